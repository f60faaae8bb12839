"""Pairs of enclaves that reach each other: all at once against Warshall's algorithm, and in diffs against the XML."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Comparison, Direction, Influenced, Layer
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.flow import Lane
from keystore_audit.model.formal.influence import Influence
from tests.amount import tried
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store, compared
from tests.model.test_comparison_exactly import Permissions

ENCLAVES = ("/a", "/b", "/c", "/d")
TOPICS = ("rt/x", "rt/y", "rt/z", "rt/rosout")
PARTICIPANTS = 6
SHORTLY = (Phase.explicit, Phase.generate)  # to shrink keystores takes minutes

sets = st.lists(st.integers(0, 15), min_size=PARTICIPANTS, max_size=PARTICIPANTS)
lanes = st.lists(st.builds(lambda puts, gets: Lane(puts=puts, gets=gets), sets, sets), min_size=1, max_size=2)


@given(several=lanes)
@settings(max_examples=tried(300), deadline=None, derandomize=True)
def test_everybody_is_reached_whom_a_way_of_hops_reaches(several: list[Lane]) -> None:
    everybody = range(PARTICIPANTS)
    reached = [[any(lane.puts[e] & lane.gets[f] for lane in several) for f in everybody] for e in everybody]
    graph = Influence(several, PARTICIPANTS)
    assert [set(members(each)) for each in graph.hops] == [{f for f in everybody if row[f]} for row in reached]
    for between, start, end in product(everybody, repeat=3):
        reached[start][end] = reached[start][end] or (reached[start][between] and reached[between][end])
    assert [set(members(each)) for each in graph.flows] == [
        {e, *(f for f in everybody if reached[e][f])} for e in everybody
    ]


topics = st.lists(st.sampled_from(TOPICS), max_size=2)
documents = st.builds(
    lambda publish, subscribe, denied: [
        *([rule(criterion(denied, "rt/y"), allow=False)] if denied else []),
        *([rule(criterion("publish", *publish))] if publish else []),
        *([rule(criterion("subscribe", *subscribe))] if subscribe else []),
    ],
    topics,
    topics,
    st.sampled_from(["", "", "publish", "subscribe"]),
)
stores = st.dictionaries(st.sampled_from(ENCLAVES), documents, min_size=2, max_size=4)


def keystore(members_of: dict[str, list[str]]) -> Store:
    return Store(
        members={
            path: Member(permissions=permissions(grant(path, *rules)), serial=101 + ENCLAVES.index(path))
            for path, rules in members_of.items()
        }
    )


def compare_stores(old: Store, new: Store) -> Comparison:
    with tempfile.TemporaryDirectory() as root:
        return compared(old, new, Path(root), ("spec",))


def hops(store: Store) -> set[tuple[str, str]]:
    """Who hands samples to whom, from the XML; not over what every node uses."""
    said = {path: Permissions(member.permissions) for path, member in store.members.items()}
    return {
        (one, other)
        for one, other, topic in product(said, said, TOPICS[:-1])
        if one != other and said[one].allows("publish", topic, "", 0) and said[other].allows("subscribe", topic, "", 0)
    }


def flows(store: Store) -> set[tuple[str, str]]:
    found = hops(store)
    while more := {(e, g) for (e, f), (h, g) in product(found, found) if f == h and e != g} - found:
        found |= more
    return found


def told(found: Comparison, direction: Direction) -> Iterator[Influenced]:
    for change in found.changes:
        for each in (change, *change.consequences):
            if each.influenced is not None and each.direction is direction:
                yield each.influenced


@given(old=stores, new=stores)
@settings(max_examples=tried(60), deadline=None, derandomize=True, phases=SHORTLY)
def test_pairs_are_gained_and_lost_where_ways_are(old: dict[str, list[str]], new: dict[str, list[str]]) -> None:
    stores_of = keystore(old), keystore(new)
    found = compare_stores(*stores_of)
    before, after = (flows(store) for store in stores_of)
    for direction, pairs, store in (
        (Direction.GAINED, after - before, stores_of[1]),
        (Direction.LOST, before - after, stores_of[0]),
    ):
        influenced = list(told(found, direction))
        assert sum(each.pairs for each in influenced) == len(pairs)
        assert {end for each in influenced for end in each.ends} == {end for pair in pairs for end in pair}
        possible = hops(store)
        for each in influenced:
            assert (each.way[0].sender, each.way[-1].receiver) in pairs
            assert all((hop.sender, hop.receiver) in possible for hop in each.way)
            assert all(one.receiver == other.sender for one, other in zip(each.way, each.way[1:], strict=False))
    assert not [change for change in found.changes if change.layer is Layer.INFLUENCE], "each has a cause here"


def chain(*, last: bool) -> Store:
    """/a hands to /b hands to /c; `last`: it may hear what /b says."""
    return keystore(
        {
            "/a": [rule(criterion("publish", "rt/x"))],
            "/b": [rule(criterion("subscribe", "rt/x"), criterion("publish", "rt/y"))],
            "/c": [rule(criterion("subscribe", "rt/y" if last else "rt/z"))],
        }
    )


def test_two_causes_have_a_part_each(tmp_path: Path) -> None:
    """/c hears /b, and /d hears /a: two changes, one pair by /d's and two by /c's."""
    listening = {"/d": Member(permissions=permissions(grant("/d", rule(criterion("subscribe", "rt/w")))), serial=104)}
    old, new = chain(last=False), chain(last=True)
    old = replace(old, members={**old.members, **listening})
    hearing = permissions(grant("/d", rule(criterion("subscribe", "rt/w", "rt/x"))))
    new = replace(new, members={**new.members, **listening}).member("/d", permissions=hearing)
    found = compared(old, new, tmp_path)
    parts = {
        change.enclaves: each.influenced.pairs
        for change in found.changes
        for each in change.consequences
        if each.influenced is not None
    }
    assert parts == {("/c",): 2, ("/d",): 1}


def test_what_could_not_be_read_is_no_way(tmp_path: Path) -> None:
    """Whether /b still hands on is not known: neither gained nor lost."""
    old = chain(last=True)
    broken = old.members["/b"].permissions.replace("<dds>", "<!DOCTYPE dds><dds>")
    found = compared(old, old.member("/b", permissions=broken), tmp_path)
    assert {each.enclave for each in found.unknown} == {"/b"}
    assert found.changes == ()
