"""Why the signer of a document is refused: it may not sign, or OpenSSL finds no way from it to a root."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.issuer import fit_to_sign, lets_sign, names_itself
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.trust.chain import is_found, step_refusal
from keystore_audit.model.trust.verdicts import (
    MAX_AUTHORITIES,
    authorities_read,
    document_alike,
    is_first_embedded,
    issuers_taken,
    may_sign,
    not_read,
    signers_taken,
)
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Trust


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
        lost = not is_found(signer, read, at)
        return f"of {place} the first certificate of the signer's name is another" if lost else None
    refusals: list[str] = []
    # A certificate, whether it is of the CA file, and the number of authorities below it that are not self-issued.
    pending = [(signer, False, 0)]
    seen = {*pending}
    while pending:
        below, trusted, between = pending.pop()
        found = issuers_taken(below, read, at)
        # Above one of the CA file the message is not looked at any more.
        for above in found if found or trusted else issuers_taken(below, embedded, at):
            root = names_itself(above)
            refusal = step_refusal(above, below, between, root=root)
            if refusal is None and not lets_sign(above):
                refusal = "does not admit S/MIME signing; no other is tried"
            if refusal is None and at is not None and not in_force(above, at):
                refusal = "is outside its validity; no other is tried"
            step = (above, bool(found), between + (above.subject_der != above.issuer_der))
            if refusal is not None:
                refusals.append(refusal)
            elif root and found:
                return None
            elif not root and step not in seen and step[2] < MAX_AUTHORITIES:
                seen.add(step)
                pending.append(step)
    first = f"the first certificate of the issuer's name, of {place} before those of the message,"
    return f"{first} {refusals[0]}" if refusals else f"no path over {place} and the message has an end"
