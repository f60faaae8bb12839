"""Why a certificate does not chain to an identity CA: no authority vouches for it, or OpenSSL finds no way to one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import same_name
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.issuer import Issue, fit_to_sign, key_identifier_fits, lets_sign, names_itself, suits_key
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.trust.verdicts import (
    MAX_AUTHORITIES,
    authorities_read,
    certificate_alike,
    chaining,
    document_alike,
    is_authority,
    is_first_embedded,
    is_issued,
    issue,
    issuers_taken,
    may_have_issued,
    may_sign,
    not_read,
    signers_taken,
    stands_alone,
)
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Trust

# Which authorities are trusted: those that somebody declared, else the ones that are found in their standard places.
#
# Two certificates of one key are one authority, as where it was renewed. A certificate in a file of any other name is
# never one, whatever it says of itself.


ROLES: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)


class Authorities(Struct, frozen=True, kw_only=True):
    """What somebody declared, by role: SHA-256, in hexadecimal, of certificates or of their keys; empty: nothing."""

    identity: frozenset[str] = frozenset()
    permissions: frozenset[str] = frozenset()

    def of(self, role: Role) -> frozenset[str]:
        """The fingerprints for a role."""
        return self.identity if role is Role.IDENTITY_CA else self.permissions

    @property
    def complete(self) -> bool:
        """Whether the trusted authorities are declared for both roles."""
        return all(map(self.of, ROLES))


class Anchors(Struct, frozen=True, kw_only=True):
    """The authorities that are trusted in a role: those declared that are here, by place, or the one found.

    `found_in`: the file that it was taken from; empty where they were declared, or where none can be determined.
    """

    role: Role
    declared: frozenset[str]
    certificates: tuple[Certificate, ...]
    found_in: str = ""

    def trusts(self, certificate: Certificate) -> bool:
        """Whether the certificate belongs to one of them."""
        if self.declared:
            return not self.declared.isdisjoint((certificate.sha256, certificate.key))
        return any(certificate.key == each.key for each in self.certificates)

    def foreign(self, file: CertificateFile) -> tuple[str, ...]:
        """The certificates of others in a file, by their SHA-256."""
        return tuple(each.sha256 for each in file.certificates if not self.trusts(each))


def authority_files(
    keystore: Keystore, role: Role
) -> tuple[CertificateFile | None, tuple[tuple[CertificateFile, tuple[Enclave, ...]], ...]]:
    """The standard file of `public/`, which new enclaves link to, and each file that enclaves read, with these."""
    read: dict[str, tuple[CertificateFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        file = enclave.identity_ca if role is Role.IDENTITY_CA else enclave.permissions_ca
        if file is not None:
            read.setdefault(file.file.place, (file, []))[1].append(enclave)
    name = f"public/{role.value}.pem"  # by its name as linked: sros2's leads to public/ca.cert.pem
    places = {each.place for each in keystore.layout.authorities if each.path == name and each.status is Status.PRESENT}
    public = next((file for file in keystore.authorities if file.file.place in places), None)
    return public, tuple((file, tuple(enclaves)) for file, enclaves in read.values())


@lru_cache(maxsize=2)
def trusted(keystore: Keystore, authorities: Authorities) -> tuple[Anchors, ...]:
    """Who is trusted in this keystore, in each role."""
    return tuple(_anchors(keystore, role, authorities) for role in ROLES)


def _anchors(keystore: Keystore, role: Role, authorities: Authorities) -> Anchors:
    public, read = authority_files(keystore, role)
    files = [*([public] if public else ()), *(file for file, _enclaves in read)]
    declared = authorities.of(role)
    if declared:
        wanted = Anchors(role=role, declared=declared, certificates=())
        here = {c.sha256: c for file in files for c in file.certificates if wanted.trusts(c)}
        ordered = sorted(here.values(), key=lambda each: (each.path, each.line))
        return Anchors(role=role, declared=declared, certificates=tuple(ordered))
    first = _as_found(public, [file for file in files if file.certificates])
    return Anchors(
        role=role,
        declared=declared,
        certificates=(first.certificates[0],) if first else (),
        found_in=first.file.place if first else "",
    )


def _as_found(public: CertificateFile | None, files: Sequence[CertificateFile]) -> CertificateFile | None:
    """The file whose first certificate is taken for the authority; without one in `public/` all have to be alike."""
    if public is not None and public.certificates:
        return public
    keys = {frozenset(each.key for each in file.certificates) for file in files}
    return files[0] if len(keys) == 1 else None


def chain_refusal(
    certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime | None = None
) -> str | None:
    """Why the certificate does not chain to an identity CA of the file; None where it does.

    `at` None: why it never does. Otherwise of the certificates in force then; that none is, is no reason here.

    At each step OpenSSL takes the first certificate with the issuer's name and key identifier, and tries no other
    (X509_STORE_CTX_get1_issuer; measured with 3.0.19). All authorities of sros2 have one name.
    """
    return _chain_refusal(
        certificate_alike(certificate, file), file, chaining(trust, file), at if len(file.certificates) > 1 else None
    )


@lru_cache(maxsize=65_536)
def _chain_refusal(certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime | None) -> str | None:
    place = file.file.place
    if not is_issued(file, certificate, trust):
        issuers = [authority for authority in file.certificates if may_have_issued(authority, certificate)]
        if not issuers:
            return f"no certificate in {place} has the key that signed it"
        if not any(is_authority(authority) for authority in issuers):
            return f"the certificate in {place} that signed it is no authority"
        if not any(authority in authorities_read(file, trust) for authority in issuers):
            return not_read(place, trust)
        return f"no chain in {place} ends at a self-signed certificate within its path lengths"
    return _path_refusal(certificate, file, trust, at) if trust.needs_root else None


def _path_refusal(certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime | None) -> str | None:
    """Why no path that OpenSSL builds holds `at` the instant, or at any; None where one does."""
    place, authorities = file.file.place, authorities_read(file, trust)
    if names_itself(certificate) and not _is_found(certificate, authorities, at):
        return f"the first certificate in {place} of its own name is another; no other is tried"
    if stands_alone(certificate, authorities):
        return None
    dated = at is not None and is_issued(file, certificate, trust, at)  # else that none is in force is why

    def wrong(above: Certificate, below: Certificate, between: int) -> str | None:
        refusal = _step_refusal(above, below, between, signed=trust.checks_root_signature)
        if refusal is None and dated and at is not None and not in_force(above, at):
            refusal = _OVER
        return refusal and f"the first certificate in {place} of the issuer's name {refusal}"

    nobody = f"no certificate in {place} has the issuer's name and key identifier"
    refusals = _dead_ends(certificate, authorities, (), at, wrong, nobody)
    return None if refusals is None else next(iter(refusals), f"no path over {place} has an end")


_OVER: Final = "is outside its validity; no other is tried"


def _dead_ends(
    start: Certificate,
    read: Sequence[Certificate],
    embedded: Sequence[Certificate],
    at: datetime | None,
    wrong: Callable[[Certificate, Certificate, int], str | None],
    nobody: str = "",
) -> list[str] | None:
    """Why no path that OpenSSL takes arrives at a self-signed certificate of the file; None where one does. Paths lead
    over certificates of the CA file (`read`) before those of the message.

    `wrong`: what is wrong with the issuer of a certificate that has so many authorities below it that are not
    self-issued. `nobody`: what is said where there is none.
    """
    refusals: list[str] = []
    # A certificate, whether it is of the CA file, and the number of authorities below it; each is looked at once.
    pending = [(start, False, 0)]
    seen = {*pending}
    while pending:
        below, trusted, between = pending.pop()
        found = issuers_taken(below, read, at)
        # Above one of the CA file the message is not looked at any more.
        taken = found if found or trusted else issuers_taken(below, embedded, at)
        if nobody and not taken:
            refusals.append(nobody)
        for above in taken:
            refusal, root = wrong(above, below, between), names_itself(above)
            step = (above, bool(found), between + (above.subject_der != above.issuer_der))
            if refusal is not None:
                refusals.append(refusal)
            elif root and found:
                return None
            elif not root and step not in seen and step[2] < MAX_AUTHORITIES:
                seen.add(step)
                pending.append(step)
    return refusals


def _step_refusal(above: Certificate, below: Certificate, between: int, *, signed: bool = False) -> str | None:
    """What is wrong with a certificate that OpenSSL takes for the issuer of another; no other one is tried."""
    root = names_itself(above)
    if issue(above, below) is Issue.SIGNATURE_INVALID:
        return "is another authority's; no other is tried"
    if not is_authority(above) or not (root or above.is_ca):
        return "is no authority; no other is tried"
    if above.path_length is not None and between > above.path_length:
        return "allows no path of this length"
    return "did not sign itself" if root and signed and not may_have_issued(above, above) else None


def _is_found(root: Certificate, read: Sequence[Certificate], at: datetime | None) -> bool:
    """Whether a self-signed certificate that is shown is the one of the CA file that OpenSSL finds in its place.

    `at` None: whenever that is in force.
    """
    first, last = (root.not_before, root.not_after) if at is None else (at, at)
    found = (
        each.sha256
        for each in read
        if each.sha256 == root.sha256
        or (
            same_name(each.subject_name, root.issuer_name)
            and suits_key(root, each)
            and each.not_before <= first
            and last <= each.not_after
            and key_identifier_fits(root, each)
        )
    )
    return next(found, None) == root.sha256


# Why the signer of a document is refused: it may not sign, or OpenSSL finds no way from it to a root.


def signer_refusal(signed: SignedDocument, permissions_ca: CertificateFile, trust: Trust) -> str | None:
    """Why a document whose signatures hold is refused for its signer; None where it is taken."""
    place = permissions_ca.file.place
    for signer in signers_taken(signed, trust):
        if may_sign(signer, signed, permissions_ca, trust):
            continue
        if not any(signer.sha256 == authority.sha256 for authority in permissions_ca.certificates):
            return f"the signer is not in {place}"
        if trust.pins_signer and any(signer.sha256 == each.sha256 for each in authorities_read(permissions_ca, trust)):
            return f"another certificate of its issuer and serial number stands before the signer's in {place}"
        if trust.pins_signer:
            return not_read(place, trust)
        if not is_first_embedded(signer, signed):
            return "the message does not hold the signer's certificate"
        if not fit_to_sign(signer) or signer.unknown_critical:
            return "the key usage of the signer's certificate does not admit S/MIME signing"
        return f"no chain ends at a self-signed certificate that is read in {place}"
    return None


def path_refusal(
    signed: SignedDocument, permissions_ca: CertificateFile, trust: Trust, at: datetime | None = None
) -> str | None:
    """Why no path is found `at` the instant, or at any, for a signer that `may_sign`; None where one is.

    At each step PKCS7_verify takes the first fitting certificate of the issuer's name, of the CA file before those of
    the message. It tries no other (build_chain in x509_vfy.c; measured on Fast DDS 2.9.1). So of two permissions CAs of
    one name, as sros2 makes all, it refuses what the second signs. Only who starts rests on this: what a peer may
    present is asked of `may_sign`, which looks at every path.
    """
    several = len(permissions_ca.certificates) > 1 or len(signed.embedded) > 1
    when = at if several else None
    return None if trust.pins_signer else _signer_refusal(document_alike(signed), permissions_ca, trust, when)


@lru_cache(maxsize=16_384)
def _signer_refusal(
    signed: SignedDocument, permissions_ca: CertificateFile, trust: Trust, at: datetime | None
) -> str | None:
    place, read = permissions_ca.file.place, authorities_read(permissions_ca, trust)
    for signer in signers_taken(signed, trust):
        if at is not None and not names_itself(signer) and not may_sign(signer, signed, permissions_ca, trust, at):
            continue  # no path at all is in force, which is a reason by itself
        lost = _lost(signer, place, read, signed.embedded, at)
        if lost is not None:
            return lost
    return None


def _lost(
    signer: Certificate,
    place: str,
    read: Sequence[Certificate],
    embedded: Sequence[Certificate],
    at: datetime | None,
) -> str | None:
    """Why no path from the signer arrives at a self-signed certificate of the CA file; None where one does."""
    if names_itself(signer):
        lost = not _is_found(signer, read, at)
        return f"of {place} the first certificate of the signer's name is another" if lost else None

    def wrong(above: Certificate, below: Certificate, between: int) -> str | None:
        refusal = _step_refusal(above, below, between)
        if refusal is None and not lets_sign(above):
            return "does not admit S/MIME signing; no other is tried"
        return _OVER if refusal is None and at is not None and not in_force(above, at) else refusal

    refusals = _dead_ends(signer, read, embedded, at, wrong)
    if refusals is None:
        return None
    first = f"the first certificate of the issuer's name, of {place} before those of the message,"
    return f"{first} {refusals[0]}" if refusals else f"no path over {place} and the message has an end"
