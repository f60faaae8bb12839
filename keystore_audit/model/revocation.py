"""Whose certificates an enclave's revocation list takes back (RFC 5280, 6.3.3)."""

from __future__ import annotations

from keystore_audit.keystore.crl import RevocationList, crl_signed_by
from keystore_audit.keystore.keystore import Enclave


def revoked_serials(enclave: Enclave) -> frozenset[tuple[bytes, int]]:
    """(issuer, serial number) of the certificates that `crl.pem` revokes under an identity CA of the enclave.

    Of a file with several lists the first counts: run times read no other. A list that no identity CA signed revokes
    nothing here: what it does at run time is a finding of its own, and leaving an identity in is the careful reading.
    """
    lists: tuple[RevocationList, ...] = enclave.crl.revocation_lists[:1] if enclave.crl else ()
    authorities = enclave.identity_ca.certificates if enclave.identity_ca else ()
    return frozenset(
        (revocations.issuer_der, serial)
        for revocations in lists
        if any(crl_signed_by(revocations, authority) for authority in authorities)
        for serial in revocations.revoked
    )
