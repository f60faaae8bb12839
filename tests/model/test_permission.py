"""Grant choice and first match on bit sets, against the definitions read off one channel at a time."""

from __future__ import annotations

import random
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone

import pytest

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import (
    ChannelAtom,
    DocumentAtom,
    DomainAtom,
    GrantAtom,
    Reading,
    RuleAtom,
    System,
)
from tests.amount import tried

START = datetime(2026, 1, 1, tzinfo=timezone.utc)
HERE = Location(path="permissions.p7s", line=1)


def subset(random_source: random.Random, size: int) -> frozenset[int]:
    return frozenset(n for n in range(size) if random_source.random() < 0.4)


def small_system(seed: int) -> System:
    """Two domains, three channels each, two documents with two grants of up to four rules."""
    source = random.Random(seed)
    rules = sorted(source.randrange(4) for _ in range(source.randrange(10)))
    return System(
        profiles=("spec",),
        readings=(Reading(pins_signer=True, skips_grants_out_of_date=True, requires_grant=False),),
        may=True,
        instants=tuple(START + timedelta(days=n) for n in range(4)),
        now=source.randrange(4),
        certificates=(),
        documents=tuple(
            DocumentAtom(label="", location=Location(""), intact=True, signers=frozenset(), opaque=False)
            for _ in range(4)
        ),
        trust_domains=(),
        enclaves=(),
        domains=tuple(DomainAtom(label=str(n), intervals=((n, n),)) for n in range(2)),
        channels=tuple(
            ChannelAtom(domain=n % 2, topic=f"t{n}", partition="", ros=False, infinite=False) for n in range(6)
        ),
        domain_rules=(),
        topic_rules=(),
        grants=tuple(
            GrantAtom(
                document=n // 2,
                names=subset(source, 3),
                not_before=source.randrange(4),
                not_after=source.randrange(4),
                default_allow=source.random() < 0.3,
                location=HERE,
            )
            for n in range(4)
        ),
        rules=tuple(
            RuleAtom(
                grant=grant,
                allow=source.random() < 0.6,
                domains=subset(source, 2),
                publish=subset(source, 6),
                subscribe=subset(source, 6),
                relay=subset(source, 6),
                location=HERE,
            )
            for grant in rules
        ),
    )


def decision(system: System, grant: int, operation: Operation, channel: int) -> bool:
    """docs/model.md, `decision`, to the letter."""
    for rule in system.rules:
        if rule.grant != grant or system.channels[channel].domain not in rule.domains:
            continue
        if channel in getattr(rule, operation.value):
            return rule.allow
    return system.grants[grant].default_allow


@pytest.mark.parametrize("seed", range(tried(200)))
def test_allowed_is_the_first_match(seed: int) -> None:
    system = small_system(seed)
    permissions = Permissions(system)
    for grant in range(len(system.grants)):
        for operation in Operation:
            expected = {c for c in range(6) if decision(system, grant, operation, c)}
            assert set(members(permissions.allowed(grant, operation))) == expected


@pytest.mark.parametrize("seed", range(tried(200)))
def test_chosen_is_the_first_grant_in_force_of_each_document(seed: int) -> None:
    system = small_system(seed)
    permissions = Permissions(system)
    for certificate in range(3):
        for documents in (frozenset({0}), frozenset({1}), frozenset({0, 1})):
            expected = []
            for document in sorted(documents):
                named = [
                    n
                    for n, grant in enumerate(system.grants)
                    if grant.document == document
                    and certificate in grant.names
                    and grant.not_before <= system.now <= grant.not_after
                ]
                expected += named[:1]
            assert permissions.chosen(certificate, documents) == expected


@pytest.mark.parametrize(
    "numbers", [[], [0, 3, 64, 1000], range(9_000), range(10, 9_000), [3, 8_000], range(0, 300_000, 1_001)]
)
def test_bits_and_members_are_inverse(numbers: Sequence[int]) -> None:
    assert list(members(bits(numbers))) == [*numbers]
    assert bits(numbers) == sum(1 << number for number in numbers)
