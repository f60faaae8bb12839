"""KA5: whom grants name, when they are in force (read as `spec` has it), and what ends the process of a reader."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Final

from keystore_audit.findings import Act, Location, Severity, decision
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Grant, Permissions
from keystore_audit.model.access_view import typed_by
from keystore_audit.model.claims.ability import sent
from keystore_audit.model.inventory import unmanaged_identities
from keystore_audit.model.subjects.comparison import matching, names
from keystore_audit.model.subjects.told import meaning, meanings
from keystore_audit.profiles import VARIANTS, Profile, SubjectComparison, facts, implementations
from keystore_audit.rules.governance import in_document
from keystore_audit.rules.permissions import about, dated, own_grants
from keystore_audit.rules.registry import Context, Violation, located, more_like, quoted, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import DocumentUse, PermissionsUse, instant_of, permissions_uses, speaks
from keystore_audit.text import instant

_SAFE_FORM: Final = (
    "Use subjects that every implementation reads alike: one CN, the enclave's path, in ASCII, without blanks, quotes "
    "and escapes. Write it in the grant as `CN=/path`, letter by letter. The parts of a path must not all be parts of "
    "another enclave's path. Issue certificates again if their subject changes."
)

_Named = tuple[Grant, PermissionsUse, Certificate, tuple[Profile, ...], bool]
"""A grant, its document, a certificate, the variants whose peers take the grant to name it, and whether it means that
subject alone."""


def _identities(keystore: Keystore) -> dict[str, Certificate]:
    """Those of enclaves, by SHA-256."""
    firsts = (enclave.identity for enclave in keystore.enclaves)
    return {first.sha256: first for first in firsts if first is not None}


@lru_cache(maxsize=1)  # both rules ask
def _named(keystore: Keystore, at: datetime) -> tuple[_Named, ...]:
    """Of unmanaged identities as well, of which it is known that somebody has the key."""
    unmanaged = {e.certificate.sha256: e.certificate for e in unmanaged_identities(keystore, at) if e.held}
    return tuple(_grants_and_identities(keystore, [*(unmanaged | _identities(keystore)).values()]))


def _grants_and_identities(keystore: Keystore, identities: Sequence[Certificate]) -> Iterator[_Named]:
    """Each grant of a document that may be taken, with each identity that some variants, not all, take it to name."""
    held = ((grant, use) for use in permissions_uses(keystore) if use.speaks for grant in use.document.grants)
    grants = grouped(held, lambda each: each[0].subject_name.text)
    tables = {comparison: matching(list(grants), identities, comparison) for comparison in SubjectComparison}
    odd = [
        (subject, identities[number], comparisons)
        for subject in grants
        for number in dict.fromkeys(number for table in tables.values() for number in table[subject])
        if len(comparisons := [each for each, table in tables.items() if number in table[subject]]) < len(tables)
    ]
    subjects = {each.subject for each in identities}
    meant = gathered((meant, each.subject) for each in identities for meant in meanings(each)) if odd else {}
    for subject, identity, comparisons in odd:
        naming = tuple(profile for profile in VARIANTS.values() if profile.trust.subjects in comparisons)
        own = {subject} if subject in subjects else set(meant.get(meaning(subject), ()))
        for grant, use in grants[subject]:
            yield grant, use, identity, naming, own == {identity.subject}


@rule(
    "KA519",
    Severity.CRITICAL,
    f"DDS-Security 1.1, 9.4.1.3 (subject_name); {facts.SUBJECTS_SOURCES}",
    decision(_SAFE_FORM, Act.EDIT_PERMISSIONS),
    explains=("no-subject-serves-two-enclaves",),
)
def grant_names_another_subject(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Some implementation takes a grant to name an identity whose subject is another one.

    Peers accept any validly signed document that an enclave presents, so this identity has the rights of the grant.
    Fast DDS since 2.14 counts attributes and looks each up by its type, so a repeated one stands for others. Cyclone
    DDS cuts names at `,`, `/` and `|`, and looks for every piece of the certificate's name in the grant's. So `/robot`
    has the rights of `/robot/arm`, and so has `/arm/robot`. High if no chosen profile does so. Identities that no
    enclave has count if somebody has the key and an identity CA vouches for them (KA228, KA668).
    """
    enclaves = _identities(keystore)
    lent = [each for each in _named(keystore, context.at) if not each[-1]]
    for (_sha256, naming), found in grouped(lent, lambda each: (each[2].sha256, each[3])).items():
        certificate, texts = found[0][2], list(dict.fromkeys(each[0].subject_name.text for each in found))
        whoever = (
            "that enclave" if certificate.sha256 in enclaves else f"whoever has the identity in {certificate.path}"
        )
        yield Violation(
            f"The grant of {quoted(texts[0])}{more_like(texts)} names {quoted(certificate.subject)} too, for "
            f"{implementations(naming)}: {whoever} has {'their' if texts[1:] else 'its'} rights.",
            (*(use.at(grant.subject_name.line) for grant, use, *_ in found), located(certificate, "the identity")),
            severity=None if context.chose(naming) else Severity.HIGH,
            profiles=tuple(profile.name for profile in naming),
            key="\0".join((*sorted(texts), certificate.subject)),
        )


