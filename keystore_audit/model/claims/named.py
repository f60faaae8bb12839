"""What settings name apart from claims: places, forwards, publishers, and subjects that nobody here has."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.globs import (
    Globs,
    by_default,
    left_out,
    means_everybody,
    named_enclaves,
    named_paths,
    nameless,
    region_of,
    topic_regions,
    unmanaged,
)
from keystore_audit.model.claims.stated import Marks, check_granted, granted_channels
from keystore_audit.model.formal.asked import Place, PlaceAtom, Scheduler
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import CertificateAtom, GrantAtom, Participant, System, TrustDomainAtom
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.subjects.told import Meaning, grants_naming, meaning


class NamedPlace(Struct, frozen=True, kw_only=True):
    """A name for enclaves, or for topics (`globs`). `place`: where a user gave it, `FILE:LINE`."""

    name: str
    globs: Globs
    place: str


def place_regions(places: Iterable[NamedPlace]) -> tuple[ReadRegion, ...]:
    """The sets of topics that have names: they take part in the classes, so that a name is exact."""
    with_topics = (place.globs.topics for place in places if place.globs.topics)
    return tuple(dict.fromkeys(region for topics in with_topics for region in topic_regions(topics)))


def with_places(
    systems: Sequence[System], places: Sequence[NamedPlace], channels: Channels, keystore: Keystore
) -> tuple[System, ...]:
    """The systems with the places as facts.

    Raises errors.UsageError for a name of something that is not in the keystore: whatever is said of it would be true.
    """
    if not places or not systems:
        return tuple(systems)
    _check(places, systems, channels, keystore)
    known = {enclave.path for enclave in keystore.enclaves}
    return tuple(
        replace(system, places=tuple(_atom(place, system, channels, known) for place in places)) for system in systems
    )


def _check(places: Sequence[NamedPlace], systems: Sequence[System], channels: Channels, keystore: Keystore) -> None:
    """Raises errors.UsageError for globs that find nothing."""
    paths = [enclave.path for enclave in keystore.enclaves]
    used = granted_channels(systems)
    for place in places:
        for glob in place.globs.enclaves:
            named_paths(glob, paths, place.place)
        for glob in place.globs.topics:
            check_granted(glob, channels, used, place.place)


def _atom(place: NamedPlace, system: System, channels: Channels, known: set[str]) -> PlaceAtom:
    """`known`: the paths of enclaves."""
    globs = place.globs.enclaves
    enclaves = named_enclaves(system, globs, known, unread=False)
    if any(map(means_everybody, globs)):
        enclaves |= unmanaged(system)
    return PlaceAtom(
        name=place.name,
        enclaves=enclaves if globs else None,
        channels=channels.regions[region_of(place.globs.topics)] if place.globs.topics else None,
        unread=bool(globs) and bool(nameless(system, known)),
    )


# Subjects that grants name and no enclave here has: whoever has such an identity may present the grant.
#
# The keystore of one robot holds its own enclaves; its authorities vouch for those of others too. Peers take a document
# from whoever has a subject that it names. So each such subject becomes a certificate that no enclave has. It is there
# for claims of who alone may do something, or learns something, and takes part in no flow: nobody knows what it
# forwards.


UNREAD_IDENTITY = "somebody named by a document that could not be read"
"""The subject that stands for all that are named there."""


def with_subjects_elsewhere(systems: Iterable[System]) -> tuple[System, ...]:
    """The systems, each with a certificate for every subject that its grants name and that is no enclave's here.

    An enclave has a subject only where its peers accept its certificate. Where they refuse it, somebody else may have
    one that they accept.
    """
    known: dict[object, tuple[GrantAtom, ...]] = {}
    return tuple(_with_subjects(system, known) for system in systems)


def same_elsewhere(system: System, enclave: int) -> Iterator[int]:
    """The certificates that stand for holders of the enclave's subject elsewhere."""
    identity = system.enclaves[enclave].identity
    elsewhere = [number for number, certificate in enumerate(system.certificates) if certificate.elsewhere]
    if identity is not None and elsewhere:
        meant = meaning(system.certificates[identity].label)
        yield from (number for number in elsewhere if meaning(system.certificates[number].label) == meant)


