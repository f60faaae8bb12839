"""Why a certificate does not chain to an identity CA: no authority vouches for it, or OpenSSL finds no way to one."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.distinguished_name import same_name
from keystore_audit.keystore.issuer import Issue, key_identifier_fits, names_itself, suits_key
from keystore_audit.model.trust.verdicts import (
    MAX_AUTHORITIES,
    authorities_read,
    certificate_alike,
    chaining,
    is_authority,
    is_issued,
    issue,
    issuers_taken,
    may_have_issued,
    not_read,
    stands_alone,
)
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Trust


def chain_refusal(
    certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime | None = None
) -> str | None:
    """Why the certificate does not chain to an identity CA of the file; None where it does.

    `at` None: why it never does. Otherwise of the certificates in force then; that none is, is no reason here.

    OpenSSL takes, at each step, the first certificate with the issuer's name and key identifier for the issuer, and
    tries no other one (X509_STORE_CTX_get1_issuer; measured with 3.0.19): all authorities of sros2 have one name.
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
    if names_itself(certificate) and not is_found(certificate, authorities, at):
        return f"the first certificate in {place} of its own name is another; no other is tried"
    if stands_alone(certificate, authorities):
        return None
    dated = at is not None and is_issued(file, certificate, trust, at)  # else that none is in force is why
    refusals: list[str] = []
    # A certificate with the number of authorities below it that are not self-issued; each pair is looked at once.
    pending = [(certificate, 0)]
    seen = {*pending}
    while pending:
        below, between = pending.pop()
        taken = issuers_taken(below, authorities, at)
        if not taken:
            refusals.append(f"no certificate in {place} has the issuer's name and key identifier")
        for above in taken:
            root = names_itself(above)
            refusal = step_refusal(above, below, between, root=root, signed=trust.checks_root_signature)
            if refusal is None and dated and at is not None and not in_force(above, at):
                refusal = "is outside its validity; no other is tried"
            if refusal is not None:
                refusals.append(f"the first certificate in {place} of the issuer's name {refusal}")
            elif root:
                return None
            else:
                step = (above, between + (above.subject_der != above.issuer_der))
                if step not in seen and step[1] < MAX_AUTHORITIES:
                    seen.add(step)
                    pending.append(step)
    return refusals[0] if refusals else f"no path over {place} has an end"


def step_refusal(
    above: Certificate, below: Certificate, between: int, *, root: bool, signed: bool = False
) -> str | None:
    """What is wrong with a certificate that OpenSSL takes for the issuer of another; no other one is tried."""
    if issue(above, below) is Issue.SIGNATURE_INVALID:
        return "is another authority's; no other is tried"
    if not is_authority(above) or not (root or above.is_ca):
        return "is no authority; no other is tried"
    if above.path_length is not None and between > above.path_length:
        return "allows no path of this length"
    return "did not sign itself" if root and signed and not may_have_issued(above, above) else None


def is_found(root: Certificate, read: Sequence[Certificate], at: datetime | None) -> bool:
    """Whether a self-signed certificate that is shown is the one of the CA file that OpenSSL finds in its place."""
    taken = next((each for each in read if each.sha256 == root.sha256 or _hides(each, root, at)), None)
    return taken is not None and taken.sha256 == root.sha256


def _hides(other: Certificate, root: Certificate, at: datetime | None) -> bool:
    """Whether OpenSSL takes the other for the issuer of the root, `at` None: whenever that is in force."""
    first, last = (root.not_before, root.not_after) if at is None else (at, at)
    return (
        same_name(other.subject_name, root.issuer_name)
        and suits_key(root, other)
        and other.not_before <= first
        and last <= other.not_after
        and key_identifier_fits(root, other)
    )
