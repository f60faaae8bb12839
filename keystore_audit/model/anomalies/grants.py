"""The anomalies of one grant as one implementation reads it, told of its lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Effort, RuleAnomaly
from keystore_audit.model.anomalies.rules import Own, rule_anomalies
from keystore_audit.model.domains import describe, domain_bits
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import Pattern, has_wildcard, parse
from keystore_audit.model.names import (
    DISCOVERY_TOPIC,
    REPLY_SUFFIX,
    REQUEST_SUFFIX,
    SUFFIX_OF,
    TOPIC_PREFIX,
    Use,
    is_ros_dds_name,
)
from keystore_audit.model.semantics import ReadGrant, ReadRule
from keystore_audit.profiles import Matcher

# Expressions that match no name, or none that ROS 2 produces.


_STATES: Final = 256
"""States for one expression: one with ten stars has some hundred."""

_COST: Final = 4
"""States of the keystore's effort that asking about one character of an expression takes."""

_NOT_OF_NAMES: Final = re.compile(r"[^A-Za-z0-9_/\n]")
_NOT_OF_TOKENS: Final = re.compile(r"/[0-9]")
_BROKEN: Final = ("//", "/\n", f"/{REQUEST_SUFFIX}\n", f"/{REPLY_SUFFIX}\n")
_PROBES: Final = ("", "a", "/a", "a/b", "t/a", "rt/a")
"""What is tried for each star: most expressions that match a ROS 2 name match one of these."""


def void(texts: Iterable[str], matchers: Collection[Matcher], effort: Effort) -> set[str]:
    """Those that match nothing under any matcher: no name matches, or they are malformed and no ROS 2 name does.

    Raises errors.BudgetExceeded.
    """
    found = set()
    for text in texts:
        if "[" in text or "\\" in text:
            patterns = [parse(text, matcher) for matcher in matchers]
            if all(_is_void(pattern, effort) for pattern in patterns):
                found.add(text)
    return found


def _is_void(pattern: Pattern, effort: Effort) -> bool:
    if pattern.undefined:
        return False
    return matches_nothing(pattern) or (pattern.malformed is not None and not _has_ros_name(pattern, effort))


def matches_nothing(pattern: Pattern) -> bool:
    """Whether no name matches: it needs a character that does not exist, or matches only the empty name."""
    return pattern.literal == "" or any(
        not isinstance(piece, str) and any(not isinstance(each, str) and not each.ranges for each in piece)
        for piece in pattern.pieces
    )


def foreign(texts: Collection[str], matchers: Collection[Matcher], effort: Effort) -> set[str]:
    """Those that match no name of ROS 2 under any of the matchers. Raises errors.BudgetExceeded."""
    return {
        text
        for text in texts
        if not is_ros_dds_name(text) and not any(_has_ros_name(parse(text, matcher), effort) for matcher in matchers)
    }


def are_ros_names(texts: Collection[str]) -> bool:
    """Whether all certainly are; the quick check for 100,000s of names."""
    whole = "\n".join(texts) + "\n"
    if _NOT_OF_NAMES.search(whole) or _NOT_OF_TOKENS.search(whole) or any(broken in whole for broken in _BROKEN):
        return False
    for text in texts:
        suffix = SUFFIX_OF.get(text[:3])
        if suffix is None:
            if text != DISCOVERY_TOPIC:
                return False
        elif suffix and not text.endswith(suffix):
            return False
    return True


def _has_ros_name(pattern: Pattern, effort: Effort) -> bool:
    """Whether a name of ROS 2 matches; the empty name and NUL are in no name."""
    if pattern.literal is not None:
        return is_ros_dds_name(pattern.literal)
    prefix = pattern.prefix
    starts = (*SUFFIX_OF, DISCOVERY_TOPIC)
    if not any(start.startswith(prefix) or prefix.startswith(start) for start in starts):
        return False
    if any(isinstance(piece, str) and _NOT_OF_NAMES.search(piece) for piece in pattern.pieces):
        return False
    if _probed(pattern):
        return True
    effort.states -= _COST * len(pattern.text)
    if effort.states < 0:
        raise BudgetExceeded("there are too many expressions to be held against the names of ROS 2")
    return _decided(pattern.text, pattern.matcher)


def _probed(pattern: Pattern) -> bool:
    """Whether one of a few names that the expression matches is of ROS 2."""
    if len(pattern.pieces) == 1:
        name = "rt/".ljust(len(pattern.pieces[0]), "a")
        return is_ros_dds_name(name) and pattern.matches(name)
    if not all(isinstance(piece, str) for piece in pattern.pieces):
        return False
    pieces = [str(piece) for piece in pattern.pieces]
    names = (probe.join(pieces) for probe in _PROBES)
    return any(is_ros_dds_name(name) and pattern.matches(name) for name in names)


