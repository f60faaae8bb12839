"""KA5: permissions documents, their form and their grants (DDS-Security 1.1, 9.4.1.3).

Dates are in `grants.py`, domains in `restrictions.py`, how far grants reach in `breadth.py`. Rules about what a
document says apply where somebody may take it: what every implementation refuses says nothing of consequence.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

from keystore_audit.findings import Location, Remedy, Severity, decision
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.identity import Identity
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.typed import Grant, Operation
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.subjects.comparison import matching
from keystore_audit.model.subjects.told import meaning, meanings, same_meaning
from keystore_audit.profiles import VARIANTS, JoinCheck, Profile, SubjectComparison, Syntax, doing, facts
from keystore_audit.rules.certificate import has_usual_subject, usual_subject
from keystore_audit.rules.governance import AMBIGUOUS, DIFFER, UNREAD, in_document, out_of_form
from keystore_audit.rules.registry import Context, Violation, defective, listed, located, quoted, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import ROWS, PermissionsUse, instant_of, speaks, verdict
from keystore_audit.truth import Truth


def dated(grant: Grant) -> str:
    """Whom the grant names and when it is in force: the key of what is about dates."""
    return f"{grant.subject_name.text} {grant.not_before.text} {grant.not_after.text}"


def own_grants(use: PermissionsUse) -> list[Grant]:
    """The grants that mean an enclave which carries the document, in whatever notation, second ones too."""
    own = [enclave.identity for enclave in use.enclaves if enclave.identity is not None]
    subjects = {each.subject for each in own}
    meant = {meant for each in own for meant in meanings(each)}
    texts = ((grant, grant.subject_name.text) for grant in use.document.grants)
    return [grant for grant, text in texts if text in subjects or meaning(text) in meant]


def about(use: PermissionsUse, grant: Grant, line: int | None, message: str, **more: Any) -> Violation:
    """A violation about a grant, at `line`."""
    more.setdefault("key", grant.subject_name.text)
    return Violation(
        message,
        (use.at(line),),
        **more,
    )


@rule(
    "KA501",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 and its permissions XSD",
    in_permissions("Correct what the schema forbids"),
    stops=True,
)
def permissions_schema_invalid(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The document breaks the permissions schema of DDS-Security.

    Fast DDS refuses unknown and reordered elements, Cyclone DDS accepts any order (measured). Verdicts follow what each
    one reads; medium if all read it. If one in scope was not measured, the meaning is unknown, unless nobody accepts
    the signature.
    """
    yield from out_of_form(use, context, Kind.SCHEMA_INVALID)


