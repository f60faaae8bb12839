"""Identities that lie beside the enclaves and that peers of theirs take for one of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from functools import cached_property
from itertools import chain, islice
from typing import NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.issuer import fit_to_sign
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.permissions import Grant, PermissionsFile
from keystore_audit.keystore.unmanaged import UnmanagedIdentity
from keystore_audit.model.inventory import (
    authorities_of,
    documents_of,
    embedded_authorities,
    may_be_taken,
    named_by_some,
    permissions_cas,
    trust_files,
)
from keystore_audit.model.trust.revocation import revoked
from keystore_audit.model.trust.verdicts import is_authority, is_issued, may_have_issued, signing_authorities
from keystore_audit.model.validity import ANY_ZONE, read_date
from keystore_audit.profiles import DateReading, Profile, Trust


class Admitted(Struct, frozen=True, kw_only=True):
    """An identity beside the enclaves that peers take. `key`: where its private key lies.

    `rights`: what lets it in: grants that name it, in documents that a peer may take, a governance that wants none, or
    the permissions CA, where peers take permissions that it signs itself.
    `enclave`: one that has the same subject, and whom all take that take this one, so that it has the same rights
    already; None: nobody has.
    """

    certificate: Certificate
    key: str
    rights: tuple[Location, ...]
    enclave: str | None


class _Peer(NamedTuple):
    """One of the enclaves that trust alike, as an implementation reads its files. `wants_grant`: from whoever joins."""

    enclave: Enclave
    trust: Trust
    wants_grant: bool


def admitted(
    keystore: Keystore, identities: Sequence[UnmanagedIdentity], profiles: Sequence[Profile], at: datetime
) -> tuple[Admitted, ...]:
    """Those of `identities` that some peer takes under some profile `at` an instant, or later by a grant that begins.

    `at`: aware UTC.
    """
    enclaves = list({trust_files(enclave): enclave for enclave in keystore.enclaves}.values())
    kinds = dict.fromkeys((profile.trust, profile.access.requires_grant) for profile in profiles)
    peers = [_Peer(enclave, *kind) for enclave in enclaves for kind in kinds]
    authorities = {certificate.sha256 for certificate in authorities_of(keystore)}
    asked = ((s, _taking(peers, s.certificate, at)) for s in identities if s.certificate.sha256 not in authorities)
    vouched = [(each, taking) for each, taking in asked if taking]
    if not vouched:  # nearly always
        return ()
    granted = _granted(keystore, [each.certificate for each, _taking in vouched], profiles, at)
    signers = _Signers(keystore)
    return tuple(
        Admitted(
            certificate=each.certificate,
            key=each.key,
            rights=rights,
            enclave=_like(each.certificate, taking, keystore, signers, at),
        )
        for number, (each, taking) in enumerate(vouched)
        if (rights := tuple(granted.get(number) or _ungranted(taking, signers, each.certificate)))
    )


def _taking(peers: Iterable[_Peer], certificate: Certificate, at: datetime) -> list[_Peer]:
    """Those of the peers that take who has the certificate for one of theirs."""
    return [peer for peer in peers if _takes(peer.enclave, certificate, peer.trust, at)]


def _takes(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> bool:
    """Whether the enclave authenticates who has the certificate; its dates count."""
    file = enclave.identity_ca
    return (
        file is not None
        and at <= certificate.not_after
        and is_issued(file, certificate, trust)
        and not revoked(enclave, (certificate,), trust, at)
    )


def _like(
    certificate: Certificate, taking: Sequence[_Peer], keystore: Keystore, signers: _Signers, at: datetime
) -> str | None:
    """The path of an enclave of the same subject that has, to each of these peers, all rights that this one has."""
    signing = [*signers.peers(taking, certificate)]
    for enclave in keystore.enclaves:
        theirs = enclave.identity
        if (
            theirs is not None
            and theirs.subject == certificate.subject
            and len(_taking(taking, theirs, at)) == len(taking)
            and len([*signers.peers(signing, theirs)]) == len(signing)
        ):
            return enclave.path
    return None


class _Signers:
    """Whose keys sign permissions that peers take, by the authorities of CA files and messages of a keystore."""

    def __init__(self, keystore: Keystore) -> None:
        self._keystore = keystore

    @cached_property
    def _authorities(self) -> tuple[Certificate, ...]:
        found = (*authorities_of(self._keystore), *embedded_authorities(documents_of(self._keystore)))
        return tuple({each.sha256: each for each in found if is_authority(each)}.values())

    def trusted_by(self, peers: Iterable[_Peer], certificate: Certificate) -> Iterator[Location]:
        """Where the authority stands by which one of the peers takes what the certificate's key signs."""
        for peer in self.peers(peers, certificate):
            if peer.enclave.permissions_ca is not None:
                yield Location(path=peer.enclave.permissions_ca.file.place, line=1)

    def peers(self, peers: Iterable[_Peer], certificate: Certificate) -> Iterator[_Peer]:
        """Those of the peers that take what it signs for itself (`attacker.TrustDomainView.self_granting`)."""
        for peer in peers:
            ca, trust = peer.enclave.permissions_ca, peer.trust
            roots = signing_authorities(ca, trust) if ca is not None else ()
            below = not trust.pins_signer and (fit_to_sign(certificate) or is_authority(certificate))
            if any(root.key == certificate.key for root in roots) or (below and self._chains(certificate, roots)):
                yield peer

    def _chains(self, certificate: Certificate, roots: Iterable[Certificate]) -> bool:
        """Whether it is below one of the roots: a message brings the authorities between along."""
        ends = {root.sha256 for root in roots}
        pending, seen = [certificate], {certificate.sha256}
        while pending:
            below = pending.pop()
            above = [each for each in self._authorities if may_have_issued(each, below) and each.sha256 not in seen]
            if any(each.sha256 in ends for each in above):
                return True
            seen.update(each.sha256 for each in above)
            pending.extend(above)
        return False


