"""Who may fall through the real Analyzer: the sets that it finds are those of the native engine."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy import fallen
from keystore_audit.engine.alloy.facts import CONSISTENCY, facts
from keystore_audit.engine.alloy.fallen import smallest_sets, write_question
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import Analyzer
from keystore_audit.errors import EngineOutOfScale
from keystore_audit.model.formal.asked import ClaimAtom
from keystore_audit.model.formal.system import System
from tests.amount import tried
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.test_fallen import MOST, PAIRS, Sets, asked, told

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy"), pytest.mark.usefixtures("resident_analyzer")]


@pytest.fixture
def solver(analyzer: Engine) -> Analyzer:
    return Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=180, memory_mb=1024)


@pytest.mark.parametrize("name", PAIRS)
def test_one_change_flips_it(name: str, solver: Analyzer) -> None:
    builder, claim, sets = PAIRS[name]
    system = replace(builder.system(), claims=(claim,))
    assert set(smallest_sets(system, MOST, solver)) == set(map(frozenset, sets))


def there_is(place: Path, system: System, size: int, without: Sets, changed: dict[str, str] | None = None) -> bool:
    """Whether there is a set of this size at most with none of these in it."""
    modules = shipped() | {"keystore.als": facts(system), "asked.als": write_question(system, size, without)}
    found = outcomes(place, modules | (changed or {}), "asked.als")
    assert found[CONSISTENCY]
    return found["Fall"]


def disagreements(place: Path, system: System, claim: ClaimAtom, changed: dict[str, str] | None = None) -> int:
    """How many answers are not as the native sets say: without all but one of them there is that one, without all none.

    Nothing is left out where nobody need be compromised: nobody is in every set.
    """
    system = replace(system, claims=(claim,))
    sets = [each.fallen for each in told(system, claim)]
    if frozenset() in sets:
        return not there_is(place, system, 0, [], changed)
    each = [there_is(place, system, len(one), [other for other in sets if other != one], changed) for one in sets]
    return each.count(False) + there_is(place, system, MOST, sets, changed)


@pytest.mark.parametrize("several", [False, True])
def test_the_engines_find_the_same_sets(several: bool, tmp_path: Path) -> None:
    sizes = set()
    for seed in range(0, tried(45 if several else 150, 30), 3):
        for system, claim in [*asked(seed, several=several)][:2]:
            assert disagreements(tmp_path, system, claim) == 0, (seed, claim)
            sizes |= {len(each.fallen) for each in told(system, claim)}
    assert sizes >= {0, 1}


MUTANTS = {
    "nobody compromised sends": ("imposes[forgers, receiving].(usable", "imposes[none, receiving].(usable"),
    "nobody compromised listens": ("~(intercepts[eavesdroppers, sending])", "~(intercepts[Outsider, sending])"),
    "what is written by right stays": ("sends[sending, receiving].(usable", "none -> none.(usable"),
    "everybody passes on": ("(Enclave + Outsider - through) <: hop", "hop"),
    "who gets what it begins with is none": ("(source + (got - through))", "source"),
    "it never ends at a topic": ("or some each: source", "and some each: source"),
}
"""By what is wrong: the text of fallen.als, and what stands in its place."""


@pytest.mark.parametrize("name", MUTANTS)
def test_a_change_of_the_module_is_a_disagreement(name: str, tmp_path: Path) -> None:
    old, new = MUTANTS[name]
    text = shipped()["fallen.als"]
    assert text.count(old) == 1
    changed = {"fallen.als": text.replace(old, new)}
    every = [(builder.system(), claim) for builder, claim, _sets in PAIRS.values()]
    every += [case for seed in range(0, 60, 3) for case in [*asked(seed)][:2]]
    assert any(disagreements(tmp_path, system, claim, changed) for system, claim in every)


def test_too_many_are_not_asked_about(solver: Analyzer, monkeypatch: pytest.MonkeyPatch) -> None:
    builder, claim, _sets = PAIRS["a reader forges with the writer's key"]
    system = replace(builder.system(), claims=(claim,))
    monkeypatch.setattr(fallen, "MOST", len(system.enclaves))
    assert smallest_sets(system, 1, solver)
    monkeypatch.setattr(fallen, "MOST", len(system.enclaves) - 1)
    with pytest.raises(EngineOutOfScale, match="more than 2 enclaves"):
        smallest_sets(system, 1, solver)
