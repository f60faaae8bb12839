"""What of the evidence plays a part in the model: documents, certificates and instants, each once and in order."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import CrlFile
from keystore_audit.keystore.issuer import fit_to_sign
from keystore_audit.keystore.keystore import Enclave, Keystore, every_certificate
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.keystore.unmanaged import UnmanagedDocument, UnmanagedIdentity
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.subjects.comparison import matching
from keystore_audit.model.trust.verdicts import (
    envelope,
    first_alike,
    is_authority,
    may_have_issued,
    may_take,
    signers_taken,
    stands_alone,
)
from keystore_audit.profiles import VARIANTS, Profile
from keystore_audit.truth import Truth

Typed = GovernanceFile | PermissionsFile
"""A signed document, by what it says."""

_TRUSTS: Final = tuple(dict.fromkeys(profile.trust for profile in VARIANTS.values()))
_BY_SIGNERS: Final = tuple({trust.pins_signer: trust for trust in _TRUSTS}.values())
"""One of each way to find a document's signers."""

MAX_ISSUER_CHECKS: Final = 50_000
"""Pairs of certificate and authority whose signature is verified: five seconds at worst; 10,000 enclaves of one
keystore need 20,000."""


class Document(Struct, frozen=True):
    """A document of the keystore by its place; `file` is None where it could not be read at all."""

    place: str
    file: Typed | None


@lru_cache(maxsize=3)  # a comparison has three; asked by whoever looks at all documents
def documents_of(keystore: Keystore) -> tuple[Document, ...]:
    """Every distinct document that bears on rights, by place: what enclaves carry, and others that a peer may take.
    Unread ones are among them.
    """
    found: dict[str, Document] = {}
    for enclave in keystore.enclaves:
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            file = enclave.files.files[role]
            if read is not None or (role is Role.PERMISSIONS and file.status.unknown):
                found.setdefault(file.place, Document(file.place, read))
    others = [Document(each.place, each.document) for each in unmanaged_permissions(keystore)]
    # At the place of an enclave's document there may be another one, which stands in its text.
    return tuple(sorted((*found.values(), *others), key=lambda document: document.place))


def beside_enclaves(keystore: Keystore) -> Callable[[str], bool]:
    """Whether a place is among what goes on robots: what enclaves carry, and all that lies beside it."""
    carried = {file.place for enclave in keystore.enclaves for file in enclave.files.files.values()}
    directories = {f"{enclave.files.directory}/" for enclave in keystore.enclaves if enclave.files.directory != "."}
    folders = ("public/", "enclaves/", *directories)
    return lambda place: place.startswith(folders) or place in carried


def unmanaged_permissions(keystore: Keystore) -> tuple[UnmanagedDocument, ...]:
    """The unmanaged documents that may give rights: permissions that some peer may take, and whatever was not read.

    Of governance documents an enclave applies its own alone.
    """
    files = permissions_cas(keystore)
    return tuple(
        each
        for each in keystore.unmanaged
        if each.document is None
        or (isinstance(each.document, PermissionsFile) and may_be_taken(each.document.signed, files))
    )


def governance_apart(keystore: Keystore) -> tuple[UnmanagedDocument, ...]:
    """Governance documents of no enclave that some peer's permissions CA signed."""
    found = [each for each in keystore.unmanaged if isinstance(each.document, GovernanceFile)]
    files = permissions_cas(keystore) if found else ()
    return tuple(s for s in found if s.document is not None and may_be_taken(s.document.signed, files))


def unmanaged_governance(keystore: Keystore) -> tuple[UnmanagedDocument, ...]:
    """The same, if somebody may start with them.

    Enclaves do not. A holder of an unmanaged identity has files that nobody here knows, and these documents are here.
    """
    governances = governance_apart(keystore)
    return governances if governances and _outside(keystore) else ()


@lru_cache(maxsize=2)
def system_documents(keystore: Keystore) -> tuple[Document, ...]:
    """Those of `documents_of`, and governance documents that no enclave applies but somebody else may, by place."""
    more = [Document(each.place, each.document) for each in unmanaged_governance(keystore)]
    documents = documents_of(keystore)
    return tuple(sorted((*documents, *more), key=lambda document: document.place)) if more else documents


