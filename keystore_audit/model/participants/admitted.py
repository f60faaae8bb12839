"""Identities that lie beside the enclaves and that peers of theirs accept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import chain, islice
from typing import NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.issuer import fit_to_sign
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Grant, PermissionsFile
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

    `rights`: what lets it in. That is grants that name it, in documents that a peer may take, or a governance that
    wants none. Or it is the permissions CA, where peers take permissions that it signs itself.
    `enclave`: one with the same subject, accepted by all who accept this one, so that it has the same rights already;
    None: nobody has.
    """

    certificate: Certificate
    key: str
    rights: tuple[Location, ...]
    enclave: str | None


class _Peer(NamedTuple):
    """One of the enclaves that trust alike, as an implementation reads its files. `wants_grant`: of who joins."""

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
    vouched = [
        (each, taking)
        for each in identities
        if each.certificate.sha256 not in authorities
        and (taking := [peer for peer in peers if _takes(peer.enclave, each.certificate, peer.trust, at)])
    ]
    if not vouched:  # nearly always
        return ()
    granted = _granted(keystore, [each.certificate for each, _taking in vouched], profiles, at)
    above = (*authorities_of(keystore), *embedded_authorities(documents_of(keystore)))
    above = tuple({each.sha256: each for each in above if is_authority(each)}.values())
    found = []
    for number, (each, taking) in enumerate(vouched):
        certificate = each.certificate
        signing = [peer for peer in taking if _takes_signature(peer, certificate, above)]
        rights = granted.get(number) or [*islice(chain(_without_grants(taking), _permissions_cas(signing)), 1)]
        if rights:
            alike = (
                enclave.path
                for enclave in keystore.enclaves
                if (theirs := enclave.identity) is not None
                and theirs.subject == certificate.subject
                and all(_takes(peer.enclave, theirs, peer.trust, at) for peer in taking)
                and all(_takes_signature(peer, theirs, above) for peer in signing)
            )
            found.append(
                Admitted(certificate=certificate, key=each.key, rights=tuple(rights), enclave=next(alike, None))
            )
    return tuple(found)


def _takes(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> bool:
    """Whether the enclave authenticates the holder of the certificate; its dates count."""
    file = enclave.identity_ca
    return (
        file is not None
        and at <= certificate.not_after
        and is_issued(file, certificate, trust)
        and not revoked(enclave, (certificate,), trust, at)
    )


def _takes_signature(peer: _Peer, certificate: Certificate, authorities: Iterable[Certificate]) -> bool:
    """Whether it accepts permissions that the certificate's key signs (`attacker.TrustDomainView.self_granting`).

    `authorities`: those over which one that is not pinned may chain to a root; a message brings them along.
    """
    ca, trust = peer.enclave.permissions_ca, peer.trust
    roots = signing_authorities(ca, trust) if ca is not None else ()
    if any(root.key == certificate.key for root in roots):
        return True
    if trust.pins_signer or not (fit_to_sign(certificate) or is_authority(certificate)):
        return False
    pending, seen = [certificate], {certificate.sha256}
    while pending:
        below = pending.pop()
        above = [each for each in authorities if may_have_issued(each, below) and each.sha256 not in seen]
        seen.update(each.sha256 for each in above)
        pending.extend(above)
    return any(root.sha256 in seen for root in roots)


def _permissions_cas(peers: Iterable[_Peer]) -> Iterator[Location]:
    """The places of the authorities by which these peers accept self-signed permissions."""
    for peer in peers:
        if peer.enclave.permissions_ca is not None:
            yield Location(path=peer.enclave.permissions_ca.file.place, line=1)


def _granted(
    keystore: Keystore, certificates: Sequence[Certificate], profiles: Sequence[Profile], at: datetime
) -> dict[int, list[Location]]:
    """By certificate, the grants that have not ended and name it, in documents that some peer may take."""
    files = permissions_cas(keystore)
    grants = [
        (grant, Location(path=file.signed.file.place, line=grant.line))
        for document in documents_of(keystore)
        if isinstance(file := document.file, PermissionsFile) and may_be_taken(file.signed, files)
        for read in file.readings.distinct
        for grant in read.grants
        if not _ended(grant, at)
    ]
    named = named_by_some((grant.subject_name.text for grant, _place in grants), certificates, profiles)
    return gathered((number, place) for grant, place in grants for number in named[grant.subject_name.text])


def _ended(grant: Grant, at: datetime) -> bool:
    """Whether every implementation takes it for expired, wherever the robot is."""
    dated = read_date(grant.not_after.text, DateReading.XSD, None)
    return dated is not None and at - dated.instant > ANY_ZONE


def _without_grants(peers: Iterable[_Peer]) -> Iterator[Location]:
    """Governances under which these peers let in everybody whom they authenticate."""
    for peer in peers:
        file = None if peer.wants_grant else peer.enclave.governance
        if file is not None:
            yield from (
                Location(path=file.signed.file.place, line=rule.line)
                for read in file.readings.distinct
                for rule in read.domain_rules
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
