"""S/MIME messages as hypothesis strategies: headers, boundaries, parts and signatures, put together at will."""

from __future__ import annotations

import base64
from typing import Final

from hypothesis import strategies as st

from tests.strategies.mutations import Draw, edited, edited_der, is_structure, seeds

_BOUNDARY: Final = b"----0011223344"
_TOP: Final = (
    b"MIME-Version: 1.0",
    b'Content-Type: multipart/signed; protocol="application/x-pkcs7-signature"; micalg="sha-256"; boundary="%s"'
    % _BOUNDARY,
    b'Content-Type: multipart/signed; boundary="%s"; boundary="x"' % _BOUNDARY,
    b"content-type: MULTIPART/SIGNED; boundary=%s" % _BOUNDARY,
    b'Content-Type: application/x-pkcs7-mime; smime-type=signed-data; name="smime.p7m"',
    b"Content-Transfer-Encoding: base64",
    b"X-Note: (a; comment) <dds/>",
    b"\tfolded",
    b"no colon",
)
_PART: Final = (
    b"Content-Type: text/plain",
    b"Content-Type: text/plain; charset=utf-8",
    b'Content-Type: application/x-pkcs7-signature; name="smime.p7s"',
    b"Content-Type: application/pkcs7-signature",
    b"Content-Transfer-Encoding: base64",
    b'Content-Disposition: attachment; filename="smime.p7s"',
    b"",
)
_ENDS: Final = st.sampled_from((b"\n", b"\n", b"\r\n", b"\r\n", b"\r\r\n", b"\r"))


def structures() -> st.SearchStrategy[bytes]:
    """The DER of a signature: as it was, changed inside, changed anywhere."""
    return st.one_of(seeds("cms"), edited_der(seeds("cms").filter(is_structure)), edited(seeds("cms")))


@st.composite
def _header(draw: Draw, lines: tuple[bytes, ...], usual: tuple[int, ...], end: bytes) -> bytes:
    chosen = [lines[number] for number in usual]
    if draw(st.integers(0, 3)) == 0:
        chosen.insert(draw(st.integers(0, len(chosen))), draw(st.sampled_from(lines)))
    if draw(st.integers(0, 7)) == 0:
        chosen = draw(st.permutations(chosen))[:2]
    return end.join(chosen) + end + end


@st.composite
def _encoded(draw: Draw, end: bytes) -> bytes:
    encoded = base64.b64encode(draw(structures()))
    width = draw(st.sampled_from((64, 64, 76, 80, 1)))
    return end.join(encoded[at : at + width] for at in range(0, len(encoded), width)) + end


@st.composite
def built(draw: Draw) -> bytes:
    """A message from its pieces, some of them out of place."""
    end = draw(_ENDS)
    delimiter = b"--" + _BOUNDARY + draw(st.sampled_from((b"", b"", b"", b" ", b"-"))) + end
    text = draw(_header(_PART, (0,), b"\r\n")) + draw(seeds("permissions"))
    signature = draw(_header(_PART, (2, 4, 5), end)) + draw(_encoded(end))
    parts = [text, signature]
    if draw(st.integers(0, 5)) == 0:
        parts.insert(draw(st.integers(0, 2)), draw(st.sampled_from((text, signature, b"", end))))
    preamble = draw(st.sampled_from((b"This is an S/MIME signed message" + end + end, b"", b"<dds/>" + end)))
    final = draw(st.sampled_from((b"--" + _BOUNDARY + b"--" + end, b"", delimiter)))
    top = draw(_header(_TOP, (0, draw(st.sampled_from((1, 1, 1, 3, 4)))), end))
    return top + preamble + b"".join(delimiter + part + end for part in parts) + final


def messages() -> st.SearchStrategy[bytes]:
    """Files of every kind that stand under the name of a signed document."""
    return st.one_of(built(), edited(built()), edited(seeds("smime")), edited(seeds("mime")))
