"""What rules are about: each distinct file and each enclave once, and who takes a signed document."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any, Final, TypeVar

from msgspec import Struct

from keystore_audit.findings import Location, Remedy, decision
from keystore_audit.grouped import grouped
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.defect import Defect, first_opaque
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.files import File
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.model.inventory import unmanaged_permissions
from keystore_audit.model.trust.verdicts import Envelope, document_verdict, envelope, vouches
from keystore_audit.model.validity import read_date
from keystore_audit.profiles import VARIANTS, DateReading, Profile, RevocationLists, Trust
from keystore_audit.rules.registry import Context
from keystore_audit.truth import Truth

ROWS: Final = tuple(dict.fromkeys(profile.trust for profile in VARIANTS.values()))
"""The trust rows of all known variants, the specification's first."""

SPEC: Final = VARIANTS["spec"].trust
"""The row by which a document is genuine: a certificate of the permissions CA file made every signature."""

READS_LISTS_OF_CA_FILES: Final = tuple(
    name for name, each in VARIANTS.items() if each.trust.revocation is RevocationLists.CRL_AND_CA_FILE
)
"""The names of the variants that read revocation lists in a CA file."""

UNPINNED: Final = tuple(profile for profile in VARIANTS.values() if not profile.trust.pins_signer)
"""The variants that take documents from any signer that chains to the permissions CA, and not from it alone."""


def unread_authority(enclave: Enclave) -> bool:
    """Whether it is unknown whom the enclave takes documents from: a robot may read a CA file that we did not."""
    read = enclave.permissions_ca
    return (
        enclave.files.files[Role.PERMISSIONS_CA].status.unknown
        or Role.PERMISSIONS_CA in enclave.files.pkcs11
        or (read is not None and first_opaque(read.defects) is not None)
    )


def accepting(signed: SignedDocument, files: Iterable[CertificateFile]) -> tuple[Profile, ...]:
    """The known variants under which an enclave with one of these permissions CA files takes the document."""
    takes = {trust for trust in ROWS for file in files if document_verdict(signed, file, trust) is Truth.YES}
    return tuple(profile for profile in VARIANTS.values() if profile.trust in takes)


def verdict(signed: SignedDocument, enclave: Enclave, trust: Trust) -> Truth:
    """What the enclave does with the document; UNKNOWN too where its permissions CA could not be read."""
    said = document_verdict(signed, enclave.permissions_ca, trust)
    if said is not Truth.NO or not unread_authority(enclave):
        return said
    return said if envelope(signed).verdict is Truth.NO else Truth.UNKNOWN


def may_be_taken(signed: SignedDocument, enclaves: Sequence[Enclave]) -> bool:
    """Whether some known implementation may take the document in some of the enclaves.

    Where none may, what its XML says is of no consequence: the signature's finding says everything.
    """
    return any(verdict(signed, enclave, trust) is not Truth.NO for trust in ROWS for enclave in enclaves)


def genuine_for(signed: SignedDocument, enclaves: Sequence[Enclave]) -> int:
    """How many of the enclaves have a permissions CA that signed the document."""
    return sum(verdict(signed, enclave, SPEC) is Truth.YES for enclave in enclaves)


EXCHANGED: Final = "The files of the two authorities hold each other's certificate."

_IN_PUBLIC: Final = decision(
    "Exchange public/identity_ca.cert.pem and public/permissions_ca.cert.pem, and copies in enclaves. Exchange "
    "the keys in private/ if they are exchanged too."
)
_COPIES: Final = decision(
    "Exchange identity_ca.cert.pem and permissions_ca.cert.pem in the folders of the enclaves, which have copies. "
    "Exchange those in public/, and their keys in private/, only if they are exchanged too."
)


def exchange(enclaves: Collection[Enclave], signer: Certificate) -> Remedy | None:
    """What to do where that is so, as far as these enclaves and the signer of a document of theirs tell."""
    exchanged = all(
        any(signer.sha256 == authority.sha256 for authority in enclave.trusts(Role.IDENTITY_CA))
        and enclave.identity is not None
        and any(vouches(authority, enclave.identity) for authority in enclave.trusts(Role.PERMISSIONS_CA))
        for enclave in enclaves
    )
    if not exchanged:
        return None
    authorities = (authority for enclave in enclaves for authority in enclave.trusts(Role.PERMISSIONS_CA))
    return _IN_PUBLIC if any(authority.path.startswith("public/") for authority in authorities) else _COPIES


def exchange_for(enclave: Enclave) -> Remedy | None:
    """The same of one enclave, by whoever signed its documents."""
    documents = (each for each in (enclave.permissions, enclave.governance) if each is not None)
    signers = (c for each in documents for made in each.signed.signatures for c in made.verified_by)
    return next((remedy for signer in signers if (remedy := exchange([enclave], signer)) is not None), None)


