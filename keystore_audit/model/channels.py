"""Channels: domain class × topic class × partition class, exact over all names and ids.

Every expression of every readable document, as each kind of implementation reads it, takes part in the classes, so that
each ordered rule list, each default and each governance look-up is constant on a class; one evaluation per class is
then exact for all names (docs/model.md). Classes that no rule of any document tells apart are merged: that hands no
decision to anybody, since equal matches decide alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.atoms import TopicClass, classify
from keystore_audit.model.domains import Interval, contains, describe, elementary
from keystore_audit.model.expression import Matcher, Pattern, parse
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.model.profiles import Access
from keystore_audit.model.semantics import Region
from keystore_audit.model.system import ChannelAtom, DomainAtom

ANY_TOPIC = "rt/chatter"
"""The name by which the channel of an ungoverned domain goes: every topic there is alike."""

MAX_CELLS = 1_000_000
"""Pairs of a topic class and a partition or domain class: about a second and 200 MB. Beyond it the answer is unknown;
10,000 enclaves as `ros2 security` makes them have some 300,000."""

Named = tuple[Matcher, Region]
"""A region with the matcher that reads its expressions."""

Point = tuple[str, str]
"""A topic name and a partition name."""


class Cell(NamedTuple):
    """A class of topics in a class of partitions, by one name each. `infinite`: it holds infinitely many."""

    topic: str
    partition: str
    infinite: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Channels:
    """The classes, and what each region matches.

    `regions`: the channels of each, in every governed domain class. `starts`: by domain class, its first channel.
    `columns`: what the channels of a governed domain class stand for, in order.
    """

    domains: tuple[DomainAtom, ...]
    channels: tuple[ChannelAtom, ...]
    regions: Mapping[Named, frozenset[int]]
    starts: tuple[int, ...]
    columns: Sequence[_Column] = ()

    def cells(self, channel: int) -> list[Cell]:
        """What a channel stands for: those that are told apart in no region are one channel."""
        atom = self.channels[channel]
        start, end = self._bounds(atom.domain)
        if end - start != len(self.columns):  # an ungoverned class has one channel for all names
            return [Cell(atom.topic, atom.partition, atom.infinite)]
        return self.columns[channel - start].named()

    def of_point(self, domain: int, point: int) -> int:
        """The channel of a point, by its place among the points asked for, in a domain id of 0..232."""
        number = next(n for n, atom in enumerate(self.domains) if contains(atom.intervals, domain))
        start, end = self._bounds(number)
        return min(start + point, end - 1)  # an ungoverned class has one channel for all points

    def _bounds(self, domain: int) -> tuple[int, int]:
        """The first channel of a domain class, and the one after its last."""
        return self.starts[domain], self.starts[domain + 1] if domain + 1 < len(self.starts) else len(self.channels)


@dataclass(frozen=True, slots=True)
class _Column:
    """One merged set of (topic class, partition class) pairs: the shapes that hold it, and its witness."""

    hits: tuple[int, ...]
    topic: TopicClass
    partition: str
    infinite: bool
    cells: Sequence[tuple[int, int]] = ()  # of the classes below: partition and topic
    topics: Sequence[TopicClass] = ()
    partitions: Sequence[TopicClass] = ()

    def named(self) -> list[Cell]:
        """What was merged."""
        return [
            Cell(
                self.topics[topic].witness,
                self.partitions[partition].witness,
                self.topics[topic].infinite or self.partitions[partition].infinite,
            )
            for partition, topic in self.cells
        ] or [Cell(self.topic.witness, self.partition, infinite=False)]


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
    regions: Iterable[Named],
    points: Sequence[Point] | None = None,
) -> Channels:
    """The channels of all governed domain classes (`governed`, parallel to `domains`), one more for each ungoverned
    one.

    `points`: only these names, each a channel of its own; None: all names, in classes. Raises errors.BudgetExceeded
    where the classes are too many.
    """
    shapes = _Shapes(regions)
    columns = shapes.columns() if points is None else [shapes.column(point) for point in points]
    _check_cells(len(columns), sum(governed), "classes of topics in {} classes of domains")
    channels: list[ChannelAtom] = []
    starts: list[int] = []
    for number, is_governed in enumerate(governed):
        starts.append(len(channels))
        if not is_governed:
            channels.append(ChannelAtom(domain=number, topic=ANY_TOPIC, partition="", ros=True, infinite=True))
            continue
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
    return Channels(
        domains=domains,
        channels=tuple(channels),
        regions=shapes.found(columns, [start for start, ruled in zip(starts, governed, strict=True) if ruled]),
        starts=tuple(starts),
        columns=columns,
    )


def document_channels(
    read: Mapping[Access, Iterable[ReadDocument]],
    points: Sequence[Point] | None = None,
    claimed: Iterable[Named] = (),
    *,
    ungoverned: bool = False,
) -> Channels:
    """The channels that documents tell apart, as implementations of each access row read them.

    `points`: as in `build_channels`, which says what is raised. `claimed`: names that have to be told apart as well.
    `ungoverned`: names of domains that only permissions speak of are told apart too.
    """
    governed: dict[tuple[Interval, ...], None] = {}
    ruled: dict[tuple[Interval, ...], None] = {}
    regions: dict[Named, None] = dict.fromkeys(claimed)
    for access, documents in read.items():
        for document in documents:
            for domain_rule in document.domain_rules or ():
                governed[domain_rule.domains] = None
                for topic_rule in domain_rule.topic_rules:
                    regions[access.matcher, topic_rule.region] = None
            for grant in document.grants or ():
                for rule in grant.rules:
                    ruled[rule.domains] = None
                    for region in (rule.publish, rule.subscribe, rule.relay):
                        regions[access.matcher, region] = None
                    if access.first_rule_decides_topic:
                        regions[access.matcher, rule.listed] = None
    domains = domain_classes([*governed, *ruled])
    wanted = [*governed, *ruled] if ungoverned else [*governed]
    covers = [any(contains(cover, domain.intervals[0][0]) for cover in wanted) for domain in domains]
    return build_channels(domains, covers, regions, points)


def _check_cells(classes: int, others: int, words: str) -> None:
    """Raises errors.BudgetExceeded for more pairs than can be worked out."""
    if classes * others > MAX_CELLS:
        message = f"{classes} {words.format(others)} are more than can be worked out (limit {MAX_CELLS} pairs)."
        raise BudgetExceeded(message)


_Shape = tuple[tuple[tuple[int, ...], "tuple[int, ...] | None"], ...]
"""A region by what its expressions mean: the numbers of topic and of partition patterns of each area."""


class _Shapes:
    """The regions by what they mean: however many are written alike, or mean the same to several implementations."""

    def __init__(self, regions: Iterable[Named]) -> None:
        self._topics = _Patterns()
        self._partitions = _Patterns()
        self._numbers: dict[_Shape, int] = {}
        self._of = {named: self._number(named) for named in dict.fromkeys(regions)}

    def _number(self, named: Named) -> int:
        matcher, region = named
        shape = tuple(
            (
                tuple(self._topics.number(text, matcher) for text in area.topics),
                None
                if area.partitions is None
                else tuple(self._partitions.number(text, matcher) for text in area.partitions),
            )
            for area in region
        )
        return self._numbers.setdefault(shape, len(self._numbers))

    def columns(self) -> list[_Column]:
        """The cells (topic class × partition class) that no shape tells apart, merged."""
        topics, partitions = self._topics.classes(), [self._partitions.empty(), *self._partitions.classes()]
        _check_cells(len(topics), len(partitions), "topic classes in {} partition classes")
        topics_of, partitions_of = self._topics.places(topics), self._partitions.places(partitions)
        hits: list[list[list[int]]] = [[[] for _ in topics] for _ in partitions]
        for shape, number in self._numbers.items():
            for topic_patterns, partition_patterns in shape:
                for row in hits if partition_patterns is None else _chosen(hits, partition_patterns, partitions_of):
                    for pattern in topic_patterns:
                        for topic in topics_of[pattern]:
                            cell = row[topic]
                            if not cell or cell[-1] != number:
                                cell.append(number)
        merged: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        for partition, row in enumerate(hits):
            for topic, cell in enumerate(row):
                merged.setdefault(tuple(cell), []).append((partition, topic))
        return [_column(signature, cells, topics, partitions) for signature, cells in merged.items()]

    def column(self, point: Point) -> _Column:
        """One topic name in one partition."""
        topic, partition = point
        named = self._topics.matching(topic)
        listed = self._partitions.matching(partition)
        hits = {
            number
            for pattern in named
            for number, partitions in self._listing.get(pattern, ())
            if partitions is None or not listed.isdisjoint(partitions)
        }
        only = TopicClass(members=named, witness=topic, ros=is_ros_dds_name(topic), infinite=False)
        return _Column(hits=tuple(sorted(hits)), topic=only, partition=partition, infinite=False)

    @cached_property
    def _listing(self) -> dict[int, list[tuple[int, tuple[int, ...] | None]]]:
        """By topic pattern: the shapes that list it, each with the partition patterns beside it."""
        listing: dict[int, list[tuple[int, tuple[int, ...] | None]]] = {}
        for shape, number in self._numbers.items():
            for topics, partitions in shape:
                for pattern in topics:
                    listing.setdefault(pattern, []).append((number, partitions))
        return listing

    def found(self, columns: Sequence[_Column], starts: Sequence[int]) -> dict[Named, frozenset[int]]:
        """The channels of each region."""
        matched: list[list[int]] = [[] for _ in self._numbers]
        for at, column in enumerate(columns):
            for hit in column.hits:
                matched[hit].append(at)
        # Shared by regions that match the same: thousands of one expression times 233 classes of domains are 200 MB.
        shared = {each: frozenset(start + at for start in starts for at in each) for each in map(tuple, matched)}
        frozen = [shared[tuple(each)] for each in matched]
        return {named: frozen[number] for named, number in self._of.items()}


def _chosen(
    rows: list[list[list[int]]], patterns: Sequence[int], places: Sequence[Sequence[int]]
) -> list[list[list[int]]]:
    """The rows of the partition classes that one of the patterns matches."""
    return [rows[place] for place in sorted({place for pattern in patterns for place in places[pattern]})]


def _column(
    signature: tuple[int, ...],
    cells: list[tuple[int, int]],
    topics: Sequence[TopicClass],
    partitions: Sequence[TopicClass],
) -> _Column:
    """The column of these cells, with the witness that a person reads most easily."""
    partition, topic = cells[0]
    if len(cells) > 1:
        partition, topic = min(
            cells, key=lambda cell: (cell[0] != 0, not topics[cell[1]].ros, topics[cell[1]].infinite, cell)
        )
    return _Column(
        hits=signature,
        topic=topics[topic],
        partition=partitions[partition].witness,
        infinite=len(cells) > 1 or topics[topic].infinite or partitions[partition].infinite,
        cells=cells,
        topics=topics,
        partitions=partitions,
    )


class _Patterns:
    """Expressions of one sort of name, each meaning once."""

    def __init__(self) -> None:
        self._patterns: list[Pattern] = []
        self._by_meaning: dict[object, int] = {}
        self._known: dict[tuple[str, Matcher], int] = {}
        self._literals: dict[str, int] = {}
        self._wildcards: list[int] = []

    def number(self, text: str, matcher: Matcher) -> int:
        """The number of the pattern."""
        number = self._known.get((text, matcher))
        if number is None:
            pattern = parse(text, matcher)
            number = self._by_meaning.setdefault((pattern.rewinds, pattern.pieces), len(self._patterns))
            if number == len(self._patterns):
                self._patterns.append(pattern)
                if pattern.literal is None:
                    self._wildcards.append(number)
                else:
                    self._literals[pattern.literal] = number
            self._known[text, matcher] = number
        return number

    def classes(self) -> tuple[TopicClass, ...]:
        """The classes of all non-empty names."""
        return classify(self._patterns)

    def empty(self) -> TopicClass:
        """The class of the empty name alone: the default partition."""
        return TopicClass(members=self.matching(""), witness="", ros=False, infinite=False)

    def matching(self, name: str) -> frozenset[int]:
        """The patterns that match the name."""
        literal = self._literals.get(name)
        found = [number for number in self._wildcards if self._patterns[number].matches(name)]
        return frozenset(found if literal is None else [literal, *found])

    def places(self, classes: Sequence[TopicClass]) -> list[list[int]]:
        """By pattern: the classes whose names it matches."""
        places: list[list[int]] = [[] for _ in self._patterns]
        for place, each in enumerate(classes):
            for member in each.members:
                places[member].append(place)
        return places
