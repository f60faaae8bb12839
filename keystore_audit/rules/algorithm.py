"""KA2: the algorithms of keys and certificates (DDS-Security 1.1, 9.3.1; NIST SP 800-57 and 800-131A)."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.findings import Severity
from keystore_audit.keystore.public_key import is_weak_algorithm, is_weak_kind
from keystore_audit.profiles import VARIANTS
from keystore_audit.remedy import Remedy
from keystore_audit.rules.certificate import at, remedy, what
from keystore_audit.rules.context import Context
from keystore_audit.rules.identity import is_identity
from keystore_audit.rules.private_key import authority_anew
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import ISSUE_AGAIN, issue_again
from keystore_audit.rules.subjects import CertificateUse


@rule(
    "KA216",
    Severity.HIGH,
    clause="NIST SP 800-57 Part 1, 5.6; DDS-Security 1.1, 9.3.1",
    remedy=issue_again("Use keys on prime256v1, as sros2 does."),
    stops=True,
)
def weak_key(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The key is shorter than RSA 2048 or EC 256: whoever breaks it is this identity or this authority.

    How the key was made, and whether it is one of the known bad ones, is not looked at.
    """
    for certificate in use.in_use:
        if is_weak_kind(certificate.key_kind):
            message = (
                f"{what(use, certificate)} has a weak key: got {certificate.key_kind}, expected RSA 2048 or EC 256."
            )
            yield at(use, certificate, message, remedy=_anew(use))


def _anew(use: CertificateUse) -> Remedy | None:
    """How to replace an authority: it takes another key."""
    return authority_anew(use.roles, "The authority needs another key.")


@rule(
    "KA217",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.3.1 (RSA with 2,048 bits or EC on prime256v1); measured",
    remedy=issue_again("Use keys on prime256v1, as sros2 does."),
    applies=is_identity,
    stops=True,
)
def key_outside_dds_security(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The identity's key is strong enough but of a kind that the specification does not name.

    Cyclone DDS takes RSA with 2,048 bits and any curve of 256 bits and refuses the rest; Fast DDS starts (measured).
    High where a chosen profile of Cyclone DDS refuses the enclave.
    """
    for certificate in use.in_use[:1]:
        kind = certificate.key_kind
        if kind not in ("RSA 2048", "EC secp256r1") and not is_weak_kind(kind):
            taken = {name: profile.trust.identity_keys for name, profile in VARIANTS.items()}
            refusing = [name for name, kinds in taken.items() if kinds is not None and kind not in kinds]
            yield at(
                use,
                certificate,
                f"{what(use, certificate)} has a key that the specification does not name"
                f"{' and Cyclone DDS refuses' if refusing else ''}: got {kind}, expected EC secp256r1 or RSA 2048.",
                profiles=("spec", *refusing),
                severity=Severity.HIGH if context.refused(use.enclaves, "cyclonedds") else None,
            )


@rule(
    "KA218",
    Severity.HIGH,
    clause="NIST SP 800-131A; DDS-Security 1.1, 9.3.1 (SHA-256)",
    remedy=ISSUE_AGAIN,
    stops=True,
)
def weak_signature_algorithm(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The certificate is signed over SHA-1 or MD5, for which two contents with one digest have been made.

    Of an authority's own signature over itself nothing depends, but what makes it signs the rest alike. Fast DDS takes
    sha1WithRSAEncryption, Cyclone DDS any digest (measured).
    """
    for certificate in use.in_use:
        if is_weak_algorithm(certificate.signature_algorithm):
            message = (
                f"{what(use, certificate)} is signed with {certificate.signature_algorithm}, expected SHA-256 as in "
                "ecdsa-with-SHA256."
            )
            yield at(use, certificate, message, remedy=remedy(use))
