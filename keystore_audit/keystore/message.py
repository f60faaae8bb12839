"""Whether a file may be an S/MIME message at all, whatever its name: asked of every file of a keystore."""

from __future__ import annotations

from typing import Final

_BLANK_LINES: Final = (b"\n\n", b"\n\r", b"\n\0")
"""What ends a header: OpenSSL ends lines at LF, and one that begins with CR, LF or NUL is blank (asn_mime.c)."""

_TYPES: Final = (b"multipart/signed", b"pkcs7-mime")
"""What the header of a signed message has to say somewhere, in any case of letters."""


def may_be_message(data: bytes) -> bool:
    """Whether OpenSSL may take `data` for a signed message; False: it certainly does not (`mime.read_message`).

    It reads header lines up to the first blank one, and refuses what names neither type there. Other text may stand in
    the header, before the type too.
    """
    lowered = data.lower()
    for kind in _TYPES:
        found = lowered.find(kind)
        if found >= 0 and not any(data.find(line, 0, found) >= 0 for line in _BLANK_LINES):
            return True
    return False
