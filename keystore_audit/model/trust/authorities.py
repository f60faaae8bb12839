"""Which authorities are trusted: those that somebody declared, else the ones that are found in their standard places.

Two certificates of one key are one authority, as where it was renewed. A certificate in a file of any other name is
never one, whatever it says of itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role

ROLES: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)


class Authorities(Struct, frozen=True, kw_only=True):
    """What somebody declared, by role: SHA-256, in hexadecimal, of certificates or of their keys; none: nothing."""

    identity: frozenset[str] = frozenset()
    permissions: frozenset[str] = frozenset()

    def of(self, role: Role) -> frozenset[str]:
        """The fingerprints for a role."""
        return self.identity if role is Role.IDENTITY_CA else self.permissions

    @property
    def complete(self) -> bool:
        """Whether somebody said of both roles who is trusted."""
        return all(map(self.of, ROLES))


class Anchors(Struct, frozen=True, kw_only=True):
    """The authorities that are trusted in a role: those declared that are here, by place, or the one found.

    `found_in`: the file that it was taken from; empty where they were declared, or where none can be told.
    """

    role: Role
    declared: frozenset[str]
    certificates: tuple[Certificate, ...]
    found_in: str = ""

    def trusts(self, certificate: Certificate) -> bool:
        """Whether the certificate is that of one of them."""
        if self.declared:
            return not self.declared.isdisjoint((certificate.sha256, certificate.key))
        return any(certificate.key == each.key for each in self.certificates)

    def foreign(self, file: CertificateFile) -> tuple[str, ...]:
        """The certificates of others in a file, by their SHA-256."""
        return tuple(each.sha256 for each in file.certificates if not self.trusts(each))


def authority_files(
    keystore: Keystore, role: Role
) -> tuple[CertificateFile | None, tuple[tuple[CertificateFile, tuple[Enclave, ...]], ...]]:
    """The standard file of `public/`, which new enclaves link to, and each file that enclaves read, with these."""
    read: dict[str, tuple[CertificateFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        file = enclave.identity_ca if role is Role.IDENTITY_CA else enclave.permissions_ca
        if file is not None:
            read.setdefault(file.file.place, (file, []))[1].append(enclave)
    name = f"public/{role.value}.pem"  # by its name as linked: sros2's leads to public/ca.cert.pem
    places = {each.place for each in keystore.layout.authorities if each.path == name and each.status is Status.PRESENT}
    public = next((file for file in keystore.authorities if file.file.place in places), None)
    return public, tuple((file, tuple(enclaves)) for file, enclaves in read.values())


@lru_cache(maxsize=2)
def trusted(keystore: Keystore, authorities: Authorities) -> tuple[Anchors, ...]:
    """Who is trusted in this keystore, in each role."""
    return tuple(_anchors(keystore, role, authorities) for role in ROLES)


def _anchors(keystore: Keystore, role: Role, authorities: Authorities) -> Anchors:
    public, read = authority_files(keystore, role)
    files = [*([public] if public else ()), *(file for file, _enclaves in read)]
    declared = authorities.of(role)
    if declared:
        wanted = Anchors(role=role, declared=declared, certificates=())
        here = {c.sha256: c for file in files for c in file.certificates if wanted.trusts(c)}
        ordered = sorted(here.values(), key=lambda each: (each.path, each.line))
        return Anchors(role=role, declared=declared, certificates=tuple(ordered))
    first = _as_found(public, [file for file in files if file.certificates])
    return Anchors(
        role=role,
        declared=declared,
        certificates=(first.certificates[0],) if first else (),
        found_in=first.file.place if first else "",
    )


def _as_found(public: CertificateFile | None, files: Sequence[CertificateFile]) -> CertificateFile | None:
    """The file whose first certificate is taken for the authority; without one in `public/` all have to be alike."""
    if public is not None and public.certificates:
        return public
    keys = {frozenset(each.key for each in file.certificates) for file in files}
    return files[0] if len(keys) == 1 else None
