"""Observational determinism: two runs in Alloy against every pair of states, and against runs in the plainest way."""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine import native_determinism
from keystore_audit.engine.alloy.determinism import (
    CERTAIN,
    MAIN,
    MODULE,
    PERHAPS,
    SHOWN,
    decide,
    write_behaviour,
)
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import Analyzer
from keystore_audit.engine.native_determinism import answer, explore
from keystore_audit.errors import EngineFailed, EngineTimeout
from keystore_audit.findings import Location
from keystore_audit.model.formal.asked import Behaviour, DeterminismAtom, Differs, Scheduler
from keystore_audit.properties.result import Answer, Round, Status
from tests.amount import tried
from tests.engine.alloy_batch import outcomes
from tests.engine.behaviours import (
    Run,
    behaviour,
    deterministic,
    deterministic_freely,
    multiplexer,
    next_runs,
    random_behaviour,
)
from tests.engine.systems import healthy

ANY, PRIORITY = Scheduler.ANY, Scheduler.PRIORITY
SAME, MAYBE, OTHER = Differs.NEVER, Differs.PERHAPS, Differs.ALWAYS

RELAY = behaviour(2, [(PRIORITY, (0,), (1,))], [(0, SAME)], [1])
"""One topic to another."""

RACE = behaviour(2, [(PRIORITY, (0,), (1,))], [(0, SAME), (0, SAME)], [1])
"""Two who publish on one topic: which sample is the newer one is up to the network."""

TWO_GATES = behaviour(4, [(PRIORITY, (0,), (1,)), (PRIORITY, (2,), (3,))], [(0, SAME), (2, OTHER)], [1])
"""A node that passes on what is high and what is not, each its own way: data could go over, and does not."""

DETOUR = behaviour(3, [(PRIORITY, (0,), (1,)), (ANY, (0, 1), (2,))], [(0, SAME)], [2])
"""One source, and two ways to the same node: a sample and the one before it wait at once."""

CYCLE = behaviour(3, [(PRIORITY, (0, 1), (2,)), (PRIORITY, (2,), (1,))], [(0, SAME)], [2])
"""What a node publishes comes back to it."""

STARVED = behaviour(2, [(PRIORITY, (0,), (1,))], [(1, SAME)], [0])
"""Nothing ever comes to what is low."""

EXAMPLES = {
    "relay": (RELAY, Status.HOLDS),
    "race": (RACE, Status.VIOLATED),
    "two gates": (TWO_GATES, Status.HOLDS),
    "detour": (DETOUR, Status.VIOLATED),
    "cycle": (CYCLE, Status.HOLDS),
    "starved": (STARVED, Status.UNKNOWN),
    "fixed priority": (multiplexer(PRIORITY), Status.HOLDS),
    "arrival decides": (multiplexer(ANY), Status.VIOLATED),
    "high input": (multiplexer(PRIORITY, second=OTHER), Status.VIOLATED),
    "undeclared node on the way": (multiplexer(PRIORITY, second=MAYBE), Status.UNKNOWN),
    "undeclared, but decided anyhow": (multiplexer(ANY, second=MAYBE), Status.VIOLATED),
}


def claim(*behaviours: Behaviour, undecided: str = "") -> DeterminismAtom:
    location = Location(path="settings.toml", beside=True)
    return DeterminismAtom(id="asked", behaviours=behaviours, undecided=undecided, location=location)


def modules(**changed: tuple[str, str]) -> dict[str, str]:
    """The shipped module, with changes (any name) of one text for another."""
    text = (resources.alloy() / MODULE).read_text()
    for before, after in changed.values():
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    return {MODULE: text}


def in_alloy(directory: Path, asked: Behaviour, beyond: int = 0, **changed: tuple[str, str]) -> dict[str, bool]:
    """What each command finds; `beyond`: so many rounds more than are needed."""
    steps = max(explore(asked, perhaps=False).depth, explore(asked, perhaps=True).depth) + 1 + beyond
    return outcomes(directory, {**modules(**changed), MAIN: write_behaviour(asked, steps)}, MAIN)


