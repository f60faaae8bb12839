"""Channels: domain class × topic class × partition class, exact over all names and ids.

Every expression of every readable document, as each kind of implementation reads it, takes part in the classes. So each
ordered rule list, each default and each governance look-up is constant on a class. One evaluation per class is then
exact for all names (docs/model.md). Classes that no rule of any document tells apart are merged.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache

from msgspec import Struct, field

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.columns import Cell, Column, Columns, Shape, Table
from keystore_audit.model.domains import Interval, contains, covered_classes, domain_bits, domain_classes, merged
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.formal.system import ChannelAtom, DomainAtom
from keystore_audit.model.matching.atoms import TopicClass
from keystore_audit.model.matching.expression import UNESCAPED_WILDCARDS
from keystore_audit.model.matching.patterns import MAX_KEPT, Patterns
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.model.semantics import CHECKED_TOGETHER, DEFAULT_PARTITION, Region
from keystore_audit.profiles import Access, Matcher

ANY_TOPIC = "rt/chatter"
"""The name of the channel of an ungoverned domain: every topic there is alike."""

MAX_CELLS = 1_000_000
"""Pairs of a topic class and a partition or domain class: a second and 200 MB. 10,000 stock enclaves have 300,000."""

MAX_FURTHER = 300_000
FURTHER = 20_000
FURTHER_PER_DOCUMENT = 1_500
"""Channels of further domain classes than the first, each with all classes of names: about 200 MB. Also how many of
them a keystore of few documents has. 1,000 enclaves have 30,000 classes of names: they may be in ten domain classes."""

MAX_RULED = 50_000_000
"""Pairs of such a channel and what topic rules of governance documents are about: a second and 50 MB."""

ReadRegion = tuple[Matcher, Region]
"""A region with the matcher that reads its expressions."""
Point = tuple[str, ...]
"""A topic name, and the names of all partitions that an endpoint is in."""

_Listed = tuple[int, frozenset[int] | None, bool]
"""A shape that lists a topic, with the partition patterns beside it, and `every` of the area."""


class Channels(Struct, frozen=True, kw_only=True, eq=False):
    """The classes, and what each region matches.

    `regions`: the channels of each, in every governed domain class. `in_domain`: by domain class, its channels.
    `columns`: what the channels of a governed domain class stand for, in order. `meets`: by channel, the others in
    which an endpoint is met too, since its partition may be a pattern; empty where no channel meets another.
    """

    domains: tuple[DomainAtom, ...]
    channels: tuple[ChannelAtom, ...]
    regions: Mapping[ReadRegion, frozenset[int]]
    in_domain: tuple[range, ...]
    columns: Sequence[Column] = ()
    meets: tuple[frozenset[int], ...] = ()
    _covered: dict[tuple[Interval, ...], frozenset[int]] = field(default_factory=dict)

    def covered(self, cover: tuple[Interval, ...]) -> frozenset[int]:
        """The domain classes that the cover is about, where it is one that made them; worked out once."""
        known = self._covered.get(cover)
        if known is None:
            known = self._covered[cover] = covered_classes(cover, self.domains)
        return known

    def cells(self, channel: int) -> list[Cell]:
        """What a channel stands for: cells that no region tells apart are one channel."""
        atom = self.channels[channel]
        here = self.in_domain[atom.domain]
        if len(here) != len(self.columns):  # an ungoverned class has one channel for all names
            return [Cell(atom.topic, atom.partition, atom.infinite)]
        return self.columns[channel - here.start].named()

    def of_point(self, domain: int, point: int) -> int:
        """The channel of a point, by its place among the points asked for, in a domain id of 0..232."""
        here = self.in_domain[self.domain_class(domain)]
        return here[min(point, len(here) - 1)]  # an ungoverned class has one channel for all points

    def domain_class(self, domain: int) -> int:
        """The class of a domain id of 0..232."""
        return next(number for number, atom in enumerate(self.domains) if contains(atom.intervals, domain))

    def bits_in(self, domain: int) -> int:
        """The channels of a domain class as a bit set."""
        here = self.in_domain[domain]
        return (1 << here.stop) - (1 << here.start)

    def within(self, cover: tuple[Interval, ...]) -> int:
        """The channels, as a bit set, of the domains that the cover is about, where it is one that made the classes."""
        return union(map(self.bits_in, self.covered(cover)))


def build_channels(
    domains: tuple[DomainAtom, ...],
    governed: Sequence[bool],
    regions: Iterable[ReadRegion],
    points: Sequence[Point] | None = None,
    opening: frozenset[ReadRegion] | None = frozenset(),
    ruling: int = 0,
    documents: int = 0,
) -> Channels:
    """The channels of all governed domain classes (`governed`, parallel to `domains`), one more for each ungoverned
    one.

    `points`: only these names, each a channel of its own that stands for its class; None: all names, in classes.
    `opening`: the regions in which somebody may be allowed to have endpoints (None: anywhere); in no other is it asked
    what patterns meet. `ruling`: how many of the regions are of topic rules. `documents`: how many say all this. Raises
    errors.BudgetExceeded where the classes are too many.
    """
    shapes = _shapes_of(tuple(dict.fromkeys(regions)))
    met: Mapping[int, frozenset[int]] = {}
    if points is None:
        columns, met = shapes.columns(opening, documents)
    else:
        columns = [shapes.column(point) for point in points]
        met = shapes.met_by_points(points, opening)
    further = max(sum(governed) - 1, 0)
    most = min(MAX_FURTHER, FURTHER + FURTHER_PER_DOCUMENT * documents)
    _check_cells(len(columns), further, "classes of topics in {} further classes of domains", most)
    words = f"channels of {further} further classes of domains under {{}} topic rules"
    _check_cells(len(columns) * further, ruling, words, MAX_RULED)
    channels: list[ChannelAtom] = []
    in_domain: list[range] = []
    for number, is_governed in enumerate(governed):
        start = len(channels)
        channels += _atoms(number, columns if is_governed else None)
        in_domain.append(range(start, len(channels)))
    ruled = [here.start for here, is_governed in zip(in_domain, governed, strict=True) if is_governed]
    return Channels(
        domains=domains,
        channels=tuple(channels),
        regions=shapes.found(columns, ruled),
        in_domain=tuple(in_domain),
        columns=columns,
        meets=_meets(met, ruled, len(channels)),
    )


def _atoms(domain: int, columns: Iterable[Column] | None) -> Iterator[ChannelAtom]:
    """The channels of a domain class. `columns` None: it is not governed."""
    if columns is None:
        yield ChannelAtom(domain=domain, topic=ANY_TOPIC, partition="", ros=True, infinite=True)
        return
    for column in columns:
        yield ChannelAtom(
            domain=domain,
            topic=column.topic.witness,
            partition=column.partition,
            ros=column.topic.ros,
            infinite=column.infinite,
        )


def _meets(met: Mapping[int, frozenset[int]], starts: Sequence[int], count: int) -> tuple[frozenset[int], ...]:
    """By channel, the channels that it meets: those of the columns that its column meets, in its domain."""
    if not met:
        return ()
    found = [frozenset[int]()] * count
    for start in starts:
        for column, others in met.items():
            found[start + column] = frozenset(start + other for other in others)
    return tuple(found)


def domain_covers(
    read: Mapping[Access, Sequence[ReadDocument]],
) -> tuple[list[tuple[Interval, ...]], list[tuple[Interval, ...]]]:
    """The domains of governance documents and of rules of grants, as written, each once."""
    documents = [document for several in read.values() for document in several]
    governed = dict.fromkeys(rule.domains for each in documents for rule in each.domain_rules or ())
    ruled = dict.fromkeys(rule.domains for each in documents for grant in each.grants or () for rule in grant.rules)
    return [*governed], [*ruled]


def governed_domains(read: Mapping[Access, Sequence[ReadDocument]]) -> tuple[Interval, ...]:
    """The domains that some governance among the documents covers, ascending and apart."""
    governed, _ruled = domain_covers(read)
    return merged(interval for cover in governed for interval in cover)


def document_channels(
    read: Mapping[Access, Sequence[ReadDocument]],
    points: Sequence[Point] | None = None,
    claimed: Iterable[ReadRegion] = (),
    *,
    ungoverned: bool = False,
    opened: bool = False,
    literal: bool | None = None,
) -> Channels:
    """The channels that documents tell apart, as implementations of each access row read them.

    `points`: as in `build_channels`, which says what is raised. `claimed`: names that have to be told apart as well.
    `ungoverned`: names of domains that only permissions speak of are told apart too. `opened`: those of any domain.
    `literal`: partitions are plain names, as they are to permissions. Else an endpoint in a pattern is met in all that
    the pattern matches. None: they are where there are `points`, which then need no classes of names at all.
    """
    regions: dict[ReadRegion, None] = dict.fromkeys(claimed)
    opening: set[ReadRegion] = set()
    topics: set[ReadRegion] = set()
    by_default = False
    for access, documents in read.items():
        for document in documents:
            for topic_rule in (each for rule in document.domain_rules or () for each in rule.topic_rules):
                regions[access.matcher, topic_rule.region] = None
                topics.add((access.matcher, topic_rule.region))
            for grant in document.grants or ():
                by_default = by_default or grant.default_allow
                for rule in grant.rules:
                    for region in (rule.publish, rule.subscribe, rule.relay):
                        regions[access.matcher, region] = None
                        if rule.allow and any(area.partitions != DEFAULT_PARTITION for area in region):
                            opening.add((access.matcher, region))
                    for together in CHECKED_TOGETHER[access.topic_check]:
                        regions[access.matcher, rule.listed(together)] = None
    governed, ruled = domain_covers(read)
    domains = domain_classes([*governed, *ruled])
    wanted = union(map(domain_bits, [*governed, *ruled] if ungoverned else governed))
    plain = points is not None if literal is None else literal
    covers = [opened or bool(wanted >> domain.intervals[0][0] & 1) for domain in domains]
    return build_channels(
        domains,
        covers,
        regions,
        points,
        frozenset() if plain else None if by_default else frozenset(opening),
        ruling=len(topics),
        documents=max(map(len, read.values()), default=0),
    )


def _check_cells(classes: int, others: int, words: str, most: int = MAX_CELLS) -> None:
    """Raises errors.BudgetExceeded for more pairs than can be worked out."""
    if classes * others > most:
        message = f"{classes} {words.format(others)} are more than can be worked out (limit {most} pairs)."
        raise BudgetExceeded(message)


class _Shapes:
    """The regions by what they mean: however many are written alike, or mean the same to several implementations."""

    def __init__(self, regions: Iterable[ReadRegion]) -> None:
        self._topics = Patterns()
        self._partitions = Patterns(topics=False)
        self._numbers: dict[Shape, int] = {}
        self._of = {named: self._number(named) for named in regions}
        self._columns: dict[frozenset[ReadRegion] | None, Table] = {}
        self._by_topic: dict[str, tuple[TopicClass, list[_Listed]]] = {}

    def _number(self, named: ReadRegion) -> int:
        matcher, region = named
        shape = tuple(
            (
                tuple(self._topics.number(text, matcher) for text in area.topics),
                None
                if area.partitions is None
                else tuple(self._partitions.number(text, matcher) for text in area.partitions),
                area.every,
            )
            for area in region
        )
        return self._numbers.setdefault(shape, len(self._numbers))

    def columns(self, opening: frozenset[ReadRegion] | None, documents: int) -> Table:
        """The cells (topic class × partition class) that no shape tells apart, merged, and which meet which others.

        What a cell is met by is part of what tells it apart: rights in one column mean one thing then.
        """
        if opening not in self._columns:
            self._columns[opening] = self._tabulated(opening, documents)
        return self._columns[opening]

    def _tabulated(self, opening: frozenset[ReadRegion] | None, documents: int) -> Table:
        topics, partitions = self._topics.classes(documents), self._partition_classes
        _check_cells(len(topics), len(partitions), "topic classes in {} partition classes")
        allowing = self._allowing(opening)
        topics_of, met_by = self._topics.places(topics), self._met_by(allowing)
        return Columns(self._numbers.items(), topics_of, self._places, met_by, allowing).table(topics, partitions)

    def _allowing(self, opening: frozenset[ReadRegion] | None) -> set[int] | None:
        """The shapes of these regions."""
        return None if opening is None else {self._of[named] for named in opening}

    @cached_property
    def _partition_classes(self) -> list[TopicClass]:
        """Of partitions, the default one first."""
        return [self._partitions.empty(), *self._partitions.classes()]

    @cached_property
    def _places(self) -> Sequence[Sequence[int]]:
        """By expression of partitions the classes that it matches."""
        return self._partitions.places(self._partition_classes)

    def _met_by(self, allowing: set[int] | None) -> dict[int, list[int]]:
        """By partition class: the others in which somebody may have endpoints that patterns make meet it."""
        every = range(len(self._partition_classes))
        asked = set(every if allowing is None else ())
        for shape, number in self._numbers.items():
            for _, listed, _every in shape if allowing is not None and number in allowing else ():
                asked.update(every if listed is None else (q for p in listed for q in self._places[p]))
        met_by: dict[int, list[int]] = {}
        for place, others in self._partitions.meetings(sorted(asked - {0})).items():
            for other in others:
                met_by.setdefault(other, []).append(place)
        return met_by

    def met_by_points(
        self, points: Sequence[Point], opening: frozenset[ReadRegion] | None
    ) -> dict[int, frozenset[int]]:
        """By point: those of the same topic that are met by who may be in its class of partitions."""
        if opening is not None and not opening:
            return {}
        met_by = self._met_by(self._allowing(opening))
        place_of = {each.members: place for place, each in enumerate(self._partition_classes) if place}
        by_topic: dict[str, dict[int, list[int]]] = {}
        for number, (topic, *partitions) in enumerate(points) if met_by else ():
            for partition in partitions:
                place = place_of[self._partitions.matching(partition)] if partition else 0
                by_topic.setdefault(topic, {}).setdefault(place, []).append(number)
        found: dict[int, set[int]] = {}
        for at in by_topic.values():
            for place, others in at.items():
                for meeting in met_by.get(place, ()):
                    for one in at.get(meeting, ()):
                        found.setdefault(one, set()).update(others)
        return {number: frozenset(others) for number, others in found.items()}

    def column(self, point: Point) -> Column:
        """One topic name in all partitions of an endpoint."""
        topic, *partitions = point
        only, shapes = self._topic(topic)
        matching = [*map(self._partitions.matching, partitions)]
        hits = {
            number
            for number, listed, every in shapes
            if listed is None or (all if every else any)(not listed.isdisjoint(each) for each in matching)
        }
        return Column(hits=tuple(sorted(hits)), topic=only, partition=", ".join(partitions), infinite=False)

    def _topic(self, name: str) -> tuple[TopicClass, list[_Listed]]:
        """One topic name, and the shapes that list it, each with the partition patterns beside it."""
        known = self._by_topic.get(name)
        if known is None:
            named = self._topics.matching(name)
            only = TopicClass(members=named, witness=name, ros=is_ros_dds_name(name), infinite=False)
            known = self._by_topic[name] = only, [each for pattern in named for each in self._listing.get(pattern, ())]
        return known

    @cached_property
    def _listing(self) -> dict[int, list[_Listed]]:
        """By topic pattern: the shapes that list it, each with the partition patterns beside it."""
        listing: dict[int, list[_Listed]] = {}
        for shape, number in self._numbers.items():
            for topics, listed, every in shape:
                partitions = None if listed is None else frozenset(listed)
                for pattern in topics:
                    listing.setdefault(pattern, []).append((number, partitions, every))
        return listing

    def found(self, columns: Sequence[Column], starts: Sequence[int]) -> dict[ReadRegion, frozenset[int]]:
        """The channels of each region."""
        matched: list[list[int]] = [[] for _ in self._numbers]
        for at, column in enumerate(columns):
            for hit in column.hits:
                matched[hit].append(at)
        # Shared by regions that match the same: thousands of one expression times 233 classes of domains are 200 MB.
        shared = {each: frozenset(start + at for start in starts for at in each) for each in map(tuple, matched)}
        frozen = [shared[tuple(each)] for each in matched]
        return {named: frozen[number] for named, number in self._of.items()}


def _shapes_of(regions: tuple[ReadRegion, ...]) -> _Shapes:
    """The shapes of regions: the same for those who ask about the same regions in turn, as in `patterns.classes_of`."""
    return _kept_shapes(regions) if len(regions) <= MAX_KEPT else _Shapes(regions)


_kept_shapes = lru_cache(maxsize=4)(_Shapes)


def wildcard_names(channels: Channels) -> list[int]:
    """The channels of one name that is an expression on Fast DDS."""
    odd = {topic for topic in {each.topic for each in channels.channels} if not UNESCAPED_WILDCARDS.isdisjoint(topic)}
    return [n for n, each in enumerate(channels.channels) if each.topic in odd and not each.infinite] if odd else []


def illegal_names(channels: Channels, legal: str) -> Iterator[int]:
    """The channels of one name that `legal` does not match; of infinitely many names some may be."""
    pattern = re.compile(legal)
    for number, channel in enumerate(channels.channels):
        if not channel.infinite and pattern.fullmatch(channel.topic) is None:
            yield number
