"""Which directories are enclaves, whatever distribution of ROS 2 wrote the keystore."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from enum import Enum
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.descent import Place, display
from keystore_audit.keystore.files import EntryKind, File, Listing, Status
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.walk import below, in_other_root, is_volume, walk


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


class EnclaveFiles(Struct, frozen=True, kw_only=True):
    """The files of one enclave.

    `path` is its ROS name as untrusted text, percent-encoded like a file's path where directories name it.
    `directory` is relative as in `File.path` (`.` for the root itself). `files` holds an entry for each role,
    MISSING ones too; Ardent's one `ca.cert.pem` serves both CA roles. `pkcs11` are the `.p11` files beside,
    without content, `unsigned` are `governance.xml` and `permissions.xml` by role: of both only what exists.
    """

    path: str
    directory: str
    files: Mapping[Role, File]
    pkcs11: Mapping[Role, File]
    unsigned: Mapping[Role, File]

    @property
    def for_run_time(self) -> tuple[File, ...]:
        """Those that a run time may read."""
        return (*self.files.values(), *self.pkcs11.values())

    @property
    def every(self) -> tuple[File, ...]:
        """All of them."""
        return (*self.for_run_time, *self.unsigned.values())


class Nested(NamedTuple):
    """A folder that is a keystore or an enclave of its own where the keystore around it has none; `path` as in
    `File.path`. `startable`: it holds enclaves/, or certificate and key: a participant can be started from it.
    """

    path: str
    startable: bool


class Layout(Struct, frozen=True, kw_only=True):
    """A keystore's directory as discovered.

    `authorities`: CA certificate files outside enclaves (`public/*.cert.pem`, a flat root's `ca.cert.pem`).
    `authority_keys`: CA private key files anywhere (`private/*key.pem`, `ca.key.pem`), without content, links and
    their targets listed once by resolved path.
    `governance`: the shared `governance.p7s`, if any; `unsigned_governance`: the `governance.xml` beside it.
    `directory_links`: links that leave the keystore and other roots where an enclave could be (nobody looked whether
    to a directory).
    `unreadable_directories`: those that could not be listed. Where the limit of entries was reached, the last one is
    the directory that exceeded it. Nothing after it in order of path was looked at.
    `expected`: what a complete keystore of this kind would hold and this one lacks, in words.
    `nested`: the topmost such folders, and those below one that nobody can start, in order of path. It is the root
    (`.`) for an enclave's files beside enclaves/.
    `folders`: those from the root down to what enclaves read and to the authorities' certificates, links included.
    Whoever can write in one can replace what it leads to.
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
    nested: tuple[Nested, ...] = ()
    folders: tuple[File, ...] = ()


_IN_PEM_OR_P11: Final = (Role.IDENTITY_CA, Role.CERTIFICATE, Role.KEY, Role.PERMISSIONS_CA)
_SIGNED: Final = (Role.GOVERNANCE, Role.PERMISSIONS)

_NAMES: Final = {role: f"{role.value}.{'p7s' if role in _SIGNED else 'pem'}".encode() for role in Role}
_PKCS11_NAMES: Final = {role: f"{role.value}.p11".encode() for role in _IN_PEM_OR_P11}
_UNSIGNED_NAMES: Final = {role: f"{role.value}.xml".encode() for role in _SIGNED}

_RUN_TIME: Final = frozenset(_NAMES.values()) - {_NAMES[Role.CRL]} | frozenset(_PKCS11_NAMES.values())
"""The six files that a run time requires (rmw_dds_common, security.cpp), four of them in either form."""

_OWN: Final = frozenset({b"cert.pem", b"cert.p11", b"key.pem", b"key.p11", b"permissions.p7s"})
"""Those that belong to one enclave; the others also stand in shared folders."""

_AUTHORITIES: Final = frozenset(
    {b"identity_ca.cert.pem", b"identity_ca.cert.p11", b"permissions_ca.cert.pem", b"permissions_ca.cert.p11"}
)
_ONE_AUTHORITY: Final = b"ca.cert.pem"
_FLAT_ROOT: Final = frozenset({_ONE_AUTHORITY, b"ca.key.pem", b"governance.p7s", b"governance.xml"})
"""What sros2 put into the root from Ardent to Eloquent."""

ENCLAVE_NAMES: Final = frozenset((*_RUN_TIME, _NAMES[Role.CRL], *_UNSIGNED_NAMES.values()))
"""What an enclave's files are called since Crystal."""

_COMPLETE: Final = tuple(
    frozenset({_NAMES[role], _PKCS11_NAMES.get(role, b"")} | ({_ONE_AUTHORITY} if "_ca." in role.value else set()))
    for role in Role
    if role is not Role.CRL
)
"""What each file of an enclave that can start may be called, in any layout."""

_CERTIFICATE: Final = frozenset({_NAMES[Role.CERTIFICATE], _PKCS11_NAMES[Role.CERTIFICATE]})
_KEY: Final = frozenset({_NAMES[Role.KEY], _PKCS11_NAMES[Role.KEY]})

_LOST: Final = "lost+found"
"""What the file system ext4 keeps in the root of a volume for itself alone. It is no ROS name."""

_ENCLAVE_WANTED: Final = (
    "expected a folder with cert.pem, key.pem, identity_ca.cert.pem, permissions_ca.cert.pem, governance.p7s "
    "and permissions.p7s"
)


def discover(root: Root, aliases: Iterable[str] = ()) -> Layout:
    """Find the enclaves and the shared files of a keystore, and read them, private keys sealed.

    `aliases`: ROS names, as in `EnclaveFiles.path`, of folders that are enclaves under another one, too.
    Raises NothingToAudit, with what was expected where, if there is no enclave at all.
    """
    tree = _Tree(root)
    kind = tree.kind()
    places = _without(aliases, tree, kind, tree.enclaves(kind))
    if not places:
        raise NothingToAudit(tree.nothing(kind))
    single = _has_one_authority(tree, places) and kind is not LayoutKind.SROS2
    if single and kind is LayoutKind.FLAT:
        kind = LayoutKind.ARDENT
    shared = {LayoutKind.SROS2: b"enclaves/", LayoutKind.ENCLAVE: None}.get(kind, b"")
    enclaves = [_enclave(tree, place, kind, one_authority=single) for place in places]
    authorities = tuple(_authorities(tree, places))
    folders = tuple(_folders(tree, authorities, enclaves))  # before further links are looked at
    return Layout(
        kind=kind,
        enclaves=tuple(sorted(enclaves, key=lambda enclave: (enclave.path, enclave.directory))),
        authorities=authorities,
        authority_keys=tuple(_authority_keys(tree)),
        governance=_existing(root, shared, b"governance.p7s"),
        unsigned_governance=_existing(root, shared, b"governance.xml"),
        directory_links=tuple(_directory_links(tree, kind, enclaves)),
        unreadable_directories=tuple(f for f in tree.unreadable if kind is not LayoutKind.SROS2 or f.path != _LOST),
        expected=tuple(_expected(tree, kind)),
        nested=tuple(_nested(tree, kind)),
        folders=folders,
    )


def starts_by_itself(names: AbstractSet[bytes]) -> bool:
    """Whether a folder with these names is a keystore since Foxy, or an enclave. An enclave has somebody's certificate
    or key and one more file of an enclave. It may be incomplete: what lacks a file has to fail somewhere.
    """
    own = names & (_CERTIFICATE | _KEY)
    return b"enclaves" in names or bool(own and sum(bool(names & role) for role in _COMPLETE) > 1)


def keeps_enclaves_apart(names: AbstractSet[bytes]) -> bool:
    """Whether a keystore with these names in its root has enclaves below enclaves/ alone."""
    both = {_ONE_AUTHORITY, b"governance.p7s"} <= names  # before Foxy, with a namespace called enclaves
    return b"enclaves" in names and (not both or b"public" in names or b"private" in names)


class _Tree:
    """Every directory below the root, in order of path, with the names in it: `every` one. `listings` has those in
    which enclaves may be, so not what the files of a mounted volume lead to.
    """

    def __init__(self, root: Root) -> None:
        self.root = root
        self.top = {entry.name: entry.kind for entry in root.entries(b"").entries}
        is_there = self.top.get(b"enclaves") is EntryKind.DIRECTORY or root.directory_behind(b"enclaves") is not None
        self._since_foxy = is_there and keeps_enclaves_apart(self.top.keys())
        self._volumes: set[bytes] = set()
        self.every = dict(walk(root, self._enters))
        inside = (*(volume + b"/" for volume in self._volumes),)
        self.listings = {place: each for place, each in self.every.items() if not (place + b"/").startswith(inside)}
        directories = (listing.directory for listing in self.every.values())
        self.unreadable = tuple(each for each in directories if each.status is not Status.DIRECTORY)
        self._names = {place: self._names_in(place, listing) for place, listing in self.listings.items()}

    def _enters(self, path: bytes, end: Place) -> bool:
        """Whether enclaves or authorities are reached over the link; what is elsewhere is seen where it stands."""
        if is_volume(self.root, path, end):
            self._volumes.add(below(path.rpartition(b"/")[0], end[-1]))
            return False
        if not self._since_foxy or in_other_root(path, end):
            return True
        return path in (b"enclaves", b"public", b"private") or path.startswith(b"enclaves/")

    def _names_in(self, place: bytes, listing: Listing) -> frozenset[bytes]:
        """Return the names in a directory; in one that cannot be listed, those that can be opened."""
        if listing.directory.status is Status.DIRECTORY:
            return frozenset(entry.name for entry in listing.entries)
        sealed = self.root.sealed
        return frozenset(
            name for name in ENCLAVE_NAMES | _FLAT_ROOT if sealed(below(place, name)).status is Status.PRESENT
        )

    def names(self, place: bytes) -> frozenset[bytes]:
        """Return the names in a directory, none where there is no such directory."""
        return self._names.get(place, frozenset())

    def kind(self) -> LayoutKind:
        """Return the layout as the root shows it; ARDENT is a FLAT one, to be told by its enclaves."""
        if self._since_foxy:
            return LayoutKind.SROS2
        names = self.names(b"")
        if names & _OWN:
            return LayoutKind.ENCLAVE
        return LayoutKind.FLAT if names & _FLAT_ROOT else LayoutKind.PARTIAL

    def enclaves(self, kind: LayoutKind) -> list[bytes]:
        """Return the directories that are enclaves (design section 3)."""
        if kind is LayoutKind.PARTIAL and (self.top.get(b"enclaves") is EntryKind.LINK or self._keystores()):
            return []
        return [place for place in self.listings if self._is_enclave(place, kind)]

    def _is_enclave(self, place: bytes, kind: LayoutKind) -> bool:
        # Shared folders hold CA certificates and the governance too: they count by what is an enclave's own.
        if kind is LayoutKind.SROS2:
            if not place.startswith(b"enclaves/") and place != b"enclaves":
                return False
            shared = place == b"enclaves"
        else:
            shared = place in (b"", b"public", b"private")
        return bool(self.names(place) & (_OWN if shared else _RUN_TIME))

    def _keystores(self) -> list[bytes]:
        """Return directories below the root that are keystores themselves."""
        return [place.rpartition(b"/")[0] for place in self.listings if place.endswith(b"/enclaves")]

    def nothing(self, kind: LayoutKind) -> str:
        """Say what was expected where, and what is there."""
        where = self.root.path
        keystores = self._keystores()
        top = self.listings[b""].directory
        if top.status is not Status.DIRECTORY:
            text = f"{where} {top.detail}"
        elif self.top.get(b"enclaves") is EntryKind.LINK:
            text = f"{where}/enclaves {self.root.sealed(b'enclaves').detail}"
        elif not self.top:
            text = f"{where} is empty: expected a keystore, with a folder for each enclave below enclaves/"
        elif kind is LayoutKind.SROS2:
            half_made = b"public" in self.listings and not self.names(b"public")
            made = "half-made keystore" if half_made else "keystore"
            text = f"{where} is a {made} without any enclave: {_ENCLAVE_WANTED} for each below {where}/enclaves"
        elif keystores and kind is LayoutKind.PARTIAL:
            shown = ", ".join(display(place) for place in keystores[:3]) + (", ..." if keystores[3:] else "")
            of_sros2 = f"holds {len(keystores)} with enclaves/"  # those of older layouts are not looked for
            text = f"{where} is no keystore, but {of_sros2}: name one of them ({shown}), or audit all with --recursive"
        else:
            text = f"{where} is no keystore: {_ENCLAVE_WANTED} for each enclave below {where}/enclaves"
        if self.unreadable and top.status is Status.DIRECTORY:
            first = self.unreadable[0]
            text += f". Not looked at: {len(self.unreadable)} directories, {first.path} first ({first.detail})"
        return text + "."


def _without(aliases: Iterable[str], tree: _Tree, kind: LayoutKind, places: list[bytes]) -> list[bytes]:
    """The enclaves but those that are another one by another path, and are called so."""
    called = (*(f"{alias.rstrip('/')}/" for alias in aliases),)
    alias = {place for place in places if f"{_ros_name(place, kind)}/".startswith(called)}
    others = {tree.root.real(place) for place in places if place not in alias}
    return [place for place in places if place not in alias or tree.root.real(place) not in others]


def _ros_name(place: bytes, kind: LayoutKind) -> str:
    named = place[len(b"enclaves/") :] if kind is LayoutKind.SROS2 else place
    return f"/{display(named)}" if named else "/"


def _enclave(tree: _Tree, place: bytes, kind: LayoutKind, *, one_authority: bool) -> EnclaveFiles:
    root, names = tree.root, tree.names(place)
    stand_in = {Role.IDENTITY_CA: _ONE_AUTHORITY, Role.PERMISSIONS_CA: _ONE_AUTHORITY} if one_authority else {}
    paths = {role: below(place, stand_in.get(role, name)) for role, name in _NAMES.items()}
    files = {role: root.sealed(path) if role is Role.KEY else root.file(path) for role, path in paths.items()}
    pkcs11 = {role: root.sealed(below(place, name)) for role, name in _PKCS11_NAMES.items() if name in names}
    unsigned = {role: root.file(below(place, name)) for role, name in _UNSIGNED_NAMES.items() if name in names}
    return EnclaveFiles(
        path=_ros_name(place, kind),
        directory=display(place),
        files=files,
        pkcs11=pkcs11,
        unsigned=unsigned,
    )


def _has_one_authority(tree: _Tree, places: list[bytes]) -> bool:
    """Whether the enclaves are Ardent's or Bouncy's: `ca.cert.pem` for both roles."""
    names = frozenset[bytes]().union(*(tree.names(place) for place in places))
    return _ONE_AUTHORITY in names and not names & _AUTHORITIES


def _authorities(tree: _Tree, enclaves: list[bytes]) -> Iterator[File]:
    for place in (b"", b"public"):
        if place not in enclaves:
            for name in sorted(tree.names(place)):
                if name.endswith(b".cert.pem" if place else b"ca.cert.pem"):
                    yield tree.root.file(below(place, name))


def _authority_keys(tree: _Tree) -> list[File]:
    found: dict[str, File] = {}
    for place in tree.listings:
        for name in sorted(tree.names(place)):
            if name.endswith(b"key.pem" if place == b"private" else b"ca.key.pem"):
                file = tree.root.sealed(below(place, name))
                if file.link is None or file.place not in found:
                    found[file.place] = file
    return [found[place] for place in sorted(found)]


def _existing(root: Root, directory: bytes | None, name: bytes) -> File | None:
    file = root.file(directory + name) if directory is not None else None
    return None if file is None or file.status is Status.MISSING else file


def _directory_links(tree: _Tree, kind: LayoutKind, enclaves: Iterable[EnclaveFiles]) -> Iterator[File]:
    spoken_of = {file.path for enclave in enclaves for file in enclave.for_run_time}
    for place, listing in tree.listings.items():
        if kind is LayoutKind.SROS2 and not (place + b"/").startswith(b"enclaves/"):
            continue
        for entry in listing.entries:
            file = tree.root.sealed(below(place, entry.name)) if entry.kind is EntryKind.LINK else None
            if file and file.status in (Status.OUTSIDE, Status.UNREADABLE) and file.path not in spoken_of:
                yield file


def _nested(tree: _Tree, kind: LayoutKind) -> Iterator[Nested]:
    """In the other layouts every such folder is an enclave of the keystore itself."""
    found: bytes | None = None
    for place in tree.listings if kind is LayoutKind.SROS2 else ():
        own = (place + b"/").startswith(b"enclaves/")
        if own or (found is not None and place.startswith(found + b"/")):
            continue
        names = tree.names(place) - (set() if place else {b"enclaves"})
        if starts_by_itself(names):
            startable = b"enclaves" in names or bool(names & _CERTIFICATE and names & _KEY)
            found = (startable and place) or found  # an enclave in the root hides nothing, nor what nobody can start
            yield Nested(path=display(place), startable=startable)


def _folders(tree: _Tree, authorities: Iterable[File], enclaves: Iterable[EnclaveFiles]) -> Iterator[File]:
    read = (file for enclave in enclaves for file in enclave.for_run_time)
    own = {path.rpartition("/")[0] for file in (*authorities, *read) for path in (file.path, file.place)}
    folders, above = set[str](), own | tree.root.passed()
    while above:
        folders |= above
        above = {folder.rpartition("/")[0] or "." for folder in above} - folders
    return (each.directory for each in tree.every.values() if each.directory.path in folders)


def _expected(tree: _Tree, kind: LayoutKind) -> Iterator[str]:
    if kind is LayoutKind.SROS2:
        for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem"):
            if name.encode() not in tree.names(b"public"):
                yield f"public/{name}, the certificate that new enclaves link to"
        if b"governance.p7s" not in tree.names(b"enclaves"):
            yield "enclaves/governance.p7s, the governance that new enclaves link to"
    elif kind in (LayoutKind.FLAT, LayoutKind.ARDENT):
        if _ONE_AUTHORITY not in tree.top:
            yield "ca.cert.pem, the certificate of the authority, in the root"
        if b"governance.p7s" not in tree.top:
            yield "governance.p7s, the governance that new enclaves copy, in the root"
    elif kind is LayoutKind.PARTIAL:
        yield "enclaves/, where ROS 2 since Foxy looks, or the ca.cert.pem and governance.p7s of an older one"
