"""The DDS topics that are made of ROS names, as channels: what decides about them is the same as for all others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import Channels, ReadRegion, domain_covers
from keystore_audit.model.domains import contains, domain_classes
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import ChannelAtom
from keystore_audit.model.matching.expression import any_matches
from keystore_audit.model.matching.patterns import Patterns
from keystore_audit.model.ros.classes import Affix, RosClass, classify_ros_names
from keystore_audit.model.semantics import DIRECTIONS
from keystore_audit.profiles import Access, Matcher

MAX_CHANNELS: Final = 200_000
"""Classes × affixes × domain classes of one enclave: a second; 5,000 services in two domains take a tenth."""


class RosChannels(Struct, frozen=True, kw_only=True):
    """Channels for every class of ROS names, with each of the affixes, in the default partition.

    `starts`: by governed domain class, its first channel; from there on all classes with the first affix, then all with
    the second. `unmarked`: the classes (bit set) whose names no mark matches. By operation, of allow rules: `literals`
    are the expressions, `numbers` those with their numbers among the members of classes.
    """

    channels: Channels
    classes: tuple[RosClass, ...]
    affixes: tuple[Affix, ...]
    starts: tuple[int, ...]
    unmarked: int
    literals: Mapping[Operation, frozenset[str]]
    numbers: Mapping[Operation, frozenset[tuple[str, int]]]

    def of_affix(self, affix: Affix) -> int:
        """The place of the first channel with the affix, counted from a start."""
        return self.affixes.index(affix) * len(self.classes)

    def by_class(self, channels: int, start: int, place: int) -> int:
        """Those of the channels that have the affix of `place`, as a bit set of classes."""
        return channels >> (start + place) & ((1 << len(self.classes)) - 1)

    def listed(self, operation: Operation, affix: Affix) -> int:
        """The classes whose topic is listed by name for the operation."""
        listed = self.literals[operation]
        return bits(number for number, each in enumerate(self.classes) if affix.topic(each.name) in listed)

    def naming(self, operation: Operation, affix: Affix, part: str) -> int:
        """The classes whose topic an expression with `part` in it lists for the operation."""
        place = self.affixes.index(affix)
        numbers = frozenset(number for text, number in self.numbers[operation] if part in text)
        return bits(n for n, each in enumerate(self.classes) if not numbers.isdisjoint(each.members[place]))

    def is_literal(self, number: int) -> bool:
        """Whether the class is a name that is listed with some affix."""
        name = self.classes[number].name
        return any(affix.topic(name) in listed for affix in self.affixes for listed in self.literals.values())


def ros_channels(
    read: Mapping[Access, Sequence[ReadDocument]], affixes: Sequence[Affix], marks: Iterable[str] = ()
) -> RosChannels:
    """The channels that these documents tell apart, as implementations of each access row read them.

    `marks`: POSIX expressions for topics with the first affix. Raises errors.BudgetExceeded where there are too many.
    """
    patterns = Patterns()
    marking = {patterns.number(mark, Matcher.POSIX) for mark in marks}
    regions: dict[ReadRegion, None] = {}
    for access, documents in read.items():
        for document in documents:
            for topic_rule in (each for rule in document.domain_rules or () for each in rule.topic_rules):
                regions[access.matcher, topic_rule.region] = None
            for rule in (rule for grant in document.grants or () for rule in grant.rules):
                for region in (rule.publish, rule.subscribe, rule.listed):
                    regions[access.matcher, region] = None
    for matcher, region in regions:
        for text in (text for area in region for text in area.topics):
            patterns.number(text, matcher)
    classes = classify_ros_names(patterns.patterns, affixes)
    governed, ruled = domain_covers(read)
    domains = domain_classes([*governed, *ruled])
    covered = [n for n, atom in enumerate(domains) if any(contains(each, atom.intervals[0][0]) for each in governed)]
    if len(classes) * len(affixes) * len(covered) > MAX_CHANNELS:
        raise BudgetExceeded(f"{len(classes)} classes of ROS names are too many in {len(covered)} classes of domains.")
    topics = [(affix.topic(each.name), affix) for affix in affixes for each in classes]
    in_domain: list[range] = []
    for number in range(len(domains)):
        start = in_domain[-1].stop if in_domain else 0
        in_domain.append(range(start, start + (len(topics) if number in covered else 0)))
    starts = tuple(here.start for here in in_domain if here)
    marked = bits(n for n, each in enumerate(classes) if not marking.isdisjoint(each.members[0]))
    return RosChannels(
        channels=Channels(
            domains=domains,
            channels=tuple(
                ChannelAtom(domain=domain, topic=topic, partition="", ros=True, infinite=False)
                for domain in covered
                for topic, _affix in topics
            ),
            regions=_found(regions, patterns, classes, affixes, starts),
            in_domain=tuple(in_domain),
        ),
        classes=classes,
        affixes=tuple(affixes),
        starts=starts,
        unmarked=(1 << len(classes)) - 1 & ~marked,
        literals={each: frozenset(text for text, _matcher in _allowed(read, each)) for each in DIRECTIONS},
        numbers={
            each: frozenset((text, patterns.number(text, matcher)) for text, matcher in _allowed(read, each))
            for each in DIRECTIONS
        },
    )


def _allowed(read: Mapping[Access, Sequence[ReadDocument]], operation: Operation) -> Iterator[tuple[str, Matcher]]:
    """What allow rules list."""
    for access, documents in read.items():
        for document in documents:
            for rule in (rule for grant in document.grants or () for rule in grant.rules if rule.allow):
                yield from ((text, access.matcher) for text in rule.texts(operation))


def _found(
    regions: Iterable[ReadRegion],
    patterns: Patterns,
    classes: Sequence[RosClass],
    affixes: Sequence[Affix],
    starts: Sequence[int],
) -> dict[ReadRegion, frozenset[int]]:
    """The channels of each region: those in the default partition."""
    places: list[list[int]] = [[] for _ in patterns.patterns]
    for at, each in enumerate(classes):
        for affix in range(len(affixes)):
            for pattern in each.members[affix]:
                places[pattern].append(affix * len(classes) + at)
    found = {}
    for named in regions:
        matcher, region = named
        matched = {
            place
            for area in region
            if area.partitions is None or any_matches(area.partitions, "", matcher)
            for text in area.topics
            for place in places[patterns.number(text, matcher)]
        }
        found[named] = frozenset(start + place for start in starts for place in matched)
    return found
