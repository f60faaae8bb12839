"""DER by hand, for what no library would write: elements one by one, and a structure as a tree that can be changed."""

from __future__ import annotations

from cryptography import x509
from cryptography.hazmat import asn1
from msgspec import Struct


def tlv(tag: int, *contents: bytes) -> bytes:
    content = b"".join(contents)
    length = len(content)
    if length < 0x80:
        return bytes((tag, length)) + content
    size = (length.bit_length() + 7) // 8
    return bytes((tag, 0x80 | size)) + length.to_bytes(size, "big") + content


def oid(dotted: str) -> bytes:
    return asn1.encode_der(x509.ObjectIdentifier(dotted))


def integer(number: int) -> bytes:
    return tlv(2, number.to_bytes(number.bit_length() // 8 + 1, "big"))


def algorithm(dotted: str, *parameters: bytes) -> bytes:
    return tlv(0x30, oid(dotted), *parameters)


def attribute(dotted: str, *values: bytes) -> bytes:
    return tlv(0x30, oid(dotted), tlv(0x31, *values))


SHA256, SHA1, SHA512 = "2.16.840.1.101.3.4.2.1", "1.3.14.3.2.26", "2.16.840.1.101.3.4.2.3"
SIGNED_DATA, DATA = "1.2.840.113549.1.7.2", "1.2.840.113549.1.7.1"
ECDSA_SHA256, ECDSA_SHA384 = "1.2.840.10045.4.3.2", "1.2.840.10045.4.3.3"
RSA, RSA_PSS, ED25519 = "1.2.840.113549.1.1.1", "1.2.840.113549.1.1.10", "1.3.101.112"
NULL = b"\x05\x00"

MAX_DEPTH = 40
"""Constructed elements inside one another that are followed: the signature of a DDS document has 10."""


class Element(Struct):
    """One element: its tag octet, and the elements inside it or, where there are none, its octets."""

    tag: int
    children: list[Element]
    octets: bytes = b""

    def encode(self) -> bytes:
        if not self.tag & 0x20:
            return tlv(self.tag, self.octets)
        return tlv(self.tag, *(child.encode() for child in self.children), self.octets)

    def walk(self) -> list[Element]:
        """It and everything in it, outermost first."""
        return [self, *(inner for child in self.children for inner in child.walk())]


def parse(data: bytes, depth: int = 0) -> list[Element]:
    """The elements of some octets with definite lengths and short tags; ValueError where they are none."""
    found = []
    position = 0
    while position < len(data):
        if len(data) - position < 2 or data[position] & 0x1F == 0x1F or depth > MAX_DEPTH:
            raise ValueError(data)
        tag, length = data[position], data[position + 1]
        position += 2
        if length & 0x80:
            size = length & 0x7F
            length = int.from_bytes(data[position : position + size], "big") if size else len(data)
            position += size
        content = data[position : position + length]
        if len(content) < length:
            raise ValueError(data)
        found.append(_element(tag, content, depth))
        position += length
    return found


def _element(tag: int, content: bytes, depth: int) -> Element:
    if not tag & 0x20:
        return Element(tag, [], content)
    try:
        return Element(tag, parse(content, depth + 1))
    except ValueError:  # says that it is made of elements, and is not
        return Element(tag, [], content)
