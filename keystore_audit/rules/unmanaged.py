"""KA6: signed documents and identities that no enclave has, and that peers take all the same (DDS-Security 1.1,
9.4.1.3).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.unmanaged import UnmanagedDocument
from keystore_audit.model.formal.rights import UnmanagedGrant, unmanaged_grants
from keystore_audit.model.inventory import (
    governance_apart,
    may_be_taken,
    permissions_cas,
    unmanaged_governance,
    unmanaged_permissions,
)
from keystore_audit.model.participants.admitted import Admitted, admitted
from keystore_audit.model.trust.verdicts import envelope
from keystore_audit.rules.files import renaming
from keystore_audit.rules.registry import (
    VERBS,
    Context,
    Violation,
    listed,
    located,
    more_like,
    of_kinds,
    quoted,
    rule,
    sentence,
)
from keystore_audit.rules.remedies import SIGN_AGAIN
from keystore_audit.rules.subjects import unmanaged_uses
from keystore_audit.truth import Truth

_CLAUSE: Final = "DDS-Security 1.1, 9.4.1.3 and 8.4.2.9 (a peer checks the document that it is shown); measured"

_REVOKE: Final = (
    "Give the enclave a certificate with another subject, or make a new permissions CA and sign every document again. "
    "Then delete the file. Deleting it alone is not enough: whoever has a copy can present it until its dates end."
)

_FIND_OUT: Final = (
    "Find out what the file holds (`openssl pkey -in FILE -pubout`), and remove it from the keystore. If it is the "
    "identity of a robot, revoke its certificate, or let no grant name its subject: copies stay usable."
)

_NEEDED_OR_NOT: Final = (
    "Move the identity's folder below enclaves/ if a robot needs it, so that it is audited too. Else delete the key, "
    "and revoke "
    "the certificate or let no grant name its subject: copies stay usable."
)

_CRASHES: Final = (Kind.EMPTY_TOPIC, Kind.RULE_WITHOUT_DOMAINS, Kind.EMPTY_ELEMENT)
"""What ends the process of an implementation that reads it (KA517, KA518, KA521)."""


def _has_unmanaged(keystore: Keystore, _context: Context) -> bool:
    return bool(keystore.unmanaged)


def _granting(keystore: Keystore, context: Context) -> tuple[UnmanagedGrant, ...]:
    """What genuine documents of no enclave give to enclaves; KA301 and KA302 speak of those of others."""
    genuine = {use.signed.file.place for use in unmanaged_uses(keystore) if use.genuine}
    return unmanaged_grants(context.meaning.systems, genuine) if genuine else ()


def _documents(number: int) -> str:
    return "A signed document" if number == 1 else f"{number} signed documents"


def _at(documents: Sequence[UnmanagedDocument]) -> list[Location]:
    return [Location(each.place) for each in documents]


@rule(
    "KA660",
    Severity.HIGH,
    _CLAUSE,
    decision(_REVOKE),
    applies=_has_unmanaged,
)
def several_permissions_for_subject(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An old or other permissions document, validly signed and in force, lies outside the enclaves.

    Peers accept any valid document that is presented, so an enclave has the rights of all of them together, and nothing
    revokes one. High if it gives an enclave what its own document does not; else low, since a right that is removed
    later is still in it. Copies outside the keystore are not seen.
    """
    granting = _granting(keystore, context)
    wider = [grant for grant in granting if grant.surplus is not None]
    if wider:
        first, surplus = wider[0], wider[0].surplus
        right = f"{VERBS[surplus.operation]} {surplus.topic} in {surplus.domains}" if surplus else ""
        profiles = dict.fromkeys(name for grant in wider for name in grant.profiles)
        one = len({grant.document for grant in wider}) == 1
        rename = renaming(keystore)(first.document, Role.PERMISSIONS) if one else ""
        yield Violation(
            f"{first.document} is validly signed and in force, and lets {first.enclave} {right}, which its own "
            f"permissions do not: peers accept it{more_like(wider)}.",
            [grant.location for grant in wider],
            enclave=first.enclave if len({grant.enclave for grant in wider}) == 1 else None,
            profiles=tuple(profiles),
            key="wider",
            remedy=decision(f"{rename} Else: {_REVOKE}") if rename else None,
        )
    known = {grant.document for grant in wider}
    equal = [grant for grant in granting if grant.document not in known]
    if equal:
        documents = dict.fromkeys(grant.document for grant in equal)
        give = "gives" if len(documents) == 1 else "give"
        yield Violation(
            f"{_documents(len(documents))} outside the enclaves {give} no more than theirs do, for now: "
            f"{listed(documents)} for {listed(dict.fromkeys(grant.enclave for grant in equal))}. A right that is "
            "removed later stays usable.",
            [grant.location for grant in equal],
            severity=Severity.LOW,
            key="equal",
        )


