"""What about an enclave could not be read, so that it counts as able to do anything (design section 3, may
and must).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import NARROWING, Certificate, CertificateFile
from keystore_audit.keystore.defect import Defect, first_opaque
from keystore_audit.keystore.document import KNOWN_FORMS
from keystore_audit.keystore.issuer import Issue
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.keystore.unmanaged import UnmanagedIdentity
from keystore_audit.model.access_view import AccessViews, ReadDocument
from keystore_audit.model.inventory import (
    Typed,
    permissions_cas,
    unmanaged_governance,
    unmanaged_identities,
    unmanaged_permissions,
)
from keystore_audit.model.participants.admitted import admitted
from keystore_audit.model.question import Doubt
from keystore_audit.model.subjects.comparison import is_printable
from keystore_audit.model.subjects.told import contested
from keystore_audit.model.trust.revocation import list_unread
from keystore_audit.model.trust.verdicts import MAX_AUTHORITIES, envelope, is_authority, issue, may_take, stands_alone
from keystore_audit.profiles import Access, Profile, Trust, facts
from keystore_audit.truth import Truth


def keystore_doubts(keystore: Keystore, profile: Profile, accesses: AccessViews) -> Iterator[Doubt]:
    """Everything that could not be read, each place once."""
    seen: set[tuple[str, int | None]] = set()
    for file in (*keystore.layout.directory_links, *keystore.layout.unreadable_directories):
        yield _doubt(None, file.path, file.detail)
    for file in keystore.identities.unread:
        yield _doubt(None, file.place, f"it may hold an identity that peers let in: it {file.detail}")
    row = accesses.row(profile.access)
    by_enclave = (enclave_doubts(enclave, profile.trust, row, accesses) for enclave in keystore.enclaves)
    others = _doubts_of_others(keystore, profile.trust, row, accesses)
    unmanaged = filter(None, map(unmanaged_doubt, unmanaged_identities(keystore, accesses.at)))
    for doubt in chain(chain.from_iterable(by_enclave), others, unmanaged, _possible(keystore, profile, accesses)):
        place = (doubt.location.path, doubt.location.line)
        if place not in seen:
            seen.add(place)
            yield doubt


@lru_cache(maxsize=256)  # asked of each operation under each kind of implementation, one enclave after the other
def enclave_doubts(enclave: Enclave, trust: Trust, access: Access, accesses: AccessViews) -> tuple[Doubt, ...]:
    """Everything about the enclave that could not be read and that an implementation might act on."""
    return tuple(_enclave_doubts(enclave, trust, access, accesses))


def _enclave_doubts(enclave: Enclave, trust: Trust, access: Access, accesses: AccessViews) -> Iterator[Doubt]:
    yield from file_doubts(enclave)
    unread = list_unread(enclave, trust)
    if unread is not None:
        yield _doubt(enclave.path, *unread)
    for document in (enclave.governance, enclave.permissions):
        if document is None:
            continue
        read = accesses.read(document, access)
        if may_say_anything(document, read, (enclave.permissions_ca,), trust):
            yield document_doubt(enclave.path, document, read)


@lru_cache(maxsize=16_384)
def file_doubts(enclave: Enclave) -> tuple[Doubt, ...]:
    """What about its files is in doubt for every implementation alike."""
    files = (_file_doubt(enclave, role) for role in (Role.KEY, Role.PERMISSIONS))
    return tuple(doubt for doubt in (identity_doubt(enclave), trust_domain_doubt(enclave), *files) if doubt is not None)


def _doubts_of_others(keystore: Keystore, trust: Trust, access: Access, accesses: AccessViews) -> Iterator[Doubt]:
    """Everything unread that a peer may take for permissions, in enclaves or outside of them.

    Its own enclave may refuse it. Also governance that the holder of an unmanaged identity may apply.
    """
    files = permissions_cas(keystore)
    outside = bool(unmanaged_identities(keystore, accesses.at))
    documents: list[tuple[str | None, Typed | None]] = []
    for enclave in keystore.enclaves:
        documents += [(enclave.path, enclave.permissions), (enclave.path, enclave.governance if outside else None)]
    for each in (*unmanaged_permissions(keystore), *unmanaged_governance(keystore)):
        if each.document is None:
            yield _doubt(None, each.place, each.file.detail)
        documents.append((None, each.document))
    for path, document in documents:
        if document is None:
            continue
        read = accesses.read(document, access)
        if may_say_anything(document, read, files, trust, to_peers=True):
            yield document_doubt(path, document, read)


def may_say_anything(
    document: Typed,
    read: ReadDocument,
    files: Iterable[CertificateFile | None],
    trust: Trust,
    *,
    to_peers: bool = False,
) -> bool:
    """Whether a peer with one of these permissions CA files may take the document, and what it says is unknown.

    `to_peers`: not to its own enclave, which knows whom it compares.
    """
    unknown = read.is_silent or envelope(document.signed).verdict is Truth.UNKNOWN
    if to_peers and isinstance(document, PermissionsFile):
        unknown = unknown or contested(document, trust.subjects)
    return unknown and may_take(document.signed, files, trust)


def document_doubt(enclave: str | None, file: Typed, read: ReadDocument) -> Doubt:
    """What keeps the document from having one meaning."""
    defects: tuple[Defect, ...] = file.signed.defects + file.defects
    defect = next((each for each in defects if each.kind.opaque and each.kind not in KNOWN_FORMS), None)
    if defect is None and read.doubt is not None:
        return _doubt(enclave, file.signed.file.place, *read.doubt)
    defect = defect or first_opaque(defects)
    if defect is None:
        begins = "which grant counts for a peer depends on who begins the handshake: one is in OpenSSL's form"
        reason = begins if read.is_readable else "the document has no meaning that every parser agrees on"
        return _doubt(enclave, file.signed.file.place, reason)
    return _doubt(enclave, defect.path, defect.detail, defect.line)


@lru_cache(maxsize=16_384)  # by the systems too
def identity_doubt(enclave: Enclave) -> Doubt | None:
    """Why the enclave's identity is unknown: it may then be anybody whom the identity CA vouches for."""
    doubt = _file_doubt(enclave, Role.CERTIFICATE)
    first = enclave.identity
    if doubt is not None or first is None:
        return doubt
    return _doubt_of(enclave.path, first, enclave.trusts(Role.IDENTITY_CA))


