"""Which directories are enclaves, whatever distribution of ROS 2 wrote the keystore."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from keystore_audit.keystore.files import File


class LayoutKind(str, Enum):
    """The layouts that sros2 ever wrote (design section 3)."""

    SROS2 = "sros2"
    FLAT = "flat"
    ARDENT = "ardent"
    ENCLAVE = "enclave"
    PARTIAL = "partial"


class Role(str, Enum):
    """What an enclave's file is for. The value is the stem of its name in Foxy and later."""

    IDENTITY_CA = "identity_ca.cert"
    CERTIFICATE = "cert"
    KEY = "key"
    PERMISSIONS_CA = "permissions_ca.cert"
    GOVERNANCE = "governance"
    PERMISSIONS = "permissions"
    CRL = "crl"


@dataclass(frozen=True, slots=True, kw_only=True)
class EnclaveFiles:
    """The files of one enclave.

    `path` is its ROS name as untrusted text, `directory` relative as in `File.path` (`.` for the root
    itself). `files` holds an entry for each role, MISSING ones too; Ardent's one `ca.cert.pem` serves both CA
    roles. `pkcs11` are the `.p11` files beside; `unsigned` are `governance.xml` and `permissions.xml` by
    role.
    """

    path: str
    directory: str
    files: Mapping[Role, File]
    pkcs11: Mapping[Role, File]
    unsigned: Mapping[Role, File]


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """A keystore's directory as discovered.

    `authorities`: CA certificate files outside enclaves (`public/*.cert.pem`, a flat root's `ca.cert.pem`);
    `authority_keys`: CA private key files anywhere (`private/*.key.pem`, `ca.key.pem`), links and their
    targets listed once by resolved path; `unsigned_governance`: `governance.xml` beside a shared
    governance.p7s; `governance`: the shared `governance.p7s`, if any; `directory_links`: links to
    directories, never followed; `unreadable_directories`: directories that could not be listed; `expected`:
    what a complete keystore of this kind would hold and this one lacks, in words.
    """

    kind: LayoutKind
    enclaves: tuple[EnclaveFiles, ...]
    authorities: tuple[File, ...]
    authority_keys: tuple[File, ...]
    governance: File | None
    unsigned_governance: File | None
    directory_links: tuple[File, ...]
    unreadable_directories: tuple[File, ...]
    expected: tuple[str, ...]
