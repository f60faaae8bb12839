"""Whether two builds are the same: byte for byte, or by meaning where the signer adds time and nonce."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator

from asn1crypto import cms  # type: ignore[import-untyped]
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec import Struct

from .store import Entry, Link, Tree


class Signed(Struct, frozen=True, kw_only=True):
    """What an S/MIME message of the stock signer says: the signed entity, and who signed it."""

    entity: bytes
    signer: str
    serial: int
    embedded: tuple[bytes, ...]


def differences(committed: Tree, built: Tree, *, by_meaning: bool) -> Iterator[str]:
    """A line for every path that differs. `by_meaning`: `.p7s` files may differ in what signing adds."""
    for path in sorted(committed.keys() | built.keys()):
        if path not in built:
            yield f"{path}: is there, but no story builds it"
        elif path not in committed:
            yield f"{path}: is missing"
        elif not same(path, committed[path], built[path], by_meaning=by_meaning):
            yield f"{path}: differs from what the story builds"


def same(path: str, left: Entry, right: Entry, *, by_meaning: bool) -> bool:
    """Whether two entries are equal in the sense of `differences`."""
    if left == right:
        return True
    if not by_meaning or not path.endswith(".p7s") or isinstance(left, Link) or isinstance(right, Link):
        return False
    try:
        return read_stock(left) == read_stock(right)
    except (ValueError, TypeError, IndexError, InvalidSignature):
        return False


def read_stock(message: bytes) -> Signed:
    """Read a message of sros2's signer and check its signature.

    Raises ValueError, TypeError or IndexError where it is not of that form, InvalidSignature where it does not verify.
    Only for messages that we built ourselves.
    """
    boundary = b"\r\n--" + message.split(b'boundary="')[1].split(b'"')[0]
    _top, entity, signature, _end = message.split(boundary)
    entity = entity.removeprefix(b"\r\n")
    der = base64.b64decode(signature.split(b"\r\n\r\n", 1)[1])
    data = cms.ContentInfo.load(der, strict=True)["content"]
    (info,) = data["signer_infos"]
    (certificate,) = (choice.chosen.dump() for choice in data["certificates"])
    attributes = {attribute["type"].native: attribute["values"][0].native for attribute in info["signed_attrs"]}
    if attributes["message_digest"] != hashlib.sha256(entity).digest():
        raise ValueError("the digest is not that of the content")
    key = x509.load_der_x509_certificate(certificate).public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey):
        raise TypeError("the signer's key is not on a curve")
    key.verify(info["signature"].native, info["signed_attrs"].untag().dump(), ec.ECDSA(hashes.SHA256()))
    signer = info["sid"].chosen
    return Signed(
        entity=entity,
        signer=signer["issuer"].human_friendly,
        serial=signer["serial_number"].native,
        embedded=(certificate,),
    )
