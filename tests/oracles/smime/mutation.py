"""Random mutations of signed messages, most of them where meaning hangs on a byte."""

from __future__ import annotations

import base64
import random
import re
from collections.abc import Callable

from tests.keystore.messages import put_together, taken_apart
from tests.oracles.smime.der import DATA, NULL, SHA1, SHA256, SHA512, Element, algorithm, attribute, oid, parse, tlv
from tests.oracles.smime.resigning import Signers, covered_by, other_header, other_text, sign


def mutated(message: bytes, rng: random.Random, signers: Signers) -> bytes:
    """One to three random changes; some are signed again, by whoever of `signers` the message names."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if rng.random() < _SIGNED_AGAIN:
            try:
                message = rng.choice(_SIGNING)(message, rng, signers)
            except (AssertionError, ValueError):  # no longer a message that can be taken apart
                message = _flip(message, rng)
        else:
            message = rng.choice(_MUTATORS)(message, rng)
    return message


# --- the text


_INTERESTING = b'\r\n\n\n\r \t-=:;"()\x00/+AZaz09,<>\xff\x80'


def _flip(message: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(message) or 1)
    return message[:at] + bytes([rng.randrange(256)]) + message[at + 1 :]


def _flip_important(message: bytes, rng: random.Random) -> bytes:
    places = [m.start() for m in re.finditer(rb"(?m)^(?:--|Content|MIME|This)|boundary|base64|text/plain", message)]
    at = max(0, (rng.choice(places) if places else 0) + rng.randrange(-3, 60))
    return message[:at] + bytes([rng.choice(_INTERESTING)]) + message[at + rng.randrange(2) :]


def _insert(message: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(message) + 1)
    return message[:at] + bytes(rng.choices(_INTERESTING, k=rng.choice((1, 1, 2, 3)))) + message[at:]


def _delete(message: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(message) + 1)
    return message[:at] + message[at + rng.choice((1, 1, 2, 5, 70)) :]


def _line(message: bytes, rng: random.Random) -> bytes:
    lines = message.split(b"\n")
    source, target = rng.randrange(len(lines)), rng.randrange(len(lines))
    if rng.random() < 0.5:
        source = rng.choice([i for i, line in enumerate(lines) if line.startswith((b"--", b"Content"))] or [source])
    line = lines[source]
    if rng.random() < 0.5:
        del lines[source]
    lines.insert(target, line[: rng.randrange(len(line) + 1)] if rng.random() < 0.2 else line)
    return b"\n".join(lines)


def _ends(message: bytes, rng: random.Random) -> bytes:
    lines = message.split(b"\n")
    at = rng.randrange(len(lines))
    lines[at] = lines[at].rstrip(b"\r") + rng.choice((b"", b"\r", b"\r\r", b" \r", b"\r ", b" "))
    return b"\n".join(lines)


def _stretch(message: bytes, rng: random.Random) -> bytes:
    """Bring the buffer of 1,024 bytes into play."""
    at = rng.randrange(len(message) + 1)
    length = rng.choice((1000, 1018, 1021, 1022, 1023, 1024, 2046))
    return message[:at] + rng.choice((b"x", b" ", b"\r", b"-")) * length + message[at:]


def _octets(message: bytes, rng: random.Random) -> bytes:
    try:
        before, der, behind = taken_apart(message)
    except (AssertionError, ValueError):
        return _flip(message, rng)
    return put_together(before, _spoiled(der, rng), behind)


def _spoiled(der: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(der) or 1)
    choice = rng.random()
    if choice < 0.6:
        return der[:at] + bytes([rng.choice((rng.randrange(256), 0, 0x80, 0x30, 0x31, 0xA0, 5, 1))]) + der[at + 1 :]
    if choice < 0.8:
        return der[:at] + der[at + rng.choice((1, 2, 11)) :]
    return der[:at] + bytes(rng.choices(range(256), k=rng.choice((1, 2)))) + der[at:]


# --- base64


def _base64(message: bytes, rng: random.Random) -> bytes:
    """Other characters, lines of another length, other ends."""
    try:
        before, der, behind = taken_apart(message)
    except (AssertionError, ValueError):
        return _insert(message, rng)
    text = base64.b64encode(der)
    end = rng.choice((b"\n", b"\n", b"\r\n", b"\r\r\n", b" \n", b"\n\n"))
    width = rng.choice((64, 64, 64, 76, 1, 4, 60, 63, 65, 72, 77, 80, 81, 100, 1000, 1020, 1023, 1024, 3000))
    at = rng.randrange(len(text) + 1)
    text = rng.choice(
        (
            text,
            text[:at] + rng.choice((b"=", b"-", b" ", b"\t", b"\x00", b"AAAA", b"====", b"\xff")) + text[at:],
            text + rng.choice((b"=", b"==", b"AAAA", b"A", b"=AAA", b"-", b"\n-", b"\nMIIB", b"\n\n\n")),
            text.rstrip(b"="),
            text[:-4] + rng.choice((b"AA==", b"AB==", b"AAA=", b"AAB=")),
            text[: at - at % 4] + b"=" * rng.randrange(1, 3) + text[at - at % 4 :],
        )
    )
    return before + end.join(text[i : i + width] for i in range(0, len(text), width)) + behind


# --- the structure, written anew

_VOCABULARY = (
    *(NULL, b"\x02\x01\x01", b"\x02\x01\x03", b"\x30\x00", b"\x31\x00", b"\xa0\x00", b"\xa1\x00", tlv(4, b"")),
    *(oid(DATA), oid(SHA1), algorithm(SHA1), algorithm(SHA256), algorithm(SHA256, NULL), algorithm(SHA512, NULL)),
    *(algorithm("1.2.840.113549.1.1.1", NULL), algorithm("1.2.840.10045.4.3.2"), algorithm("1.2.840.10045.4.3.4")),
    *(attribute("1.2.840.113549.1.9.3", oid(DATA)), attribute("1.2.3.4", NULL), tlv(0xA0, tlv(4, b"<dds/>"))),
    *(algorithm("1.3.101.112"), algorithm("1.2.840.113549.1.1.10"), b"\x01\x01\x01", b"\x05\x81\x00"),
)  # fmt: skip


def _other_structure(der: bytes, rng: random.Random) -> Element:
    (structure,) = parse(der)
    for _ in range(rng.choice((1, 1, 2))):
        places = [(parent, number) for parent in structure.walk() for number in range(len(parent.children))]
        if not places:
            raise ValueError(der)
        _change(*rng.choice(places), structure, rng)
    return structure


def _change(parent: Element, number: int, structure: Element, rng: random.Random) -> None:
    """Change one element in its place."""
    children, element = parent.children, parent.children[number]
    choice = rng.randrange(9)
    if choice == 0:
        del children[number]
    elif choice == 1:
        children.insert(rng.randrange(len(children) + 1), element)
    elif choice == 2:
        rng.shuffle(children)
    elif choice == 3:
        element.tag = rng.choice((2, 3, 4, 5, 6, 12, 19, 0x30, 0x31, 0xA0, 0xA1, 0x80, element.tag ^ 0x20)) or 5
    elif choice == 4:
        children[number : number + rng.randrange(2)] = parse(rng.choice(_VOCABULARY))
    elif choice == 5:
        children[number] = Element(rng.choice((0x30, 0x31, 0xA0, 0x24)), [element])
    elif choice == 6:
        children[number] = parse(rng.choice(structure.walk()).encode())[0]
    else:
        at = rng.randrange(len(element.octets) + 1)
        other = rng.choice((b"", b"\x00", b"\xff", bytes([rng.randrange(256)])))
        element.octets = element.octets[:at] + other + element.octets[at + rng.randrange(2) :]


def _structure(message: bytes, rng: random.Random) -> bytes:
    try:
        before, der, behind = taken_apart(message)
        return put_together(before, _other_structure(der, rng).encode(), behind)
    except (AssertionError, ValueError):
        return _flip(message, rng)


def _structure_signed_again(message: bytes, rng: random.Random, signers: Signers) -> bytes:
    before, der, behind = taken_apart(message)
    structure = _other_structure(der, rng)
    sign(structure, covered_by(structure, message), signers, digest=rng.random() < 0.5)
    return put_together(before, structure.encode(), behind)


_MUTATORS: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_flip, _flip_important, _flip_important, _insert, _delete, _line, _line, _ends, _stretch),
    *(_octets, _octets, _base64, _base64, _structure, _structure),
)
_SIGNING = (_structure_signed_again, _structure_signed_again, _structure_signed_again, other_header, other_text)
_SIGNED_AGAIN = 0.3
"""How often a change is signed again: those messages get furthest."""