_Document = TypeVar("_Document", GovernanceFile, PermissionsFile)


def instant_of(date: Text) -> datetime | None:
    """The instant that a date of a grant names to the specification, None for years that nobody reads.

    Where implementations read another one, date-read-differently and date-not-portable say so.
    """
    dated = read_date(date.text, DateReading.XSD, None)
    return dated.instant if dated is not None else None


def signed_bytes(signed: SignedDocument) -> str:
    """What was signed to the letter, whoever signed it and however; of a file without such a text all of it."""
    return signed.file.sha256 or "" if signed.content is None else hashlib.sha256(signed.content).hexdigest()


class CertificateUse(Struct, frozen=True, kw_only=True):
    """A certificate file that enclaves carry, and every role in which they do.

    Roles are IDENTITY_CA, CERTIFICATE and PERMISSIONS_CA; several where one authority serves for both.
    """

    roles: frozenset[Role]
    certificates: CertificateFile
    enclaves: tuple[Enclave, ...]

    @property
    def authority(self) -> bool:
        """Whether it is the file of a certificate authority."""
        return bool(self.roles & {Role.IDENTITY_CA, Role.PERMISSIONS_CA})

    @property
    def in_use(self) -> tuple[Certificate, ...]:
        """The certificates that some run time takes from it: of an identity the first, of an authority all."""
        return self.certificates.certificates if self.authority else self.certificates.certificates[:1]


class RevocationUse(Struct, frozen=True, kw_only=True):
    """Revocation lists that enclaves carry: a `crl.pem`, or lists inside an identity CA file (`in_ca_file`).

    Of a `crl.pem` run times read the first list; lists in a CA file are read by Fast DDS alone.
    `authorities`: the certificates of the identity CA files of the enclaves.
    """

    file: File
    lists: tuple[RevocationList, ...]
    defects: tuple[Defect, ...]
    in_ca_file: bool
    authorities: tuple[Certificate, ...]
    enclaves: tuple[Enclave, ...]

    @property
    def in_use(self) -> tuple[RevocationList, ...]:
        """The lists that some run time reads."""
        return self.lists if self.in_ca_file else self.lists[:1]


class SignedUse(Struct, frozen=True, kw_only=True):
    """A signed document and the enclaves whose verdict on it counts.

    What its signatures are worth is worked out once. `envelope`: apart from who signed. `may_be_taken`: whether some
    known implementation may take it in some of the enclaves. `genuine_for`: how many have a CA that signed it.
    """

    signed: SignedDocument
    enclaves: tuple[Enclave, ...]
    envelope: Envelope
    may_be_taken: bool
    genuine_for: int

    def at(self, line: int | None, message: str = "") -> Location:
        """The place of a line of the document."""
        return Location(self.signed.file.place, line, message=message)

    @property
    def genuine(self) -> bool:
        """Whether the permissions CA of one of the enclaves signed it."""
        return self.genuine_for > 0

    @property
    def genuine_everywhere(self) -> bool:
        """Whether the permissions CA of every one of the enclaves signed it."""
        return self.genuine_for == len(self.enclaves)

    @property
    def judging(self) -> tuple[tuple[Enclave, CertificateFile], ...]:
        """The enclaves that have a permissions CA to compare the signers with."""
        return tuple(
            (enclave, enclave.permissions_ca)
            for enclave in self.enclaves
            if enclave.permissions_ca is not None and enclave.permissions_ca.certificates
        )

    @property
    def authorities(self) -> tuple[Certificate, ...]:
        """The permissions CA certificates of those enclaves, each once."""
        return tuple({c.sha256: c for _enclave, file in self.judging for c in file.certificates}.values())


class DocumentUse(SignedUse, frozen=True, kw_only=True):
    """A signed document and the enclaves that carry it (several, where it is linked)."""

    document: GovernanceFile | PermissionsFile


class GovernanceUse(DocumentUse, frozen=True, kw_only=True):
    """A governance document."""

    document: GovernanceFile

    @property
    def speaks(self) -> bool:
        """Whether it has one meaning and may be taken: only then is what it says of consequence."""
        return self.may_be_taken and self.document.governance is not None


class PermissionsUse(DocumentUse, frozen=True, kw_only=True):
    """A permissions document."""

    document: PermissionsFile

    @property
    def speaks(self) -> bool:
        """Whether it has one meaning and may be taken: only then is what it says of consequence."""
        return self.may_be_taken and self.document.permissions is not None


def taken(use: DocumentUse, _context: Context) -> bool:
    """When rules apply that concern everybody who may take a document, whatever it says."""
    return use.may_be_taken


def speaks(use: GovernanceUse | PermissionsUse, _context: Context) -> bool:
    """When rules about what a document says apply."""
    return use.speaks