@lru_cache(maxsize=4096)
def _decided(text: str, matcher: Matcher) -> bool:
    """Whether a ROS 2 name matches, decided over all names; yes where that takes too many states: nothing is wrong."""
    try:
        classes = classify((parse(text, matcher),), budget=_STATES)
    except BudgetExceeded:
        return True
    return any(each.ros for each in classes if each.members)


_WHOLE_RULE: Final = frozenset({AnomalyKind.UNREACHABLE, AnomalyKind.REDUNDANT, AnomalyKind.SAME_AS_DEFAULT})


def has_ordinary_rules(grant: ReadGrant) -> bool:
    """Whether its rules are as `ros2 security` writes them where nothing is denied, so that no order matters.

    One allow rule, and that for ros_discovery_info; or several that have no expression in common and no wildcards.
    """
    if grant.default_allow or not all(rule.allow for rule in grant.rules):
        return False
    if sum(not is_discovery_rule(rule) for rule in grant.rules) <= 1:
        return True
    for operation in Operation:
        listed = [area.topics for rule in grant.rules for area in rule.region(operation)]
        if len(set().union(*listed)) < sum(map(len, listed)) or has_wildcard("\n".join(map("\n".join, listed))):
            return False
    return True


def is_discovery_rule(rule: ReadRule) -> bool:
    """Whether it is the one that `ros2 security` adds for the announcements of DDS participants."""
    areas = (*rule.publish, *rule.subscribe)
    return bool(areas) and not rule.relay and all(area.topics == (DISCOVERY_TOPIC,) for area in areas)


def order_anomalies(grant: ReadGrant, matcher: Matcher, effort: Effort, own: Own) -> Iterator[Anomaly]:
    """What is odd about the order of its rules. Raises errors.BudgetExceeded."""
    rules = [rule for rule in grant.rules if not rule.of_peers]
    # A denial that stands for the partitions which an allow rule leaves out (`semantics`).
    implied = frozenset(number for number, rule in enumerate(rules) if rule.allow is not rule.rule.allow)
    told = _Told(grant, rules, implied)
    for found in rule_anomalies(
        rules, default_allow=grant.default_allow, matcher=matcher, effort=effort, implied=implied, own=own
    ):
        redundant = found.kind is AnomalyKind.REDUNDANT
        if not (redundant and is_discovery_rule(rules[found.rule])):
            yield told.of(found)


class _Told:
    """Turns numbers of rules into lines."""

    def __init__(self, grant: ReadGrant, rules: Sequence[ReadRule], implied: frozenset[int]) -> None:
        self._grant = grant
        self._rules = rules
        self._implied = implied

    def of(self, found: RuleAnomaly) -> Anomaly:
        """The anomaly with its lines and texts."""
        rule = self._rules[found.rule]
        whole = found.kind in _WHOLE_RULE
        other = None if found.other is None else self._rules[found.other].line
        if found.other is not None and found.other_expression is not None and found.operation is not None:
            other = self._line(found.other, found.operation, found.other_expression)
        operation = "" if found.operation is None else found.operation.value
        single = f"{operation} {found.expression} {found.other_expression}"
        return Anomaly(
            kind=found.kind,
            allow=rule.allow,
            subject=self._grant.grant.subject_name.text,
            line=rule.line if found.operation is None else self._line(found.rule, found.operation, found.expression),
            other=other,
            texts=tuple(dict.fromkeys(rule.texts())) if whole else (found.expression or "",),
            other_text=found.other_expression or "",
            point=found.point,
            key=f"{'allow' if rule.allow else 'deny'} {_signature(rule) if whole else single}",
            rules=frozenset((rule.line, None if found.other is None else self._rules[found.other].line)),
            serious=not rule.allow and found.kind in (AnomalyKind.UNREACHABLE, AnomalyKind.EXPRESSION_UNREACHABLE),
        )

    def _line(self, number: int, operation: Operation, expression: str | None) -> int | None:
        rule = self._rules[number]
        listed = (
            text.line
            for criterion in rule.rule.criteria
            if criterion.operation is operation and number not in self._implied
            for text in criterion.topics
            if text.text == expression
        )
        return next(listed, rule.line)


def _signature(rule: ReadRule) -> str:
    """The rule's content, without lines."""
    said = sorted(
        f"{operation.value} {text} {'in all' if area.partitions is None else sorted(area.partitions)}"
        for operation in Operation
        for area in rule.region(operation)
        for text in area.topics
    )
    return "\n".join((describe(rule.domains), *said))


