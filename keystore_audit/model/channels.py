"""Channels: domain class × topic class × partition class, exact over all names and ids.

Every expression of every readable document, as each kind of implementation reads it, takes part in the classes, so that
each ordered rule list, each default and each governance look-up is constant on a class; one evaluation per class is
then exact for all names (docs/model.md). Classes that no rule of any document tells apart are merged: that hands no
decision to anybody, since equal matches decide alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

from keystore_audit.dataclass import dataclass
from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.atoms import TopicClass
from keystore_audit.model.domains import Interval, contains, domain_bits, domain_classes
from keystore_audit.model.expression import Matcher
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.model.partition_patterns import between
from keystore_audit.model.patterns import MAX_KEPT, Patterns
from keystore_audit.model.profiles import Access
from keystore_audit.model.semantics import DEFAULT_PARTITION, Region
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
    `columns`: what the channels of a governed domain class stand for, in order. `meets`: by channel, the others in
    which an endpoint is met too, since its partition may be a pattern; empty where no channel meets another.
    """

    domains: tuple[DomainAtom, ...]
    channels: tuple[ChannelAtom, ...]
    regions: Mapping[Named, frozenset[int]]
    starts: tuple[int, ...]
    columns: Sequence[_Column] = ()
    meets: tuple[frozenset[int], ...] = ()

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


def build_channels(
    domains: tuple[DomainAtom, ...],
    governed: Sequence[bool],
    regions: Iterable[Named],
    points: Sequence[Point] | None = None,
    opening: frozenset[Named] | None = frozenset(),
) -> Channels:
    """The channels of all governed domain classes (`governed`, parallel to `domains`), one more for each ungoverned
    one.

    `points`: only these names, each a channel of its own that stands for its class; None: all names, in classes.
    `opening`: the regions in which somebody may be allowed to have endpoints (None: anywhere); in no other is it asked
    what patterns meet. Raises errors.BudgetExceeded where the classes are too many.
    """
    shapes = _shapes_of(tuple(dict.fromkeys(regions)))
    met: Mapping[int, frozenset[int]] = {}
    if points is None:
        columns, met = shapes.columns(opening)
    else:
        columns = [shapes.column(point) for point in points]
        met = shapes.met_by_points(points, opening)
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
    ruled = [start for start, is_governed in zip(starts, governed, strict=True) if is_governed]
    return Channels(
        domains=domains,
        channels=tuple(channels),
        regions=shapes.found(columns, ruled),
        starts=tuple(starts),
        columns=columns,
        meets=_meets(met, ruled, len(channels)),
    )


def _meets(met: Mapping[int, frozenset[int]], starts: Sequence[int], count: int) -> tuple[frozenset[int], ...]:
    """By channel, what it meets: what its column does, in its domain."""
    if not met:
        return ()
    found = [frozenset[int]()] * count
    for start in starts:
        for column, others in met.items():
            found[start + column] = frozenset(start + other for other in others)
    return tuple(found)


def document_channels(
    read: Mapping[Access, Iterable[ReadDocument]],
    points: Sequence[Point] | None = None,
    claimed: Iterable[Named] = (),
    *,
    ungoverned: bool = False,
    opened: bool = False,
) -> Channels:
    """The channels that documents tell apart, as implementations of each access row read them.

    `points`: as in `build_channels`, which says what is raised. `claimed`: names that have to be told apart as well.
    `ungoverned`: names of domains that only permissions speak of are told apart too. `opened`: those of any domain.
    """
    governed: dict[tuple[Interval, ...], None] = {}
    ruled: dict[tuple[Interval, ...], None] = {}
    regions: dict[Named, None] = dict.fromkeys(claimed)
    opening: set[Named] = set()
    by_default = False
    for access, documents in read.items():
        for document in documents:
            for domain_rule in document.domain_rules or ():
                governed[domain_rule.domains] = None
                for topic_rule in domain_rule.topic_rules:
                    regions[access.matcher, topic_rule.region] = None
            for grant in document.grants or ():
                by_default = by_default or grant.default_allow
                for rule in grant.rules:
                    ruled[rule.domains] = None
                    for region in (rule.publish, rule.subscribe, rule.relay):
                        regions[access.matcher, region] = None
                        if rule.allow and any(area.partitions != DEFAULT_PARTITION for area in region):
                            opening.add((access.matcher, region))
                    if access.first_rule_decides_topic:
                        regions[access.matcher, rule.listed] = None
    domains = domain_classes([*governed, *ruled])
    wanted = 0
    for cover in [*governed, *ruled] if ungoverned else governed:
        wanted |= domain_bits(cover)
    covers = [opened or bool(wanted >> domain.intervals[0][0] & 1) for domain in domains]
    return build_channels(domains, covers, regions, points, None if by_default else frozenset(opening))


def _check_cells(classes: int, others: int, words: str) -> None:
    """Raises errors.BudgetExceeded for more pairs than can be worked out."""
    if classes * others > MAX_CELLS:
        message = f"{classes} {words.format(others)} are more than can be worked out (limit {MAX_CELLS} pairs)."
        raise BudgetExceeded(message)


_Table = tuple[list[_Column], dict[int, frozenset[int]]]
"""Columns, and which of them meet which others."""

_Shape = tuple[tuple[tuple[int, ...], "tuple[int, ...] | None"], ...]
"""A region by what its expressions mean: the numbers of topic and of partition patterns of each area."""


