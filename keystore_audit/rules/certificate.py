"""KA2: certificate files, their dates, form and algorithms (DDS-Security 1.1, 9.3; RFC 5280; NIST SP 800-57, 800-131A).

Identities and authorities as such are in `identity.py` and `authority.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from keystore_audit.findings import Remedy, Severity, decision, outside
from keystore_audit.keystore.certificate import IN_DER, Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.keystore.public_key import is_weak_algorithm, is_weak_kind
from keystore_audit.model.trust.chain import trusted
from keystore_audit.profiles import VARIANTS, doing, facts
from keystore_audit.rules.private_key import authority_anew
from keystore_audit.rules.registry import (
    Context,
    Violation,
    defective,
    either,
    listed,
    located,
    of_kinds,
    paths,
    quoted,
    rule,
)
from keystore_audit.rules.remedies import ISSUE_AGAIN, RENEW_AUTHORITY, issue_again
from keystore_audit.rules.subjects import CertificateUse, is_identity
from keystore_audit.text import instant

_WRITE_PEM: Final = decision(
    "Convert the file to PEM: `openssl x509 -inform DER -in FILE -out new.pem`, then replace it by new.pem."
)

_ROLES: Final = {
    Role.IDENTITY_CA: "identity CA",
    Role.CERTIFICATE: "identity certificate",
    Role.PERMISSIONS_CA: "permissions CA",
}


def usual_subject(enclave: Enclave, keystore: Keystore) -> str:
    """`CN=/talker`, the subject that `ros2 security` gives to the enclave's identity and names in its grant."""
    ardent = keystore.layout.kind is LayoutKind.ARDENT
    return f"CN={enclave.path.lstrip('/') if ardent else enclave.path}"


def has_usual_subject(certificate: Certificate, enclave: Enclave, keystore: Keystore) -> bool:
    """Whether the identity's subject is that, whatever else it holds."""
    return usual_subject(enclave, keystore) in certificate.subject.split(",")


def what(use: CertificateUse, certificate: Certificate) -> str:
    """`The identity certificate 'CN=/talker' of /talker`."""
    roles = either([name for role, name in _ROLES.items() if role in use.roles])
    return f"The {roles} {quoted(certificate.subject)} of {paths(use.enclaves)}"


def at(certificate: Certificate, message: str, **more: Any) -> Violation:
    """A violation about one certificate of the file."""
    return Violation(
        message,
        (located(certificate),),
        key=certificate.key,
        **more,
    )


def remedy(use: CertificateUse) -> Remedy:
    """How to get another certificate of this role."""
    return RENEW_AUTHORITY if use.authority else ISSUE_AGAIN


def _of(use: CertificateUse, certificate: Certificate, says: str, **more: Any) -> Violation:
    """A violation about one certificate in use, which gets another one."""
    return at(certificate, f"{what(use, certificate)} {says}", **{"remedy": remedy(use), **more})


def _bears_on(use: CertificateUse) -> frozenset[str]:
    """The properties in which the validity of a certificate in these roles counts."""
    properties = set()
    if use.roles & {Role.IDENTITY_CA, Role.CERTIFICATE}:
        properties.add("identities-chain-to-the-identity-ca")
    if Role.PERMISSIONS_CA in use.roles:
        properties.add("documents-signed-by-the-permissions-ca")
    return frozenset(properties)


_UNASKING: Final = doing("checks_permissions_ca", False)
"""Who does not ask whether the permissions CA is in force."""


@rule(
    "KA201",
    Severity.HIGH,
    "RFC 7468, 5; RFC 5280, 4.1",
    ISSUE_AGAIN,
    stops=True,
)
def certificate_unreadable(use: CertificateUse) -> Iterator[Violation]:
    """A certificate does not parse.

    OpenSSL, which the implementations use, may still accept it: its owner, and whom it vouches for, are unknown. Of an
    identity file only the first certificate counts, since run times read no further.
    """
    if use.authority or not use.certificates.certificates:
        found = list(of_kinds(use.certificates.defects, Kind.CERTIFICATE_UNREADABLE))
        in_der = any(defect.detail.endswith(IN_DER) for defect in found)
        yield from defective(
            found,
            "its owner is unknown.",
            undecided=True,
            remedy=_WRITE_PEM if in_der else remedy(use),
        )


