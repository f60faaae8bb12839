"""KA3: who signed governance.p7s and permissions.p7s (DDS-Security 1.1, 9.4.1.1). Their form is in `envelope.py`.

One document yields its most specific finding. It was signed by an identity, by the authority's key under another
certificate, by somebody else, or not validly at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Any, Final

from keystore_audit.findings import Act, Severity, decision
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.smime import Signature
from keystore_audit.model.trust.chain import path_refusal, signer_refusal
from keystore_audit.model.trust.verdicts import document_verdict, may_sign, vouches
from keystore_audit.profiles import VARIANTS, Profile, facts, implementations
from keystore_audit.rules.registry import Context, Violation, located, of_kinds, paths, quoted, rule
from keystore_audit.rules.remedies import sign_again
from keystore_audit.rules.subjects import EXCHANGED, SPEC, DocumentUse, SignedUse, accepting, exchange, signed_bytes
from keystore_audit.truth import Truth

_SIGNED: Final = "documents-signed-by-the-permissions-ca"
_FORGED: Final = (
    _SIGNED,
    "no-enclave-grants-itself-rights",
    "nobody-writes-without-a-grant",
    "nobody-reads-without-a-grant",
)


class _Maker(Enum):
    """Who made a signature, as far as the certificates of the keystore and of the message tell."""

    AUTHORITY = "the permissions CA of every enclave that carries the document"
    RENEWED = "the key of a permissions CA, under another certificate"
    IDENTITY = "an identity, or another certificate that the permissions CA issued"
    STRANGER = "somebody else"
    NOBODY = "no key that it names: content or signature were changed"


def _maker(use: SignedUse, signature: Signature, context: Context) -> tuple[_Maker, Certificate | None]:
    """Who made the signature, with the certificate that tells so."""
    if signature.digest_matches is False or any(of_kinds(use.signed.defects, Kind.DIGEST_MISMATCH)):
        return _Maker.NOBODY, None
    verified = {certificate.sha256 for certificate in signature.verified_by}
    signer = next((certificate for certificate in signature.named if certificate.sha256 in verified), None)
    if signer is None:
        return _unnamed(use, signature)
    if all(may_sign(signer, use.signed, file, SPEC) for _enclave, file in use.judging):
        return _Maker.AUTHORITY, signer
    if _holder(signer, context) is not None:
        return _Maker.IDENTITY, signer
    keys = {authority.key for authority in use.authorities}
    own = any(signer.sha256 == authority.sha256 for authority in use.authorities)
    if signer.key in keys and not own:
        return _Maker.RENEWED, signer
    if not own and any(vouches(authority, signer) for authority in use.authorities):
        return _Maker.IDENTITY, signer
    return _Maker.STRANGER, signer


def _unnamed(use: SignedUse, signature: Signature) -> tuple[_Maker, Certificate | None]:
    """Who made a signature that verifies under no certificate which it names."""
    keys = {authority.key for authority in use.authorities}
    for certificate in signature.verified_by:
        if certificate.key in keys:
            return _Maker.RENEWED, certificate
    if signature.verified_by:
        return _Maker.STRANGER, signature.verified_by[0]
    return (_Maker.NOBODY, signature.named[0]) if signature.named else (_Maker.STRANGER, None)


def _holder(signer: Certificate, context: Context) -> Enclave | None:
    """The enclave whose identity it is, by certificate or by key."""
    for enclave in context.keystore.enclaves:
        first = enclave.identity
        if first is not None and (first.sha256 == signer.sha256 or first.key == signer.key):
            return enclave
    return None


def _makers(use: SignedUse, context: Context, wanted: _Maker) -> Iterator[tuple[Certificate | None, Signature]]:
    """The signatures made by these, each maker once."""
    if use.genuine_everywhere:
        return
    seen: set[tuple[_Maker, str | int]] = set()
    for signature in use.signed.signatures:
        maker, certificate = _maker(use, signature, context)
        mark = (maker, certificate.sha256 if certificate is not None else signature.serial)
        if maker is wanted and mark not in seen:
            seen.add(mark)
            yield certificate, signature


def _readable(use: SignedUse, _context: Context) -> bool:
    """Whether there is a signature to judge, of which we know what it covers."""
    refused_form = any(of_kinds(use.signed.defects, Kind.NOT_SMIME, Kind.NO_TEXT_PLAIN))
    return bool(use.signed.signatures) and not refused_form and use.envelope.verdict is not Truth.UNKNOWN


def _comparable(use: SignedUse, context: Context) -> bool:
    """Whether there is an authority to compare its signer with as well."""
    return _readable(use, context) and bool(use.judging)


def _refusing(use: SignedUse) -> tuple[tuple[Enclave, CertificateFile], ...]:
    """The enclaves whose permissions CA did not sign."""
    return tuple(
        (enclave, file) for enclave, file in use.judging if document_verdict(use.signed, file, SPEC) is Truth.NO
    )


def _accepting(use: SignedUse) -> tuple[Profile, ...]:
    """The known variants that take the document in one of those enclaves all the same."""
    return accepting(use.signed, [file for _enclave, file in _refusing(use)])


def _explained(use: SignedUse, context: Context) -> frozenset[str]:
    """The properties that such a document violates where one in scope takes it, and where none does."""
    return frozenset(_FORGED if context.chose(_accepting(use)) else (_SIGNED,))


def _consequence(use: SignedUse, context: Context) -> str:
    """Who in scope refuses and accepts a document that not every enclave's permissions CA signed, and who beyond it
    accepts.
    """
    refusing = _refusing(use)
    whom = "" if len(refusing) == len(use.enclaves) else f" in {paths(enclave for enclave, _file in refusing)}"
    accepted = _accepting(use)
    if not accepted:
        return f"refused by every known implementation{whom}"
    told = {
        "accepted by": [profile for profile in context.profiles if profile in accepted],
        f"refused{whom} by": [profile for profile in context.profiles if profile not in accepted],
        "beyond the scope accepted by": [profile for profile in accepted if profile not in context.profiles],
    }
    return "; ".join(f"{verb} {implementations(profiles)}" for verb, profiles in told.items() if profiles)


def _violation(use: SignedUse, message: str, signer: Certificate | None, key: str, **more: Any) -> Violation:
    """A violation about the document; the signer's certificate is a second place, unless that is in the message."""
    place = use.at(1)
    found = [] if signer is None else [located(signer, "the signer's certificate")]
    return Violation(
        message,
        (place, *(location for location in found if location.path != place.path)),
        # What was signed is part of it, with all of its dates: who accepts this accepts no other document.
        key=f"{key} {signed_bytes(use.signed)}",
        **more,
    )


