"""All cases of a small scope: every governance row, and every pair of ordered rules, decided by both engines.

Alloy is asked whether its functions are otherwise than the native engine says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.facts import facts
from keystore_audit.engine.native import NativeEngine
from keystore_audit.keystore.typed import Operation, ProtectionKind
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID
from keystore_audit.properties.result import Role
from tests.engine.alloy_batch import otherwise, shipped
from tests.engine.systems import (
    IDENTITY_CA,
    PERMISSIONS_CA,
    Builder,
    healthy_builder,
)

pytestmark = [pytest.mark.alloy, pytest.mark.slow, pytest.mark.xdist_group("alloy")]

KINDS = tuple(ProtectionKind)
PAYLOAD_KINDS = (ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT)
BOTH = (False, True)

OUTCOMES = {
    "outsiders-cannot-read": "readable_outside",
    "outsiders-cannot-learn-names": "announced_outside",
    "outsiders-cannot-inject": "injectable_outside",
    "outsiders-cannot-replay": "replayable_outside",
    "grants-are-enforced": "unenforced",
    "nobody-writes-without-a-grant": "writes_without_a_grant[TrustDomain]",
    "nobody-reads-without-a-grant": "reads_without_a_grant[TrustDomain]",
    "readers-cannot-forge": "forged_by_readers[TrustDomain]",
    "relays-cannot-read": "read_by_relays[TrustDomain]",
}
"""For each property what the model says it is about: channels of the trust domain, or of enclaves."""

WRITER, READER, RELAY, STRANGER = range(4)


def test_all_governance_rows_have_the_same_outcomes_in_both_engines(tmp_path: Path) -> None:
    """6,000 rows: 3,600 that DDS-Security allows and 2,400 that let the unauthenticated in beside protected messages.

    A writer, a reader, a relay and a stranger, which joined by a grant for something else, on a channel for each row.
    """
    vectors: set[frozenset[tuple[str, int | None]]] = set()
    legal: set[frozenset[tuple[str, int | None]]] = set()
    rows = 0
    for rtps, discovery, unauthenticated in product(KINDS, KINDS, BOTH):
        system = governed(rtps, discovery, unauthenticated=unauthenticated)
        found = natively(system)
        assert otherwise_in_alloy(system, found, tmp_path) == [], (rtps, discovery, unauthenticated)
        for outcome in by_channel(system, found)[1:]:
            vectors.add(outcome)
            if not unauthenticated or rtps is ProtectionKind.NONE:
                legal.add(outcome)
            rows += 1
    assert rows == 6000
    assert (len(legal), len(vectors)) == (OF_LEGAL_ROWS, OF_ALL_ROWS)


def test_one_outcome_turned_is_seen(tmp_path: Path) -> None:
    """What the test above rests on: a pair too many or too few, in any of the relations, is told apart."""
    system = governed(ProtectionKind.NONE, ProtectionKind.SIGN, unauthenticated=True)
    found = natively(system)
    for property_id, expression in OUTCOMES.items():
        turned = found | {property_id: found[property_id] ^ {(0, 1)}}
        assert otherwise_in_alloy(system, turned, tmp_path) == [expression]


OF_LEGAL_ROWS, OF_ALL_ROWS = 74, 80
"""Different outcomes, of nine properties and by whom, that the 3,600 legal rows have, and all 6,000."""


def governed(rtps: ProtectionKind, discovery: ProtectionKind, *, unauthenticated: bool) -> System:
    """A channel for each topic rule, in a domain that is governed so; channel 0 is the stranger's."""
    b = healthy_builder()
    b.rules.clear()
    for _ in range(2):
        identity = b.certificate([IDENTITY_CA])
        document = b.document([PERMISSIONS_CA])
        b.enclave(0, identity, document)
        b.grant(document, [identity])
    b.channels.clear()
    b.topic_rules.clear()
    b.domain_rules[0] = replace(
        b.domain_rules[0],
        rtps_protection_kind=rtps,
        discovery_protection_kind=discovery,
        allow_unauthenticated_participants=unauthenticated,
    )
    b.topic_rule(0, [b.channel(0, "rt/own")])
    for metadata, data, read, write, hidden in product(KINDS, PAYLOAD_KINDS, BOTH, BOTH, BOTH):
        channel = b.channel(0, f"rt/topic_{len(b.channels)}")
        b.topic_rule(
            0,
            [channel],
            enable_discovery_protection=hidden,
            enable_read_access_control=read,
            enable_write_access_control=write,
            metadata=metadata,
            data=data,
        )
    channels = range(1, len(b.channels))
    b.rule(WRITER, [0], publish=channels)
    b.rule(READER, [0], subscribe=channels)
    b.rule(RELAY, [0], relay=channels)
    b.rule(STRANGER, [0], publish=[0])
    return b.system()


