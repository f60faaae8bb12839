"""The whole keystore as evidence: `read_keystore` is the one entry to this package."""

from __future__ import annotations

from dataclasses import dataclass

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.crl import CrlFile
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.layout import EnclaveFiles, Layout
from keystore_audit.keystore.permissions import PermissionsFile
from keystore_audit.keystore.private_key import PrivateKey


@dataclass(frozen=True, slots=True, kw_only=True)
class Enclave:
    """One enclave: each reading is None where its file is not PRESENT (see `files.files`)."""

    files: EnclaveFiles
    identity_ca: CertificateFile | None
    certificate: CertificateFile | None
    key: PrivateKey | None
    permissions_ca: CertificateFile | None
    governance: GovernanceFile | None
    permissions: PermissionsFile | None
    crl: CrlFile | None

    @property
    def path(self) -> str:
        """The enclave's ROS name, untrusted text."""
        return self.files.path


@dataclass(frozen=True, slots=True, kw_only=True)
class Keystore:
    """Everything read below `root` (the path as the user gave it).

    A file shared by several enclaves (by link, or as a copy with the same bytes at the same resolved path) is read once: the
    same object stands in each. `digest`: SHA-256 over the sorted (path, type, content or link target).
    """

    root: str
    layout: Layout
    enclaves: tuple[Enclave, ...]
    authorities: tuple[CertificateFile, ...]
    authority_keys: tuple[PrivateKey, ...]
    digest: str
