"""Mutations by hand of the text around what is signed."""

from __future__ import annotations

import re


def _boundary(message: bytes) -> bytes:
    match = re.search(rb'boundary="([^"]*)"', message)
    assert match is not None
    return match[1]


def _between(message: bytes) -> list[bytes]:
    """The pieces between the boundary lines."""
    return message.split(b"--" + _boundary(message))


def textual(message: bytes) -> dict[str, bytes]:
    """Mutations of the text around what is signed; `message` is a detached one with LF headers (`openssl smime`)."""
    boundary = _boundary(message)
    mark = b"--" + boundary
    head, text, signature, tail = _between(message)
    lf = message.replace(b"\r\n", b"\n")
    crlf = lf.replace(b"\n", b"\r\n")
    header = b'Content-Type: multipart/signed; boundary="x"\n'
    long_line = b"<!--" + b"x" * 3000 + b"-->\r\n"
    return {
        "all LF": lf,
        "all CRLF": crlf,
        "all CRCRLF": lf.replace(b"\n", b"\r\r\n"),
        "CR alone": lf.replace(b"\n", b"\r"),
        "byte order mark": b"\xef\xbb\xbf" + message,
        "leading blank line": b"\n" + message,
        "leading CR": b"\r" + message,
        "extra header": b"X-Note: <dds/>\n" + message,
        "header without colon": b"<dds/>\n" + message,
        "comment in a header": message.replace(b"MIME-Version: 1.0", b"MIME-Version: 1.0 (<dds/>)", 1),
        "folded header": message.replace(b'; boundary="', b';\n boundary="', 1),
        "folded header with tab": message.replace(b"; protocol", b";\n\tprotocol", 1),
        "upper case header": message.replace(b"Content-Type: multipart/signed", b"CONTENT-TYPE: MULTIPART/SIGNED", 1),
        "no MIME-Version": message.replace(b"MIME-Version: 1.0\n", b"", 1),
        "other protocol": message.replace(b'protocol="application/x-pkcs7-signature"', b'protocol="text/x"', 1),
        "no micalg": re.sub(rb' micalg="[^"]*";', b"", message, count=1),
        "duplicate Content-Type first": header + message,
        "duplicate Content-Type last": message.replace(b"\n\n", b"\n" + header + b"\n", 1),
        "duplicate boundary": message.replace(b'; boundary="', b'; boundary="x"; boundary="', 1),
        "boundary not quoted": message.replace(b'"' + boundary + b'"', boundary, 1),
        "boundary half quoted": message.replace(b'"' + boundary + b'"', b'"' + boundary, 1),
        "boundary of one letter": message.replace(boundary, b"B"),
        "boundary of one letter, not quoted": message.replace(b'"' + boundary + b'"', b"B").replace(boundary, b"B"),
        "empty boundary": message.replace(b'"' + boundary + b'"', b'""').replace(boundary, b""),
        "boundary with blanks": message.replace(b'"' + boundary + b'"', b' " ' + boundary + b' " ', 1),
        "boundary shortened in header": message.replace(b'"' + boundary + b'"', b'"' + boundary[:-4] + b'"', 1),
        "lone CR in boundary": message.replace(b'"' + boundary + b'"', b'"' + boundary + b'"\r x', 1),
        "preamble": message.replace(b"This is an S/MIME", b"<dds>evil</dds> S/MIME", 1),
        "preamble line added": message.replace(mark, b"<dds/>\n" + mark, 1),
        "no preamble": message.replace(b"This is an S/MIME signed message\n\n", b"", 1),
        "epilogue": message + b"<dds/>\n",
        "epilogue with parts": message + message,
        "text behind a boundary": message.replace(mark + b"\n", mark + b" evil\n", 1),
        "text behind the final boundary": message.replace(mark + b"--", mark + b"-- evil", 1),
        "empty part first": message.replace(mark + b"\n", mark + b"\n" + mark + b"\n", 1),
        "empty part between": head + mark + text + mark + b"\n" + mark + signature + mark + tail,
        "three parts": head + mark + text + mark + b"\n\nx\n" + mark + signature + mark + tail,
        "swapped parts": head + mark + signature + mark + text + mark + tail,
        "text twice": head + mark + text + mark + text + mark + signature + mark + tail,
        "signature twice": head + mark + text + mark + signature + mark + signature + mark + tail,
        "no final boundary": message.replace(mark + b"--", b"", 1),
        "final boundary not final": message.replace(mark + b"--", mark, 1),
        "final boundary early": message.replace(mark, mark + b"--", 1),
        "cut off": message[:-200],
        "text changed": message.replace(b"<id>0</id>", b"<id>1</id>", 1),
        "text longer": message.replace(b"</dds>", b"</dds>\r\n", 1),
        "trailing blank in the text": message.replace(b"<domains>", b"<domains> ", 1),
        "lone CR in the text": message.replace(b"<domains>", b"<domains>\r", 1),
        "NUL in the text": message.replace(b"</dds>", b"</dds>\x00", 1),
        "NUL in the header": message.replace(b"1.0", b"1.0\x00", 1),
        "NUL in the preamble": message.replace(b"signed message", b"signed\x00message", 1),
        "long line in the text": message.replace(b"</dds>", long_line + b"</dds>", 1),
        "long line in the preamble": message.replace(b"This is", b"x" * 3000 + b"This is", 1),
        "boundary at byte 1023 of a line": message.replace(mark, b"x" * 1023 + mark, 1),
        "boundary at byte 1022 of a line": message.replace(mark, b"x" * 1022 + mark, 1),
        "long header line": b"X-Long: " + b"x" * 3000 + b"\n" + message,
        "Content-Type split at byte 1023": b"X" * 1023 + message,
        "many headers": b"".join(b"X-%d: x\n" % i for i in range(100)) + message,
        "two signature headers": message.replace(b'; name="smime.p7s"\n', b'; name="smime.p7s"\n' * 2, 1),
        "signature type text/plain": message.replace(b"application/x-pkcs7-signature; name", b"text/plain; name", 1),
        "signature type without x": message.replace(b"x-pkcs7-signature; name", b"pkcs7-signature; name", 1),
        "signature 7bit": message.replace(b"Encoding: base64", b"Encoding: 7bit", 1),
        "signature extra header": message.replace(b"Content-Transfer", b"X-Note: x\nContent-Transfer", 1),
        "text/plain with charset": message.replace(b"text/plain", b"text/plain; charset=utf-8", 1),
        "text/html": message.replace(b"text/plain", b"text/html", 1),
        "blank lines in the base64": re.sub(rb"(\n[A-Za-z0-9+/]{64}\n)", rb"\1\n", message, count=1),
        "blank in the base64": re.sub(rb"\n([A-Za-z0-9+/]{10})([A-Za-z0-9+/]{54}\n)", rb"\n\1 \2", message, count=1),
        "other line length in the base64": re.sub(rb"\n(MII[A-Za-z0-9+/]{57})", rb"\n\1\n", message, count=1),
        "text behind the base64": message.replace(b"\n\n" + mark + b"--", b"\nevil\n\n" + mark + b"--", 1),
        "text before the base64": message.replace(b'filename="smime.p7s"\n\n', b'filename="smime.p7s"\n\nevil!\n', 1),
        "no base64": head + mark + text + mark + signature.split(b"\n\n")[0] + b"\n\n" + mark + tail,
        "empty": b"",
        "header alone": message.split(b"\n\n")[0] + b"\n\n",
        "signed text alone": text,
    }  # fmt: skip
