"""KA3: the form of signed documents, S/MIME and CMS (RFC 8551, RFC 5652). Who signed them is in `signature.py`.

The reader names each defect; here it gets its code, severity and consequence. What we refuse to interpret is
undecided as long as some implementation may take the document.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.keystore.defect import Kind
from keystore_audit.profiles import facts
from keystore_audit.rules.registry import Violation, defective, of_kinds, rule
from keystore_audit.rules.remedies import SIGN_AGAIN, sign_again
from keystore_audit.rules.subjects import SignedUse
from keystore_audit.truth import Truth


def _has(use: SignedUse, says: str, *kinds: Kind, opens: bool = False) -> Iterable[Violation]:
    """`opens`: it is undecided, unless something else makes every implementation refuse the document."""
    if not use.signed.defects:
        return ()
    undecided = opens and use.envelope.verdict is Truth.UNKNOWN
    return defective(of_kinds(use.signed.defects, *kinds), says, undecided=undecided)


@rule(
    "KA304",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2 and 9.4.1.3 (S/MIME version 3.2, multipart/signed); measured",
    SIGN_AGAIN,
    explains=("documents-signed-by-the-permissions-ca",),
    stops=True,
)
def not_smime(use: SignedUse) -> Iterator[Violation]:
    """The file is no S/MIME message: plain XML, PEM or DER. Every implementation refuses it (measured)."""
    yield from _has(use, "every implementation refuses it.", Kind.NOT_SMIME)


@rule(
    "KA305",
    Severity.HIGH,
    "RFC 8551, 3.5.3; RFC 2046, 5.1; OpenSSL, crypto/asn1/asn_mime.c",
    sign_again("Find out how it was damaged, or who changed it."),
    stops=True,
)
def malformed_smime(use: SignedUse) -> Iterator[Violation]:
    """The message can be parsed in more than one way, or not as the standard demands.

    OpenSSL, which all measured implementations use, accepts some of these. The meaning is unknown, since it is not
    guessed.
    """
    yield from _has(use, "what a robot reads in the document is unknown.", Kind.MIME_MALFORMED, opens=True)


@rule(
    "KA306",
    Severity.HIGH,
    "RFC 5652, 5.1; ITU-T X.690 (DER)",
    SIGN_AGAIN,
    stops=True,
)
def cms_not_strict(use: SignedUse) -> Iterator[Violation]:
    """The signature is not strict DER, or not the structure that RFC 5652 describes.

    OpenSSL accepts BER, and bytes behind the end. The meaning is unknown, since parsers may differ.
    """
    says = "it is not interpreted here, since parsers may read it differently."
    yield from _has(use, says, Kind.CMS_NOT_DER, Kind.CMS_MALFORMED, opens=True)


@rule(
    "KA307",
    Severity.HIGH,
    "OpenSSL, SMIME_text (run times pass PKCS7_TEXT); measured",
    sign_again("Sign with -text."),
    explains=("documents-signed-by-the-permissions-ca",),
    stops=True,
)
def no_text_plain_header(use: SignedUse) -> Iterator[Violation]:
    """The signed part does not begin with Content-Type: text/plain, as when -text was forgotten.

    Every implementation refuses it (measured), though `openssl smime -verify` without -text accepts it.
    """
    yield from _has(use, "every implementation refuses it.", Kind.NO_TEXT_PLAIN)


@rule(
    "KA308",
    Severity.MEDIUM,
    "RFC 2046, 5.1.1 (preamble and epilogue are ignored)",
    sign_again("Remove the text from the file; signing again does so."),
)
def unsigned_text(use: SignedUse) -> Iterator[Violation]:
    """Text stands outside the signature, beyond the line that every S/MIME writer adds.

    No run time reads it, but a reviewer may take it for signed.
    """
    yield from _has(use, "a reviewer may take it for signed.", Kind.UNSIGNED_TEXT)


@rule(
    "KA309",
    Severity.HIGH,
    "NIST SP 800-131A; DDS-Security 1.1, 9.4.1.1",
    sign_again("Sign over SHA-256 (-md sha256)."),
    stops=True,
)
def weak_digest(use: SignedUse) -> Iterator[Violation]:
    """The signature covers a SHA-1 or MD5 digest, for which two documents with one value have been made.

    Whoever could choose what was signed may hold another document with the same signature. Every implementation accepts
    it (measured).
    """
    digests = " ".join(sorted({each.digest for each in use.signed.signatures}))
    for found in _has(use, "another document may have the same signature.", Kind.WEAK_DIGEST):
        yield replace(found, key=f"{found.key} {digests}")


@rule(
    "KA310",
    Severity.MEDIUM,
    "RFC 5652, 5.1; measured: every SignerInfo has to verify",
    sign_again("Sign with one authority."),
    explains=("documents-signed-by-the-permissions-ca",),
)
def several_signers(use: SignedUse) -> Iterator[Violation]:
    """The document has several signers.

    Each has to be a permissions CA. Fast DDS knows all certificates of the CA file, Cyclone DDS only the first
    (measured).
    """
    yield from _has(use, facts.TWO_SIGNERS, Kind.SEVERAL_SIGNERS)


@rule(
    "KA311",
    Severity.MEDIUM,
    "RFC 8551, 3.5.2 (application/pkcs7-mime); measured",
    sign_again("Sign without -nodetach."),
    stops=True,
)
def opaque_message(use: SignedUse) -> Iterator[Violation]:
    """The document is inside the signature, so nobody can review it in an editor.

    Implementations accept it; debug builds of Cyclone DDS stop at an assertion.
    """
    yield from _has(use, "nobody can read it without a tool.", Kind.OPAQUE_MESSAGE)


@rule(
    "KA312",
    Severity.HIGH,
    "RFC 5652, 5.2 (eContent is absent in a detached signature)",
    SIGN_AGAIN,
    stops=True,
)
def two_contents(use: SignedUse) -> Iterator[Violation]:
    """The message carries one content beside the signature and another inside it.

    Which one counts depends on the parser; OpenSSL accepts such a message (measured).
    """
    yield from _has(use, "which of the two counts depends on the parser.", Kind.TWO_CONTENTS, opens=True)


@rule(
    "KA313",
    Severity.LOW,
    "RFC 5652, 5.3 and 11.3; RFC 8551, 2.5",
    sign_again("Sign without -noattr."),
)
def no_signed_attributes(use: SignedUse) -> Iterator[Violation]:
    """The signature covers only the content: nothing says when it was made, or for what kind of content.

    Valid everywhere (measured).
    """
    yield from _has(use, "nothing says when it was signed.", Kind.NO_SIGNED_ATTRIBUTES)


@rule(
    "KA314",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.1; keystore-audit, docs/model.md (what is not read counts as able to do anything)",
    sign_again("Sign with ECDSA or RSA over SHA-256."),
    stops=True,
)
def unsupported_signature_algorithm(use: SignedUse) -> Iterator[Violation]:
    """The signature uses an algorithm that is not verified here.

    OpenSSL may verify it, so it is unknown whether the signature is valid.
    """
    yield from _has(use, "whether it is valid is unknown.", Kind.UNSUPPORTED_ALGORITHM, opens=True)


@rule(
    "KA315",
    Severity.HIGH,
    "RFC 5652, 5.1; DDS-Security 1.1, 9.4.1.1",
    SIGN_AGAIN,
    explains=("documents-signed-by-the-permissions-ca",),
    stops=True,
)
def no_signer(use: SignedUse) -> Iterator[Violation]:
    """The message has the form of a signed one, but no signature: every implementation refuses it."""
    yield from _has(use, "every implementation refuses it.", Kind.NO_SIGNER)