def is_identity(use: CertificateUse, _context: Context) -> bool:
    """Whether some enclave takes its identity from this file."""
    return Role.CERTIFICATE in use.roles and bool(use.certificates.certificates)


class Refusal(Struct, frozen=True, kw_only=True):
    """An enclave that does not start under chosen profiles, `profiles` by reason, and of which no rule has said why."""

    enclave: Enclave
    profiles: Mapping[tuple[str, ...], tuple[str, ...]]


class Crash(Struct, frozen=True, kw_only=True):
    """A rule that raised `exception` on `subject`: the type's name alone, since messages may quote what was read."""

    rule: str
    subject: str
    exception: str


def certificate_uses(keystore: Keystore) -> Iterator[CertificateUse]:
    """Every certificate file that an enclave carries, by resolved path."""
    uses: dict[str, tuple[CertificateFile, set[Role], dict[str, Enclave]]] = {}
    for enclave in keystore.enclaves:
        for role, read in (
            (Role.IDENTITY_CA, enclave.identity_ca),
            (Role.CERTIFICATE, enclave.certificate),
            (Role.PERMISSIONS_CA, enclave.permissions_ca),
        ):
            if read is not None:
                _, roles, enclaves = uses.setdefault(read.file.place, (read, set(), {}))
                roles.add(role)
                enclaves.setdefault(enclave.files.directory, enclave)
    for place in sorted(uses):
        read, roles, enclaves = uses[place]
        yield CertificateUse(roles=frozenset(roles), certificates=read, enclaves=tuple(enclaves.values()))


def revocation_uses(keystore: Keystore) -> Iterator[RevocationUse]:
    """Every `crl.pem` of an enclave and every identity CA file with revocation lists in it, by resolved path."""
    uses: dict[tuple[str, bool], list[Enclave]] = {}
    for enclave in keystore.enclaves:
        if enclave.crl is not None:
            uses.setdefault((enclave.crl.file.place, False), []).append(enclave)
        if enclave.identity_ca is not None and enclave.identity_ca.revocation_lists:
            uses.setdefault((enclave.identity_ca.file.place, True), []).append(enclave)
    for (_place, in_ca_file), enclaves in sorted(uses.items(), key=lambda item: item[0]):
        read = enclaves[0].identity_ca if in_ca_file else enclaves[0].crl
        if read is not None:
            authorities = {each.sha256: each for enclave in enclaves for each in enclave.trusts(Role.IDENTITY_CA)}
            yield RevocationUse(
                file=read.file,
                lists=read.revocation_lists,
                defects=() if in_ca_file else read.defects,  # those of a CA file are the certificates' rules'
                in_ca_file=in_ca_file,
                authorities=tuple(authorities.values()),
                enclaves=tuple(enclaves),
            )


def governance_uses(keystore: Keystore) -> Iterator[GovernanceUse]:
    """Every distinct governance file."""
    for document, enclaves in _by_place((enclave.governance, enclave) for enclave in keystore.enclaves):
        yield GovernanceUse(document=document, **_worth(document.signed, enclaves))


def permissions_uses(keystore: Keystore) -> Iterator[PermissionsUse]:
    """Every distinct permissions file."""
    for document, enclaves in _by_place((enclave.permissions, enclave) for enclave in keystore.enclaves):
        yield PermissionsUse(document=document, **_worth(document.signed, enclaves))


def unmanaged_uses(keystore: Keystore) -> Iterator[SignedUse]:
    """Permissions that no enclave carries and that some peer may take; with two enclaves for each permissions CA file
    of those that may.
    """
    by_authority = grouped(
        keystore.enclaves, lambda enclave: enclave.permissions_ca.file.sha256 if enclave.permissions_ca else None
    )
    for each in unmanaged_permissions(keystore):
        if each.document is not None:
            signed = each.document.signed
            taking = [each for each in by_authority.values() if may_be_taken(signed, each[:1])]
            yield SignedUse(**_worth(signed, tuple(enclave for each in taking for enclave in each[:2])))


def _by_place(read: Iterable[tuple[_Document | None, Enclave]]) -> Iterator[tuple[_Document, tuple[Enclave, ...]]]:
    """Each document with the enclaves that carry it, by resolved path."""
    uses: dict[str, tuple[_Document, list[Enclave]]] = {}
    for document, enclave in read:
        if document is not None:
            uses.setdefault(document.signed.file.place, (document, []))[1].append(enclave)
    for place in sorted(uses):
        yield uses[place][0], tuple(uses[place][1])


def _worth(signed: SignedDocument, enclaves: tuple[Enclave, ...]) -> dict[str, Any]:
    """The document and what its signatures are worth to these enclaves, as `SignedUse` has them."""
    return {
        "signed": signed,
        "enclaves": enclaves,
        "envelope": envelope(signed),
        "may_be_taken": may_be_taken(signed, enclaves),
        "genuine_for": genuine_for(signed, enclaves),
    }
