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
    "Deleting the file does not end what it gives: whoever has a copy may present it until its dates end. Give the "
    "enclave a certificate with another subject, or make a new permissions CA and sign every document again; then "
    "delete it."
)

_FIND_OUT: Final = (
    "Find out what it holds (`openssl pkey -in FILE -pubout`), and take it out of "
    "the keystore. If it is the identity of a robot, whoever has a copy goes on being that participant: revoke its "
    "certificate, or let no grant name its subject."
)

_NEEDED_OR_NOT: Final = (
    "If a robot needs it, move its folder below enclaves/, so that it is audited with the others. If not, delete the "
    "key, and revoke the certificate or let no grant name its subject: whoever has a copy of both is this participant."
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

    A peer takes whatever valid document is presented to it, so that an enclave has the rights of all of them together,
    and nothing revokes one: high where it gives what no enclave's own document does, else low, since a right that is
    taken away later is still in it. Copies with the same bytes give nothing more; those kept elsewhere are not seen.
    """
    granting = _granting(keystore, context)
    wider = [grant for grant in granting if grant.surplus is not None]
    if wider:
        first, surplus = wider[0], wider[0].surplus
        right = f"{VERBS[surplus.operation]} {quoted(surplus.topic)} in {surplus.domains}" if surplus else ""
        profiles = dict.fromkeys(name for grant in wider for name in grant.profiles)
        one = len({grant.document for grant in wider}) == 1
        rename = renaming(keystore)(first.document, Role.PERMISSIONS) if one else ""
        yield Violation(
            f"{first.document} is validly signed and in force, and lets {first.enclave} {right}, which its own "
            f"permissions do not: peers take it{more_like(wider)}.",
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
            f"{listed(documents)} for {listed(dict.fromkeys(grant.enclave for grant in equal))}. A right that is taken "
            "away later stays usable.",
            [grant.location for grant in equal],
            severity=Severity.LOW,
            key="equal",
        )


@rule(
    "KA661",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2 (an enclave applies the governance that it is given)",
    decision(
        "Delete it, or keep it where documents are signed; a governance that is validly signed takes the "
        "place of another by copying one file."
    ),
    applies=_has_unmanaged,
)
def signed_governance_at_large(keystore: Keystore) -> Iterator[Violation]:
    """A governance document that the permissions CA signed lies where no enclave applies it.

    It has no effect on enclaves. Whoever has an identity outside of them (KA668) may start with it: flows count that.
    Whoever can write to a robot needs no key to put it in the place of the one in use, and old governances are often
    weaker. Governance documents have no dates.
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
    decision("Delete what is not needed; on a robot nothing but its own enclaves' documents is."),
    applies=_has_unmanaged,
)
def signed_document_without_effect(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A signed document outside the enclaves gives nothing to anybody here.

    Either no peer here takes its signature, or none of its grants is in force and names an enclave here. It may count
    where another authority is trusted, or once a grant's dates begin.
    """
    files = permissions_cas(keystore)
    read = [each for each in keystore.unmanaged if each.document is not None]
    refused = [each for each in read if each.document and not may_be_taken(each.document.signed, files)]
    if refused:
        yield Violation(
            f"{_documents(len(refused))} outside the enclaves that no peer here takes: "
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
            f"{_documents(len(idle))} outside the enclaves that peers would take, without a grant in force for "
            f"an enclave here: {listed(each.place for each in idle)}.",
            _at(idle),
            key="idle",
        )


@rule(
    "KA663",
    Severity.HIGH,
    "keystore-audit, docs/model.md (what is not read counts as able to do anything)",
    decision(
        "Take the file out of the keystore if it is no document of it. A copy that peers may take goes on "
        "counting wherever it is: find out what it says."
    ),
    applies=_has_unmanaged,
)
def document_at_large_unread(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A file may be a permissions document that peers take, and what it says is unknown.

    No enclave has it, or it stands in an enclave's own where no implementation reads it and from where anybody can take
    it. It carries the mark of a message and was not read as one (below other text, a signature in PEM, too large, one
    of too many), or its XML has no single meaning; it then counts as giving everything to everybody. A text that only
    quotes the mark, without a signature, is none. So does a governance document without a single meaning where somebody
    has an identity outside the enclaves (KA668) and may start with it. Critical where it is of a form that ends the
    process of the implementation that reads it, since permissions come from peers too. What is wrong with a signature
    is in KA3.
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
    "DDS-Security 1.1, 9.3.1 and 9.4.1.3 (whoever has the key of a certificate that the identity CA issued is a "
    "participant, with what grants give its subject)",
    decision(_NEEDED_OR_NOT),
    applies=lambda keystore, _context: bool(
        keystore.identities.found or keystore.identities.possible or keystore.identities.unread
    ),
)
def identity_outside_enclaves(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A certificate outside the enclaves, its private key somewhere in the tree, and peers that let it in.

    Whoever has the tree can start it: a run time needs no more than a folder of six files, and may get them from
    anywhere. It is no enclave here; flows and properties count it among the participants. Peers let it in by a grant,
    also one that begins later; by a governance with join access control off, where no grant is needed; or by
    permissions that it signs itself, where it has the permissions CA's own key or the signer is not pinned. Medium
    where an enclave has the same subject and all peers that take this identity take that enclave, too: the identity
    has no further rights then. Certificates and keys are taken from wherever they stand in PEM, and from files in DER.

    A certificate that an enclave has as its own, in a form that no run time reads, is left to certificate-unreadable.

    Undecided where a key in PEM that cannot be read (a password) may be that of such a certificate, unless it lies
    where those of authorities do, and where a file with the mark of a certificate or key cannot be read. What other
    files hold that were not read (KA121) is assumed to be none.
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
            f"{unread[0].place} may hold an identity that peers let in: it {unread[0].detail}{more_like(unread)}.",
            [Location(file.place) for file in unread],
            undecided=True,
            remedy=decision(_FIND_OUT),
            key="unread",
        )


def _started(found: Sequence[Admitted], rename: str) -> Violation:
    """Identities with their keys, all of which share their subjects with enclaves, or none."""
    first = found[0]
    same = first.enclave is not None
    whose = f"another identity of {first.enclave}" if same else "an identity of its own and no enclave here"
    return Violation(
        f"{first.certificate.path} is {whose} ({quoted(first.certificate.subject)}), its private key "
        f"is in {first.key}, and peers let it in: whoever has this tree can start it{more_like(found)}.",
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
            f"Peers let in whoever has the key of {first.certificate.path} "
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
        "Audit this keystore with `-r`, which audits what lies in it too. Then move it out: whoever has this "
        "keystore has its private keys."
    ),
)
def keystore_inside_keystore(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Outside enclaves/ lies another keystore or an enclave, whole or not, and this audit does not judge it.

    A run time that is told of that folder uses it. Its documents and identities count here as far as peers of this
    keystore take them (KA660, KA661, KA668); its own governance, authorities and rights are judged by no rule. So the
    audit is incomplete where somebody can be started from it (it holds enclaves/, or a certificate and a private key)
    and the same run does not audit it. In layouts before Foxy such a folder is an enclave of the keystore itself: one
    that gets enclaves/ and public/ beside its enclaves is of the newer layout, and these are judged no more.
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
