"""KA3: the signatures of governance.p7s and permissions.p7s (DDS-Security 1.1, 9.4.1.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import Signature
from keystore_audit.model.trust import Verdict, envelope, may_sign, vouches
from keystore_audit.rules.context import Context
from keystore_audit.rules.places import from_defect, implementations, of_kinds, pinned, sole, unpinned
from keystore_audit.rules.registry import Rule, Violation, rule
from keystore_audit.rules.subjects import DocumentUse

SIGN_AGAIN = (
    "Sign the document again with the permissions CA: openssl smime -sign -text -in DOCUMENT.xml -out DOCUMENT.p7s "
    "-signer permissions_ca.cert.pem -inkey permissions_ca.key.pem (or ros2 security create_permission)"
)


def _foreign_signers(use: DocumentUse) -> tuple[Certificate, ...]:
    """Signers of a sound signature that are no permissions CA of an enclave which carries the document."""
    judged = envelope(use.signed)
    if judged.verdict is not Verdict.ACCEPTED:
        return ()
    return tuple(
        signer
        for signer in judged.signers
        if any(
            enclave.permissions_ca is not None and not may_sign(signer, enclave.permissions_ca, pins_signer=True)
            for enclave in use.enclaves
        )
    )


def _renewed(use: DocumentUse, signer: Certificate) -> bool:
    """Whether the signer's key is that of a permissions CA of the enclaves."""
    return any(
        authority.key == signer.key
        for enclave in use.enclaves
        if enclave.permissions_ca is not None
        for authority in enclave.permissions_ca.certificates
    )


def _identity_of(signer: Certificate, context: Context) -> str | None:
    """The enclave whose identity certificate, or key, the signer is."""
    for enclave in context.keystore.enclaves:
        first = enclave.certificate.first if enclave.certificate else None
        if first is not None and (first.sha256 == signer.sha256 or first.key == signer.key):
            return enclave.path
    return None


def _chains(use: DocumentUse, signer: Certificate) -> bool:
    """Whether a permissions CA of the enclaves vouches for the signer."""
    return any(
        vouches(authority, signer)
        for enclave in use.enclaves
        if enclave.permissions_ca is not None
        for authority in enclave.permissions_ca.certificates
    )


def _accepted_unpinned(use: DocumentUse) -> bool:
    """Whether implementations that do not pin the signer take the document."""
    judged = envelope(use.signed)
    return judged.verdict is Verdict.ACCEPTED and any(
        enclave.permissions_ca is not None
        and all(may_sign(signer, enclave.permissions_ca, pins_signer=False) for signer in judged.signers)
        for enclave in use.enclaves
    )


def _by_whom(use: DocumentUse) -> str:
    """Who refuses and who accepts a document that another than the permissions CA signed."""
    if not _accepted_unpinned(use):
        return "Refused by every known implementation."
    return f"Refused by {implementations(pinned())}; ACCEPTED by {implementations(unpinned())}."


def _place(use: DocumentUse) -> Location:
    return Location(path=use.signed.file.place, line=1)


