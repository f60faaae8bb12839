"""Which revocation lists count for an identity, and what they take back (RFC 5280, 6.3.3; crypto/x509/x509_vfy.c)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.crl import RevocationList, crl_signed_by
from keystore_audit.keystore.distinguished_name import same_name
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.profiles import RevocationLists, Trust
from keystore_audit.model.trust import authorities_read, may_have_issued

NO_IDENTITIES: Final = frozenset(
    {"onlyContainsCACerts", "onlyContainsAttributeCerts", "onlySomeReasons", "indirectCRL"}
)
"""Scopes that hold no identity, or that OpenSSL leaves aside without X509_V_FLAG_EXTENDED_CRL_SUPPORT."""


def lists_read(enclave: Enclave, trust: Trust) -> tuple[RevocationList, ...]:
    """The revocation lists that an implementation reads: the first of `crl.pem`, perhaps those in the CA file."""
    if trust.revocation is RevocationLists.NONE:
        return ()
    lists = enclave.crl.revocation_lists[:1] if enclave.crl else ()
    if trust.revocation is RevocationLists.CRL_AND_CA_FILE and enclave.identity_ca is not None:
        lists += enclave.identity_ca.revocation_lists
    return lists


def revoked(enclave: Enclave, certificates: Iterable[Certificate], trust: Trust) -> tuple[Certificate, ...]:
    """Those of the certificates that are revoked under an identity CA of the enclave.

    A list that no identity CA signed revokes nothing here: what it does at run time is a finding of its own, and
    leaving an identity in is the careful reading.
    """
    authorities = authorities_read(enclave.identity_ca, trust) if enclave.identity_ca else ()
    lists = [
        revocations
        for revocations in lists_read(enclave, trust)
        if revocations.revoked and any(crl_signed_by(revocations, authority) for authority in authorities)
    ]
    return tuple(c for c in (certificates if lists else ()) if any(names_revoked(each, c) for each in lists))


def names_revoked(revocations: RevocationList, certificate: Certificate) -> bool:
    """Whether the list has the certificate's issuer, by meaning, and its serial number."""
    return certificate.serial in revocations.revoked and same_name(revocations.issuer_name, certificate.issuer_name)


def list_missing(enclave: Enclave, certificate: Certificate, trust: Trust) -> bool:
    """Whether lists are read and none of them can be used for the identity, so that it is refused.

    One that can be used names the identity's issuer, is signed by that issuer, whose keyUsage allows it, and holds
    identities of every kind.
    """
    lists = lists_read(enclave, trust)
    issuers = [
        authority
        for authority in (authorities_read(enclave.identity_ca, trust) if enclave.identity_ca else ())
        if may_have_issued(authority, certificate)
    ]
    return bool(lists) and not any(
        usable_for(revocations, certificate, issuer) for revocations in lists for issuer in issuers
    )


def usable_for(revocations: RevocationList, certificate: Certificate, issuer: Certificate) -> bool:
    """Whether a list can be used for a certificate of this issuer; a signature that cannot be checked counts."""
    other_kind = "onlyContainsUserCerts" if certificate.is_ca else "onlyContainsCACerts"
    return (
        same_name(revocations.issuer_name, issuer.subject_name)
        and crl_signed_by(revocations, issuer) is not False
        and (issuer.key_usage is None or "cRLSign" in issuer.key_usage)
        and not revocations.scope & (NO_IDENTITIES - {"onlyContainsCACerts"} | {other_kind})
    )
