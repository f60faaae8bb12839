"""S/MIME signed documents, read by OpenSSL's MIME algorithm (crypto/asn1/asn_mime.c)."""

from __future__ import annotations

import base64
import hashlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import Final, overload

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.x509.oid import PublicKeyAlgorithmOID
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.certificate import Certificate, read_certificates
from keystore_audit.keystore.cms import CmsError, SignedData, SignerInfo, has_string_values, read_signed_data
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.der import well_formed_throughout
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.mime import Message, MimeError, read_message, split_text
from keystore_audit.keystore.public_key import DIGESTS

MAX_KEYS_TRIED: Final = 64
"""Distinct keys that are tried on one signature beyond those that it names: a document that no certificate of the
keystore signed would otherwise cost one verification (0.1 ms) for every enclave, and as often as there are such
documents. What an unnamed key verifies explains a refusal and changes no verdict."""

_HASH: Final = {name: getattr(hashlib, name) for name in DIGESTS}


class Signature(Struct, frozen=True, kw_only=True):
    """One SignerInfo of a CMS SignedData (RFC 5652 5.3), and whose key made it.

    `named`: candidates whose issuer and serial number the signer identifier names.
    `verified_by`: candidates whose key verifies the signature over this content (a renewed CA with the same key is
    in `verified_by` but not in `named`). `digest_matches`: the messageDigest attribute equals the
    digest of the content; None where there are no signed attributes (the signature covers the content itself).
    """

    issuer_der: bytes
    serial: int
    digest: str
    """`sha256`, `sha1`, … or the dotted identifier of an unknown one."""
    digest_matches: bool | None
    named: tuple[Certificate, ...]
    verified_by: tuple[Certificate, ...]
    signing_time: datetime | None
    """Asserted by the signer (RFC 5652 11.3): a hint, never trusted."""
    value: bytes = b""
    hashed: bytes = b""
    """The signature itself, and the digest of what it covers; empty where that is of an unknown kind."""


class SignedDocument(Struct, frozen=True, kw_only=True, eq=False):
    """`governance.p7s` or `permissions.p7s` as read; compared by identity, so that verdicts can be kept by document.

    `content` is the signed XML as OpenSSL hands it to a DDS implementation: canonical CRLF line ends, without the
    `Content-Type: text/plain` header; None where it could not be separated. `first_line` is
    the line of the file at which `content` begins, None for an opaque message (its XML has no line of its own there).
    `embedded` are the certificates inside the message; one that the keystore holds too is that object, with its place.
    """

    file: File
    content: bytes | None
    first_line: int | None
    embedded: tuple[Certificate, ...]
    signatures: tuple[Signature, ...]
    defects: tuple[Defect, ...]

    def line(self, content_line: int | None) -> int | None:
        """The line of the file for line `content_line` (from 1) of the signed XML."""
        if self.first_line is None or content_line is None:
            return None
        return self.first_line + content_line - 1

    def defect(self, kind: Kind, content_line: int | None, detail: str) -> Defect:
        """A defect in the signed XML."""
        return Defect(kind=kind, path=self.file.place, line=self.line(content_line), detail=detail)


class Candidates(Sequence[Certificate]):
    """Certificates that may have signed, found by signer identifier and by key without looking at each.

    Make it once for a keystore: it is what `read_signed` works with.
    """

    def __init__(self, certificates: Iterable[Certificate]) -> None:
        self._certificates = tuple({certificate.sha256: certificate for certificate in certificates}.values())
        self._by_digest = {certificate.sha256: certificate for certificate in self._certificates}
        self._by_name: dict[tuple[bytes, int], list[Certificate]] = {}
        self._by_key: dict[str, list[Certificate]] = {}
        for certificate in self._certificates:
            self._by_name.setdefault((certificate.issuer_der, certificate.serial), []).append(certificate)
            self._by_key.setdefault(certificate.key, []).append(certificate)

    @overload
    def __getitem__(self, index: int) -> Certificate: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Certificate, ...]: ...
    def __getitem__(self, index: int | slice) -> Certificate | tuple[Certificate, ...]:
        return self._certificates[index]

    def __len__(self) -> int:
        return len(self._certificates)

    def known(self, der: bytes) -> Certificate | None:
        """The candidate with these bytes."""
        return self._by_digest.get(hashlib.sha256(der).hexdigest())

    def named(self, issuer_der: bytes, serial: int) -> list[Certificate]:
        """The candidates that a signer identifier names (RFC 5652, 5.3); the same certificate only once."""
        return self._by_name.get((issuer_der, serial), [])

    def with_key(self, key: str) -> list[Certificate]:
        """The candidates with this public key."""
        return self._by_key.get(key, [])

    def one_per_key(self) -> Iterator[Certificate]:
        """One candidate for each distinct key, in the order given."""
        return (certificates[0] for certificates in self._by_key.values())


