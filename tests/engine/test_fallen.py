"""Who may fall: the smallest sets of compromised participants against all sets, taken one by one and by definition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import NamedTuple

import pytest
from msgspec.structs import replace

from keystore_audit.engine import native_claims
from keystore_audit.engine.engines import combine_falls
from keystore_audit.errors import BudgetExceeded
from keystore_audit.flow import FlowQuestion, questions
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal import fallen
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, search_of
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Status
from tests.amount import tried
from tests.engine.alloy.flow_builders import (
    FOURTH,
    OUT,
    THIRD,
    at,
    chain,
    claim,
    on_channel,
    opaque_third,
    weak,
    with_listeners_key,
)
from tests.engine.flows_by_hand import ByHand, Flow
from tests.engine.systems import CHATTER, LISTENER, OTHER_TOPIC, TALKER, Builder, mixed, random_system, with_claims

MOST = 3

Sets = list[frozenset[int]]


def asked(seed: int, *, several: bool = False) -> Iterator[tuple[System, ClaimAtom]]:
    """Claims about flows of a random system (of `several` implementations), as they are asked about who may fall."""
    system = with_claims(random_system(seed), seed, 12)
    system = mixed(system, seed) if several else system
    for each in system.claims:
        if each.kind is ClaimKind.NO_FLOW and not each.source.outsider:
            yield system, replace(each, attacker=Attacker.HONEST, until=None)


def told(system: System, asked: ClaimAtom, most: int = MOST) -> tuple[fallen.Fall, ...]:
    return native_claims.fallen(replace(system, claims=(asked,)), most)


def smallest(system: System, asked: ClaimAtom) -> dict[frozenset[int], int]:
    """By smallest set the length of a shortest flow; every larger set lets it through as well."""
    hand = ByHand(system)
    found: dict[frozenset[int], int] = {}
    for size in range(MOST + 1):
        for each in map(frozenset, combinations(hand.enclaves, size)):
            length = Flow(hand, asked, each).shortest()
            if any(smaller <= each for smaller in found):
                assert length is not None, (asked, each)
            elif length is not None:
                found[each] = length
    return found


@pytest.mark.parametrize("several", [False, True])
def test_all_smallest_sets_and_no_others(several: bool) -> None:
    sizes = [0] * (MOST + 1)
    for seed in range(tried(120 if several else 300, 90)):
        for system, claim_ in asked(seed, several=several):
            found = {each.fallen: len(each.legs) for each in told(system, claim_)}
            assert found == smallest(system, claim_), (seed, claim_)
            for each in found:
                sizes[len(each)] += 1
    assert all(sizes[:3])


def test_everybody_compromised_is_less_than_relays_by_the_outsider_alone() -> None:
    """Whom the honest attacker and relays let through, the sets between them do too."""
    for seed in range(60):
        for system, claim_ in asked(seed):
            flows = Flows(system, trust_domain_views(system))
            search = search_of(claim_)
            everybody = frozenset(range(flows.outsider))
            ways = [
                flows.shortest(search),
                *(flows.shortest(replace(search, compromised=each)) for each in (everybody & {0}, everybody)),
                flows.shortest(replace(search, attacker=Attacker.RELAYS)),
            ]
            through = [way is not None for way in ways]
            assert through == sorted(through), (seed, claim_)


class Case(NamedTuple):
    builder: Builder
    claim: ClaimAtom
    sets: Iterable[set[int]]


HONEST = Attacker.HONEST
ORIGIN = ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION
NONE, SIGN, ENCRYPT = ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT


def with_a_fourth() -> Builder:
    """One without rights, whose key is its own."""
    b = with_listeners_key(chain())
    identity = b.enclaves[FOURTH].identity
    assert identity is not None
    b.certificates[identity] = replace(b.certificates[identity], key=4_444)
    return b


def both_read(**kinds: ProtectionKind) -> Builder:
    """The talker and the third read what the listener and the talker write."""
    b = weak(**kinds)
    b.rule(0, [0], subscribe=[OTHER_TOPIC])
    b.rule(THIRD, [0], subscribe=[CHATTER])
    return b


PAIRS = {
    "by right it needs nobody": Case(chain(), claim(at(TALKER), at(THIRD), HONEST), [set()]),
    "a topic goes on over who reads it": Case(chain(), claim(on_channel(CHATTER), at(THIRD), HONEST), [set()]),
    "unless no flow may pass that one": Case(
        chain(), claim(on_channel(CHATTER), at(THIRD), HONEST, through=(LISTENER,)), []
    ),
    "it ends at a topic that is written": Case(chain(), claim(at(TALKER), on_channel(OTHER_TOPIC), HONEST), [set()]),
    "nobody forges what tells its origin": Case(both_read(), claim(at(THIRD), at(TALKER), HONEST), []),
    "a reader forges with the writer's key": Case(
        both_read(metadata=ENCRYPT, rtps=SIGN), claim(at(THIRD), at(TALKER), HONEST), [{THIRD}]
    ),
    "one that no flow may pass breaks nothing": Case(
        weak(metadata=ENCRYPT), claim(at(TALKER), at(THIRD), HONEST, through=(LISTENER,)), []
    ),
    "who has a reader's key reads as that one": Case(
        with_listeners_key(chain()), claim(at(TALKER), at(FOURTH), HONEST), [{FOURTH}]
    ),
    "who has none reads nothing": Case(with_a_fourth(), claim(at(TALKER), at(FOURTH), HONEST), []),
    "the outsider listens, and is not counted": Case(
        weak(rtps=NONE, metadata=NONE, data=NONE), claim(at(TALKER), OUT, HONEST), [set()]
    ),
    "what was not read may have any key": Case(
        opaque_third(), claim(at(LISTENER), at(TALKER), HONEST, through=(THIRD,)), [{TALKER}]
    ),
    "what was read has its own": Case(chain(), claim(at(LISTENER), at(TALKER), HONEST, through=(THIRD,)), []),
}


@pytest.mark.parametrize("name", PAIRS)
def test_one_change_flips_it(name: str) -> None:
    builder, claim_, sets = PAIRS[name]
    system = builder.system()
    assert {each.fallen for each in told(system, claim_)} == set(map(frozenset, sets)) == set(smallest(system, claim_))


def test_so_many_as_are_asked_about() -> None:
    builder, claim_, _sets = PAIRS["a reader forges with the writer's key"]
    assert told(builder.system(), claim_, 0) == ()
    assert [each.fallen for each in told(builder.system(), claim_, 1)] == [{THIRD}]


def test_too_much_to_try_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    builder, claim_, _sets = PAIRS["a reader forges with the writer's key"]
    monkeypatch.setattr(fallen, "MAX_WORK", 4 * 4)
    assert told(builder.system(), claim_, 1)
    monkeypatch.setattr(fallen, "MAX_WORK", 4 * 4 - 1)
    with pytest.raises(BudgetExceeded, match="too many to try: ask for fewer"):
        told(builder.system(), claim_, 1)


def test_what_one_engine_alone_finds_is_unknown() -> None:
    """A set that only one finds, and a smaller one of the other: neither is decided."""
    system = replace(chain().system(), claims=(claim(at(TALKER), at(THIRD), HONEST),), profiles=("spec",))
    [by_right] = told(system, system.claims[0])
    other = fallen.Fall(frozenset({LISTENER}), by_right.legs)
    [stated] = questions(FlowQuestion(source="/talker", target="/third", compromised=1))
    system = replace(system, claims=(replace(system.claims[0], id=stated.id),))
    for engines, expected in (
        ({"native": [[by_right]], "alloy": [[by_right]]}, {(): Status.VIOLATED}),
        ({"native": [[by_right]], "alloy": [[]]}, {(): Status.UNKNOWN}),
        ({"native": [[]], "alloy": [[other]]}, {("/listener",): Status.UNKNOWN}),
    ):
        found = combine_falls(stated, [system], engines, ["spec"])
        assert {names: result.status for names, result in found} == expected