def natively(system: System) -> dict[str, frozenset[tuple[int, int]]]:
    """For each property the trust domain or enclave and the channel of each violation."""
    answers = NativeEngine([system]).answers[0]
    return {
        property_id: frozenset(
            (witness[Role.ENCLAVE if is_by_enclave(property_id) else Role.TRUST_DOMAIN], witness[Role.CHANNEL])
            for witness in answers[property_id].witnesses
        )
        for property_id in OUTCOMES
    }


def is_by_enclave(property_id: str) -> bool:
    return Role.ENCLAVE in BY_ID[property_id].roles


def by_channel(
    system: System, found: Mapping[str, frozenset[tuple[int, int]]]
) -> list[frozenset[tuple[str, int | None]]]:
    outcomes: list[set[tuple[str, int | None]]] = [set() for _ in system.channels]
    for property_id, pairs in found.items():
        for first, channel in pairs:
            outcomes[channel].add((property_id, first if is_by_enclave(property_id) else None))
    return [frozenset(outcome) for outcome in outcomes]


def otherwise_in_alloy(system: System, found: Mapping[str, frozenset[tuple[int, int]]], directory: Path) -> list[str]:
    atoms = name_atoms(system)
    return otherwise(
        directory,
        shipped() | {"keystore.als": facts(system)},
        {
            expression: (
                atoms["enclaves"] if is_by_enclave(property_id) else atoms["trust_domains"],
                found[property_id],
            )
            for property_id, expression in OUTCOMES.items()
        },
        atoms["channels"],
    )


def rule_pairs() -> Iterator[tuple[tuple[bool, int, int], ...]]:
    """(allow, domains, topics) twice: sets as bits, of two domains and three topic classes."""
    one = list(product(BOTH, range(1, 4), range(8)))
    yield from product(one, one)


@pytest.mark.parametrize("default", BOTH)
def test_all_pairs_of_ordered_rules_decide_alike_in_both_engines(default: bool, tmp_path: Path) -> None:
    """2 domains, 3 topic classes, 2 ordered rules, a default: 2,304 grants each, in systems of 256."""
    pairs = list(rule_pairs())
    assert len(pairs) == 2304
    for start in range(0, len(pairs), 256):
        system = of_grants(pairs[start : start + 256], default_allow=default)
        permissions = Permissions(system)
        native = {
            (grant, channel)
            for grant in range(len(system.grants))
            for channel in members(permissions.allowed(grant, Operation.PUBLISH))
        }
        atoms = name_atoms(system)
        expected = {"publish_allowed": (atoms["grants"], native)}
        assert otherwise(tmp_path, shipped() | {"keystore.als": facts(system)}, expected, atoms["channels"]) == []
        assert native == {
            (grant, channel)
            for grant, rules in enumerate(pairs[start : start + 256])
            for channel in range(6)
            if first_match(rules, default, *divmod(channel, 3))
        }


def first_match(rules: tuple[tuple[bool, int, int], ...], default: bool, domain: int, topic: int) -> bool:
    """What DDS-Security says, counted out: the first rule that matches, else the default."""
    for allow, domains, topics in rules:
        if domains >> domain & 1 and topics >> topic & 1:
            return allow
    return default


def of_grants(pairs: list[tuple[tuple[bool, int, int], ...]], *, default_allow: bool) -> System:
    b: Builder = healthy_builder()
    b.grants.clear()
    b.rules.clear()
    b.channels.clear()
    b.domain(1, 1)
    for domain, topic in product(range(2), range(3)):
        b.channel(domain, f"rt/topic_{topic}")
    b.topic_rules[0] = replace(b.topic_rules[0], channels=frozenset(range(6)))
    for rules in pairs:
        grant = b.grant(1, [2], default_allow=default_allow)
        for allow, domains, topics in rules:
            named = [channel for channel in range(6) if topics >> channel % 3 & 1]
            b.rule(grant, [d for d in range(2) if domains >> d & 1], publish=named, allow=allow)
    return b.system()
