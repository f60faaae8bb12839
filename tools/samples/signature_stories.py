"""Pairs for KA3: who signed a document, how, and what stands around it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import ONE, PERMISSIONS_CA, TALKER_CERTIFICATE, with_talker
from .certificates import day
from .cms import SignedData, Signer
from .documents import edited
from .keys import Key
from .smime import Message, signed_by
from .store import Seal, Store
from .story import Case, Story, pair

GENUINE = "The permissions CA signed it."
CA_SIGNER = Signer(certificate=PERMISSIONS_CA)


def stories() -> Iterator[Story]:
    """All pairs of KA3, each about the talker's permissions.p7s."""
    yield from _signers()
    yield from _envelopes()
    yield from _forms()
    yield from _numbers_of_signers()


def _sealed(seal: Seal) -> Store:
    return with_talker(seal=seal)


def _signed(**fields: object) -> Seal:
    """Signed by the permissions CA with `fields` of the SignedData replaced."""
    return Message(signature=replace(SignedData(signers=(CA_SIGNER,)), **fields)).smime


def _signers() -> Iterator[Story]:
    stranger = replace(PERMISSIONS_CA, key=Key(label="rules, a stranger"))
    yield from pair(
        "KA301",
        bad=Case(
            "A stranger signed the permissions, with an authority of the same name and another key. The signature "
            "is valid, but not the permissions CA's.",
            _sealed(signed_by(stranger).smime),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA302",
        bad=Case(
            "The talker signed its permissions with its own identity. Every run time refuses them, since the "
            "authorities are separate.",
            _sealed(signed_by(TALKER_CERTIFICATE).smime),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA303",
        bad=Case(
            "After signing, somebody changed /chatter to /cmd_vel: the signature no longer fits the document.",
            _sealed(_tampered),
        ),
        good=Case(GENUINE, ONE),
    )
    renewed = replace(PERMISSIONS_CA, not_before=day(2026, 1, 1))
    yield from pair(
        "KA316",
        bad=Case(
            "The permissions CA was renewed with its old key. The document names the new certificate, the enclave "
            "has the old one, so OpenSSL finds no signer.",
            _sealed(signed_by(renewed).smime),
        ),
        good=Case("The document names the certificate that the enclave has.", ONE),
    )
    yield from pair(
        "KA317",
        bad=Case(
            "Signed with -nocerts: implementations that look for the signer in the message refuse it.",
            _sealed(_signed(embed_certificates=False)),
        ),
        good=Case("The signer's certificate is in the message.", ONE),
    )


def _tampered(document: bytes) -> bytes:
    return edited(signed_by(PERMISSIONS_CA).smime(document).decode(), "rt/chatter", "rt/cmd_vel").encode()


def _envelopes() -> Iterator[Story]:
    yield from pair(
        "KA304",
        bad=Case(
            "permissions.p7s is plain XML: somebody copied permissions.xml over it. Nothing is signed.",
            _sealed(lambda document: document),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA305",
        bad=Case(
            "The last boundary of the message is missing, as in a file that was cut short.",
            _sealed(lambda document: signed_by(PERMISSIONS_CA).smime(document).rsplit(b"\r\n--", 1)[0]),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA306",
        bad=Case(
            "Four bytes follow the CMS structure inside its base64. OpenSSL ignores them, stricter parsers do not.",
            _sealed(_signed(trailing=bytes(4))),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA307",
        bad=Case(
            "`openssl smime -sign` signed the document without -text. The signature is good, but no run time "
            "accepts content that does not begin with Content-Type: text/plain.",
            _sealed(Message(signature=SignedData(signers=(CA_SIGNER,)), text=False).smime),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA308",
        bad=Case(
            "After the signature stands a second grant in plain text. No run time reads it, but a reviewer might.",
            _sealed(Message(signature=SignedData(signers=(CA_SIGNER,)), epilogue=_DECOY).smime),
        ),
        good=Case(GENUINE, ONE),
    )


_DECOY = b'<grant name="/talker"><subject_name>CN=/talker</subject_name></grant>\r\n'


def _forms() -> Iterator[Story]:
    yield from pair(
        "KA309",
        bad=Case(
            "The permissions were signed over SHA-1, for which collisions exist.",
            _sealed(_signed(digest="sha1")),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA311",
        bad=Case(
            "The document is inside the CMS structure (application/pkcs7-mime): valid, but not readable in an editor.",
            _sealed(signed_by(PERMISSIONS_CA).opaque),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA312",
        bad=Case(
            "The message carries two documents: one beside the signature and another inside it. Which one counts "
            "depends on the parser.",
            _sealed(_signed(content=b"Content-Type: text/plain\r\n\r\n<dds/>\r\n")),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA313",
        bad=Case(
            "The signature covers only the document, without signed attributes (openssl's -noattr).",
            _sealed(_signed(attributes=False)),
        ),
        good=Case(GENUINE, ONE),
    )
    yield from pair(
        "KA314",
        bad=Case(
            "The permissions were signed over SHA3-256. OpenSSL verifies it; this audit does not, and calls it "
            "neither valid nor invalid.",
            _sealed(_signed(digest="sha3_256")),
        ),
        good=Case(GENUINE, ONE),
    )


def _numbers_of_signers() -> Iterator[Story]:
    successor = replace(PERMISSIONS_CA, key=Key(label="rules permissions CA 2"), subject="permissionsCA2")
    both = {"permissions_ca.cert.pem": PERMISSIONS_CA.pem() + successor.pem()}
    yield from pair(
        "KA310",
        bad=Case(
            "While the permissions CA is replaced, old and new authority both signed. Cyclone DDS knows only the "
            "first, and refuses.",
            with_talker(seal=signed_by(PERMISSIONS_CA, successor).smime, changes=both),
        ),
        good=Case("Only the old authority signed, the first in the file.", with_talker(changes=both)),
    )
    yield from pair(
        "KA315",
        bad=Case("A CMS structure without any signature.", _sealed(_signed(signers=()))),
        good=Case(GENUINE, ONE),
    )