def permissions_cas(keystore: Keystore) -> tuple[CertificateFile | None, ...]:
    """The permissions CA files of the enclaves, those of equal bytes once; None where an enclave has none."""
    found = {e.permissions_ca.file.sha256 if e.permissions_ca else None: e.permissions_ca for e in keystore.enclaves}
    return tuple(found.values())


def may_be_taken(signed: SignedDocument, files: Collection[CertificateFile | None]) -> bool:
    """Whether a peer with one of these permissions CA files may take the document, under any known implementation."""
    return any(may_take(signed, files, trust) for trust in _TRUSTS)


def named_by_some(
    texts: Iterable[str], certificates: Sequence[Certificate], profiles: Iterable[Profile]
) -> dict[str, frozenset[int]]:
    """For each subject_name of a grant the certificates (indices) that some of the profiles take it to name."""
    wanted = sorted(set(texts))
    comparisons = dict.fromkeys(profile.trust.subjects for profile in profiles)
    found = [matching(wanted, certificates, comparison) for comparison in comparisons]
    return {text: frozenset[int]().union(*(each[text] for each in found)) for text in wanted}


def embedded_authorities(documents: Iterable[Document]) -> Iterator[Certificate]:
    """Authorities that signed messages bring along: implementations that do not pin the signer chain over them."""
    for document in documents:
        if document.file is not None and envelope(document.file.signed).signers:
            yield from (certificate for certificate in document.file.signed.embedded if is_authority(certificate))


@lru_cache(maxsize=2)
def embeddable(keystore: Keystore, at: datetime) -> tuple[Certificate, ...]:
    """Certificates below some permissions CA, wherever they are read, that are not over `at` an instant.

    An attacker can put anything into a message. Where signers are not pinned, peers take what the key of any of these
    signs, if it is fit to sign. An authority among these can make such certificates.
    Raises errors.BudgetExceeded.
    """
    identities = keystore.identities
    every = (
        *every_certificate(keystore.enclaves, keystore.authorities, keystore.unmanaged),
        *identities.keyless,
        *identities.copies,
        *(each.certificate for each in identities.found),
    )
    known = {c.sha256: c for c in every if at <= c.not_after and (is_authority(c) or fit_to_sign(c))}
    pending = [c for file in permissions_cas(keystore) if file for c in file.certificates if is_authority(c)]
    found: dict[str, Certificate] = {}
    checks = 0
    while pending:
        above, checks = pending.pop(), checks + len(known)
        if checks > MAX_ISSUER_CHECKS:
            raise BudgetExceeded(f"{len(known)} certificates are under more authorities than can be checked.")
        for sha256 in [sha256 for sha256, each in known.items() if may_have_issued(above, each)]:
            below = found[sha256] = known.pop(sha256)
            if is_authority(below):
                pending.append(below)
    return tuple(found.values())


def certificates_of(keystore: Keystore, at: datetime) -> tuple[Certificate, ...]:
    """Every distinct certificate that plays a part `at` an instant: identities, authorities and signers, by place.

    Systems number them so. Included are certificates that make a participant of the holder of an authority's key.
    """
    found: dict[str, Certificate] = {}
    for certificate in _playing_a_part(keystore, at):
        found.setdefault(certificate.sha256, certificate)
    return tuple(sorted(found.values(), key=lambda c: (c.path, c.line, c.sha256)))


def _playing_a_part(keystore: Keystore, at: datetime) -> Iterator[Certificate]:
    for enclave in keystore.enclaves:
        yield from (*enclave.trusts(Role.IDENTITY_CA), *enclave.trusts(Role.PERMISSIONS_CA))
        yield from filter(None, (enclave.identity,))
    documents = system_documents(keystore)
    for signed in (document.file.signed for document in documents if document.file is not None):
        yield from (signer for trust in _BY_SIGNERS for signer in signers_taken(signed, trust))
    yield from (*embedded_authorities(documents), *embeddable(keystore, at))
    yield from (identity.certificate for identity in unmanaged_identities(keystore, at))
    keys = {certificate.key for certificate in authorities_of(keystore)} if keystore.identities.keyless else ()
    yield from (certificate for certificate in keystore.identities.keyless if certificate.key in keys)


