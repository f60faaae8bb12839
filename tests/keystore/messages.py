"""Signed messages as real writers make them, and ways to spoil them."""

from __future__ import annotations

import base64
import random
import re
import subprocess
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import Encoding, pkcs7

from tests.keystore.builder import GOVERNANCE, Signed

OPENSSL_OPTIONS: dict[str, tuple[str, ...]] = {
    "smime -text": ("smime", "-text"),
    "smime": ("smime",),
    "smime -text -nodetach": ("smime", "-text", "-nodetach"),
    "smime -text -nodetach -stream": ("smime", "-text", "-nodetach", "-stream"),
    "smime -text -stream": ("smime", "-text", "-stream"),
    "smime -text -nocerts": ("smime", "-text", "-nocerts"),
    "smime -text -noattr": ("smime", "-text", "-noattr"),
    "smime -text -noattr -nodetach": ("smime", "-text", "-noattr", "-nodetach"),
    "smime -text -nosmimecap": ("smime", "-text", "-nosmimecap"),
    "smime -text -crlfeol": ("smime", "-text", "-crlfeol"),
    "smime -text -binary": ("smime", "-text", "-binary"),
    "smime -binary": ("smime", "-binary"),
    "smime -text -md sha1": ("smime", "-text", "-md", "sha1"),
    "smime -text -md sha224": ("smime", "-text", "-md", "sha224"),
    "smime -text -md sha384": ("smime", "-text", "-md", "sha384"),
    "smime -text -md sha512": ("smime", "-text", "-md", "sha512"),
    "smime -text -outform DER": ("smime", "-text", "-outform", "DER"),
    "smime -text -outform PEM": ("smime", "-text", "-outform", "PEM"),
    "smime -text -subject -to": ("smime", "-text", "-subject", "rights", "-to", "robot"),
    "cms -text": ("cms", "-text"),
    "cms": ("cms",),
    "cms -text -nodetach": ("cms", "-text", "-nodetach"),
    "cms -text -nodetach -stream": ("cms", "-text", "-nodetach", "-stream"),
    "cms -text -nocerts": ("cms", "-text", "-nocerts"),
    "cms -text -noattr": ("cms", "-text", "-noattr"),
    "cms -text -nosmimecap": ("cms", "-text", "-nosmimecap"),
    "cms -text -cades": ("cms", "-text", "-cades"),
    "cms -text -keyid": ("cms", "-text", "-keyid"),
    "cms -text -crlfeol": ("cms", "-text", "-crlfeol"),
    "cms -text -binary": ("cms", "-text", "-binary"),
    "cms -text -asciicrlf": ("cms", "-text", "-asciicrlf"),
    "cms -text -md sha512": ("cms", "-text", "-md", "sha512"),
    "cms -text -econtent_type": ("cms", "-text", "-econtent_type", "1.2.3.4"),
    "cms -text -receipt": ("cms", "-text", "-receipt_request_to", "somebody", "-receipt_request_all"),
}
RSA_OPTIONS: dict[str, tuple[str, ...]] = {
    "smime -text -md md5": ("smime", "-text", "-md", "md5"),
    "smime -text -md ripemd160": ("smime", "-text", "-md", "ripemd160"),
    "smime -text -md sha3-256": ("smime", "-text", "-md", "sha3-256"),
    "cms -text, RSA-PSS": ("cms", "-text", "-keyopt", "rsa_padding_mode:pss"),
}
PYCA_OPTIONS: dict[str, tuple[pkcs7.PKCS7Options, ...]] = {
    "pyca as sros2": (pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature),
    "pyca opaque": (),
    "pyca without text": (pkcs7.PKCS7Options.DetachedSignature,),
    "pyca no attributes": (
        pkcs7.PKCS7Options.Text,
        pkcs7.PKCS7Options.DetachedSignature,
        pkcs7.PKCS7Options.NoAttributes,
    ),
    "pyca no capabilities": (
        pkcs7.PKCS7Options.Text,
        pkcs7.PKCS7Options.DetachedSignature,
        pkcs7.PKCS7Options.NoCapabilities,
    ),
    "pyca no certificates": (
        pkcs7.PKCS7Options.Text,
        pkcs7.PKCS7Options.DetachedSignature,
        pkcs7.PKCS7Options.NoCerts,
    ),
}


def by_openssl(options: Sequence[str], *signers: Signed, content: bytes = GOVERNANCE) -> bytes:
    """Sign with the command line tool."""
    tool, *rest = options
    with TemporaryDirectory() as folder:
        directory = Path(folder)
        (directory / "content").write_bytes(content)
        arguments = ["-sign", "-in", "content", "-out", "message", *rest]
        for number, signer in enumerate(signers):
            (directory / f"{number}.pem").write_bytes(signer.pem)
            (directory / f"{number}.key").write_bytes(signer.key_pem)
            arguments += ["-signer", f"{number}.pem", "-inkey", f"{number}.key"]
            if "-keyopt" in rest:  # belongs to the signer before it
                arguments = [a for a in arguments if a not in rest[-2:]] + rest[-2:]
        subprocess.run(["openssl", tool, *arguments], cwd=directory, check=True, capture_output=True)
        return (directory / "message").read_bytes()


def by_pyca(options: Sequence[pkcs7.PKCS7Options], signer: Signed, content: bytes = GOVERNANCE) -> bytes:
    """Sign with the library that sros2 uses since Iron."""
    builder = pkcs7.PKCS7SignatureBuilder().set_data(content)
    builder = builder.add_signer(signer.certificate, signer.key, hashes.SHA256())  # type: ignore[arg-type]
    return builder.sign(Encoding.SMIME, list(options))


def corpus(signer: Signed, *, rsa: bool) -> dict[str, bytes]:
    """Every option set of every writer, signed by `signer`."""
    options = OPENSSL_OPTIONS | (RSA_OPTIONS if rsa else {})
    made = {title: by_openssl(arguments, signer) for title, arguments in options.items() if title != "cms -text -keyid"}
    return made | {title: by_pyca(arguments, signer) for title, arguments in PYCA_OPTIONS.items()}


# --- taking a message apart and putting it together again


_PARTS = re.compile(
    rb"(?s)\A(.*base64\r?\n(?:Content-Disposition[^\n]*\n)?\r?\n)([A-Za-z0-9+/=\r\n]*?)(\r?\n\r?\n?--.*)?\Z"
)


@lru_cache(maxsize=256)
def taken_apart(message: bytes) -> tuple[bytes, bytes, bytes]:
    """What stands before the signature, the DER of the signature, and what stands behind it."""
    match = _PARTS.match(message)
    assert match is not None, message[:200]
    return match[1], base64.b64decode(match[2]), match[3] or b"\n"


def put_together(before: bytes, der: bytes, behind: bytes) -> bytes:
    end = b"\r\n" if b"base64\r\n" in before else b"\n"
    encoded = base64.b64encode(der)
    return before + end.join(encoded[i : i + 64] for i in range(0, len(encoded), 64)) + behind


def with_signature(message: bytes, der: bytes) -> bytes:
    """The message with another signature."""
    before, _, behind = taken_apart(message)
    return put_together(before, der, behind)


# --- mutations by hand


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


# --- mutations at random


def mutated(message: bytes, rng: random.Random) -> bytes:
    """One to three random changes, half of them where meaning hangs on a byte: headers, boundaries, the signature."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        message = rng.choice(_MUTATORS)(message, rng)
    return message


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


def _der(message: bytes, rng: random.Random) -> bytes:
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


_MUTATORS = (_flip, _flip_important, _flip_important, _insert, _delete, _line, _line, _ends, _stretch, _der, _der, _der)
