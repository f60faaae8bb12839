"""Rules of one grant that decide nothing, change nothing, or whose order decides.

The anomalies that Al-Shaer and Hamed found among firewall rules (Discovery of policy anomalies in distributed
firewalls, 2004). They are exact here over operations, domains, topics and partitions. Domains and partitions in which
nothing is allowed anyway, by no rule and no default, do not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.grouped import gathered
from keystore_audit.keystore.document import MAX_DOMAIN
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.anomalies.anomaly import AnomalyKind, Effort, NameClass, Point, RuleAnomaly, name_classes
from keystore_audit.model.domains import Interval, domain_bits
from keystore_audit.model.formal.bit_sets import bits, lowest, members, union
from keystore_audit.model.formal.steps import Step, decided, deciding
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.names import AMBIENT_TOPICS
from keystore_audit.model.semantics import DIRECTIONS, ReadRule
from keystore_audit.profiles import Matcher

_MAX_BITS: Final = 1 << 27
"""Cells times rules: 16 MB, and some 50 milliseconds."""

_MAX_WITNESSES: Final = 32
"""Cells among which one is looked for that people can read."""

_EVERY_DOMAIN: Final = (2 << MAX_DOMAIN) - 1


class Own(NamedTuple):
    """Where the first rule that lists a topic decides about own endpoints, whatever it says of peers. `everywhere`: in
    other domains, too. `any_operation`: for whatever operation, in whatever partition.
    """

    everywhere: bool = False
    any_operation: bool = False


def rule_anomalies(
    rules: Sequence[ReadRule],
    *,
    default_allow: bool,
    matcher: Matcher,
    effort: Effort,
    implied: frozenset[int],
    own: Own,
) -> Iterator[RuleAnomaly]:
    """The anomalies of a grant's rules, of which the first that matches decides.

    `implied`: numbers of rules that only say what the rule before them leaves out (`semantics`); nothing is said of
    them. Raises errors.BudgetExceeded.
    """
    cells = _Cells(rules, matcher, effort, default_allow=default_allow)
    order = _Order(rules, cells, implied, own)
    yield from order.never_firing()
    yield from order.without_effect(default_allow=default_allow)
    if any(rule.allow for rule in rules) and not all(rule.allow for rule in rules):
        yield from order.expressions_never_firing()
        yield from order.overlapping(effort)


class Expression(NamedTuple):
    """One expression of a rule with the cells that it is about."""

    operation: Operation
    text: str
    cells: int


class _Cells:
    """All (operation, domain, partition, topic) that a grant's rules tell apart, numbered; sets of them as bits."""

    def __init__(self, rules: Sequence[ReadRule], matcher: Matcher, effort: Effort, *, default_allow: bool) -> None:
        self._domains = _domain_classes(rules, everywhere=default_allow)
        self._names = _texts(rules)
        topics = name_classes(self._names, matcher, effort)
        self._partitions, self._partition_bits = _partition_classes(rules, matcher, effort, everywhere=default_allow)
        self._topics = topics
        self._plane = len(topics) * len(self._domains) * len(self._partitions)
        if self._plane * len(Operation) * max(len(rules), 1) > _MAX_BITS:
            raise BudgetExceeded("there are too many rules in too many domains and partitions")
        self._topic_bits = _holding(self._names, topics)
        self._spreads: dict[tuple[tuple[Interval, ...], tuple[str, ...] | None], int] = {}

    def rule(self, rule: ReadRule) -> int:
        """The cells that a rule is about."""
        found = 0
        for at, operation in enumerate(Operation):
            for area in rule.region(operation):
                named = union(self._topic_bits[text] for text in area.topics)
                found |= named * self._spread(rule.domains, area.partitions) << at * self._plane
        return found

    def names(self, rule: ReadRule, *operations: Operation) -> int:
        """The topics that a rule lists for these operations, or for all."""
        return union(self._topic_bits[text] for text in rule.texts(*operations))

    def expressions(self, rule: ReadRule) -> Iterator[Expression]:
        """The expressions of a rule, as written."""
        for at, operation in enumerate(Operation):
            for area in rule.region(operation):
                spread = self._spread(rule.domains, area.partitions)
                for text in area.topics:
                    yield Expression(operation, text, self._topic_bits[text] * spread << at * self._plane)

    def says_something(self, rule: ReadRule) -> bool:
        """Whether the rule is about any cell, except cells in which nothing is allowed anyway."""
        return bool(rule.domains) and any(
            self._topic_bits[text] and (area.partitions is None or area.partitions)
            for operation in Operation
            for area in rule.region(operation)
            for text in area.topics
        )

    def best(self, cells: int) -> int:
        """The one of these cells, at least one, that people read most easily."""
        return min(islice(members(cells), _MAX_WITNESSES), key=lambda cell: _readable(self.point(cell)))

    def point(self, cell: int) -> Point:
        """What is done in the cell, by example."""
        operation, rest = divmod(cell, self._plane)
        place, topic = divmod(rest, len(self._topics))
        domain, partition = divmod(place, len(self._partitions))
        return Point(
            tuple(Operation)[operation],
            self._topics[topic].witness,
            self._partitions[partition].witness,
            lowest(self._domains[domain]),
        )

    def _spread(self, domains: tuple[Interval, ...], partitions: tuple[str, ...] | None) -> int:
        """The factor that puts a set of topics into each of the domains and partitions."""
        known = self._spreads.get((domains, partitions))
        if known is None:
            cover = domain_bits(domains)
            inside = [number for number, each in enumerate(self._domains) if each & cover]
            listed = self._listed(partitions)
            known = bits(
                (domain * len(self._partitions) + partition) * len(self._topics)
                for domain in inside
                for partition in listed
            )
            self._spreads[domains, partitions] = known
        return known

    def _listed(self, partitions: tuple[str, ...] | None) -> Sequence[int]:
        if partitions is None:
            return range(len(self._partitions))
        return tuple(members(union(self._partition_bits[text] for text in partitions)))


