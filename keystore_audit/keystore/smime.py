"""S/MIME signed documents, read by OpenSSL's MIME algorithm (crypto/asn1/asn_mime.c)."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable
from datetime import datetime
from typing import Final

from cryptography.x509.oid import PublicKeyAlgorithmOID
from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate, read_certificate
from keystore_audit.keystore.cms import CmsError, SignedData, SignerInfo, has_string_values, read_signed_data
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.der import well_formed_throughout
from keystore_audit.keystore.files import File
from keystore_audit.keystore.mime import Message, MimeError, read_message, split_text
from keystore_audit.keystore.public_key import DIGESTS, public_half
from keystore_audit.truth import Truth

MAX_KEYS_TRIED: Final = 64
"""Distinct keys that are tried on one signature beyond those that it names. Without the limit, each document that no
certificate of the keystore signed would cost one verification (0.1 ms) for every enclave. What an unnamed key verifies
explains a refusal and changes no verdict."""

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

    `content` is the signed XML as OpenSSL hands it to a DDS implementation. It has canonical CRLF line ends and no
    `Content-Type: text/plain` header, and is None where it could not be separated. `first_line` is
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


class Candidates:
    """Certificates that may have signed, each once and in the order given, found without looking at each.

    Make it once for a keystore: it is what `read_signed` works with. `by_name`: what a signer identifier names, by
    issuer in DER and serial number (RFC 5652, 5.3).
    """

    def __init__(self, certificates: Iterable[Certificate]) -> None:
        self.by_digest = {certificate.sha256: certificate for certificate in certificates}
        self.by_name: dict[tuple[bytes, int], list[Certificate]] = {}
        self.by_key: dict[str, list[Certificate]] = {}
        for certificate in self.by_digest.values():
            self.by_name.setdefault((certificate.issuer_der, certificate.serial), []).append(certificate)
            self.by_key.setdefault(certificate.key, []).append(certificate)


def read_signed(file: File, candidates: Candidates | Iterable[Certificate]) -> SignedDocument:
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
        self._line = 1
        self._pools = [candidates]
        """Certificates of the keystore, and those that only the message knows."""

    def read(self, data: bytes) -> None:
        try:
            message = read_message(data)
        except MimeError as error:
            return self._defect(error.kind, error.detail, error.line)
        self._line = message.signature_line
        for line, detail in message.unsigned:
            self._defect(Kind.UNSIGNED_TEXT, detail, line)
        signed, entity = self._signed_data(message)
        if entity is not None:
            try:
                self.content, line = split_text(entity, message.entity_line)
                self.first_line = line if message.entity is not None else None
            except MimeError as error:
                self._defect(error.kind, error.detail, error.line)
        if signed is None:
            return None
        for kind, detail in signed.problems:
            self._defect(kind, detail)
        self._read_embedded(signed)
        if entity is None:
            return None
        self.signatures = tuple(self._signature(signer, entity) for signer in signed.signers)
        if len(signed.signers) > 1:
            self._defect(Kind.SEVERAL_SIGNERS, f"expected one signature, found {len(signed.signers)}")
        two_contents = signed.content is not None and message.entity is not None
        if not two_contents and any(signature.digest_matches is False for signature in self.signatures):
            detail = "the text is not the one that was signed: its digest differs from the one in the signature"
            self._defect(Kind.DIGEST_MISMATCH, detail)
        return None

    def _defect(self, kind: Kind, detail: str, line: int | None = None) -> None:
        line = self._line if line is None else line
        self.defects.append(Defect(kind=kind, path=self._file.place, line=line, detail=detail))

    def _signed_data(self, message: Message) -> tuple[SignedData | None, bytes | None]:
        """The CMS structure, and the bytes that its signatures cover."""
        try:
            signed = read_signed_data(message.signature)
        except CmsError as error:
            self._defect(error.kind, error.detail)
            return None, message.entity
        if message.entity is None:
            detail = "text and signature in one structure (openssl: -nodetach), which no line of the file shows"
            self._defect(Kind.OPAQUE_MESSAGE, detail)
            if signed.content is None:
                detail = "there is no signed text, neither outside nor inside the signature"
                self._defect(Kind.CMS_MALFORMED, detail)
            return signed, signed.content
        if signed.content is not None:
            self._defect(Kind.TWO_CONTENTS, "one text outside the signature and one inside: readers take either")
        return signed, message.entity

    # --- signatures

    def _read_embedded(self, signed: SignedData) -> None:
        known = self._pools[0].by_digest
        read = [
            known.get(hashlib.sha256(der).hexdigest()) or _certificate(der, self._file, self._line)
            for der in signed.certificates
        ]
        for certificate in read:
            if certificate is None:
                self._defect(Kind.CMS_MALFORMED, "a certificate inside the message cannot be read")
        self.embedded = tuple(certificate for certificate in read if certificate is not None)
        self._pools.append(Candidates(each for each in self.embedded if each.sha256 not in known))

    def _signature(self, signer: SignerInfo, entity: bytes) -> Signature:
        """Check one signature over `entity`; what cannot be checked here becomes a defect."""
        digest = _HASH.get(signer.digest)
        matches = None
        if signer.message_digest is not None and digest is not None:
            matches = digest(entity).digest() == signer.message_digest
        name = (signer.issuer_der, signer.serial)
        named = tuple(each for pool in self._pools for each in pool.by_name.get(name, ()))
        data = entity if signer.signed is None else signer.signed
        maker = self._named_maker(signer, data, named) or self._unnamed_maker(signer, data, named)
        key = "" if maker is None else maker.key
        return Signature(
            issuer_der=signer.issuer_der,
            serial=signer.serial,
            digest=signer.digest,
            digest_matches=matches,
            named=named,
            verified_by=tuple(each for pool in self._pools for each in pool.by_key.get(key, ())),
            signing_time=signer.signing_time,
            value=signer.signature,
            hashed=b"" if digest is None else digest(data).digest(),
        )

    def _named_maker(self, signer: SignerInfo, data: bytes, named: tuple[Certificate, ...]) -> Certificate | None:
        """The certificate that the signer identifier names and whose key made the signature over `data`."""
        scheme = signer.scheme
        said = signer.digest not in DIGESTS or scheme.problems
        for certificate in self._distinct_keys(named):
            if scheme.family is not None and not certificate.key_kind.startswith(scheme.family):
                found = f"a signature algorithm for {scheme.family} by a signer whose key is {certificate.key_kind}"
                self._defect(Kind.CMS_MALFORMED, found)  # OpenSSL goes by the key
                continue
            answer = _made_by(certificate, signer, data)
            if answer.must:
                return certificate
            if answer is Truth.UNKNOWN and not said:
                found = f"a signature that cannot be checked here: {signer.digest}, key {certificate.key_kind}"
                self._defect(Kind.UNSUPPORTED_ALGORITHM, found)
        return None

    def _unnamed_maker(self, signer: SignerInfo, data: bytes, named: tuple[Certificate, ...]) -> Certificate | None:
        """Another candidate whose key made the signature: it explains why the named ones did not."""
        tried = {certificate.key for certificate in named}
        everyone = (each for pool in self._pools for each in pool.by_digest.values())
        same_serial = [other for other in everyone if other.serial == signer.serial and other.key not in tried]
        for other in self._distinct_keys(same_serial):
            if _made_by(other, signer, data).must:
                # OpenSSL compares names by meaning (X509_NAME_cmp), so it may take this one for the signer.
                found = "the issuer in the signature is written in other bytes than in the signer's certificate"
                self._defect(Kind.CMS_MALFORMED, found)
                return other
        others = (each[0] for pool in self._pools for key, each in pool.by_key.items() if key not in tried)
        return next(
            (other for other in itertools.islice(others, MAX_KEYS_TRIED) if _made_by(other, signer, data).must), None
        )

    def _distinct_keys(self, certificates: Iterable[Certificate]) -> list[Certificate]:
        """One certificate for each key; more than can be tried are a defect, since a run time would try them."""
        distinct = list({certificate.key: certificate for certificate in certificates}.values())
        if len(distinct) > MAX_KEYS_TRIED:
            found = f"{len(distinct)} certificates that may be the signer's, {MAX_KEYS_TRIED} are tried"
            self._defect(Kind.CMS_MALFORMED, found)
        return distinct[:MAX_KEYS_TRIED]


def _made_by(certificate: Certificate, signer: SignerInfo, data: bytes) -> Truth:
    """Whether the certificate's key made the signature over `data`; UNKNOWN where that cannot be checked."""
    key = public_half(certificate.parsed)
    if key is None:
        return Truth.UNKNOWN
    made = signer.scheme.made_by(key, signer.signature, data)
    if made is Truth.NO and certificate.parsed.public_key_algorithm_oid == PublicKeyAlgorithmOID.RSASSA_PSS:
        return Truth.UNKNOWN  # a key for RSA-PSS alone, which OpenSSL uses so whatever the signature algorithm says
    return made


def _certificate(der: bytes, file: File, line: int) -> Certificate | None:
    """Read a certificate that stands in no file of its own."""
    if not well_formed_throughout(der):
        return None
    read = read_certificate(der, line, file.place)
    if not isinstance(read, Certificate):
        return None
    return read if has_string_values(read.subject_der) and has_string_values(read.issuer_der) else None
