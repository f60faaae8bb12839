"""What lies in a keystore of sros2's layout: each file known by its place, certificates and signatures by openssl.

Any other file, and any form that is not as sros2 writes it, is CannotTell.
"""

from __future__ import annotations

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

from keystore_audit.certificate.documents import SUBJECT, Governance, Permissions, governance, permissions
from keystore_audit.certificate.errors import CannotTell

_T = TypeVar("_T")
_MAX_BYTES: Final = 4_000_000
_SECONDS: Final = 60
_PLACE: Final = re.compile(
    r"public/(?:|identity_|permissions_)ca\.cert\.pem|private/(?:|identity_|permissions_)ca\.key\.pem"
    r"|enclaves/(?:.+/)?governance\.(?:p7s|xml)|enclaves/.+/permissions\.(?:p7s|xml)"
    r"|enclaves/.+/(?:key|cert|identity_ca\.cert|permissions_ca\.cert)\.pem"
)
_NEEDED: Final = ("cert.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s")
_BLOCK: Final = re.compile(rb"-----BEGIN ([A-Z ]+)-----\n[A-Za-z0-9+/=\n]+-----END \1-----\n?")
_AUTHORITY: Final = re.compile(r"(?:(?:^|,)[A-Z]+=[A-Za-z0-9 ._-]+)+")
"""Subjects of which no grant of the plain form has a part."""

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
    """A keystore. `issued`: pairs of fingerprints: which certificate leads to which, over the certificates here."""

    enclaves: tuple[Enclave, ...]
    permissions: tuple[Permissions, ...]
    issued: frozenset[tuple[str, str]]
    digests: Mapping[str, str]


def read(root: Path) -> Store:
    """The keystore there. Raises CannotTell."""
    try:
        files, places = _files(root.resolve())
    except OSError as error:
        raise CannotTell(f"{error.filename} cannot be read") from error
    certified = {path: content for path, content in files.items() if path.endswith("cert.pem")}
    certificates = {path: replace(_told(path, _certificate, content), path=path) for path, content in certified.items()}
    known = {each.fingerprint: each for each in certificates.values()}
    _check_others(files, certificates)
    with tempfile.TemporaryDirectory() as folder:
        every = Path(folder) / "certificates.pem"
        every.write_bytes(b"\n".join(certified.values()))
        message = cache(partial(_message, every, known.keys()))
        signed = {path: _told(path, message, files[path]) for path in files if path.endswith(".p7s")}
        issued = frozenset(
            (authority.fingerprint, each.fingerprint)
            for authority in known.values()
            for each in known.values()
            if authority.authority and _leads(certified[authority.path], certified[each.path], every)
        )
    laws = {at: _told(at, governance, at, *said) for at, said in signed.items() if at.endswith("governance.p7s")}
    rights = {at: _told(at, permissions, at, *said) for at, said in signed.items() if at.endswith("permissions.p7s")}
    folders = sorted({path.rpartition("/")[0] for path in places if re.match("enclaves/.+/", path)})
    enclaves = []
    for folder in folders:
        *three, law, document = (places.get(f"{folder}/{name}", "") for name in _NEEDED)
        if not (all(three) and law and document):
            raise CannotTell(f"{folder} lacks a file")
        own, identity, authority = (certificates[path] for path in three)
        path = folder.removeprefix("enclaves")
        enclaves.append(Enclave(path, own, identity, authority, laws[law], rights[document]))
    _check_use(enclaves, certificates.values(), issued)
    digests = {path: sha256(content).hexdigest() for path, content in files.items()}
    return Store(tuple(enclaves), tuple(rights.values()), issued, digests)


def _kind(path: str) -> str:
    return re.sub(".*/|identity_|permissions_", "", path)


def _files(top: Path) -> tuple[dict[str, bytes], dict[str, str]]:
    """By place the content of each file; and by place, links among them, where it is. Raises OSError."""
    files, places = dict[str, bytes](), dict[str, str]()
    for path in sorted(top.rglob("*")):
        if path.is_dir() and not path.is_symlink():
            next(path.iterdir(), None)  # one that is not to be read is an error
            continue
        place, real = path.relative_to(top).as_posix(), path.resolve()
        known = _PLACE.fullmatch(place) and real.is_file() and real.is_relative_to(top)
        if not known or _kind(place) != _kind(real.as_posix()) or real.stat().st_size > _MAX_BYTES:
            raise CannotTell(f"{place} is no file that the checker knows")
        places[place] = real.relative_to(top).as_posix()
        files[places[place]] = real.read_bytes()
    return files, places


