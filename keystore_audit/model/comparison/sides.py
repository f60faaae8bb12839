"""Two keystores side by side: the same channels, the same views of documents, enclaves matched by their paths."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import Final
from zoneinfo import ZoneInfo

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.keystore import Keystore, every_certificate
from keystore_audit.keystore.smime import Candidates
from keystore_audit.keystore.typed import Operation, PermissionsFile, read_permissions
from keystore_audit.keystore.unmanaged import UnmanagedDocument, UnmanagedIdentity
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import document_channels
from keystore_audit.model.claims.globs import region_of
from keystore_audit.model.comparison.change import Name, Names, Unread
from keystore_audit.model.domains import Interval, contains, merged
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.permission import Decisions
from keystore_audit.model.formal.rights import OwnRights, Peers
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import usability_by_profile
from keystore_audit.model.inventory import Typed, documents_of, system_documents
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.participants.doubt import enclave_doubts, keystore_doubts
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.trust.verdicts import envelope
from keystore_audit.profiles import Access, Profile
from keystore_audit.truth import Truth

MAX_SHOWN: Final = 3
"""Names that stand for a change; the rest are counted."""

BEFORE: Final = "old:"
"""Begins the places of what OLD alone has."""


class View(Peers):
    """One keystore under one system, without what could not be read. `evidence`: its enclaves by their paths."""

    def __init__(
        self, system: System, decisions: Decisions, keystore: Keystore, accesses: AccessViews, access: Access
    ) -> None:
        super().__init__(system, decisions)
        self.evidence = keystore.by_path
        self._keystore, self._accesses, self._access = keystore, accesses, access

    @cached_property
    def subjects(self) -> list[tuple[str, int]]:
        """The subject_name of each grant of the system, in order."""
        files = {each.place: each.file for each in documents_of(self._keystore)}
        numbers = gathered((grant.document, number) for number, grant in enumerate(self.system.grants))
        found: list[tuple[str, int]] = []
        for document, grants in numbers.items():
            file = files[self.system.documents[document].label]
            if isinstance(file, PermissionsFile):
                read = self._accesses.read(file, self._access).grants or ()
                texts = (each.grant.subject_name.text for each in read)
                found += zip(texts, grants, strict=True)
        return found

    def letting_in(self, path: str) -> tuple[int, ...]:
        """The trust domains, by their places, that accept the enclave's identity, whatever the dates."""
        number = self.numbers.get(path)
        return (
            ()
            if number is None
            else tuple(n for n, each in enumerate(self.trust_domains) if each.authenticated(number))
        )

    def members(self, trust_domains: Iterable[int]) -> frozenset[str]:
        """The paths of the enclaves of these trust domains."""
        return frozenset(self.system.enclaves[n].label for place in trust_domains for n in self.judging[place])

    @cached_property
    def taken(self) -> frozenset[int]:
        """The documents that some peer accepts."""
        return frozenset(document for trust_domain in self.trust_domains for document in trust_domain.accepted)

    @cached_property
    def let_in(self) -> frozenset[int]:
        """The enclaves whose identity some peer accepts."""
        known = (number for number, each in enumerate(self.system.enclaves) if each.identity is not None)
        return frozenset(
            number for number in known if any(trust_domain.authenticated(number) for trust_domain in self.trust_domains)
        )

    @cached_property
    def named(self) -> Mapping[str, list[int]]:
        """By subject, the identities that are let in."""
        identities = (self.system.enclaves[number].identity for number in sorted(self.let_in))
        return gathered((self.system.certificates[each].label, each) for each in identities if each is not None)

    @cached_property
    def lasting(self) -> Mapping[int, list[int]]:
        """By identity, the grants for it that are not over, begun or not, of documents that some peer takes."""
        return gathered(
            (certificate, number)
            for number, grant in enumerate(self.system.grants)
            if grant.document in self.taken and grant.not_after >= self.system.now
            for certificate in grant.names
        )

    @cached_property
    def keeps(self) -> bool:
        """Whether some peer accepts anything that only OLD has."""
        documents = any(self.system.documents[each].label.startswith(BEFORE) for each in self.taken)
        return documents or any(self.system.enclaves[n].location.path.startswith(BEFORE) for n in self.let_in)

    def own_grant(self, path: str) -> int | None:
        """The grant of the enclave's own document that counts."""
        enclave = self.enclave(path)
        return next(iter(self.permissions.chosen(enclave.identity, enclave.permissions)), None)

    def presented(self, path: str) -> list[int]:
        """The grants that count, of all documents that name the enclave and that some peer accepts."""
        return self.permissions.chosen(self.enclave(path).identity, self.taken)

    def made(self, enclave: int, operation: Operation) -> int:
        """The channels on which its own implementation makes a writer (PUBLISH) or a reader of the enclave, or on
        which such an endpoint is met.
        """
        atom = self.system.enclaves[enclave]
        alone = atom.writes_alone if operation is Operation.PUBLISH else atom.reads_alone
        peer_authorised = union(each.abilities(enclave).by_right(operation) for each in self._own_rights)
        return bits(alone) | self.decisions.met(peer_authorised)

    @cached_property
    def _own_rights(self) -> list[OwnRights]:
        return [OwnRights(self.system, trust_domain) for trust_domain in self.trust_domains]