def _granted(
    keystore: Keystore, certificates: Sequence[Certificate], profiles: Sequence[Profile], at: datetime
) -> dict[int, list[Location]]:
    """By certificate, the grants that have not ended and name it, in documents that some peer may take."""
    files = permissions_cas(keystore)
    grants = [
        (grant, Location(path=file.signed.file.place, line=grant.line))
        for document in documents_of(keystore)
        if isinstance(file := document.file, PermissionsFile) and may_be_taken(file.signed, files)
        for grant in file.grants
        if not _ended(grant, at)
    ]
    named = named_by_some((grant.subject_name.text for grant, _place in grants), certificates, profiles)
    return gathered((number, place) for grant, place in grants for number in named[grant.subject_name.text])


def _ended(grant: Grant, at: datetime) -> bool:
    """Whether every implementation takes it for over, wherever the robot is."""
    dated = read_date(grant.not_after.text, DateReading.XSD, None)
    return dated is not None and at - dated.instant > ANY_ZONE


def _ungranted(taking: Sequence[_Peer], signers: _Signers, certificate: Certificate) -> Iterator[Location]:
    """What lets it in among these peers without a grant of the permissions CA, if anything does."""
    return islice(chain(_without_grants(taking), signers.trusted_by(taking, certificate)), 1)


def _without_grants(peers: Iterable[_Peer]) -> Iterator[Location]:
    """Governances under which these peers let in whomever they authenticate."""
    for peer in peers:
        file = None if peer.wants_grant else peer.enclave.governance
        if file is not None and file.governance is not None:
            rules = file.governance.domain_rules
            yield from (
                Location(path=file.signed.file.place, line=rule.line)
                for rule in rules
                if not rule.enable_join_access_control
            )


class Takers:
    """Which enclaves of a keystore authenticate somebody `at` an instant (aware UTC), or later."""

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._at = at
        self._alike = grouped(keystore.enclaves, trust_files)

    def of(self, certificate: Certificate, profiles: Sequence[Profile]) -> Iterator[str]:
        """The paths of those that do so under some of the profiles."""
        for enclaves in self._alike.values():
            if any(_takes(enclaves[0], certificate, profile.trust, self._at) for profile in profiles):
                yield from (enclave.path for enclave in enclaves)
