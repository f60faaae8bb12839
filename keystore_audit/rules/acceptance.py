"""Who takes a signed document, under every known implementation (`model.trust` per profile)."""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.profiles import VARIANTS, Profile
from keystore_audit.model.trust import Verdict, document_verdict, envelope


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


def verdict(signed: SignedDocument, enclave: Enclave, *, pins_signer: bool) -> Verdict:
    """What the enclave does with the document; UNKNOWN too where its permissions CA could not be read."""
    said = document_verdict(signed, enclave.permissions_ca, pins_signer=pins_signer)
    if said is not Verdict.REFUSED or not unread_authority(enclave):
        return said
    return said if envelope(signed).verdict is Verdict.REFUSED else Verdict.UNKNOWN


def may_be_taken(signed: SignedDocument, enclaves: Sequence[Enclave]) -> bool:
    """Whether some known implementation may take the document in some of the enclaves.

    Where none may, what its XML says is of no consequence: the signature's finding says everything.
    """
    return any(
        verdict(signed, enclave, pins_signer=pins_signer) is not Verdict.REFUSED
        for pins_signer in (True, False)
        for enclave in enclaves
    )


def genuine_for(signed: SignedDocument, enclaves: Sequence[Enclave]) -> int:
    """How many of the enclaves have a permissions CA that signed the document."""
    return sum(verdict(signed, enclave, pins_signer=True) is Verdict.ACCEPTED for enclave in enclaves)
