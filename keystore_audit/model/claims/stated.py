"""Labels on enclaves and topics, and where what is labelled may go: one lattice (docs/model.md, Labels).

Nothing here decides anything. For every two labels between which the lattice lets nothing through, there is a claim
that nothing flows from the one to the other. The engines decide those like any other claim.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import combinations
from typing import Final, Protocol

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location, Severity
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.globs import Globs, at, named_paths, region_of
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.formal.system import System

RESTING_ON_STARTS: Final = frozenset({ClaimKind.ABLE, ClaimKind.SEPARATE_DOMAINS})
"""Kinds of claims that ask which enclaves start."""

RESTING_ON_SUBJECTS: Final = frozenset({ClaimKind.ONLY_PUBLISH, ClaimKind.ENCRYPTED})
"""Kinds of claims that ask whom grants name that is no enclave here."""


class LabelPair(Struct, frozen=True, kw_only=True):
    """Two labels between which nothing may flow. `id`: of all claims that say so; `labelling`: where they come from."""

    id: str
    source: str
    target: str
    labelling: Labelling


Marks = tuple[tuple[str, str], ...]
"""Globs on enclaves or DDS topics, each with the place where it stands: `FILE:LINE`."""


class Marked(Protocol):
    """What settings say of globs."""

    @property
    def place(self) -> str:
        """Where it stands."""

    @property
    def marks(self) -> Marks:
        """Where its globs stand."""


class Claim(Struct, frozen=True, kw_only=True):
    """A property that a user asserts, or a question about a flow.

    `id`: unique, `[a-z0-9-]+`. `statement`: a sentence. `until`: aware UTC, None: at the audit instant alone.
    `location`: where it stands, `beside` the keystore. `place`: the same for people, `FILE:LINE`, empty for a question
    of the command line. `marks`: where its globs stand, if known. `labels`: where labels make it.
    `source` may be empty for ONLY_PUBLISH alone: one enclave may publish then, whichever it is.
    """

    id: str
    statement: str
    kind: ClaimKind
    attacker: Attacker
    source: Globs
    target: Globs
    severity: Severity = Severity.HIGH
    through: tuple[str, ...] = ()
    include_ambient: bool = False
    until: datetime | None = None
    location: Location
    place: str
    marks: Marks = ()
    labels: LabelPair | None = None

    @property
    def meaning(self) -> str:
        """What is claimed, apart from its name, its words, its severity and its end: equal for equal claims."""
        places = (self.source, self.target, Globs(enclaves=self.through))
        sides = [[sorted(place.enclaves), sorted(place.topics), place.outsider] for place in places]
        return json.dumps([self.kind.value, self.attacker.value, sides, self.include_ambient])


def marked(what: Marked, glob: str) -> str:
    """Where the glob stands, else where what it belongs to does."""
    return dict(what.marks).get(glob, what.place)


def granted_channels(systems: Sequence[System]) -> frozenset[int]:
    """Channels that some document, as some implementation reads it, allows something on, or that may be one."""
    everything = frozenset(range(len(systems[0].channels)))
    granted: set[int] = set()
    for system in systems:
        if system.has_doubt or any(grant.default_allow for grant in system.grants):
            return everything
        for rule in system.rules:
            if rule.allow:
                granted |= rule.publish | rule.subscribe | rule.relay
    return frozenset(granted)


def check_granted(topic: str, channels: Channels, used: frozenset[int], place: str) -> None:
    """Raises errors.UsageError for a glob that matches no channel `used`: misspelt, so that everything would hold."""
    if not channels.regions[region_of((topic,))] & used:
        raise UsageError(f"{at(place)}no permissions document grants anything on the DDS topic {topic!r}.")


MAX_CLAIMS: Final = 400
"""Claims that labels make: a hundred pairs of labels between which nothing may flow."""


Lattice = Mapping[str, frozenset[str]]
"""Labels, and by label the labels of what it may flow to, itself among them: a partial order.

