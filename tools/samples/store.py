"""A keystore as a value: what stands in it, from which every story states only its difference."""

from __future__ import annotations

import posixpath
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from msgspec import Struct, field

from .certificates import Certificate
from .documents import Governance, Permissions
from .keys import Key
from .smime import signed_by

Seal = Callable[[bytes], bytes]
"""Makes the `.p7s` of a document."""


class Link(Struct, frozen=True, kw_only=True):
    """A symbolic link."""

    target: str


Entry = bytes | Link
Tree = dict[str, Entry]
"""Files and links by path relative to the keystore; directories are implied."""

ROLES = ("identity", "permissions")
"""What an authority certifies."""

Changes = Mapping[str, Entry | None]
"""What replaces, or with None removes, a file."""


class Enclave(Struct, frozen=True, kw_only=True):
    """An enclave. `key` None: the certificate's. `seal` None: the permissions CA signs.

    `changes` are by file name.
    """

    path: str
    certificate: Certificate
    permissions: Permissions | str
    key: Key | None = None
    seal: Seal | None = None
    changes: Changes = field(default_factory=dict)


class Store(Struct, frozen=True, kw_only=True):
    """A keystore in the layout of Foxy and later.

    One certificate for both CA roles makes `ca.cert.pem` with links to it, as sros2 does. `private_keys`:
    those of the CAs stand in `private/`. `unsigned`: governance.xml and permissions.xml stand beside the
    signed files. `changes` are by path.
    """

    identity_ca: Certificate
    permissions_ca: Certificate
    enclaves: tuple[Enclave, ...]
    governance: Governance | str = field(default_factory=Governance)
    governance_seal: Seal | None = None
    private_keys: bool = False
    unsigned: bool = False
    changes: Changes = field(default_factory=dict)

    def tree(self) -> Tree:
        """All files and links."""
        tree = {**self._authorities(), **self._governance()}
        for enclave in self.enclaves:
            folder = posixpath.join("enclaves", enclave.path.strip("/")).rstrip("/")
            tree.update(
                changed(self._enclave(enclave, folder), {f"{folder}/{n}": e for n, e in enclave.changes.items()})
            )
        return changed(tree, self.changes)

    def signed_permissions(self, enclave: Enclave) -> bytes:
        """The `permissions.p7s` of `enclave`."""
        return (enclave.seal or signed_by(self.permissions_ca).smime)(encoded(enclave.permissions))

    def signed_governance(self) -> bytes:
        """The shared `governance.p7s`."""
        return (self.governance_seal or signed_by(self.permissions_ca).smime)(encoded(self.governance))

    def _authorities(self) -> Tree:
        if self.identity_ca == self.permissions_ca:
            tree: Tree = {"public/ca.cert.pem": self.identity_ca.pem()}
            tree.update({f"public/{role}_ca.cert.pem": Link(target="ca.cert.pem") for role in ROLES})
            if self.private_keys:
                tree["private/ca.key.pem"] = self.identity_ca.key.pem()
                tree.update({f"private/{role}_ca.key.pem": Link(target="ca.key.pem") for role in ROLES})
            return tree
        tree = {}
        for role, authority in zip(ROLES, (self.identity_ca, self.permissions_ca), strict=True):
            tree[f"public/{role}_ca.cert.pem"] = authority.pem()
            if self.private_keys:
                tree[f"private/{role}_ca.key.pem"] = authority.key.pem()
        return tree

    def _governance(self) -> Tree:
        tree: Tree = {"enclaves/governance.p7s": self.signed_governance()}
        if self.unsigned:
            tree["enclaves/governance.xml"] = encoded(self.governance)
        return tree

    def _enclave(self, enclave: Enclave, folder: str) -> Tree:
        tree: Tree = {
            f"{folder}/cert.pem": enclave.certificate.pem(),
            f"{folder}/key.pem": (enclave.key or enclave.certificate.key).pem(),
            f"{folder}/permissions.p7s": self.signed_permissions(enclave),
        }
        shared = [f"public/{role}_ca.cert.pem" for role in ROLES]
        if folder != "enclaves":  # The root enclave `/` has the shared governance.p7s in its own folder.
            shared.append("enclaves/governance.p7s")
        for path in shared:
            tree[f"{folder}/{posixpath.basename(path)}"] = Link(target=posixpath.relpath(path, folder))
        if self.unsigned:
            tree[f"{folder}/permissions.xml"] = encoded(enclave.permissions)
        return tree


def encoded(document: Governance | Permissions | str) -> bytes:
    """The XML of a document, or a text as it is, in UTF-8."""
    return (document if isinstance(document, str) else document.xml()).encode()


def changed(tree: Tree, changes: Changes) -> Tree:
    """`tree` with files replaced, added, or removed. Raises KeyError for the removal of what is not there."""
    result = dict(tree)
    for path, entry in changes.items():
        if entry is None:
            del result[path]
        else:
            result[path] = entry
    return result


def write(tree: Tree, root: Path, key_mode: int = 0o600) -> None:
    """Write `tree` as the directory `root`, which must not be there yet; private keys get `key_mode`."""
    root.mkdir(parents=True)
    for path, entry in sorted(tree.items()):
        place = root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(entry, Link):
            place.symlink_to(entry.target)
        else:
            place.write_bytes(entry)
            place.chmod(key_mode if is_private_key(path) else 0o644)


def is_private_key(path: str) -> bool:
    """Whether a file is a private key by its name, as sros2 names them."""
    return path.endswith("key.pem")


def read(root: Path) -> Tree:
    """The tree that stands at `root`; what is neither file nor directory nor link is left out."""
    tree: Tree = {}
    for place in sorted(root.rglob("*")):
        path = place.relative_to(root).as_posix()
        if place.is_symlink():
            tree[path] = Link(target=str(place.readlink()))
        elif place.is_file():
            tree[path] = place.read_bytes()
    return tree


def copy_with_modes(sample: Path, destination: Path, key_mode: int) -> None:
    """Copy a committed sample as it was built: git keeps neither the modes of private keys nor the umask
    of who cloned it.
    """
    shutil.copytree(sample, destination, symlinks=True)
    for place in (destination, *destination.rglob("*")):
        if place.is_symlink():
            continue
        if place.is_dir():
            place.chmod(0o755)
        else:
            place.chmod(key_mode if is_private_key(place.name) else 0o644)
