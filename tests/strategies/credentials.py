"""PEM files as hypothesis strategies: certificates, revocation lists and keys, whole, changed and in any mixture."""

from __future__ import annotations

import base64
import re
from typing import Final

from hypothesis import strategies as st

from tests.fuzz.targets import CORPUS
from tests.strategies.mutations import Draw, edited, edited_der, is_structure, seeds

LABELS: Final = ("CERTIFICATE", "X509 CERTIFICATE", "TRUSTED CERTIFICATE", "X509 CRL", "PRIVATE KEY", "EC PRIVATE KEY")
LABELS_TOO: Final = ("RSA PRIVATE KEY", "ENCRYPTED PRIVATE KEY", "PKCS7", "", "certificate", "A" * 70)
_BLOCK: Final = re.compile(rb"-----BEGIN ([A-Z0-9 ]+)-----\r?\n([A-Za-z0-9+/=\r\n]+)-----END")


def _structures(target: str) -> st.SearchStrategy[tuple[str, bytes]]:
    """Label and DER of each block of a corpus that has both."""
    found = []
    for path in sorted((CORPUS / target).iterdir()):
        for label, body in _BLOCK.findall(path.read_bytes()):
            try:
                der = base64.b64decode(body, validate=False)
            except ValueError:
                continue
            if is_structure(der):
                found.append((label.decode(), der))
    return st.sampled_from(found)


@st.composite
def _blocks(draw: Draw, target: str) -> bytes:
    label, der = draw(_structures(target))
    der = draw(st.one_of(st.just(der), edited_der(st.just(der)), edited_der(st.just(der)), edited(st.just(der))))
    label = draw(st.sampled_from((label,) * 8 + LABELS + LABELS_TOO))
    encoded = base64.b64encode(der)
    width = draw(st.sampled_from((64, 64, 64, 76, 1_000)))
    end = draw(st.sampled_from((b"\n", b"\n", b"\r\n", b" \n", b"\r")))
    lines = end.join(encoded[at : at + width] for at in range(0, len(encoded), width))
    return f"-----BEGIN {label}-----".encode() + end + lines + end + f"-----END {label}-----".encode() + end


_JUNK: Final = st.one_of(
    st.binary(max_size=40), st.sampled_from((b"\n", b"Certificate:\n    Data:\n", b"-----BEGIN X-----\n"))
)


def pem_files(target: str) -> st.SearchStrategy[bytes]:
    """A file of `target`: a corpus's file changed, or blocks of it with things between."""
    blocks = st.lists(st.one_of(_blocks(target), _blocks(target), _JUNK), max_size=4).map(b"".join)
    return st.one_of(blocks, blocks, edited(seeds(target)), edited(blocks))
