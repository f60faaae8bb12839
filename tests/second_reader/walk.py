"""The second reader's own walk of a keystore's directory: enclaves, their files, where links lead, what is foreign.

Written from design section 3 and the layouts that sros2 wrote (Ardent to Rolling). Paths are relative to the keystore,
as text (surrogates where they are not UTF-8).
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from msgspec import Struct

MAX_LINKS = 40
MAX_BYTES = 4 * 1024 * 1024

ROLES = ("identity_ca", "cert", "key", "permissions_ca", "governance", "permissions", "crl")
_FILES = {
    "identity_ca": "identity_ca.cert.pem",
    "cert": "cert.pem",
    "key": "key.pem",
    "permissions_ca": "permissions_ca.cert.pem",
    "governance": "governance.p7s",
    "permissions": "permissions.p7s",
    "crl": "crl.pem",
}
_P11 = {role: name.replace(".pem", ".p11") for role, name in _FILES.items() if name.endswith(".pem") and role != "crl"}
_RUN_TIME = ({*_FILES.values()} - {"crl.pem"}) | {*_P11.values()}
_SHARED = {"identity_ca.cert.pem", "permissions_ca.cert.pem", "identity_ca.cert.p11", "permissions_ca.cert.p11"}
_OWN = _RUN_TIME - _SHARED - {"governance.p7s"}
_FLAT = {"ca.cert.pem", "ca.key.pem", "governance.p7s", "governance.xml"}

_OF_ENCLAVE = _RUN_TIME | {"crl.pem", "permissions.xml", "governance.xml"}
_OF_OPENSSL_ERA = {"ecdsaparam", "req.pem", "request.cnf"}
_OF_FLAT_ROOT = re.compile(
    r"(identity_|permissions_)?ca\.(cert|key)\.pem|ca_conf\.cnf|ecdsaparam|governance\.(xml|p7s)"
    r"|(index\.txt|serial)(\.attr)?(\.old)?|[0-9A-F]{4}\.pem"
)
_AUTHORITY = re.compile(r"((identity_|permissions_)?ca)\.(cert|key)\.pem")


class Entry(Struct, frozen=True, dict=True):
    """What a name leads to: `place`, where links end, None where there is nothing that was read.

    `unread`: something is there, and it was not read: it leaves the keystore, is no regular file, or too large.
    """

    place: str | None
    content: bytes | None
    unread: bool = False

    @property
    def missing(self) -> bool:
        """Whether nothing is there."""
        return self.place is None and not self.unread


MISSING = Entry(None, None)


class EnclaveFolder(Struct, frozen=True, dict=True):
    """An enclave by its ROS name and the folder in which a run time looks; `p11`: roles with such a file beside."""

    name: str
    folder: str
    files: dict[str, Entry]
    p11: frozenset[str]


class Outside(Exception):
    """A link that leaves the keystore."""


class Tree:
    """A keystore's directory."""

    def __init__(self, root: Path) -> None:
        self._root = os.path.realpath(root)
        self._kinds: dict[str, str] = {}
        self._below: dict[str, list[str]] = {}
        self._targets: dict[str, str] = {}
        self._scan("")

    def _scan(self, folder: str) -> None:
        names = self._below[folder] = []
        with os.scandir(os.path.join(self._root, folder)) as found:
            for entry in sorted(found, key=lambda entry: os.fsencode(entry.name)):
                path = f"{folder}/{entry.name}" if folder else entry.name
                names.append(entry.name)
                if entry.is_symlink():
                    self._kinds[path], self._targets[path] = "link", os.readlink(entry.path)
                elif entry.is_dir(follow_symlinks=False):
                    self._kinds[path] = "directory"
                    self._scan(path)
                else:
                    self._kinds[path] = "file" if entry.is_file(follow_symlinks=False) else "special"

    def resolve(self, path: str) -> str | None:
        """Where a path ends, as the kernel follows it; None where nothing is. Raises Outside."""
        here: list[str] = []
        left, links = path.split("/")[::-1], 0
        while left:
            step = left.pop()
            if step in ("", "."):
                continue
            if step == "..":
                if not here:
                    raise Outside
                here.pop()
                continue
            at = "/".join((*here, step))
            kind = self._kinds.get(at)
            if kind is None or (left and kind in ("file", "special")):
                return None
            if kind != "link":
                here.append(step)
                continue
            links += 1
            if links > MAX_LINKS:
                raise Outside
            target = self._targets[at]
            if target.startswith("/"):
                if not f"{target}/".startswith(f"{self._root}/"):
                    raise Outside
                here, target = [], target[len(self._root) :]
            left.extend(target.split("/")[::-1])
        return "/".join(here)

    def kind(self, path: str) -> str:
        """What stands at a place that is no link."""
        return self._kinds.get(path, "directory" if path == "" else "nothing")

    def entry(self, path: str) -> Entry:
        """What is read under a name."""
        try:
            place = self.resolve(path)
        except Outside:
            return Entry(None, None, unread=True)
        if place is None:
            return MISSING
        if self.kind(place) != "file":
            return Entry(None, None, unread=True)
        content = self.content(place)
        return Entry(place, content, unread=content is None)

    def content(self, place: str) -> bytes | None:
        """The bytes of a regular file, None where they are too many."""
        path = os.path.join(self._root, place)
        if not stat.S_ISREG(os.lstat(path).st_mode) or os.path.getsize(path) > MAX_BYTES:
            return None
        try:
            return Path(path).read_bytes()
        except OSError:
            return None

    def names(self, folder: str) -> set[str]:
        """The names in a folder, which may be reached over links inside the keystore."""
        try:
            place = self.resolve(folder)
        except Outside:
            return set()
        return set(self._below.get(place, ())) if place is not None else set()

    @cached_property
    def files(self) -> tuple[str, ...]:
        """Every regular file, by path."""
        return tuple(sorted(path for path, kind in self._kinds.items() if kind == "file"))

    @cached_property
    def layout(self) -> str:
        """One of sros2, flat, enclave, partial; Ardent's is a flat one."""
        top = self.names("")
        older = {"ca.cert.pem", "governance.p7s"} <= top and not top & {"public", "private"}
        if self._kinds.get("enclaves") == "directory" and not older:
            return "sros2"
        if top & _OWN:
            return "enclave"
        return "flat" if top & _FLAT else "partial"

    def folders(self, start: str) -> Iterator[str]:
        """Every folder below `start`, itself first, also over links that stay inside; no circles."""

        def descend(path: str, around: tuple[str, ...]) -> Iterator[str]:
            try:
                place = self.resolve(path)
            except Outside:
                return
            if place is None or self.kind(place) != "directory" or place in around:
                return
            yield path
            for name in self._below[place]:
                if name != "..data" and not name.startswith("..2"):  # Kubernetes keeps what is mounted behind these
                    yield from descend(f"{path}/{name}" if path else name, (*around, place))

        yield from descend(start, ())

    @cached_property
    def enclaves(self) -> tuple[EnclaveFolder, ...]:
        """Every enclave, by name."""
        found = []
        for folder in self.folders("enclaves" if self.layout == "sros2" else ""):
            apart = folder == "enclaves" if self.layout == "sros2" else folder in ("", "public", "private")
            if self.names(folder) & (_OWN if apart else _RUN_TIME):
                found.append(folder)
        every = set().union(*(self.names(folder) for folder in found)) if found else set()
        ardent = self.layout in ("flat", "enclave", "partial") and "ca.cert.pem" in every and not every & _SHARED
        return tuple(sorted((self._enclave(f, ardent=ardent) for f in found), key=lambda e: (e.name, e.folder)))

    def _enclave(self, folder: str, *, ardent: bool) -> EnclaveFolder:
        names = dict(_FILES)
        if ardent:
            names |= {"identity_ca": "ca.cert.pem", "permissions_ca": "ca.cert.pem"}
        below = folder.removeprefix("enclaves").lstrip("/") if self.layout == "sros2" else folder
        at = f"{folder}/" if folder else ""
        return EnclaveFolder(
            name=f"/{below}",
            folder=folder,
            files={role: self.entry(at + name) for role, name in names.items()},
            p11=frozenset(role for role, name in _P11.items() if name in self.names(folder)),
        )

    @cached_property
    def foreign(self) -> tuple[str, ...]:
        """Files that neither sros2 nor the plugins know by place and name; what links of theirs lead to is known."""
        known = set()
        for enclave in self.enclaves:
            at = f"{enclave.folder}/" if enclave.folder else ""
            own = _OF_ENCLAVE | (_OF_OPENSSL_ERA | {"ca.cert.pem"} if self.layout != "sros2" else set())
            for name in self.names(enclave.folder) & own:
                known.add(at + name)
        if self.layout == "sros2":
            known |= {"enclaves/governance.xml", "enclaves/governance.p7s"}
            for folder, kind in (("public", "cert"), ("private", "key")):
                for name in self.names(folder):
                    match = _AUTHORITY.fullmatch(name)
                    if match is not None and match[3] == kind:
                        known.add(f"{folder}/{name}")
        else:
            known |= {name for name in self.names("") if _OF_FLAT_ROOT.fullmatch(name)}
        places = known | {self.entry(path).place for path in known}
        return tuple(path for path in self.files if path not in places)
