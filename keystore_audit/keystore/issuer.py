"""Whether one certificate issued another, and what OpenSSL admits a certificate for (crypto/x509/v3_purp.c)."""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import Final

from cryptography import x509

from keystore_audit.keystore import public_key
from keystore_audit.keystore.certificate import Certificate, is_netscape_type
from keystore_audit.keystore.crl import RevocationList, extension_of, same_name
from keystore_audit.truth import Truth

_EMAIL_PROTECTION: Final = "1.3.6.1.5.5.7.3.4"  # id-kp-emailProtection, RFC 5280, 4.2.1.12
_NETSCAPE_SMIME_OR_CLIENT: Final = 0x20 | 0x80  # SSL client too: "workaround for some buggy certificates" (v3_purp.c)
_NETSCAPE_AUTHORITY: Final = 0x01 | 0x02 | 0x04  # of objects, S/MIME and SSL


class Issue(str, Enum):
    """Whether one certificate issued another, as OpenSSL's X509_check_issued and X509_verify judge.

    Not dates, not CA:TRUE. UNSUPPORTED: the library cannot check such a signature, so a robot may accept it.
    """

    ISSUED = "issued"
    NAME_DIFFERS = "name-differs"
    KEY_IDENTIFIER_DIFFERS = "key-identifier-differs"
    SIGNATURE_INVALID = "signature-invalid"
    UNSUPPORTED = "unsupported"


@lru_cache(maxsize=65_536)
def _verified(issuer: x509.Certificate, certificate: x509.Certificate) -> Truth:
    """Whether the issuer's key made the signature: asked once, however many copies of the two lie in enclaves."""
    return public_key.verifies(issuer, certificate.tbs_certificate_bytes, certificate)


def issued_by(certificate: Certificate, issuer: Certificate) -> Issue:
    """Whether `issuer` issued `certificate`: names, key identifiers and the signature, weak digests included."""
    if not _is_named_by(issuer, certificate):
        return Issue.NAME_DIFFERS
    if not certificate.algorithms_agree:  # X509_verify compares both statements of the algorithm first
        return Issue.SIGNATURE_INVALID
    verified = _verified(issuer.parsed, certificate.parsed)
    if verified is Truth.NO:
        return Issue.SIGNATURE_INVALID
    if not key_identifier_fits(certificate, issuer):
        return Issue.KEY_IDENTIFIER_DIFFERS
    return Issue.ISSUED if verified.must else Issue.UNSUPPORTED


def fit_to_sign(certificate: Certificate) -> bool:
    """Whether OpenSSL's purpose X509_PURPOSE_SMIME_SIGN admits the certificate (crypto/x509/v3_purp.c).

    Extended key usage: absent or with emailProtection (anyExtendedKeyUsage is refused, measured). keyUsage: absent or
    with digitalSignature or nonRepudiation. Netscape certificate type: absent, S/MIME or SSL client. PKCS7_verify asks
    for it in the implementations that do not pin the signer (CVE-2023-24010).
    """
    usage, netscape = certificate.key_usage, _netscape_type(certificate.parsed)
    return (
        lets_sign(certificate)
        and (usage is None or bool(usage & {"digitalSignature", "nonRepudiation"}))
        and (netscape is None or bool(netscape & _NETSCAPE_SMIME_OR_CLIENT))
    )


def lets_sign(certificate: Certificate) -> bool:
    """Whether the extended key usage admits signing S/MIME; that of an authority binds those below it too."""
    return certificate.extended_key_usage is None or _EMAIL_PROTECTION in certificate.extended_key_usage


def may_issue(certificate: Certificate) -> bool:
    """Whether OpenSSL's X509_check_ca admits it as an issuer (crypto/x509/v3_purp.c).

    keyUsage: absent or with keyCertSign. basicConstraints: CA:TRUE. Without them it must look like an old authority:
    self-signed of version 1, with keyUsage, or with a Netscape type of an authority.
    """
    usage = certificate.key_usage
    if usage is not None and "keyCertSign" not in usage:
        return False
    if certificate.is_ca is not None:
        return certificate.is_ca
    old_root = certificate.parsed.version is x509.Version.v1 and names_itself(certificate)
    return old_root or usage is not None or bool((_netscape_type(certificate.parsed) or 0) & _NETSCAPE_AUTHORITY)


@lru_cache(maxsize=65_536)
def names_itself(certificate: Certificate) -> bool:
    """Whether OpenSSL takes it for self-signed (EXFLAG_SS): issuer, key identifier and kind of key are its own."""
    own = _is_named_by(certificate, certificate) and key_identifier_fits(certificate, certificate)
    return own and suits_key(certificate, certificate)


def _is_named_by(issuer: Certificate, certificate: Certificate) -> bool:
    return certificate.issuer_der == issuer.subject_der or same_name(certificate.issuer_name, issuer.subject_name)


def suits_key(certificate: Certificate, issuer: Certificate) -> bool:
    """Whether keys of the issuer's kind make signatures of the certificate's algorithm, or we cannot tell.

    Without that OpenSSL looks for another issuer (check_sig_alg_match in crypto/x509/v3_purp.c). It goes by the
    algorithm that is signed; where another stands outside, we have that one alone.
    """
    return not certificate.algorithms_agree or not public_key.is_of_another_kind(
        certificate.signature_algorithm, issuer.key_kind
    )


def key_identifier_fits(named: Certificate | RevocationList, issuer: Certificate) -> bool:
    """Whether nothing in the authorityKeyIdentifier of a certificate or list contradicts `issuer`.

    X509_check_akid in crypto/x509/v3_purp.c.
    """
    authority = extension_of(named.parsed.extensions, x509.AuthorityKeyIdentifier)
    if authority is None:
        return True
    subject = extension_of(issuer.parsed.extensions, x509.SubjectKeyIdentifier)
    if authority.key_identifier is not None and subject is not None and authority.key_identifier != subject.digest:
        return False
    if authority.authority_cert_serial_number not in (None, issuer.serial):
        return False
    names = [n.value for n in authority.authority_cert_issuer or () if isinstance(n, x509.DirectoryName)]
    return not names or same_name(names[0], issuer.issuer_name)


def _netscape_type(parsed: x509.Certificate) -> int | None:
    """Return the bits of the Netscape certificate type, 0 if it is malformed, None where it is absent."""
    values = (each.value.value for each in parsed.extensions if is_netscape_type(each.value))
    return next((value[3] if len(value) > 3 and value[0] == 0x03 else 0 for value in values), None)


@lru_cache(maxsize=4096)  # asked by rules, usability and systems, under every trust row
def crl_signed_by(crl: RevocationList, ca: Certificate) -> Truth:
    """Whether the key of `ca` made the signature of `crl`; UNKNOWN where the library cannot tell.

    Names, dates and keyUsage are not looked at. X509_CRL_verify compares both statements of the algorithm first.
    """
    return public_key.verifies(ca.parsed, crl.signed_part, crl.parsed) if crl.algorithms_agree else Truth.NO
