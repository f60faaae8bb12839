"""Who takes a signed document, under every known implementation (`model.trust.verdicts` per profile)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.trust.verdicts import Acceptance, document_verdict, envelope
from keystore_audit.profiles import VARIANTS, Profile, Trust

ROWS: Final = tuple(dict.fromkeys(profile.trust for profile in VARIANTS.values()))
"""The trust rows of all known variants, the specification's first."""

SPEC: Final = VARIANTS["spec"].trust
"""The row by which a document is genuine: a certificate of the permissions CA file made every signature."""

FAST_DDS: Final = tuple(name for name in VARIANTS if name.startswith("fastdds"))
"""The names of the variants of Fast DDS."""

UNPINNED: Final = tuple(profile for profile in VARIANTS.values() if not profile.trust.pins_signer)
"""The variants that take documents from any signer that chains to the permissions CA, and not from it alone."""


def unread_authority(enclave: Enclave) -> bool:
    """Whether it is unknown whom the enclave takes documents from: a robot may read a CA file that we did not."""
    read = enclave.permissions_ca
    return (
        enclave.files.files[Role.PERMISSIONS_CA].status.unknown
        or Role.PERMISSIONS_CA in enclave.files.pkcs11
        or (read is not None and first_opaque(read.defects) is not None)
    )


def accepting(signed: SignedDocument, files: Iterable[CertificateFile]) -> tuple[Profile, ...]:
    """The known variants under which an enclave with one of these permissions CA files takes the document."""
    takes = {trust for trust in ROWS for file in files if document_verdict(signed, file, trust) is Acceptance.ACCEPTED}
    return tuple(profile for profile in VARIANTS.values() if profile.trust in takes)


def verdict(signed: SignedDocument, enclave: Enclave, trust: Trust) -> Acceptance:
    """What the enclave does with the document; UNKNOWN too where its permissions CA could not be read."""
    said = document_verdict(signed, enclave.permissions_ca, trust)
    if said is not Acceptance.REFUSED or not unread_authority(enclave):
        return said
    return said if envelope(signed).verdict is Acceptance.REFUSED else Acceptance.UNKNOWN


def may_be_taken(signed: SignedDocument, enclaves: Sequence[Enclave]) -> bool:
    """Whether some known implementation may take the document in some of the enclaves.

    Where none may, what its XML says is of no consequence: the signature's finding says everything.
    """
    return any(verdict(signed, enclave, trust) is not Acceptance.REFUSED for trust in ROWS for enclave in enclaves)


def genuine_for(signed: SignedDocument, enclaves: Sequence[Enclave]) -> int:
    """How many of the enclaves have a permissions CA that signed the document."""
    return sum(verdict(signed, enclave, SPEC) is Acceptance.ACCEPTED for enclave in enclaves)
