"""Updates in any order through the real Analyzer, to which it is left which enclaves carry which files."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.export import commands
from keystore_audit.engine.alloy.facts import CONSISTENCY, facts
from keystore_audit.engine.native import NativeEngine
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.comparison.mixed import RollOut
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import claimed_systems
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.properties import PROPERTIES, Status
from tests.amount import tried
from tests.engine.alloy_batch import outcomes, shipped
from tests.model.comparing import AT, Store, authority
from tests.test_rolling import GIVEN, changing, some_stores, states

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]


def may(keystore: Keystore) -> System:
    """As the first profile reads it."""
    accesses = GIVEN.accesses(keystore)
    about = keystore, GIVEN.profiles[:1], AT, accesses, Usabilities(None, accesses), {}, ()
    return claimed_systems(*about)[0][0]


def left_free(text: str, differing: list[str]) -> tuple[str, str]:
    """Facts of both versions of all enclaves, in which one of each is there; and the scope of what may be there.

    A document of NEW is there where its enclave has it.
    """
    found, free = [], []
    for path in differing:
        old, new = (
            re.findall(rf"^-- {path}: {was}enclaves\S*\none sig (\w+) extends Enclave", text, re.MULTILINE)
            for was in ("old:", "")
        )
        document = re.findall(
            rf"^-- enclaves{path}/permissions.p7s\none sig (\w+) extends Document", text, re.MULTILINE
        )
        versions = [*old, *new]
        assert len(versions) == 2
        found.append(f"one ({' + '.join(versions)})")
        found += [f"(some {each}) iff (some {new[0]})" for each in document]
        free += [*versions, *document]
    for each in free:
        text = text.replace(f"one sig {each} ", f"lone sig {each} ")
    scope = [f"{len(re.findall(rf'sig [^ ]+ extends {each} ', text))} {each}" for each in ("Enclave", "Document")]
    return text + "\nfact Carried {\n\t" + "\n\t".join(found) + "\n}\n", ", ".join(scope)


def violated(place: Path, system: System, differing: list[str]) -> set[str]:
    """The properties that some choice violates."""
    text, scope = left_free(facts(system), differing)
    asked = commands(PROPERTIES, system).replace("for 0", f"for 0 but {scope}")
    names = {prop.predicate: prop.id for prop in PROPERTIES}
    found = outcomes(place, shipped() | {"keystore.als": text, "audit.als": asked}, names=[CONSISTENCY, *names])
    assert found[CONSISTENCY]
    return {name for predicate, name in names.items() if found[predicate]}


def kept_names(store: Store, chance: Random) -> Store:
    """Each enclave under its own name, so that no identity stays behind, and with a key of its own."""
    keys = dict(zip(store.members, chance.sample(["/k", "/x", "/y", "/z"], len(store.members)), strict=True))
    members = {path: replace(each, subject=None, key=keys[path]) for path, each in store.members.items()}
    return replace(store, members=members, identity=(authority("oneCA"),))


def test_alloy_chooses_as_the_states_say(tmp_path: Path) -> None:
    """And its choice matters: some properties fail on the way alone, others only where both versions are there."""
    on_the_way, together = set[str](), set[str]()
    for seed in range(tried(60)):
        chance, place = Random(1000 + seed), tmp_path / str(seed)
        old, new = (kept_names(each, chance) for each in some_stores(chance, 1.0))
        way = RollOut(*(GIVEN.keystore(each.write(place / name)) for each, name in ((old, "OLD"), (new, "NEW"))))
        paths = changing(old, new)
        several = [frozenset[str](), *states(old, new)]
        told = [natively(may(way.keystore([(path, path in state) for path in paths]))) for state in several]
        union = may(way.keystore([(path, is_new) for path in paths for is_new in (False, True)]))
        expected = set[str]().union(*told)
        assert violated(place, union, paths) == expected, seed
        on_the_way |= expected - told[0] - told[-1]
        together |= natively(union) - expected
    assert on_the_way
    assert together


def natively(system: System) -> set[str]:
    """The properties that it violates."""
    told = NativeEngine([system]).answers[0]
    return {prop.id for prop in PROPERTIES if told[prop.id].status is Status.VIOLATED}
