"""Flows and claims through the real Analyzer: against enumeration by hand, and against the native engine."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy import claims, moments, paths
from keystore_audit.engine.alloy.facts import MODULES, commands, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.runner import examine
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.formal.claim import Attacker, ClaimAtom, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Answer, Status
from keystore_audit.properties.property import Role
from tests.engine.alloy.flow_builders import THIRD, at, chain, claim
from tests.engine.alloy.flow_mutants import MUTANTS
from tests.engine.alloy.flow_questions import questions
from tests.engine.alloy_batch import decide_claims, outcomes, shipped
from tests.engine.flows_by_hand import ByHand, Flow
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    Builder,
    healthy_builder,
    lively,
    random_system,
    with_claims,
)

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy"), pytest.mark.usefixtures("resident_analyzer")]

ENOUGH = 180.0
"""Seconds for a small model on a busy machine."""

PATHS = (824, 1207, 828)
"""Seeds of systems with several flows."""


def claiming(seed: int, count: int) -> System:
    return with_claims(lively(random_system(seed), seed), seed, count)


def _status(is_violated: bool) -> Status:
    return Status.VIOLATED if is_violated else Status.HOLDS


@pytest.mark.parametrize("seed", PATHS)
def test_paths_are_shortest_and_each_hop_is_one(seed: int, analyzer: Engine) -> None:
    """Systems with a dozen claims: what the trace says is checked hop by hop."""
    system = claiming(seed, 14)
    answers = examine([system], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)[0].answers
    hand = ByHand(system)
    walked = 0
    for asked in system.claims:
        if asked.kind is not ClaimKind.NO_FLOW or answers[asked.id].status is Status.HOLDS:
            assert answers[asked.id].path == ()
            continue
        flow, path = Flow(hand, asked), answers[asked.id].path
        assert len(path) == flow.shortest()
        walked += 1
        hops = {(-1 if hop.sender is None else hop.sender, hop.channel, hop.receiver) for hop in path}
        inner = path[bool(asked.source.channels) : len(path) - bool(asked.target.channels)]
        known = {(e, c, None if f == -1 else f) for e, c, f in flow.hops}
        assert {(-1 if h.sender is None else h.sender, h.channel, h.receiver) for h in inner} <= known, hops
        for before, after in pairwise(path):
            assert before.receiver == after.sender
    assert walked >= 2


def ask(builder: Builder, asked: ClaimAtom, analyzer: Engine) -> Answer:
    system = replace(builder.system(), claims=(asked,))
    return examine([system], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)[0].answers["asked"]


def test_a_flow_is_told_hop_by_hop(analyzer: Engine) -> None:
    answer = ask(chain(), claim(at(TALKER), at(THIRD)), analyzer)
    assert [(hop.sender, hop.channel, hop.receiver, hop.instant) for hop in answer.path] == [
        (TALKER, CHATTER, LISTENER, 2),
        (LISTENER, OTHER_TOPIC, THIRD, 2),
    ]
    assert answer.witnesses == ({Role.ENCLAVE: TALKER, Role.OTHER: THIRD},)


def test_the_longest_path_there_can_be_is_within_the_bound(analyzer: Engine) -> None:
    """Every enclave passes the data on to the next, and the last one back to the first."""
    b = healthy_builder()
    b.rules.clear()
    for _ in range(3):
        identity = b.certificate([IDENTITY_CA])
        document = b.document([PERMISSIONS_CA])
        b.enclave(0, identity, document)
        b.grant(document, [identity])
    ring = [CHATTER, OTHER_TOPIC, *(b.channel(0, f"rt/topic_{number}") for number in range(3))]
    b.topic_rules[0] = replace(b.topic_rules[0], channels=frozenset(ring))
    for number, channel in enumerate(ring):
        b.rule(number, [0], publish=[channel])
        b.rule((number + 1) % len(ring), [0], subscribe=[channel])
    path = ask(b, claim(at(TALKER), at(TALKER)), analyzer).path
    assert [(hop.sender, hop.receiver) for hop in path] == [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0)]


def test_what_each_change_makes_of_a_claim() -> None:
    table = questions()
    asked = [replace(each.builder.system(), claims=(each.claim,)) for each in table]
    wrong = [
        (number, each.name, each.claim.kind, each.claim.source, each.claim.target)
        for number, (each, found) in enumerate(zip(table, decide_claims(asked), strict=True))
        if found["asked"] is not _status(each.violated)
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
    modules = shipped() | {"keystore.als": facts(system), paths.MAIN: paths.write_paths(system, (0,))}
    assert outcomes(tmp_path, modules, paths.MAIN) == {"Path0": False}
    condition = "Datum.holder in through implies"
    mutant = {"propagation.als": modules["propagation.als"].replace(condition, "no Datum implies")}
    assert outcomes(tmp_path, modules | mutant, paths.MAIN) == {"Path0": True}


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
    assert [(hop.sender, hop.receiver, hop.instant) for hop in later.path] == [(TALKER, LISTENER, 3)]
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
    for seed in range(150):
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


def test_a_flow_without_a_path_is_no_answer(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The trace must confirm what the compartments say."""
    folder = tmp_path / "alloy"
    folder.mkdir()
    for module in resources.alloy().glob("*.als"):
        text = module.read_text()
        if module.name == "propagation.als":
            assert "eventually arrives" in text
            text = text.replace("eventually arrives", "no Datum.holder and eventually arrives")
        (folder / module.name).write_text(text)
    monkeypatch.setattr(resources, "alloy", lambda: folder)
    with pytest.raises(EngineFailed, match="no path"):
        ask(chain(), claim(at(TALKER), at(THIRD)), analyzer)


def test_places_and_flows_that_are_not_there_are_named(analyzer: Engine) -> None:
    nowhere = replace(chain().system(), claims=(claim(at(), at(THIRD)),))
    somewhere = replace(chain().system(), claims=(claim(at(TALKER), at(THIRD), through=(LISTENER,)),))
    silent = chain()
    silent.rules.clear()
    nothing = replace(silent.system(), claims=(claim(at(TALKER), at(THIRD)),))
    found = examine([nowhere, somewhere, nothing], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)
    assert [decision.idle & set(claims.EXERCISED) for decision in found] == [{"places"}, set(), {"flows"}]


def test_an_exported_model_holds_claims_and_their_paths(tmp_path: Path) -> None:
    system = replace(chain().system(), claims=(claim(at(TALKER), at(THIRD)),))
    modules = shipped()
    modules |= {"keystore.als": facts(system), "audit.als": commands((), system, window=True)}
    assert outcomes(tmp_path, modules)["Claim0"] is False
    modules[paths.MAIN] = paths.write_paths(system, (0,))
    assert outcomes(tmp_path, modules, paths.MAIN) == {"Path0": True}
