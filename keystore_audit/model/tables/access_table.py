"""Who may do what, for every enclave and every topic name, in one domain.

Names are taken in classes, each by its witness, so that the table is exact for all of them. Profiles whose tables are
equal are one group.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews, ReadDocument
from keystore_audit.model.channels import MAX_CELLS, governed_domains
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.rights import EffectiveRights, Safeguard
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.matching.patterns import Patterns
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.rights import Window
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import Access, Profile
from keystore_audit.truth import Bounds, Truth

# The names that a keystore's documents tell apart, each class by a witness, for tables that people read.
#
# Unlike channels (`model.channels`), names are not merged where no rule tells them apart: a topic that a document lists
# keeps a place of its own.


class Named(Struct, frozen=True, kw_only=True):
    """The topic names of one class, in a class of partitions.

    `topic`: one of them, the only one unless there are `several`. `ros`: whether ROS 2 can produce one. `expressions`:
    those with wildcards in permissions that match it, longest first. `partition`: one of the names that are alike.
    """

    topic: str
    partition: str
    ros: bool
    several: bool
    expressions: tuple[str, ...]


def names_of(read: Mapping[Access, Sequence[ReadDocument]], most: int = MAX_CELLS) -> tuple[tuple[Named, ...], int]:
    """The classes of all topic names in all partitions, for documents as implementations of each access row read them.
    And the place of the class that the fewest expressions match: of whatever no document lists.

    `most`: pairs of both, those of the default partition apart. Raises errors.BudgetExceeded where they are more.
    """
    topics, partitions = Patterns(), Patterns(topics=False)
    granted: dict[int, str] = {}
    for matcher, document in ((access.matcher, document) for access, several in read.items() for document in several):
        for domain_rule in document.domain_rules or ():
            for topic_rule in domain_rule.topic_rules:
                for text in (text for area in topic_rule.region for text in area.topics):
                    topics.number(text, matcher)
        for grant in document.grants or ():
            for area in (area for rule in grant.rules for area in (*rule.publish, *rule.subscribe, *rule.relay)):
                for text in area.topics:
                    granted.setdefault(topics.number(text, matcher), text)
                for text in area.partitions or ():
                    partitions.number(text, matcher)
    classes = topics.classes(max(map(len, read.values()), default=0))
    wildcards = {number: text for number, text in granted.items() if topics.patterns[number].literal is None}
    others: list[str] = []
    if any(pattern.literal != "" for pattern in partitions.patterns):
        others = [each.witness for each in partitions.classes()]
    if len(classes) * (1 + len(others)) > MAX_CELLS or len(classes) * len(others) > most:
        message = f"{len(classes)} topic classes in {1 + len(others)} partition classes are more than can be shown."
        raise BudgetExceeded(message)
    names = tuple(
        Named(
            topic=each.witness,
            partition=partition,
            ros=each.ros,
            several=all(topics.patterns[member].literal is None for member in each.members),
            expressions=tuple(
                sorted({wildcards[n] for n in each.members if n in wildcards}, key=lambda text: (-len(text), text))
            ),
        )
        for partition in ("", *others)
        for each in classes
    )
    rest = min(range(len(classes)), key=lambda n: (not classes[n].infinite, len(classes[n].members), n))
    return names, rest


class Rights(Struct, frozen=True, kw_only=True):
    """What one enclave may do with one operation, over the `names` of the table (all of them, as a bit set).

    `decided`: by its own implementation; `taken`: by some peer.
    """

    names: int
    decided: Bounds
    taken: Bounds

    @property
    def allowed(self) -> int:
        """What its own implementation allows for certain."""
        return self.decided.must

    @property
    def accepted(self) -> int:
        """What some peer takes for certain."""
        return self.taken.must

    @property
    def disputed(self) -> int:
        """Where it cannot be told whether peers take it."""
        return self.taken.unknown


class EnclaveRights(Struct, frozen=True, kw_only=True):
    """`usable`: whether its participant starts in the domain; `reasons`: why not."""

    usable: Truth
    reasons: tuple[str, ...]
    rights: Mapping[Operation, Rights]

    def otherwise(self, operation: Operation, rest: int) -> tuple[Truth, Truth]:
        """Decision and effective of whatever no document lists (`AccessTable.rest`)."""
        right = self.rights[operation]
        return right.decided.holds(rest), right.taken.holds(rest)

    def exceptions(self, operation: Operation, rest: int) -> Iterable[tuple[int, Truth, Truth]]:
        """The names of which something else holds: place, decision and effective."""
        right = self.rights[operation]
        every = (right.decided.must, right.decided.may, right.taken.must, right.taken.may)
        differing = union(~held if held >> rest & 1 else held for held in every)
        for name in members(differing & right.names):
            yield name, right.decided.holds(name), right.taken.holds(name)


class Group(Struct, frozen=True, kw_only=True):
    """Profiles whose tables are equal.

    `enclaves`: by path. `safeguards`: by name, what the enclaves' governances have, several where they differ.
    """

    profiles: tuple[str, ...]
    enclaves: Mapping[str, EnclaveRights]
    safeguards: tuple[tuple[Safeguard, ...], ...]

    @property
    def has_unknown(self) -> bool:
        """Whether anything in it could not be decided."""
        return any(
            enclave.usable is Truth.UNKNOWN
            or any(right.decided.unknown or right.taken.unknown for right in enclave.rights.values())
            for enclave in self.enclaves.values()
        )


class AccessTable(Struct, frozen=True, kw_only=True):
    """The whole table of the keystore at `root`.

    `rest`: the place among `names` of whatever no document lists. `groups`: the largest last, else in the order of
    their first profile. `fleets`: on which.
    """

    root: str
    at: datetime
    domain: int
    names: tuple[Named, ...]
    rest: int
    groups: tuple[Group, ...]
    fleets: Sequence[Profile]

    @property
    def has_unknown(self) -> bool:
        """Whether anything in it could not be decided."""
        return any(group.has_unknown for group in self.groups)


class TableBuilder:
    """Works out the rights in the domain (0..232), None: in the lowest that some governance covers, 0 where none does.

    `window`, `local`, `systems` (by profile, MAY): what they are read off. Raises errors.BudgetExceeded where the names
    are of too many classes.
    """

    def __init__(
        self,
        keystore: Keystore,
        profiles: Sequence[Profile],
        at: datetime,
        accesses: AccessViews,
        domain: int | None,
    ) -> None:
        read = accesses.by_row(profiles, (document.file for document in documents_of(keystore)))
        if domain is None:
            domain = next((lowest for lowest, _highest in governed_domains(read)), 0)
        names, self._rest = names_of(read)
        builder = SystemBuilder(keystore, profiles, at, accesses, [(name.topic, name.partition) for name in names])
        systems = builder.systems()
        self.systems = {name: system for system in systems if system.may for name in system.profiles}
        self.window = Window(builder.channels, domain, len(names))
        self.local = LocalRights(accesses, builder.channels, at)
        self._keystore = keystore
        self._profiles = profiles
        self._at = at
        self._domain = domain
        self._names = names
        self._usabilities = Usabilities(domain, accesses)
        self._effective = EffectiveRights(systems)
        self._unclear = {
            profile.name: bits(
                number
                for number, name in enumerate(names)
                if accesses.unclear_name(name.topic, (name.partition,), profile) is not None
            )
            for profile in profiles
        }
        self._several = bits(number for number, name in enumerate(names) if name.several)

    def table(self) -> AccessTable:
        """The whole table."""
        return AccessTable(
            root=self._keystore.root,
            at=self._at,
            domain=self._domain,
            names=self._names,
            rest=self._rest,
            groups=tuple(sorted(self._groups(), key=lambda group: len(group.profiles))),
            fleets=self._profiles,
        )

    def _groups(self) -> list[Group]:
        """Profiles by equal answers."""
        kinds = grouped(self._profiles, lambda profile: (self._usabilities.kind(profile), self._unclear[profile.name]))
        groups: list[Group] = []
        for alike in kinds.values():
            enclaves = {enclave.path: self._rights(enclave, alike[0]) for enclave in self._keystore.enclaves}
            protected = self.window.safeguards(self.systems[alike[0].name])
            names = tuple(profile.name for profile in alike)
            for number, group in enumerate(groups):
                if (group.enclaves, group.safeguards) == (enclaves, protected):
                    groups[number] = replace(group, profiles=(*group.profiles, *names))
                    break
            else:
                groups.append(Group(profiles=names, enclaves=enclaves, safeguards=protected))
        return groups

    def _rights(self, enclave: Enclave, profile: Profile) -> EnclaveRights:
        usability = self._usabilities.of(enclave, self._at, profile)
        rights = {}
        unclear = self._unclear[profile.name]
        for operation in Operation:
            decided = Bounds(0, self.window.all if usability.usable.may else 0)
            if usability.usable.must:
                decided = Bounds.exact(self._allowed(enclave, profile, operation)).but(unclear)
            taken = self._effective.accepted(enclave.path, profile.name, operation)
            taken = Bounds(self.window.of(taken.must), self.window.of(taken.may)).but(unclear)
            rights[operation] = Rights(names=self.window.all, decided=decided, taken=taken)
        return EnclaveRights(usable=usability.usable, reasons=usability.reasons, rights=rights)

    def _allowed(self, enclave: Enclave, profile: Profile, operation: Operation) -> int:
        """The names on which its own implementation allows the operation.

        That it creates no topic of a witness's name says nothing of the other names of the class.
        """
        allowed = self.window.of(self.local.allowed(enclave, profile, operation))
        if profile.local.topic_names is None or not self._several:
            return allowed
        any_name = replace(profile, local=replace(profile.local, topic_names=None))
        by_rules = self.window.of(self.local.allowed(enclave, any_name, operation))
        return allowed & ~self._several | by_rules & self._several
