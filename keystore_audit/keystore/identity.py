"""The identities of a keystore alone, to be compared with those of others that are audited beside it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import islice
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.files import File
from keystore_audit.keystore.foreign import NOTHING_DECLARED, DeclaredFiles
from keystore_audit.keystore.key_quality import Material, material_of
from keystore_audit.keystore.keystore import Keystore, Reader, with_subject_as_path
from keystore_audit.keystore.layout import Role, discover
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.smime import SignedDocument, read_signed
from keystore_audit.keystore.unmanaged import loose_keys
from keystore_audit.keystore.walk import records

MAX_NAMED: Final = 10_000
"""Subjects that the grants of one keystore name: of more of them nobody says whose they are."""

_SUBJECT_NAME: Final = re.compile(rb"<subject_name\s*>([^<]{1,1024})<")


class LooseKey(Struct, frozen=True, kw_only=True):
    """A private key in a file of no enclave in the keystore `root` (the path as the user gave it). It has the public
    half, as `Certificate.key`, and the path.
    """

    root: str
    path: str
    key: str

    @property
    def beside(self) -> str:
        """The path of the file for reports of other keystores."""
        return f"{self.root.rstrip('/')}/{self.path}"


class Identity(LooseKey, frozen=True, kw_only=True):
    """An enclave's identity in a keystore, small enough to keep thousands: its key, and where its certificate is.

    `enclave`: its ROS name, untrusted text. `subject_alike`: of its subject as `alike`. `authorities`: the keys of the
    certificates in its identity CA file.
    """

    enclave: str
    line: int
    subject: str
    subject_alike: tuple[str, ...]
    issuer: str
    not_before: datetime
    not_after: datetime
    authorities: frozenset[str]


class Compared(Struct, frozen=True, kw_only=True):
    """What of a keystore is compared with others."""

    identities: tuple[Identity, ...] = ()
    keys: tuple[LooseKey, ...] = ()
    material: Material = Material()
    """Of certificates and documents in the places of enclaves and authorities."""


class Beside(Struct, frozen=True, kw_only=True):
    """What a run over several keystores knows when it comes to one of them.

    `shared`: identities of the others, at least those whose key or subject is also in this one. Also those that grants
    here name under an authority of this one, and their loose keys that belong to identities of this one.
    `compared`: its own, as they were when they were compared. `apart`: folders in it that the run audits by themselves,
    as in `layout.Nested.path`.
    """

    shared: Compared
    compared: Compared
    apart: frozenset[str] = frozenset()


def read_identities(
    path: str | os.PathLike[str], declared: DeclaredFiles = NOTHING_DECLARED
) -> tuple[Compared, frozenset[str]]:
    """The identities of the enclaves in the directory `path` whose certificates can be read, and other private keys
    there. Also the subjects that the enclaves' permissions seem to name: documents are searched, not verified.

    Raises NothingToAudit if there is no directory or no enclave in it.
    """
    with Root.open(path, declared.roots) as root:
        read, layout = Reader(root).certificates, discover(root, declared.aliases)
        roles = (Role.CERTIFICATE, Role.IDENTITY_CA)
        certificates = [{role: read(files.files[role]) for role in roles} for files in layout.enclaves]
        enclaves = zip(with_subject_as_path(layout, certificates).enclaves, certificates, strict=True)
        found = (_identity(root.path, files.path, *(read[role] for role in roles)) for files, read in enclaves)
        documents = [files.files[Role.PERMISSIONS] for files in layout.enclaves]
        signed = [files.files[role] for files in layout.enclaves for role in (Role.PERMISSIONS, Role.GOVERNANCE)]
        material = _material(
            root.path,
            (read(files.files[role]) for files in layout.enclaves for role in _AUTHORITATIVE),
            (read_signed(each, ()) for each in {each.sha256: each for each in signed if each.content}.values()),
        )
        for _entry in records(root):  # with them, every file has been read
            pass
        keys = _loose(root.path, loose_keys(root, layout.enclaves))
        compared = Compared(identities=_known(found), keys=keys, material=material)
        return compared, frozenset(islice(_named(documents), MAX_NAMED))


def _named(documents: Iterable[File]) -> Iterator[str]:
    for document in documents:
        for match in _SUBJECT_NAME.finditer(document.content or b""):
            yield match[1].decode("utf-8", "replace").strip()


def compared_of(keystore: Keystore) -> Compared:
    """The same of a keystore that was read as a whole: equal to what is read alone, if nobody writes meanwhile."""
    found = (_identity(keystore.root, each.path, each.certificate, each.identity_ca) for each in keystore.enclaves)
    signed = [each.signed for own in keystore.enclaves for each in (own.permissions, own.governance) if each]
    return Compared(
        identities=_known(found),
        keys=_loose(keystore.root, keystore.identities.loose),
        material=_material(
            keystore.root,
            (file for own in keystore.enclaves for file in (own.identity_ca, own.certificate, own.permissions_ca)),
            {each.file.sha256: each for each in signed}.values(),
        ),
    )


_AUTHORITATIVE: Final = (Role.IDENTITY_CA, Role.CERTIFICATE, Role.PERMISSIONS_CA)


def _material(root: str, files: Iterable[CertificateFile | None], documents: Iterable[SignedDocument]) -> Material:
    """Keys and signatures, in an order of their own: whatever verifies them is looked for where two are alike."""
    certificates = [each for file in files if file is not None for each in file.certificates]
    found = material_of(root, certificates, documents)
    return Material(
        keys=tuple(sorted(found.keys, key=lambda each: each.key)),
        signed=tuple(sorted(found.signed, key=lambda each: (each.r, each.hashed))),
    )


def _loose(root: str, places: Mapping[str, Iterable[str]]) -> tuple[LooseKey, ...]:
    return tuple(LooseKey(root=root, path=place, key=key) for key in sorted(places) for place in places[key])


def _known(found: Iterable[Identity | None]) -> tuple[Identity, ...]:
    return tuple(identity for identity in found if identity is not None)


def _identity(
    root: str, enclave: str, own: CertificateFile | None, authority: CertificateFile | None
) -> Identity | None:
    """The identity in a file of certificates, None where none can be read."""
    certificate = None if own is None else own.first
    if certificate is None:
        return None
    return Identity(
        root=root,
        enclave=enclave,
        path=certificate.path,
        line=certificate.line,
        key=certificate.key,
        subject=certificate.subject,
        subject_alike=alike(certificate.subject),
        issuer=certificate.issuer,
        not_before=certificate.not_before,
        not_after=certificate.not_after,
        authorities=frozenset(each.key for each in (authority.certificates if authority is not None else ())),
    )


def alike(subject: str) -> tuple[str, ...]:
    """What is the same of any two subjects (RFC 4514) that some implementation takes for one.

    Implementations compare text: whatever the string types in DER, some in any order, some blanks and cases apart.
    """
    attributes = re.split(r"(?<!\\)[,+]", subject)
    return tuple(sorted(" ".join(attribute.casefold().split()) for attribute in attributes))
