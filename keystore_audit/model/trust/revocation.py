"""Which revocation lists count for an identity, and what they revoke (RFC 5280, 6.3.3; crypto/x509/x509_vfy.c)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import Final

from cryptography import x509

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.crl import RevocationList, same_name
from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.issuer import crl_signed_by, key_identifier_fits
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.verdicts import authorities_read, issuers_taken, may_have_issued
from keystore_audit.model.validity import LAST
from keystore_audit.profiles import RevocationLists, Trust

NO_IDENTITIES: Final = frozenset(
    {"onlyContainsCACerts", "onlyContainsAttributeCerts", "onlySomeReasons", "indirectCRL"}
)
"""Scopes that hold no identity, or that OpenSSL leaves aside without X509_V_FLAG_EXTENDED_CRL_SUPPORT."""


def lists_carried(enclave: Enclave) -> tuple[RevocationList, ...]:
    """Every revocation list in its files, whether or not it is read."""
    files = (enclave.crl, enclave.identity_ca)
    return tuple(each for file in files if file is not None for each in file.revocation_lists)


def list_unread(enclave: Enclave, trust: Trust) -> tuple[str, str] | None:
    """Where and why `crl.pem`, which the implementation reads, is unknown here: it may then revoke anybody, or nobody.

    Lists in the CA file no longer count then: another may come before them.
    """
    if trust.revocation is RevocationLists.NONE:
        return None
    file = enclave.files.files[Role.CRL]
    if file.status.unknown:
        return file.path, f"crl.pem could not be read: {file.detail}"
    if enclave.crl is None:  # nearly always
        return None
    defect = first_opaque(enclave.crl.defects)
    return None if defect is None else (defect.path, defect.detail)


def lists_read(enclave: Enclave, trust: Trust) -> tuple[RevocationList, ...]:
    """The revocation lists that an implementation reads: perhaps those in the CA file, then the first of `crl.pem`.

    None where one of them is unknown (`list_unread`).
    """
    if trust.revocation is RevocationLists.NONE or list_unread(enclave, trust) is not None:
        return ()
    lists = enclave.crl.revocation_lists[:1] if enclave.crl else ()
    if trust.revocation is RevocationLists.CRL_AND_CA_FILE and enclave.identity_ca is not None:
        lists = enclave.identity_ca.revocation_lists + lists
    return lists


def identity_authorities(enclave: Enclave, trust: Trust) -> tuple[Certificate, ...]:
    """The certificates of its identity CA file that count."""
    return authorities_read(enclave.identity_ca, trust) if enclave.identity_ca else ()


def list_dates(enclave: Enclave, trust: Trust, at: datetime) -> tuple[datetime, ...]:
    """The instants from `at` on around which another one of several lists counts, or none of them.

    Also dates of several authorities: another one may then be taken for a list's issuer (`issuers_taken`).
    """
    if len(lists_read(enclave, trust)) < 2:
        return ()
    authorities = identity_authorities(enclave, trust)
    dates = {date for each in authorities[1:] and authorities for date in (each.not_before, each.not_after)}
    return tuple(sorted({*ends_of_lists(enclave, trust, at), *(date for date in dates if at <= date <= LAST)}))


def ends_of_lists(enclave: Enclave, trust: Trust, at: datetime) -> tuple[datetime, ...]:
    """The instants from `at` on at which a list begins or ends."""
    lists = lists_read(enclave, trust)
    dates = {date for each in lists for date in (each.this_update, each.next_update) if date is not None}
    return tuple(sorted(date for date in dates if at <= date <= LAST))


def revoked(
    enclave: Enclave, certificates: Iterable[Certificate], trust: Trust, at: datetime
) -> tuple[Certificate, ...]:
    """Those of the certificates that are revoked under an identity CA of the enclave `at` an instant (aware UTC).

    A list that no identity CA signed revokes nothing here. Its run-time effect has a finding of its own, and to leave
    an identity in is the careful reading.
    """
    lists = [each for each in lists_read(enclave, trust) if each.revoked]
    authorities = identity_authorities(enclave, trust)
    if not lists or not authorities:
        return ()
    named = [certificate for certificate in certificates if any(names_revoked(each, certificate) for each in lists)]
    used = [(certificate, list_used(enclave, certificate, trust, at)) for certificate in named]
    return tuple(
        certificate
        for certificate, each in used
        if each is not None
        and names_revoked(each, certificate)
        and any(crl_signed_by(each, authority).must for authority in authorities)
    )


def _lists_about(
    enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime | None
) -> Iterator[tuple[RevocationList, bool]]:
    """The lists in which OpenSSL may look the identity up `at` the instant, or ever, and whether each can be used. A
    signature that cannot be checked counts as usable.

    A usable list names the identity's issuer and holds identities of every kind. The certificate that OpenSSL takes for
    the list's issuer, by that name, signed it, and its keyUsage allows that.
    """
    lists = lists_read(enclave, trust)
    authorities = identity_authorities(enclave, trust) if lists else ()
    for each in lists:
        signers = [*_signers(each, certificate, authorities, trust, at)] if _is_about(each, certificate) else ()
        if signers:
            yield each, any(crl_signed_by(each, signer).may and _lets_sign_lists(each, signer) for signer in signers)


def list_used(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> RevocationList | None:
    """Of the lists that can be used for the identity, the one that OpenSSL looks it up in.

    One in force `at` the instant goes before others, then the newest, then the first (`get_crl_score` in x509_vfy.c;
    measured on Fast DDS 2.9.1).
    """
    return _chosen((each for each, usable in _lists_about(enclave, certificate, trust, at) if usable), at)


def list_broken(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> bool:
    """Whether the list that OpenSSL looks the identity up in is one that it then refuses, beside others that would do.

    It chooses before it asks for signature and keyUsage (get_crl_score and check_crl in x509_vfy.c; measured).
    """
    found = [*_lists_about(enclave, certificate, trust, at)]
    chosen = _chosen((each for each, _usable in found), at)
    return any(each is chosen and not usable for each, usable in found)


def list_looked_up(authority: Certificate, lists: Iterable[RevocationList], at: datetime) -> RevocationList | None:
    """Of `lists`, the one in which OpenSSL looks up an identity that the authority itself issued, whichever it is."""
    usable = (
        each
        for each in lists
        if same_name(each.issuer_name, authority.subject_name)
        and not each.scope & NO_IDENTITIES
        and key_identifier_fits(each, authority)
        and not each.unknown_critical
        and _lets_sign_lists(each, authority)
        and crl_signed_by(each, authority).may
    )
    return _chosen(usable, at)


def _chosen(lists: Iterable[RevocationList], at: datetime) -> RevocationList | None:
    """One in force goes before others, then the newest, then the first."""
    return max(lists, key=lambda each: (list_in_force(each, at), each.this_update), default=None)


def list_in_force(revocations: RevocationList, at: datetime) -> bool:
    """Whether the instant is between thisUpdate and nextUpdate."""
    return revocations.this_update <= at and (revocations.next_update is None or at <= revocations.next_update)


def names_revoked(revocations: RevocationList, certificate: Certificate) -> bool:
    """Whether the list has the certificate's issuer, by meaning, and its serial number."""
    return certificate.serial in revocations.revoked and same_name(revocations.issuer_name, certificate.issuer_name)


