"""An enclave that attacks is on the network too: it does whatever somebody does there without any key."""

from __future__ import annotations

from itertools import product

import pytest
from msgspec.structs import replace

from keystore_audit.engine.native_claims import claims_at
from keystore_audit.model.formal.asked import Attacker, ClaimKind, Place, Search
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Decisions
from keystore_audit.model.formal.system import System
from tests.engine.systems import random_system, with_claims

ATTACKING = (Attacker.SOURCE, Attacker.RELAYS)


@pytest.mark.parametrize("start", range(0, 200, 50))
def test_a_key_takes_nothing_away(start: int) -> None:
    """Where the outsider's data gets, that of an enclave which attacks gets; what the outsider hears, it hears."""
    told = {True: 0, False: 0}
    outsider = Place(outsider=True)
    for seed in range(start, start + 50):
        system = with_claims(random_system(seed), seed, 1)
        flows = _flows_of(system)
        places = [Place(enclaves=frozenset({e})) for e in range(len(system.enclaves))]
        places += [Place(channels=frozenset({c})) for c in range(len(system.channels))]
        for enclave, place in product(range(len(system.enclaves)), places):
            if place.enclaves == {enclave}:
                continue
            inside = Place(enclaves=frozenset({enclave}))
            asked = [
                Search(attacker=attacker, source=one, target=place)
                for attacker in ATTACKING
                for one in (outsider, inside)
            ]
            asked += [Search(attacker=Attacker.RELAYS, source=place, target=one) for one in (outsider, inside)]
            for without, with_key in zip(asked[::2], asked[1::2], strict=True):
                found = flows.shortest(without) is not None
                assert not found or flows.shortest(with_key) is not None, (seed, without, with_key)
                told[found] += 1
    assert min(told.values()) > 20


def _flows_of(system: System) -> Flows:
    return Flows(system, trust_domain_views(system))


@pytest.mark.parametrize("start", range(0, 200, 50))
def test_what_honest_enclaves_let_the_outsider_hear_is_what_is_written_and_not_encrypted(start: int) -> None:
    """Topic by topic, over any number of trust domains. That no enclave here writes one tells nothing of encryption."""
    told = {True: 0, False: 0}
    for seed in range(start, start + 50):
        system = with_claims(random_system(seed), seed, 1)
        claims = claims_at(system, 2 * system.now, Decisions(system))
        everybody, channels = Place(enclaves=frozenset(range(len(system.enclaves)))), range(len(system.channels))
        views = trust_domain_views(system)
        clear = union(view.readable for view in views)
        written = union(view.honest(e).writes_at_all & view.readable for view in views for e in everybody.enclaves)
        for channel in channels:
            heard = replace(
                system.claims[0],
                kind=ClaimKind.NO_FLOW,
                attacker=Attacker.HONEST,
                source=everybody,
                target=Place(outsider=True),
                through=frozenset(),
                left_out=frozenset(channels) - {channel},
            )
            topic = Place(channels=frozenset({channel}))
            encrypted = replace(heard, kind=ClaimKind.ENCRYPTED, attacker=Attacker.OUTSIDER, target=topic)
            found = [claims.violation(each) is not None for each in (heard, encrypted)]
            assert found == [bool(written >> channel & 1), bool(clear >> channel & 1)], (seed, channel)
            told[found[0]] += 1
    assert min(told.values()) > 10
