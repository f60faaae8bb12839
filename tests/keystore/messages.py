"""Signed messages as real writers make them, taken apart and put together again."""

from __future__ import annotations

import base64
import re
import subprocess
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from cryptography.hazmat.primitives.serialization import pkcs7

from tests.keystore.builder import GOVERNANCE, SROS2, Signed, signed_document

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
    "smime -text -indef": ("smime", "-text", "-indef"),
    "smime -text -nocerts -noattr": ("smime", "-text", "-nocerts", "-noattr"),
    "smime -text -outform SMIME": ("smime", "-text", "-outform", "SMIME"),
    "smime -text -outform DER": ("smime", "-text", "-outform", "DER"),
    "smime -text -outform PEM": ("smime", "-text", "-outform", "PEM"),
    "smime -text -subject -to": ("smime", "-text", "-subject", "rights", "-to", "robot"),
    "cms -text": ("cms", "-text"),
    "cms": ("cms",),
    "cms -text -nodetach": ("cms", "-text", "-nodetach"),
    "cms -text -nodetach -stream": ("cms", "-text", "-nodetach", "-stream"),
    "cms -text -nocerts": ("cms", "-text", "-nocerts"),
    "cms -text -noattr -nodetach": ("cms", "-text", "-noattr", "-nodetach"),
    "cms -text -stream": ("cms", "-text", "-stream"),
    "cms -text -outform DER": ("cms", "-text", "-outform", "DER"),
    "cms -text -outform PEM": ("cms", "-text", "-outform", "PEM"),
    "cms -text -subject -to": ("cms", "-text", "-subject", "rights", "-to", "robot"),
    "cms -text -md sha1": ("cms", "-text", "-md", "sha1"),
    "cms -text -md sha384": ("cms", "-text", "-md", "sha384"),
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
    "pyca as sros2": SROS2,
    "pyca opaque": (),
    "pyca without text": (pkcs7.PKCS7Options.DetachedSignature,),
    "pyca no attributes": (*SROS2, pkcs7.PKCS7Options.NoAttributes),
    "pyca no capabilities": (*SROS2, pkcs7.PKCS7Options.NoCapabilities),
    "pyca no certificates": (*SROS2, pkcs7.PKCS7Options.NoCerts),
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


def corpus(signer: Signed, *, rsa: bool) -> dict[str, bytes]:
    """Every option set of every writer, signed by `signer`."""
    options = OPENSSL_OPTIONS | (RSA_OPTIONS if rsa else {})
    made = {title: by_openssl(arguments, signer) for title, arguments in options.items() if title != "cms -text -keyid"}
    return made | {
        title: signed_document(GOVERNANCE, signer, options=arguments) for title, arguments in PYCA_OPTIONS.items()
    }


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