def issuers_of(keystore: Keystore, certificates: Sequence[Certificate]) -> tuple[frozenset[int], ...]:
    """For each certificate, the authorities, of CA files and others, that issued it: names and signature, not dates.

    Raises errors.BudgetExceeded.
    """
    every = (*_trusted(keystore, Role.IDENTITY_CA), *_trusted(keystore, Role.PERMISSIONS_CA))
    listed = {certificate.sha256 for certificate in every}
    pool = [(n, c) for n, c in enumerate(certificates) if c.sha256 in listed or is_authority(c)]
    if len(pool) * len(certificates) > MAX_ISSUER_CHECKS:
        raise BudgetExceeded(
            f"{len(certificates)} certificates under {len(pool)} authorities are more chains than can be "
            f"checked (limit {MAX_ISSUER_CHECKS})."
        )
    return tuple(
        frozenset(n for n, authority in pool if may_have_issued(authority, certificate)) for certificate in certificates
    )


def instants_of(certificates: Iterable[Certificate], grants: Iterable[ReadGrant], at: datetime) -> tuple[datetime, ...]:
    """Every validity boundary and the audit instant, sorted."""
    instants = {at}
    for certificate in certificates:
        instants.update((certificate.not_before, certificate.not_after))
    for grant in grants:
        instants.update((grant.not_before, grant.not_after))
    return tuple(sorted(instants))


def certified_again(keystore: Keystore) -> Iterator[tuple[Enclave, tuple[Certificate, ...]]]:
    """Enclaves with further certificates of their identity's key in files of no enclave, and those certificates."""
    known: dict[str, dict[str, Certificate]] = {}
    carried = every_certificate(keystore.enclaves, keystore.authorities, keystore.unmanaged)
    for certificate in (*carried, *keystore.identities.keyless):
        known.setdefault(certificate.key, {}).setdefault(certificate.sha256, certificate)
    firsts = {enclave.identity.sha256 for enclave in keystore.enclaves if enclave.identity is not None}
    for enclave in keystore.enclaves:
        first = enclave.identity
        others = [c for c in known.get(first.key, {}).values() if c.sha256 not in firsts] if first is not None else []
        if others:
            yield enclave, tuple(others)


def authorities_of(keystore: Keystore) -> Iterator[Certificate]:
    """The certificates in enclaves' CA files that can vouch or sign: authorities, and the first one for permissions.

    Any other certificate there is an identity like one that lies elsewhere.
    """
    yield from filter(is_authority, _trusted(keystore, Role.IDENTITY_CA))
    for file in dict.fromkeys(e.permissions_ca for e in keystore.enclaves if e.permissions_ca):
        yield from file.certificates[:1]
        yield from filter(is_authority, file.certificates[1:])


def _trusted(keystore: Keystore, role: Role) -> Iterator[Certificate]:
    """The certificates in the CA files for this role; each file is looked at once."""
    yield from dict.fromkeys(certificate for enclave in keystore.enclaves for certificate in enclave.trusts(role))


def _standing_elsewhere(keystore: Keystore) -> Iterator[Certificate]:
    """Identities of enclaves that no authority vouches for and that are in another enclave's identity CA file.

    That enclave accepts them (measured on Fast DDS), whatever their own CA file says: a holder of the key ignores it.
    """
    every = {certificate.sha256: certificate for certificate in _trusted(keystore, Role.IDENTITY_CA)}
    for enclave in keystore.enclaves:
        identity = enclave.identity
        if identity is None or identity.sha256 not in every:
            continue
        own = {certificate.sha256 for certificate in enclave.trusts(Role.IDENTITY_CA)}
        if identity.sha256 not in own and stands_alone(identity, every.values()):
            yield identity