def _alone(sets: Mapping[int, int], number: int) -> int:
    """What is in this set and in no other."""
    return sets.get(number, 0) & ~union(each for other, each in sets.items() if other != number)


def _texts(rules: Iterable[ReadRule]) -> tuple[str, ...]:
    """The distinct topic expressions of all rules."""
    return tuple(dict.fromkeys(text for rule in rules for text in rule.texts()))


def _domain_classes(rules: Sequence[ReadRule], *, everywhere: bool) -> list[int]:
    """Domains that no rule tells apart, of those in which something may be allowed."""
    live = _EVERY_DOMAIN if everywhere else 0
    covers: dict[tuple[Interval, ...], int] = {}
    for rule in rules:
        covers.setdefault(rule.domains, domain_bits(rule.domains))
        if rule.allow:
            live |= covers[rule.domains]
    classes = [live] if live else []
    for cover in set(covers.values()):
        classes = [part for each in classes for part in (each & cover, each & ~cover) if part]
    return sorted(classes, key=lowest)


def _partition_classes(
    rules: Sequence[ReadRule], matcher: Matcher, effort: Effort, *, everywhere: bool
) -> tuple[Sequence[NameClass], dict[str, int]]:
    """Partitions that no rule tells apart, of those in which something may be allowed; the classes of each expression.

    The empty name, the default partition, is a class of its own.
    """
    listed = [
        (rule.allow, area.partitions) for rule in rules for operation in Operation for area in rule.region(operation)
    ]
    texts = tuple(dict.fromkeys(text for _allow, partitions in listed for text in partitions or ()))
    empty = NameClass(frozenset(n for n, text in enumerate(texts) if parse(text, matcher).matches("")), "")
    classes = [empty]
    if everywhere or any(texts):  # what no expression matches is the rest of `*`
        classes += name_classes((*texts, "*") if everywhere else texts, matcher, effort)
    if not everywhere:
        allowed = {text for allow, partitions in listed if allow for text in partitions or ()}
        live = {number for number, text in enumerate(texts) if text in allowed}
        classes = [each for each in classes if not live.isdisjoint(each.members)]
    return classes, _holding(texts, classes)


