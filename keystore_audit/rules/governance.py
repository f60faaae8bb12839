"""KA4: the governance document (DDS-Security 1.1, 9.4.1.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.governance import DomainRule, ProtectionKind, TopicRule
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.domains import HIGHEST_DOMAIN, covered, describe
from keystore_audit.rules.context import Context
from keystore_audit.rules.places import acceptable, from_defect, of_kinds, sole
from keystore_audit.rules.registry import Rule, Violation, rule
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, governance_uses

SIGN_AGAIN = (
    "Correct governance.xml and sign it again with the permissions CA: openssl smime -sign -text -in "
    "governance.xml -out governance.p7s -signer permissions_ca.cert.pem -inkey permissions_ca.key.pem"
)

CYCLONE_HIGHEST_DOMAIN = 230
"""Cyclone DDS refuses the whole document above it (measured, 0.10.2 and 11.0.1)."""


def domain_rules(use: GovernanceUse) -> tuple[DomainRule, ...]:
    """The domain rules, none where the document has no single meaning."""
    return use.document.governance.domain_rules if use.document.governance else ()


def topic_rules(use: GovernanceUse) -> Iterator[tuple[DomainRule, TopicRule]]:
    """Every topic rule with its domain rule."""
    return ((domain, topic) for domain in domain_rules(use) for topic in domain.topic_rules)


def _at(use: GovernanceUse, rule_: DomainRule | TopicRule, element: str, message: str, **more: Any) -> Violation:
    """A violation at the line of an element of a rule."""
    line = rule_.lines.get(element, rule_.line)
    name = rule_.expression.text if isinstance(rule_, TopicRule) else describe(covered(rule_.domains))
    return Violation(
        message=message,
        locations=(Location(path=use.signed.file.place, line=line),),
        enclave=sole(use.enclaves),
        key=f"{element} {name}",
        **more,
    )


def _domains(rule_: DomainRule) -> str:
    return f"domain {describe(covered(rule_.domains))}"


def _topics(topic: TopicRule) -> str:
    return f"topics {topic.expression.text!r}"


@rule(
    "KA401",
    "governance-schema-invalid",
    Severity.HIGH,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.3 and its governance XSD",
    remedy=SIGN_AGAIN,
)
def governance_schema_invalid(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """The document breaks the governance schema of DDS-Security 1.0 and 1.1.

    Implementations differ in what they make of such a file: Fast DDS refuses unknown or missing elements, Cyclone DDS
    takes elements in any order. Its meaning is unknown unless nobody accepts its signature.
    """
    for defect in of_kinds(use.document.defects, {Kind.SCHEMA_INVALID}):
        yield from_defect(defect, use.enclaves, undecided=acceptable(use))


@rule(
    "KA402",
    "governance-ambiguous",
    Severity.HIGH,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2; XML 1.0",
    remedy=SIGN_AGAIN,
)
def governance_ambiguous(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """The document lies outside the plain XML that every parser reads alike, or holds a value without a meaning.

    Fast DDS (tinyxml2), Cyclone DDS (its own parser) and libxml2 read comments, CDATA, entities and blanks inside
    values differently (measured), so one signed file has several meanings.
    """
    kinds = {Kind.XML_AMBIGUOUS, Kind.XML_MALFORMED, Kind.VALUE_INVALID}
    for defect in of_kinds(use.document.defects, kinds):
        yield from_defect(defect, use.enclaves, undecided=acceptable(use))


@rule(
    "KA403",
    "unauthenticated-participants-allowed",
    Severity.HIGH,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants)",
    remedy="Set <allow_unauthenticated_participants> to false. " + SIGN_AGAIN,
    explains=("only-authenticated-participants-join",),
)
def unauthenticated_participants_allowed(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """A participant without any certificate is matched in the domain.

    With every protection kind NONE, plain peers then read and write topics under access control (measured on Cyclone
    DDS).
    """
    for domain in domain_rules(use):
        if domain.allow_unauthenticated_participants:
            yield _at(
                use,
                domain,
                "allow_unauthenticated_participants",
                f"{_domains(domain)}: allow_unauthenticated_participants is true (expected false): "
                "whoever reaches the network is matched without a certificate.",
            )


def _flag(
    code: str, name: str, element: str, on_domain: bool, explains: tuple[str, ...], what: str, why: str
) -> Rule[GovernanceUse]:
    """The rule that an access control flag is on."""

    def check(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
        found: Iterator[tuple[DomainRule | TopicRule, str]]
        if on_domain:
            found = ((domain, _domains(domain)) for domain in domain_rules(use))
        else:
            found = ((topic, f"{_domains(domain)}, {_topics(topic)}") for domain, topic in topic_rules(use))
        for rule_, where in found:
            if not getattr(rule_, element):
                yield _at(use, rule_, element, f"{where}: {element} is false (expected true): {what}.")

    check.__doc__ = why
    register: Callable[[Callable[[GovernanceUse, Context], Iterator[Violation]]], Rule[GovernanceUse]] = rule(
        code,
        name,
        Severity.HIGH,
        on=GovernanceUse,
        clause=f"DDS-Security 1.1, {'9.4.1.2.4' if on_domain else '9.4.1.2.6'} ({element})",
        remedy=f"Set <{element}> to true. " + SIGN_AGAIN,
        explains=explains,
    )
    return register(check)


_GRANTS = ("grants-are-enforced", "nobody-writes-without-a-grant", "nobody-reads-without-a-grant")

join_access_control_off = _flag(
    "KA404",
    "join-access-control-off",
    "enable_join_access_control",
    True,
    ("grants-are-enforced",),
    "every enclave that authenticates joins, whatever its permissions",
    "Peers do not ask for a grant before they let an authenticated participant join. Fast DDS demands one allow rule of"
    " its own participant in any case; remote ones are what counts here.",
)

read_access_control_off = _flag(
    "KA405",
    "read-access-control-off",
    "enable_read_access_control",
    False,
    _GRANTS,
    "whoever joins reads, and can write as well, because the keys it gets are symmetric",
    "Subscribe permissions are not consulted. Since readers get the keys that samples are authenticated with, write"
    " access control is defeated too, unless a kind authenticates the origin.",
)

write_access_control_off = _flag(
    "KA406",
    "write-access-control-off",
    "enable_write_access_control",
    False,
    ("grants-are-enforced", "nobody-writes-without-a-grant"),
    "whoever joins writes",
    "Publish permissions are not consulted.",
)


@rule(
    "KA407",
    "rtps-protection-none",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (rtps_protection_kind)",
    remedy="Set <rtps_protection_kind> to SIGN, as sros2 does. " + SIGN_AGAIN,
    explains=("outsiders-cannot-inject",),
)
def rtps_protection_none(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Whole messages are neither authenticated nor encrypted.

    Message headers and the submessages that carry no topic, time stamps among them, can then be forged from outside,
    whatever protects the topics.
    """
    for domain in domain_rules(use):
        if domain.rtps_protection_kind is ProtectionKind.NONE:
            yield _at(
                use,
                domain,
                "rtps_protection_kind",
                f"{_domains(domain)}: rtps_protection_kind is NONE (expected SIGN or more): headers, time stamps and "
                "control messages can be forged from outside.",
            )