@rule(
    "KA202",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.3.1; measured: every implementation reads only the first certificate of cert.pem",
    decision(
        "Leave only one certificate in the file; in a CA file, the one that issues or signs. `openssl x509 -in FILE "
        "-out new.pem` writes the first."
    ),
)
def certificate_file_holds_more(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The file holds more than one certificate.

    Run times read only the first certificate of an identity file. Of a CA file, Fast DDS takes all certificates and
    revocation lists, Cyclone DDS the first certificate (measured). Fast DDS also tells peers the name of its first
    permissions CA certificate, and refuses peers that tell another (read in its source). So keep one order everywhere
    while you change an authority; claims of `able` count that. A dump before a certificate, as sros2 writes it, is no
    finding. For authorities that nobody expects, see unexpected-authority.
    """
    certificates, lists = use.certificates.certificates, use.certificates.revocation_lists
    differ = facts.CERTIFICATES_OF_A_FILE if use.authority else "run times read the first certificate and no further"
    anchors = [each for each in trusted(context.keystore, context.authorities) if each.role in use.roles]
    known = [c for c in certificates[1:] if all(each.trusts(c) for each in anchors)]  # else unexpected-authority
    more = [located(c, f"certificate {quoted(c.subject)}") for c in known]
    more += [located(r, "a revocation list") for r in lists]
    if more:
        held = f"{len(certificates)} certificates" if len(certificates) > 1 else "a certificate"
        crls = f" and {len(lists)} revocation lists" if lists else ""
        yield Violation(
            f"The file holds {held}{crls} (expected one certificate): {differ}.",
            tuple(more),
            key=" ".join(["several", *(certificate.key for certificate in certificates)]),
        )
    if certificates:  # else something else stands in their place: certificate-unreadable
        unread = () if use.authority else (Kind.CERTIFICATE_UNREADABLE,)
        extra = of_kinds(use.certificates.defects, Kind.CERTIFICATE_FILE_EXTRA, *unread)
        yield from defective(extra, f"{differ}.")


@rule(
    "KA203",
    Severity.HIGH,
    "RFC 5280, 4.1.2.5 and 6.1.3 (a)(2)",
    ISSUE_AGAIN,
    explains=("identities-chain-to-the-identity-ca", "documents-signed-by-the-permissions-ca"),
    stops=True,
)
def certificate_expired(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate is past its notAfter.

    Every implementation refuses an expired identity or identity CA. Cyclone DDS 0.10, and Fast DDS from 2.6.10 and
    2.14.5 on, refuse an expired permissions CA; Cyclone DDS 11 accepts it (measured). Some implementations never end
    running sessions, and the robot's clock may differ.
    """
    for certificate in use.in_use:
        if certificate.not_after < context.at:
            only_signs = use.roles == {Role.PERMISSIONS_CA}
            refused = (
                f"{_UNASKING} still accept its documents, the others refuse them"
                if only_signs
                else "peers refuse new sessions"
            )
            says = f"expired at {instant(certificate.not_after)} (audited for {instant(context.at)}): {refused}."
            yield _of(use, certificate, says, explains=_bears_on(use))


@rule(
    "KA204",
    Severity.HIGH,
    "RFC 5280, 4.1.2.5 and 6.1.3 (a)(2)",
    outside("Wait until then, or issue the certificate again on a machine whose clock is right."),
    explains=("identities-chain-to-the-identity-ca", "documents-signed-by-the-permissions-ca"),
    stops=True,
)
def certificate_not_yet_valid(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate is before its notBefore, and refused like an expired one.

    A robot whose clock has no battery may start before every certificate; that cannot be seen here.
    """
    for certificate in use.in_use:
        if certificate.not_before > context.at:
            says = f"is valid from {instant(certificate.not_before)} on (audited for {instant(context.at)})."
            yield _of(use, certificate, says, remedy=None, explains=_bears_on(use))


@rule(
    "KA205",
    Severity.MEDIUM,
    "RFC 5280, 4.1.2.5",
    ISSUE_AGAIN,
)
def certificate_expires_soon(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate ends within the notice period (--expires-within, 30 days): afterwards nothing new starts."""
    for certificate in use.in_use:
        if context.at <= certificate.not_after and certificate.not_after - context.at <= context.expires_within:
            days = (certificate.not_after - context.at).days
            notice = f"(notice: {context.expires_within.days})."
            yield _of(use, certificate, f"expires at {instant(certificate.not_after)}, in {days} days {notice}")


@rule(
    "KA221",
    Severity.HIGH,
    "RFC 5280, 4.2: a certificate-using system MUST reject a critical extension that it does not recognize",
    ISSUE_AGAIN,
    explains=("identities-chain-to-the-identity-ca",),
    stops=True,
)
def unknown_critical_extension(use: CertificateUse) -> Iterator[Violation]:
    """The certificate has a critical extension that OpenSSL does not process, so it is refused (measured)."""
    for certificate in use.in_use:
        if certificate.unknown_critical:
            refused = listed(certificate.unknown_critical)
            yield _of(use, certificate, f"has critical extensions that implementations refuse: {refused}.")


MAX_SERIAL_OCTETS: Final = 20
"""RFC 5280, 4.1.2.2."""


@rule(
    "KA224",
    Severity.LOW,
    "RFC 5280, 4.1.2.2 (positive, at most 20 octets)",
    ISSUE_AGAIN,
)
def irregular_serial_number(use: CertificateUse) -> Iterator[Violation]:
    """The serial number is not positive, or longer than 20 octets: tools cut it, and libraries begin to refuse it."""
    for certificate in use.in_use:
        octets = certificate.serial.bit_length() // 8 + 1
        if certificate.serial <= 0 or octets > MAX_SERIAL_OCTETS:
            got = f"{octets} octets" if certificate.serial > 0 else "a number that is not positive"
            yield _of(use, certificate, f"has an irregular serial number: got {got}, expected 1 to 20 octets.")


@rule(
    "KA216",
    Severity.HIGH,
    "NIST SP 800-57 Part 1, 5.6; DDS-Security 1.1, 9.3.1",
    issue_again("Use keys on prime256v1, as sros2 does."),
    stops=True,
)
def weak_key(use: CertificateUse) -> Iterator[Violation]:
    """The key is shorter than RSA 2048 or EC 256: whoever breaks it can act as this identity or authority.

    How the key was made is not checked here.
    """
    for certificate in use.in_use:
        if is_weak_kind(certificate.key_kind):
            anew = authority_anew(use.roles, "Replace the authority's key.")
            says = f"has a weak key: got {certificate.key_kind}, expected RSA 2048 or EC 256."
            yield _of(use, certificate, says, remedy=anew)


@rule(
    "KA217",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.3.1 (RSA with 2,048 bits or EC on prime256v1); measured",
    issue_again("Use keys on prime256v1, as sros2 does."),
    applies=is_identity,
    stops=True,
)
def key_outside_dds_security(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The identity's key is strong enough, but of a kind that the specification does not name.

    Cyclone DDS accepts only RSA 2048 and curves of 256 bits; Fast DDS starts (measured). High if a chosen Cyclone DDS
    profile refuses the enclave.
    """
    for certificate in use.in_use[:1]:
        kind = certificate.key_kind
        if kind not in ("RSA 2048", "EC secp256r1") and not is_weak_kind(kind):
            taken = {name: profile.trust.identity_keys for name, profile in VARIANTS.items()}
            refusing = [name for name, kinds in taken.items() if kinds is not None and kind not in kinds]
            refuser = doing("identity_keys", *(taken[name] for name in refusing))
            yield at(
                certificate,
                f"{what(use, certificate)} has a key that the specification does not name"
                f"{f' and {refuser} refuses' if refusing else ''}: got {kind}, expected EC secp256r1 or RSA 2048.",
                profiles=("spec", *refusing),
                severity=Severity.HIGH if context.refused(use.enclaves, refusing) else None,
            )


@rule(
    "KA218",
    Severity.HIGH,
    "NIST SP 800-131A; DDS-Security 1.1, 9.3.1 (SHA-256)",
    ISSUE_AGAIN,
    stops=True,
)
def weak_signature_algorithm(use: CertificateUse) -> Iterator[Violation]:
    """The certificate is signed over SHA-1 or MD5, for which two contents with one digest have been made.

    An authority's signature over itself protects nothing, but its maker signs the rest alike. Fast DDS accepts
    sha1WithRSAEncryption, Cyclone DDS any digest (measured).
    """
    for certificate in use.in_use:
        if is_weak_algorithm(certificate.signature_algorithm):
            signed = f"is signed with {certificate.signature_algorithm}"
            yield _of(use, certificate, f"{signed}, expected SHA-256 as in ecdsa-with-SHA256.")
