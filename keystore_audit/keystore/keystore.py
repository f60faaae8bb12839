"""The whole keystore as evidence: `read_keystore` is the one entry to this package."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, Final, TypeVar

from cryptography.x509.oid import NameOID
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.keystore.certificate import Certificate, CertificateFile, read_certificates
from keystore_audit.keystore.crl import CrlFile, RevocationList, read_crl
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import UNREAD_BUT_THERE, File, Status
from keystore_audit.keystore.foreign import NOTHING_DECLARED, DeclaredFiles, Foreign, find_foreign
from keystore_audit.keystore.issuer import may_issue
from keystore_audit.keystore.layout import EnclaveFiles, Layout, LayoutKind, Role, discover
from keystore_audit.keystore.private_key import PrivateKey, read_private_key
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.smime import Candidates, Signature, SignedDocument
from keystore_audit.keystore.typed import GovernanceFile, Grant, PermissionsFile, read_governance, read_permissions
from keystore_audit.keystore.unmanaged import (
    Carried,
    UnmanagedDocument,
    UnmanagedIdentities,
    own_places,
    read_unmanaged,
    read_unmanaged_identities,
)
from keystore_audit.keystore.walk import contents, digest, records, uncovered
from keystore_audit.text import meant, some

MAX_FURTHER_KEYS: Final = 64
"""Files with private keys in odd places that are parsed: of the rest it is not said whose key they hold."""


class Enclave(Struct, frozen=True, kw_only=True, eq=False):
    """One enclave, compared by identity: each reading is None where its file is not PRESENT (see `files.files`)."""

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

    @property
    def identity(self) -> Certificate | None:
        """The certificate that it goes by: the first of its file."""
        return None if self.certificate is None else self.certificate.first

    @property
    def grants(self) -> tuple[Grant, ...]:
        """Those of its permissions as they are written; none where they have no single meaning."""
        return () if self.permissions is None else self.permissions.grants

    def trusts(self, role: Role) -> tuple[Certificate, ...]:
        """The certificates in its file of this authority."""
        file = self.identity_ca if role is Role.IDENTITY_CA else self.permissions_ca
        return file.certificates if file is not None else ()


MAX_KNOWN: Final = 30
"""Enclaves named in a message about one that there is not; those of a fleet would hide the message."""


class Keystore(Struct, frozen=True, kw_only=True, eq=False):
    """Everything read below `root` (the path as the user gave it).

    A file shared by several enclaves, by links to one path, is read once: the same object stands in each.
    Copies of a document with the same bytes are verified once. `digest`: SHA-256 over the sorted (path,
    type, content or link target) of every entry: see `digest`.
    """

    root: str
    layout: Layout
    enclaves: tuple[Enclave, ...]
    authorities: tuple[CertificateFile, ...]
    authority_keys: tuple[PrivateKey, ...]
    private_keys: tuple[File, ...]
    """Every file below the root in which a private key is, whatever its name; without content."""
    further_keys: tuple[PrivateKey, ...] = ()
    """Of those that are no enclave's key.pem and no authority's by name, what the first of them hold."""
    digest: str
    contents: tuple[tuple[str, str], ...] = ()
    """Path and SHA-256, in hexadecimal, of every file, by path: of the bytes that were parsed, or searched."""
    uncovered: tuple[str, ...] = ()
    """Paths, in order, of files and directories of which no digest holds what is in them."""
    unmanaged: tuple[UnmanagedDocument, ...] = ()
    """Signed messages that no enclave carries, by place, each content once: see `unmanaged`."""
    identities: UnmanagedIdentities = UnmanagedIdentities()
    """Identities beside the enclaves."""
    declared: DeclaredFiles = NOTHING_DECLARED
    foreign: tuple[Foreign, ...] = ()
    """What neither sros2 nor the plugins know by place and name, by path."""

    @property
    def by_path(self) -> dict[str, Enclave]:
        """The enclaves by path, in its order: of those with one path the first."""
        return dict(sorted({each.path: each for each in reversed(self.enclaves)}.items()))

    def enclave(self, path: str, also: str = "") -> Enclave:
        """The enclave of that path. Raises UsageError, which names the nearest one and what would do `also`."""
        known = self.by_path
        if path not in known:
            every = some(known, MAX_KNOWN)
            raise UsageError(f"There is no enclave {path!r}.{meant(path, known)} Known: {also}{every}.")
        return known[path]

    @property
    def unread_foreign(self) -> tuple[File, ...]:
        """Files, read and accepted by nobody, in which keys, certificates or documents may stand. They are foreign
        ones, enclaves' own in other forms, and keys of unknown authorities.
        """
        read = {key.file.path for key in self.authority_keys if key.key is not None}
        files = (
            *(each.file for each in self.foreign if each.unread),
            *(file for enclave in self.enclaves for file in enclave.files.every if file.opaque),
            *(f for f in self.layout.authority_keys if f.path not in read and f.status in UNREAD_BUT_THERE),
        )
        found = {file.place: file for file in files if file.sha256 is None or file.sha256 not in self.declared.accepted}
        return tuple(found[place] for place in sorted(found))


def read_keystore(
    path: str | os.PathLike[str],
    *,
    progress: Callable[[int, int], None] | None = None,
    declared: DeclaredFiles = NOTHING_DECLARED,
) -> Keystore:
    """Read and verify everything in the directory `path`, enclaves in the order of their paths.

    `progress` is told how many enclaves are done, of how many. What cannot be read is evidence, not an error.
    Raises NothingToAudit if there is no directory or no enclave in it, and UsageError for one that is declared and
    not there.
    """
    with Root.open(path, declared.roots) as root:
        layout = discover(root, declared.aliases)
        reader = Reader(root)
        certificates = [reader.certificates_of(files) for files in layout.enclaves]
        layout = with_subject_as_path(layout, certificates)
        known = sorted(files.path for files in layout.enclaves)
        for wanted, place in declared.enclaves:
            if wanted not in known:
                raise UsageError(f"{place}: {wanted!r} is no enclave of this keystore.{meant(wanted, known)}")
        authorities = _distinct(reader.certificates(file) for file in layout.authorities)
        candidates = _candidates(certificates, authorities)
        enclaves: list[Enclave] = []
        for files, read in zip(layout.enclaves, certificates, strict=True):
            enclaves.append(reader.enclave(files, read, candidates))
            if progress is not None:
                progress(len(enclaves), len(layout.enclaves))
        entries = sorted(records(root))  # with them, every file has been read
        marked, private_keys = _marked(root, layout), root.holding_private_keys()
        others = _unmanaged(root, marked, enclaves, candidates)
        carried = _carried(layout, enclaves, authorities, others)
        unread = (file for file in marked if _may_hold_keys(file) and file.place not in carried.key_places[1])
        identities = read_unmanaged_identities(root, carried, unread)
        return Keystore(
            root=root.path,
            layout=layout,
            enclaves=tuple(enclaves),
            authorities=authorities,
            authority_keys=_distinct(reader.private_key(file) for file in layout.authority_keys),
            private_keys=private_keys,
            further_keys=_further_keys(reader, private_keys, layout, enclaves),
            digest=digest(entries),
            contents=tuple(contents(entries)),
            uncovered=tuple(uncovered(entries)),
            unmanaged=others,
            identities=identities,
            declared=declared,
            foreign=tuple(find_foreign(root, layout)),
        )


_CertificatesOf = dict[Role, CertificateFile | None]
_Reading = TypeVar("_Reading", CertificateFile, PrivateKey, CrlFile, GovernanceFile, PermissionsFile)
_Held = TypeVar("_Held", CertificateFile, PrivateKey)


class Reader:
    """Reads each distinct file once."""

    def __init__(self, root: Root) -> None:
        self._root = root
        self._done: dict[tuple[object, str | None], tuple[File, Any]] = {}

    def certificates_of(self, files: EnclaveFiles) -> _CertificatesOf:
        """The certificates of an enclave."""
        roles = (Role.IDENTITY_CA, Role.CERTIFICATE, Role.PERMISSIONS_CA)
        return {role: self.certificates(files.files[role]) for role in roles}

    def enclave(self, files: EnclaveFiles, read: _CertificatesOf, candidates: Candidates) -> Enclave:
        """The enclave with these certificates, and all else of it read."""
        by_role = files.files
        return Enclave(
            files=files,
            identity_ca=read[Role.IDENTITY_CA],
            certificate=read[Role.CERTIFICATE],
            key=self.private_key(by_role[Role.KEY]),
            permissions_ca=read[Role.PERMISSIONS_CA],
            governance=self._read(by_role[Role.GOVERNANCE], read_governance, candidates),
            permissions=self._read(by_role[Role.PERMISSIONS], read_permissions, candidates),
            crl=self._read(by_role[Role.CRL], read_crl),
        )

    def certificates(self, file: File) -> CertificateFile | None:
        """What a file of certificates holds; None where it is not there."""
        return self._read(file, read_certificates)

    def private_key(self, file: File) -> PrivateKey | None:
        """The public half of what a file of a key holds, and what is to be said of it; None where it is not there."""
        return self._read(file, read_private_key)

    def _read(self, file: File, read: Callable[..., _Reading], *more: object) -> _Reading | None:
        """What a file holds; a copy of one that was read holds the same at its own place."""
        if file.status is not Status.PRESENT:
            return None
        content, here = (read, file.sha256 or file.place), (read, file.place)
        if content not in self._done:
            whole = self._root.unsealed(file) if file.content is None else file
            self._done[content] = self._done[here] = file, read(whole, *more)
        if here not in self._done:
            first, found = self._done[content]
            self._done[here] = file, _moved(found, first.place, file)
        reading: _Reading = self._done[here][1]
        return reading


_MADE_OF_PARTS: Final = (
    CertificateFile,
    CrlFile,
    PrivateKey,
    GovernanceFile,
    PermissionsFile,
    SignedDocument,
    Signature,
)


def _moved(evidence: Any, place: str, file: File) -> Any:
    """The evidence about the file at `place` as that about a copy of it; what stands elsewhere stays there."""
    if isinstance(evidence, _MADE_OF_PARTS):
        parts = {name: _moved(getattr(evidence, name), place, file) for name in evidence.__struct_fields__}
        return replace(evidence, **parts)
    if isinstance(evidence, tuple):
        return tuple([_moved(each, place, file) for each in evidence])
    if isinstance(evidence, (Certificate, RevocationList, Defect)) and evidence.path == place:
        return replace(evidence, path=file.place)
    if isinstance(evidence, File):
        return file if evidence.content is not None else file.holding(None)
    return evidence


def _unmanaged(
    root: Root, marked: Iterable[File], enclaves: Iterable[Enclave], candidates: Candidates
) -> tuple[UnmanagedDocument, ...]:
    """Read the signed messages that no enclave carries; those that could not be read are known by their mark."""
    carried = {
        document.signed.file.sha256 or document.signed.file.place
        for enclave in enclaves
        for document in (enclave.governance, enclave.permissions)
        if document is not None
    }
    unknown = [file for file in marked if file.may_be_message]
    return tuple(sorted(read_unmanaged([*root.messages(), *unknown], carried, candidates), key=lambda each: each.place))


def _carried(
    layout: Layout,
    enclaves: Sequence[Enclave],
    authorities: Iterable[CertificateFile],
    unmanaged: Iterable[UnmanagedDocument],
) -> Carried:
    identity_cas = dict.fromkeys(enclave.identity_ca for enclave in enclaves if enclave.identity_ca is not None)
    permissions_cas = dict.fromkeys(
        enclave.permissions_ca for enclave in enclaves if enclave.permissions_ca is not None
    )
    own = [enclave.certificate for enclave in enclaves if enclave.certificate is not None]
    files = [*own, *identity_cas, *permissions_cas, *authorities]
    trusted = chain.from_iterable(file.certificates for file in (*identity_cas, *permissions_cas))
    return Carried(
        identities=tuple(enclave.identity for enclave in enclaves if enclave.identity is not None),
        authorities=(*filter(may_issue, trusted), *(file.first for file in permissions_cas if file.first is not None)),
        others=tuple(every_certificate(enclaves, authorities, unmanaged)),
        files=frozenset(file.file.sha256 for file in files if not file.defects),
        places=frozenset(file.file.place for file in files),
        keys=tuple(enclave.key for enclave in enclaves if enclave.key is not None),
        own_places=own_places(enclave.files for enclave in enclaves),
        key_places=(
            frozenset(enclave.files.files[Role.KEY].place for enclave in enclaves),
            frozenset(
                file.place for file in layout.authority_keys if file.path.count("/") == file.path.startswith("private/")
            ),
        ),
    )


def every_certificate(
    enclaves: Iterable[Enclave], authorities: Iterable[CertificateFile], unmanaged: Iterable[UnmanagedDocument]
) -> Iterator[Certificate]:
    """The certificates in files that are read as what they are: of enclaves, authorities, and inside messages."""
    for enclave in enclaves:
        for file in (enclave.certificate, enclave.identity_ca, enclave.permissions_ca):
            yield from file.certificates if file is not None else ()
        for document in (enclave.governance, enclave.permissions):
            yield from document.signed.embedded if document is not None else ()
    for each in unmanaged:
        yield from each.document.signed.embedded if each.document is not None else ()
    for file in authorities:
        yield from file.certificates


def _further_keys(
    reader: Reader, found: Sequence[File], layout: Layout, enclaves: Sequence[Enclave]
) -> tuple[PrivateKey, ...]:
    known = {enclave.key.file.place for enclave in enclaves if enclave.key is not None}
    known.update(file.place for file in layout.authority_keys)
    files = [file for file in found if file.place not in known]
    return _distinct(reader.private_key(file) for file in files[:MAX_FURTHER_KEYS])


def _marked(root: Root, layout: Layout) -> list[File]:
    """Files that were not read and may hold a message, certificate or key, apart from those of enclaves. They carry its
    mark, or their link leads out of the roots.
    """
    known = {file.path for enclave in layout.enclaves for file in enclave.for_run_time}
    known |= {file.path for file in layout.directory_links}  # behind which whole enclaves may be
    return [file for file in root.unread() if file.path not in known and (file.may_be_message or _may_hold_keys(file))]


def _may_hold_keys(file: File) -> bool:
    return file.holds_certificates or file.status is Status.OUTSIDE


def _distinct(readings: Iterable[_Held | None]) -> tuple[_Held, ...]:
    """Leave out what is not there, and what several links lead to but once."""
    return tuple({reading.file.place: reading for reading in readings if reading is not None}.values())


def _candidates(enclaves: list[_CertificatesOf], authorities: tuple[CertificateFile, ...]) -> Candidates:
    """Return every certificate of the keystore once, those that are likely to have signed first."""
    found: dict[str, Certificate] = {}
    for role in (Role.PERMISSIONS_CA, Role.IDENTITY_CA, None, Role.CERTIFICATE):
        files = authorities if role is None else [read[role] for read in enclaves]
        for file in files:
            for certificate in file.certificates if file is not None else ():
                found.setdefault(certificate.sha256, certificate)
    return Candidates(found.values())


def with_subject_as_path(layout: Layout, certificates: Sequence[Mapping[Role, CertificateFile | None]]) -> Layout:
    """Name a single enclave's folder, and what is below it, by its certificate (design section 3)."""
    if layout.kind is not LayoutKind.ENCLAVE:
        return layout
    name = "/"
    for files, read in zip(layout.enclaves, certificates, strict=True):
        if files.directory == ".":
            name = _common_name(read[Role.CERTIFICATE]) or "/"
    if not name.startswith("/"):
        return layout
    named = tuple(
        replace(files, path=name if files.path == "/" else name.rstrip("/") + files.path) for files in layout.enclaves
    )
    return replace(layout, enclaves=named)


def _common_name(file: CertificateFile | None) -> str | None:
    if file is None or file.first is None:
        return None
    for attribute in file.first.subject_name.get_attributes_for_oid(NameOID.COMMON_NAME):
        return attribute.value if isinstance(attribute.value, str) else None
    return None
