"""Identities beside the enclaves: certificates that no enclave carries, with private keys that lie in the same tree.

Whoever has both is a participant, whatever folder they are in: a run time starts from any six files. So certificates
and keys are taken from wherever they stand: files that are parsed for something else, other text, DER, base64.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

from keystore_audit.dataclass import dataclass, field, replace
from keystore_audit.keystore.certificate import Certificate, read_certificate
from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.der import MAX_ELEMENTS, elements, first_element
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.forms import blocks_in
from keystore_audit.keystore.layout import EnclaveFiles
from keystore_audit.keystore.message import ARMOUR, MAX_ARMOURED, is_signed_data
from keystore_audit.keystore.private_key import HeldKeys, PrivateKey, read_held_keys
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.traces import has_certificate_version, in_base64, is_certificate_in_der

MAX_BYTES: Final = 4 * 1024 * 1024
"""Of files with certificates outside enclaves that are parsed: 5,000 certificates, a quarter of a second."""

_CERTIFICATE_NAMES: Final = (".pem", ".crt", ".cer", ".der", ".p12", ".pfx", ".p7b", ".p7c")
_KEY_NAMES: Final = (".key", "key.pem", "key.der")
"""How the names end of files that hold certificates, and of those that hold a private key alone."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrayIdentity:
    """A certificate that no enclave has as its own, and the place of the private key that belongs to it."""

    certificate: Certificate
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StrayIdentities:
    """Those of a keystore, by place but for what stands in files that are read as what they are, which come first.

    `copies`: certificates of enclaves whose key lies in a file of no enclave as well, with this as their path.
    `keyless`: certificates of no enclave whose private key was not found. `locked`: files with private keys of which it
    is not known whose they are. `unread`: files in which whole identities may be, with the reason as their detail.
    `loose`: as `loose_keys`.
    """

    found: tuple[StrayIdentity, ...] = ()
    copies: tuple[Certificate, ...] = ()
    keyless: tuple[Certificate, ...] = ()
    locked: tuple[File, ...] = ()
    unread: tuple[File, ...] = ()
    loose: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def possible(self) -> tuple[StrayIdentity, ...]:
        """Those whose private key may be in a file that could not be read, the first of which is named."""
        keys = [file.place for file in self.locked[:1]]
        return tuple(StrayIdentity(certificate=each, key=key) for key in keys for each in self.keyless)


def may_be_anything(file: File, key_places: Collection[str]) -> bool:
    """Whether nothing is known of a file: it lies in the keystore, no byte was read, and no key should be there.

    `key_places`: where those of authorities should be. Elsewhere a name says nothing: anybody can call a file `x.key`.
    """
    return file.status is Status.UNREADABLE and file.place not in key_places


def is_certificate_by_name(file: File) -> bool:
    """Whether a file that could not be read is to count as one of certificates."""
    return file.path.lower().endswith(_CERTIFICATE_NAMES) and not is_key_by_name(file)


