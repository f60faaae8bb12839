"""Whether anything fails while enclaves are updated one by one, in any order: `diff OLD NEW --rolling`."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import combinations, islice, product
from typing import TYPE_CHECKING, Final

from keystore_audit.assumptions import Assumption
from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import NATIVELY, Engines, ask_alloy, combine, combine_claims, readings_of
from keystore_audit.engine.native import NativeEngine, shared_identities, shared_subjects
from keystore_audit.engine.needs import with_sessions
from keystore_audit.errors import BudgetExceeded, EngineOutOfScale
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.comparison.mixed import RollOut, Version
from keystore_audit.model.comparison.sides import BEFORE
from keystore_audit.model.formal.asked import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import stated_systems
from keystore_audit.properties import Answer, Property, Role, Status, Witness, stated
from keystore_audit.properties.result import Passage, PropertyResult, RollingAnswer

if TYPE_CHECKING:
    from keystore_audit.engine.alloy.install import Engine
    from keystore_audit.engine.alloy.rolling import Choice

MAX_WORK: Final = 3_000
"""Enclaves that differ, over the states that are asked one by one, and over as many others: a quarter of a minute."""

MAX_TRIED: Final = 300
"""States that are tried for the fewest updated enclaves with whom a property fails that fails for good."""

RESTING_ON_GRANTS: Final = {
    stated.NOBODY_WRITES_WITHOUT_A_GRANT.id,
    stated.NOBODY_READS_WITHOUT_A_GRANT.id,
    stated.READERS_CANNOT_FORGE.id,
    stated.RELAYS_CANNOT_READ.id,
}
"""Properties that another document may make hold: what it grants is no violation any more."""

_MISMATCH: Final = "endpoints under different governances might not match (KA416), and those of OLD and NEW differ"

State = frozenset[Version]
"""Which enclaves carry which files; those of which nothing is said are not there."""


def find_passages(
    old: str | os.PathLike[str],
    new: str | os.PathLike[str],
    given: Circumstances,
    claims: Sequence[Claim] = (),
    engines: Engines | None = None,
) -> RollingAnswer:
    """What fails on the way from the keystore at `old` to that at `new`, or in that, of all properties and the claims.

    `engines`: the native one finds what fails first; Alloy, if it is asked, whether anything does at all.

    Raises errors.NothingToAudit, errors.UsageError for a claim of what is not in both, and errors.BudgetExceeded where
    there are too many classes of names.
    """
    before, after = given.keystore(old), given.keystore(new)
    way = RollOut(before, after)
    states = _States(way, given, claims)
    was, becomes = (states.results(each, checked=True) for each in (before, after))
    passages = [each for name in becomes for each in states.passages(was[name], becomes[name])]
    runs, alone = [NATIVELY], frozenset[str]()
    if engines is not None and engines.choice != "native":
        run, told = ask_alloy(lambda engine: (states.asked_of_alloy(engine, engines), None), engines, None)
        runs.append(run)
        if told is not None:
            alone = frozenset(each.id for each in claims if each.kind is ClaimKind.ABLE or each.until is not None)
            passages += _disagreements(was, becomes, passages, told, alone)
    return RollingAnswer(
        old=before,
        new=after,
        at=given.at,
        profiles=given.names,
        changing=way.changing,
        passages=tuple(passages),
        engines=tuple(runs),
        natively_alone=tuple(sorted(alone)),
    )


def _disagreements(
    was: Mapping[str, PropertyResult],
    becomes: Mapping[str, PropertyResult],
    passages: Sequence[Passage],
    told: Mapping[str, frozenset[str]],
    alone: Collection[str],
) -> Iterator[Passage]:
    """Of what holds in OLD and in NEW, that of which one engine alone says that it fails between; not of `alone`.

    `told`: by profile, what Alloy says fails.
    """
    failing = {(each.prop.id, profile) for each in passages for profile in each.profiles}
    undecided = {each.prop.id for each in passages if each.status is Status.UNKNOWN}
    for name in (each for each in becomes if each not in undecided.union(alone)):
        staying = {*_under(was[name], Status.HOLDS)}.intersection(_under(becomes[name], Status.HOLDS))
        if apart := sorted(each for each in staying if (name in told[each]) != ((name, each) in failing)):
            yield Passage(prop=becomes[name].prop, profiles=tuple(apart), reason="the engines disagree")


def _under(result: PropertyResult, status: Status) -> list[str]:
    """The profiles under which that is the answer."""
    return [name for name, each in result.profiles.items() if each.status is status]


def choice(way: RollOut, system: System) -> Choice:
    """What is free on the way in the system of all versions of all enclaves.

    Raises errors.EngineOutOfScale where identities would come and go with enclaves, or an enclave is there twice.
    """
    from keystore_audit.engine.alloy.rolling import Choice

    sides = {(each.label, each.location.path.startswith(BEFORE)): n for n, each in enumerate(system.enclaves)}
    if len(sides) < len(system.enclaves) or way.leaves_identities or any(each.unmanaged for each in system.enclaves):
        raise EngineOutOfScale("Identities without an enclave are not asked about here.")
    versions = [[sides[path, old] for old in (True, False) if (path, old) in sides] for path in way.changing]
    new = frozenset(sides[path, False] for path in way.changing if (path, False) in sides)
    return Choice(system, versions, new, way.added)


class _States:
    """What the states on the way say, each asked once.

    Most properties are violated by what is there, so more enclaves and documents never make them hold. What all
    versions of all enclaves together do not violate, no state does (docs/model.md). About the others each is asked.
    """

    def __init__(self, way: RollOut, given: Circumstances, claims: Sequence[Claim]) -> None:
        self._way, self._given, self._claims = way, given, claims
        self._others = {*RESTING_ON_GRANTS, *(each.id for each in claims if each.kind is not ClaimKind.NO_FLOW)}
        self._able = {each.id for each in claims if each.kind is ClaimKind.ABLE}
        self._done = frozenset((path, True) for path in way.changing)
        self._every = frozenset(product(way.changing, (False, True)))
        self._known: dict[State, Mapping[str, PropertyResult]] = {}

    def results(self, keystore: Keystore, *, checked: bool) -> Mapping[str, PropertyResult]:
        """Every property and claim, natively. `checked`: as `claimed_systems`."""
        given, claims = self._given, self._claims
        systems, assumed = self._systems(keystore, checked=checked)
        told = NativeEngine(systems).answers
        answers = {"native": [_of_versions(*each) for each in zip(systems, told, strict=True)]}
        asserted = with_sessions(claims, combine_claims(claims, systems, answers, given.names), assumed)
        return {each.prop.id: each for each in (*combine(systems, answers, given.names), *asserted)}

    def _systems(self, keystore: Keystore, *, checked: bool) -> tuple[Sequence[System], Collection[Assumption]]:
        """How the implementations read the keystore, and what is taken for granted of it."""
        accesses = self._given.accesses(keystore)
        about = keystore, self._given.profiles, self._given.at, accesses, self._given.domain, self._claims
        return stated_systems(*about, checked=checked), accesses.assumed

    def asked_of_alloy(self, engine: Engine, engines: Engines) -> Mapping[str, frozenset[str]]:
        """By profile, what fails in some state, as Alloy says. Raises EngineError."""
        from keystore_audit.engine.alloy.rolling import failing
        from keystore_audit.engine.alloy.runner import analyzer_of

        systems, _assumed = self._systems(self._way.keystore(self._every), checked=False)
        with analyzer_of(engine, engines.timeout) as analyzer:
            told = failing([choice(self._way, each) for each in systems], analyzer)
        return {
            name: frozenset[str]().union(*(told[number] for number in readings_of(systems, name)))
            for name in self._given.names
        }

    def passages(self, was: PropertyResult, becomes: PropertyResult) -> Iterator[Passage]:
        """Where a property fails that `becomes` so in NEW, and under some profiles `was` so in OLD."""
        prop, left, staying = becomes.prop, _under(becomes, Status.HOLDS), _under(was, Status.HOLDS)
        if unknown := sorted({name for each in (was, becomes) for name in _under(each, Status.UNKNOWN)}):
            yield Passage(prop=prop, profiles=tuple(unknown), reason="unknown in OLD or in NEW")
        if lost := [name for name in _under(becomes, Status.VIOLATED) if name in staying]:
            example = becomes.profiles[lost[0]].counterexample
            reason = "it holds in OLD and not in NEW"
            yield Passage(prop=prop, status=Status.VIOLATED, profiles=tuple(lost), example=example, reason=reason)
        if left and self._way.governances_differ and prop.id in self._able:
            yield Passage(prop=prop, profiles=tuple(left), reason=_MISMATCH)
            return

        def fails(state: State) -> bool:
            return self._state(state)[prop.id].profiles[left[0]].status is not Status.HOLDS

        try:
            while left and self._done:
                gone: Collection[str] = left[:1]
                lasting = fails(self._done)
                core = self._core_of(prop.id, fails, lasting=lasting) if lasting or left[0] in staying else None
                if core is not None:
                    under = tuple(each for each in left if lasting or each in staying)
                    found = self._told(prop, under, core, lasting=lasting)
                    yield found
                    gone = found.profiles
                left = [each for each in left if each not in gone]
        except BudgetExceeded as exceeded:
            yield Passage(prop=prop, profiles=tuple(left), reason=exceeded.message)

    def _core_of(self, name: str, fails: Callable[[State], bool], *, lasting: bool) -> State | None:
        """With which versions the property fails first, none of which can be left out; None: in no state."""
        if lasting or name in self._others:
            several = islice(self._each_state(), MAX_TRIED if lasting else None)
            return next(filter(fails, several), self._done if lasting else None)
        return self._core(fails, self._every)

    def _core(self, fails: Callable[[State], bool], versions: State) -> State | None:
        """Some of the versions, one at most of each enclave, with whom it fails; none of them can be left out."""
        if not fails(versions):
            return None
        core = versions
        for each in sorted(versions):
            if fails(core - {each}):
                core -= {each}
        twice = sorted(path for path, is_new in core if is_new and (path, False) in core)
        if not twice:
            return core
        without = (self._core(fails, versions - {(twice[0], is_new)}) for is_new in (False, True))
        return next(filter(None, without), None)

    def _each_state(self) -> Iterator[State]:
        """All states on the way, those with the fewest updated enclaves first. Raises errors.BudgetExceeded."""
        done = sorted(self._done)
        several = (each for size in range(1, len(done)) for each in combinations(done, size))
        yield from map(self._completed, islice(several, MAX_WORK // len(done)))
        if next(several, None):
            raise BudgetExceeded("too many enclaves differ for all states between to be asked")

    def _completed(self, versions: Collection[Version]) -> State:
        """The state in which all other enclaves are not updated."""
        return frozenset((path, (path, True) in versions) for path in self._way.changing)

    def _state(self, state: State) -> Mapping[str, PropertyResult]:
        """What the enclaves of the state say. Raises errors.BudgetExceeded where others were asked too often."""
        if state not in self._known:
            if len(self._known) * len(self._done) > 2 * MAX_WORK:
                raise BudgetExceeded("too many states would have to be asked")
            self._known[state] = self.results(self._way.keystore(state), checked=False)
        return self._known[state]

    def _told(self, prop: Property, under: Sequence[str], core: State, *, lasting: bool) -> Passage:
        """What a state says that has these versions, under the first profile and those like it."""
        state = self._done if lasting else self._completed(core)
        first, results = (self._state(each)[prop.id].profiles for each in (self._completed(core), state))
        here = results[under[0]]
        alike = (first[under[0]].status, here)
        places = {step.path for step in here.counterexample.steps} if here.counterexample else ()
        used = (each.document for each in self._way.keystore(state).unmanaged if each.place in places)
        ends = (
            max((g.not_after.text for g in each.grants), default="")
            for each in used
            if isinstance(each, PermissionsFile)
        )
        return Passage(
            prop=prop,
            status=Status.UNKNOWN if here.status is Status.HOLDS else here.status,  # it may, by fewer enclaves alone
            profiles=tuple(each for each in under if (first[each].status, results[each]) == alike),
            updated=tuple(sorted(path for path, is_new in core if is_new)),
            waiting=tuple(sorted(path for path, is_new in core if not (is_new or lasting))),
            lasting=lasting,
            until=min(ends, default=None) if lasting else None,
            example=here.counterexample,
        )


def _of_versions(system: System, answers: Mapping[str, Answer]) -> Mapping[str, Answer]:
    """The answers without pairs of an enclave and itself before its update: these are one."""
    found = dict(answers)
    for prop, pairs in ((stated.NO_SHARED_IDENTITY, shared_identities), (stated.NO_SHARED_SUBJECT, shared_subjects)):
        two = tuple(islice((each for each in pairs(system) if _differ(system, each)), 1))
        found[prop.id] = Answer(status=Status.VIOLATED if two else Status.HOLDS, witnesses=two)
    return found


def _differ(system: System, pair: Witness) -> bool:
    two = (system.enclaves[pair[role]] for role in (Role.ENCLAVE, Role.OTHER))
    sides = {(each.label, each.location.path.startswith(BEFORE)) for each in two}
    return len(dict(sides)) == len(sides)