def ungoverned_rules(grant: ReadGrant, governed: int) -> Iterator[Anomaly]:
    """Rules about domains that no governance covers, unless that is so of all allow rules of the grant.

    `governed`: domain ids as bits.
    """
    outside = [rule for rule in grant.rules if rule.domains and not domain_bits(rule.domains) & governed]
    if outside and any(rule.allow and domain_bits(rule.domains) & governed for rule in grant.rules):
        for rule in outside:
            if not rule.of_peers:
                yield Anomaly(
                    kind=AnomalyKind.UNGOVERNED_DOMAIN,
                    allow=rule.allow,
                    subject=grant.grant.subject_name.text,
                    line=rule.line,
                    texts=tuple(dict.fromkeys(rule.texts())),
                    other_text=describe(rule.domains),
                    key=f"{'allow' if rule.allow else 'deny'} {_signature(rule)}",
                )


def expression_anomalies(grant: ReadGrant, matchers: Sequence[Matcher], effort: Effort) -> Iterator[Anomaly]:
    """Expressions without a name, and without one that ROS 2 produces. Raises errors.BudgetExceeded.

    A grant without any expression of ROS 2 (ros_discovery_info is one) is of a plain DDS application: nothing is said
    of its names.
    """
    texts = dict.fromkeys(text for rule in grant.rules for text in rule.texts())
    if are_ros_names(texts):
        return
    nothing = void(texts, matchers, effort)
    if nothing:
        yield from _expressions(AnomalyKind.MATCHES_NOTHING, grant, nothing, bool)
    others = foreign([text for text in texts if text not in nothing], matchers, effort)
    if others and len(others) + len(nothing) < len(texts):
        yield from _expressions(
            AnomalyKind.NOT_ROS, grant, others, lambda text: _allows(grant, _meant(text), matchers[0], effort)
        )


def _expressions(
    kind: AnomalyKind, grant: ReadGrant, texts: set[str], opens: Callable[[str], bool]
) -> Iterator[Anomaly]:
    """An anomaly for each of the expressions, once for allow rules and once for deny rules.

    `opens`: whether something is given away if a deny rule has it.
    """
    seen: set[tuple[bool, str]] = set()
    for rule in grant.grant.rules:
        for criterion in rule.criteria:
            for text in criterion.topics:
                if text.text in texts and (rule.allow, text.text) not in seen:
                    seen.add((rule.allow, text.text))
                    yield Anomaly(
                        kind=kind,
                        allow=rule.allow,
                        subject=grant.grant.subject_name.text,
                        line=text.line,
                        texts=(text.text,),
                        other_text=_meant(text.text) if kind is AnomalyKind.NOT_ROS else "",
                        key=f"{'allow' if rule.allow else 'deny'} {text.text}",
                        serious=not rule.allow and opens(text.text),
                    )


def _meant(text: str) -> str:
    """The topic of ROS 2 that was most likely meant."""
    return text if text.startswith(f"{TOPIC_PREFIX}/") else f"{TOPIC_PREFIX}/{text.lstrip('/')}"


def _allows(grant: ReadGrant, topic: str, matcher: Matcher, effort: Effort) -> bool:
    """Whether some allow rule or the default allows the topic."""
    return grant.default_allow or any(
        _matches(text, matcher, topic, effort) for rule in grant.rules if rule.allow for text in rule.texts()
    )


def _matches(text: str, matcher: Matcher, topic: str, effort: Effort) -> bool:
    effort.compare(1)
    return parse(text, matcher).matches(topic)


def counterpart_anomalies(grant: ReadGrant, missing: Iterable[Use]) -> Iterator[Anomaly]:
    """Topics that the grant allows and nobody is at the other end of."""
    subject = grant.grant.subject_name.text
    lines: dict[Use, int | None] | None = None
    for operation, topic in missing:
        if lines is None:  # nearly always nothing is missing
            lines = _lines(grant)
        yield Anomaly(
            kind=AnomalyKind.NO_COUNTERPART,
            subject=subject,
            line=lines.get((operation, topic), grant.grant.line),
            texts=(topic,),
            other_text=operation.value,
            key=f"{operation.value} {topic}",
        )


def _lines(grant: ReadGrant) -> dict[Use, int | None]:
    """The first line of each expression of its allow rules."""
    lines: dict[Use, int | None] = {}
    for criterion in grant.grant.allowed:
        for text in criterion.topics:
            lines.setdefault((criterion.operation, text.text), text.line)
    return lines