class Pair(Struct, frozen=True, kw_only=True):
    """Both keystores as some profiles read them. `lead`: one of the profiles.

    `kept`: the new one, with all that only the old one has: nobody can call that back.
    """

    profiles: tuple[str, ...]
    lead: Profile
    old: View
    new: View
    kept: View


class Sides:
    """The old and the new keystore under `profiles` at `at` (aware UTC); `zone`: where the robots are.

    `domain`: the only one that counts; None: all. `topics`: globs whose names are told apart from others. `assumed`: as
    of `AccessViews`. Raises errors.BudgetExceeded where there are too many classes of names.
    """

    def __init__(
        self,
        old: Keystore,
        new: Keystore,
        profiles: Sequence[Profile],
        at: datetime,
        zone: ZoneInfo | None,
        domain: int | None,
        topics: Iterable[str] = (),
        assumed: frozenset[Assumption] = EVERY,
    ) -> None:
        self._kept = with_what_was(old, new)
        self.at = at
        self.profiles = profiles
        self.every = tuple(profile.name for profile in profiles)
        self.keystores = (old, new)
        documents = (*system_documents(old), *system_documents(new))
        self.accesses = AccessViews(documents, at, zone, assumed)
        read = self.accesses.by_row(profiles, (document.file for document in documents))
        self.channels = document_channels(read, claimed=[region_of((glob,)) for glob in topics], ungoverned=True)
        self.enclaves = (old.by_path, new.by_path)
        self.usability = tuple(
            usability_by_profile(keystore.enclaves, profiles, at, Usabilities(domain, self.accesses))
            for keystore in self.keystores
        )
        self.mask = bits(
            number
            for number, channel in enumerate(self.channels.channels)
            if domain is None or contains(self.channels.domains[channel.domain].intervals, domain)
        )
        self._domain = domain
        self._letting: dict[tuple[int, tuple[int, ...], tuple[int, ...]], tuple[frozenset[str], frozenset[str]]] = {}
        self.pairs = list(self._paired())
        self.unknown = tuple(dict.fromkeys(self._unread()))
        self._doubtful = frozenset(self._doubted())

    def _paired(self) -> Iterator[Pair]:
        """One pair for all profiles that share the views of both keystores."""
        olds, news = (self._views(keystore) for keystore in self.keystores)
        kept = news if self._kept is self.keystores[1] else self._views(self._kept)
        views = (olds, news, kept)
        pairs = grouped(self.profiles, lambda profile: tuple(id(each[profile.name]) for each in views))
        for alike in pairs.values():
            names = tuple(profile.name for profile in alike)
            yield Pair(profiles=names, lead=alike[0], old=olds[names[0]], new=news[names[0]], kept=kept[names[0]])

    def _views(self, keystore: Keystore) -> dict[str, View]:
        """By profile. What could not be read is kept apart and not compared."""
        builder = SystemBuilder(keystore, self.profiles, self.at, self.accesses, channels=self.channels)
        shared: dict[tuple[int, int], Decisions] = {}
        found: dict[str, View] = {}
        access = {profile.name: profile.access for profile in self.profiles}
        systems = builder.systems()
        for system in sorted(systems, key=lambda each: not each.may):
            key = (id(system.grants), id(system.rules))
            if key not in shared:
                shared[key] = Decisions(system)
            view = View(system, shared[key], keystore, self.accesses, access[system.profiles[0]])
            found.update(dict.fromkeys(system.profiles, view))
        return found

    def _unread(self) -> Iterable[Unread]:
        for side, keystore in zip(("old", "new"), self.keystores, strict=True):
            for profile in self._kinds.values():
                for doubt in keystore_doubts(keystore, profile, self.accesses):
                    yield Unread(side=side, enclave=doubt.enclave, location=doubt.location, reason=doubt.reason)
        old, new = ({(file.place, file.sha256) for file in each.unread_foreign} for each in self.keystores)
        for place, _digest in sorted(new - old, key=str):
            reason = "it is new, and its content was not read ([files] in the settings accepts it)"
            yield Unread(side="new", enclave=None, location=Location(path=place), reason=reason)

    def _doubted(self) -> Iterator[str]:
        """The paths of enclaves with something unread on one side; all that share a file are among them."""
        for keystore in self.keystores:
            for profile in self._kinds.values():
                row = self.accesses.row(profile.access)
                for enclave in keystore.enclaves:
                    if enclave_doubts(enclave, profile.trust, row, self.accesses):
                        yield enclave.path

    @cached_property
    def _kinds(self) -> dict[object, Profile]:
        """The profiles, one of each kind that reads files alike."""
        return {(each.trust, self.accesses.row(each.access)): each for each in self.profiles}

    @cached_property
    def common(self) -> list[str]:
        """The paths of enclaves of both."""
        return [path for path in self.enclaves[0] if path in self.enclaves[1]]

    @cached_property
    def both(self) -> frozenset[str]:
        """The same as a set."""
        return frozenset(self.common)

    @cached_property
    def compared(self) -> list[str]:
        """Those of which everything could be read on both sides."""
        return [path for path in self.common if path not in self._doubtful]

    def letting_in(self, path: str) -> Iterator[tuple[Pair, frozenset[str], frozenset[str]]]:
        """By pair, the enclaves of both keystores that accept the identity only in the old one, and only in the new
        one.
        """
        for place, pair in enumerate(self.pairs):
            key = place, pair.old.letting_in(path), pair.new.letting_in(path)
            if key not in self._letting:  # of 10,000 enclaves most are let in by the same
                before, after = pair.old.members(key[1]) & self.both, pair.new.members(key[2]) & self.both
                self._letting[key] = before - after, after - before
            yield pair, *self._letting[key]

    def is_void(self, document: Typed | None, profile: Profile) -> bool:
        """Whether an implementation rejects the document, whoever signed it: then it says nothing."""
        if document is None:
            return False
        refused = self.accesses.read(document, profile.access).refusal is not None
        return refused or envelope(document.signed).verdict is Truth.NO

    def refused(self, pair: Pair, path: str, document: str) -> bool:
        """Whether the implementations reject the enclave's governance or permissions, old or new."""
        return any(self.is_void(getattr(by_path[path], document), pair.lead) for by_path in self.enclaves)

    def in_order(self, profiles: Iterable[str]) -> tuple[str, ...]:
        """The profiles in the order in which they were asked for."""
        wanted = set(profiles)
        return tuple(name for name in self.every if name in wanted)

    def is_read(self, path: str) -> bool:
        """Whether everything of the enclave could be read on both sides."""
        return path not in self._doubtful

    def alone(self, side: int) -> list[str]:
        """The paths of enclaves that only one side (0: old, 1: new) has, and of which everything could be read."""
        other = self.enclaves[1 - side]
        return [path for path in self.enclaves[side] if path not in other and path not in self._doubtful]

    def named(self, topics: Sequence[str]) -> int:
        """The channels of nothing but these topics, in whatever partition and domain."""
        wanted = self._literals.intersection(topics)
        return bits(
            number
            for number, channel in enumerate(self.channels.channels)
            if channel.topic in wanted and all(cell.topic in wanted for cell in self.channels.cells(number))
        )

    def claimed(self, topic: str) -> int:
        """The channels of one of the globs that are told apart."""
        return bits(self.channels.regions[region_of((topic,))])

    def names(self, channels: int) -> Names | None:
        """The names of a set of channels, by witnesses; None: there are none."""
        if not channels:
            return None
        found = self.witnesses(channels)
        domains = self.pairs[0].old.decisions.channels_in
        within = [number for number, theirs in enumerate(domains) if theirs & channels]
        return Names(
            shown=tuple(found[:MAX_SHOWN]),
            more=max(0, len(found) - MAX_SHOWN),
            infinite=any(cell.infinite for number in members(channels) for cell in self.channels.cells(number)),
            domains=self._joined(each for number in within for each in self.channels.domains[number].intervals),
            every=not any(domains[number] & ~channels for number in within),
        )

    def witnesses(self, channels: int) -> list[Name]:
        """A name for each topic in each partition: single ones first, and last those that every node uses."""
        found: dict[tuple[str, str], tuple[list[Interval], list[bool]]] = {}
        for number in members(channels):
            for cell in self.channels.cells(number):
                intervals, several = found.setdefault((cell.topic, cell.partition), ([], []))
                intervals += self.channels.domains[self.channels.channels[number].domain].intervals
                several.append(cell.infinite or cell.topic not in self._literals)
        names = [
            Name(topic=topic, partition=partition, domains=self._joined(intervals), several=any(several))
            for (topic, partition), (intervals, several) in found.items()
        ]
        return sorted(names, key=lambda name: (name.topic in AMBIENT, name.several, name.partition, name.topic))

    def _joined(self, intervals: Iterable[Interval]) -> tuple[Interval, ...]:
        if self._domain is not None:
            return ((self._domain, self._domain),)
        return merged(intervals)

    @cached_property
    def _literals(self) -> frozenset[str]:
        """Names that some expression spells out: their channels hold no other topic."""
        return frozenset(text for _matcher, region in self.channels.regions for area in region for text in area.topics)


