"""What the governance of a realm protects, and against whom (DDS-Security 1.1, 9.4.1.2).

All sets are bit sets over channels, except `unauthenticated`, `ruled` and `join_controlled`: over domains.
"""

from __future__ import annotations

from msgspec import Struct

from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import DomainRuleAtom, System, TopicRuleAtom


class Protection(Struct):
    """The flags and kinds that apply, by first match. A channel that is not `governed` is in no set."""

    ruled: int = 0
    unauthenticated: int = 0
    join_controlled: int = 0
    governed: int = 0
    read_controlled: int = 0
    write_controlled: int = 0
    discovery_hidden: int = 0
    liveliness_authenticates: int = 0
    rtps_encrypts: int = 0
    rtps_authenticates: int = 0
    metadata_encrypts: int = 0
    metadata_authenticates: int = 0
    metadata_authenticates_origin: int = 0
    data_encrypts: int = 0
    data_authenticates: int = 0


def protection(system: System, document: int | None, permissions: Permissions) -> Protection:
    """What the governance `document` says, None: nothing is governed."""
    result = Protection()
    if document is None:
        return result
    decides: dict[int, int] = {}
    left = set(range(len(system.domains)))
    for number, rule in enumerate(system.domain_rules):
        if rule.document == document and left:
            decided = rule.domains & left
            decides.update(dict.fromkeys(decided, number))
            left -= decided
    topics: dict[int, list[tuple[TopicRuleAtom, int]]] = {number: [] for number in decides.values()}
    for topic in system.topic_rules:
        if topic.domain_rule in topics:
            topics[topic.domain_rule].append((topic, bits(topic.channels)))
    for domain, number in decides.items():
        _apply_domain(result, domain, system.domain_rules[number], topics[number], permissions.channels_in[domain])
    return result


def open_protection(permissions: Permissions) -> Protection:
    """What an open realm protects: nothing, though everything is governed and everybody may come."""
    return Protection(
        ruled=permissions.all_domains,
        unauthenticated=permissions.all_domains,
        governed=permissions.all_channels,
    )


def _apply_domain(
    result: Protection, domain: int, rule: DomainRuleAtom, topics: list[tuple[TopicRuleAtom, int]], undecided: int
) -> None:
    """Adds what `rule` and its topic rules, each with its channels, say of the channels `undecided` of the domain."""
    result.ruled |= 1 << domain
    if rule.allow_unauthenticated_participants:
        result.unauthenticated |= 1 << domain
    if rule.enable_join_access_control:
        result.join_controlled |= 1 << domain
    for topic, channels in topics:
        hit = channels & undecided
        undecided &= ~hit
        _apply_topic(result, hit, rule, topic)


def _apply_topic(result: Protection, hit: int, rule: DomainRuleAtom, topic: TopicRuleAtom) -> None:
    """Adds what the topic rule and its domain rule say of the channels `hit`."""
    result.governed |= hit
    result.read_controlled |= _if(topic.enable_read_access_control, hit)
    result.write_controlled |= _if(topic.enable_write_access_control, hit)
    hidden = topic.enable_discovery_protection and rule.discovery_protection_kind.encrypts
    alive = topic.enable_liveliness_protection and rule.liveliness_protection_kind.authenticates
    result.discovery_hidden |= _if(hidden, hit)
    result.liveliness_authenticates |= _if(alive, hit)
    rtps, metadata, data = rule.rtps_protection_kind, topic.metadata_protection_kind, topic.data_protection_kind
    result.rtps_encrypts |= _if(rtps.encrypts, hit)
    result.rtps_authenticates |= _if(rtps.authenticates, hit)
    result.metadata_encrypts |= _if(metadata.encrypts, hit)
    result.metadata_authenticates |= _if(metadata.authenticates, hit)
    result.metadata_authenticates_origin |= _if(metadata.authenticates_origin, hit)
    result.data_encrypts |= _if(data.encrypts, hit)
    result.data_authenticates |= _if(data is not ProtectionKind.NONE, hit)


def _if(condition: bool, hit: int) -> int:
    return hit if condition else 0
