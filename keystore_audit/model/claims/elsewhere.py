"""Subjects that grants name and no enclave here has: whoever has such an identity may present the grant.

The keystore of one robot holds its own enclaves; its authorities vouch for those of others too, and peers take a
document from whoever has a subject that it names. So each such subject becomes a certificate that no enclave has. It
is there for claims of who alone may do something, or learns something, and takes part in no flow: nobody knows what it
forwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.model.formal.system import CertificateAtom, GrantAtom, Reading, RealmAtom, System
from keystore_audit.model.subjects.told import Meaning, grants_naming, meaning

UNREAD = "somebody whom a document names that could not be read"
"""The subject that stands for all that are named there."""


def with_subjects_elsewhere(systems: Iterable[System]) -> tuple[System, ...]:
    """The systems, each with a certificate for every subject that its grants name and that is no enclave's here.

    That an enclave has it counts where its peers take the enclave for whom it says: in realms that refuse its own
    certificate somebody else may have one that they take.
    """
    known: dict[object, tuple[GrantAtom, ...]] = {}
    return tuple(_with_subjects(system, known) for system in systems)


def same_elsewhere(system: System, enclave: int) -> Iterator[int]:
    """The certificates that stand for whoever has the subject of the enclave and is not here."""
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
    lacking = {text: realms for text in places if (realms := here.lacking(text, named[text]))}
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
        made.append(_certificate(system, UNREAD, unread, system.realms, first_key + len(made)))
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
    system: System, subject: str, place: Location, realms: Iterable[RealmAtom], key: int
) -> CertificateAtom:
    """One that the identity CAs of these realms issued, with this key."""
    return CertificateAtom(
        label=subject,
        location=place,
        issuers=frozenset[int]().union(*(realm.identity_ca for realm in realms)),
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
        # Most realms differ in their governance alone.
        self._realms = list(
            {(each.identity_ca, each.ever_revoked, self._open(each)): each for each in system.realms}.values()
        )

    def lacking(self, subject: str, named: set[int]) -> Sequence[RealmAtom]:
        """Realms in which nobody here has the subject. `named`: whom grants name that have it.

        Of an enclave that was left out nobody knows which do.
        """
        having = named.intersection(self._meant.get(meaning(subject), ()))
        if having & self._left_out:
            return ()
        return [realm for realm in self._realms if not any(self._introduced(realm, each) for each in having)]

    def _introduced(self, realm: RealmAtom, identity: int) -> bool:
        """Whether the realm takes it for who it says it is, at each moment, whatever the dates of certificates."""
        if self._open(realm):
            return True
        certificates = self._system.certificates
        # (MUST) Where the list could not be read, everybody counts as revoked, and nobody is for certain.
        unread = self._system.reading is Reading.MUST and len(realm.revoked) == len(certificates)
        revoked = frozenset[int]() if unread else realm.ever_revoked
        vouching = certificates[identity].issuers & realm.identity_ca
        return identity not in revoked and any(certificates[number].authority for number in vouching)

    def _open(self, realm: RealmAtom) -> bool:
        return realm.governance is not None and self._system.documents[realm.governance].opaque
