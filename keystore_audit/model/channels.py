"""Channels: domain class × topic class × partition class, exact over all names and ids.

Every expression of every readable document takes part in the classes, so that each ordered rule list, each
default and each governance look-up is constant on a class; one evaluation per class is then exact for all
names (docs/model.md). Classes that no rule of any document tells apart are merged: that hands no decision to
anybody, since equal matches decide alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.governance import TopicRule
from keystore_audit.keystore.permissions import Criterion, Operation, Rule
from keystore_audit.model.atoms import TopicClass, classify
from keystore_audit.model.domains import Interval, contains, covered, describe, elementary
from keystore_audit.model.expression import Matcher, Pattern, parse
from keystore_audit.model.system import ChannelAtom, DomainAtom

ANY_TOPIC = "rt/chatter"
"""The name by which the channel of an ungoverned domain goes: every topic there is alike."""


MAX_CELLS = 1_000_000
"""Pairs of a topic class and a partition or domain class: about a second and 200 MB. Beyond it the answer is unknown;
10,000 enclaves as `ros2 security` makes them have some 300,000."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleMatches:
    """Channels that the criteria of one permissions rule match, whatever its domains."""

    publish: frozenset[int]
    subscribe: frozenset[int]
    relay: frozenset[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Channels:
    """The classes, and what each rule matches: `topic_rules` and `rules` are in the order they were given in."""

    domains: tuple[DomainAtom, ...]
    channels: tuple[ChannelAtom, ...]
    topic_rules: tuple[frozenset[int], ...]
    rules: tuple[RuleMatches, ...]


@dataclass(frozen=True, slots=True)
class _Column:
    """One merged set of (topic class, partition class) pairs: who matches it, and its witness."""

    hits: tuple[int, ...]
    topic: TopicClass
    partition: str
    infinite: bool


def domain_classes(covers: Iterable[Sequence[Interval]]) -> tuple[DomainAtom, ...]:
    """Domain ids 0..232 in classes that no cover tells apart."""
    distinct = list(dict.fromkeys(tuple(cover) for cover in covers))
    classes: dict[tuple[bool, ...], list[Interval]] = {}
    for low, high in elementary(distinct):
        signature = tuple(contains(cover, low) for cover in distinct)
        classes.setdefault(signature, []).append((low, high))
    atoms = []
    for intervals in classes.values():
        several = len(intervals) > 1 or intervals[0][0] != intervals[0][1]
        label = f"{'domains' if several else 'domain'} {describe(intervals)}"
        atoms.append(DomainAtom(label=label, intervals=tuple(intervals)))
    return tuple(atoms)


def build_channels(
    domains: tuple[DomainAtom, ...],
    governed: Sequence[bool],
    topic_rules: Sequence[TopicRule],
    rules: Sequence[Rule],
) -> Channels:
    """The channels of all governed domain classes (`governed`, parallel to `domains`), one more for each
    ungoverned class.

    Raises errors.BudgetExceeded where the topic classes are too many.
    """
    columns = _columns(topic_rules, rules)
    _check_cells(len(columns), sum(governed), "classes of topics in {} classes of domains")
    channels: list[ChannelAtom] = []
    matched: list[list[int]] = [[] for _ in range(len(topic_rules) + 3 * len(rules))]
    for at, column in enumerate(columns):
        for hit in column.hits:
            matched[hit].append(at)
    starts: list[int] = []
    for number, is_governed in enumerate(governed):
        if not is_governed:
            channels.append(ChannelAtom(domain=number, topic=ANY_TOPIC, partition="", ros=True, infinite=True))
            continue
        starts.append(len(channels))
        channels.extend(
            ChannelAtom(
                domain=number,
                topic=column.topic.witness,
                partition=column.partition,
                ros=column.topic.ros,
                infinite=column.infinite,
            )
            for column in columns
        )
    # Shared by rules that match the same: thousands of one expression times 233 classes of domains are 200 MB.
    shared = {each: frozenset(start + at for start in starts for at in each) for each in map(tuple, matched)}
    frozen = [shared[tuple(each)] for each in matched]
    first = len(topic_rules)
    return Channels(
        domains=domains,
        channels=tuple(channels),
        topic_rules=tuple(frozen[:first]),
        rules=tuple(
            RuleMatches(publish=frozen[at], subscribe=frozen[at + 1], relay=frozen[at + 2])
            for at in range(first, len(frozen), 3)
        ),
    )


def _check_cells(classes: int, others: int, words: str) -> None:
    """Raises errors.BudgetExceeded for more pairs than can be worked out."""
    if classes * others > MAX_CELLS:
        message = f"{classes} {words.format(others)} are more than can be worked out (limit {MAX_CELLS} pairs)."
        raise BudgetExceeded(message)


def _columns(topic_rules: Sequence[TopicRule], rules: Sequence[Rule]) -> list[_Column]:
    """Merged columns. A hit is the number of a topic rule, or of (permissions rule, operation) after those."""
    topics = _Classes(
        [rule.expression.text for rule in topic_rules]
        + [text.text for rule in rules for criterion in rule.criteria for text in criterion.topics],
        with_empty=False,
    )
    partitions = _Classes(
        [text.text for rule in rules for criterion in rule.criteria for text in criterion.partitions or ()],
        with_empty=True,
    )
    _check_cells(len(topics.classes), len(partitions.classes), "topic classes in {} partition classes")
    operations = {Operation.PUBLISH: 0, Operation.SUBSCRIBE: 1, Operation.RELAY: 2}
    hits: list[list[list[int]]] = [[[] for _ in topics.classes] for _ in partitions.classes]
    for number, topic_rule in enumerate(topic_rules):
        for topic in topics.of(topic_rule.expression.text):
            for row in hits:
                row[topic].append(number)
    for number, rule in enumerate(rules):
        for criterion in rule.criteria:
            hit = len(topic_rules) + 3 * number + operations[criterion.operation]
            where = partitions_of(criterion, rule, partitions)
            for text in criterion.topics:
                for topic in topics.of(text.text):
                    for partition in where:
                        cell = hits[partition][topic]
                        if not cell or cell[-1] != hit:
                            cell.append(hit)
    merged: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for partition, row in enumerate(hits):
        for topic, cell in enumerate(row):
            merged.setdefault(tuple(sorted(set(cell))), []).append((partition, topic))
    return [_column(signature, cells, topics, partitions) for signature, cells in merged.items()]


def _column(
    signature: tuple[int, ...], cells: list[tuple[int, int]], topics: _Classes, partitions: _Classes
) -> _Column:
    """The column of these cells, with the witness that a person reads most easily."""
    partition, topic = cells[0]
    if len(cells) > 1:
        partition, topic = min(
            cells,
            key=lambda cell: (cell[0] != 0, not topics.classes[cell[1]].ros, topics.classes[cell[1]].infinite, cell),
        )
    return _Column(
        hits=signature,
        topic=topics.classes[topic],
        partition=partitions.classes[partition].witness,
        infinite=len(cells) > 1 or topics.classes[topic].infinite or partitions.classes[partition].infinite,
    )


def partitions_of(criterion: Criterion, rule: Rule, partitions: _Classes) -> list[int]:
    """The partition classes that a criterion covers.

    Without a list, an allow rule covers the default partition only, a deny rule all of them (DDS-Security
    1.1, 9.4.1.3.2.3.1.4 and 9.4.1.3.2.3.2.4).
    """
    if criterion.partitions is None:
        return [0] if rule.allow else list(range(len(partitions.classes)))
    found: set[int] = set()
    for text in criterion.partitions:
        found.update(partitions.of(text.text))
    return sorted(found)


class _Classes:
    """The classes of one set of expressions.

    With `with_empty`, class 0 is the empty name (the default partition).
    """

    def __init__(self, texts: Iterable[str], *, with_empty: bool) -> None:
        distinct = list(dict.fromkeys(texts))
        self._patterns: list[Pattern] = [parse(text, Matcher.POSIX) for text in distinct]
        self._number = {text: number for number, text in enumerate(distinct)}
        self._classes_of: list[list[int]] = [[] for _ in distinct]
        self.classes: list[TopicClass] = []
        if with_empty:
            empty = frozenset(n for n, pattern in enumerate(self._patterns) if pattern.matches(""))
            self.classes.append(TopicClass(members=empty, witness="", ros=False, infinite=False))
        self.classes.extend(classify(self._patterns))
        for number, topic_class in enumerate(self.classes):
            for member in topic_class.members:
                self._classes_of[member].append(number)

    def of(self, text: str) -> list[int]:
        """The classes whose names the expression matches."""
        return self._classes_of[self._number[text]]


def covers_of(rules: Iterable[Rule]) -> list[tuple[Interval, ...]]:
    """What the domains of each permissions rule cover."""
    return [covered(rule.domains) for rule in rules]
