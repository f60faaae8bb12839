"""Updates in any order, against every state on the way as a directory of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import combine, combine_claims
from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import ATTACKERS, Attacker, ClaimKind
from keystore_audit.model.interpret import interpret
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from keystore_audit.properties.result import RollingAnswer
from keystore_audit.rolling import RESTING_ON_GRANTS, find_passages
from tests.amount import tried
from tests.keystore.builder import signed_document, write
from tests.keystore.documents import allow, domain_rule, governance, grant, permissions, pub, sub, topic_rule
from tests.model.comparing import AT, Member, Store, authority

GIVEN = Circumstances(profiles=resolve(("spec", "humble")), at=AT)
Statuses = Mapping[tuple[str, str], Status]


def statuses(root: Path, claims: Sequence[Claim] = ()) -> Statuses:
    """By property and profile, as an audit of the directory says."""
    keystore, profiles = GIVEN.keystore(root), GIVEN.profiles
    accesses = GIVEN.accesses(keystore)
    meaning = interpret(keystore, profiles, AT, accesses, Usabilities(None, accesses), claims)
    native = NativeEngine(meaning.systems)
    about = native.systems, {"native": native.answers}, GIVEN.names
    found = (*combine(*about), *combine_claims(claims, *about))
    return {(each.prop.id, name): told.status for each in found for name, told in each.profiles.items()}


def subject(store: Store, path: str) -> object:
    """The name and the authority of an enclave's identity."""
    return (store.members[path].subject or path, store.identity[0]) if path in store.members else None


def between(old: Store, new: Store, updated: frozenset[str], root: Path) -> Path:
    """The state in which these enclaves carry the new files, with all old documents beside them."""
    carrying = {path: new for path in new.members if path in updated or path not in changing(old, new)}
    carrying |= {path: old for path in old.members if path not in updated and path not in carrying}
    carried = {path: store._files(path, store.members[path]) for path, store in carrying.items()}
    keys = {files["key.pem"] for files in carried.values()}
    for path, files in carried.items():
        write(root / "enclaves" / path.strip("/"), files)
    for path, member in old.members.items():
        files = old._files(path, member)
        kept = ["governance.p7s", "permissions.p7s"]
        if path in updated and subject(old, path) != subject(new, path):
            kept += ["cert.pem"] if files["key.pem"] in keys else ["cert.pem", "key.pem"]
        write(root / "old" / path.strip("/"), {name: files[name] for name in kept})
    for name, document in old.strays.items():
        write(root / "old", {name: signed_document(document.encode(), old.permissions[0])})
    return root


def changing(old: Store, new: Store) -> list[str]:
    def files(store: Store, path: str) -> object:
        return store._files(path, store.members[path]) if path in store.members else None

    return [path for path in sorted({*old.members, *new.members}) if files(old, path) != files(new, path)]


def states(old: Store, new: Store) -> Iterator[frozenset[str]]:
    paths = changing(old, new)
    for number in range(1, len(paths) + 1):
        yield from map(frozenset, combinations(paths, number))


TOPICS = ("rt/a", "rt/b")


def some_permissions(chance: Random, paths: list[str]) -> str:
    def one(path: str) -> str:
        rules = [kind(topic) for kind in (pub, sub) for topic in TOPICS if chance.random() < 0.5]
        return grant(path, allow(pub("rt/c"), *rules))

    several = [chance.choice(paths)] if chance.random() < 0.8 else paths
    return permissions(*map(one, several))