@rule(
    "KA661",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2 (an enclave applies the governance that it is given)",
    decision(
        "Delete it, or keep it where documents are signed: copying this one file is enough to replace another "
        "governance."
    ),
    applies=_has_unmanaged,
)
def signed_governance_at_large(keystore: Keystore) -> Iterator[Violation]:
    """A governance document that the permissions CA signed lies where no enclave applies it.

    Whoever has an identity outside the enclaves (KA668) may start with it: flows count that. Whoever can write to a
    robot needs no key to put it in force, and it has no date.
    """
    found = governance_apart(keystore)
    if found:
        yield Violation(
            f"{listed(each.place for each in found)}: validly signed governance that no enclave applies; it "
            "could be swapped in.",
            _at(found),
        )


@rule(
    "KA662",
    Severity.INFO,
    _CLAUSE,
    decision("Delete what is not needed; a robot needs only its own enclaves' documents."),
    applies=_has_unmanaged,
)
def signed_document_without_effect(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A signed document outside the enclaves gives nothing to anybody here.

    No peer here accepts its signature, or none of its grants is in force and names an enclave here. It may count
    elsewhere, or once a grant begins.
    """
    files = permissions_cas(keystore)
    read = [each for each in keystore.unmanaged if each.document is not None]
    refused = [each for each in read if each.document and not may_be_taken(each.document.signed, files)]
    if refused:
        yield Violation(
            f"{_documents(len(refused))} outside the enclaves that no peer here accepts: "
            f"{listed(each.place for each in refused)}.",
            _at(refused),
            key="refused",
        )
    systems = context.meaning.systems
    places = {each.place for each in unmanaged_permissions(keystore)}
    doubtful = {doubt.location.path for doubt in context.meaning.doubts}
    granting = {grant.document for grant in unmanaged_grants(systems, places)} if systems else places
    idle = [s for s in read if s.place in places - granting - doubtful]
    if idle:
        yield Violation(
            f"{_documents(len(idle))} outside the enclaves that peers would accept, without a grant in force for "
            f"an enclave here: {listed(each.place for each in idle)}.",
            _at(idle),
            key="idle",
        )


@rule(
    "KA663",
    Severity.HIGH,
    "keystore-audit, docs/model.md (what is not read counts as able to do anything)",
    decision(
        "Find out what the file says, and remove it if it is no document of the keystore. A copy that peers may "
        "accept counts wherever it is."
    ),
    applies=_has_unmanaged,
)
def document_at_large_unread(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A file may be a permissions document that peers accept, and what it says is unknown.

    No enclave has it, or an enclave has it where no implementation reads it and anybody can take it. It has the mark of
    a message and is not read as one (below other text, a PEM signature, too large, one of too many). Or its XML has no
    single meaning. It then counts as giving everything to everybody; a text that only quotes the mark, without a
    signature, does not. A governance without a single meaning counts too, if an identity outside the enclaves (KA668)
    may start with it. Critical if its form ends the process that reads it, since peers send permissions too. For faults
    of signatures, see KA3.
    """
    known = {each.place: each for each in (*unmanaged_permissions(keystore), *unmanaged_governance(keystore))}
    carried = {file.place: enclave.path for enclave in keystore.enclaves for file in enclave.files.every}
    for doubt in context.meaning.doubts:
        each = known.get(doubt.location.path)
        document = each.document if each is not None else None
        if each is None or (document is not None and envelope(document.signed).verdict is Truth.UNKNOWN):
            continue
        crashes = document is not None and any(of_kinds(document.defects, *_CRASHES))
        yield Violation(
            f"{each.place} may give anything to anybody. {sentence(doubt.reason)}.",
            (doubt.location,),
            enclave=carried.get(each.place),
            remedy=SIGN_AGAIN if each.place in carried else None,
            severity=Severity.CRITICAL if crashes else None,
            undecided=True,
            key=each.place,
        )


@rule(
    "KA668",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 and 9.4.1.3 (whoever has the key of a certificate is a participant, with what grants "
    "give its subject)",
    decision(_NEEDED_OR_NOT),
    applies=lambda keystore, _context: bool(
        keystore.identities.found or keystore.identities.possible or keystore.identities.unread
    ),
)
def identity_outside_enclaves(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A certificate outside the enclaves has its private key somewhere in the tree, and peers accept it.

    Whoever has the tree can start it: six files are enough. It is no enclave here, but flows and properties count it.
    Peers accept it by a grant, even one that begins later, or without one if join access control is off. It signs its
    own permissions if it has the permissions CA's key, or if the signer is not pinned. Medium if an enclave has the
    same subject and all peers that accept this identity accept that enclave, too: it then has no further rights.

    Certificates and keys are read in PEM anywhere, and in files in DER. Undecided if a PEM key that cannot be read (a
    password) may belong to such a certificate, unless it lies where authorities' keys do. Also undecided if a file with
    the mark of a certificate or key cannot be read. Other unread files (KA121) are assumed to hold none. For an
    enclave's own certificate in a form that no run time reads, see certificate-unreadable.
    """
    identities = keystore.identities
    unreadable = {enclave.files.files[Role.CERTIFICATE].place for enclave in keystore.enclaves if not enclave.identity}
    every = admitted(keystore, identities.found, context.profiles, context.at)
    found = [each for each in every if each.certificate.path not in unreadable]
    for same in (False, True):
        alike = [each for each in found if (each.enclave is not None) is same]
        if alike:
            certificates = [each.certificate for each in alike]
            rename = renaming(keystore)(certificates[0].path, Role.CERTIFICATE) if len(alike) == 1 else ""
            yield _started(alike, rename)
    yield from _perhaps_started(admitted(keystore, identities.possible, context.profiles, context.at))
    unread = identities.unread
    if unread:
        yield Violation(
            f"{unread[0].place} may hold an identity that peers accept: it {unread[0].detail}{more_like(unread)}.",
            [Location(file.place) for file in unread],
            undecided=True,
            remedy=decision(_FIND_OUT),
            key="unread",
        )


def _started(found: Sequence[Admitted], rename: str) -> Violation:
    """Identities with their keys, all of which share their subjects with enclaves, or none."""
    first = found[0]
    same = first.enclave is not None
    whose = f"another identity of {first.enclave}" if same else "an identity that no enclave here has"
    return Violation(
        f"{first.certificate.path} is {whose} ({quoted(first.certificate.subject)}), its private key "
        f"is in {first.key}, and peers accept it: whoever has this tree can start it{more_like(found)}.",
        [place for each in found for place in _identity_at(each)],
        severity=Severity.MEDIUM if same else None,
        key=f"{'same' if same else 'other'} subject",
        remedy=decision(f"{rename} Else: {_NEEDED_OR_NOT}") if rename else None,
    )


def _perhaps_started(possible: Sequence[Admitted]) -> Iterator[Violation]:
    """Identities whose keys may be in a file that could not be read."""
    if possible:
        first = possible[0]
        yield Violation(
            f"Peers accept whoever has the key of {first.certificate.path} "
            f"({quoted(first.certificate.subject)}). Whether {first.key} holds it is unknown: it could not be read"
            f"{more_like(possible)}.",
            [place for each in possible for place in _identity_at(each, "perhaps its private key")],
            undecided=True,
            remedy=decision(_FIND_OUT),
            key="possible",
        )


def _identity_at(each: Admitted, key: str = "the private key") -> Iterator[Location]:
    yield located(each.certificate)
    yield Location(each.key, message=key)
    for right in each.rights:
        yield located(right, "what lets it in")


@rule(
    "KA669",
    Severity.MEDIUM,
    "ros2/rmw_dds_common, security.cpp (enclaves lie in the folder enclaves/ of the keystore that is named)",
    decision(
        "Audit this keystore with `-r`, which includes what lies in it. Then move the inner one out: whoever "
        "has this keystore has its private keys."
    ),
)
def keystore_inside_keystore(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Another keystore or an enclave, whole or not, lies outside enclaves/, and this audit does not judge it.

    A run time that is told of that folder uses it. Its documents and identities count as far as peers of this keystore
    accept them (KA660, KA661, KA668). No rule judges its own governance, authorities and rights. The audit is
    incomplete if somebody can start from it (enclaves/, or a certificate and a private key) and this run does not audit
    it. In layouts before Foxy such a folder is an enclave of the keystore, until enclaves/ and public/ beside it make
    the layout a newer one.
    """
    nested = keystore.layout.nested
    if nested:
        one = len(nested) == 1
        folders = [each.path for each in nested]
        apart = context.beside.apart if context.beside is not None else frozenset()
        yield Violation(
            f"{listed(folders)} {'is a keystore or an enclave' if one else 'are keystores or enclaves'} of "
            f"{'its' if one else 'their'} own outside enclaves/: what {'it' if one else 'they'} would let anybody do "
            "was not judged here.",
            [Location(path) for path in folders],
            undecided=any(each.startable and each.path not in apart for each in nested),
            key="\n".join(folders),
        )
