"""KA4: the governance document, its form and its access control (DDS-Security 1.1, 9.4.1.2).

Protection kinds are in `protection.py`, domains in `restrictions.py`. Rules about what a document says apply where
somebody may take it: what a document says that every implementation refuses is of no consequence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from functools import lru_cache, partial
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Act, Location, Remedy, Severity, decision
from keystore_audit.grouped import grouped
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import DomainRule, GovernanceFile, TopicRule
from keystore_audit.model.access_view import typed_by
from keystore_audit.model.domains import covered, describe, domain_bits
from keystore_audit.model.inventory import Typed
from keystore_audit.model.names import DISCOVERY_TOPIC
from keystore_audit.profiles import VARIANTS, Profile, doing_so, facts
from keystore_audit.rules.meaning import told
from keystore_audit.rules.registry import Context, Violation, defective, of_kinds, paths, quoted, rule
from keystore_audit.rules.remedies import in_governance, in_permissions
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, signed_bytes, speaks

_Says = Callable[[str, str], Violation]
"""What is said at an element of a rule, after where that is."""

AMBIGUOUS: Final = (Kind.XML_AMBIGUOUS, Kind.XML_VARIES, Kind.XML_MALFORMED, Kind.VALUE_INVALID)
DIFFER: Final = "implementations read it differently."
UNREAD: Final = "what a robot reads in it is unknown."


def out_of_form(use: DocumentUse, context: Context, *kinds: Kind) -> Iterator[Violation]:
    """A violation for the defects of each of these kinds in the form of a document, and what implementations do of it.

    Undecided where that is unknown of a chosen one; medium where all chosen ones read it.
    """
    found = [of_kinds(use.document.defects, kind) for kind in kinds if use.document.defects]
    if not any(found):
        return
    does = {name: _does_with(use.document, profile) for name, profile in VARIANTS.items()}
    chosen = [profile for profile in context.profiles if does[profile.name]]
    unknown = len(chosen) < len(context.profiles)
    refusing = [profile.name for profile in chosen if does[profile.name] == _REFUSES]
    alike = grouped(chosen, lambda profile: does[profile.name])
    says = [doing_so(who, f"{{who}} {verb} the document", _like(does, verb)) for verb, who in alike.items()]
    for defects in found:
        yield from defective(
            defects,
            DIFFER if unknown else f"{', '.join(says)}.",
            undecided=use.may_be_taken and unknown,
            severity=None if unknown or refusing else Severity.MEDIUM,
            profiles=() if unknown else tuple(refusing),
        )


_REFUSES: Final = "[refuses|refuse]"


def _like(does: Mapping[str, str], verb: str) -> Callable[[Profile], bool]:
    return lambda profile: does[profile.name] == verb


def _does_with(file: Typed, profile: Profile) -> str:
    """A verb; empty where it is unknown."""
    typed = typed_by(file, profile.access)
    if isinstance(typed, str):
        return _REFUSES
    return "" if isinstance(typed, Defect | None) else "[reads|read]"


def in_document(use: DocumentUse, says: str, *kinds: Kind, remedy: Remedy | None = None) -> Iterator[Violation]:
    """A violation for the defects of each of these kinds in the XML; undecided as long as somebody may take it."""
    for kind in kinds if use.document.defects else ():
        found = of_kinds(use.document.defects, kind)
        yield from defective(found, says, undecided=use.may_be_taken, remedy=remedy)


@lru_cache(maxsize=256)  # a dozen rules ask, about the few documents of one audit
def domain_rules(file: GovernanceFile) -> tuple[DomainRule, ...]:
    """The domain rules that decide for some domain: the first that covers a domain is the one for it."""
    deciding: list[DomainRule] = []
    taken = 0  # domains of the rules so far, as bits: a hostile document has thousands of rules
    for domain_rule in file.domain_rules:
        cover = domain_bits(covered(domain_rule.domains))
        if cover & ~taken or not cover:
            deciding.append(domain_rule)
        taken |= cover
    return tuple(deciding)


def in_domains(use: GovernanceUse) -> Iterator[tuple[DomainRule, _Says]]:
    """Those rules, each with what makes a violation at an element of it from a message."""
    for domain_rule in domain_rules(use.document):
        yield domain_rule, partial(_violation, use, domain_rule, None)


def in_topics(use: GovernanceUse) -> Iterator[tuple[DomainRule, TopicRule, _Says]]:
    """The topic rules of those: none after a rule for `*`, since the first that matches a topic is the one for it.

    So it is everywhere but in OpenDDS, which lets any matching rule without access control allow (read in its source).
    """
    for domain_rule in domain_rules(use.document):
        for topic_rule in domain_rule.topic_rules:
            yield domain_rule, topic_rule, partial(_violation, use, domain_rule, topic_rule)
            if topic_rule.expression.text and not topic_rule.expression.text.strip("*"):
                break


def _violation(
    use: GovernanceUse, domain_rule: DomainRule, topic_rule: TopicRule | None, element: str, message: str
) -> Violation:
    """A violation at `element` of the topic rule, or else of the domain rule; `message` goes on after where it is."""
    where, told = f"Domain {describe(covered(domain_rule.domains))}", topic_rule or domain_rule
    expression = topic_rule.expression.text if topic_rule is not None else ""
    return Violation(
        f"{where}{f', topics {quoted(expression)}' if topic_rule is not None else ''}: {message}",
        (use.at(told.lines.get(element, told.line)),),
        key=f"{element} {covered(domain_rule.domains)} {expression}",
    )


@rule(
    "KA401",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2 and its governance XSD",
    in_governance("Correct what the schema forbids"),
    stops=True,
)
def governance_schema_invalid(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """The document breaks the governance schema of DDS-Security.

    Fast DDS refuses unknown, missing and reordered elements. Cyclone DDS accepts any order, and reads an empty boolean
    as false (measured). Verdicts follow what each one reads; medium if all read it. If one in scope was not measured,
    the meaning is unknown, unless nobody accepts the signature.
    """
    yield from out_of_form(use, context, Kind.SCHEMA_INVALID)


@rule(
    "KA402",
    Severity.HIGH,
    f"DDS-Security 1.1, 9.4.1.2; XML 1.0; {facts.XML_PARSERS}",
    in_governance("Write plain XML, without comments, CDATA, entities and blanks in values"),
    stops=True,
)
def governance_ambiguous(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """The document is outside the plain XML that every parser reads alike, or holds a value without a meaning.

    Fast DDS, Cyclone DDS and libxml2 read comments and blanks in values differently (measured). Verdicts follow what
    each one reads; medium if all read it. How a robot reads CDATA, entities and other encodings, or a document above
    our limits (docs/security-model.md), is unknown.
    """
    yield from out_of_form(use, context, *AMBIGUOUS)
    remedy = in_governance("Write fewer rules, and fewer expressions with wildcards")
    yield from in_document(use, UNREAD, Kind.BEYOND_LIMIT, remedy=remedy)


@rule(
    "KA403",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants)",
    in_governance("Set <allow_unauthenticated_participants> to false"),
    explains=(
        "only-authenticated-participants-join",
        "outsiders-cannot-replay",
        "outsiders-cannot-forge-liveliness",
    ),
    applies=speaks,
)
def unauthenticated_participants_allowed(use: GovernanceUse) -> Iterator[Violation]:
    """A participant without any certificate is matched in the domain.

    On Cyclone DDS such a peer reads and writes even topics under access control, if every protection kind is NONE
    (measured). What else it reaches differs.
    """
    for domain_rule, violation in in_domains(use):
        if domain_rule.allow_unauthenticated_participants:
            yield violation(
                "allow_unauthenticated_participants",
                "allow_unauthenticated_participants is true, expected false: whoever reaches the network joins "
                "without a certificate.",
            )


@rule(
    "KA404",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.4 (enable_join_access_control)",
    in_governance("Set <enable_join_access_control> to true"),
    explains=("grants-are-enforced",),
    applies=speaks,
)
def join_access_control_off(use: GovernanceUse) -> Iterator[Violation]:
    """Peers let every authenticated participant join, whatever its permissions.

    Fast DDS still checks its own participant (measured); what counts are its peers.
    """
    for domain_rule, violation in in_domains(use):
        if not domain_rule.enable_join_access_control:
            yield violation(
                "enable_join_access_control",
                "enable_join_access_control is false, expected true: every identity joins, granted or not.",
            )


@rule(
    "KA405",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.6 (enable_read_access_control)",
    in_governance("Set <enable_read_access_control> to true"),
    explains=("grants-are-enforced", "nobody-reads-without-a-grant", "nobody-writes-without-a-grant"),
    applies=speaks,
)
def read_access_control_off(use: GovernanceUse) -> Iterator[Violation]:
    """Every participant that joined can read the topics: nobody checks subscribe permissions.

    Readers' keys are symmetric and also make samples, so write access control is void too, unless a kind authenticates
    the origin.
    """
    for _domain_rule, topic_rule, violation in in_topics(use):
        if not topic_rule.enable_read_access_control:
            yield violation(
                "enable_read_access_control",
                "enable_read_access_control is false, expected true: every participant reads them, and can write "
                "them with a reader's keys.",
            )


@rule(
    "KA406",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.6 (enable_write_access_control)",
    in_governance("Set <enable_write_access_control> to true"),
    explains=("grants-are-enforced", "nobody-writes-without-a-grant"),
    applies=speaks,
)
def write_access_control_off(use: GovernanceUse) -> Iterator[Violation]:
    """Every participant that joined can write the topics: nobody checks publish permissions."""
    for _domain_rule, topic_rule, violation in in_topics(use):
        if not topic_rule.enable_write_access_control:
            yield violation(
                "enable_write_access_control",
                "enable_write_access_control is false, expected true: every participant writes them.",
            )


@rule(
    "KA416",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2 (participants of a domain share its governance); measured",
    decision("Decide which governance is right, and give it to every enclave, as a link to enclaves/governance.p7s."),
)
def governances_differ(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Enclaves carry governance documents that say different things.

    Endpoints with different protection kinds or access control flags never match, and nobody is told (measured). An
    attacker's endpoint declares what it likes, so the difference protects nothing. Documents are compared by meaning;
    unreadable ones by bytes.
    """
    said: dict[object, list[tuple[Enclave, GovernanceFile]]] = {}
    for enclave in keystore.enclaves:
        if enclave.governance is not None:
            said.setdefault(_meaning(enclave.governance, context.at), []).append((enclave, enclave.governance))
    if len(said) > 1:
        groups = sorted(said.values(), key=len, reverse=True)
        words = "; ".join(
            f"{group[0][1].signed.file.place} for {paths(enclave for enclave, _ in group)}" for group in groups[:3]
        )
        yield Violation(
            f"Enclaves carry {len(groups)} governance documents that say different things: {words}.",
            # The minority first: it is what has to change.
            [Location(file.signed.file.place) for group in reversed(groups) for _, file in group],
        )


