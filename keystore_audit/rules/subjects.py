"""What rules are about: each distinct file and each enclave once, however many links lead there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import PermissionsFile
from keystore_audit.keystore.smime import SignedDocument


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateUse:
    """A certificate file in a role (IDENTITY_CA, CERTIFICATE or PERMISSIONS_CA) and the enclaves that use it
    so.

    No enclaves: an authority's file that no enclave carries.
    """

    role: Role
    certificates: CertificateFile
    enclaves: tuple[Enclave, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DocumentUse:
    """A signed document and the enclaves that carry it (several, where it is linked)."""

    signed: SignedDocument
    enclaves: tuple[Enclave, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GovernanceUse(DocumentUse):
    """A governance document."""

    document: GovernanceFile


@dataclass(frozen=True, slots=True, kw_only=True)
class PermissionsUse(DocumentUse):
    """A permissions document."""

    document: PermissionsFile


def certificate_uses(keystore: Keystore) -> Iterator[CertificateUse]:
    """Every certificate file in every role, by resolved path."""
    uses: dict[tuple[Role, str], tuple[CertificateFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        for role, read in (
            (Role.IDENTITY_CA, enclave.identity_ca),
            (Role.CERTIFICATE, enclave.certificate),
            (Role.PERMISSIONS_CA, enclave.permissions_ca),
        ):
            if read is not None:
                uses.setdefault((role, read.file.place), (read, []))[1].append(enclave)
    for (role, _place), (read, enclaves) in sorted(uses.items(), key=lambda item: item[0]):
        yield CertificateUse(role=role, certificates=read, enclaves=tuple(enclaves))


def governance_uses(keystore: Keystore) -> Iterator[GovernanceUse]:
    """Every distinct governance file."""
    uses: dict[str, tuple[GovernanceFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        if enclave.governance is not None:
            place = enclave.governance.signed.file.place
            uses.setdefault(place, (enclave.governance, []))[1].append(enclave)
    for _place, (document, enclaves) in sorted(uses.items()):
        yield GovernanceUse(signed=document.signed, document=document, enclaves=tuple(enclaves))


def permissions_uses(keystore: Keystore) -> Iterator[PermissionsUse]:
    """Every distinct permissions file."""
    uses: dict[str, tuple[PermissionsFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        if enclave.permissions is not None:
            place = enclave.permissions.signed.file.place
            uses.setdefault(place, (enclave.permissions, []))[1].append(enclave)
    for _place, (document, enclaves) in sorted(uses.items()):
        yield PermissionsUse(signed=document.signed, document=document, enclaves=tuple(enclaves))