def is_key_by_name(file: File) -> bool:
    """Whether a file that could not be read is to count as one of a private key."""
    return file.path.lower().endswith(_KEY_NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """What the files of enclaves and authorities hold: it is read where they are.

    `identities`: the certificates of enclaves. `authorities`: those that vouch or sign. `others`: whatever else stands
    beside them or inside messages. `files`: the digests of those in which nothing else stands. `places`: those of which
    it is said elsewhere what cannot be read. `keys`: the private keys of enclaves. `own_places`: where
    enclaves' files are, and what links there lead to. `key_places`: where their keys should be, and those of
    authorities.
    """

    identities: tuple[Certificate, ...]
    authorities: tuple[Certificate, ...]
    others: tuple[Certificate, ...]
    files: frozenset[str | None]
    places: frozenset[str]
    keys: tuple[PrivateKey, ...]
    own_places: frozenset[str]
    key_places: tuple[frozenset[str], frozenset[str]]


def read_stray_identities(root: Root, carried: Carried, unread: Iterable[File]) -> StrayIdentities:
    """What the certificates and the private keys of the tree make. `unread`: files of no enclave that were not read.

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
    strays = [certificate for certificate in certificates.values() if certificate.sha256 not in known]
    return StrayIdentities(
        found=tuple(
            StrayIdentity(certificate=each, key=keys.places[each.key]) for each in strays if each.key in keys.places
        ),
        copies=tuple(
            replace(each, path=keys.elsewhere[each.key][0], line=1)
            for each in carried.identities
            if each.key in keys.elsewhere
        ),
        keyless=tuple(each for each in strays if each.key not in keys.places),
        locked=keys.locked,
        unread=tuple(sorted(not_read, key=lambda file: file.place)),
        loose=keys.elsewhere,
    )


def own_places(enclaves: Iterable[EnclaveFiles]) -> frozenset[str]:
    """Where enclaves' files are, and what links there lead to."""
    return frozenset(place for each in enclaves for file in each.files.values() for place in (file.path, file.place))


def loose_keys(root: Root, enclaves: Iterable[EnclaveFiles]) -> dict[str, list[str]]:
    """Private keys in files of no enclave, in whatever form: the public half, and each place.

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
        self.unread: list[File] = []
        self._locked: dict[str, File] = {}
        for key in carried.keys:
            self._of_enclave(key)
        enclaves, authorities = carried.key_places
        for file in unread:
            if file.holds_certificates or may_be_anything(file, authorities) or is_certificate_by_name(file):
                self.unread.append(file)
            elif is_key_by_name(file):
                self._locked[file.place] = file
        understood = enclaves - {key.file.place for key in carried.keys if key.key is None}
        for file in root.holding_private_keys():
            if file.place not in understood:
                self._held(file, read_held_keys(root.unsealed(file) if file.status is Status.PRESENT else file))
        theirs = authorities & self._locked.keys()
        # Each once: of what could not be read no more is known of a link than where it leads.
        files = (self._locked[place] for place in theirs)
        contents = {file.sha256 or file.place for file in files if file.resolved or file.link is None}
        if len(contents) <= len({certificate.key for certificate in carried.authorities} - self.places.keys()):
            # An authority's key with a password, say, wherever copies of it lie.
            for place, file in [*self._locked.items()]:
                if place in theirs or file.sha256 in contents:
                    del self._locked[place]

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
        if held.sealed:
            self.unread.append(replace(file, detail="is a PKCS #12 file, made for a certificate with its key"))
        elif held.locked:
            self._locked[file.place] = file


def certificates_in(file: File) -> Iterator[Certificate | int]:
    """Every certificate that can be taken out of a file; the line of each that cannot be read.

    What is cut off is no certificate, as in a text about certificates.
    """
    content = file.content or b""
    blocks = list(islice(blocks_in(content, *ARMOUR), MAX_ARMOURED + 1))
    if len(blocks) > MAX_ARMOURED:  # what begins there counts as a certificate that cannot be read
        yield blocks.pop().line
    for block in blocks:
        if block.der is None:
            yield block.line
        elif element := first_element(block.der):
            yield from _in_element(element, block.line, file, labelled=True)
    whole = list(elements(content))
    for element in (*whole, *in_base64(content)):
        yield from _in_element(element, 1, file, labelled=False)
    if len(whole) == MAX_ELEMENTS:
        yield 1


def _in_element(der: bytes, line: int, file: File, *, labelled: bool) -> Iterator[Certificate | int]:
    if is_signed_data(der):
        yield from _in_message(der, line, file)
    elif labelled or is_certificate_in_der(der):
        yield from _certificate(der, line, file, sure=labelled or has_certificate_version(der))


def _in_message(der: bytes, line: int, file: File) -> Iterator[Certificate | int]:
    """What a message carries; one that cannot be read counts as a document (`message.concealed`)."""
    try:
        certificates = read_signed_data(der).certificates
    except CmsError:
        return
    for certificate in certificates:
        yield from _certificate(certificate, line, file, sure=True)


def _certificate(der: bytes, line: int, file: File, *, sure: bool) -> Iterator[Certificate | int]:
    """`sure`: it is one, while revocation lists and requests in DER begin alike."""
    read = read_certificate(der, line, file.place)
    if isinstance(read, Certificate):
        yield read
    elif sure:
        yield line