def natively(asked: Behaviour) -> dict[str, bool]:
    certain, free = explore(asked, perhaps=False), explore(asked, perhaps=True)
    assert certain.complete
    assert free.complete
    return {SHOWN: certain.shows, CERTAIN: bool(certain.rounds), PERHAPS: bool(free.rounds)}


def told(asked: Behaviour, rounds: tuple[Round, ...]) -> bool:
    """Whether these are two possible runs with the same inputs, that differ in the last round and no earlier one."""
    inputs, free = len(asked.inputs), asked.free(perhaps=False)
    empty: Run = (None,) * len(asked.slots)
    states = {(empty, empty)}
    for number, both in enumerate(rounds, 1):
        one, other = both
        if any(one[n] != other[n] for n in range(inputs) if n not in free):
            return False
        if any(one[n] != other[n] for n in asked.seen()) != (number == len(rounds)):
            return False
        states = {
            (after, then)
            for mine, yours in states
            for (sent, after), (said, then) in product(
                next_runs(asked, mine, one[:inputs]), next_runs(asked, yours, other[:inputs])
            )
            if (sent, said) == (one, other)
        }
    return bool(states)


@pytest.mark.usefixtures("resident_analyzer")
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_engines_decide_examples(name: str, analyzer: Engine) -> None:
    asked, expected = EXAMPLES[name]
    system = replace(healthy(), determinism=(claim(asked),))
    given = Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=512)
    in_process = decide([system], given)[0]["asked"]
    native = answer(claim(asked))
    assert (in_process.status, native.status) == (expected, expected)
    if expected is Status.VIOLATED:
        assert told(asked, in_process.rounds)
        assert told(asked, native.rounds)
        assert len(in_process.rounds) == len(native.rounds)


@pytest.mark.parametrize("block", range(tried(6, 2)))
def test_the_engines_agree_on_random_behaviours(block: int, tmp_path: Path) -> None:
    kinds: Counter[tuple[bool, ...]] = Counter()
    for seed in range(20 * block, 20 * block + 20):
        asked = random_behaviour(seed)
        expected = natively(asked)
        found = in_alloy(tmp_path, asked)
        if expected[CERTAIN]:  # then the search ends before all is seen
            found[SHOWN] = expected[SHOWN]
        assert (seed, found) == (seed, expected)
        kinds[expected[SHOWN], expected[CERTAIN]] += 1
    assert kinds[True, False]
    assert kinds[True, True]


@pytest.mark.parametrize("seed", range(1000, 1000 + tried(10)))
def test_more_rounds_show_no_more(seed: int, tmp_path: Path) -> None:
    asked = random_behaviour(seed)
    if not natively(asked)[CERTAIN]:
        assert in_alloy(tmp_path, asked, beyond=3) == natively(asked)


def test_the_native_engine_agrees_with_plain_runs() -> None:
    """Every pair of states by hand, for 300 random behaviours."""
    for seed in range(2000, 2000 + tried(300)):
        asked = random_behaviour(seed)
        for perhaps in (False, True):
            found = explore(asked, perhaps=perhaps)
            assert deterministic(asked, asked.free(perhaps=perhaps), 2) is not bool(found.rounds), seed
            if found.rounds and not perhaps:
                assert told(asked, found.rounds), seed


def test_two_values_are_enough() -> None:
    for seed in range(3000, 3000 + tried(40)):
        asked = random_behaviour(seed)
        if len(asked.slots) <= 2:
            free = asked.free(perhaps=True)
            assert deterministic(asked, free, 3) is deterministic(asked, free, 2), seed


@pytest.mark.parametrize("differs", Differs)
def test_more_inputs_of_a_kind_show_no_more(differs: Differs) -> None:
    """The model has at most two that are alike (`model.claims.forwarding`)."""
    for scheduler, sources in product(Scheduler, [(0,), (0, 1)]):
        for rest in ([], [(1, SAME)], [(1, OTHER)]):
            few = 1 if differs is OTHER else 2

            def made(count: int, rest: list[tuple[int, Differs]] = rest) -> Behaviour:
                return behaviour(3, [(scheduler, sources, (2,))], [(0, differs)] * count + rest, [2])  # noqa: B023

            for perhaps in (False, True):
                fewer, more = (explore(made(count), perhaps=perhaps) for count in (few, few + 1))
                assert bool(fewer.rounds) is bool(more.rounds)


