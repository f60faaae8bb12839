"""KA2: certificates, CAs and identities (DDS-Security 1.1, 9.3; RFC 5280)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust import is_authority, vouches
from keystore_audit.rules.context import Context
from keystore_audit.rules.places import from_defect, implementations, of_kinds, sole, unpinned
from keystore_audit.rules.registry import Rule, Violation, rule
from keystore_audit.rules.subjects import CertificateUse, certificate_uses

ISSUE_AGAIN = "Move the enclave's cert.pem and key.pem away and run: ros2 security create_enclave KEYSTORE ENCLAVE"
NEW_CA = "Make a keystore with a new CA: ros2 security create_keystore KEYSTORE, then create_enclave for each enclave"

_ROLE = {
    Role.IDENTITY_CA: "identity CA",
    Role.CERTIFICATE: "identity certificate",
    Role.PERMISSIONS_CA: "permissions CA",
}

MAX_SERIAL_OCTETS = 20
"""RFC 5280, 4.1.2.2."""


def in_use(use: CertificateUse) -> tuple[Certificate, ...]:
    """The certificates that count: the first of an identity file, all of a CA file."""
    return use.certificates.certificates[:1] if use.role is Role.CERTIFICATE else use.certificates.certificates


def _at(use: CertificateUse, certificate: Certificate, message: str, *more: Location, **options: Any) -> Violation:
    return Violation(
        message=message,
        locations=(Location(path=certificate.path, line=certificate.line), *more),
        enclave=sole(use.enclaves),
        key=f"{use.role.value} {certificate.sha256}",
        **options,
    )


def _what(use: CertificateUse, certificate: Certificate) -> str:
    return f"The {_ROLE[use.role]} {certificate.subject!r}"


def _remedy(use: CertificateUse) -> str:
    return ISSUE_AGAIN + "." if use.role is Role.CERTIFICATE else NEW_CA + "."


def _time(instant: Any) -> str:
    return f"{instant:%Y-%m-%dT%H:%M:%SZ}"


@rule(
    "KA201",
    "certificate-unreadable",
    Severity.HIGH,
    on=CertificateUse,
    clause="RFC 7468; RFC 5280, 4.1",
    remedy=ISSUE_AGAIN + ".",
)
def certificate_unreadable(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """A certificate does not parse.

    OpenSSL, which the implementations use, may still take it, so whose it is stays unknown.
    """
    for defect in of_kinds(use.certificates.defects, {Kind.CERTIFICATE_UNREADABLE}):
        beside = use.role is Role.CERTIFICATE and bool(use.certificates.certificates)
        yield from_defect(defect, use.enclaves, undecided=not beside)


@rule(
    "KA202",
    "certificate-file-holds-more",
    Severity.MEDIUM,
    on=CertificateUse,
    clause="DDS-Security 1.1, 9.3.1.1; measured: only the first certificate of cert.pem is read",
    remedy="Leave one certificate, and nothing else, in the file.",
)
def certificate_file_holds_more(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The file holds more than one certificate, or other material.

    Of an identity file only the first certificate is read; of a CA file Fast DDS reads all, Cyclone DDS the first.
    """
    if len(use.certificates.certificates) > 1:
        second = use.certificates.certificates[1]
        count = len(use.certificates.certificates)
        yield _at(
            use, second, f"{count} certificates in one file (expected 1): implementations differ in which they use."
        )
    for defect in of_kinds(use.certificates.defects, {Kind.CERTIFICATE_FILE_EXTRA}):
        yield from_defect(defect, use.enclaves, undecided=False)