Every partial order lies in a lattice in which its own labels keep their order (its completion by cuts). So none has to
be filled up by hand: data of two labels counts as having both.
"""


def turned(lattice: Lattice) -> Lattice:
    """The same lattice upside down."""
    return {label: frozenset(other for other, ends in lattice.items() if label in ends) for label in lattice}


def chain(levels: Sequence[str]) -> Lattice:
    """Levels from the lowest up; data flows up."""
    return {level: frozenset(levels[number:]) for number, level in enumerate(levels)}


def powerset(sets: Mapping[str, Collection[str]]) -> Lattice:
    """Labels that are sets of categories, by name; data flows to larger sets."""
    return {
        label: frozenset(other for other, larger in sets.items() if set(larger) >= set(one))
        for label, one in sets.items()
    }


def ordered(below: Mapping[str, Collection[str]]) -> Lattice:
    """Labels with those directly below each, all of them keys; data flows up.

    Raises CyclicOrder where a label is below itself.
    """
    down: dict[str, frozenset[str]] = {}

    def descend(label: str, way: tuple[str, ...]) -> frozenset[str]:
        if label in way:
            raise CyclicOrder(way[way.index(label) :])
        if label not in down:
            found = {label}
            for lower in below[label]:
                found |= descend(lower, (*way, label))
            down[label] = frozenset(found)
        return down[label]

    for each in below:
        descend(each, ())
    return turned(down)


class CyclicOrder(ValueError):
    """Labels of which each is below the one before, and the first below the last."""

    def __init__(self, labels: tuple[str, ...]) -> None:
        super().__init__(labels)
        self.labels = labels


class Labelled(Struct, frozen=True, kw_only=True):
    """Enclaves and topics with a label: globs on enclave paths and on DDS topics. `place`: `FILE:LINE`."""

    label: str
    enclaves: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    place: str
    marks: Marks = ()


class Declassifier(Struct, frozen=True, kw_only=True):
    """Enclaves (globs) that are trusted to turn what has the label `taken` into what has the label `given`.

    An endorser is the same. A flow ends at such an enclave, and another begins there.
    """

    enclaves: tuple[str, ...]
    taken: str
    given: str
    place: str
    marks: Marks = ()


class Labelling(Struct, frozen=True, kw_only=True):
    """All that the settings say of labels. `location`, `place`: of the lattice."""

    lattice: Lattice
    labelled: tuple[Labelled, ...]
    declassifiers: tuple[Declassifier, ...] = ()
    attacker: Attacker = Attacker.RELAYS
    include_ambient: bool = False
    severity: Severity = Severity.HIGH
    until: datetime | None = None
    location: Location
    place: str

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Labels in use from the first of which nothing may flow to the second."""
        used = {one.label for one in self.labelled}
        sources = used | {one.given for one in self.declassifiers}
        targets = used | {one.taken for one in self.declassifiers}
        for source in self.lattice:
            for target in self.lattice:
                if source in sources and target in targets and target not in self.lattice[source]:
                    yield source, target

    def sources(self, label: str) -> tuple[Globs, ...]:
        """Where data of the label comes from, one sort of place each."""
        given = (one.enclaves for one in self.declassifiers if one.given == label)
        return self._places(label, given)

    def targets(self, label: str) -> tuple[Globs, ...]:
        """What takes data of the label and below."""
        taken = (one.enclaves for one in self.declassifiers if one.taken == label)
        return self._places(label, taken)

    def _places(self, label: str, trusted: Iterable[tuple[str, ...]]) -> tuple[Globs, ...]:
        tables = [one for one in self.labelled if one.label == label]
        enclaves = [glob for one in tables for glob in one.enclaves] + [glob for globs in trusted for glob in globs]
        topics = [glob for one in tables for glob in one.topics]
        places = (Globs(enclaves=tuple(dict.fromkeys(enclaves))), Globs(topics=tuple(dict.fromkeys(topics))))
        return tuple(place for place in places if place.enclaves or place.topics)

    def claims(self) -> tuple[Claim, ...]:
        """The claims that nothing flows between labels where it may not: for each two, one for each sort of places.

        Together they say what the labels say. Raises errors.UsageError where there are too many.
        """
        through = tuple(dict.fromkeys(glob for one in self.declassifiers for glob in one.enclaves))
        found = [
            Claim(
                id=f"{pair_id(source, target)}-{sort(here)}-{sort(there)}",
                statement=self._statement(source, target),
                kind=ClaimKind.NO_FLOW,
                attacker=self.attacker,
                source=here,
                target=there,
                severity=self.severity,
                through=through,
                include_ambient=self.include_ambient,
                until=self.until,
                location=self.location,
                place=self.place,
                labels=LabelPair(id=pair_id(source, target), source=source, target=target, labelling=self),
            )
            for source, target in self.pairs()
            for here in self.sources(source)
            for there in self.targets(target)
        ]
        if len(found) > MAX_CLAIMS:
            raise UsageError(
                f"{self.place}: {len(found)} pairs of labelled places between which nothing may flow are too many "
                f"(limit {MAX_CLAIMS}): expected fewer labels."
            )
        return tuple(found)

    def _statement(self, source: str, target: str) -> str:
        trusted = " except through those trusted to" if self.declassifiers else ""
        ambient = "" if self.include_ambient else ", apart from topics that nearly every node uses, unless named here"
        return f"Nothing gets from what is labelled {source} to what is labelled {target}{trusted}{ambient}."