KEPT = behaviour(4, [(ANY, (2,), (0, 3)), (PRIORITY, (3, 0), (2,))], [(0, SAME)], [0])

CHANGES = {
    "inputs need not be the same": ("all input: Input - free |", "all input: none & Input |", RELAY),
    "no difference in inputs": (
        "all input: Input - free |",
        "all input: Input |",
        EXAMPLES["undeclared node on the way"][0],
    ),
    "priority does not count": (
        "no slot.behind & ready[side]",
        "some Slot or no slot.behind & ready[side]",
        EXAMPLES["fixed priority"][0],
    ),
    "nothing is kept": ("= (slot - side.taken).(side.waiting)", "= none", KEPT),
    "what is taken stays": ("(slot - side.taken).(side.waiting)", "slot.(side.waiting)", KEPT),
    "one writer always is the newest": ("has in came", "has = (One in came implies One else came)", RACE),
    "nothing is forwarded": ("(of.forward & side.taken).(side.waiting)", "none", RACE),
    "nobody need act": ("some of.forward & ready[side] implies one", "lone", RELAY),
    "what waits at first is anything": ("\tno waiting\n", "\tLeft.waiting = Right.waiting\n", CYCLE),
    "only topics that are not low are seen": ("{ on.Low }", "{ on.(Topic - Low) }", RACE),
}
"""Changes of the module, and the behaviour of which each must change an answer."""


@pytest.mark.parametrize("change", CHANGES)
def test_each_line_of_the_module_counts(change: str, tmp_path: Path) -> None:
    before, after, asked = CHANGES[change]
    assert in_alloy(tmp_path, asked, 1, change=(before, after)) != in_alloy(tmp_path, asked, 1)


def test_any_system_within_a_scope_is_a_model(tmp_path: Path) -> None:
    """Without atoms of a main file: where nobody chooses and no slot has two writers, everything is decided."""
    text = """\
module theorem
open determinism
run SomethingIsLeftOpen {
	no InAnyOrder
	all slot: Slot | one reaches.slot
	all disj slot, other: Slot | slot.of = other.of implies (slot in other.behind iff other not in slot.behind)
	two_runs[none] and eventually not alike
} for 2 but 1..3 steps
run Differs { two_runs[none] and eventually not alike } for 2 but 1..3 steps
"""
    found = outcomes(tmp_path, {**modules(), "theorem.als": text}, "theorem.als")
    assert found == {"SomethingIsLeftOpen": False, "Differs": True}


def test_what_is_too_much_is_unknown_in_both(analyzer: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_determinism, "MAX_PAIRS", 2000)
    monkeypatch.setattr(native_determinism, "MAX_DEPTH", 3)
    wide = behaviour(6, [(PRIORITY, tuple(range(5)), (5,))], [(n, SAME) for n in range(5)], [5])
    long = behaviour(6, [(PRIORITY, (n,), (n + 1,)) for n in range(5)], [(0, SAME)], [5])
    assert not explore(wide, perhaps=False).complete
    assert not explore(long, perhaps=False).complete
    assert explore(long, perhaps=False).depth == 4
    system = replace(healthy(), determinism=(claim(RELAY, wide),))
    given = Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=512)
    assert decide([system], given)[0]["asked"] == answer(claim(RELAY, wide)) == unknown()


def unknown() -> Answer:
    return Answer(status=Status.UNKNOWN)


def test_what_cannot_be_said_is_unknown_and_nothing_is_started() -> None:
    system = replace(healthy(), determinism=(claim(undecided="it depends"), replace(claim(), id="none")))
    nowhere = Analyzer(java=Path("/nonexistent"), jar=Path("/nonexistent"), timeout=1, memory_mb=1)
    found = decide([system], nowhere)[0]
    assert {each.status for each in found.values()} == {Status.UNKNOWN}
    assert {answer(asked).status for asked in system.determinism} == {Status.UNKNOWN}