@rule(
    "KA203",
    "certificate-expired",
    Severity.HIGH,
    on=CertificateUse,
    clause="RFC 5280, 4.1.2.5",
    remedy=ISSUE_AGAIN + ".",
    explains=("identities-chain-to-the-identity-ca", "documents-signed-by-the-permissions-ca"),
)
def certificate_expired(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate is past its notAfter.

    An expired identity or identity CA is refused everywhere; an expired permissions CA by Cyclone DDS 0.10 and Fast DDS
    from 2.14.5 on, while Cyclone DDS 11 takes it (measured).
    """
    for certificate in in_use(use):
        if certificate.not_after < context.at:
            message = (
                f"{_what(use, certificate)} expired at {_time(certificate.not_after)} (audit: {_time(context.at)})."
            )
            yield _at(use, certificate, message, remedy=_remedy(use))


@rule(
    "KA204",
    "certificate-not-yet-valid",
    Severity.HIGH,
    on=CertificateUse,
    clause="RFC 5280, 4.1.2.5",
    remedy="Set the robot's clock, or issue a certificate that is valid now.",
    explains=("identities-chain-to-the-identity-ca", "documents-signed-by-the-permissions-ca"),
)
def certificate_not_yet_valid(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate is before its notBefore. A robot without a battery-backed clock starts in the past."""
    for certificate in in_use(use):
        if certificate.not_before > context.at:
            message = (
                f"{_what(use, certificate)} is valid from {_time(certificate.not_before)} only (audit:"
                f" {_time(context.at)})."
            )
            yield _at(use, certificate, message)


@rule(
    "KA205",
    "certificate-expires-soon",
    Severity.MEDIUM,
    on=CertificateUse,
    clause="RFC 5280, 4.1.2.5",
    remedy=ISSUE_AGAIN + ".",
)
def certificate_expires_soon(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The certificate ends within the notice period (--expires-within)."""
    for certificate in in_use(use):
        if context.at <= certificate.not_after <= context.at + context.expires_within:
            days = (certificate.not_after - context.at).days
            message = f"{_what(use, certificate)} expires at {_time(certificate.not_after)}, in {days} days."
            yield _at(use, certificate, message, remedy=_remedy(use))


def _issuers(use: CertificateUse, certificate: Certificate) -> list[Certificate]:
    """Identity CAs of the enclaves that vouch for the certificate."""
    found: dict[str, Certificate] = {}
    for enclave in use.enclaves:
        for authority in enclave.identity_ca.certificates if enclave.identity_ca else ():
            if vouches(authority, certificate):
                found.setdefault(authority.sha256, authority)
    return list(found.values())


@rule(
    "KA206",
    "certificate-outlives-its-ca",
    Severity.LOW,
    on=CertificateUse,
    clause="RFC 5280, 6.1.3 (a path is valid only while all of it is)",
    remedy=NEW_CA + ".",
    applies=lambda use, _context: use.role is Role.CERTIFICATE,
)
def certificate_outlives_its_ca(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The identity ends later than the CA that issued it, so it dies before its date. sros2 makes it so, by seconds."""
    for certificate in in_use(use):
        issuers = _issuers(use, certificate)
        if issuers and all(issuer.not_after < certificate.not_after for issuer in issuers):
            last = max(issuer.not_after for issuer in issuers)
            message = (
                f"{_what(use, certificate)} ends at {_time(certificate.not_after)}, its CA already at {_time(last)}."
            )
            yield _at(use, certificate, message)


@rule(
    "KA207",
    "not-issued-by-identity-ca",
    Severity.HIGH,
    on=CertificateUse,
    clause="DDS-Security 1.1, 9.3.2.1; RFC 5280, 6.1",
    remedy=ISSUE_AGAIN + ".",
    explains=("identities-chain-to-the-identity-ca",),
    applies=lambda use, _context: use.role is Role.CERTIFICATE,
)
def not_issued_by_identity_ca(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """No certificate of the enclave's identity CA file issued its identity.

    Names prove nothing here: every CA that sros2 makes is called CN=sros2CA. The signature is verified.
    """
    for enclave in use.enclaves:
        authorities = enclave.identity_ca.certificates if enclave.identity_ca else ()
        for certificate in in_use(use):
            if authorities and not any(vouches(authority, certificate) for authority in authorities):
                same_name = any(authority.subject_der == certificate.issuer_der for authority in authorities)
                why = (
                    "its name is the CA's, its signature is not"
                    if same_name
                    else f"its issuer is {certificate.issuer!r}"
                )
                yield Violation(
                    message=f"{_what(use, certificate)} was not issued by the identity CA of {enclave.path}: {why}.",
                    locations=(
                        Location(path=certificate.path, line=certificate.line),
                        Location(path=authorities[0].path, line=authorities[0].line, message="the identity CA"),
                    ),
                    enclave=enclave.path,
                    key=certificate.sha256,
                )


@rule(
    "KA208",
    "authority-not-a-ca",
    Severity.HIGH,
    on=CertificateUse,
    clause="RFC 5280, 4.2.1.3 and 4.2.1.9",
    remedy=NEW_CA + ".",
    explains=("identities-chain-to-the-identity-ca",),
    applies=lambda use, _context: use.role is Role.IDENTITY_CA,
)
def authority_not_a_ca(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The identity CA's certificate may not issue certificates: implementations refuse every identity under it."""
    for certificate in in_use(use):
        if not is_authority(certificate):
            lacks = "keyUsage keyCertSign" if certificate.is_ca else "BasicConstraints CA:TRUE"
            yield _at(
                use, certificate, f"{_what(use, certificate)} lacks {lacks}: identities that it issued are refused."
            )


@rule(
    "KA216",
    "weak-key",
    Severity.HIGH,
    on=CertificateUse,
    clause="NIST SP 800-57 Part 1, 5.6.1; DDS-Security 1.1, 9.3.1.1",
    remedy="Use prime256v1 keys, as sros2 does. " + NEW_CA + ".",
)
def weak_key(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The key offers less than 112 bits of security: RSA below 2,048 bits, elliptic curves below 224."""
    for certificate in in_use(use):
        if _bits(certificate) < (2048 if certificate.key_kind.startswith("RSA") else 224):
            yield _at(use, certificate, f"{_what(use, certificate)} has a weak key: {certificate.key_kind}.")


def _bits(certificate: Certificate) -> int:
    """The size of the key; unknown kinds count as strong here, since key-outside-dds-security speaks of them."""
    digits = "".join(c if c.isdigit() else " " for c in certificate.key_kind).split()
    kind = certificate.key_kind.split(" ")[0]
    if kind not in ("RSA", "EC", "DSA") or not digits:
        return 1 << 20
    return int(digits[0])


@rule(
    "KA217",
    "key-outside-dds-security",
    Severity.MEDIUM,
    on=CertificateUse,
    clause="DDS-Security 1.1, 9.3.1.1 (2048-bit RSA or 256-bit EC prime256v1)",
    remedy="Use prime256v1 keys, as sros2 does. " + ISSUE_AGAIN + ".",
    applies=lambda use, _context: use.role is Role.CERTIFICATE,
)
def key_outside_dds_security(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The identity's key is of a kind that the specification does not name.

    Cyclone DDS refuses it, Fast DDS starts (measured).
    """
    for certificate in in_use(use):
        if certificate.key_kind not in ("EC secp256r1", "RSA 2048"):
            message = (
                f"{_what(use, certificate)} has a {certificate.key_kind} key (expected EC secp256r1 or RSA 2048):"
                " Cyclone DDS refuses it."
            )
            yield _at(use, certificate, message)


@rule(
    "KA218",
    "weak-signature-algorithm",
    Severity.HIGH,
    on=CertificateUse,
    clause="NIST SP 800-131A; DDS-Security 1.1, 9.3.1.1",
    remedy=ISSUE_AGAIN + ".",
)
def weak_signature_algorithm(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The certificate is signed with SHA-1 or MD5, for which forgeries with the same digest can be made."""
    for certificate in in_use(use):
        algorithm = certificate.signature_algorithm.lower().replace("-", "")
        if "sha1" in algorithm or "md5" in algorithm or "md2" in algorithm:
            yield _at(
                use,
                certificate,
                f"{_what(use, certificate)} is signed with {certificate.signature_algorithm} (expected SHA-256).",
            )


@rule(
    "KA219",
    "identity-shared-by-enclaves",
    Severity.HIGH,
    on=Keystore,
    clause="DDS-Security 1.1, 9.3.1.1",
    remedy="Give each enclave its own identity. " + ISSUE_AGAIN + ".",
    explains=("no-identity-serves-two-enclaves",),
)
def identity_shared_by_enclaves(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Two enclaves have one identity key: whoever has one of them is both."""
    holders: dict[str, list[tuple[str, Certificate]]] = {}
    for enclave in keystore.enclaves:
        first = enclave.certificate.first if enclave.certificate else None
        if first is not None:
            holders.setdefault(first.key, []).append((enclave.path, first))
    for sharing in holders.values():
        if len(sharing) > 1:
            names = ", ".join(path for path, _certificate in sharing)
            places = {(c.path, c.line): Location(path=c.path, line=c.line) for _path, c in sharing}
            yield Violation(
                message=f"{len(sharing)} enclaves have one identity key: {names}.",
                locations=tuple(places.values()),
                key=sharing[0][1].key,
            )


@rule(
    "KA220",
    "subject-differs-from-enclave",
    Severity.LOW,
    on=CertificateUse,
    clause="ROS 2 design, DDS-Security integration (the enclave's path is the common name)",
    remedy=ISSUE_AGAIN + ".",
    applies=lambda use, _context: use.role is Role.CERTIFICATE,
)
def subject_differs_from_enclave(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The identity's subject is not CN= and the enclave's path, as sros2 writes it.

    The enclave runs under another's name.
    """
    for enclave in use.enclaves:
        bare = context.keystore.layout.kind.value == "ardent"
        expected = "CN=" + (enclave.path.lstrip("/") if bare else enclave.path)
        for certificate in in_use(use):
            if certificate.subject != expected:
                yield Violation(
                    message=f"The identity of {enclave.path} is for {certificate.subject!r} (expected {expected!r}).",
                    locations=(Location(path=certificate.path, line=certificate.line),),
                    enclave=enclave.path,
                    key=certificate.subject,
                )


@rule(
    "KA221",
    "unknown-critical-extension",
    Severity.HIGH,
    on=CertificateUse,
    clause="RFC 5280, 4.2",
    remedy=ISSUE_AGAIN + ".",
)
def unknown_critical_extension(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The certificate has a critical extension that verifiers do not know, so they refuse it (measured)."""
    for certificate in in_use(use):
        if certificate.unknown_critical:
            names = ", ".join(certificate.unknown_critical)
            yield _at(
                use,
                certificate,
                f"{_what(use, certificate)} has critical extensions that implementations refuse: {names}.",
            )


@rule(
    "KA222",
    "one-ca-for-both-roles",
    Severity.MEDIUM,
    on=Keystore,
    clause="DDS-Security 1.1, 9.3.1 and 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012; ros2/sros2#282",
    remedy=(
        "Make two CAs: put identity_ca and permissions_ca certificates and keys of different keys into public/ and"
        " private/ before ros2 security create_keystore, which keeps them. Or run implementations that pin the signer"
        " only."
    ),
    explains=(
        "no-enclave-grants-itself-rights",
        "nobody-writes-without-a-grant",
        "nobody-reads-without-a-grant",
    ),
)
def one_ca_for_both_roles(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """One key is identity CA and permissions CA, as sros2 makes it.

    Where the signer is not pinned, every enclave can then sign itself any rights: its own identity chains to the
    permissions CA. High if a chosen profile is such an implementation, else medium.
    """
    shared: dict[str, tuple[Certificate, Certificate]] = {}
    for enclave in keystore.enclaves:
        for identity in enclave.identity_ca.certificates if enclave.identity_ca else ():
            for permissions in enclave.permissions_ca.certificates if enclave.permissions_ca else ():
                if identity.key == permissions.key:
                    shared.setdefault(identity.key, (identity, permissions))
    bites = tuple(profile.name for profile in context.profiles if not profile.pins_signer)
    for key, (identity, permissions) in shared.items():
        places = dict.fromkeys(Location(path=c.path, line=c.line) for c in (identity, permissions))
        chosen = [profile for profile in context.profiles if not profile.pins_signer]
        effect = (
            f"under {implementations(chosen)}, every enclave can sign itself any rights"
            if chosen
            else f"under {implementations(unpinned())} (not chosen), every enclave could sign itself any rights"
        )
        yield Violation(
            message=f"One CA ({identity.subject!r}) issues identities and signs permissions: {effect}.",
            locations=tuple(places),
            severity=Severity.HIGH if bites else None,
            profiles=bites,
            key=key,
        )


@rule(
    "KA223",
    "enclaves-trust-different-cas",
    Severity.MEDIUM,
    on=Keystore,
    clause="DDS-Security 1.1, 9.3.1.1 and 9.4.1.1",
    remedy="Give every enclave the same CA files: links to public/, as sros2 makes them.",
)
def enclaves_trust_different_cas(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Enclaves of one keystore trust different CAs, so they never talk; or a CA was renewed in some only."""
    for role in (Role.IDENTITY_CA, Role.PERMISSIONS_CA):
        trusted: dict[tuple[str, ...], CertificateUse] = {}
        for use in certificate_uses(keystore):
            if use.role is role and use.certificates.certificates:
                trusted.setdefault(tuple(c.sha256 for c in use.certificates.certificates), use)
        if len(trusted) > 1:
            uses = list(trusted.values())
            names = "; ".join(f"{use.certificates.file.place} ({use.enclaves[0].path})" for use in uses[:3])
            yield Violation(
                message=f"Enclaves trust {len(uses)} different {_ROLE[role]}s: {names}.",
                locations=tuple(Location(path=use.certificates.file.place) for use in uses),
                key=role.value,
            )


@rule(
    "KA224",
    "irregular-serial-number",
    Severity.LOW,
    on=CertificateUse,
    clause="RFC 5280, 4.1.2.2",
    remedy=ISSUE_AGAIN + ".",
)
def irregular_serial_number(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The serial number is not positive or longer than 20 octets; libraries begin to refuse such certificates."""
    for certificate in in_use(use):
        if certificate.serial <= 0 or (certificate.serial.bit_length() + 8) // 8 > MAX_SERIAL_OCTETS:
            yield _at(
                use,
                certificate,
                f"{_what(use, certificate)} has the serial number {certificate.serial:x} (expected 1 to 20 octets,"
                " positive).",
            )


@rule(
    "KA225",
    "subject-shared-by-certificates",
    Severity.HIGH,
    on=Keystore,
    clause="DDS-Security 1.1, 9.4.1.3.2.1 (a grant is bound to a subject name, not to a key)",
    remedy="Give each identity its own subject. " + ISSUE_AGAIN + ".",
)
def subject_shared_by_certificates(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Identities with different keys have one subject: a grant for the one is a grant for the other."""
    by_subject: dict[str, dict[str, tuple[str, Certificate]]] = {}
    for enclave in keystore.enclaves:
        first = enclave.certificate.first if enclave.certificate else None
        if first is not None:
            by_subject.setdefault(first.subject, {}).setdefault(first.key, (enclave.path, first))
    for subject, holders in by_subject.items():
        if len(holders) > 1:
            names = ", ".join(path for path, _certificate in holders.values())
            yield Violation(
                message=f"{len(holders)} identities with different keys have the subject {subject!r}: {names}.",
                locations=tuple(Location(path=c.path, line=c.line) for _path, c in holders.values()),
                key=subject,
            )


CERTIFICATE: tuple[Rule[Any], ...] = (
    certificate_unreadable,
    certificate_file_holds_more,
    certificate_expired,
    certificate_not_yet_valid,
    certificate_expires_soon,
    certificate_outlives_its_ca,
    not_issued_by_identity_ca,
    authority_not_a_ca,
    weak_key,
    key_outside_dds_security,
    weak_signature_algorithm,
    identity_shared_by_enclaves,
    subject_differs_from_enclave,
    unknown_critical_extension,
    one_ca_for_both_roles,
    enclaves_trust_different_cas,
    irregular_serial_number,
    subject_shared_by_certificates,
)
