"""Updates in any order through the real Analyzer, to which it is left which enclaves carry which files."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy import rolling
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import Analyzer
from keystore_audit.engine.alloy.rolling import failing
from keystore_audit.engine.engines import Engines
from keystore_audit.engine.native import NativeEngine
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.comparison.mixed import RollOut
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import stated_systems
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import EngineStatus, RollingAnswer
from keystore_audit.rolling import choice, find_passages
from tests.amount import tried
from tests.keystore.documents import pub
from tests.model.comparing import Store, authority
from tests.test_rolling import (
    CLAIMS,
    GIVEN,
    X_IDLE,
    X_WRITES,
    Y_IDLE,
    Y_READS,
    changing,
    grants,
    some_stores,
    states,
    stores,
)

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]


def may(keystore: Keystore) -> System:
    """As the first profile reads it."""
    about = keystore, GIVEN.profiles[:1], GIVEN.at, GIVEN.accesses(keystore), None, CLAIMS
    return stated_systems(*about, checked=False)[0]


def kept_names(store: Store, chance: Random) -> Store:
    """Each enclave under its own name, so that no identity stays behind, and with a key of its own."""
    keys = dict(zip(store.members, chance.sample(["/k", "/x", "/y", "/z"], len(store.members)), strict=True))
    members = {path: replace(each, subject=None, key=keys[path]) for path, each in store.members.items()}
    return replace(store, members=members, identity=(authority("oneCA"),))


@pytest.mark.usefixtures("resident_analyzer")
def test_alloy_chooses_as_the_states_say(tmp_path: Path, analyzer: Engine) -> None:
    """And its choice matters: some properties fail on the way alone, others only where both versions are there."""
    given = Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=512)
    on_the_way, together = set[str](), set[str]()
    for seed in range(tried(30)):
        chance, place = Random(1000 + seed), tmp_path / str(seed)
        old, new = (kept_names(each, chance) for each in some_stores(chance, 1.0))
        way = RollOut(*(GIVEN.keystore(each.write(place / name)) for each, name in ((old, "OLD"), (new, "NEW"))))
        paths = changing(old, new)
        several = [frozenset[str](), *states(old, new)]
        told = [natively(may(way.keystore([(path, path in state) for path in paths]))) for state in several]
        union = may(way.keystore([(path, is_new) for path in paths for is_new in (False, True)]))
        expected = set[str]().union(*told)
        assert failing([choice(way, union)], given) == [expected], seed
        on_the_way |= expected - told[0] - told[-1]
        together |= natively(union) - expected
    assert on_the_way
    assert together


def both(old: Store, new: Store, place: Path, choice: str = "both") -> RollingAnswer:
    """What both engines say of the way, about each claim."""
    paths = (each.write(place / name) for each, name in ((old, "OLD"), (new, "NEW")))
    return find_passages(*paths, GIVEN, CLAIMS, Engines(choice=choice, offline=True))


OLD, NEW = stores(x=X_WRITES, y=Y_IDLE), stores(x=X_IDLE, y=Y_READS)
"""An old right and a new one make a flow; by itself neither does."""


@pytest.mark.usefixtures("resident_analyzer")
def test_both_engines_are_asked_and_agree(tmp_path: Path) -> None:
    found = both(OLD, NEW, tmp_path / "flow")
    assert (found.status, {each.status for each in found.engines}) == (Status.VIOLATED, {EngineStatus.OK})
    assert found.natively_alone == ("able",)
    assert {each.prop.id for each in found.passages} >= {CLAIMS[0].id}
    still = both(OLD, OLD.member("/y", permissions=grants("/y", pub("rt/a"))), tmp_path / "none")
    assert CLAIMS[0].id not in {each.prop.id for each in still.passages}
    assert {each.reason for each in still.passages} <= {""}


@pytest.mark.usefixtures("resident_analyzer")
@pytest.mark.parametrize("every", [True, False])
def test_engines_that_disagree_leave_it_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: bool) -> None:
    """As if Alloy found that everything fails, or nothing."""
    names = frozenset((*BY_ID, *(each.id for each in CLAIMS))) if every else frozenset[str]()
    monkeypatch.setattr(rolling, "failing", lambda choices, _analyzer: [names for _each in choices])
    found = both(OLD, NEW, tmp_path)
    apart = [each.prop.id for each in found.passages if each.reason == "the engines disagree"]
    assert apart == [each for each in (*BY_ID, *(claim.id for claim in CLAIMS)) if each in apart]
    assert found.status is Status.UNKNOWN
    assert (CLAIMS[0].id in apart) != every
    assert ("sensitive-topics-are-encrypted" in apart or len(apart) > 5) == every


@pytest.mark.parametrize(("choice", "status"), [("both", Status.UNKNOWN), ("auto", Status.VIOLATED)])
def test_identities_that_stay_behind_are_not_asked_about(tmp_path: Path, choice: str, status: Status) -> None:
    found = both(OLD, NEW.member("/x", subject="/n"), tmp_path, choice)
    assert [each.status for each in found.engines] == [EngineStatus.OK, EngineStatus.OUT_OF_SCALE]
    assert found.status is status


def natively(system: System) -> set[str]:
    """The properties and claims that it violates; ability apart."""
    told = NativeEngine([system]).answers[0]
    return {name for name, each in told.items() if each.status is Status.VIOLATED and name != "able"}