def _expected(use: SignedUse) -> str:
    """The authority that should have signed, with its number: sros2 calls every authority alike."""
    refusing = _refusing(use) or use.judging
    authority = refusing[0][1].certificates[0]
    return (
        f"expected the certificate in {authority.path}, {quoted(authority.subject)}, serial number {authority.serial:x}"
    )


@rule(
    "KA301",
    Severity.CRITICAL,
    "DDS-Security 1.1, 9.4.1.1 (signed with the private key of the permissions CA)",
    sign_again("Find out who signed it and why. Review the .xml before you sign it: it may be forged, too."),
    explains=_FORGED,
    applies=_comparable,
    stops=True,
)
def signer_not_permissions_ca(use: SignedUse, context: Context) -> Iterator[Violation]:
    """Somebody else than the permissions CA made the signature, and no identity of this keystore either.

    A certificate of the permissions CA file itself has to make every SignerInfo. Names prove nothing: sros2 calls every
    authority CN=sros2CA. If the signer's certificate is neither here nor in the message, the signature's validity is
    unknown. Critical even if all refuse it.
    """
    for signer, signature in _makers(use, context, _Maker.STRANGER):
        got = (
            f"a certificate that is not here, serial number {signature.serial:x}"
            if signer is None
            else f"{quoted(signer.subject)}, serial number {signer.serial:x}"
        )
        exchanged = exchange([enclave for enclave, _file in use.judging], signer) if signer is not None else None
        why = f" {EXCHANGED}" if exchanged else ""
        yield _violation(
            use,
            f"{use.signed.file.place} is signed by {got}, and {_consequence(use, context)}; {_expected(use)}.{why}",
            signer,
            signer.key if signer is not None else f"{signature.serial:x}",
            explains=_explained(use, context),
            remedy=exchanged,
        )


@rule(
    "KA302",
    Severity.CRITICAL,
    "DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012",
    decision(
        "Find out who signed it. Unless that was a mistake, treat the enclave as taken over: give it a new identity. "
        "Review the .xml before you sign it: it may be forged, too.",
        Act.SIGN,
    ),
    explains=_FORGED,
    applies=_comparable,
    stops=True,
)
def signed_by_an_identity(use: SignedUse, context: Context) -> Iterator[Violation]:
    """An identity, not the permissions CA, made the signature: an enclave gave rights to itself or to another.

    `openssl smime -verify -CAfile` says "Verification successful". Implementations that take any signer under the
    authority accept it (measured with real processes).
    """
    for signer, _signature in _makers(use, context, _Maker.IDENTITY):
        if signer is None:
            continue
        holder = _holder(signer, context)
        who = f"the identity of {holder.path}" if holder is not None else "a certificate that the permissions CA issued"
        yield _violation(
            use,
            f"{use.signed.file.place} is signed by {who}, {quoted(signer.subject)}: it gave out rights, or somebody "
            f"has its key. The document is {_consequence(use, context)}; {_expected(use)}.",
            signer,
            signer.key,
            explains=_explained(use, context),
        )