@rule(
    "KA408",
    "rtps-protection-sign-only",
    Severity.INFO,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (rtps_protection_kind)",
    remedy="Set <rtps_protection_kind> to ENCRYPT where traffic analysis matters; it costs computing time. "
    + SIGN_AGAIN,
)
def rtps_protection_sign_only(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Message headers are authenticated but readable: who talks to whom and when can be seen. sros2 ships it so."""
    for domain in domain_rules(use):
        kind = domain.rtps_protection_kind
        if kind.authenticates and not kind.encrypts:
            yield _at(
                use,
                domain,
                "rtps_protection_kind",
                f"{_domains(domain)}: rtps_protection_kind is {kind.value}: message headers are readable on the"
                " network.",
            )


@rule(
    "KA409",
    "discovery-unprotected",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (discovery_protection_kind) and 9.4.1.2.6 (enable_discovery_protection)",
    remedy="Set <enable_discovery_protection> to true and <discovery_protection_kind> to ENCRYPT. " + SIGN_AGAIN,
    explains=("outsiders-cannot-learn-names",),
)
def discovery_unprotected(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Topic names and types can be read from discovery by whoever listens.

    SIGN hides nothing: only an encrypting kind does, or an encrypting rtps_protection_kind.
    """
    for domain, topic in topic_rules(use):
        if domain.rtps_protection_kind.encrypts:
            continue
        where = f"{_domains(domain)}, {_topics(topic)}"
        if not topic.enable_discovery_protection:
            yield _at(
                use,
                topic,
                "enable_discovery_protection",
                f"{where}: enable_discovery_protection is false (expected true): names are readable in discovery.",
            )
        elif not domain.discovery_protection_kind.encrypts:
            kind = domain.discovery_protection_kind.value
            yield _at(
                use,
                domain,
                "discovery_protection_kind",
                f"{where}: discovery_protection_kind is {kind} (expected ENCRYPT): names are readable in discovery.",
            )


@rule(
    "KA410",
    "liveliness-unprotected",
    Severity.LOW,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (liveliness_protection_kind) and 9.4.1.2.6 (enable_liveliness_protection)",
    remedy="Set <enable_liveliness_protection> to true and <liveliness_protection_kind> to SIGN or more. " + SIGN_AGAIN,
)
def liveliness_unprotected(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Liveliness can be asserted from outside for a writer that is gone, unless whole messages are authenticated."""
    for domain, topic in topic_rules(use):
        protected = topic.enable_liveliness_protection and domain.liveliness_protection_kind.authenticates
        if not protected and not domain.rtps_protection_kind.authenticates:
            element = "enable_liveliness_protection"
            yield _at(
                use,
                topic,
                element,
                f"{_domains(domain)}, {_topics(topic)}: liveliness is not protected: a dead writer can be kept alive"
                " from outside.",
            )


@rule(
    "KA411",
    "metadata-protection-none",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.6 (metadata_protection_kind)",
    remedy="Set <metadata_protection_kind> to SIGN or ENCRYPT. " + SIGN_AGAIN,
)
def metadata_protection_none(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Submessages are not protected for those outside the topic.

    Sequence numbers, heartbeats and acknowledgements can be forged by any participant, and from outside if
    rtps_protection_kind is NONE; samples can be replayed.
    """
    for domain, topic in topic_rules(use):
        if topic.metadata_protection_kind is ProtectionKind.NONE:
            whom = "any participant" if domain.rtps_protection_kind.authenticates else "anybody on the network"
            yield _at(
                use,
                topic,
                "metadata_protection_kind",
                f"{_domains(domain)}, {_topics(topic)}: metadata_protection_kind is NONE (expected SIGN or more):"
                f" {whom} can forge heartbeats and acknowledgements and replay samples.",
            )


@rule(
    "KA412",
    "payload-in-clear",
    Severity.HIGH,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.6 (metadata_ and data_protection_kind)",
    remedy="Set <data_protection_kind> or <metadata_protection_kind> to ENCRYPT. " + SIGN_AGAIN,
    explains=("outsiders-cannot-read", "nobody-reads-without-a-grant"),
)
def payload_in_clear(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """No protection kind encrypts the samples: whoever listens reads them."""
    for domain, topic in topic_rules(use):
        kinds = (domain.rtps_protection_kind, topic.metadata_protection_kind, topic.data_protection_kind)
        if not any(kind.encrypts for kind in kinds):
            said = ", ".join(
                f"{name} {kind.value}" for name, kind in zip(("rtps", "metadata", "data"), kinds, strict=True)
            )
            yield _at(
                use,
                topic,
                "data_protection_kind",
                f"{_domains(domain)}, {_topics(topic)}: nothing encrypts ({said}): whoever listens reads the samples.",
            )


@rule(
    "KA413",
    "payload-open-to-insiders",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.5.3.3; 9.4.1.2.4 (rtps_protection_kind)",
    remedy="Set <metadata_protection_kind> or <data_protection_kind> to ENCRYPT. " + SIGN_AGAIN,
    explains=("nobody-reads-without-a-grant", "nobody-writes-without-a-grant"),
)
def payload_open_to_insiders(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Only whole messages are encrypted, with keys that every participant of the domain holds.

    A participant without a grant then reads the topic off the network, and forges on it if metadata and data kind are
    both NONE.
    """
    for domain, topic in topic_rules(use):
        inside = topic.metadata_protection_kind.encrypts or topic.data_protection_kind.encrypts
        if domain.rtps_protection_kind.encrypts and not inside:
            yield _at(
                use,
                topic,
                "data_protection_kind",
                f"{_domains(domain)}, {_topics(topic)}: only rtps_protection_kind encrypts: every participant of the"
                " domain holds the key, granted or not.",
            )


@rule(
    "KA414",
    "samples-unauthenticated",
    Severity.CRITICAL,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.6",
    remedy="Set <metadata_protection_kind> or <data_protection_kind> to SIGN or ENCRYPT. " + SIGN_AGAIN,
    explains=("outsiders-cannot-inject", "nobody-writes-without-a-grant"),
)
def samples_unauthenticated(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """No protection kind authenticates the samples: access control is void against whoever reaches the network."""
    for domain, topic in topic_rules(use):
        kinds = (domain.rtps_protection_kind, topic.metadata_protection_kind, topic.data_protection_kind)
        if not any(kind.authenticates for kind in kinds):
            yield _at(
                use,
                topic,
                "metadata_protection_kind",
                f"{_domains(domain)}, {_topics(topic)}: rtps, metadata and data protection are all NONE: whoever"
                " reaches the network can write.",
            )


@rule(
    "KA415",
    "data-protection-none",
    Severity.LOW,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.6 (data_protection_kind)",
    remedy="Set <data_protection_kind> to ENCRYPT. " + SIGN_AGAIN,
)
def data_protection_none(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Submessages are encrypted but the payload inside is not: durable stores and relays see it in clear."""
    for domain, topic in topic_rules(use):
        if topic.metadata_protection_kind.encrypts and not topic.data_protection_kind.encrypts:
            yield _at(
                use,
                topic,
                "data_protection_kind",
                f"{_domains(domain)}, {_topics(topic)}: data_protection_kind is {topic.data_protection_kind.value}:"
                " relays and durable stores see the payload in clear.",
            )


@rule(
    "KA416",
    "governances-differ",
    Severity.HIGH,
    on=Keystore,
    clause="DDS-Security 1.1, 9.4.1.2 (all participants of a domain share one governance)",
    remedy="Give every enclave the same governance.p7s: a link to enclaves/governance.p7s, as sros2 makes it.",
)
def governances_differ(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Enclaves carry governance documents that say different things.

    Endpoints whose protection kinds differ never match, silently; and an attacker's endpoint declares what it likes.
    """
    contents: dict[object, list[GovernanceUse]] = {}
    for use in governance_uses(keystore):
        said: object = use.signed.content if use.signed.content is not None else use.signed.file.sha256
        contents.setdefault(said, []).append(use)
    if len(contents) > 1:
        uses = [group[0] for group in contents.values()]
        names = "; ".join(
            f"{use.signed.file.place}"
            f" ({', '.join(e.path for e in use.enclaves[:3])}{', …' if len(use.enclaves) > 3 else ''})"
            for use in uses
        )
        yield Violation(
            message=f"{len(contents)} different governance documents are in use: {names}.",
            locations=tuple(Location(path=use.signed.file.place) for use in uses),
            key="governance",
        )


@rule(
    "KA417",
    "unauthenticated-with-rtps-protection",
    Severity.HIGH,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants, rtps_protection_kind)",
    remedy="Set <allow_unauthenticated_participants> to false. " + SIGN_AGAIN,
)
def unauthenticated_with_rtps_protection(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """Unauthenticated participants are allowed, though whole messages are protected with keys that they cannot have.

    Fast DDS from 2.6.5 and 2.14 on refuses to start with it; Cyclone DDS starts (measured).
    """
    for domain in domain_rules(use):
        if domain.allow_unauthenticated_participants and domain.rtps_protection_kind.authenticates:
            yield _at(
                use,
                domain,
                "rtps_protection_kind",
                f"{_domains(domain)}: allow_unauthenticated_participants is true although rtps_protection_kind is "
                f"{domain.rtps_protection_kind.value}: Fast DDS refuses to start with it.",
            )


@rule(
    "KA418",
    "topics-without-rule",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.5 (topic_access_rules)",
    remedy="Add a last <topic_rule> with <topic_expression>*</topic_expression>. " + SIGN_AGAIN,
)
def topics_without_rule(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """Topics of a governed domain match no topic rule, so that they cannot be created.

    OpenDDS goes on to the permissions instead (read in its source).
    """
    for ungoverned in context.meaning.ungoverned:
        if ungoverned.location.path == use.signed.file.place:
            yield Violation(
                message=(
                    f"No topic rule of {ungoverned.domains} matches, for example, {ungoverned.witness!r}: such topics"
                    " cannot be created."
                ),
                locations=(ungoverned.location,),
                enclave=sole(use.enclaves),
                key=ungoverned.domains,
            )


@rule(
    "KA419",
    "domain-range-open",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="DDS-Security 1.1, 9.4.1.2.4 (domains)",
    remedy="Write both <min> and <max>. " + SIGN_AGAIN,
)
def domain_range_open(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """An <id_range> lacks <min> or <max>.

    Without <max>, Fast DDS and Cyclone DDS read the single id <min>, the specification and OpenDDS everything from it
    on; without <min>, Cyclone DDS refuses the file (measured).
    """
    for domain in domain_rules(use):
        for range_ in domain.domains:
            if range_.low is None or range_.high is None:
                missing = "min" if range_.low is None else "max"
                yield Violation(
                    message=f"An <id_range> has no <{missing}>: implementations read different domains in it.",
                    locations=(Location(path=use.signed.file.place, line=range_.line),),
                    enclave=sole(use.enclaves),
                    key=f"{range_.low} {range_.high}",
                )


@rule(
    "KA420",
    "domain-above-230",
    Severity.MEDIUM,
    on=GovernanceUse,
    clause="RTPS 2.5, 9.6.2.3; measured on Cyclone DDS 0.10.2",
    remedy="Use domain ids up to 230. " + SIGN_AGAIN,
)
def domain_above_230(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """A domain id above 230 makes Cyclone DDS refuse the whole document; above 232 there are no ports."""
    for domain in domain_rules(use):
        for range_ in domain.domains:
            highest = max(range_.low or 0, range_.high or 0)
            if highest > CYCLONE_HIGHEST_DOMAIN:
                yield Violation(
                    message=(
                        f"Domain {highest} is above {CYCLONE_HIGHEST_DOMAIN} (highest with ports: {HIGHEST_DOMAIN}):"
                        " Cyclone DDS refuses the whole document."
                    ),
                    locations=(Location(path=use.signed.file.place, line=range_.line),),
                    enclave=sole(use.enclaves),
                    key=str(highest),
                )


@rule(
    "KA421",
    "dds-security-1-0-document",
    Severity.INFO,
    on=DocumentUse,
    clause="DDS-Security 1.0 (20160303) against 1.1 (20170901)",
    remedy="Make the keystore anew with a supported distribution of ROS 2.",
)
def dds_security_1_0_document(use: DocumentUse, _context: Context) -> Iterator[Violation]:
    """The document has the form of DDS-Security 1.0, which Ardent and Bouncy wrote; newer implementations refuse it."""
    defects = getattr(getattr(use, "document", None), "defects", ())
    for defect in of_kinds(defects, {Kind.DDS_SECURITY_1_0}):
        yield from_defect(defect, use.enclaves, undecided=False)


GOVERNANCE: tuple[Rule[Any], ...] = (
    governance_schema_invalid,
    governance_ambiguous,
    unauthenticated_participants_allowed,
    join_access_control_off,
    read_access_control_off,
    write_access_control_off,
    rtps_protection_none,
    rtps_protection_sign_only,
    discovery_unprotected,
    liveliness_unprotected,
    metadata_protection_none,
    payload_in_clear,
    payload_open_to_insiders,
    samples_unauthenticated,
    data_protection_none,
    governances_differ,
    unauthenticated_with_rtps_protection,
    topics_without_rule,
    domain_range_open,
    domain_above_230,
    dds_security_1_0_document,
)