@lru_cache(maxsize=256)
def _meaning(file: GovernanceFile, at: datetime) -> object:
    """What the document says, without lines and layout; its bytes where it has no single meaning."""
    if file.governance is None:
        return signed_bytes(file.signed)
    return tuple((covered(each.domains), told(replace(each, domains=()), at)) for each in file.domain_rules)


@rule(
    "KA418",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.5 (topic_access_rules)",
    in_governance("Add a last <topic_rule> with <topic_expression>*</topic_expression>"),
    applies=speaks,
)
def topics_without_rule(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """Some topics of a governed domain match no topic rule, so nobody can create them.

    Fast DDS and Cyclone DDS refuse them. OpenDDS finds no protection for their endpoints (read in its source). Without
    ros_discovery_info, DDS creates a participant, ROS 2 gives it up, and nothing runs. Each different reading has its
    own finding.
    """
    for topics in context.meaning.ungoverned:
        if topics.location.path == use.signed.file.place:
            nodes = ", and without this one ROS 2 makes no node (Foxy and later)"
            more = nodes if topics.witness == DISCOVERY_TOPIC else ""
            yield Violation(
                f"{topics.domains[:1].upper()}{topics.domains[1:]}: no topic rule matches, for example, "
                f"{quoted(topics.witness)}: such topics cannot be created{more}.",
                (topics.location,),
                profiles=topics.profiles,
                key=topics.domains,
            )


_ADD_LIVELINESS: Final = in_governance(
    "Write <enable_liveliness_protection> after <enable_discovery_protection> in every topic rule"
)
_IN_ORDER: Final = in_permissions("Write publish first, then subscribe, then relay in every rule")


@rule(
    "KA421",
    Severity.HIGH,
    "DDS-Security 1.0 (20160303) against 1.1 (20170901)",
    decision("Write the document in the form of DDS-Security 1.1, as the finding says.", Act.EDIT),
    stops=True,
)
def dds_security_1_0_document(use: DocumentUse) -> Iterator[Violation]:
    """The document has the form of DDS-Security 1.0, which Ardent and Bouncy wrote.

    A governance of that form lacks what 1.1 demands, so today's implementations refuse it. Permissions have publish,
    subscribe and relay in another order, which people may also write today. They are medium: Fast DDS 2.9.1 and Cyclone
    DDS 0.10.2 read them as meant (measured). This audit reads both in their own terms.
    """
    found = of_kinds(use.document.defects, Kind.DDS_SECURITY_1_0)
    if isinstance(use.document, GovernanceFile):
        yield from defective(found, remedy=_ADD_LIVELINESS)
    else:
        yield from defective(found, remedy=_IN_ORDER, severity=Severity.MEDIUM)