def some_governance(chance: Random) -> str:
    kinds = ("NONE", "SIGN", "ENCRYPT", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
    topics = topic_rule(
        read=chance.random() < 0.8, write=chance.random() < 0.8, metadata=chance.choice(kinds), data="ENCRYPT"
    )
    return governance(domain_rule(topics, join=chance.random() < 0.8, rtps=chance.choice(kinds)))


def some_stores(chance: Random, filled: float) -> tuple[Store, Store]:
    governances = [some_governance(chance) for _each in range(chance.choice([1, 2]))]
    return some_store(chance, governances, filled), some_store(chance, governances, filled)


def some_store(chance: Random, governances: list[str], filled: float) -> Store:
    paths = ["/x", "/y", "/z"]
    members = {}
    for path in paths:
        if chance.random() < filled or not members:
            own = permissions(
                grant(
                    path, allow(*(kind(t) for kind in (pub, sub) for t in TOPICS if chance.random() < 0.4), pub("rt/c"))
                )
            )
            text = own if chance.random() < 0.7 else some_permissions(chance, paths)
            key = path if chance.random() < 0.8 else chance.choice(["/k", *paths])
            name = path if chance.random() < 0.85 else chance.choice(["/n", *paths])
            members[path] = Member(permissions=text, key=key, subject=name, governance=chance.choice(governances))
    one, other, shared = authority("oneCA"), authority("otherCA"), authority("sharedCA")
    return Store(
        members=members,
        identity=(chance.choice([one, one, shared]),),
        permissions=(chance.choice([other, other, other, authority("thirdCA"), shared]),),
    )


def claim(name: str, kind: ClaimKind, attacker: Attacker, source: Globs, target: Globs) -> Claim:
    about = {"statement": name, "location": Location("settings", beside=True), "place": "settings:1"}
    return Claim(id=name, kind=kind, attacker=attacker, source=source, target=target, **about)


X, Y, C = Globs(enclaves=("/x",)), Globs(enclaves=("/y",)), Globs(topics=("rt/c",))
CLAIMS = (
    *(claim(f"no-flow-{each.value}", ClaimKind.NO_FLOW, each, X, Y) for each in ATTACKERS),
    claim("no-flow-from-outside", ClaimKind.NO_FLOW, Attacker.RELAYS, Globs(outsider=True), Y),
    claim("only-publish", ClaimKind.ONLY_PUBLISH, Attacker.HONEST, X, C),
    claim("encrypted", ClaimKind.ENCRYPTED, Attacker.INSIDER, Globs(), C),
    claim("able", ClaimKind.ABLE, Attacker.HONEST, X, Y),
)


LOST = "it holds in OLD and not in NEW"


def check_every_state(old: Store, new: Store, root: Path, claims: Sequence[Claim] = ()) -> RollingAnswer:
    """Ask about the way, and compare with each state as a directory."""
    one, other = old.write(root / "OLD"), new.write(root / "NEW")
    answer = find_passages(one, other, GIVEN, claims)
    done = frozenset(changing(old, new))
    assert frozenset(answer.changing) == done
    before, after = statuses(one, claims), statuses(other, claims)
    every = {
        state: statuses(between(old, new, state, root / "-".join(["S", *(path[1:] for path in sorted(state))])), claims)
        for state in states(old, new)
    }
    expected = set()
    for key in before:
        if after[key] is Status.HOLDS and every:
            lasting = every[done][key] is Status.VIOLATED
            if lasting or (
                before[key] is Status.HOLDS and any(told[key] is Status.VIOLATED for told in every.values())
            ):
                expected.add((*key, lasting))
    lost = {(each.prop.id, name) for each in answer.passages if each.reason == LOST for name in each.profiles}
    assert lost == {key for key in before if before[key] is Status.HOLDS and after[key] is Status.VIOLATED}
    undecided = {each.prop.id for each in answer.passages if each.status is Status.UNKNOWN}
    apart = {
        path for path in done if path in old.members and path in new.members and said(old, path) != said(new, path)
    }
    assert undecided == ({"able"} if apart and claims and Status.HOLDS in ables(after) else set())
    told_on_the_way = [each for each in answer.passages if not each.reason]
    found = {(each.prop.id, name, each.lasting): each for each in told_on_the_way for name in each.profiles}
    expected = {each for each in expected if each[0] not in undecided}
    assert found.keys() == expected
    for (name, profile, lasting), each in found.items():
        failing = [state for state, told in every.items() if told[name, profile] is Status.VIOLATED]
        assert {state for state in every if state >= set(each.updated) and not state & set(each.waiting)} <= {
            *failing,
            *(every if lasting else ()),
        }
        if lasting or name in RESTING_ON_GRANTS:  # each state was asked
            assert frozenset(each.updated) in failing
            assert profile != each.profiles[0] or len(each.updated) == min(map(len, failing))
    return answer


def said(store: Store, path: str) -> str:
    return store.members[path].governance


def ables(told: Mapping[tuple[str, str], Status]) -> set[Status]:
    return {status for (name, _profile), status in told.items() if name == "able"}


@pytest.mark.parametrize("seed", range(tried(40)))
def test_every_state_as_a_directory(seed: int, tmp_path: Path) -> None:
    old, new = some_stores(Random(seed), 0.85)
    check_every_state(old, new, tmp_path)


@pytest.mark.parametrize("seed", range(tried(40)))
def test_claims_in_every_state(seed: int, tmp_path: Path) -> None:
    old, new = some_stores(Random(seed), 1.0)
    check_every_state(old, new, tmp_path, CLAIMS)


# One change flips each.

ONE, OTHER = authority("oneCA"), authority("otherCA")
SHARED_IDENTITY, NO_FLOW = "no-identity-serves-two-enclaves", CLAIMS[0].id


def grants(path: str, *rules: str) -> str:
    return permissions(grant(path, allow(*rules)))


def stores(**members: Member) -> Store:
    return Store(members={f"/{name}": each for name, each in members.items()}, identity=(ONE,), permissions=(OTHER,))


def order(answer: RollingAnswer, name: str) -> set[tuple[tuple[str, ...], tuple[str, ...], bool]]:
    assert all(each.status is Status.VIOLATED for each in answer.passages)
    return {(each.updated, each.waiting, each.lasting) for each in answer.passages if each.prop.id == name}


IDLE = grants("/z", pub("rt/z"))


def test_keys_that_change_places(tmp_path: Path) -> None:
    """Each keystore has a key for each; while one was updated, both have the same one."""
    one, other = (Member(permissions=grants(path, pub("rt/a"))) for path in ("/x", "/y"))
    old = stores(x=replace(one, key="/k"), y=replace(other, key="/l"))
    swapped = stores(x=replace(one, key="/l"), y=replace(other, key="/k"))
    assert order(check_every_state(old, swapped, tmp_path / "a"), SHARED_IDENTITY) == {(("/x",), ("/y",), False)}
    assert not order(check_every_state(old, swapped.member("/x", key="/m"), tmp_path / "b"), SHARED_IDENTITY) - {
        (("/y",), ("/x",), False)
    }
    fresh = stores(x=replace(one, key="/m"), y=replace(other, key="/n"))
    assert not order(check_every_state(old, fresh, tmp_path / "c"), SHARED_IDENTITY)


X_WRITES, Y_READS = (Member(permissions=grants(*each)) for each in (("/x", pub("rt/c")), ("/y", sub("rt/c"))))
X_IDLE, Y_IDLE = (Member(permissions=grants(path, pub("rt/z"))) for path in ("/x", "/y"))


def test_a_flow_of_an_old_right_and_a_new_one_until_another_authority_signs(tmp_path: Path) -> None:
    old, new = stores(x=X_WRITES, y=Y_IDLE), stores(x=X_IDLE, y=Y_READS)
    claims = CLAIMS[:1]
    answer = check_every_state(old, new, tmp_path / "a", claims)
    assert order(answer, NO_FLOW) == {(("/y",), (), True)}
    assert {each.until for each in answer.passages if each.prop.id == NO_FLOW} == {"2034-01-01T00:00:00"}
    another = replace(new, permissions=(authority("thirdCA"),))
    assert not order(check_every_state(old, another, tmp_path / "b", claims), NO_FLOW)
    apart = replace(new, members={**new.members, "/y": Y_IDLE})
    assert not order(check_every_state(old, apart, tmp_path / "c", claims), NO_FLOW)


def test_what_lay_beside_old_is_there_for_good(tmp_path: Path) -> None:
    claims = [claim("only-y", ClaimKind.ONLY_PUBLISH, Attacker.HONEST, Y, C)]
    old = stores(x=X_IDLE, y=Member(permissions=grants("/y", pub("rt/c"))))
    new = old.member("/x", permissions=grants("/x", sub("rt/c")))
    kept = replace(old, strays={"kept.p7s": grants("/x", pub("rt/c"))})
    assert order(check_every_state(kept, new, tmp_path / "a", claims), "only-y") == {(("/x",), (), True)}
    assert not order(check_every_state(old, new, tmp_path / "b", claims), "only-y")


def test_an_enclave_that_leaves_keeps_its_identity(tmp_path: Path) -> None:
    """Whoever has its key says for good what it might say."""
    claims = [claim("only-y", ClaimKind.ONLY_PUBLISH, Attacker.HONEST, Y, C)]
    y = Member(permissions=grants("/y", pub("rt/c")))
    both = stores(x=X_WRITES, y=y)
    assert order(check_every_state(both, both.without("/x"), tmp_path / "a", claims), "only-y") == {(("/x",), (), True)}
    idle = both.member("/x", permissions=X_IDLE.permissions)
    assert not order(check_every_state(idle, idle.without("/x"), tmp_path / "b", claims), "only-y")


def test_what_takes_too_many_states_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Growing properties need the union alone; where grants excuse, every state is asked."""
    paths = ("/x", "/y", "/z")
    old, new = (
        stores(**{path[1:]: Member(permissions=grants(path, pub(topic))) for path in paths}) for topic in TOPICS
    )
    one, other = old.write(tmp_path / "OLD"), new.write(tmp_path / "NEW")
    assert find_passages(one, other, GIVEN).passages == ()
    monkeypatch.setattr("keystore_audit.rolling.MAX_WORK", 9)
    answer = find_passages(one, other, GIVEN)
    assert answer.status is Status.UNKNOWN
    assert {each.prop.id for each in answer.passages} <= RESTING_ON_GRANTS
    assert {each.reason for each in answer.passages} == {"too many enclaves differ for all states between to be asked"}
