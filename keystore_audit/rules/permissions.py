"""KA5: the permissions documents (DDS-Security 1.1, 9.4.1.3)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.governance import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.keystore.permissions import Rule as PermissionRule
from keystore_audit.model.domains import covered, describe
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.validity import parse_instant
from keystore_audit.rules.context import Context
from keystore_audit.rules.places import acceptable, from_defect, of_kinds, sole
from keystore_audit.rules.registry import Rule, Violation, rule
from keystore_audit.rules.subjects import PermissionsUse

SIGN_AGAIN = (
    "Correct the policy and write the permissions again: ros2 security create_permission KEYSTORE ENCLAVE policy.xml"
)

EVERY_TOPIC = ("*", "rt/*", "r*")
"""Expressions that cover every ROS 2 topic."""


def grants(use: PermissionsUse) -> tuple[Grant, ...]:
    """The grants, none where the document has no single meaning."""
    return use.document.permissions.grants if use.document.permissions else ()


def own_certificates(use: PermissionsUse) -> tuple[Certificate, ...]:
    """The identity certificates of the enclaves that carry the document."""
    firsts = (enclave.certificate.first for enclave in use.enclaves if enclave.certificate)
    return tuple(first for first in firsts if first is not None)


def own_grants(use: PermissionsUse) -> Iterator[Grant]:
    """Grants that name an enclave which carries the document."""
    subjects = {certificate.subject for certificate in own_certificates(use)}
    return (grant for grant in grants(use) if grant.subject_name.text in subjects)


def _violation(use: PermissionsUse, line: int | None, message: str, key: str, **more: Any) -> Violation:
    return Violation(
        message=message,
        locations=(Location(path=use.signed.file.place, line=line),),
        enclave=sole(use.enclaves),
        key=key,
        **more,
    )


def _expressions(grant: Grant) -> Iterator[tuple[PermissionRule, Operation, Text]]:
    """Every topic expression of a grant."""
    for rule_ in grant.rules:
        for criterion in rule_.criteria:
            for text in criterion.topics:
                yield rule_, criterion.operation, text


@rule(
    "KA501",
    "permissions-schema-invalid",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.1 and its permissions XSD",
    remedy=SIGN_AGAIN,
)
def permissions_schema_invalid(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The document breaks the permissions schema of DDS-Security 1.0 and 1.1.

    Implementations differ in what they make of such a file, and some crash. Its meaning is unknown unless nobody
    accepts its signature.
    """
    for defect in of_kinds(use.document.defects, {Kind.SCHEMA_INVALID}):
        yield from_defect(defect, use.enclaves, undecided=acceptable(use))