@rule(
    "KA303",
    Severity.CRITICAL,
    "RFC 5652, 5.4 and 5.6 (message digest, signature verification); DDS-Security 1.1, 9.4.1.1",
    sign_again("Find out who changed the file. Review the .xml before you sign it: it may be forged, too."),
    explains=(_SIGNED,),
    applies=_readable,
    stops=True,
)
def signature_invalid(use: SignedUse, context: Context) -> Iterator[Violation]:
    """Content or signature were changed after signing.

    Every implementation refuses the document, so its enclaves cannot start. A changed line end counts: sros2 and
    OpenSSL sign CRLF, and LF in its place inside the signed part breaks the signature.
    """
    for number, (named, signature) in enumerate(_makers(use, context, _Maker.NOBODY), start=1):
        mismatch = next(of_kinds(use.signed.defects, Kind.DIGEST_MISMATCH), None)
        if mismatch is not None or signature.digest_matches is False:
            why = "the content's digest is not the signed one"
        else:
            why = f"it does not verify under {quoted(named.subject)}, which it names" if named else "it names nobody"
        yield _violation(
            use,
            f"The signature is not valid: {why}; every implementation refuses {use.signed.file.place}.",
            named,
            f"{number}",
        )


@rule(
    "KA316",
    Severity.HIGH,
    "RFC 5652, 5.3 (issuerAndSerialNumber); measured: signers are looked up by it",
    sign_again("Sign every document again after renewing the authority's certificate."),
    explains=(_SIGNED,),
    applies=_comparable,
    stops=True,
)
def signed_by_renewed_ca(use: SignedUse, context: Context) -> Iterator[Violation]:
    """The permissions CA's key made the signature, but the signature names another certificate of that key.

    The authority was renewed without signing again, or the other way round. Run times look for issuer and serial number
    and find no signer.
    """
    for signer, signature in _makers(use, context, _Maker.RENEWED):
        yield _violation(
            use,
            "The permissions CA's key signed, but the signature names a certificate with the serial number "
            f"{signature.serial:x}; {_expected(use)}. The authority was renewed, and run times look for the serial "
            f"number ({_consequence(use, context)}).",
            signer,
            f"{signature.serial:x}",
        )


@rule(
    "KA317",
    Severity.HIGH,
    f"DDS-Security 1.1, 9.4.1.1; {facts.MESSAGES_MEASURED}",
    decision(
        "Put one self-signed certificate alone into permissions_ca.cert.pem: that of the signer, without a keyUsage "
        "that "
        "forbids digital signatures. Put it into the message, too (no -nocerts)."
    ),
    applies=_comparable,
    stops=True,
)
def signer_refused_by_implementations(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """The permissions CA signed, but some implementations refuse the document.

    Cyclone DDS and OpenDDS read only the first certificate of the CA file. Implementations that do not pin the signer
    look for it in the message. They want it fit for S/MIME signing, chained to a self-signed one, and try only the
    first of each name. High if a chosen profile refuses, else low.
    """
    refusals: dict[str, list[Profile]] = {}
    for file in dict.fromkeys(file for _enclave, file in use.judging):
        if document_verdict(use.signed, file, SPEC) is not Truth.YES:
            continue
        for profile in VARIANTS.values():
            refused = document_verdict(use.signed, file, profile.trust) is Truth.NO
            why = (signer_refusal if refused else path_refusal)(use.signed, file, profile.trust)
            if why is None:
                why = path_refusal(use.signed, file, profile.trust, context.at)
            if why is not None and profile not in refusals.setdefault(why, []):
                refusals[why].append(profile)
    refusing = [profile for profiles in refusals.values() for profile in profiles]
    if refusing:
        reasons = "; ".join(f"{implementations(profiles)}: {why}" for why, profiles in refusals.items())
        chosen = context.chose(refusing)
        names = tuple(profile.name for profile in VARIANTS.values() if profile in refusing)
        yield Violation(
            f"{use.signed.file.place} is refused ({reasons}).",
            (use.at(1),),
            severity=None if chosen else Severity.LOW,
            profiles=names,
            key=f"refused {' '.join(names)}",
            explains=frozenset({_SIGNED} if chosen else ()),
        )