class _Shapes:
    """The regions by what they mean: however many are written alike, or mean the same to several implementations."""

    def __init__(self, regions: Iterable[Named]) -> None:
        self._topics = Patterns()
        self._partitions = Patterns(topics=False)
        self._numbers: dict[_Shape, int] = {}
        self._of = {named: self._number(named) for named in regions}
        self._columns: dict[frozenset[Named] | None, _Table] = {}
        self._by_topic: dict[str, tuple[TopicClass, list[tuple[int, frozenset[int] | None]]]] = {}

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

    def columns(self, opening: frozenset[Named] | None) -> _Table:
        """The cells (topic class × partition class) that no shape tells apart, merged, and which meet which others.

        What a cell is met by is part of what tells it apart: rights in one column mean one thing then.
        """
        if opening not in self._columns:
            self._columns[opening] = self._tabulated(opening)
        return self._columns[opening]

    def _tabulated(self, opening: frozenset[Named] | None) -> _Table:
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
        allowing = None if opening is None else {self._of[named] for named in opening}
        met_by = self._met_by(allowing, partitions, partitions_of)
        merged: dict[tuple[tuple[int, ...], frozenset[tuple[int, ...]]], list[tuple[int, int]]] = {}
        edges: list[tuple[tuple[int, int], tuple[int, int]]] = []
        for partition, row in enumerate(hits):
            for topic, cell in enumerate(row):
                others = _NOTHING_MET
                if partition in met_by:
                    meeting = [p for p in met_by[partition] if allowing is None or allowing & {*hits[p][topic]}]
                    edges += (((p, topic), (partition, topic)) for p in meeting)
                    others = frozenset(tuple(hits[p][topic]) for p in meeting) - {tuple(cell)}
                merged.setdefault((tuple(cell), others), []).append((partition, topic))
        columns = [_column(signature, cells, topics, partitions) for (signature, _), cells in merged.items()]
        return columns, between(merged.values(), edges)

    def _met_by(
        self, allowing: set[int] | None, partitions: Sequence[TopicClass], places: Sequence[Sequence[int]]
    ) -> dict[int, list[int]]:
        """By partition class: the others in which somebody may have endpoints that patterns make meet it."""
        asked: set[int] = set()
        for shape, number in self._numbers.items():
            for _, listed in shape if allowing is None or number in allowing else ():
                asked.update(range(len(partitions)) if listed is None else (q for p in listed for q in places[p]))
        if allowing is None:
            asked.update(range(len(partitions)))
        met_by: dict[int, list[int]] = {}
        for place, others in self._partitions.meetings(sorted(asked - {0})).items():
            for other in others:
                met_by.setdefault(other, []).append(place)
        return met_by

    def met_by_points(self, points: Sequence[Point], opening: frozenset[Named] | None) -> dict[int, frozenset[int]]:
        """By point: those of the same topic that are met by who may be in its class of partitions."""
        if opening is not None and not opening:
            return {}
        partitions = [self._partitions.empty(), *self._partitions.classes()]
        allowing = None if opening is None else {self._of[named] for named in opening}
        met_by = self._met_by(allowing, partitions, self._partitions.places(partitions))
        place_of = {each.members: place for place, each in enumerate(partitions) if place}
        by_topic: dict[str, dict[int, list[int]]] = {}
        for number, (topic, partition) in enumerate(points) if met_by else ():
            place = place_of[self._partitions.matching(partition)] if partition else 0
            by_topic.setdefault(topic, {}).setdefault(place, []).append(number)
        found: dict[int, set[int]] = {}
        for at in by_topic.values():
            for place, others in at.items():
                for meeting in met_by.get(place, ()):
                    for one in at.get(meeting, ()):
                        found.setdefault(one, set()).update(others)
        return {number: frozenset(others) for number, others in found.items()}

    def column(self, point: Point) -> _Column:
        """One topic name in one partition."""
        topic, partition = point
        only, shapes = self._topic(topic)
        listed = self._partitions.matching(partition)
        hits = {number for number, partitions in shapes if partitions is None or not listed.isdisjoint(partitions)}
        return _Column(hits=tuple(sorted(hits)), topic=only, partition=partition, infinite=False)

    def _topic(self, name: str) -> tuple[TopicClass, list[tuple[int, frozenset[int] | None]]]:
        """One topic name, and the shapes that list it, each with the partition patterns beside it."""
        known = self._by_topic.get(name)
        if known is None:
            named = self._topics.matching(name)
            only = TopicClass(members=named, witness=name, ros=is_ros_dds_name(name), infinite=False)
            known = self._by_topic[name] = only, [each for pattern in named for each in self._listing.get(pattern, ())]
        return known

    @cached_property
    def _listing(self) -> dict[int, list[tuple[int, frozenset[int] | None]]]:
        """By topic pattern: the shapes that list it, each with the partition patterns beside it."""
        listing: dict[int, list[tuple[int, frozenset[int] | None]]] = {}
        for shape, number in self._numbers.items():
            for topics, listed in shape:
                partitions = None if listed is None else frozenset(listed)
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


def _shapes_of(regions: tuple[Named, ...]) -> _Shapes:
    """The shapes of regions: the same for those who ask about the same regions in turn, as in `patterns.classes_of`."""
    return _kept_shapes(regions) if len(regions) <= MAX_KEPT else _Shapes(regions)


_kept_shapes = lru_cache(maxsize=4)(_Shapes)

_NOTHING_MET: Final = frozenset[tuple[int, ...]]()


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