def list_missing(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime | None = None) -> bool:
    """Whether lists are read and none of them can be used for the identity `at` the instant, or ever: it is refused."""
    if not lists_read(enclave, trust):  # nearly always
        return False
    return not any(usable for _each, usable in _lists_about(enclave, certificate, trust, at))


def _is_about(revocations: RevocationList, certificate: Certificate) -> bool:
    """Whether the list is one of the certificate's issuer, for certificates like it, that OpenSSL can process."""
    if revocations.unknown_critical or not _in_scope(revocations, certificate):
        return False
    return same_name(revocations.issuer_name, certificate.issuer_name)


def _in_scope(revocations: RevocationList, certificate: Certificate) -> bool:
    """Whether the list is about certificates like this one (crl_crldp_check in x509_vfy.c).

    Whether it is one of the lists that a certificate itself points to is not worked out.
    """
    other = {"onlyContainsUserCerts" if certificate.is_ca else "onlyContainsCACerts"}
    if not any(isinstance(extension.value, x509.CRLDistributionPoints) for extension in certificate.parsed.extensions):
        other.add("distributionPoint")
    return not revocations.scope & (NO_IDENTITIES - {"onlyContainsCACerts"} | other)


def _lets_sign_lists(revocations: RevocationList, signer: Certificate) -> bool:
    """Whether the keyUsage admits signing the list; of a delta OpenSSL does not ask that (check_crl; measured)."""
    return revocations.delta or signer.key_usage is None or "cRLSign" in signer.key_usage


def _signers(
    revocations: RevocationList,
    certificate: Certificate,
    authorities: Sequence[Certificate],
    trust: Trust,
    at: datetime | None,
) -> Iterator[Certificate]:
    """The certificates that may be taken for the list's issuer (crl_akid_check in x509_vfy.c).

    It is the first on the way from the identity to its root that has the list's issuer as subject and fits its
    authorityKeyIdentifier. What others signed is of no use, even with the same name.
    """
    pending, seen = [certificate], {certificate}
    while pending:
        below = pending.pop()
        for above in (
            issuers_taken(below, authorities, at)
            if trust.needs_root
            else [each for each in authorities if may_have_issued(each, below)]
        ):
            if same_name(above.subject_name, revocations.issuer_name) and key_identifier_fits(revocations, above):
                yield above
            elif above not in seen:
                seen.add(above)
                pending.append(above)
