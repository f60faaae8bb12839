"""Signed documents and identities that no enclave carries, whatever they are called and wherever in the keystore they
lie.

Peers take any validly signed document that is presented to them: an old `permissions.p7s.bak` still gives what it says.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.keystore.certificate import Certificate, read_certificate
from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.der import first_element
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.layout import EnclaveFiles
from keystore_audit.keystore.pem import loose_blocks
from keystore_audit.keystore.private_key import HeldKeys, PrivateKey, read_held_keys
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.smime import Candidates
from keystore_audit.keystore.traces import ARMOUR, MAX_ARMOURED, is_signed_data
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile, read_governance, read_permissions

MAX_UNMANAGED: Final = 2_000
"""Distinct documents outside enclaves that are read, three seconds; beyond it one, unread, stands for the rest."""

_GOVERNANCE_ONLY: Final = b"domain_access_rules"
"""The element that every governance document has and no permissions document."""


class UnmanagedDocument(Struct, frozen=True, kw_only=True, eq=False):
    """A signed message that no enclave carries as its own; `document` is None where it could not be read."""

    file: File
    document: GovernanceFile | PermissionsFile | None

    @property
    def place(self) -> str:
        """Where it lies, relative to the keystore."""
        return self.file.place


def read_unmanaged(
    messages: Iterable[File], carried: Collection[str], candidates: Candidates
) -> Iterator[UnmanagedDocument]:
    """Read every message but those `carried` by enclaves; what OpenSSL takes for no message is left out.

    The mark of a message where OpenSSL reads none is one that could not be read (`traces.concealed`).

    `messages`: files that may be one, each content once; without content, they were not read. `carried`: the SHA-256 of
    the documents of the enclaves, since a copy of one gives nothing more.
    """
    others = []
    for file in messages:
        if file.concealed:  # in what enclaves carry, too
            detail = f"{file.concealed}; anybody can make a document of it, and it was not read"
            yield UnmanagedDocument(file=replace(file, content=None, detail=detail), document=None)
        elif file.sha256 not in carried:
            others.append(file)
    yield from (UnmanagedDocument(file=file, document=None) for file in others if file.content is None)
    readable = [file for file in others if file.content is not None]
    if len(readable) > MAX_UNMANAGED:  # one that may say anything stands for all of them
        detail = (
            f"{len(readable)} documents lie outside enclaves; from this on they were not read (limit {MAX_UNMANAGED})"
        )
        yield UnmanagedDocument(file=replace(readable[MAX_UNMANAGED], content=None, detail=detail), document=None)
    for file in readable[:MAX_UNMANAGED]:
        document = _document(file, candidates)
        if not any(defect.kind is Kind.NOT_SMIME for defect in document.signed.defects):
            yield UnmanagedDocument(file=file, document=document)


def _document(file: File, candidates: Candidates) -> GovernanceFile | PermissionsFile:
    """Read a document as what it is. What has no meaning as either may be permissions, which give more."""
    if file.content is not None and _GOVERNANCE_ONLY in file.content:
        governance = read_governance(file, candidates)
        if governance.governance is not None:
            return governance
    return read_permissions(file, candidates)


# --- identities: certificates that no enclave carries, with private keys that lie in the same tree

MAX_BYTES: Final = 4 * 1024 * 1024
"""Of files with certificates outside enclaves that are parsed: 5,000 certificates, a quarter of a second."""


class UnmanagedIdentity(Struct, frozen=True, kw_only=True, eq=False):
    """A certificate that no enclave has as its own.

    `key`: the file with its private key, or (not `held`) one that may hold it and could not be read. It is empty where
    it is known otherwise that somebody has the key. `authorities`: those in identity CA files that vouch for it
    (`inventory.unmanaged_identities`). Itself is among them if it is in such a file and may be taken there.
    """

    certificate: Certificate
    key: str = ""
    held: bool = True
    authorities: tuple[Certificate, ...] = ()


class UnmanagedIdentities(Struct, frozen=True, kw_only=True):
    """Those of a keystore, by place but for what stands in files that are read as what they are, which come first.

    `copies`: certificates of enclaves whose key lies in a file of no enclave as well, with this as their path.
    `keyless`: certificates of no enclave whose private key was not found. `locked`: files with private keys of which it
    is not known whose they are. `unread`: files in which whole identities may be, with the reason as their detail.
    `loose`: as `loose_keys`.
    """

    found: tuple[UnmanagedIdentity, ...] = ()
    copies: tuple[Certificate, ...] = ()
    keyless: tuple[Certificate, ...] = ()
    locked: tuple[File, ...] = ()
    unread: tuple[File, ...] = ()
    loose: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def possible(self) -> tuple[UnmanagedIdentity, ...]:
        """Those whose private key may be in a file that could not be read, the first of which is named."""
        keys = [file.place for file in self.locked[:1]]
        return tuple(UnmanagedIdentity(certificate=each, key=key, held=False) for key in keys for each in self.keyless)


class Carried(Struct, frozen=True, kw_only=True):
    """What the files of enclaves and authorities hold: it is read where they are.

    `identities`: the certificates of enclaves. `authorities`: those that vouch or sign. `others`: whatever else stands
    beside them or inside messages. `files`: the digests of those in which nothing else stands. `places`: those of which
    it is said elsewhere what cannot be read. `keys`: the private keys of enclaves. `own_places`: where
    enclaves' files are, and what links there lead to. `key_places`: where their keys should be, and those of
    authorities, of which it need not be known which key they hold.
    """

    identities: tuple[Certificate, ...]
    authorities: tuple[Certificate, ...]
    others: tuple[Certificate, ...]
    files: frozenset[str | None]
    places: frozenset[str]
    keys: tuple[PrivateKey, ...]
    own_places: frozenset[str]
    key_places: tuple[frozenset[str], frozenset[str]]


def read_unmanaged_identities(root: Root, carried: Carried, unread: Iterable[File]) -> UnmanagedIdentities:
    """What the certificates and the private keys of the tree make. `unread`: files of no enclave that were not read and
    carry the mark of one.

    A further certificate of an enclave's key that stands in the files of enclaves is none of these.
    """
    keys = _Keys(root, carried, unread)
    not_read = keys.unread
    ours = {certificate.key for certificate in carried.identities}
    again = (certificate for certificate in carried.others if certificate.key in ours)
    known = {certificate.sha256 for certificate in (*carried.identities, *carried.authorities, *again)}
    certificates = {certificate.sha256: certificate for certificate in carried.others}
    left = MAX_BYTES
    for file in root.certificates():
        if file.sha256 in carried.files:
            continue
        told = file.place in carried.places
        left -= 0 if told else len(file.content or b"")
        if left < 0:
            detail = f"was not read: with it, files with certificates hold more than {MAX_BYTES} bytes"
            not_read.append(replace(file, content=None, detail=detail))
            continue
        for found in certificates_in(file):
            if isinstance(found, Certificate):
                certificates.setdefault(found.sha256, found)
            elif not told:
                detail = f"holds a certificate in line {found} that cannot be read"
                not_read.append(replace(file, content=None, detail=detail))
                break
    others = [certificate for certificate in certificates.values() if certificate.sha256 not in known]
    return UnmanagedIdentities(
        found=tuple(
            UnmanagedIdentity(certificate=each, key=keys.places[each.key]) for each in others if each.key in keys.places
        ),
        copies=tuple(
            replace(each, path=keys.elsewhere[each.key][0], line=1)
            for each in carried.identities
            if each.key in keys.elsewhere
        ),
        keyless=tuple(each for each in others if each.key not in keys.places),
        locked=keys.locked,
        unread=tuple(sorted(not_read, key=lambda file: file.place)),
        loose=keys.elsewhere,
    )


def own_places(enclaves: Iterable[EnclaveFiles]) -> frozenset[str]:
    """Where enclaves' files are, and what links there lead to."""
    return frozenset(place for each in enclaves for file in each.files.values() for place in (file.path, file.place))


