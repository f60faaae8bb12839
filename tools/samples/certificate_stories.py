"""Pairs for KA201 to KA211: certificates, their dates, their issuers and their keys."""

from __future__ import annotations

import base64
from collections.abc import Iterator

from msgspec.structs import replace

from .base import IDENTITY_CA, ONE, TALKER_CERTIFICATE, with_talker
from .certificates import day
from .keys import Key
from .story import Case, Story, pair


def stories() -> Iterator[Story]:
    """The first pairs of KA2."""
    yield from _files()
    yield from _dates()
    yield from _issuers()
    yield from _keys()


def _files() -> Iterator[Story]:
    yield from pair(
        "KA201",
        bad=Case(
            "The talker's cert.pem is cut short inside the DER. What a robot reads in it is unknown.",
            with_talker(changes={"cert.pem": _armoured("CERTIFICATE", TALKER_CERTIFICATE.der()[:-20])}),
        ),
        good=Case("The whole certificate.", ONE),
    )
    yield from pair(
        "KA202",
        bad=Case(
            "cert.pem holds a chain: the identity, then its authority. Run times read only the first.",
            with_talker(changes={"cert.pem": TALKER_CERTIFICATE.pem() + IDENTITY_CA.pem()}),
        ),
        good=Case("cert.pem holds one certificate.", ONE),
    )


def _dates() -> Iterator[Story]:
    yield from pair(
        "KA203",
        bad=Case(
            "The talker's identity ended in June 2026: no peer has accepted a new session since.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, not_after=day(2026, 6, 1))),
        ),
        good=Case("The identity is valid until 2100.", ONE),
    )
    yield from pair(
        "KA204",
        bad=Case(
            "The talker's identity begins in 2027, since the signing machine's clock ran ahead. Until then every "
            "peer refuses it.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, not_before=day(2027, 1, 1))),
        ),
        good=Case("The identity has been valid since 2020.", ONE),
    )
    yield from pair(
        "KA205",
        bad=Case(
            "The talker's identity ends two weeks after the audit: time to issue it again.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, not_after=day(2026, 12, 5))),
        ),
        good=Case("The identity is valid until 2100.", ONE),
    )
    short = replace(IDENTITY_CA, not_after=day(2099, 1, 1))
    yield from pair(
        "KA206",
        bad=Case(
            "The identity CA ends a year before the identity that it issued, so the identity's last year is worthless.",
            replace(with_talker(certificate=replace(TALKER_CERTIFICATE, issuer=short)), identity_ca=short),
        ),
        good=Case("Authority and identity end together.", ONE),
    )


def _issuers() -> Iterator[Story]:
    yield from pair(
        "KA207",
        bad=Case(
            "The talker's identity names the identity CA as its issuer, but another key signed it, such as a second "
            "keystore's. No peer accepts it.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, signed_by=Key(label="another keystore's CA"))),
        ),
        good=Case("The same names and numbers, signed with the identity CA's key.", ONE),
    )
    no_ca = replace(IDENTITY_CA, ca=False, path_length=None)
    yield from pair(
        "KA208",
        bad=Case(
            "The identity CA's certificate says CA:FALSE, so OpenSSL accepts nothing that it issued (RFC 5280, "
            "6.1.4 k).",
            replace(with_talker(certificate=replace(TALKER_CERTIFICATE, issuer=no_ca)), identity_ca=no_ca),
        ),
        good=Case("The same authority with CA:TRUE.", ONE),
    )


def _keys() -> Iterator[Story]:
    yield from pair(
        "KA209",
        bad=Case(
            "key.pem belongs to another certificate. Fast DDS does not start; Cyclone DDS starts and never finishes "
            "a handshake.",
            with_talker(key=Key(label="rules, somebody else's")),
        ),
        good=Case("key.pem is the key that cert.pem certifies.", ONE),
    )
    yield from pair(
        "KA210",
        bad=Case(
            "key.pem is a PEM block whose content is no key. OpenSSL with other providers might read it; this audit "
            "cannot.",
            with_talker(changes={"key.pem": _armoured("PRIVATE KEY", b"\x30\x0bnot-a-key-at")}),
        ),
        good=Case("key.pem is PKCS#8.", ONE),
    )
    yield from pair(
        "KA211",
        bad=Case(
            "key.pem needs a password. ROS 2 passes none to the run time, so the participant is refused.",
            with_talker(changes={"key.pem": TALKER_CERTIFICATE.key.encrypted_pem("sample")}),
        ),
        good=Case("key.pem is not encrypted, and only its owner can read it.", ONE),
    )


def _armoured(label: str, der: bytes) -> bytes:
    body = base64.encodebytes(der)
    return b"-----BEGIN " + label.encode() + b"-----\n" + body + b"-----END " + label.encode() + b"-----\n"