def _outside(keystore: Keystore) -> Mapping[str, UnmanagedIdentity]:
    """By SHA-256 the certificates that are not only an enclave's own, without authorities."""
    authorities = {certificate.sha256 for certificate in authorities_of(keystore)}
    again = (c for _enclave, others in certified_again(keystore) for c in others if c.sha256 not in authorities)
    found = {
        certificate.sha256: UnmanagedIdentity(certificate=certificate)
        for certificate in (*again, *keystore.identities.copies, *_standing_elsewhere(keystore))
    }
    for each in (*keystore.identities.found, *keystore.identities.possible):
        if each.certificate.sha256 not in authorities:
            found.setdefault(each.certificate.sha256, each)
    return found


@lru_cache(maxsize=3)  # asked by the systems, for doubts under each kind of implementation, and by a rule
def unmanaged_identities(keystore: Keystore, at: datetime) -> tuple[UnmanagedIdentity, ...]:
    """By whose certificates somebody may join `at` an instant (aware UTC) or later, beside the enclaves, by place.

    Whoever has the key is a participant with what grants give the subject (measured on Cyclone DDS and Fast DDS).
    Authorities of CA files are none of these: what their keys open is asked by itself. A further certificate of such a
    key is one. It makes a participant, whatever else the key signs, and whether or not anybody trusts that authority.
    So is an enclave's own where its key lies elsewhere, too: who has that one has other files around it.
    """
    found = _outside(keystore)
    if not found:  # nearly always
        return ()
    every = tuple(_trusted(keystore, Role.IDENTITY_CA))
    vouching = [c for c in every if is_authority(c)]
    lasting = [each for each in found.values() if at <= each.certificate.not_after]
    lasting.sort(key=lambda each: (each.certificate.path, each.certificate.line, each.certificate.sha256))
    vouched = (
        replace(
            each,
            authorities=(
                *(authority for authority in vouching if may_have_issued(authority, each.certificate)),
                *([each.certificate] if stands_alone(each.certificate, every) else ()),
            ),
        )
        for each in lasting
    )
    return tuple(identity for identity in vouched if identity.authorities)


def unread_places(keystore: Keystore) -> tuple[str, ...]:
    """Places behind which whole enclaves may lie that were not read."""
    layout = keystore.layout
    return tuple(file.path for file in (*layout.directory_links, *layout.unreadable_directories))


def behind(place: str) -> str:
    """The name for everything that lies behind one of these places."""
    return f"whatever is behind {place}"


@lru_cache(maxsize=16_384)
def governance_alike(file: GovernanceFile) -> GovernanceFile:
    """The first ever read that says the same and has the same signers: some sign one again for each enclave.

    It may be of another keystore, so that it is there to compare with. All that implementations make of a governance
    follows from these. One of several meanings, or in a message that we refuse to interpret, is like its copies alone.
    """
    judged = envelope(file.signed)
    signers, embedded = (tuple([each.sha256 for each in some]) for some in (judged.signers, file.signed.embedded))
    return first_alike(file, judged.verdict, signers, embedded, governance_says(file))


def governance_says(file: GovernanceFile) -> object:
    """What it says, wherever it stands; its bytes where that is not one meaning."""
    said = file.readings.common
    one_meaning = said is not None and envelope(file.signed).verdict is not Truth.UNKNOWN
    return _unplaced(said) if one_meaning else file.signed.file.sha256


def _unplaced(part: object) -> object:
    """What a part of a document says, wherever it stands."""
    if isinstance(part, Struct):
        return tuple(_unplaced(getattr(part, name)) for name in part.__struct_fields__ if name not in ("line", "lines"))
    return tuple(map(_unplaced, part)) if isinstance(part, tuple) else part


TrustFiles = tuple[CertificateFile | None, CertificateFile | None, GovernanceFile | None, CrlFile | None, bool]


def trust_files(enclave: Enclave) -> TrustFiles:
    """What the trust domain of an enclave is made of: files, each one object however many enclaves share it.

    Of governances that are alike the first. The last: whether there is a `crl.pem` that was not read.
    """
    unread = enclave.files.files[Role.CRL].status.unknown
    governance = None if enclave.governance is None else governance_alike(enclave.governance)
    return enclave.identity_ca, enclave.permissions_ca, governance, enclave.crl, unread