def _told(path: str, reads: Callable[..., _T], *said: object) -> _T:
    """What it reads; CannotTell names the file."""
    try:
        return reads(*said)
    except CannotTell as why:
        raise CannotTell(f"{path} {why}") from why


def _openssl(content: bytes, *words: str) -> bytes | None:
    """What openssl says of the content, None where it refuses."""
    try:
        done = subprocess.run(["openssl", *words], input=content, capture_output=True, timeout=_SECONDS, check=False)
    except (OSError, subprocess.SubprocessError) as error:
        raise CannotTell(f"cannot be asked of openssl: {error}") from error
    return done.stdout if done.returncode == 0 else None


def _digest(pem: bytes) -> str:
    """The digest of what one block of PEM holds."""
    return sha256(b64decode(b"".join(pem.splitlines()[1:-1]))).hexdigest()


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


def _check_others(files: Mapping[str, bytes], certificates: Mapping[str, Certificate]) -> None:
    """Each private key is that of the certificate beside it, or of an authority; and XML is nothing else."""
    authorities = {each.key for each in certificates.values() if each.authority}
    for path, content in files.items():
        if path.endswith("key.pem"):
            beside = certificates.get(path.removesuffix("key.pem") + "cert.pem")
            keys = {beside.key} if beside else authorities if path.startswith("private/") else ()
            if _told(path, _public_half, content) not in keys:
                raise CannotTell(f"{path} is not the key of the certificate that it belongs to")
        elif path.endswith(".xml") and not (
            content.startswith(b"<") and b"-----" not in content and b": " not in content
        ):
            raise CannotTell(f"{path} holds more than XML")


def _leads(authority: bytes, certificate: bytes, every: Path) -> bool:
    """Whether the certificate leads to the authority, over the certificates here."""
    trusted = every.with_name("trusted.pem")
    trusted.write_bytes(authority)
    words = ("verify", "-no_check_time", "-partial_chain", "-no-CApath", "-no-CAstore", "-trusted", str(trusted))
    return _openssl(certificate, *words, "-untrusted", str(every)) is not None


def _message(every: Path, known: Collection[str], content: bytes) -> tuple[str, bytes, int]:
    """The one signer, who is known; the text, which is in the message as it is; and how many lines precede it."""
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
    """The fingerprints of the certificates in PEM; nothing else may be among them."""
    blocks = [block for block in _BLOCK.finditer(pem) if block[1] == b"CERTIFICATE"]
    if pem.count(b"-----BEGIN") != len(blocks):
        raise CannotTell("holds more than certificates")
    return [_digest(block[0]) for block in blocks]


def _check_use(
    enclaves: Sequence[Enclave], certificates: Iterable[Certificate], issued: Collection[tuple[str, str]]
) -> None:
    """Each certificate has one use, each key one holder, and each enclave's files belong together."""
    trusted = {ca.fingerprint: ca.key for each in enclaves for ca in (each.identity_ca, each.permissions_ca)}
    keys = [*trusted.values(), *(each.identity.key for each in enclaves)]
    if len({*keys}) < len(keys) or not enclaves:
        raise CannotTell("two certificates have one key, or there is no enclave")
    for each in certificates:
        ours = each.path.endswith("ca.cert.pem"), each.fingerprint in trusted, bool(_AUTHORITY.fullmatch(each.subject))
        if {*ours} != {each.authority}:
            raise CannotTell(f"{each.path} is an authority that no enclave trusts, or an identity, or called like one")
    for enclave in enclaves:
        vouched = (enclave.identity_ca.fingerprint, enclave.identity.fingerprint) in issued
        signed = enclave.governance.signer == enclave.permissions_ca.fingerprint
        if not (vouched and signed and SUBJECT.fullmatch(enclave.identity.subject)):
            raise CannotTell(f"{enclave.path} has a subject that is not CN=/NAME, or files of other authorities")
