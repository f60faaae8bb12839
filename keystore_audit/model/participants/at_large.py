"""Identities that are no enclave's own (`inventory.identities_at_large`) as participants of a system.

Whoever has such a certificate's key joins under it, with the grants of its subject, and peers cannot tell. Where
nothing of that is unknown, they are in both readings. MAY has to have them, or a flow over them would be missing. MUST
has to have them as well: peers let them in for certain, and else a doubt about something else would make unknown of
what they do. That nothing good rests on them, which is a matter of claims, is seen to there (`model.claims.claims`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.formal.system import CertificateAtom, EnclaveAtom, RealmAtom
from keystore_audit.model.participants.lone_endpoints import Endpoints, Timeline, joined, made_alone, within
from keystore_audit.text import shorten

MAX_SUBJECT: Final = 160
"""Characters of a subject in the name of its identity."""

MAX_AT_LARGE: Final = 2_000
"""Participants that are no enclaves; in large keystores each costs as much as an enclave does."""


class Candidate(Struct, frozen=True, kw_only=True):
    """An identity at large by the index of its certificate.

    `doubted`: whether peers take it for whom is unknown. `possible`: so is whether anybody has its key. `alone`: it
    stands in an identity CA file itself, and is no authority of a realm, so that any may be the one that takes it.
    """

    certificate: Certificate
    number: int
    doubted: bool
    possible: bool = False
    alone: bool = False


def at_large_atoms(
    candidates: Iterable[Candidate],
    enclaves: Sequence[EnclaveAtom],
    realms: Sequence[RealmAtom],
    certificates: Sequence[CertificateAtom],
    names: Mapping[str, frozenset[int]],
    own: Mapping[tuple[int, int], Sequence[Timeline]],
) -> Iterator[EnclaveAtom]:
    """The identities that a realm lets in, in each that does.

    Whose realm it is matters for what it takes itself, and nobody knows which files it is started with
    (`holders.hosts_of`): an enclave that has its key need not use its own, nor need anybody else.
    `names`: the certificates that subjects of grants mean. `own`: by certificate and realm, the endpoints that their
    implementation creates with each document that names them. One that is like an enclave's own, or like another, in
    all that peers look at, and that has no endpoints beyond those of that one, adds nothing to its realm and is left
    out there: a certificate that was renewed, for instance. Raises errors.BudgetExceeded.
    """
    every = {key: joined(several) for key, several in own.items()}
    adding = _adding(candidates, enclaves, realms, certificates, names, every)
    for count, (each, realm, timeline) in enumerate(adding):
        if count >= MAX_AT_LARGE:
            raise BudgetExceeded(
                f"More than {MAX_AT_LARGE} identities that are no enclave's own are more than can be told apart, "
                f"{each.certificate.path}:{each.certificate.line} among them."
            )
        atom = EnclaveAtom(
            label=f"{shorten(each.certificate.subject, MAX_SUBJECT)} ({each.certificate.path}, no enclave)",
            location=Location(path=each.certificate.path, line=each.certificate.line),
            realm=realm,
            identity=None if each.doubted else each.number,
            permissions=None,
            opaque=each.doubted,
            at_large=True,
            possible=each.possible,
        )
        yield made_alone(atom, timeline)


def let_in(
    candidates: Iterable[Candidate],
    enclaves: Iterable[EnclaveAtom],
    realms: Sequence[RealmAtom],
    certificates: Sequence[CertificateAtom],
) -> list[Candidate]:
    """Those that some enclave takes for one of its realm: others have nobody to talk to, whatever they start with."""
    peers = [realms[number] for number in sorted({enclave.realm for enclave in enclaves})]
    return [each for each in candidates if any(admits(realm, each, certificates) for realm in peers)]


def _adding(
    candidates: Iterable[Candidate],
    enclaves: Iterable[EnclaveAtom],
    realms: Sequence[RealmAtom],
    certificates: Sequence[CertificateAtom],
    names: Mapping[str, frozenset[int]],
    own: Mapping[tuple[int, int], Timeline],
) -> Iterator[tuple[Candidate, int, Timeline]]:
    """Those that a realm lets in and that add something to the enclaves there and to those before.

    With the realm, and what their own implementation creates in it.
    """
    candidates = tuple(candidates)
    if not candidates:  # nearly always
        return
    told = _Told(realms, certificates, names)
    known: dict[tuple[int, object], list[Timeline]] = {}
    for enclave in enclaves:
        if enclave.identity is not None:
            moments = ((0, enclave), *enclave.later)
            timeline = tuple((begin, Endpoints(atom.reads_alone, atom.writes_alone)) for begin, atom in moments)
            known.setdefault((enclave.realm, told.of(enclave.identity)), []).append(timeline)
    for each in candidates:
        about = told.of(each.number)
        for realm, atom in enumerate(realms):
            if not admits(atom, each, certificates):
                continue
            timeline, alike = own.get((each.number, realm), ()), known.setdefault((realm, about), [])
            if each.doubted or not any(within(timeline, other) for other in alike):
                alike.append(timeline)
                yield each, realm, timeline


def unread_atoms(places: Sequence[str], realms: Sequence[RealmAtom]) -> Iterator[EnclaveAtom]:
    """(MAY) Identities in files outside enclaves that were not read: one stands for all, in each realm."""
    for realm in range(len(realms)) if places else ():
        yield EnclaveAtom(
            label=f"whoever is in {places[0]}{f' and {len(places) - 1} more files' if len(places) > 1 else ''}",
            location=Location(path=places[0]),
            realm=realm,
            identity=None,
            permissions=None,
            opaque=True,
            at_large=True,
        )


def trusting_all(realms: Iterable[RealmAtom], unread: RealmAtom) -> RealmAtom:
    """(MAY) The realm of a governance that could not be read, with the authorities of all these realms."""
    several = tuple(realms)
    return replace(
        unread,
        identity_ca=frozenset[int]().union(*(realm.identity_ca for realm in several)),
        permissions_ca=frozenset[int]().union(*(realm.permissions_ca for realm in several)),
    )


def admits(realm: RealmAtom, each: Candidate, certificates: Sequence[CertificateAtom]) -> bool:
    """Whether members of the realm take who has the certificate for one of theirs, whatever the dates."""
    issuers = certificates[each.number].issuers & realm.identity_ca
    vouched = each.alone or any(certificates[issuer].authority for issuer in issuers)
    return vouched and each.number not in realm.always_revoked


class _Told:
    """All that a peer looks at in a certificate, dates apart; equal for certificates that serve alike."""

    def __init__(
        self,
        realms: Sequence[RealmAtom],
        certificates: Sequence[CertificateAtom],
        names: Mapping[str, frozenset[int]],
    ) -> None:
        self._certificates = certificates
        self._revoked = gathered(
            (certificate, (number, moment))
            for number, realm in enumerate(realms)
            for moment, revoked in ((-1, realm.revoked), *realm.revoked_later)
            for certificate in revoked
        )
        self._named = gathered((certificate, text) for text, named in names.items() for certificate in named)

    def of(self, number: int) -> object:
        """All of one."""
        atom = self._certificates[number]
        return (
            (atom.key, atom.issuers, atom.authority, atom.fit_to_sign),
            tuple(self._revoked.get(number, ())),
            tuple(self._named.get(number, ())),
        )