def test_a_solver_that_does_not_answer_is_no_answer(
    analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = replace(healthy(), determinism=(claim(RACE),))
    with pytest.raises(EngineTimeout):
        decide([system], Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=0.05, memory_mb=512))
    folder = tmp_path / "alloy"
    folder.mkdir()
    given = Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=512)
    wrong = modules(change=("pred alike {", "pred alike { {"))[MODULE]
    never = modules(change=("{ watched <: Left.sent = watched <: Right.sent }", "{ no Run }"))[MODULE]
    monkeypatch.setattr(resources, "alloy", lambda: folder)
    with pytest.raises(EngineFailed, match="incomplete"):
        decide([system], given)
    (folder / MODULE).write_text(wrong)
    with pytest.raises(EngineFailed, match=MODULE):
        decide([system], given)
    (folder / MODULE).write_text(never)
    with pytest.raises(EngineFailed, match="no difference"):
        decide([replace(healthy(), determinism=(claim(RELAY),))], given)


def test_names_stand_in_comments_alone() -> None:
    text = write_behaviour(replace(RELAY, topics=("rt/x\n} check Evil { none }", "rt/*/--")), 3)
    for line in text.splitlines():
        assert "Evil" not in line or line.startswith("--")


IN_ITS_OWN_TIME = (
    "some of.forward & ready[side] implies one of.forward & side.taken",
    "lone of.forward & side.taken",
)
"""What lets a forward rest for a round."""

FIRST_ALIKE = """
pred first[side: Run, writer: Writer, value: Value] { no side.sent[writer] until side.sent[writer] = value }

check FirstAlike {
	two_runs[none] implies no writer: watched, disj said, told: Value |
		first[Left, writer, said] and first[Right, writer, told]
} for 0 but 1..5 steps
"""


def is_forwarded(asked: Behaviour) -> bool:
    """Whether a forward ever shows something on a low topic."""
    low = {len(asked.inputs) + n for n, each in enumerate(asked.forwards) if each.targets & asked.low}
    states, before = {(None,) * len(asked.slots)}, set[Run]()
    while states != before:
        before = {*states}
        for state, came in product(before, product((None, 0), repeat=len(asked.inputs))):
            for sent, after in next_runs(asked, state, came):
                if any(sent[writer] is not None for writer in low):
                    return True
                states.add(after)
    return False


@pytest.mark.parametrize("name", EXAMPLES)
def test_no_forward_is_deterministic_in_its_own_time(name: str, tmp_path: Path) -> None:
    """A sample that comes while it rests replaces the one before: Alloy, and all runs of three rounds, say so."""
    asked, _expected = EXAMPLES[name]
    asked = replace(asked, inputs=tuple(replace(each, differs=SAME) for each in asked.inputs))
    assert deterministic_freely(asked, frozenset(), 3) != is_forwarded(asked)
    files = {**modules(rests=IN_ITS_OWN_TIME), MAIN: write_behaviour(asked, 5) + FIRST_ALIKE}
    assert outcomes(tmp_path, files, MAIN)["FirstAlike"] == is_forwarded(asked)
    in_rounds = outcomes(tmp_path, {**modules(), MAIN: write_behaviour(asked, 5) + FIRST_ALIKE}, MAIN)
    assert in_rounds["FirstAlike"] <= natively(asked)[CERTAIN]


def test_what_no_forward_shows_is_the_same_in_rounds_and_without() -> None:
    """Of random behaviours: with nothing shown but inputs, both answers are one; else no free one holds."""
    kinds = Counter[bool]()
    for seed in range(tried(40)):
        asked = random_behaviour(seed)
        if len(asked.slots) > 2 or len(asked.inputs) > 2:
            continue
        free = asked.free(perhaps=False)
        freely = deterministic_freely(asked, free, 3)
        assert freely == (not is_forwarded(asked) and deterministic(asked, free, 2)), seed
        kinds[freely] += 1
    assert kinds[True]
    assert kinds[False]
