"""An enclave that attacks is on the network too: it does whatever somebody does there without any key."""

from __future__ import annotations

from itertools import product

import pytest

from keystore_audit.model.attacker import RealmView
from keystore_audit.model.claim import Attacker, Place
from keystore_audit.model.flow import Flows, Search
from keystore_audit.model.permission import Permissions
from keystore_audit.model.system import System
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
    permissions = Permissions(system)
    return Flows(system, [RealmView(system, realm, permissions) for realm in range(len(system.realms))])