@rule(
    "KA502",
    "permissions-ambiguous",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3; XML 1.0",
    remedy=SIGN_AGAIN,
)
def permissions_ambiguous(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The document lies outside the plain XML that every parser reads alike, or holds a value without a meaning.

    Fast DDS (tinyxml2), Cyclone DDS (its own parser) and libxml2 read comments, CDATA, entities and blanks inside
    values differently (measured), so one signed file has several meanings.
    """
    kinds = {Kind.XML_AMBIGUOUS, Kind.XML_MALFORMED, Kind.VALUE_INVALID}
    for defect in of_kinds(use.document.defects, kinds):
        yield from_defect(defect, use.enclaves, undecided=acceptable(use))


@rule(
    "KA503",
    "no-grant-for-certificate",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.1 (subject_name)",
    remedy=SIGN_AGAIN,
)
def no_grant_for_certificate(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """No grant of the document names the certificate of the enclave that carries it, so the enclave cannot start.

    Compared is the text of the subject in RFC 4514 form, the one form that every implementation takes alike; some take
    others too.
    """
    if use.document.permissions is None:
        return
    named = {grant.subject_name.text for grant in grants(use)}
    for enclave in use.enclaves:
        first = enclave.certificate.first if enclave.certificate else None
        if first is not None and first.subject not in named:
            line = grants(use)[0].subject_name.line if grants(use) else use.document.permissions.line
            yield Violation(
                message=(
                    f"No grant names the certificate of {enclave.path}: got "
                    f"{', '.join(repr(n) for n in sorted(named)[:3]) or 'no grant'}, expected {first.subject!r}."
                ),
                locations=(
                    Location(path=use.signed.file.place, line=line),
                    Location(path=first.path, line=first.line, message="the certificate"),
                ),
                enclave=enclave.path,
                key=first.subject,
            )


@rule(
    "KA504",
    "second-grant-for-subject",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.1",
    remedy="Merge the grants into one. " + SIGN_AGAIN,
)
def second_grant_for_subject(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """Two grants name one subject: only the first counts (measured), or, on Fast DDS, the first in force.

    sros2 writes one grant for each <profiles> of an enclave, so that all but the first are lost.
    """
    seen: dict[str, Grant] = {}
    for grant in grants(use):
        first = seen.setdefault(grant.subject_name.text, grant)
        if first is not grant:
            yield Violation(
                message=(
                    f"A second grant names {grant.subject_name.text!r}: only the first, at line {first.line}, is used."
                ),
                locations=(
                    Location(path=use.signed.file.place, line=grant.line),
                    Location(path=use.signed.file.place, line=first.line, message="the grant that is used"),
                ),
                enclave=sole(use.enclaves),
                key=grant.subject_name.text,
            )


@rule(
    "KA505",
    "grant-expired",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.2 (validity)",
    remedy=SIGN_AGAIN,
)
def grant_expired(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant is past its not_after: its enclave cannot start. Dates without a zone are read as UTC."""
    for grant in grants(use):
        end = parse_instant(grant.not_after.text)
        if end is not None and end < context.at:
            message = (
                f"The grant for {grant.subject_name.text!r} expired at {grant.not_after.text} (audit:"
                f" {context.at:%Y-%m-%dT%H:%M:%SZ})."
            )
            yield _violation(use, grant.not_after.line, message, grant.subject_name.text)


@rule(
    "KA506",
    "grant-not-yet-valid",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.2 (validity)",
    remedy="Set the robot's clock, or write permissions that are valid now. " + SIGN_AGAIN,
)
def grant_not_yet_valid(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant is before its not_before: its enclave cannot start. Dates without a zone are read as UTC."""
    for grant in grants(use):
        start = parse_instant(grant.not_before.text)
        if start is not None and start > context.at:
            message = (
                f"The grant for {grant.subject_name.text!r} is valid from {grant.not_before.text} only (audit:"
                f" {context.at:%Y-%m-%dT%H:%M:%SZ})."
            )
            yield _violation(use, grant.not_before.line, message, grant.subject_name.text)


@rule(
    "KA507",
    "grant-expires-soon",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.2 (validity)",
    remedy=SIGN_AGAIN,
)
def grant_expires_soon(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant ends within the notice period (--expires-within)."""
    for grant in grants(use):
        end = parse_instant(grant.not_after.text)
        if end is not None and context.at <= end <= context.at + context.expires_within:
            days = (end - context.at).days
            message = f"The grant for {grant.subject_name.text!r} expires at {grant.not_after.text}, in {days} days."
            yield _violation(use, grant.not_after.line, message, grant.subject_name.text)


@rule(
    "KA508",
    "grant-outside-governance-domains",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3.2.3.1.1 (domains)",
    remedy="Let the rules name a domain that the governance covers. " + SIGN_AGAIN,
)
def grant_outside_governance_domains(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """No allow rule of the enclave's grant names a domain that its governance covers: it can start nowhere."""
    for enclave in use.enclaves:
        governance = enclave.governance.governance if enclave.governance else None
        subject = _subject(enclave)
        if governance is None or subject is None:
            continue
        governed = [interval for domain in governance.domain_rules for interval in covered(domain.domains)]
        for grant in grants(use):
            allowed = [i for r in grant.rules if r.allow for i in covered(r.domains)]
            meet = any(low <= upper and lower <= high for low, high in governed for lower, upper in allowed)
            if grant.subject_name.text == subject and allowed and not grant.default_allow and not meet:
                message = (
                    f"The grant allows domains {describe(sorted(set(allowed)))}; the governance covers "
                    f"{describe(sorted(set(governed)))}: the enclave can start in none."
                )
                yield _violation(use, grant.line, message, grant.subject_name.text)


def _subject(enclave: Enclave) -> str | None:
    first = enclave.certificate.first if enclave.certificate else None
    return first.subject if first else None


@rule(
    "KA509",
    "default-allow",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.4 (default)",
    remedy="Write <default>DENY</default> and allow what is needed. " + SIGN_AGAIN,
)
def default_allow(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """What no rule names is allowed.

    Fast DDS reads the element and never uses it: there, what no rule names is denied (measured). Cyclone DDS and
    OpenDDS honour it.
    """
    for grant in grants(use):
        if grant.default_allow:
            message = (
                f"<default> is ALLOW (expected DENY): {grant.subject_name.text!r} may do whatever no rule denies, in"
                " every domain."
            )
            yield _violation(use, grant.default_line, message, grant.subject_name.text)


def _allows_everything(grant: Grant) -> bool:
    """Whether the grant allows every ROS topic and service both ways, as sros2's default permissions do."""
    wanted = ("rt/*", "rq/*Request", "rr/*Reply")
    for operation in (Operation.PUBLISH, Operation.SUBSCRIBE):
        allowed = {text.text for r, op, text in _expressions(grant) if r.allow and op is operation}
        if not all(expression in allowed or "*" in allowed or "r*" in allowed for expression in wanted):
            return False
    return True


@rule(
    "KA510",
    "wildcard-grant",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.3.1.2 (topics)",
    remedy="Name each topic. " + SIGN_AGAIN,
)
def wildcard_grant(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """An allow rule covers names by pattern, those among them that nobody has thought of yet.

    `*` crosses `/`, so `rt/*` covers every topic. Grants that allow everything are allow-everything-permissions, once.
    """
    for grant in grants(use):
        if _allows_everything(grant):
            continue
        for rule_, operation, text in _expressions(grant):
            if rule_.allow and text.text and parse(text.text, Matcher.POSIX).literal is None:
                every = text.text in EVERY_TOPIC
                reach = "every topic" if every else "an open set of names"
                message = f"{operation.value} is allowed on {text.text!r}: {reach}."
                severity = Severity.HIGH if every else None
                yield _violation(use, text.line, message, f"{operation.value} {text.text}", severity=severity)


@rule(
    "KA511",
    "allow-everything-permissions",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3; ROS 2 design, SROS2 access control policies",
    remedy=SIGN_AGAIN,
)
def allow_everything_permissions(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant allows publishing and subscribing to everything: what `ros2 security create_enclave` writes by default.

    Running create_enclave again on a hardened enclave puts it back, silently.
    """
    for grant in grants(use):
        if _allows_everything(grant):
            message = (
                f"{grant.subject_name.text!r} may publish and subscribe to everything: the default of create_enclave."
            )
            yield _violation(use, grant.line, message, grant.subject_name.text)


@rule(
    "KA512",
    "grants-for-other-subjects",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3; measured on Cyclone DDS 0.10.2, 11.0.1 and Fast DDS 2.9.1",
    remedy="Give each enclave a document with its own grant only. " + SIGN_AGAIN,
)
def grants_for_other_subjects(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The document holds a grant for somebody else.

    Whoever is named may present this document in place of its own: peers take any validly signed one. It also tells
    whoever listens to the handshake what the other may do.
    """
    own = {certificate.subject for certificate in own_certificates(use)}
    if not own or not any(grant.subject_name.text in own for grant in grants(use)):
        return
    for grant in grants(use):
        if grant.subject_name.text not in own:
            message = (
                f"A grant names {grant.subject_name.text!r}, not this enclave: whoever has that name can use it by"
                " presenting this document."
            )
            yield _violation(use, grant.line, message, grant.subject_name.text)


@rule(
    "KA513",
    "grant-outlives-certificate",
    Severity.LOW,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.2 (validity)",
    remedy="Let the grant end with the certificate. " + SIGN_AGAIN,
)
def grant_outlives_certificate(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant ends later than the certificate that it names.

    A renewed certificate inherits rights nobody has looked at.
    """
    ends = {certificate.subject: certificate for certificate in own_certificates(use)}
    for grant in own_grants(use):
        end, certificate = parse_instant(grant.not_after.text), ends[grant.subject_name.text]
        if end is not None and end > certificate.not_after:
            message = (
                f"The grant ends at {grant.not_after.text}, its certificate at"
                f" {certificate.not_after:%Y-%m-%dT%H:%M:%SZ}."
            )
            yield _violation(use, grant.not_after.line, message, grant.subject_name.text)


@rule(
    "KA514",
    "grant-without-allow-rule",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.3",
    remedy=SIGN_AGAIN,
)
def grant_without_allow_rule(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant has no allow rule.

    Fast DDS refuses the participant, Cyclone DDS starts it if the default is ALLOW (measured).
    """
    for grant in grants(use):
        if not any(rule_.allow for rule_ in grant.rules):
            message = f"The grant for {grant.subject_name.text!r} has no allow rule: Fast DDS refuses the participant."
            yield _violation(use, grant.line, message, grant.subject_name.text)


@rule(
    "KA515",
    "rule-domain-range-open",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.3.1.1 (domains)",
    remedy="Write both <min> and <max>. " + SIGN_AGAIN,
)
def rule_domain_range_open(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """An <id_range> of a rule lacks <min> or <max>: implementations read different domains in it (measured)."""
    for grant in grants(use):
        for rule_ in grant.rules:
            for range_ in rule_.domains:
                if range_.low is None or range_.high is None:
                    missing = "min" if range_.low is None else "max"
                    message = f"An <id_range> has no <{missing}>: implementations read different domains in it."
                    yield _violation(use, range_.line, message, f"{range_.low} {range_.high}")


@rule(
    "KA516",
    "validity-inverted",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3.2.2 (validity)",
    remedy="Let not_before come before not_after. " + SIGN_AGAIN,
)
def validity_inverted(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant ends before it begins: it is never valid."""
    for grant in grants(use):
        start, end = parse_instant(grant.not_before.text), parse_instant(grant.not_after.text)
        if start is not None and end is not None and start > end:
            message = (
                f"The grant for {grant.subject_name.text!r} begins at {grant.not_before.text} and ends at"
                f" {grant.not_after.text}."
            )
            yield _violation(use, grant.not_before.line, message, grant.subject_name.text)


def _crash(code: str, name: str, kind: Kind, why: str) -> Rule[PermissionsUse]:
    """The rule that a signed document does not hold a form which crashes an implementation."""

    def check(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
        for defect in of_kinds(use.document.defects, {kind}):
            yield from_defect(defect, use.enclaves, undecided=acceptable(use))

    check.__doc__ = why
    return rule(
        code,
        name,
        Severity.CRITICAL,
        on=PermissionsUse,
        clause="DDS-Security 1.1, 9.4.1.3.2.3; measured on Cyclone DDS 0.10.2 and 11.0.1, Fast DDS 2.9.1",
        remedy=SIGN_AGAIN,
    )(check)


empty_topic_expression = _crash(
    "KA517",
    "empty-topic-expression",
    Kind.EMPTY_TOPIC,
    "A signed <topic> is empty: it ends the process of Cyclone DDS that reads it, its own or a peer's, so one signed"
    " file is a denial of service. The schema allows it.",
)

rule_without_domains = _crash(
    "KA518",
    "rule-without-domains",
    Kind.RULE_WITHOUT_DOMAINS,
    "A signed rule has no <domains>: it ends the process of Cyclone DDS that reads it, its own or a peer's, so one"
    " signed file is a denial of service.",
)

PERMISSIONS: tuple[Rule[Any], ...] = (
    permissions_schema_invalid,
    permissions_ambiguous,
    no_grant_for_certificate,
    second_grant_for_subject,
    grant_expired,
    grant_not_yet_valid,
    grant_expires_soon,
    grant_outside_governance_domains,
    default_allow,
    wildcard_grant,
    allow_everything_permissions,
    grants_for_other_subjects,
    grant_outlives_certificate,
    grant_without_allow_rule,
    rule_domain_range_open,
    validity_inverted,
    empty_topic_expression,
    rule_without_domains,
)