@lru_cache(maxsize=4_096)  # by the systems too
def unmanaged_doubt(identity: UnmanagedIdentity) -> Doubt | None:
    """The same of an identity that is no enclave's own."""
    return _doubt_of(None, identity.certificate, identity.authorities)


def _possible(keystore: Keystore, profile: Profile, accesses: AccessViews) -> Iterator[Doubt]:
    """Identities that peers let in and whose key may be in a file that could not be read."""
    if not keystore.identities.possible:  # nearly always
        return
    for each in admitted(keystore, keystore.identities.possible, (profile,), accesses.at):
        reason = f"its private key may be in {each.key}, which could not be read"
        yield _doubt(None, each.certificate.path, reason, each.certificate.line)


def _doubt_of(enclave: str | None, certificate: Certificate, authorities: tuple[Certificate, ...]) -> Doubt | None:
    """Why it is unknown who has the certificate, or whether these authorities vouch for it."""
    if not is_printable(certificate):
        reason = f"the subject {certificate.subject!r} has attributes that implementations print in ways of their own"
    elif stands_alone(certificate, authorities):
        reason = "it is in the identity CA file itself, where implementations accept it although it is no authority"
    else:
        issues = [issue(authority, certificate) for authority in authorities if is_authority(authority)]
        if Issue.UNSUPPORTED not in issues or Issue.ISSUED in issues:
            return _constrained(enclave, (certificate, *authorities))
        reason = f"whether the identity CA issued the certificate cannot be told ({certificate.signature_algorithm})"
    return _doubt(enclave, certificate.path, reason, certificate.line)


def _constrained(enclave: str | None, certificates: Iterable[Certificate]) -> Doubt | None:
    """The doubt about one of several, first about one that may widen what is accepted."""
    found = [each for each in certificates if each.constraints]
    for certificate in sorted(found, key=lambda each: NARROWING.issuperset(each.constraints))[:1]:
        reason = f"the certificate has extensions ({', '.join(certificate.constraints)}) that implementations evaluate"
        doubt = _doubt(enclave, certificate.path, f"{reason} and this audit does not")
        return replace(doubt, narrows=NARROWING.issuperset(certificate.constraints))
    return None


@lru_cache(maxsize=16_384)
def trust_domain_doubt(enclave: Enclave) -> Doubt | None:
    """Why it is unknown whom the enclave trusts: it may then accept everything, or (`narrows`) less than is read.

    A governance document that was read but has no single meaning is not among these: it is opaque as a
    document.
    """
    for role, read in ((Role.IDENTITY_CA, enclave.identity_ca), (Role.PERMISSIONS_CA, enclave.permissions_ca)):
        doubt = _file_doubt(enclave, role)
        if doubt is not None:
            return doubt
        if read is not None and len(read.certificates) > MAX_AUTHORITIES:
            reason = f"{len(read.certificates)} certificates are too many to search for chains"
            return _doubt(enclave.path, read.file.place, f"{reason} (limit {MAX_AUTHORITIES})")
    return _file_doubt(enclave, Role.GOVERNANCE) or _constrained(enclave.path, enclave.trusts(Role.PERMISSIONS_CA))


def opens(doubt: Doubt | None) -> bool:
    """Whether, because of this doubt, somebody may be more, or accept more, than what was read says."""
    return doubt is not None and not doubt.narrows


def _file_doubt(enclave: Enclave, role: Role) -> Doubt | None:
    """Why it is unknown what a file holds: not read, not understood, or overridden by a PKCS#11 reference on Fast DDS.

    Of an identity the first certificate is enough. Whether a private key serves bears on usability only: who holds it
    is not in the file. What documents say is another question.
    """
    file = enclave.files.files[role]
    if role in enclave.files.pkcs11:
        return _doubt(enclave.path, enclave.files.pkcs11[role].path, facts.PKCS11)
    if file.status.unknown:
        return _doubt(enclave.path, file.path, f"{role.value} could not be read: {file.detail}")
    read = {
        Role.IDENTITY_CA: enclave.identity_ca,
        Role.CERTIFICATE: enclave.certificate if enclave.identity is None else None,
        Role.KEY: enclave.key,
        Role.PERMISSIONS_CA: enclave.permissions_ca,
    }.get(role)
    defect = first_opaque(read.defects) if read is not None else None
    line = defect.line if defect is not None and role is not Role.KEY else None  # a private key is doubted whole
    return None if defect is None else _doubt(enclave.path, defect.path, defect.detail, line)


def _doubt(enclave: str | None, path: str, reason: str, line: int | None = None) -> Doubt:
    return Doubt(enclave=enclave, location=Location(path=path, line=line), reason=reason)
