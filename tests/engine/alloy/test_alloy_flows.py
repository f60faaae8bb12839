"""Flows and claims through the real Analyzer: against enumeration by hand, and against the native engine."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine import moments
from keystore_audit.engine.alloy import claims, export
from keystore_audit.engine.alloy.facts import MODULES, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.runner import examine
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineOutOfScale
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Answer, Status
from tests.amount import tried
from tests.engine.alloy.flow_builders import THIRD, at, chain, claim
from tests.engine.alloy.flow_mutants import MUTANTS
from tests.engine.alloy.flow_questions import questions
from tests.engine.alloy_batch import decide_claims, outcomes, shipped
from tests.engine.systems import (
    LISTENER,
    TALKER,
    Builder,
    random_system,
    with_claims,
)

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy"), pytest.mark.usefixtures("resident_analyzer")]

ENOUGH = 180.0
"""Seconds for a small model on a busy machine."""


def _status(is_violated: bool) -> Status:
    return Status.VIOLATED if is_violated else Status.HOLDS


def ask(builder: Builder, asked: ClaimAtom, analyzer: Engine) -> Answer:
    system = replace(builder.system(), claims=(asked,))
    return examine([system], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)[0].answers["asked"]


def test_what_each_change_makes_of_a_claim() -> None:
    table = questions()
    asked: dict[System, list[ClaimAtom]] = {}
    for number, each in enumerate(table):
        asked.setdefault(each.builder.system(), []).append(replace(each.claim, id=str(number)))
    answers = decide_claims([replace(system, claims=tuple(about)) for system, about in asked.items()])
    found = {number: status for each in answers for number, status in each.items()}
    wrong = [
        (number, each.name, each.claim.kind, each.claim.source, each.claim.target)
        for number, each in enumerate(table)
        if found[str(number)] is not _status(each.violated)
    ]
    assert wrong == []


def test_every_change_of_the_model_changes_an_answer() -> None:
    """Each mutant of the flows is found out by one of the questions."""
    named = [each for each in questions() if each.name]
    table = {each.name: each for each in named}
    assert len(table) == len(named)
    assert set(table) == {asked for asked, _old, _new in MUTANTS.values()}
    survived = []
    for name, (asked, old, new) in MUTANTS.items():
        builder, question, expected, _name = table[asked]
        modules = shipped()
        changed = next(module for module in (*claims.MODULES, *MODULES) if old in modules[module])
        mutant = {changed: modules[changed].replace(old, new, 1)}
        [found] = decide_claims([replace(builder.system(), claims=(question,))], mutant)
        if found["asked"] is _status(expected):
            survived.append(name)
    assert survived == []


def test_a_datum_passes_nobody_whom_the_claim_names(tmp_path: Path) -> None:
    """Also where no compartment said before that there is no flow; without that condition, one is found."""
    system = replace(chain().system(), claims=(claim(at(TALKER), at(THIRD), through=(LISTENER,)),))
    modules = shipped() | {"keystore.als": facts(system), export.PATHS: export.write_paths(system, (0,))}
    assert outcomes(tmp_path, modules, export.PATHS) == {"Path0": False}
    condition = "Datum.holder in through implies"
    mutant = {"propagation.als": modules["propagation.als"].replace(condition, "no Datum implies")}
    assert outcomes(tmp_path, modules | mutant, export.PATHS) == {"Path0": True}


def narrow_grant_first() -> Builder:
    """A grant of nothing that ends at instant 3 stands before the talker's: it then becomes able to publish."""
    b = chain()
    b.grants.insert(0, replace(b.grants[0], not_after=3))
    b.rules[:] = [replace(rule, grant=rule.grant + 1) for rule in b.rules]
    return b


def test_rights_that_begin_when_a_grant_ends_violate_a_claim_until_later(analyzer: Engine) -> None:
    asked = claim(at(TALKER), at(LISTENER))
    assert ask(narrow_grant_first(), asked, analyzer).status is Status.HOLDS
    assert ask(narrow_grant_first(), replace(asked, until=3), analyzer).status is Status.HOLDS
    later = ask(narrow_grant_first(), replace(asked, until=4), analyzer)
    assert later.status is Status.VIOLATED
    native = NativeEngine([replace(narrow_grant_first().system(), claims=(replace(asked, until=4),))]).answers[0]
    assert later.moment == native["asked"].moment == 7
    stops = narrow_grant_first()
    stops.skips_grants_out_of_date = False
    assert ask(stops, replace(asked, until=4), analyzer).status is Status.HOLDS


def test_rights_that_begin_later_are_looked_at_until_the_date(analyzer: Engine) -> None:
    b = chain()
    b.grants[0] = replace(b.grants[0], not_before=4)
    asked = claim(at(TALKER), at(LISTENER))
    assert ask(b, replace(asked, until=3), analyzer).status is Status.HOLDS
    assert ask(b, replace(asked, until=4), analyzer).status is Status.VIOLATED


def test_an_ability_must_last_until_the_date(analyzer: Engine) -> None:
    b = chain()
    b.grants[0] = replace(b.grants[0], not_after=3)
    asked = claim(at(TALKER), at(LISTENER), Attacker.HONEST, kind=ClaimKind.ABLE)
    assert ask(b, replace(asked, until=3), analyzer).status is Status.HOLDS
    assert ask(b, replace(asked, until=4), analyzer).status is Status.VIOLATED


def test_a_system_at_a_later_moment_is_what_the_native_engine_says_of_that_moment() -> None:
    """Statuses of all properties at every moment, with the moment made an instant of the facts or taken as a number."""
    for seed in range(tried(150)):
        system = with_claims(random_system(seed), seed)
        system = replace(system, claims=tuple(replace(each, until=None) for each in system.claims))
        for moment in range(2 * system.now, 2 * len(system.instants)):
            then = {i: a.status for i, a in NativeEngine([moments.at(system, moment)]).answers[0].items()}
            assert then == NativeEngine([system]).statuses(moment)[0], (seed, moment)


def test_too_many_dates_are_out_of_scale() -> None:
    b = chain()
    b.rules.clear()
    system = replace(b.system(), claims=(claim(at(TALKER), at(THIRD), until=4),))
    many = replace(
        system,
        instants=tuple(system.instants[0].replace(year=2020 + number) for number in range(60)),
        grants=tuple(replace(system.grants[0], not_before=0, not_after=n) for n in range(3, 50)),
        claims=(replace(system.claims[0], until=59),),
    )
    nowhere = Path("/nonexistent")
    with pytest.raises(EngineOutOfScale, match="date of a claim"):
        examine([many], java=nowhere, jar=nowhere, timeout=1)


def test_an_exported_model_holds_claims_and_their_paths(tmp_path: Path) -> None:
    system = replace(chain().system(), claims=(claim(at(TALKER), at(THIRD)),))
    modules = shipped()
    modules |= {"keystore.als": facts(system), "audit.als": export.commands((), system, window=True)}
    assert outcomes(tmp_path, modules)["Claim0"] is False
    modules[export.PATHS] = export.write_paths(system, (0,))
    assert outcomes(tmp_path, modules, export.PATHS) == {"Path0": True}