def loose_keys(root: Root, enclaves: Iterable[EnclaveFiles]) -> dict[str, list[str]]:
    """Private keys in files of no enclave: the public half, and each place.

    Every file has been read.
    """
    own = own_places(enclaves)
    found: dict[str, list[str]] = {}
    for file in root.holding_private_keys():
        if file.place not in own and file.status is Status.PRESENT:
            for public in read_held_keys(root.unsealed(file)).keys:
                found.setdefault(public, []).append(file.place)
    return found


class _Keys:
    """The private keys of the tree.

    `places`: where that of each public key is. `elsewhere`: of those in files of no enclave. `locked`: files of
    which it is not known whose keys are in them. `unread`: files in which a certificate may be with its key.
    """

    def __init__(self, root: Root, carried: Carried, unread: Iterable[File]) -> None:
        self.places: dict[str, str] = {}
        self.elsewhere: dict[str, list[str]] = {}
        self._own_places = carried.own_places
        self._locked: dict[str, File] = {}
        for key in carried.keys:
            self._of_enclave(key)
        enclaves, self._authorities = carried.key_places
        self.unread = [*unread]
        understood = enclaves - {key.file.place for key in carried.keys if key.key is None}
        for file in root.holding_private_keys():
            if file.place not in understood:
                self._held(file, read_held_keys(root.unsealed(file)))

    @property
    def locked(self) -> tuple[File, ...]:
        """By place."""
        return tuple(self._locked[place] for place in sorted(self._locked))

    def _of_enclave(self, key: PrivateKey) -> None:
        for public in key.keys:
            if public is not None:
                self.places.setdefault(public, key.file.place)
        if any(other.key is None for other in key.others):
            self._locked[key.file.place] = key.file

    def _held(self, file: File, held: HeldKeys) -> None:
        for public in held.keys:
            self.places.setdefault(public, file.place)
            if file.place not in self._own_places:
                self.elsewhere.setdefault(public, []).append(file.place)
        if held.locked and file.place not in self._authorities:
            self._locked[file.place] = file


def certificates_in(file: File) -> Iterator[Certificate | int]:
    """The certificates in PEM that can be taken out of a file, or the one in DER; the line of each that cannot be read.

    What is cut off is no certificate, as in a text about certificates.
    """
    content = file.content or b""
    blocks = list(islice(loose_blocks(content, *ARMOUR), MAX_ARMOURED + 1))
    if len(blocks) > MAX_ARMOURED:  # what begins there counts as a certificate that cannot be read
        yield blocks.pop().line
    for block in blocks:
        if block.der is None:
            yield block.line
        elif element := first_element(block.der):
            yield from (_in_message if is_signed_data(element) else _certificate)(element, block.line, file)
    if not blocks and (element := first_element(content)):
        yield from (found for found in _certificate(element, 1, file) if isinstance(found, Certificate))


def _in_message(der: bytes, line: int, file: File) -> Iterator[Certificate | int]:
    """What a message carries; one that cannot be read counts as a document (`traces.concealed`)."""
    try:
        certificates = read_signed_data(der).certificates
    except CmsError:
        return
    for certificate in certificates:
        yield from _certificate(certificate, line, file)


def _certificate(der: bytes, line: int, file: File) -> Iterator[Certificate | int]:
    read = read_certificate(der, line, file.place)
    yield read if isinstance(read, Certificate) else line
