"""Changes to bytes as hypothesis strategies: of any text, line by line, and inside DER."""

from __future__ import annotations

from typing import Final

from hypothesis import strategies as st

from tests.fuzz.targets import CORPUS
from tests.oracles.smime.der import parse

Draw = st.DrawFn

_TELLING: Final = (
    b"\n",
    b"\r\n",
    b"\r",
    b"\0",
    b"--",
    b"-----",
    b" ",
    b"\t",
    b":",
    b";",
    b'"',
    b"=",
    b"<",
    b">",
    b"&",
    b"]]>",
)
_TAGS: Final = (0x00, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C, 0x13, 0x17, 0x18, 0x30, 0x31, 0x80, 0xA0, 0xA1, 0xA3, 0xFF)


def seeds(target: str) -> st.SearchStrategy[bytes]:
    """The corpus of a fuzzing target."""
    return st.sampled_from([path.read_bytes() for path in sorted((CORPUS / target).iterdir())])


@st.composite
def edited(draw: Draw, source: st.SearchStrategy[bytes]) -> bytes:
    """One to four changes of bytes and lines."""
    data = draw(source)
    for _ in range(draw(st.integers(1, 4))):
        data = draw(st.one_of(_bytes(data), _lines(data)))
    return data


@st.composite
def _bytes(draw: Draw, data: bytes) -> bytes:
    begin = draw(st.integers(0, len(data)))
    end = min(len(data), begin + draw(st.sampled_from((0, 0, 1, 1, 2, 16, 1024))))
    between = draw(st.one_of(st.binary(max_size=4), st.sampled_from(_TELLING), st.just(data[begin:end] * 2)))
    return data[:begin] + between + data[end:]


@st.composite
def _lines(draw: Draw, data: bytes) -> bytes:
    """A line moved, doubled or left out."""
    lines = data.splitlines(keepends=True) or [b""]
    line = lines[draw(st.integers(0, len(lines) - 1))]
    if draw(st.booleans()):
        lines.remove(line)
    lines.insert(draw(st.integers(0, len(lines))), line)
    return b"".join(lines)


def is_structure(data: bytes) -> bool:
    """Whether it is one DER structure, which `edited_der` can take apart."""
    try:
        return len(parse(data)) == 1
    except ValueError:
        return False


@st.composite
def edited_der(draw: Draw, source: st.SearchStrategy[bytes]) -> bytes:
    """A structure with one to three elements changed, all lengths right again (or not, in one of five)."""
    data = draw(source)
    (tree, *_) = parse(data)
    for _ in range(draw(st.integers(1, 3))):
        elements = tree.walk()
        element = elements[draw(st.integers(0, len(elements) - 1))]
        other = elements[draw(st.integers(0, len(elements) - 1))]
        change = draw(st.sampled_from(("tag", "octets", "drop", "double", "swap", "empty")))
        if change == "tag":
            element.tag = draw(st.sampled_from(_TAGS))
        elif change == "octets":
            element.octets = draw(st.one_of(st.binary(max_size=24), edited(st.just(element.octets))))
        elif change == "empty":
            element.children, element.octets = [], b""
        elif change == "swap":
            element.tag, other.tag = other.tag, element.tag
            element.octets, other.octets = other.octets, element.octets
        elif element.children:
            at = draw(st.integers(0, len(element.children) - 1))
            element.children[at : at + 1] = [] if change == "drop" else [element.children[at]] * 2
    encoded = tree.encode()
    return draw(edited(st.just(encoded))) if draw(st.integers(0, 4)) == 0 else encoded
