"""Anomalies of ordered rules against every name one by one: found where the definition holds, and nowhere else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import product
from typing import NamedTuple

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.anomalies.anomaly import AnomalyKind, Effort, Point, RuleAnomaly
from keystore_audit.model.anomalies.rules import Own, rule_anomalies
from keystore_audit.model.semantics import ReadRule, read_rules
from keystore_audit.profiles import VARIANTS, Matcher
from tests.amount import tried
from tests.rules.divergent import ruled
from tests.rules.evidence import grant

NAMES = tuple("".join(name) for length in (1, 2, 3) for name in product("abc", repeat=length))
PARTITIONS = ("", "p", "q", "pq")
DOMAINS = (0, 1, 2)
OPERATIONS = (Operation.PUBLISH, Operation.SUBSCRIBE)
POINTS = tuple(Point(*each) for each in product(OPERATIONS, NAMES, PARTITIONS, DOMAINS))
"""Few enough to ask each rule about each; every class of names that the drawn expressions can make is among them."""

_TOPICS = st.lists(
    st.sampled_from(("a", "b", "ab", "*", "*", "a*", "*b", "?b", "[ab]", "[!a]*", "a*b", "b?*")), min_size=1, max_size=3
)
_PARTITIONS = st.one_of(
    st.none(), st.none(), st.lists(st.sampled_from(("p", "q", "p*", "*", "")), min_size=1, max_size=2, unique=True)
)
_CRITERIA = st.lists(st.tuples(_TOPICS, _PARTITIONS), max_size=2)
_PLAIN = st.lists(st.tuples(_TOPICS, st.none()), min_size=1, max_size=1)
_DOMAIN_SETS = st.sampled_from((((0, 0),), ((0, 0),), ((0, 2),), ((1, 2),), ((0, 0), (2, 2))))
_RULES = st.one_of(
    st.tuples(st.booleans(), st.just(((0, 0),)), _PLAIN, st.just([])),
    st.tuples(st.booleans(), _DOMAIN_SETS, _CRITERIA, _CRITERIA),
)


@cache
def matches(expression: str, name: str) -> bool:
    """Our own reading of the few expressions above."""
    pattern = expression.replace("[!", "[^").replace("*", ".*").replace("?", ".")
    return re.fullmatch(pattern, name) is not None


class Listed(NamedTuple):
    """A rule, or one expression of it, as tuples."""

    allow: bool
    domains: tuple[tuple[int, int], ...]
    areas: tuple[tuple[Operation, tuple[str, ...], tuple[str, ...] | None], ...]

    @classmethod
    def of(cls, rule: ReadRule) -> Listed:
        areas = tuple((o, area.topics, area.partitions) for o in Operation for area in rule.region(o))
        return cls(rule.allow, rule.domains, areas)

    def single(self, operation: Operation, expression: str) -> list[Listed]:
        """The rule reduced to one expression, once for each criterion that has it."""
        return [
            self._replace(areas=((o, (expression,), partitions),))
            for o, topics, partitions in self.areas
            if o is operation and expression in topics
        ]

    def holds(self, point: Point) -> bool:
        return any(low <= point.domain <= high for low, high in self.domains) and any(
            operation is point.operation
            and any(matches(topic, point.topic) for topic in topics)
            and (partitions is None or any(matches(each, point.partition) for each in partitions))
            for operation, topics, partitions in self.areas
        )

    def set(self) -> frozenset[Point]:
        return _set(self)


@lru_cache(maxsize=4096)
def _set(listed: Listed) -> frozenset[Point]:
    return frozenset(filter(listed.holds, POINTS))


class Brute:
    """The definitions of `AnomalyKind`, word by word."""

    def __init__(self, rules: Sequence[ReadRule], *, default: bool) -> None:
        self.rules = [Listed.of(rule) for rule in rules]
        self.default = default
        self.sets = [rule.set() for rule in self.rules]
        domains = {
            p.domain
            for p in POINTS
            for r in self.rules
            if r.allow and any(lo <= p.domain <= hi for lo, hi in r.domains)
        }
        partitions = {
            partition
            for partition in PARTITIONS
            for rule in self.rules
            if rule.allow
            for _operation, _topics, listed in rule.areas
            if listed is None or any(matches(each, partition) for each in listed)
        }
        self.live = frozenset(p for p in POINTS if default or (p.domain in domains and p.partition in partitions))
        self.first = {p: next((n for n, s in enumerate(self.sets) if p in s), None) for p in self.live}
        self.fires = [frozenset(p for p, n in self.first.items() if n == number) for number in range(len(self.rules))]

    def decisions(self, kept: Sequence[int]) -> list[bool]:
        return [next((self.rules[n].allow for n in kept if p in self.sets[n]), self.default) for p in POINTS]

    def joined(self, kept: Sequence[int]) -> set[int]:
        """The domains that an allow rule lets its holder join."""
        allowing = [self.rules[number] for number in kept if self.rules[number].allow]
        return {d for rule in allowing for low, high in rule.domains for d in range(low, high + 1)}

    def opposed(self, points: frozenset[Point], allow: bool) -> bool:
        firsts = {self.first[p] for p in points & self.live}
        return any(n is not None and self.rules[n].allow is not allow for n in firsts)

    def heard_without(self, number: int) -> bool:
        """Whether a later rule that fires nowhere would decide the opposite if this one went."""
        return any(
            not self.fires[n] and rule.allow is not self.rules[number].allow and self.sets[n] & self.fires[number]
            for n, rule in enumerate(self.rules)
            if n > number
        )

    def whole_rules(self) -> set[tuple[AnomalyKind, int]]:
        found = set()
        for number, rule in enumerate(self.rules):
            if self.sets[number] & self.live and not self.fires[number]:
                opposed = self.opposed(self.sets[number], rule.allow)
                found.add((AnomalyKind.UNREACHABLE if opposed else AnomalyKind.REDUNDANT, number))
        kept = [number for number in range(len(self.rules)) if self.fires[number]]
        for number in reversed(kept.copy()):
            without = [n for n in kept if n != number]
            joins = self.default or self.joined(without) == self.joined(kept)
            if joins and self.decisions(without) == self.decisions(kept) and not self.heard_without(number):
                kept = without
                helped = any(self.fires[number] & self.sets[n] for n in kept if n > number)
                found.add((AnomalyKind.REDUNDANT if helped else AnomalyKind.SAME_AS_DEFAULT, number))
        for number, rule in enumerate(self.rules):
            if not rule.allow and self.sets[number] and not self.sets[number] & self.live:
                found.add((AnomalyKind.SAME_AS_DEFAULT, number))
        return found

    def expressions(self) -> set[tuple[int, Operation, str]]:
        found = set()
        for number, operation, text, own in self._singles():
            dead = own & self.live and not any(self.first[p] == number for p in own & self.live)
            if self.fires[number] and dead and self.opposed(own, self.rules[number].allow):
                found.add((number, operation, text))
        return found

    def pairs(self) -> set[tuple[AnomalyKind, int, Operation, str, int, str]]:
        found = set()
        singles = list(self._singles())
        for (i, operation, x, mine), (j, _o, y, theirs) in product(singles, singles):
            opposed = i < j and self.rules[i].allow is not self.rules[j].allow
            if opposed and mine & theirs & self.fires[i] and theirs & self.fires[j]:
                exception = mine & self.live <= theirs
                kind = AnomalyKind.GENERALISED if exception else AnomalyKind.CORRELATED
                found.add((kind, i, operation, x, j, y))
        return found

    def _singles(self):  # type: ignore[no-untyped-def]
        for number, rule in enumerate(self.rules):
            for operation, topics, _partitions in dict.fromkeys(rule.areas):
                for text in dict.fromkeys(topics):
                    for single in rule.single(operation, text):
                        yield number, operation, text, single.set()


WHOLE = {AnomalyKind.UNREACHABLE, AnomalyKind.REDUNDANT, AnomalyKind.SAME_AS_DEFAULT}
PAIRS = {AnomalyKind.CORRELATED, AnomalyKind.GENERALISED}


def read(
    drawn: Sequence[tuple[bool, object, object, object]], *, default: bool, profile: str = "spec"
) -> list[ReadRule]:
    rules = [
        ruled(allows=allows, domains=domains, publish=publish, subscribe=subscribe)  # type: ignore[arg-type]
        for allows, domains, publish, subscribe in drawn
    ]
    made = grant("/talker", *rules, default_allow=default)
    return list(read_rules(made, VARIANTS[profile].access))


def found_in(rules: Sequence[ReadRule], *, default: bool) -> list[RuleAnomaly]:
    effort = Effort.of(1)
    return list(
        rule_anomalies(
            rules, default_allow=default, matcher=Matcher.POSIX, effort=effort, implied=frozenset(), own=Own()
        )
    )


@settings(max_examples=tried(120), deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    st.lists(_RULES, min_size=1, max_size=4),
    st.sampled_from((False, False, True)),
    st.sampled_from(("spec", "cyclonedds-11")),
)
def test_anomalies_are_found_exactly(drawn, default, profile) -> None:  # type: ignore[no-untyped-def]
    rules = read(drawn, default=default, profile=profile)
    brute = Brute(rules, default=default)
    found = found_in(rules, default=default)
    assert {(each.kind, each.rule) for each in found if each.kind in WHOLE} == brute.whole_rules()
    dead = {(e.rule, e.operation, e.expression) for e in found if e.kind is AnomalyKind.EXPRESSION_UNREACHABLE}
    assert dead == brute.expressions()
    pairs = {(e.kind, e.rule, e.operation, e.expression, e.other, e.other_expression) for e in found if e.kind in PAIRS}
    assert pairs == brute.pairs()
