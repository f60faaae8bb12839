"""What the rules of each grant say of each channel: in which order they allow and deny it.

A decision of a grant about a channel depends on the order of the qualifiers of those rules that match it and on the
default, and on nothing else. Runs of one qualifier count once. Which rule decides is not said here.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from typing import Final

from keystore_audit.model.formal.system import RuleAtom, System

MAX_MENTIONS: Final = 2_000_000
"""Pairs of a rule and a channel that are looked at: two seconds at worst."""

Order = tuple[bool, ...]
"""Qualifiers of rules that match, in order: True for allow."""

Said = tuple[Mapping[int, Order], Mapping[int, Order], Mapping[int, Order]]
"""What grants (by index) say of one channel: of publishing, of subscribing, of relaying."""


def mentions(system: System) -> list[Said] | None:
    """Return what grants say of each channel, by channel; None where that is too much to look at."""
    granted = sum(len(rule.publish) + len(rule.subscribe) + len(rule.relay) for rule in system.rules)
    if granted + sum(len(rule.channels) for rule in system.topic_rules) > MAX_MENTIONS:
        return None
    said: list[tuple[dict[int, Order], ...]] = [({}, {}, {}) for _ in system.channels]
    for rule in system.rules:
        for operation, channel in _matches(rule, system):
            by_grant = said[channel][operation]
            before = by_grant.get(rule.grant, ())
            if before[-1:] != (rule.allow,):
                by_grant[rule.grant] = (*before, rule.allow)
    return [(publish, subscribe, relay) for publish, subscribe, relay in said]


def _matches(rule: RuleAtom, system: System) -> Iterator[tuple[int, int]]:
    """Operation (its place in a `Said`) and channel, for each channel that a criterion of the rule matches."""
    for operation, channels in enumerate((rule.publish, rule.subscribe, rule.relay)):
        for channel in channels:
            if system.channels[channel].domain in rule.domains:
                yield operation, channel


def surroundings(system: System) -> list[Hashable]:
    """Return what is known of each channel besides what grants say: domain, rules of governance, places of claims,
    and of which enclaves their own implementation decides about it otherwise than peers.
    """
    by_itself: list[list[tuple[int, int]]] = [[] for _ in system.channels]
    for number, enclave in enumerate(system.enclaves):
        for relation, channels in enumerate(enclave.by_itself):
            for channel in channels:
                by_itself[channel].append((number, relation))
    # Topics of a claim of ability are places each, whatever its source and target are together.
    places = [
        list(dict.fromkeys(each.channels for pair in claim.pairs for each in pair if each.channels))
        for claim in system.claims
    ]
    topic_rules: list[list[int]] = [[] for _ in system.channels]
    for number, rule in enumerate(system.topic_rules):
        for channel in rule.channels:
            topic_rules[channel].append(number)
    return [
        (
            atom.domain,
            tuple(topic_rules[channel]),
            tuple(by_itself[channel]),
            tuple(
                (
                    channel in claim.source.channels,
                    channel in claim.target.channels,
                    channel in claim.left_out,
                    *(channel in part for part in parts),
                )
                for claim, parts in zip(system.claims, places, strict=True)
            ),
        )
        for channel, atom in enumerate(system.channels)
    ]
