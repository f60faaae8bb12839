"""Private keys: their public half and facts about them. Nothing else ever leaves this module."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import islice
from typing import Final

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.types import PublicKeyTypes
from cryptography.hazmat.primitives.serialization import load_der_private_key
from cryptography.utils import CryptographyDeprecationWarning
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore import public_key
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.der import first_element
from keystore_audit.keystore.files import File
from keystore_audit.keystore.pem import Block, Problem, loose_blocks, read_pem

MAX_KEY_BYTES: Final = 64 * 1024
"""Longest key that is parsed: an RSA key of 16,384 bits, the largest that OpenSSL uses, has 9,300 bytes."""

_BEGIN: Final = b"-----BEGIN"

_LABELS: Final = frozenset(
    {"PRIVATE KEY", "ENCRYPTED PRIVATE KEY", "EC PRIVATE KEY", "RSA PRIVATE KEY", "DSA PRIVATE KEY"}
)
"""PKCS #8 and the traditional forms: what PEM_read_bio_PrivateKey takes; it skips every other block."""

MAX_OTHER_KEYS: Final = 64
"""Further keys of one file of which the public half is looked at; of the rest it is not known whose they are."""

MAX_HELD_KEYS: Final = 1_000
"""Private keys of one file of no enclave that are looked at; whose the rest are is not known."""


class OtherKey(Struct, frozen=True, kw_only=True):
    """A further private key in the file of one: no run time reads it, and whoever has the file has it.

    `key` as in `PrivateKey`.
    """

    line: int
    key: str | None


class PrivateKey(Struct, frozen=True, kw_only=True):
    """A private key file. `file.content` is None: the bytes stay here.

    `key` identifies the public half as `Certificate.key` does, None where it could not be read. `others`: keys behind
    it, each of which is a defect as well.
    """

    file: File
    key: str | None
    key_kind: str | None
    encrypted: bool
    defects: tuple[Defect, ...]
    others: tuple[OtherKey, ...] = ()

    @property
    def keys(self) -> tuple[str | None, ...]:
        """Its own public half, and those of the keys behind it."""
        return (self.key, *(other.key for other in self.others))


def read_private_key(file: File) -> PrivateKey:
    """Read the first private key of a PEM file as OpenSSL would, without a password. Never raises or asks.

    The words of a defect are ours alone: what the library says of a key is not repeated.
    """
    sealed = file.holding(None)
    if file.content is None:
        return _unread(sealed, Kind.KEY_UNREADABLE, None, f"expected a file with a key, found {file.detail}")
    block = _first_key(file.content)
    if isinstance(block, Problem):
        return _unread(sealed, Kind.KEY_UNREADABLE, block.line, block.detail)
    others = list(_others(file, block))
    second = tuple(_second(file, each) for each in others)
    further = tuple(_other(each, look=number < MAX_OTHER_KEYS) for number, each in enumerate(others))
    if block.encrypted:
        detail = "expected a key without a password, found an encrypted one; ROS 2 hands over no password"
        first = _unread(sealed, Kind.KEY_ENCRYPTED, block.line, detail)
    elif (key := _public_half(block)) is None:
        detail = f"expected a private key in DER, found other bytes in the block {block.label}"
        first = _unread(sealed, Kind.KEY_UNREADABLE, block.line, detail)
    else:
        identity, kind = public_key.identity(key), public_key.kind(key)
        first = PrivateKey(file=sealed, key=identity, key_kind=kind, encrypted=False, defects=())
    return replace(first, defects=first.defects + second, others=further) if further else first


class HeldKeys(Struct, frozen=True, kw_only=True):
    """Whose private keys a file holds. `keys` as in `PrivateKey`, each once.

    `locked`: there is one that could not be read: with a password, or in another form.
    """

    keys: tuple[str, ...] = ()
    locked: bool = False


def holds_key(der: bytes) -> bool:
    """Whether a structure in DER is a private key without a password."""
    return _public_half(Block(label="", line=1, der=der)) is not None


def read_held_keys(file: File) -> HeldKeys:
    """Look at every private key of a file that is no enclave's, in PEM or DER. Never raises or asks."""
    content = file.content
    if content is None:
        return HeldKeys(locked=True)
    blocks = list(islice(loose_blocks(content, "PRIVATE KEY"), MAX_HELD_KEYS + 1))
    read = [_public_half(block) for block in blocks[:MAX_HELD_KEYS] if block.der != b""]  # else a text about keys
    if not read:
        read = [_public_half(Block(label="", line=1, der=first_element(content)))]
    keys = dict.fromkeys(public_key.identity(key) for key in read if key is not None)
    return HeldKeys(keys=tuple(keys), locked=None in read or len(blocks) > MAX_HELD_KEYS)


def _first_key(content: bytes) -> Block | Problem:
    for part in read_pem(content).parts:
        if isinstance(part, Problem):
            return Problem(line=part.line, detail=f"expected a PEM block PRIVATE KEY, found {part.detail}")
        if part.label in _LABELS:
            return part
    if content.lstrip().lower().startswith(b"pkcs11:"):
        detail = "expected a PEM block PRIVATE KEY, found a PKCS #11 address: it belongs into key.p11"
        return Problem(line=1, detail=detail)
    return Problem(line=1, detail="expected a PEM block PRIVATE KEY, found none")


def _others(file: File, first: Block) -> Iterator[Block]:
    """The blocks of further private keys, wherever they stand."""
    content = file.content or b""
    if content.count(_BEGIN) < 2:  # nearly always: the file is not read twice
        return
    for block in islice(loose_blocks(content, "PRIVATE KEY"), MAX_HELD_KEYS):
        if block.line != first.line:
            yield block


def _second(file: File, block: Block) -> Defect:
    detail = f"expected one private key, found another in the block {block.label}"
    return Defect(kind=Kind.SECOND_KEY, path=file.place, line=block.line, detail=detail)


def _other(block: Block, *, look: bool) -> OtherKey:
    key = _public_half(block) if look and not block.encrypted else None
    return OtherKey(line=block.line, key=public_key.identity(key) if key is not None else None)


def _public_half(block: Block) -> PublicKeyTypes | None:
    """Return the public half.

    RSA keys are not tested for primality: 42 ms a key, and no run time does it either
    (docs/security-model.md).
    """
    if block.der is None or len(block.der) > MAX_KEY_BYTES:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CryptographyDeprecationWarning)
            private = load_der_private_key(block.der, None, unsafe_skip_rsa_key_validation=True)
        return private.public_key()
    except (ValueError, TypeError, UnsupportedAlgorithm):  # TypeError: encrypted after all
        return None


def _unread(file: File, kind: Kind, line: int | None, detail: str) -> PrivateKey:
    defect = Defect(kind=kind, path=file.place, line=line, detail=detail)
    return PrivateKey(file=file, key=None, key_kind=None, encrypted=kind is Kind.KEY_ENCRYPTED, defects=(defect,))