def _with_subjects(system: System, known: dict[object, tuple[GrantAtom, ...]]) -> System:
    """`known`: grants that systems have in common stay so, since decisions are worked out once for equal objects."""
    here = _Here(system)
    places: dict[str, Location] = {}
    named: dict[str, set[int]] = {}
    for grant in system.grants:
        places.setdefault(grant.subject, grant.location)
        named.setdefault(grant.subject, set()).update(grant.names)
    lacking = {text: trust_domains for text in places if (trust_domains := here.lacking(text, named[text]))}
    unread = next((document.location for document in system.documents if document.opaque), None)
    first_key = 1 + max((certificate.key for certificate in system.certificates), default=-1)
    made: list[CertificateAtom] = []
    naming: dict[int, set[int]] = {}
    for text, sets in grants_naming(system, lacking).items():
        for grants in sets:
            for number in grants:
                naming.setdefault(number, set()).add(len(system.certificates) + len(made))
            made.append(_certificate(system, text, places[text], lacking[text], first_key + len(made)))
    if unread is not None:
        made.append(_certificate(system, UNREAD_IDENTITY, unread, system.trust_domains, first_key + len(made)))
    if not made:
        return system
    key = (id(system.grants), tuple((number, frozenset(naming[number])) for number in sorted(naming)))
    if key not in known:
        known[key] = tuple(
            replace(grant, names=grant.names | naming[number]) if number in naming else grant
            for number, grant in enumerate(system.grants)
        )
    return replace(system, certificates=(*system.certificates, *made), grants=known[key])


def _certificate(
    system: System, subject: str, place: Location, trust_domains: Iterable[TrustDomainAtom], key: int
) -> CertificateAtom:
    """One that the identity CAs of these trust domains issued, with this key."""
    return CertificateAtom(
        label=subject,
        location=place,
        issuers=frozenset[int]().union(*(trust_domain.identity_ca for trust_domain in trust_domains)),
        authority=False,
        fit_to_sign=False,
        key=key,
        not_before=0,
        not_after=len(system.instants) - 1,
        elsewhere=True,
    )