def pair_id(source: str, target: str) -> str:
    """The name under which reports have the answer about two labels."""
    return f"label-{slug(source)}-to-{slug(target)}"


def slug(label: str) -> str:
    """A label as a part of a name."""
    return label.replace(", ", "-and-").replace(" ", "-")


def sort(place: Globs) -> str:
    """What is at a place, in a word."""
    return "topics" if place.topics else "enclaves"


def label_regions(labelling: Labelling) -> Iterator[ReadRegion]:
    """The names of each glob by itself, so that it is known which overlap."""
    for one in labelling.labelled:
        for glob in one.topics:
            yield region_of((glob,))


def check_labels(labelling: Labelling, paths: Sequence[str], channels: Channels, used: frozenset[int]) -> None:
    """Raises errors.UsageError for a glob that labels nothing in this keystore, and for what has two labels.

    `used`: channels that some document allows something on. Topics overlap also where nobody may do anything on them.
    """
    named_enclaves = [(one.label, glob, marked(one, glob)) for one in labelling.labelled for glob in one.enclaves]
    named_enclaves += [
        (_trust(one), glob, marked(one, glob)) for one in labelling.declassifiers for glob in one.enclaves
    ]
    found: dict[str, tuple[str, str]] = {}
    for label, glob, place in named_enclaves:
        for enclave in named_paths(glob, paths, place):
            other, before = found.setdefault(enclave, (label, place))
            if other != label:
                raise _overlap("the enclave", enclave, (other, before), (label, place))
    regions = [
        (one.label, glob, marked(one, glob), channels.regions[region_of((glob,))])
        for one in labelling.labelled
        for glob in one.topics
    ]
    for _label, glob, place, _region in regions:
        check_granted(glob, channels, used, place)
    for (label, _glob, place, region), (other, _other_glob, after, more) in combinations(regions, 2):
        both = region & more
        if label != other and both:
            raise _overlap("the DDS topic", channels.channels[min(both)].topic, (label, place), (other, after))


def _trust(declassifier: Declassifier) -> str:
    return f"{declassifier.taken} turned into {declassifier.given}"


def _overlap(what: str, name: str, before: tuple[str, str], after: tuple[str, str]) -> UsageError:
    return UsageError(
        f"{after[1]}: {what} {name!r} is labelled {after[0]!r} here, and {before[0]!r} at {before[1]}: "
        "expected one label for each."
    )