_NOBODY: Final = Candidates(())


def read_signed(file: File, candidates: Sequence[Certificate]) -> SignedDocument:
    """Read a signed document and find whose keys made its signatures; never raises.

    `candidates`: every certificate of the keystore, likely signers first, best as `Candidates`. Certificates inside
    the message count as candidates too: whether such a signer may sign is not decided here.
    """
    reading = _Reading(file, candidates if isinstance(candidates, Candidates) else Candidates(candidates))
    if file.content is not None:
        reading.read(file.content)
    return SignedDocument(
        file=file,
        content=reading.content,
        first_line=reading.first_line,
        embedded=reading.embedded,
        signatures=reading.signatures,
        defects=tuple(reading.defects),
    )


class _Reading:
    """One document while it is read: what was found so far stays when a later step fails."""

    def __init__(self, file: File, candidates: Candidates) -> None:
        self.content: bytes | None = None
        self.first_line: int | None = None
        self.embedded: tuple[Certificate, ...] = ()
        self.signatures: tuple[Signature, ...] = ()
        self.defects: list[Defect] = []
        self._file = file
        self._candidates = candidates
        self._strangers = _NOBODY

    def read(self, data: bytes) -> None:
        try:
            message = read_message(data)
            for text in message.unsigned:
                self._defect(Kind.UNSIGNED_TEXT, text.line, text.detail)
            signed, entity = self._signed_data(message)
            if entity is not None:
                self._text(message, entity)
        except MimeError as error:
            self._defect(error.kind, error.line, error.detail)
            return
        if signed is None:
            return
        for kind, detail in signed.problems:
            self._defect(kind, message.signature_line, detail)
        self._embedded(signed, message.signature_line)
        if entity is not None:
            self._signatures(signed, entity, message)

    def _defect(self, kind: Kind, line: int | None, detail: str) -> None:
        self.defects.append(Defect(kind=kind, path=self._file.place, line=line, detail=detail))

    def _signed_data(self, message: Message) -> tuple[SignedData | None, bytes | None]:
        """The CMS structure, and the bytes that its signatures cover."""
        line = message.signature_line
        try:
            signed = read_signed_data(message.signature)
        except CmsError as error:
            self._defect(error.kind, line, error.detail)
            return None, message.entity
        if message.entity is None:
            detail = "text and signature in one structure (openssl: -nodetach), which no line of the file shows"
            self._defect(Kind.OPAQUE_MESSAGE, line, detail)
            if signed.content is None:
                self._defect(
                    Kind.CMS_MALFORMED, line, "there is no signed text, neither outside nor inside the signature"
                )
            return signed, signed.content
        if signed.content is not None:
            detail = "one text outside the signature and one inside: readers take either"
            self._defect(Kind.TWO_CONTENTS, line, detail)
        return signed, message.entity

    def _text(self, message: Message, entity: bytes) -> None:
        try:
            self.content, line = split_text(entity, message.entity_line)
        except MimeError as error:
            self._defect(error.kind, error.line, error.detail)
        else:
            self.first_line = line if message.entity is not None else None

    # --- signatures

    def _embedded(self, signed: SignedData, line: int) -> None:
        found, strangers = [], []
        for der in signed.certificates:
            known = self._candidates.known(der)
            if known is not None:
                found.append(known)
                continue
            certificate = _certificate(der, self._file, line)
            if certificate is None:
                self._defect(Kind.CMS_MALFORMED, line, "a certificate inside the message cannot be read")
            else:
                found.append(certificate)
                strangers.append(certificate)
        self.embedded = tuple(found)
        if strangers:
            self._strangers = Candidates(strangers)

    def _signatures(self, signed: SignedData, entity: bytes, message: Message) -> None:
        line = message.signature_line
        self.signatures = tuple(self._signature(signer, entity, line) for signer in signed.signers)
        if len(signed.signers) > 1:
            self._defect(Kind.SEVERAL_SIGNERS, line, f"expected one signature, found {len(signed.signers)}")
        two_contents = signed.content is not None and message.entity is not None
        if not two_contents and any(signature.digest_matches is False for signature in self.signatures):
            detail = "the text is not the one that was signed: its digest differs from the one in the signature"
            self._defect(Kind.DIGEST_MISMATCH, line, detail)

    def _signature(self, signer: SignerInfo, entity: bytes, line: int) -> Signature:
        """Check one signature over `entity`; what cannot be checked here becomes a defect."""
        digest_matches = None
        if signer.message_digest is not None and signer.digest in _HASH:
            digest_matches = _HASH[signer.digest](entity).digest() == signer.message_digest
        name = (signer.issuer_der, signer.serial)
        named = (*self._candidates.named(*name), *self._strangers.named(*name))
        data = entity if signer.signed is None else signer.signed
        maker = self._named_maker(signer, data, named, line) or self._unnamed_maker(signer, data, named, line)
        key = "" if maker is None else maker.key
        return Signature(
            issuer_der=signer.issuer_der,
            serial=signer.serial,
            digest=signer.digest,
            digest_matches=digest_matches,
            named=named,
            verified_by=(*self._candidates.with_key(key), *self._strangers.with_key(key)),
            signing_time=signer.signing_time,
            value=signer.signature,
            hashed=_HASH[signer.digest](data).digest() if signer.digest in _HASH else b"",
        )

    def _named_maker(
        self, signer: SignerInfo, data: bytes, named: tuple[Certificate, ...], line: int
    ) -> Certificate | None:
        """The certificate that the signer identifier names and whose key made the signature over `data`."""
        for certificate in self._distinct_keys(named, line):
            scheme = signer.scheme
            if scheme.family is not None and not certificate.key_kind.startswith(scheme.family):
                found = f"a signature algorithm for {scheme.family} by a signer whose key is {certificate.key_kind}"
                self._defect(Kind.CMS_MALFORMED, line, found)  # OpenSSL goes by the key
                continue
            answer = _made_by(certificate, signer, data)
            if answer:
                return certificate
            said = signer.digest not in DIGESTS or any(
                kind is Kind.UNSUPPORTED_ALGORITHM for kind, _ in scheme.problems
            )
            if answer is None and not said:
                found = f"a signature that cannot be checked here: {signer.digest}, key {certificate.key_kind}"
                self._defect(Kind.UNSUPPORTED_ALGORITHM, line, found)
        return None

    def _unnamed_maker(
        self, signer: SignerInfo, data: bytes, named: tuple[Certificate, ...], line: int
    ) -> Certificate | None:
        """Another candidate whose key made the signature: it explains why the named ones did not."""
        tried = {certificate.key for certificate in named}
        everyone = itertools.chain(self._candidates, self._strangers)
        same_serial = [other for other in everyone if other.serial == signer.serial and other.key not in tried]
        for other in self._distinct_keys(same_serial, line):
            if _made_by(other, signer, data):
                # OpenSSL compares names by meaning (X509_NAME_cmp), so it may take this one for the signer.
                found = "the issuer in the signature is written in other bytes than in the signer's certificate"
                self._defect(Kind.CMS_MALFORMED, line, found)
                return other
        keys = itertools.chain(self._candidates.one_per_key(), self._strangers.one_per_key())
        others = itertools.islice((other for other in keys if other.key not in tried), MAX_KEYS_TRIED)
        return next((other for other in others if _made_by(other, signer, data)), None)

    def _distinct_keys(self, certificates: Iterable[Certificate], line: int) -> list[Certificate]:
        """One certificate for each key; more than can be tried are a defect, since a run time would try them."""
        distinct = list({certificate.key: certificate for certificate in certificates}.values())
        if len(distinct) > MAX_KEYS_TRIED:
            found = f"{len(distinct)} certificates that may be the signer's, {MAX_KEYS_TRIED} are tried"
            self._defect(Kind.CMS_MALFORMED, line, found)
        return distinct[:MAX_KEYS_TRIED]


def _made_by(certificate: Certificate, signer: SignerInfo, data: bytes) -> bool | None:
    """Whether the certificate's key made the signature over `data`; None where that cannot be checked."""
    try:
        key = certificate.parsed.public_key()
    except (ValueError, UnsupportedAlgorithm):
        return None
    made = signer.scheme.made_by(key, signer.signature, data)
    if made is False and certificate.parsed.public_key_algorithm_oid == PublicKeyAlgorithmOID.RSASSA_PSS:
        return None  # a key for RSA-PSS alone, which OpenSSL uses so whatever the signature algorithm says
    return made


def _certificate(der: bytes, file: File, line: int) -> Certificate | None:
    """Read a certificate that stands in no file of its own."""
    if not well_formed_throughout(der):
        return None
    pem = b"-----BEGIN CERTIFICATE-----\n" + base64.encodebytes(der) + b"-----END CERTIFICATE-----\n"
    alone = File(path=file.path, resolved=file.resolved, status=Status.PRESENT, content=pem)
    first = read_certificates(alone).first
    if first is None or not (has_string_values(first.subject_der) and has_string_values(first.issuer_der)):
        return None
    return replace(first, line=line)