@rule(
    "KA520",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (subject_name); RFC 2253; measured",
    decision(
        "Write <subject_name> as the message writes the identity's subject. If that is read differently, too, "
        f"change the subject. {_SAFE_FORM}",
        Act.EDIT_PERMISSIONS,
    ),
    stops=True,
)
def subject_read_differently(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A grant means an identity, but some implementations do not find it: the enclave has no rights there.

    Order, blanks, quotes, escapes, non-ASCII characters and repeated attributes differ. High if a chosen profile does
    not find it, else low.
    """
    enclaves = _identities(keystore)
    for grant, use, certificate, _naming, own in _named(keystore, context.at):
        missing = [each for each in VARIANTS.values() if not _finds(use, grant, certificate, each)]
        if certificate.sha256 not in enclaves or not own or len(missing) == len(VARIANTS):  # KA503 tells of nobody
            continue
        yield Violation(
            f"The grant of {quoted(grant.subject_name.text)} does not name the identity "
            f"{quoted(certificate.subject)} for {implementations(missing)}, though it means that subject.",
            _places(use, grant, certificate),
            severity=None if context.chose(missing) else Severity.LOW,
            profiles=tuple(profile.name for profile in missing),
            key=f"{grant.subject_name.text}\0{certificate.subject}",
        )


def _finds(use: PermissionsUse, grant: Grant, certificate: Certificate, profile: Profile) -> bool:
    """Whether an implementation takes the grant, as it reads it, for the certificate's, or does not read it at all."""
    read, place = typed_by(use.document, profile.access), use.document.grants.index(grant)
    grants = read.grants[place : place + 1] if isinstance(read, Permissions) else ()
    return not grants or names(grants[0].subject_name.text, certificate, profile.trust.subjects)


def _places(use: PermissionsUse, grant: Grant, certificate: Certificate) -> tuple[Location, ...]:
    return (use.at(grant.subject_name.line), located(certificate, "the identity"))


_LATER = in_permissions("Let the grant end later")
_CLAUSE = "DDS-Security 1.1, 9.4.1.3 (validity: not_before, not_after)"


def _dated(use: PermissionsUse) -> Iterator[tuple[Grant, datetime, datetime]]:
    """Grants that name an enclave which carries the document, with the instants between which they are in force."""
    for grant in own_grants(use):
        start, end = instant_of(grant.not_before), instant_of(grant.not_after)
        if start is not None and end is not None:
            yield grant, start, end


def _of_date(use: PermissionsUse, grant: Grant, date: Text, says: str) -> Violation:
    """A violation at a date of a grant."""
    message = f"The grant of {quoted(grant.subject_name.text)} {says}."
    return about(use, grant, date.line, message, key=dated(grant))


@rule(
    "KA505",
    Severity.HIGH,
    _CLAUSE,
    _LATER,
    applies=speaks,
    stops=True,
)
def grant_expired(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The enclave's grant is past its not_after: the enclave cannot start, and peers refuse it.

    Dates without a zone are read as UTC. Fast DDS reads every date in the machine's zone (measured), which shifts it by
    up to 14 hours. Running sessions may go on.
    """
    for grant, start, end in _dated(use):
        if start <= end < context.at:
            says = f"expired at {instant(end)} (audited for {instant(context.at)})"
            yield _of_date(use, grant, grant.not_after, says)


@rule(
    "KA506",
    Severity.HIGH,
    _CLAUSE,
    in_permissions("Wait until then, or let the grant begin earlier"),
    applies=speaks,
    stops=True,
)
def grant_not_yet_valid(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The enclave's grant is before its not_before: the enclave cannot start, and peers refuse it.

    A robot whose clock has no battery may start before every not_before; that cannot be seen here.
    """
    for grant, start, end in _dated(use):
        if context.at < start <= end:
            says = f"is valid from {instant(start)} on (audited for {instant(context.at)})"
            yield _of_date(use, grant, grant.not_before, says)


@rule(
    "KA507",
    Severity.MEDIUM,
    _CLAUSE,
    _LATER,
    applies=speaks,
)
def grant_expires_soon(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The enclave's grant ends within the notice period (--expires-within, 30 days): then nothing new starts."""
    for grant, start, end in _dated(use):
        if start <= end and context.at <= end and end - context.at <= context.expires_within:
            notice = f"(notice: {context.expires_within.days})"
            says = f"expires at {instant(end)}, in {(end - context.at).days} days {notice}"
            yield _of_date(use, grant, grant.not_after, says)


@rule(
    "KA513",
    Severity.LOW,
    _CLAUSE,
    in_permissions("Let the grant end with the identity"),
    applies=speaks,
)
def grant_outlives_certificate(use: PermissionsUse) -> Iterator[Violation]:
    """The grant ends later than the identity that it names.

    The next identity of that name gets its rights without a new signature: a signed grant cannot be revoked before it
    ends.
    """
    firsts = [enclave.identity for enclave in use.enclaves if enclave.identity is not None]
    ends = gathered((meant, each.not_after) for each in firsts for meant in (each.subject, *meanings(each)))
    for grant, start, end in _dated(use):
        text = grant.subject_name.text
        identity_ends = max(ends.get(text) or ends[meaning(text)])
        if start <= end and end > identity_ends:
            says = f"is good until {instant(end)}, the identity only until {instant(identity_ends)}"
            yield _of_date(use, grant, grant.not_after, says)


@rule(
    "KA516",
    Severity.HIGH,
    _CLAUSE,
    in_permissions("Let not_before come before not_after"),
    applies=speaks,
    stops=True,
)
def validity_inverted(use: PermissionsUse) -> Iterator[Violation]:
    """The grant ends before it begins, so it is never in force. Zones count: `Z` and `+02:00` differ."""
    for grant, start, end in _dated(use):
        if start > end:
            says = f"begins at {instant(start)} and ends before that, at {instant(end)}"
            yield _of_date(use, grant, grant.not_before, says)


_CRASHES: Final = "an enclave or peer that reads it crashes, so one signed file stops a robot."


@rule(
    "KA517",
    Severity.CRITICAL,
    facts.EMPTY_TOPIC_MEASURED,
    decision("Find out who signed it, and remove the empty element.", Act.EDIT),
    stops=True,
)
def empty_topic_expression(use: DocumentUse) -> Iterator[Violation]:
    """A <topic> or <topic_expression> is empty: implementations dereference a null pointer and crash (measured).

    Peers send permissions too, so one document that the authority signed stops others. What an implementation without
    the fault makes of it is unknown.
    """
    yield from in_document(use, _CRASHES, Kind.EMPTY_TOPIC)


@rule(
    "KA518",
    Severity.CRITICAL,
    facts.NO_DOMAINS_MEASURED,
    in_permissions("Find out who signed it, and add <domains> to the rule"),
    stops=True,
)
def rule_without_domains(use: PermissionsUse) -> Iterator[Violation]:
    """A rule has no <domains>: Cyclone DDS crashes at a null pointer (measured), Fast DDS refuses the document.

    Peers send permissions too, so one document that the authority signed stops others.
    """
    yield from in_document(use, _CRASHES, Kind.RULE_WITHOUT_DOMAINS)


@rule(
    "KA521",
    Severity.CRITICAL,
    facts.EMPTY_ELEMENT_MEASURED,
    in_permissions("Find out who signed it, and write the document again"),
    stops=True,
)
def empty_element(use: PermissionsUse) -> Iterator[Violation]:
    """The document, or the date of a grant, is empty: Fast DDS 2.9 and 2.14 crash at a null pointer (measured).

    Others refuse the document. Peers send permissions too, so one document that the authority signed stops others.
    """
    yield from in_document(use, _CRASHES, Kind.EMPTY_ELEMENT)


_DYING: Final = VARIANTS[facts.DIES_OF_LARGE_PERMISSIONS]


@rule(
    "KA522",
    Severity.MEDIUM,
    facts.HANDSHAKE_MEASURED,
    decision(
        "Use one expression for several names, remove rules that the nodes do not use, or give the nodes "
        "several enclaves. Then sign the documents again."
    ),
)
def permissions_too_large(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """Certificate and permissions do not fit in a handshake message: on Fast DDS the enclave talks to nobody.

    High under Fast DDS 2.9, whose process ends when it answers a peer's handshake (measured). If it asks first, it only
    logs an error. Not measured on other Fast DDS versions; Cyclone DDS sends them in parts (measured). How much fits
    depends on the kind of key: 63,000 octets with all, 63,700 with none.
    """
    for enclave in use.enclaves:
        octets = sent(enclave)
        limits = {p.name: p.local.most_sent for p in context.profiles if p.local.most_sent is not None}
        unfit = tuple(name for name, limit in limits.items() if octets > limit)
        if unfit:
            yield Violation(
                f"{enclave.path} sends peers {octets:,} octets of certificate and permissions. A handshake of "
                f"{_DYING.title} holds {min(limits.values()):,}: it talks to nobody, and its process ends.",
                (Location(use.signed.file.place),),
                severity=Severity.HIGH if _DYING.name in unfit else None,
                enclave=enclave.path,
                profiles=unfit,
                key="",
            )
