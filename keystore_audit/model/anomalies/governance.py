"""Rules of a governance that apply to nothing, since earlier ones of it apply to all that they name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import DomainRule, GovernanceFile, Operation, ProtectionKind, TopicRule
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Effort, NameClass, Point, name_classes
from keystore_audit.model.domains import describe, domain_bits
from keystore_audit.model.formal.steps import Step, allowed
from keystore_audit.model.matching.automaton import PatternIndex
from keystore_audit.model.matching.expression import Pattern, any_matches, has_wildcard, parse
from keystore_audit.model.names import (
    ACTION_PART,
    AMBIENT,
    REPLY_PREFIX,
    REQUEST_PREFIX,
    SERVICE_PREFIX,
    Use,
    is_ros_dds_name,
)
from keystore_audit.model.semantics import (
    OF_DOMAINS,
    OF_TOPICS,
    OPENING,
    ReadDomainRule,
    ReadGrant,
    ReadRule,
    is_controlled,
    strengths,
)
from keystore_audit.profiles import Matcher


class _Protections(NamedTuple):
    """What a domain rule protects: as a whole, and by its topic rules, each with its expression."""

    domain: frozenset[tuple[str, str]]
    topics: tuple[tuple[str, frozenset[tuple[str, str]]], ...]


def governance_anomalies(rules: Sequence[ReadDomainRule], matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """The anomalies of a governance: the first domain rule that covers a domain counts, of it the first topic rule.

    Raises errors.BudgetExceeded.
    """
    taken = 0
    winning: list[tuple[int, DomainRule, _Protections]] = []
    known: dict[int, list[tuple[int, DomainRule, _Protections]]] = {}
    lacking: dict[tuple[_Protections, _Protections], bool] = {}  # thousands of rules may say the same
    for read in rules:
        cover = domain_bits(read.domains)
        own = _Protections(
            _protecting(read.rule),
            tuple((topic.expression.text, _protecting(topic)) for topic in read.rule.topic_rules),
        )
        if cover and not cover & ~taken:
            if cover not in known:  # no later rule wins any of these domains
                known[cover] = [winner for winner in winning if winner[0] & cover]
            weaker = None
            for _, rule, winner in known[cover]:
                if (winner, own) not in lacking:
                    lacking[winner, own] = _lacks(winner, own, matcher, effort)
                if lacking[winner, own]:
                    weaker = rule
                    break
            yield _shadowed_domain_rule(read, weaker or known[cover][0][1], serious=weaker is not None)
            continue
        if cover & ~taken:
            winning.append((cover & ~taken, read.rule, own))
        if len(read.topic_rules) > 1:
            yield from _topic_rules(read, matcher, effort)
        taken |= cover


def _shadowed_domain_rule(read: ReadDomainRule, winner: DomainRule, *, serious: bool) -> Anomaly:
    domains = describe(read.domains)
    return Anomaly(
        kind=AnomalyKind.DOMAIN_RULE_SHADOWED,
        line=read.rule.line,
        other=winner.line,
        other_text=domains,
        key=f"domain rule {domains}",
        serious=serious,
    )


def _lacks(winner: _Protections, shadowed: _Protections, matcher: Matcher, effort: Effort) -> bool:
    """Whether the rule that applies lacks a protection of the other one."""
    if shadowed.domain - winner.domain:
        return True
    names = list(dict.fromkeys(text for each in (winner, shadowed) for text, _ in each.topics))
    for topics in name_classes(names, matcher, effort):
        listed = {names[member] for member in topics.members}
        applying, lost = (
            next((protections for text, protections in each.topics if text in listed), None)
            for each in (winner, shadowed)
        )
        effort.compare(1)
        if applying is not None and (lost is None or lost - applying):
            return True
    return False


def _topic_rules(read: ReadDomainRule, matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """Topic rules to which earlier ones of the domain rule leave nothing."""
    rules = read.rule.topic_rules
    names = list(dict.fromkeys(rule.expression.text for rule in rules))
    at = {text: number for number, text in enumerate(names)}
    classes = name_classes(names, matcher, effort)
    holding = gathered((member, number) for number, topics in enumerate(classes) for member in topics.members)
    winner: dict[int, TopicRule] = {}
    for rule in rules:
        held = holding.get(at[rule.expression.text], ())
        effort.compare(len(held) // 16 + 1)
        fresh = [number for number in held if number not in winner]
        winner.update(dict.fromkeys(fresh, rule))
        if held and not fresh:
            weaker = [number for number in held if _protecting(rule) - _protecting(winner[number])]
            shown = min(weaker or held, key=lambda number: _readable(classes[number]))
            yield _shadowed_topic_rule(read, rule, winner[shown], classes[shown].witness, serious=bool(weaker))


def _shadowed_topic_rule(
    read: ReadDomainRule, rule: TopicRule, winner: TopicRule, witness: str, *, serious: bool
) -> Anomaly:
    domains = describe(read.domains)
    return Anomaly(
        kind=AnomalyKind.TOPIC_RULE_SHADOWED,
        line=rule.line,
        other=winner.line,
        texts=(rule.expression.text,),
        other_text=winner.expression.text,
        point=Point(Operation.PUBLISH, witness, "", read.domains[0][0] if read.domains else 0),
        key=f"{domains} {rule.expression.text}",
        serious=serious,
    )


def _readable(topics: NameClass) -> tuple[object, ...]:
    return not is_ros_dds_name(topics.witness), len(topics.witness), topics.witness


def _protecting(rule: DomainRule | TopicRule) -> frozenset[tuple[str, str]]:
    """The protections of a rule, each by itself."""
    names = OF_DOMAINS if isinstance(rule, DomainRule) else OF_TOPICS
    return _protections(tuple((name, getattr(rule, name)) for name in names))


@lru_cache(maxsize=1_024)
def _protections(said: tuple[tuple[str, bool | ProtectionKind], ...]) -> frozenset[tuple[str, str]]:
    """Flags that protect, and what each kind does; some hundreds of sets, however many rules there are."""
    found = set[tuple[str, str]]()
    for name, value in said:
        if isinstance(value, ProtectionKind):
            found |= {(name, each) for each in strengths(value)}
        elif value is not (name in OPENING):
            found.add((name, ""))
    return frozenset(found)


# Topics that somebody may write and nobody may read, or the reverse, in no domain that they share.


_OF_SERVICES: Final = (f"{REQUEST_PREFIX}/", f"{REPLY_PREFIX}/", f"{SERVICE_PREFIX}/")
"""Services and actions are checked as a whole elsewhere, and may be offered to tools outside the keystore."""

_COUNTERPART: Final = {
    Operation.PUBLISH: (Operation.SUBSCRIBE, Operation.RELAY),
    Operation.SUBSCRIBE: (Operation.PUBLISH, Operation.RELAY),
}


class Counterparts:
    """Who may read and write what, by the grants of all documents of a keystore, as one implementation reads them.

    Grants count for everybody whom they name, also for those who are not in the keystore.
    """

    def __init__(
        self, documents: Iterable[ReadDocument], governances: Iterable[GovernanceFile], matcher: Matcher, effort: Effort
    ) -> None:
        self._matcher = matcher
        self._effort = effort
        self._grants = [grant for document in documents for grant in document.grants or ()]
        rules = [rule for grant in self._grants for rule in grant.rules]
        self._simple = _is_simple(rules)
        self._default = any(grant.default_allow for grant in self._grants)
        self._open = {operation: _open(governances, operation) for operation in _COUNTERPART}
        self._decisions: dict[tuple[int, Operation], _Decisions] = {}
        self._named: dict[Operation, dict[str, list[ReadGrant]]] = {operation: {} for operation in Operation}
        self._wild = {operation: PatternIndex() for operation in Operation}
        for number, grant in enumerate(self._grants):
            for operation, named in self._named.items():
                for text in _listed(grant.rules, operation):
                    named.setdefault(text, []).append(grant)
                    if has_wildcard(text):
                        self._wild[operation].add(number, parse(text, matcher))

    def missing(self, grant: ReadGrant) -> Iterator[Use]:
        """The topics that the grant allows by name and that have nobody at the other end."""
        if self._default:
            return
        for operation in _COUNTERPART:
            for topic in sorted(_listed(grant.rules, operation)):
                if not _is_usual(topic) and not self._met(grant, operation, topic):
                    yield operation, topic

    def _met(self, grant: ReadGrant, operation: Operation, topic: str) -> bool:
        """Whether somebody may be at the other end; also where the topic is no single name, or not allowed at all."""
        mine = self._places(grant, operation, topic)
        if not mine or parse(topic, self._matcher).literal != topic:
            return True
        others = _COUNTERPART[operation]
        listing = ((each, other) for other in others for each in self._listing(other, topic))
        met = any(mine & self._places(each, other, topic) for each, other in listing)
        return met or any_matches(self._open[others[0]], topic, self._matcher)

    def _listing(self, operation: Operation, topic: str) -> Iterator[ReadGrant]:
        """The grants that list the topic for the operation, by name or by a pattern."""
        yield from self._named[operation].get(topic, ())
        likely = [*self._wild[operation].candidates(topic)]
        self._effort.compare(len(likely) // 64)
        yield from (self._grants[number] for number, pattern in likely if pattern.matches(topic))

    def _places(self, grant: ReadGrant, operation: Operation, topic: str) -> int:
        """The domains in which the grant, which lists it, allows it, in whatever partition."""
        if self._simple:
            return domain_bits(grant.rules[0].domains)
        known = self._decisions.get((id(grant), operation))
        if known is None:
            known = self._decisions[id(grant), operation] = _Decisions(grant, operation, self._matcher)
        self._effort.compare(1 + len(known.wild) // 64)
        return known.places(topic)


class _Decisions:
    """What the rules of a grant decide about an operation, in their order: found by name, or by wildcards.

    `wild`: patterns with their places in that order.
    """

    def __init__(self, grant: ReadGrant, operation: Operation, matcher: Matcher) -> None:
        self.grant = grant  # kept, so that its id stays its own
        self.wild: list[tuple[int, Pattern]] = []
        self._areas = [(rule, area) for rule in grant.rules for area in rule.region(operation)]
        self._named: dict[str, list[int]] = {}
        for place, (_rule, area) in enumerate(self._areas):
            for text in area.topics:
                self._named.setdefault(text, []).append(place)
                if has_wildcard(text):
                    self.wild.append((place, parse(text, matcher)))

    def places(self, topic: str) -> int:
        """The domains in which the topic is allowed, as bits."""
        found = {*self._named.get(topic, ()), *(place for place, pattern in self.wild if pattern.matches(topic))}
        areas = map(self._areas.__getitem__, sorted(found))
        return allowed(
            Step(domain_bits(rule.domains), rule.allow, rule)
            for rule, area in areas
            if rule.allow or area.partitions is None
        )


def _listed(rules: Iterable[ReadRule], operation: Operation) -> set[str]:
    """The topics that allow rules list."""
    return set().union(*(area.topics for rule in rules if rule.allow for area in rule.region(operation)))


def _is_simple(rules: Sequence[ReadRule]) -> bool:
    """Whether all rules allow, in the same domains: then whatever two of them list meets."""
    return all(rule.allow and rule.domains == rules[0].domains for rule in rules)


def _open(governances: Iterable[GovernanceFile], operation: Operation) -> tuple[str, ...]:
    """Expressions of topics without access control in some domain of some governance."""
    return tuple(
        dict.fromkeys(
            topic.expression.text
            for file in governances
            for governance in file.readings.distinct
            for domain_rule in governance.domain_rules
            for topic in domain_rule.topic_rules
            if not is_controlled(topic, operation)
        )
    )


def _is_usual(topic: str) -> bool:
    """Whether nodes have it whether or not anybody is at the other end; Dashing has /rosout in a node's namespace."""
    return topic in AMBIENT or topic.endswith("/rosout") or topic.startswith(_OF_SERVICES) or ACTION_PART in topic
