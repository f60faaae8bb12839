"""KA4: the protection kinds of the governance (DDS-Security 1.1, 9.4.1.2.4, 9.4.1.2.6 and 9.5).

Rtps keys protect whole messages, and every participant of the domain holds them. Metadata keys protect a writer's
submessages, data keys its payload; those that may read it hold them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.keystore.typed import DomainRule, ProtectionKind, TopicRule
from keystore_audit.profiles import VARIANTS, facts
from keystore_audit.rules.governance import in_domains, in_topics
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_governance
from keystore_audit.rules.subjects import GovernanceUse, speaks


def _kinds(domain_rule: DomainRule, topic_rule: TopicRule) -> tuple[ProtectionKind, ProtectionKind, ProtectionKind]:
    return (
        domain_rule.rtps_protection_kind,
        topic_rule.metadata_protection_kind,
        topic_rule.data_protection_kind,
    )


def _nothing_authenticates(domain_rule: DomainRule, topic_rule: TopicRule) -> bool:
    return not any(kind.authenticates for kind in _kinds(domain_rule, topic_rule))


def _forger(domain_rule: DomainRule) -> str:
    """Who can write what only whole messages protect."""
    return "any participant" if domain_rule.rtps_protection_kind.authenticates else "anybody on the network"


def _said(domain_rule: DomainRule, topic_rule: TopicRule) -> str:
    rtps, metadata, data = _kinds(domain_rule, topic_rule)
    return f"rtps {rtps.value}, metadata {metadata.value}, data {data.value}"


@rule(
    "KA407",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.4 (rtps_protection_kind)",
    in_governance("Set <rtps_protection_kind> to SIGN, as sros2 does"),
    explains=("outsiders-cannot-inject", "outsiders-cannot-replay", "outsiders-cannot-forge-liveliness"),
    applies=speaks,
)
def rtps_protection_none(use: GovernanceUse) -> Iterator[Violation]:
    """Whole messages are neither authenticated nor encrypted.

    Outsiders can then forge headers, time stamps and the submessages that belong to no topic, whatever protects the
    topics.
    """
    for domain_rule, violation in in_domains(use):
        if domain_rule.rtps_protection_kind is ProtectionKind.NONE:
            yield violation(
                "rtps_protection_kind",
                "rtps_protection_kind is NONE, expected SIGN or more: message headers and time stamps can be forged "
                "from outside.",
            )


@rule(
    "KA408",
    Severity.INFO,
    "DDS-Security 1.1, 9.4.1.2.4 (rtps_protection_kind)",
    in_governance("Set <rtps_protection_kind> to ENCRYPT if it matters who talks to whom; this costs computing time"),
    applies=speaks,
)
def rtps_protection_sign_only(use: GovernanceUse) -> Iterator[Violation]:
    """Message headers are authenticated but readable: who talks to whom, when and how much. sros2 ships it so."""
    for domain_rule, violation in in_domains(use):
        kind = domain_rule.rtps_protection_kind
        if kind.authenticates and not kind.encrypts:
            yield violation(
                "rtps_protection_kind",
                f"rtps_protection_kind is {kind.value}: who talks to whom is readable on the network.",
            )


@rule(
    "KA409",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.4 (discovery_protection_kind) and 9.4.1.2.6 (enable_discovery_protection)",
    in_governance("Set <enable_discovery_protection> to true and <discovery_protection_kind> to ENCRYPT"),
    explains=("outsiders-cannot-learn-names",),
    applies=speaks,
)
def discovery_unprotected(use: GovernanceUse) -> Iterator[Violation]:
    """Topic names and types are readable in discovery.

    SIGN hides nothing: only an encrypting kind does, or an encrypting rtps_protection_kind. The handshake shows
    permissions in clear in any case.
    """
    for domain_rule, violation in in_domains(use):
        kind = domain_rule.discovery_protection_kind
        if not kind.encrypts and not domain_rule.rtps_protection_kind.encrypts:
            yield violation(
                "discovery_protection_kind",
                f"discovery_protection_kind is {kind.value}, expected ENCRYPT: topic names are readable.",
            )
    for domain_rule, topic_rule, violation in in_topics(use):
        if not topic_rule.enable_discovery_protection and not domain_rule.rtps_protection_kind.encrypts:
            yield violation(
                "enable_discovery_protection",
                "enable_discovery_protection is false, expected true: their names are readable.",
            )


@rule(
    "KA410",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.4 (liveliness_protection_kind) and 9.4.1.2.6 (enable_liveliness_protection)",
    in_governance("Set <enable_liveliness_protection> to true and <liveliness_protection_kind> to SIGN or more"),
    explains=("outsiders-cannot-forge-liveliness",),
    applies=speaks,
)
def liveliness_unprotected(use: GovernanceUse) -> Iterator[Violation]:
    """Liveliness messages can be forged: a writer that died is kept alive for its readers.

    Any participant of the domain can do so, and outsiders too if rtps_protection_kind is NONE. Documents of
    DDS-Security 1.0 have no such element for topics.
    """
    for domain_rule, violation in in_domains(use):
        whom = _forger(domain_rule)
        if not domain_rule.liveliness_protection_kind.authenticates:
            yield violation(
                "liveliness_protection_kind",
                f"liveliness_protection_kind is NONE, expected SIGN or more: {whom} can keep a dead writer alive.",
            )
    for domain_rule, topic_rule, violation in in_topics(use):
        element = "enable_liveliness_protection"
        if not topic_rule.enable_liveliness_protection and element in topic_rule.lines:
            whom = _forger(domain_rule)
            yield violation(
                element, f"enable_liveliness_protection is false, expected true: {whom} can keep a dead writer alive."
            )


@rule(
    "KA411",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.6 (metadata_protection_kind)",
    in_governance("Set <metadata_protection_kind> to SIGN or ENCRYPT"),
    explains=("nobody-writes-without-a-grant", "nobody-reads-without-a-grant", "outsiders-cannot-replay"),
    applies=speaks,
)
def metadata_protection_none(use: GovernanceUse) -> Iterator[Violation]:
    """Submessages are not protected from participants that may not read the topic.

    Any participant can forge sequence numbers, heartbeats and acknowledgements, and replay samples; outsiders too, if
    rtps_protection_kind is NONE. If no kind authenticates anything, see samples-unauthenticated.
    """
    for domain_rule, topic_rule, violation in in_topics(use):
        none = topic_rule.metadata_protection_kind is ProtectionKind.NONE
        if none and not _nothing_authenticates(domain_rule, topic_rule):
            yield violation(
                "metadata_protection_kind",
                f"metadata_protection_kind is NONE, expected SIGN or more: {_forger(domain_rule)} can forge heartbeats "
                "and acknowledgements and replay samples.",
            )


@rule(
    "KA412",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.6 (metadata_protection_kind, data_protection_kind)",
    in_governance("Set <data_protection_kind> or <metadata_protection_kind> to ENCRYPT"),
    explains=("outsiders-cannot-read", "nobody-reads-without-a-grant", "relays-cannot-read"),
    applies=speaks,
)
def payload_in_clear(use: GovernanceUse) -> Iterator[Violation]:
    """No protection kind encrypts the samples: whoever listens on the network reads them."""
    for domain_rule, topic_rule, violation in in_topics(use):
        if not any(kind.encrypts for kind in _kinds(domain_rule, topic_rule)):
            yield violation(
                "data_protection_kind",
                f"nothing encrypts ({_said(domain_rule, topic_rule)}), expected data or metadata ENCRYPT: whoever "
                "listens reads the samples.",
            )


@rule(
    "KA413",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.5.3.3 (keys of rtps protection) and 9.4.1.2.6",
    in_governance("Set <metadata_protection_kind> or <data_protection_kind> to ENCRYPT"),
    explains=("nobody-reads-without-a-grant", "nobody-writes-without-a-grant", "relays-cannot-read"),
    applies=speaks,
)
def payload_open_to_insiders(use: GovernanceUse) -> Iterator[Violation]:
    """Only whole messages are encrypted, with keys that every participant of the domain holds.

    An identity without a grant for the topic reads it off the network, and forges on it if metadata and data kind are
    NONE.
    """
    for domain_rule, topic_rule, violation in in_topics(use):
        rtps, metadata, data = _kinds(domain_rule, topic_rule)
        if rtps.encrypts and not metadata.encrypts and not data.encrypts:
            forge = " and forges" if not metadata.authenticates and not data.authenticates else ""
            yield violation(
                "data_protection_kind",
                f"only rtps_protection_kind encrypts ({_said(domain_rule, topic_rule)}), expected data or metadata "
                f"ENCRYPT: every participant reads{forge} them, granted or not.",
            )


@rule(
    "KA414",
    Severity.CRITICAL,
    "DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.2.6 (protection kinds)",
    in_governance(
        "Set <metadata_protection_kind> and <data_protection_kind> to ENCRYPT and <rtps_protection_kind> to SIGN"
    ),
    explains=("outsiders-cannot-inject", "outsiders-cannot-replay", "nobody-writes-without-a-grant"),
    applies=speaks,
)
def samples_unauthenticated(use: GovernanceUse) -> Iterator[Violation]:
    """No protection kind authenticates the samples: whoever reaches the network commands the robot.

    Access control checks endpoints, but nothing ties a sample to an endpoint.
    """
    for domain_rule, topic_rule, violation in in_topics(use):
        if _nothing_authenticates(domain_rule, topic_rule):
            yield violation(
                "metadata_protection_kind",
                "rtps, metadata and data protection are all NONE, expected SIGN or more in one of them: whoever "
                "reaches the network writes.",
            )


@rule(
    "KA415",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.6 (data_protection_kind)",
    in_governance("Set <data_protection_kind> to ENCRYPT"),
    applies=speaks,
)
def data_protection_none(use: GovernanceUse) -> Iterator[Violation]:
    """Submessages are encrypted, but not the payload in them: relays and stores of durable data see it in clear."""
    for _domain_rule, topic_rule, violation in in_topics(use):
        kind = topic_rule.data_protection_kind
        if topic_rule.metadata_protection_kind.encrypts and not kind.encrypts:
            yield violation(
                "data_protection_kind",
                f"data_protection_kind is {kind.value}, expected ENCRYPT: relays and stores see the payload in clear.",
            )


_REFUSE_CONTRADICTION: Final = tuple(
    name for name, profile in VARIANTS.items() if profile.access.refuses_unauthenticated_with_rtps
)


@rule(
    "KA417",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants, rtps_protection_kind)",
    in_governance("Set <allow_unauthenticated_participants> to false"),
    applies=speaks,
    stops=True,
)
def unauthenticated_with_rtps_protection(use: GovernanceUse) -> Iterator[Violation]:
    """Participants without a certificate are admitted, but keys that they cannot have protect every message.

    Fast DDS from 2.6.5 and 2.10.2 on refuses to start with it. Cyclone DDS starts, and the plain peer gets no data
    (measured).
    """
    for domain_rule, violation in in_domains(use):
        kind = domain_rule.rtps_protection_kind
        if domain_rule.allow_unauthenticated_participants and kind.authenticates:
            found = violation(
                "rtps_protection_kind",
                f"allow_unauthenticated_participants is true and rtps_protection_kind {kind.value}, which contradict "
                f"each other: {facts.RTPS_CONTRADICTION}.",
            )
            yield replace(found, profiles=_REFUSE_CONTRADICTION)
