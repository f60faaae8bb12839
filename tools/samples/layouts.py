"""The layouts of distributions before Foxy: a flat root, a folder for each node, copies instead of links."""

from __future__ import annotations

import posixpath
from datetime import datetime

from .certificates import Certificate
from .store import Link, Store, Tree, changed, encoded


def flat(store: Store) -> Tree:
    """The layout of Crystal, Dashing and Eloquent; the identity CA is the root's `ca.cert.pem`."""
    tree: Tree = {
        "ca.cert.pem": store.identity_ca.pem(),
        "governance.p7s": store.signed_governance(),
        "governance.xml": encoded(store.governance),
        "index.txt": b"".join(_index_line(enclave.certificate) for enclave in store.enclaves),
        "serial": b"%04X\n" % (0x1000 + len(store.enclaves)),
    }
    if store.permissions_ca != store.identity_ca:
        tree["permissions_ca.cert.pem"] = store.permissions_ca.pem()
    for enclave in store.enclaves:
        folder = enclave.path.strip("/")
        files: Tree = {
            "cert.pem": _dump(enclave.certificate) + enclave.certificate.pem(),
            "key.pem": (enclave.key or enclave.certificate.key).pem(),
            "identity_ca.cert.pem": store.identity_ca.pem(),
            "permissions_ca.cert.pem": store.permissions_ca.pem(),
            "governance.p7s": store.signed_governance(),
            "permissions.p7s": store.signed_permissions(enclave),
            "permissions.xml": encoded(enclave.permissions),
        }
        tree.update({posixpath.join(folder, name): entry for name, entry in changed(files, enclave.changes).items()})
    return changed(tree, store.changes)


def ardent(store: Store) -> Tree:
    """The layout of Ardent and Bouncy: one `ca.cert.pem` in each folder serves both roles."""
    tree = flat(store)
    for path in list(tree):
        folder, name = posixpath.split(path)
        if folder and name == "identity_ca.cert.pem":
            tree[posixpath.join(folder, "ca.cert.pem")] = tree.pop(path)
        elif folder and name == "permissions_ca.cert.pem":
            del tree[path]
    return tree


def copied(tree: Tree) -> Tree:
    """`tree` with files instead of links, as `cp -rL` or a Windows machine leaves it."""
    return {path: _followed(tree, path) for path in tree}


def _followed(tree: Tree, path: str) -> bytes:
    entry = tree[path]
    while isinstance(entry, Link):
        path = posixpath.normpath(posixpath.join(posixpath.dirname(path), entry.target))
        entry = tree[path]
    return entry


def _index_line(certificate: Certificate) -> bytes:
    """A line of `openssl ca`'s database: valid, end of validity, serial number, unknown file, subject."""
    fields = (
        "V",
        f"{certificate.not_after:%Y%m%d%H%M%SZ}",
        "",
        f"{certificate.serial_number():X}",
        "unknown",
    )
    return ("\t".join((*fields, f"/CN={certificate.subject}")) + "\n").encode()


def _dump(certificate: Certificate) -> bytes:
    """The head of what `openssl ca` writes for people before the PEM block, shortened."""
    issuer = (certificate.issuer or certificate).subject
    lines = (
        "Certificate:",
        "    Data:",
        "        Version: 3 (0x2)",
        f"        Serial Number: {certificate.serial_number()} ({certificate.serial_number():#x})",
        "    Signature Algorithm: ecdsa-with-SHA256",
        f"        Issuer: CN={issuer}",
        "        Validity",
        f"            Not Before: {_openssl_time(certificate.not_before)}",
        f"            Not After : {_openssl_time(certificate.not_after)}",
        f"        Subject: CN={certificate.subject}",
    )
    return ("\n".join(lines) + "\n").encode()


def _openssl_time(instant: datetime) -> str:
    return f"{instant:%b} {instant.day:2} {instant:%H:%M:%S %Y GMT}"
