"""KA6: rules of a grant that decide nothing, change nothing, or whose order decides (`model.anomalies.find`).

One finding for each document and severity. KA601 to KA616 report what implementations order or read differently. Where
a rule is odd under only some of them, their finding about its line stands alone, unless it voids a denial to the
specification.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.grouped import grouped
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Point
from keystore_audit.model.names import ros_name
from keystore_audit.profiles import VARIANTS
from keystore_audit.rules.registry import VERBS, Context, Violation, listed, more_like, quoted, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import DocumentUse, PermissionsUse, speaks

_IN_ORDER: Final = "DDS-Security 1.1, 9.4.1.3 (of the rules of a grant the first that matches decides)"


def odd(use: DocumentUse, context: Context, kind: AnomalyKind) -> list[Anomaly]:
    """The anomalies of a kind in the document, but for those that a divergence speaks for."""
    every = context.meaning.anomalies.get(use.signed.file.place, ())
    found = [anomaly for anomaly in every if anomaly.kind is kind]
    if not any(anomaly.profiles for anomaly in found):
        return found
    spoken = _spoken(use, context)
    return [
        anomaly
        for anomaly in found
        if not anomaly.profiles or anomaly.serious or spoken.isdisjoint(anomaly.rules - {None})
    ]


def _spoken(use: DocumentUse, context: Context) -> set[int | None]:
    """The lines of the document of which a divergence speaks."""
    return {
        location.line
        for divergence in context.meaning.divergences
        for location in (divergence.location, divergence.other)
        if location is not None and location.path == use.signed.file.place
    }


Says = Callable[[Anomaly, str], str]
"""What is said of the first of some anomalies; the text tells how many more are like it."""


def all_odd(use: DocumentUse, context: Context, kind: AnomalyKind, says: Says, other: str = "") -> Iterator[Violation]:
    """What is said of all anomalies of a kind."""
    return folded(use, odd(use, context, kind), says, other)


def folded(use: DocumentUse, found: Iterable[Anomaly], says: Says, other: str = "") -> Iterator[Violation]:
    """One violation for all serious anomalies, one for all others, each a location; `other` names the second."""
    for serious, alike in grouped(found, lambda anomaly: anomaly.serious).items():
        named = {name for anomaly in alike for name in anomaly.profiles}
        everywhere = any(not anomaly.profiles for anomaly in alike)
        yield Violation(
            says(alike[0], more_like(alike)),
            [*_locations(use, alike, other)],
            severity=Severity.HIGH if serious else None,
            profiles=() if everywhere else tuple(name for name in VARIANTS if name in named),
            # What is odd is part of it: another rule is not hidden by one that was accepted before.
            key="\n".join(sorted({f"{anomaly.subject} {anomaly.key}" for anomaly in alike})),
        )


def _locations(use: DocumentUse, found: Sequence[Anomaly], other: str) -> Iterator[Location]:
    place = use.signed.file.place
    for anomaly in found:
        yield Location(place, anomaly.line)
        if anomaly.other is not None and anomaly.other != anomaly.line:
            yield Location(place, anomaly.other, message=other)


def named(anomaly: Anomaly) -> str:
    """`The deny rule for 'rt/a' and 'rt/b'`, as far as people read."""
    verb = "allow" if anomaly.allow else "deny"
    return f"The {verb} rule for {listed(quoted(text) for text in anomaly.texts)}"


def right(point: Point) -> str:
    """`publish /chatter in domain 0`."""
    where = f", partition {quoted(point.partition)}" if point.partition else ""
    return f"{VERBS[point.operation]} {ros_name(point.topic)} in domain {point.domain}{where}"


def _decided(anomaly: Anomaly, *, allowed: bool) -> str:
    may = "may" if allowed else "may not"
    return f"{quoted(anomaly.subject)} {may} {right(anomaly.point)}" if anomaly.point is not None else ""


@rule(
    "KA617",
    Severity.MEDIUM,
    _IN_ORDER,
    in_permissions("Move the rule before the one that decides in its place, or remove it"),
    applies=speaks,
)
def rule_unreachable(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A rule never decides: earlier rules match all of it, and decide the opposite for some of it.

    High for a deny rule: what it denies is allowed. Decided over all names, domains and partitions in which anything is
    allowed. `ros2 security` writes deny rules first.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.UNREACHABLE,
        lambda first, more: (
            f"{named(first)}{more} never decides, since earlier rules match all of it: "
            f"{_decided(first, allowed=not first.allow)}."
        ),
        "the rule that decides instead",
    )


@rule(
    "KA618",
    Severity.MEDIUM,
    _IN_ORDER,
    in_permissions("Move the rule before the one that decides in its place, or remove the expression"),
    applies=speaks,
)
def expression_unreachable(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An expression of a rule names only what earlier rules match, and one of them decides the opposite.

    High in a deny rule: what it names is allowed. If no expression of the rule decides, see rule-unreachable.
    Expressions that repeat the same rule or a like one are no finding.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.EXPRESSION_UNREACHABLE,
        lambda first, more: (
            f"{quoted(first.texts[0])}{more} in {_a_rule(first)} never decides, since earlier rules "
            f"match all of it: {_decided(first, allowed=not first.allow)}."
        ),
        "the rule that decides instead",
    )


def _a_rule(anomaly: Anomaly) -> str:
    return "an allow rule" if anomaly.allow else "a deny rule"


@rule(
    "KA619",
    Severity.LOW,
    _IN_ORDER,
    in_permissions("Remove the rule, so that one rule alone decides"),
    applies=speaks,
)
def rule_redundant(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A rule changes nothing: other rules decide the same about everything that it decides.

    Whoever removes a right from one of them may believe it gone. All rules named can go, alone or together, and so can
    rules that never decide. The rule that `ros2 security` adds for ros_discovery_info is no finding.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.REDUNDANT,
        lambda first, more: (
            f"{named(first)}{more} changes nothing, since another rule decides the same: "
            f"{_decided(first, allowed=first.allow)} with or without it."
        ),
        "the rule that decides the same",
    )


@rule(
    "KA620",
    Severity.MEDIUM,
    _IN_ORDER,
    in_permissions("Let each rule name only what the other does not, so that their order does not matter"),
    applies=speaks,
)
def rules_correlated(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An allow and a deny expression share names, neither holds all of the other's, and the order of the rules decides.

    Neither is an exception to the other, so a reader cannot tell what was meant for the shared names. Domains and
    partitions count.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.CORRELATED,
        lambda first, more: (
            f"{_opposed(first)}{more} share names, and the earlier rule decides: "
            f"{_decided(first, allowed=first.allow)}."
        ),
        "the rule that comes too late",
    )


def _opposed(anomaly: Anomaly) -> str:
    first, second = ("allowed", "denied") if anomaly.allow else ("denied", "allowed")
    return f"{quoted(anomaly.texts[0])}, {first}, and {quoted(anomaly.other_text)}, {second},"


@rule(
    "KA621",
    Severity.INFO,
    _IN_ORDER,
    decision("Keep the order of the rules if the exception is meant."),
    applies=speaks,
)
def rule_generalised(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A rule is an exception to a later, more general one: the usual way to write exceptions.

    It depends on the order: in the other order, the exception would be void.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.GENERALISED,
        lambda first, more: (
            f"{quoted(first.texts[0])}{more} is {'allowed' if first.allow else 'denied'} as an "
            f"exception to {quoted(first.other_text)}: {_decided(first, allowed=first.allow)}."
        ),
        "the general rule",
    )


@rule(
    "KA622",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.3 (default: what no rule matches)",
    in_permissions("Remove the rule: what no rule allows is denied"),
    applies=speaks,
)
def rule_same_as_default(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A rule changes nothing: no other rule is about what it decides, and the default decides the same.

    Usually harmless. On Cyclone DDS 0.10 such a deny rule may take the whole topic away: see deny-rule-blocks-topic. On
    Fast DDS it may void a later rule for another domain. Related: default-allow, grant-without-allow-rule,
    rule-in-no-governed-domain.
    """
    every = odd(use, context, AnomalyKind.SAME_AS_DEFAULT)
    if not every:
        return
    allowing = {each.subject_name.text for each in use.document.grants if any(one.allow for one in each.rules)}
    found = [anomaly for anomaly in every if not anomaly.allow and anomaly.subject in allowing]
    outside = {(anomaly.subject, anomaly.key) for anomaly in odd(use, context, AnomalyKind.UNGOVERNED_DOMAIN)}
    nothing = {text for anomaly in odd(use, context, AnomalyKind.MATCHES_NOTHING) for text in anomaly.texts}
    spoken = _spoken(use, context)
    yield from folded(
        use,
        (
            anomaly
            for anomaly in found
            if (anomaly.subject, anomaly.key) not in outside
            and anomaly.line not in spoken
            and not nothing.issuperset(anomaly.texts)
        ),
        lambda first, more: (
            f"{named(first)}{more} changes nothing: the default is DENY, and no other rule is about it{_as_in(first)}."
        ),
    )


def _as_in(anomaly: Anomaly) -> str:
    if anomaly.point is None:
        return ""
    return f" ({quoted(anomaly.subject)} may not {right(anomaly.point)} without it either)"