def with_what_was(old: Keystore, new: Keystore) -> Keystore:
    """NEW, with the documents and the identities beside it that OLD alone has."""
    known = {e.permissions.signed.file.sha256 for e in new.enclaves if e.permissions is not None}
    known |= {each.file.sha256 for each in new.unmanaged}
    carried = (enclave.permissions for enclave in old.enclaves)
    others = (each.document for each in old.unmanaged)
    files = [file for file in (*carried, *others) if isinstance(file, PermissionsFile)]
    gone = {file.signed.file.sha256: file for file in files if file.signed.file.sha256 not in known}
    # An identity of the same name and authority may do what this one may.
    named = {(e.identity.subject, e.identity.issuer) for e in new.enclaves if e.identity is not None}
    owned = [e.identity for e in old.enclaves if e.identity is not None]
    owned += [each.certificate for each in old.identities.found]
    identities = {c.sha256: c for c in owned if (c.subject, c.issuer) not in named}
    if not gone and not identities:
        return new
    signers = Candidates(c for k in (new, old) for c in every_certificate(k.enclaves, k.authorities, ()))
    documents = [
        UnmanagedDocument(
            file=replace(file.signed.file, path=BEFORE + file.signed.file.place, resolved=None),
            document=read_permissions(file.signed.file, signers),
        )
        for file in gone.values()
    ]
    known_by = [
        UnmanagedIdentity(certificate=replace(c, path=BEFORE + c.path), key=BEFORE) for c in identities.values()
    ]
    found = replace(new.identities, found=(*new.identities.found, *known_by))
    return replace(new, unmanaged=(*new.unmanaged, *documents), identities=found)