@rule(
    "KA502",
    Severity.HIGH,
    f"DDS-Security 1.1, 9.4.1.3; XML 1.0; {facts.XML_PARSERS}",
    in_permissions("Write plain XML, without comments, CDATA, entities and blanks in values"),
    stops=True,
)
def permissions_ambiguous(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The document is outside the plain XML that every parser reads alike, or holds a value without a meaning.

    Fast DDS, Cyclone DDS and libxml2 read comments, blanks in values and odd dates differently (measured). Verdicts
    follow what each one reads; medium if all read it. How a robot reads CDATA, entities and other encodings, or a
    document above our limits (docs/security-model.md), is unknown.
    """
    yield from out_of_form(use, context, *AMBIGUOUS)
    remedy = in_permissions(
        "Split a document for several enclaves into one for each, or write fewer rules and wildcards"
    )
    yield from in_document(use, UNREAD, Kind.BEYOND_LIMIT, remedy=remedy)
    valid = use.document.readings.by_syntax.get(Syntax.SCHEMA)  # of other dates KA501 speaks
    grants = () if isinstance(valid, str | Defect | None) else valid.grants
    dates = (date for grant in grants for date in (grant.not_before, grant.not_after))
    odd = (
        Defect(
            kind=Kind.VALUE_INVALID,
            path=use.signed.file.place,
            line=date.line,
            detail=f"expected a date as 2026-01-31T00:00:00, got {quoted(date.text)}",
        )
        for date in dates
        if instant_of(date) is None
    )
    yield from defective(odd, DIFFER, undecided=use.may_be_taken)


def _name_it(subject: str) -> Remedy:
    return in_permissions(f"Set <subject_name> to {quoted(subject)}")


@rule(
    "KA503",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (subject_name); RFC 4514",
    in_permissions("Set <subject_name> to the subject of cert.pem, in the form of RFC 4514"),
    applies=speaks,
    stops=True,
)
def no_grant_for_certificate(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """No grant names the identity of the enclave that carries the document, so the enclave cannot start.

    Compared in the form of RFC 4514, which every implementation reads alike. If some implementations still find the
    identity in a grant that means its subject, see subject-read-differently. If it means another subject, this finding
    is about the others, and low if none of them was chosen.
    """
    grants = use.document.grants
    named = list(dict.fromkeys(grant.subject_name.text for grant in grants))
    line = next((grant.subject_name.line for grant in grants), None)
    got = f"got {listed(f'{quoted(name)}' for name in named)}" if named else "there is no grant at all"
    for enclave, first, naming in _unnamed(use, named):
        wanted, remedy = f"{got}, expected {quoted(first.subject)}", _name_it(first.subject)
        if not has_usual_subject(first, enclave, context.keystore):  # to grant it rights moves the fault: see KA220
            usual = usual_subject(enclave, context.keystore)
            wanted = f"{got}, and the identity is {quoted(first.subject)}; expected {quoted(usual)} in both"
            remedy = decision(f"Use {quoted(usual)} in both certificate and <subject_name>, and issue and sign again.")
        missing = [profile for profile in VARIANTS.values() if profile not in naming]
        yield Violation(
            f"No grant names the identity of {enclave.path}: {wanted}.",
            (use.at(line), located(first, "the identity")),
            enclave=enclave.path,
            severity=None if context.chose(missing) else Severity.LOW,
            profiles=tuple(profile.name for profile in missing) if naming else (),
            key=first.subject,
            remedy=remedy,
        )


def _unnamed(use: PermissionsUse, named: Sequence[str]) -> Iterator[tuple[Enclave, Certificate, list[Profile]]]:
    """Enclaves whose identity has none of these names to the letter, each with the variants that take one for it.

    Left out is who does not take the document, and whose name is meant and only written otherwise for some.
    """
    lacking = [
        (enclave, enclave.identity)
        for enclave in use.enclaves
        if enclave.identity is not None and enclave.identity.subject not in named and not _refused_by(use, enclave)
    ]
    firsts = [first for _enclave, first in lacking]
    tables = {each: matching(named, firsts, each, own=True) for each in SubjectComparison} if firsts else {}
    for number, (enclave, first) in enumerate(lacking):
        naming = {each: [text for text in named if number in table[text]] for each, table in tables.items()}
        if not any(same_meaning(text, first) for texts in naming.values() for text in texts):
            yield enclave, first, [profile for profile in VARIANTS.values() if naming[profile.trust.subjects]]


def _refused_by(use: PermissionsUse, enclave: Enclave) -> bool:
    """Whether the enclave takes the document under no known implementation."""
    return all(verdict(use.signed, enclave, trust) is Truth.NO for trust in ROWS)


@rule(
    "KA504",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (grant); measured: the first one decides",
    in_permissions("Merge the grants into one, with one <profile> for each node below one <profiles>"),
    applies=speaks,
)
def second_grant_for_subject(use: PermissionsUse) -> Iterator[Violation]:
    """Two grants name one subject, and the second counts for nothing.

    On Fast DDS the first grant in force decides; on Cyclone DDS the first one, in force or not (measured). For each
    <profiles> of an enclave sros2 writes a grant: all but the first are lost.
    """
    first: dict[str, Grant] = {}
    for grant in use.document.grants:
        subject = grant.subject_name.text
        if first.setdefault(subject, grant) is not grant:
            yield Violation(
                f"A second grant names {quoted(subject)}: the one at line {first[subject].line} decides. "
                f"This one takes its place only on {doing('skips_grants_out_of_date', True)}, when that one has "
                "expired.",
                [use.at(g.line, m) for g, m in ((grant, ""), (first[subject], "the grant that decides"))],
                # The dates tell when it takes the place of the other.
                key=f"{dated(first[subject])}\n{dated(grant)}",
            )


@rule(
    "KA512",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3; {facts.OTHERS_GRANTS_MEASURED}",
    in_permissions("Give each enclave a document with only its own grant"),
    applies=speaks,
)
def grants_for_other_subjects(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The document holds grants for others than the enclaves that carry it.

    Peers accept any validly signed document with a matching grant, so whoever is named may present this one instead of
    its own (measured). The handshake also shows everybody what the others may do. High if it gives an enclave of the
    keystore a right that its own document does not: an escalation. For a misspelt name of this enclave, see
    no-grant-for-certificate. If several robots' keystores are audited together, the finding names the enclave; its own
    rights are not compared.
    """
    own = {grant.subject_name.text for grant in own_grants(use)}
    if not any(enclave.identity for enclave in use.enclaves):
        return
    everybody = _by_subject(context.keystore)
    elsewhere = {subject: other for subject, other in _elsewhere(use, context).items() if subject not in everybody}
    strangers = [grant for grant in use.document.grants if grant.subject_name.text not in own]
    others = [g for g in strangers if own or g.subject_name.text in everybody or g.subject_name.text in elsewhere]
    if others:
        names = list(dict.fromkeys(grant.subject_name.text for grant in others))
        robots = {name: elsewhere[name] for name in names if name in elsewhere}
        named = [f"{quoted(name)}{_whose(robots[name]) if name in robots else ''}" for name in names]
        here = [use.at(grant.line) for grant in others]
        there = [Location(r.beside, r.line, message="the identity", beside=True) for r in robots.values()]
        gaining = _gaining(use, [everybody[name] for name in names if name in everybody], context)
        more = f", and {listed(gaining)} {'gains' if len(gaining) == 1 else 'gain'} by it" if gaining else ""
        yield Violation(
            f"The document also grants rights to {listed(named)}: whoever has the name can use them by "
            f"presenting this document{more}.",
            [*here, *there],
            severity=Severity.HIGH if gaining else None,
            key="\n".join([*sorted(names), "", *sorted(gaining)]),
            # A right that is taken out of their own grants is one more that this document gives.
            against=[place for own_places in gaining.values() for place in own_places],
        )


@lru_cache(maxsize=1)  # asked of each document
def _by_subject(keystore: Keystore) -> dict[str, str]:
    """The paths of the enclaves by the subjects of their certificates."""
    return {enclave.identity.subject: enclave.path for enclave in keystore.enclaves if enclave.identity is not None}


def _elsewhere(use: PermissionsUse, context: Context) -> dict[str, Identity]:
    """By subject, an enclave of another keystore of this run whose identity CA enclaves here trust."""
    trusted = {authority.key for enclave in use.enclaves for authority in enclave.trusts(Role.IDENTITY_CA)}
    found: dict[str, Identity] = {}
    for other in context.beside.shared.identities if context.beside is not None else ():
        if trusted & other.authorities:
            found.setdefault(other.subject, other)
    return found


def _whose(other: Identity) -> str:
    return f" ({other.enclave} in {quoted(other.root)})"


def _gaining(use: PermissionsUse, paths: Sequence[str], context: Context) -> dict[str, list[Location]]:
    """The enclaves to which this document gives a right under a chosen profile that their own does not, with the places
    of their own grants.
    """
    found: dict[str, list[Location]] = {}
    for system in context.meaning.systems if paths else ():
        permissions = Permissions(system)
        atoms = {enclave.label: enclave for enclave in system.enclaves}
        place = use.signed.file.place
        here = frozenset(n for n, document in enumerate(system.documents) if document.location.path == place)
        for path in paths:
            enclave = atoms.get(path)
            if enclave is None:
                continue
            had = permissions.chosen(enclave.identity, enclave.permissions)
            if _gains(permissions, permissions.chosen(enclave.identity, here), had):
                found.setdefault(path, []).extend(system.grants[grant].location for grant in had)
    return found


def _gains(permissions: Permissions, given: Iterable[int], had: Collection[int]) -> bool:
    """Whether the grants that are given allow anything that those which one had do not."""
    for operation in Operation:
        beyond = 0
        for grant in given:
            beyond |= permissions.allowed(grant, operation)
        for grant in had:
            beyond &= ~permissions.allowed(grant, operation)
        if beyond:
            return True
    return False


@rule(
    "KA514",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.3 (allow_rule); measured",
    in_permissions("Allow what the enclave needs, including ros_discovery_info"),
    applies=speaks,
    stops=True,
)
def grant_without_allow_rule(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The enclave's grant has no allow rule: Fast DDS refuses the participant.

    Cyclone DDS starts it if the default is ALLOW or join access control is off (measured). High if a chosen profile
    refuses the enclave.
    """
    severity = Severity.HIGH if context.refused(use.enclaves) else None
    for grant in own_grants(use):
        if not any(permission_rule.allow for permission_rule in grant.rules):
            message = (
                f"The grant of {quoted(grant.subject_name.text)} has no allow rule, expected one: "
                f"{doing('joins', JoinCheck.ANY_ALLOW_RULE)} refuses the participant, and others do where nothing else "
                "lets it join."
            )
            yield about(use, grant, grant.line, message, severity=severity)