@rule(
    "KA301",
    "signer-not-permissions-ca",
    Severity.CRITICAL,
    on=DocumentUse,
    clause="DDS-Security 1.1, 9.4.1.1 (signed by the permissions CA)",
    remedy=SIGN_AGAIN,
    explains=("documents-signed-by-the-permissions-ca", "no-enclave-grants-itself-rights"),
)
def signer_not_permissions_ca(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """The signature holds, but somebody else than the permissions CA made it.

    A name proves nothing: every CA that sros2 makes is called CN=sros2CA. Compared are certificates and keys.
    """
    for signer in _foreign_signers(use):
        if _identity_of(signer, context) or _chains(use, signer) or _renewed(use, signer):
            continue
        yield Violation(
            message=f"Signed by {signer.subject!r} ({signer.path}), expected the permissions CA's own certificate. "
            + _by_whom(use),
            locations=(_place(use), Location(path=signer.path, line=signer.line, message="the signer")),
            enclave=sole(use.enclaves),
            key=signer.subject,
        )


@rule(
    "KA302",
    "signed-by-an-identity",
    Severity.CRITICAL,
    on=DocumentUse,
    clause="DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012",
    remedy="Treat the enclave as compromised: issue its identity again, use separate identity and permissions CAs. "
    + SIGN_AGAIN,
    explains=(
        "documents-signed-by-the-permissions-ca",
        "no-enclave-grants-itself-rights",
        "nobody-writes-without-a-grant",
        "nobody-reads-without-a-grant",
    ),
)
def signed_by_an_identity(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """An identity certificate signed the document: an enclave gave itself its rights.

    `openssl smime -verify -CAfile` accepts it, and so do implementations that take any signer the CA vouches for.
    """
    accepted = _accepted_unpinned(use)
    for signer in _foreign_signers(use):
        identity = _identity_of(signer, context)
        if (identity is None and not _chains(use, signer)) or _renewed(use, signer):
            continue
        who = f"the identity of enclave {identity}" if identity else f"{signer.subject!r}, which the CA issued"
        forge = " There, whoever holds that key can forge its own rights." if accepted else ""
        yield Violation(
            message=f"Signed by {who}, expected the permissions CA's own certificate. {_by_whom(use)}{forge}",
            locations=(_place(use), Location(path=signer.path, line=signer.line, message="the signer")),
            enclave=sole(use.enclaves),
            key=signer.subject,
        )


def _unverified(signature: Signature) -> bool:
    """Whether a signature does not hold under any certificate that it names."""
    verified = {certificate.sha256 for certificate in signature.verified_by}
    return signature.digest_matches is False or not any(c.sha256 in verified for c in signature.named)


@rule(
    "KA303",
    "signature-invalid",
    Severity.CRITICAL,
    on=DocumentUse,
    clause="DDS-Security 1.1, 9.4.1.1; RFC 5652, 5.4",
    remedy="Find out who changed the file. " + SIGN_AGAIN,
    explains=("documents-signed-by-the-permissions-ca",),
)
def signature_invalid(use: DocumentUse, _context: Context) -> Iterator[Violation]:
    """The content or the signature was changed after signing, or the signer's certificate is not known here.

    Every implementation refuses the file, so its enclave cannot start; nothing in it can be believed.
    """
    tampered = next(of_kinds(use.signed.defects, {Kind.DIGEST_MISMATCH}), None)
    if tampered is not None:
        yield from_defect(tampered, use.enclaves, undecided=False)
        return
    if envelope(use.signed).verdict is Verdict.UNKNOWN:
        return
    for number, signature in enumerate(use.signed.signatures):
        if _unverified(signature) and not signature.verified_by:
            if signature.named:
                named = signature.named[0]
                said = f"the signature does not verify under {named.subject!r} ({named.path}), which it names"
            else:
                said = (
                    f"no certificate in the keystore is the signer that it names (serial number {signature.serial:x})"
                )
            yield Violation(
                message=f"Signature {number + 1} is not valid: {said}.",
                locations=(_place(use),),
                enclave=sole(use.enclaves),
                key=f"{number}",
            )


def _defect_rule(
    code: str, name: str, severity: Severity, kinds: tuple[Kind, ...], *, undecided: bool, clause: str, why: str
) -> Rule[DocumentUse]:
    """The rule that the envelope has none of these defects."""

    def check(use: DocumentUse, _context: Context) -> Iterator[Violation]:
        for defect in of_kinds(use.signed.defects, set(kinds)):
            yield from_defect(defect, use.enclaves, undecided=undecided)

    check.__doc__ = why
    register: Callable[[Callable[[DocumentUse, Context], Iterator[Violation]]], Rule[DocumentUse]] = rule(
        code, name, severity, on=DocumentUse, clause=clause, remedy=SIGN_AGAIN
    )
    return register(check)


not_smime = _defect_rule(
    "KA304",
    "not-smime",
    Severity.HIGH,
    (Kind.NOT_SMIME,),
    undecided=False,
    clause="DDS-Security 1.1, 9.4.1.2 and 9.4.1.3; RFC 8551, 3.5.3",
    why="The file is no S/MIME message (plain XML, PEM or DER): every implementation refuses it.",
)

malformed_smime = _defect_rule(
    "KA305",
    "malformed-smime",
    Severity.HIGH,
    (Kind.MIME_MALFORMED,),
    undecided=True,
    clause="RFC 8551, 3.5.3; RFC 2046, 5.1",
    why=(
        "The message can be taken apart in more than one way. OpenSSL, which all measured implementations use, takes"
        " some such files; we do not guess which part it reads, so the meaning is unknown."
    ),
)

cms_not_strict = _defect_rule(
    "KA306",
    "cms-not-strict",
    Severity.HIGH,
    (Kind.CMS_NOT_DER, Kind.CMS_MALFORMED),
    undecided=True,
    clause="RFC 5652; X.690 (DER)",
    why=(
        "The signature is not strict DER. Implementations accept BER and bytes after the end; we do not interpret what"
        " two parsers may read differently, so the meaning is unknown."
    ),
)

no_text_plain_header = _defect_rule(
    "KA307",
    "no-text-plain-header",
    Severity.HIGH,
    (Kind.NO_TEXT_PLAIN,),
    undecided=False,
    clause="DDS-Security 1.1, 9.4.1.2 (S/MIME with Content-Type text/plain); measured",
    why=(
        "The signed part has no Content-Type: text/plain header (signed without -text): every implementation"
        " refuses it."
    ),
)

unsigned_text = _defect_rule(
    "KA308",
    "unsigned-text",
    Severity.MEDIUM,
    (Kind.UNSIGNED_TEXT,),
    undecided=False,
    clause="RFC 2046, 5.1.1 (preamble and epilogue)",
    why="Text stands outside the signature. Implementations ignore it; a person who reviews the file may not.",
)

weak_digest = _defect_rule(
    "KA309",
    "weak-digest",
    Severity.HIGH,
    (Kind.WEAK_DIGEST,),
    undecided=False,
    clause="NIST SP 800-131A; DDS-Security 1.1, 9.4.1.1",
    why=(
        "The signature uses SHA-1 or MD5, for which two documents with one digest can be made. Implementations"
        " accept it."
    ),
)

several_signers = _defect_rule(
    "KA310",
    "several-signers",
    Severity.MEDIUM,
    (Kind.SEVERAL_SIGNERS,),
    undecided=False,
    clause="RFC 5652, 5.1",
    why="The document has several signers; implementations demand that each of them is a permissions CA.",
)

opaque_message = _defect_rule(
    "KA311",
    "opaque-message",
    Severity.MEDIUM,
    (Kind.OPAQUE_MESSAGE,),
    undecided=False,
    clause="RFC 8551, 3.5.2; measured",
    why=(
        "The document is inside the signature, not beside it: nobody can read it in an editor, and a debug build of"
        " Cyclone DDS stops on it."
    ),
)

two_contents = _defect_rule(
    "KA312",
    "two-contents",
    Severity.HIGH,
    (Kind.TWO_CONTENTS,),
    undecided=True,
    clause="RFC 5652, 5.2; RFC 8551, 3.5.3",
    why=(
        "The message carries one content beside the signature and another inside it. Which one is read depends on the "
        "implementation, so the meaning is unknown."
    ),
)

no_signed_attributes = _defect_rule(
    "KA313",
    "no-signed-attributes",
    Severity.LOW,
    (Kind.NO_SIGNED_ATTRIBUTES,),
    undecided=False,
    clause="RFC 5652, 5.3; RFC 8551, 2.5",
    why="The signature has no signed attributes, so no signing time is bound to it.",
)

unsupported_signature_algorithm = _defect_rule(
    "KA314",
    "unsupported-signature-algorithm",
    Severity.HIGH,
    (Kind.UNSUPPORTED_ALGORITHM,),
    undecided=True,
    clause="DDS-Security 1.1, 9.3.1.1 and 9.4.1.1",
    why=(
        "The signature uses an algorithm that we do not verify. An implementation may accept it, so its worth is"
        " unknown."
    ),
)

no_signer = _defect_rule(
    "KA315",
    "no-signer",
    Severity.HIGH,
    (Kind.NO_SIGNER,),
    undecided=False,
    clause="RFC 5652, 5.1",
    why="The message holds no signature at all: every implementation refuses it.",
)


@rule(
    "KA316",
    "signed-by-renewed-ca",
    Severity.HIGH,
    on=DocumentUse,
    clause="RFC 5652, 5.3 (issuerAndSerialNumber)",
    remedy="Sign every document again after renewing the CA certificate. " + SIGN_AGAIN,
    explains=("documents-signed-by-the-permissions-ca",),
)
def signed_by_renewed_ca(use: DocumentUse, _context: Context) -> Iterator[Violation]:
    """The permissions CA's key signed, but the signature names another certificate of that key.

    So it happens when the CA certificate was renewed: implementations look for the serial number and refuse the
    document.
    """
    signers = {signer.sha256: signer for signer in _foreign_signers(use) if _renewed(use, signer)}
    for signature in use.signed.signatures:
        if _unverified(signature):
            for certificate in signature.verified_by:
                if _renewed(use, certificate):
                    signers.setdefault(certificate.sha256, certificate)
    for signer in signers.values():
        yield Violation(
            message=(
                f"The key of {signer.subject!r} made the signature, but it names another certificate than the"
                " permissions CA's: the CA was renewed after signing."
            ),
            locations=(_place(use), Location(path=signer.path, line=signer.line, message="the CA certificate")),
            enclave=sole(use.enclaves),
            key=signer.subject,
        )


SIGNATURE: tuple[Rule[Any], ...] = (
    signer_not_permissions_ca,
    signed_by_an_identity,
    signature_invalid,
    not_smime,
    malformed_smime,
    cms_not_strict,
    no_text_plain_header,
    unsigned_text,
    weak_digest,
    several_signers,
    opaque_message,
    two_contents,
    no_signed_attributes,
    unsupported_signature_algorithm,
    no_signer,
    signed_by_renewed_ca,
)
