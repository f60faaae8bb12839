"""What lies in a keystore of sros2's layout: each file known by its place, certificates and signatures by openssl.

Any other file, and any form that is not as sros2 writes it, is CannotTell.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from base64 import b64decode
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Final, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.certificate.documents import Governance, Permissions, governance, permissions
from keystore_audit.certificate.errors import CannotTell

_T = TypeVar("_T")
_MAX_FILES: Final = 20_000
_MAX_BYTES: Final = 4_000_000
_SECONDS: Final = 60
_PLACES: Final = (
    (re.compile(r"public/(?:ca|identity_ca|permissions_ca)\.cert\.pem"), "authority"),
    (re.compile(r"private/(?:ca|identity_ca|permissions_ca)\.key\.pem"), "key"),
    (re.compile(r"enclaves/governance\.p7s"), "governance"),
    (re.compile(r"enclaves/governance\.xml|enclaves/.+/(?:permissions|governance)\.xml"), "unsigned"),
    (re.compile(r"enclaves/.+/key\.pem"), "key"),
    (re.compile(r"enclaves/.+/cert\.pem"), "identity"),
    (re.compile(r"enclaves/.+/(?:identity_ca|permissions_ca)\.cert\.pem"), "authority"),
    (re.compile(r"enclaves/.+/permissions\.p7s"), "permissions"),
    (re.compile(r"enclaves/.+/governance\.p7s"), "governance"),
)
_NEEDED: Final = ("cert.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s")
_BLOCK: Final = re.compile(rb"-----BEGIN ([A-Z ]+)-----\n[A-Za-z0-9+/=\n]+-----END \1-----\n?")
_SUBJECT: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+){1,19}")
_EXTENSIONS: Final = frozenset({"Basic Constraints", "Key Usage", "Subject Key Identifier", "Authority Key Identifier"})


class Certificate(Struct, frozen=True):
    """A certificate. `fingerprint`, `key`: SHA-256 of it and of its public key, in DER."""

    path: str
    fingerprint: str
    key: str
    subject: str
    authority: bool


class Enclave(Struct, frozen=True):
    """An enclave with the files that it starts with."""

    path: str
    identity: Certificate
    identity_ca: Certificate
    permissions_ca: Certificate
    governance: Governance
    permissions: Permissions


class Store(Struct, frozen=True):
    """A keystore. `issued`: pairs of fingerprints, who leads to whom over the certificates that are here."""

    enclaves: tuple[Enclave, ...]
    permissions: tuple[Permissions, ...]
    issued: frozenset[tuple[str, str]]
    digests: Mapping[str, str]


def read(root: Path) -> Store:
    """The keystore there. Raises CannotTell."""
    files, links = _files(root)
    for kind, path, content in files.values():
        if kind == "unsigned" and (not content.startswith(b"<") or b"-----" in content or b"Content-Type" in content):
            raise CannotTell(f"{path} holds more than XML")
    by_path = {path: content for kind, path, content in files.values() if kind in _CERTIFIED}
    certificates = {path: replace(_told(path, _certificate, content), path=path) for path, content in by_path.items()}
    known = {each.fingerprint: each for each in certificates.values()}
    _check_keys(files, certificates)
    with tempfile.TemporaryDirectory() as folder:
        every = Path(folder) / "certificates.pem"
        every.write_bytes(b"\n".join(by_path.values()))
        message = cache(partial(_message, every, known.keys()))
        signed = {
            path: _READERS[kind](path, *_told(path, message, content))
            for kind, path, content in files.values()
            if kind in _READERS
        }
        issued = frozenset(
            (authority.fingerprint, each.fingerprint)
            for authority in known.values()
            for each in known.values()
            if authority.authority and _leads(by_path[authority.path], by_path[each.path], every)
        )
    enclaves = tuple(_enclave(folder, links, certificates, signed) for folder in _folders(links))
    _check_use(enclaves, certificates)
    rights = tuple(each for _path, each in sorted(signed.items()) if isinstance(each, Permissions))
    return Store(enclaves, rights, issued, {path: sha256(files[path][2]).hexdigest() for path in files})


_CERTIFIED: Final = ("identity", "authority")
_READERS: Final[Mapping[str, Callable[[str, str, bytes, int], Governance | Permissions]]] = {
    "governance": governance,
    "permissions": permissions,
}


def _files(root: Path) -> tuple[dict[str, tuple[str, str, bytes]], dict[str, str]]:
    """By place: kind, place and content of each file; and by path where it leads, links among them."""
    files: dict[str, tuple[str, str, bytes]] = {}
    links: dict[str, str] = {}
    top = root.resolve()
    for folder, folders, names in os.walk(top):
        if any((Path(folder) / each).is_symlink() for each in folders):
            raise CannotTell(f"{folder} holds a link to a directory")
        for name in sorted(names):
            path = Path(folder) / name
            place, real = path.relative_to(top).as_posix(), path.resolve()
            kind = next((kind for form, kind in _PLACES if form.fullmatch(place)), None)
            if kind is None or not real.is_file() or not real.is_relative_to(top):
                raise CannotTell(f"{place} is no file that the checker knows")
            links[place] = real.relative_to(top).as_posix()
            if not path.is_symlink():
                if path.stat().st_size > _MAX_BYTES or len(files) >= _MAX_FILES:
                    raise CannotTell(f"{place} is too large, or one file too many")
                files[place] = (kind, place, path.read_bytes())
    for place, target in links.items():
        if target not in files or files[target][0] != next(kind for form, kind in _PLACES if form.fullmatch(place)):
            raise CannotTell(f"{place} leads to {target}, which is something else")
    return files, links


def _told(path: str, reads: Callable[[bytes], _T], content: bytes) -> _T:
    """What it reads; who cannot tell says of which file."""
    try:
        return reads(content)
    except CannotTell as why:
        raise CannotTell(f"{path} {why}") from why


def _openssl(content: bytes, *words: str) -> bytes | None:
    """What openssl says of the content, None where it does not do it."""
    done = subprocess.run(["openssl", *words], input=content, capture_output=True, timeout=_SECONDS, check=False)
    return done.stdout if done.returncode == 0 else None


def _digest(pem: bytes) -> str:
    """That of what one block of PEM holds."""
    return sha256(b64decode(b"".join(pem.splitlines()[1:-1]))).hexdigest()


def fingerprint(word: str) -> str:
    """What `sha256:...` says, or the digest of the certificate in a file of PEM. Raises CannotTell."""
    if word.startswith("sha256:"):
        return word.removeprefix("sha256:").replace(":", "").lower()
    content = Path(word).read_bytes()
    if _BLOCK.fullmatch(content) is None:
        raise CannotTell(f"{word} is not one certificate in PEM")
    return _digest(content)


@lru_cache(maxsize=1024)
def _certificate(content: bytes) -> Certificate:
    """The one certificate of a file, in the form of sros2; of no place yet."""
    block = _BLOCK.fullmatch(content)
    said = _openssl(content, "x509", "-noout", "-pubkey", "-text", "-nameopt", "RFC2253")
    if block is None or block[1] != b"CERTIFICATE" or said is None:
        raise CannotTell("is not one certificate in PEM")
    key, _end, text = said.decode("utf-8", "replace").partition("-----END PUBLIC KEY-----\n")
    subject = re.findall(r"^ {8}Subject: (.*)$", text, re.MULTILINE)
    extensions = re.findall(r"^ {12}(?:X509v3 )?(\S.*?):(?: critical)?\s*$", text, re.MULTILINE)
    if not _EXTENSIONS.issuperset(extensions) or len(set(extensions)) < len(extensions):
        raise CannotTell(f"has an extension that the checker does not know: {', '.join(extensions)}")
    return Certificate("", _digest(content), _digest(f"{key}\n".encode()), subject[0], "CA:TRUE" in text)


@lru_cache(maxsize=1024)
def _public_half(content: bytes) -> str:
    """The digest of the public key of the one private key of a file."""
    block = _BLOCK.fullmatch(content)
    said = _openssl(content, "pkey", "-pubout", "-passin", "pass:")
    if block is None or not block[1].endswith(b"PRIVATE KEY") or said is None:
        raise CannotTell("is not one private key in PEM")
    return _digest(said)


def _check_keys(files: Mapping[str, tuple[str, str, bytes]], certificates: Mapping[str, Certificate]) -> None:
    """Each private key is that of the certificate beside it, or of an authority."""
    authorities = {each.key for each in certificates.values() if each.authority}
    for kind, path, content in files.values():
        if kind == "key":
            key, beside = (
                _told(path, _public_half, content),
                certificates.get(f"{path.removesuffix('key.pem')}cert.pem"),
            )
            if key not in authorities if path.startswith("private/") else beside is None or key != beside.key:
                raise CannotTell(f"{path} is not the key of the certificate that it belongs to")


def _leads(authority: bytes, certificate: bytes, every: Path) -> bool:
    """Whether the certificate leads to the authority, over whatever is here."""
    trusted = every.with_name("trusted.pem")
    trusted.write_bytes(authority)
    words = ("verify", "-no_check_time", "-partial_chain", "-no-CApath", "-no-CAstore", "-trusted", str(trusted))
    return _openssl(certificate, *words, "-untrusted", str(every)) is not None


def _message(every: Path, known: Collection[str], content: bytes) -> tuple[str, bytes, int]:
    """The one signer, who is known, the text, which stands in the message as it is, and how many lines before it."""
    out, holder = every.with_name("signer.pem"), every.with_name("embedded.pem")
    holder.write_bytes(b"")
    words = ("cms", "-verify", "-noverify", "-text", "-certfile", str(every), "-signer", str(out))
    said = _openssl(content, *words, "-certsout", str(holder))
    message, text = (each.replace(b"\r\n", b"\n") for each in (content, said or b""))
    head, found, tail = message.partition(b"\nContent-Type: text/plain\n\n" + text)
    if not text.strip() or not found or not tail.lstrip(b"\n").startswith(b"--") or text in tail:
        raise CannotTell("is not a message as sros2 writes it, or its signature does not hold")
    embedded, signers = (_fingerprints(each.read_bytes()) for each in (holder, out))
    if len(signers) != 1 or not {*embedded, *signers} <= {*known}:
        raise CannotTell("holds or is signed by a certificate that is nowhere else here, or by several")
    return signers[0], text, head.count(b"\n") + 3


def _fingerprints(pem: bytes) -> Sequence[str]:
    """Of the certificates in PEM; nothing else may be among them."""
    blocks = [block for block in _BLOCK.finditer(pem) if block[1] == b"CERTIFICATE"]
    if pem.count(b"-----BEGIN") != len(blocks):
        raise CannotTell("holds more than certificates")
    return [_digest(block[0]) for block in blocks]


def _folders(links: Iterable[str]) -> list[str]:
    """Those of enclaves."""
    return sorted({path.rpartition("/")[0] for path in links if path.startswith("enclaves/") and path.count("/") > 1})


def _enclave(
    folder: str,
    links: Mapping[str, str],
    certificates: Mapping[str, Certificate],
    signed: Mapping[str, Governance | Permissions],
) -> Enclave:
    try:
        places = [links[f"{folder}/{name}"] for name in _NEEDED]
    except KeyError as missing:
        raise CannotTell(f"{missing.args[0]} is not there") from missing
    own, identity_ca, permissions_ca = (certificates[place] for place in places[:3])
    rules, rights = (signed[place] for place in places[3:])
    return Enclave(folder.removeprefix("enclaves"), own, identity_ca, permissions_ca, rules, rights)  # type: ignore[arg-type]


def _check_use(enclaves: Sequence[Enclave], certificates: Mapping[str, Certificate]) -> None:
    """Each certificate has one use, each key one holder, and each enclave's files belong together."""
    if not enclaves:
        raise CannotTell("there is no enclave")
    authorities = {ca.fingerprint for each in enclaves for ca in (each.identity_ca, each.permissions_ca)}
    keys = [each.identity.key for each in enclaves]
    keys += {each.fingerprint: each.key for each in certificates.values() if each.authority}.values()
    if len(set(keys)) < len(keys):
        raise CannotTell("two certificates have one key")
    for each in certificates.values():
        if each.authority is not each.path.endswith("ca.cert.pem") or (
            each.authority and each.fingerprint not in authorities
        ):
            raise CannotTell(f"{each.path} is an authority that no enclave trusts, or an identity that is one")
    for enclave in enclaves:
        if _SUBJECT.fullmatch(enclave.identity.subject) is None:
            raise CannotTell(f"{enclave.identity.path} has a subject that is not CN=/NAME")
        if enclave.governance.signer != enclave.permissions_ca.fingerprint:
            raise CannotTell(f"{enclave.governance.path} is not signed by the permissions CA of {enclave.path}")
