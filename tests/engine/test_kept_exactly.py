"""Flows over moments beside enumeration by hand: random grants that come and go, and lists that do."""

from __future__ import annotations

import random

from msgspec.structs import replace

from keystore_audit.engine.native_claims import KeptFlows, Stage
from keystore_audit.findings import Location
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.system import System
from tests.amount import tried
from tests.engine.flows_by_hand import OUTSIDER, ByHand, Flow
from tests.engine.systems import GOVERNANCE, INSTANTS, PERMISSIONS_CA, healthy_builder

SEEDS = tried(400)
HOPS = 1, 2, 3  # topics beside `rt/chatter` and the rest


def coming_and_going(chance: random.Random) -> System:
    """Five enclaves; each may publish and subscribe to a topic or two for an instant or two, or is revoked at times."""
    b, lists = healthy_builder(), chance.random() < 0.3
    b.now = 0
    b.grants.clear()
    b.rules.clear()
    for number in range(3):
        document = b.document([PERMISSIONS_CA])
        b.enclave(0, b.certificate([0], label=f"/{number}"), document, label=f"/{number}")
    b.domain(1, 1)
    for number in HOPS:
        b.channel(number % 2, f"rt/{number}")
    b.topic_rules.clear()
    b.domain_rules.clear()
    b.domain_rule(GOVERNANCE, [0, 1])
    b.topic_rule(0, range(len(b.channels)))
    for enclave in b.enclaves:
        assert enclave.document is not None
        assert enclave.identity is not None
        for instant in range(INSTANTS) if not lists else (0,):
            end = min(instant + chance.randrange(2), INSTANTS - 1) if not lists else INSTANTS - 1
            grant = b.grant(enclave.document, [enclave.identity], not_before=instant, not_after=end)
            publish, subscribe = ([c for c in range(len(b.channels)) if chance.random() < 0.12] for _ in range(2))
            b.rule(grant, [0, 1], publish=publish, subscribe=subscribe)
    system = b.system()
    if not lists:
        return system
    identities = [enclave.identity for enclave in system.enclaves if enclave.identity is not None]
    first, *later = (frozenset(chance.sample(identities, 2)) for _moment in range(INSTANTS))
    revoked_later = tuple((2 * instant + 1, each) for instant, each in enumerate(later))
    return replace(
        system, trust_domains=(replace(system.trust_domains[0], revoked=first, revoked_later=revoked_later),)
    )


def claim(chance: random.Random, system: System) -> ClaimAtom:
    def place() -> Place:
        if chance.random() < 0.6:
            return Place(enclaves=frozenset(chance.sample(range(len(system.enclaves)), chance.randint(1, 2))))
        return Place(channels=frozenset(chance.sample(range(len(system.channels)), chance.randint(1, 2))))

    return ClaimAtom(
        id="apart",
        kind=ClaimKind.NO_FLOW,
        attacker=chance.choice([Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS]),
        source=place(),
        target=place(),
        through=frozenset(e for e in range(len(system.enclaves)) if chance.random() < 0.1),
        left_out=frozenset(c for c in range(len(system.channels)) if chance.random() < 0.1),
        until=chance.randrange(1, INSTANTS),
        location=Location(path="keystore-audit.toml"),
    )


def by_hand(system: System, asked: ClaimAtom) -> tuple[int, bool] | None:
    """The first moment at which something has come to the target, and whether that one alone is enough."""
    had: set[int] = set()
    for moment in range(2 * system.now, 2 * (asked.until or 0) + 1):
        flow = Flow(ByHand(system, moment), asked)
        have, known = had | flow.source | (flow.gets() - asked.through), None
        while known != have:
            known = have
            have = have | {f for e, _channel, f in flow.hops if e in have and f not in asked.through}
        arrived = {f for e, _channel, f in flow.hops if e in have} | flow.gets()
        if arrived & flow.target or any(map(flow.puts, have)):
            return moment, flow.shortest() is not None
        had = have
    return None


def check(system: System, asked: ClaimAtom, stages: tuple[Stage, ...]) -> None:
    """That each hop is one of its moment, and goes on from where the one before ended."""
    hops = [(Flow(ByHand(system, stage.moment), asked), leg) for stage in stages for leg in stage.legs]
    at: int | None = None
    for number, (flow, (sender, channel, receiver)) in enumerate(hops):
        one, other = (OUTSIDER if each is None else each for each in (sender, receiver))
        if number == 0 and asked.source.channels:
            assert channel in asked.source.channels
            assert other in flow.gets()
        elif number == len(hops) - 1 and asked.target.channels:
            assert channel in asked.target.channels
            assert flow.puts(one)
        else:
            assert (one, channel, other) in flow.hops
        assert one == at if number else asked.source.channels or one in flow.source
        assert number == len(hops) - 1 or other not in asked.through
        at = other
    assert asked.target.channels or at in hops[-1][0].target


def test_flows_over_time_are_those_that_enumeration_finds() -> None:
    alone, together = 0, 0
    for seed in range(SEEDS):
        chance = random.Random(seed)
        system = coming_and_going(chance)
        kept = KeptFlows(system)
        for asked in [claim(chance, system) for _ in range(4)]:
            expected, found = by_hand(system, asked), kept.flow(asked)
            assert (found[-1].moment if found else None) == (expected[0] if expected else None), (seed, asked)
            if expected is not None and found is not None:
                check(system, asked, found)
                assert kept.takes_time(asked) is not expected[1], (seed, asked)
                alone, together = alone + expected[1], together + (not expected[1])
    assert min(alone, together) > tried(50), (alone, together)
