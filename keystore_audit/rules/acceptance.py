"""Who takes a signed document, under every known implementation (`model.trust` per profile)."""

from __future__ import annotations

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.model.profiles import VARIANTS, Profile
from keystore_audit.model.trust import Verdict, document_verdict, envelope
from keystore_audit.rules.context import Context
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, PermissionsUse


def unpinned() -> tuple[Profile, ...]:
    """Every known variant that takes documents from any signer that chains to the permissions CA."""
    return tuple(profile for profile in VARIANTS.values() if not profile.pins_signer)


def pinned() -> tuple[Profile, ...]:
    """Every known variant that takes documents from the permissions CA itself alone."""
    return tuple(profile for profile in VARIANTS.values() if profile.pins_signer)


def unread_authority(enclave: Enclave) -> bool:
    """Whether it is unknown whom the enclave takes documents from: a robot may read a CA file that we did not."""
    read = enclave.permissions_ca
    return (
        enclave.files.files[Role.PERMISSIONS_CA].status.unknown
        or Role.PERMISSIONS_CA in enclave.files.pkcs11
        or (read is not None and any(defect.kind.opaque for defect in read.defects))
    )


def verdict(use: DocumentUse, enclave: Enclave, *, pins_signer: bool) -> Verdict:
    """What the enclave does with the document; UNKNOWN too where its permissions CA could not be read."""
    said = document_verdict(use.signed, enclave.permissions_ca, pins_signer=pins_signer)
    sound = envelope(use.signed).verdict is not Verdict.REFUSED
    return Verdict.UNKNOWN if said is Verdict.REFUSED and sound and unread_authority(enclave) else said


def may_be_accepted(use: DocumentUse) -> bool:
    """Whether some known implementation may take the document in some enclave that carries it.

    Where none may, what its XML says is of no consequence: the signature's finding says everything.
    """
    return any(
        verdict(use, enclave, pins_signer=pins_signer) is not Verdict.REFUSED
        for pins_signer in (True, False)
        for enclave in use.enclaves
    )


def genuine(use: DocumentUse) -> bool:
    """Whether every signer is a permissions CA of an enclave that carries the document."""
    return any(verdict(use, enclave, pins_signer=True) is Verdict.ACCEPTED for enclave in use.enclaves)


def governs(use: GovernanceUse, _context: Context) -> bool:
    """Whether the document has one meaning and may be taken: rules about what it says apply."""
    return use.document.governance is not None and may_be_accepted(use)


def grants(use: PermissionsUse, _context: Context) -> bool:
    """Whether the document has one meaning and may be taken: rules about what it says apply."""
    return use.document.permissions is not None and may_be_accepted(use)


def judging(use: DocumentUse) -> tuple[tuple[Enclave, CertificateFile], ...]:
    """The enclaves that carry the document and have a permissions CA to compare its signers with."""
    return tuple(
        (enclave, enclave.permissions_ca)
        for enclave in use.enclaves
        if enclave.permissions_ca is not None and enclave.permissions_ca.certificates
    )


def authorities(use: DocumentUse) -> tuple[Certificate, ...]:
    """The permissions CA certificates of those enclaves, each once."""
    return tuple({c.sha256: c for _enclave, file in judging(use) for c in file.certificates}.values())