def _holding(texts: Sequence[str], classes: Sequence[NameClass]) -> dict[str, int]:
    """By expression, its classes: a class's members are places among `texts`, or behind them."""
    holding = gathered((member, number) for number, each in enumerate(classes) for member in each.members)
    return {text: bits(holding.get(number, ())) for number, text in enumerate(texts)}


def _readable(point: Point) -> tuple[object, ...]:
    return point.partition != "", point.topic in AMBIENT_TOPICS, len(point.topic), point


_Listed = dict[bool, dict[tuple[Operation, tuple[Interval, ...]], int]]
"""By what rules decide, operation and domains, the topics that they list."""


class _Fired(Struct):
    """A rule with the cells that it is about and those that it decides."""

    number: int
    rule: ReadRule
    cells: int
    fires: int


class _Order:
    """The rules in order, each with where it fires."""

    def __init__(self, rules: Sequence[ReadRule], cells: _Cells, implied: frozenset[int], own: Own) -> None:
        self._cells = cells
        self._implied = implied
        self._own = own
        self._steps = [Step(cells.rule(rule), rule.allow, number) for number, rule in enumerate(rules)]
        fires = {step.by: part for step, part in decided(self._steps)}
        self._rules = [_Fired(n, rule, self._steps[n].channels, fires.get(n, 0)) for n, rule in enumerate(rules)]

    def never_firing(self) -> Iterator[RuleAnomaly]:
        """Rules that fire nowhere although they are about something."""
        fired = {True: 0, False: 0}
        for each in self._rules:
            if each.cells and not each.fires and each.number not in self._implied:
                opposite = each.cells & fired[not each.rule.allow]
                kind = AnomalyKind.UNREACHABLE if opposite else AnomalyKind.REDUNDANT
                cell = self._cells.best(opposite or each.cells)
                other = deciding(self._steps, cell).by
                yield RuleAnomaly(kind=kind, rule=each.number, other=other, point=self._cells.point(cell))
            fired[each.rule.allow] |= each.fires

    def without_effect(self, *, default_allow: bool) -> Iterator[RuleAnomaly]:
        """Rules that fire but change nothing: taken out one by one, from the last on.

        Rules that fire nowhere count as gone before, except one that would fire without this one, and decide the
        opposite. An allow rule also lets its holder join its domains.
        """
        later: list[_Fired] = []
        listed: _Listed = {True: {}, False: {}}
        unheard = {True: 0, False: 0}
        allowing = () if default_allow else (each for each in self._rules if each.rule.allow and each.fires)
        joined = {each.number: domain_bits(each.rule.domains) for each in allowing}
        allowed, matched = (-1 if default_allow else 0), 0
        for each in reversed(self._rules):
            allow, fires = each.rule.allow, each.fires
            self._list(each.rule, listed[allow])
            if not each.cells:
                said = each.number not in self._implied and self._cells.says_something(each.rule)
                if not allow and said and not self._decides_own(each.rule, listed[not allow]):
                    yield RuleAnomaly(kind=AnomalyKind.SAME_AS_DEFAULT, rule=each.number)
                continue
            if not fires:
                unheard[allow] |= each.cells
                continue
            completed = each.number in self._implied or each.number + 1 in self._implied
            same = not fires & ((~allowed if allow else allowed) | unheard[not allow])
            same = same and not _alone(joined, each.number) and not completed
            if same and not self._decides_own(each.rule, listed[not allow]):
                joined.pop(each.number, None)
                kept = fires & matched
                kind = AnomalyKind.REDUNDANT if kept else AnomalyKind.SAME_AS_DEFAULT
                cell = self._cells.best(kept or fires)
                other = next(rule.number for rule in reversed(later) if rule.cells >> cell & 1) if kept else None
                yield RuleAnomaly(kind=kind, rule=each.number, other=other, point=self._cells.point(cell))
                continue
            later.append(each)
            matched |= each.cells
            allowed = allowed | each.cells if allow else allowed & ~each.cells

    def _list(self, rule: ReadRule, listed: dict[tuple[Operation, tuple[Interval, ...]], int]) -> None:
        """Note what a rule lists, where own endpoints are decided apart."""
        for operation in DIRECTIONS if self._own != Own() else ():
            key = operation, rule.domains
            listed[key] = listed.get(key, 0) | self._cells.names(rule, operation)

    def _decides_own(self, rule: ReadRule, later: Mapping[tuple[Operation, tuple[Interval, ...]], int]) -> bool:
        """Whether a later rule may decide otherwise about own endpoints that this rule decides about."""
        covered, every = domain_bits(rule.domains), self._cells.names(rule)
        named = {operation: self._cells.names(rule, operation) for operation in DIRECTIONS}
        return any(
            (self._own.everywhere and names & named[operation])
            or (self._own.any_operation and names & every and covered & domain_bits(domains))
            for (operation, domains), names in later.items()
        )

    def expressions_never_firing(self) -> Iterator[RuleAnomaly]:
        """Expressions to which earlier rules leave nothing, and one of those decides the opposite."""
        before = 0
        fired = {True: 0, False: 0}
        for each in self._rules:
            if each.fires and each.cells & before and each.number not in self._implied:
                for expression in dict.fromkeys(self._cells.expressions(each.rule)):
                    opposite = expression.cells & fired[not each.rule.allow]
                    if opposite and not expression.cells & ~before:
                        cell = self._cells.best(opposite)
                        yield RuleAnomaly(
                            kind=AnomalyKind.EXPRESSION_UNREACHABLE,
                            rule=each.number,
                            other=deciding(self._steps, cell).by,
                            operation=expression.operation,
                            expression=expression.text,
                            point=self._cells.point(cell),
                        )
            before |= each.cells
            fired[each.rule.allow] |= each.fires

    def overlapping(self, effort: Effort) -> Iterator[RuleAnomaly]:
        """Pairs of expressions of opposite rules where the earlier decides and the later would decide otherwise."""
        later: list[_Fired] = []
        others = {True: 0, False: 0}
        for each in reversed(self._rules):
            opposite = each.fires & others[not each.rule.allow]
            if each.number in self._implied or not each.fires:
                continue
            if opposite:
                for expression in dict.fromkeys(self._cells.expressions(each.rule)):
                    if expression.cells & opposite:
                        yield from self._pairs(each, expression, later, effort)
            later.append(each)
            others[each.rule.allow] |= each.cells

    def _pairs(
        self, each: _Fired, expression: Expression, later: Sequence[_Fired], effort: Effort
    ) -> Iterator[RuleAnomaly]:
        decides = expression.cells & each.fires
        effort.compare(len(later))
        for rule in reversed(later):
            if rule.rule.allow is each.rule.allow or not rule.cells & decides:
                continue
            others = dict.fromkeys(self._cells.expressions(rule.rule))
            effort.compare(len(others))
            for other in others:
                shared = other.cells & decides
                if shared and other.cells & rule.fires:
                    exception = not expression.cells & ~other.cells
                    yield RuleAnomaly(
                        kind=AnomalyKind.GENERALISED if exception else AnomalyKind.CORRELATED,
                        rule=each.number,
                        other=rule.number,
                        operation=expression.operation,
                        expression=expression.text,
                        other_expression=other.text,
                        point=self._cells.point(self._cells.best(shared)),
                    )