class _Here:
    """Who is here, by the subjects of their certificates."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._left_out = {each.identity for each in system.left_out}
        identities = {enclave.identity for enclave in system.enclaves} | self._left_out
        self._meant: dict[Meaning, list[int]] = {}
        for identity in sorted(each for each in identities if each is not None):
            self._meant.setdefault(meaning(system.certificates[identity].label), []).append(identity)
        # Most trust domains differ in their governance alone.
        self._trust_domains = list(
            {(each.identity_ca, each.ever_revoked, self._open(each)): each for each in system.trust_domains}.values()
        )

    def lacking(self, subject: str, named: set[int]) -> Sequence[TrustDomainAtom]:
        """Trust domains in which nobody here has the subject. `named`: certificates with it that grants name.

        It is unknown which trust domains an enclave that was left out is in.
        """
        having = named.intersection(self._meant.get(meaning(subject), ()))
        if having & self._left_out:
            return ()
        return [
            trust_domain
            for trust_domain in self._trust_domains
            if not any(self._introduced(trust_domain, each) for each in having)
        ]

    def _introduced(self, trust_domain: TrustDomainAtom, identity: int) -> bool:
        """Whether the trust domain takes it for who it says, at each moment, whatever the dates of certificates."""
        if self._open(trust_domain):
            return True
        certificates = self._system.certificates
        # (MUST) Where the list could not be read, everybody counts as revoked, and nobody is for certain.
        unread = not self._system.may and len(trust_domain.revoked) == len(certificates)
        revoked = frozenset[int]() if unread else trust_domain.ever_revoked
        vouching = certificates[identity].issuers & trust_domain.identity_ca
        return identity not in revoked and any(certificates[number].authority for number in vouching)

    def _open(self, trust_domain: TrustDomainAtom) -> bool:
        return trust_domain.governance is not None and self._system.documents[trust_domain.governance].opaque


# Who may publish by a claim of only-publish: whom it names, or the one enclave that does now.


def permitted(system: System, globs: Collection[str], known: Collection[str], channels: frozenset[int]) -> Place:
    """The enclaves that the globs name, of all (`known`) those in the system; without globs some writer.

    Included is who has the subject of one elsewhere, where its peers refuse the certificate here. Included too (MUST)
    is what may belong to intended enclaves that were left out: if they publish, that is no violation.
    """
    if globs:
        here = named_enclaves(system, globs, known, unread=False)
        return _with_theirs(system, here, left_out(system, globs, known))
    writer = _some_writer(system, channels)
    return _with_theirs(system, writer, () if writer else system.left_out)


def _with_theirs(system: System, enclaves: frozenset[int], unread: Iterable[Participant]) -> Place:
    """The enclaves, holders of their subjects elsewhere, and each certificate that may belong to one of `unread`."""
    identities = {each.identity for each in unread}
    anybody = None in identities
    keys = {system.certificates[identity].key for identity in identities if identity is not None}
    unmanaged = {
        n for n, each in enumerate(system.enclaves) if each.unmanaged and (anybody or system.key_of(n) in keys)
    }
    here = {each.identity for each in system.enclaves}
    possible = {n for n in range(len(system.certificates)) if anybody or n in identities} - here
    theirs = {each for enclave in enclaves for each in same_elsewhere(system, enclave)}
    return Place(enclaves=enclaves | unmanaged, certificates=frozenset(possible | theirs))


def _some_writer(system: System, channels: frozenset[int]) -> frozenset[int]:
    """One enclave that may write one of the channels at the audit instant, none where nobody may.

    Only identities of enclaves count, and readable ones come first. Else it is one whose subject may write there
    elsewhere. This does not say that nobody else writes there.
    """
    asked = bits(channels)
    views = trust_domain_views(system)
    enclaves = [number for number, enclave in enumerate(system.enclaves) if not enclave.unmanaged]
    for number in sorted(enclaves, key=lambda number: system.enclaves[number].opaque):
        if any(view.abilities(number).may_write & asked for view in views):
            return frozenset({number})
    writing = {each for view in views for each, able in view.elsewhere.items() if able.may_write & asked}
    for number in enclaves if writing else ():
        if writing.intersection(same_elsewhere(system, number)):
            return frozenset({number})
    return frozenset()


# What users say that their nodes forward, and what follows for one system (docs/model.md, Determinism).


UNREAD: Final = "it depends on what could not be read"
"""Why a claim is undecided where the readings of a system differ."""


class Forward(Struct, frozen=True, kw_only=True):
    """A node of an enclave publishes on each of `targets` what it got of `sources` (DDS topics), as it came.

    `sources` in the order of their priority. An enclave with forwards does nothing else. `location`, `place`: where it
    is declared, as in `claims.Claim`.
    """

    enclave: str
    sources: tuple[str, ...]
    targets: tuple[str, ...]
    scheduler: Scheduler
    location: Location
    place: str
    marks: Marks = ()


class Determinism(Struct, frozen=True, kw_only=True):
    """A claim that two runs show the same on `low` (DDS topics), whatever comes from `high`, with equal other inputs.

    `forwards`: those on which what is on `low` depends. The rest is as in `claims.Claim`.
    """

    id: str
    statement: str
    severity: Severity
    high: Globs
    low: tuple[str, ...]
    forwards: tuple[Forward, ...]
    include_ambient: bool
    location: Location
    place: str
    marks: Marks = ()

    @property
    def meaning(self) -> str:
        """What is claimed, and of which forwards, apart from names and words: equal for equal claims."""
        forwards = [[f.enclave, f.sources, sorted(f.targets), f.scheduler.value] for f in self.forwards]
        high = [sorted(self.high.enclaves), sorted(self.high.topics)]
        return json.dumps(["deterministic", sorted(self.low), high, self.include_ambient, forwards])


class Declared(Struct, frozen=True, kw_only=True):
    """The forwards that are declared, and what is claimed of them."""

    forwards: tuple[Forward, ...] = ()
    claims: tuple[Determinism, ...] = ()

    def regions(self) -> tuple[ReadRegion, ...]:
        """The sets of names that take part in the classes, so that the claims are exact."""
        topics: dict[str, None] = {}
        for forward in self.forwards:
            topics.update(dict.fromkeys((*forward.sources, *forward.targets)))
        for claim in self.claims:
            topics.update(dict.fromkeys((*claim.low, *claim.high.topics)))
        if not self.claims:
            return ()
        return (
            region_of(AMBIENT),
            *(region for topic in topics for region in (region_of((topic,)), by_default(topic))),
        )


def leading_to(low: Iterable[str], forwards: Sequence[Forward]) -> tuple[Forward, ...]:
    """The forwards on which what is on these topics depends, in their order."""
    topics = set(low)
    found: set[int] = set()
    while True:
        more = {n for n, forward in enumerate(forwards) if n not in found and topics.intersection(forward.targets)}
        if not more:
            return tuple(forwards[number] for number in sorted(found))
        found |= more
        topics.update(source for number in more for source in forwards[number].sources)
