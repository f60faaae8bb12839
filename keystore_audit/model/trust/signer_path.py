"""Why the signer of a document is refused: it may not sign, or OpenSSL finds no way from it to a root."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.distinguished_name import same_name
from keystore_audit.keystore.issuer import fit_to_sign, key_identifier_fits, lets_sign, names_itself, suits_key
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.profiles import Trust
from keystore_audit.model.trust.verdicts import (
    authorities_read,
    document_alike,
    is_authority,
    is_first_embedded,
    issuers_taken,
    may_have_issued,
    may_sign,
    not_read,
    signers_taken,
)


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

    PKCS7_verify takes at each step the first certificate of the issuer's name that fits, of the CA file before those of
    the message, and tries no other one (build_chain in x509_vfy.c; measured on Fast DDS 2.9.1): of two permissions CAs
    of one name, as sros2 names all, what the second signs is refused. Only who starts rests on this: what a peer may
    present is asked of `may_sign`, which looks at every path.
    """
    several = len(permissions_ca.certificates) > 1 or len(signed.embedded) > 1
    when = at if several else None
    return None if trust.pins_signer else _path_refusal(document_alike(signed), permissions_ca, trust, when)


@lru_cache(maxsize=16_384)
def _path_refusal(
    signed: SignedDocument, permissions_ca: CertificateFile, trust: Trust, at: datetime | None
) -> str | None:
    read = authorities_read(permissions_ca, trust)
    if all(_arrives(signer, read, signed.embedded, at) for signer in signers_taken(signed, trust)):
        return None
    return f"of {permissions_ca.file.place} the first certificate of the signer's or issuer's name is another"


def _arrives(
    signer: Certificate, read: Sequence[Certificate], embedded: Sequence[Certificate], at: datetime | None
) -> bool:
    pending, seen = [(signer, False)], {signer}
    while pending:
        below, trusted = pending.pop()
        if names_itself(below):
            if trusted or _is_found(below, read, at):
                return True
            continue
        # Above one of the CA file the message is not looked at any more.
        found = issuers_taken(below, read, at)
        taken = found if found or trusted else issuers_taken(below, embedded, at)
        for above in taken:
            if above not in seen and may_have_issued(above, below) and is_authority(above) and lets_sign(above):
                seen.add(above)
                pending.append((above, bool(found)))
    return False


def _is_found(root: Certificate, read: Sequence[Certificate], at: datetime | None) -> bool:
    """Whether a self-signed certificate of the message is the one of the CA file that OpenSSL finds in its place."""
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
