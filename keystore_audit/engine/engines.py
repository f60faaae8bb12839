"""Runs the engines that were asked for, and brings their answers together, failing closed.

An engine that did not answer is recorded and never counts as an answer. Readings, kinds of implementation and labels
come together here too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.assumptions import WORLD
from keystore_audit.engine.case import plainest
from keystore_audit.engine.counterexample import describe
from keystore_audit.engine.counterexample_claims import describe_claim, describe_flow
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineError, EngineMissing, EngineOutOfScale, EngineTimeout
from keystore_audit.model.claims.named import Determinism
from keystore_audit.model.claims.stated import Claim, LabelPair
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Answer, Status
from keystore_audit.properties.result import (
    AssertedResult,
    Counterexample,
    EngineRun,
    EngineStatus,
    FallResult,
    LabelResult,
    ProfileResult,
    Property,
    PropertyResult,
)
from keystore_audit.resources import in_ci

if TYPE_CHECKING:
    from keystore_audit.engine.alloy.install import Engine
    from keystore_audit.engine.native_claims import KeptFlows
    from keystore_audit.model.formal.fallen import Fall

Tell = Callable[[int, Answer], Counterexample | None]
"""Says what an answer about the system of this number means."""

Answers = Mapping[str, Sequence[Mapping[str, Answer]]]
"""By engine what it said of each system, parallel to the systems asked."""

Falls = Sequence[Sequence["Fall"]]
"""By system, the smallest sets of compromised participants that violate a claim."""


class Engines(Struct, frozen=True, kw_only=True):
    """Who decides. `choice`: both, alloy, native, or auto: both, but native alone if Alloy cannot be had at all.

    `jar`: of Alloy, None: the one installed; `offline`: it is never fetched. `timeout`: of the solver, in seconds.
    """

    choice: str = "native"
    jar: Path | None = None
    offline: bool = False
    timeout: float = 120.0


T = TypeVar("T")

Asked = tuple[T, tuple[int, int] | None]
"""What the Analyzer says, and the sizes of the largest model, as `EngineRun` has them."""


def run_engines(
    native: NativeEngine, engines: Engines, stage: Callable[[str], None] | None, *, claims: bool = False
) -> tuple[tuple[EngineRun, ...], Answers]:
    """How each engine fared with the systems of `native`, and the answers of those that answered.

    `claims`: where the native engine is asked alone, it is asked about claims alone.
    """

    def ask(engine: Engine) -> Asked[Sequence[Mapping[str, Answer]]]:
        from keystore_audit.engine.alloy.runner import examine

        expected = None if engines.choice == "alloy" else [_statuses(answers) for answers in native.answers]
        found = examine(native.systems, java=engine.java, jar=engine.jar, timeout=engines.timeout, expected=expected)
        atoms = max((decision.atoms for decision in found), key=lambda sizes: sizes[1], default=None)
        return native.checked([decision.answers for decision in found]), atoms

    alone = claims and engines.choice == "native"
    return run_asked(lambda: native.claim_answers() if alone else native.answers, ask, engines, stage)


def run_falls(
    systems: Sequence[System], most: int, engines: Engines
) -> tuple[tuple[EngineRun, ...], Mapping[str, Falls]]:
    """The same for which compromised participants, `most` of them, violate the one claim of each system."""
    from keystore_audit.engine.native_claims import fallen  # most audits have no flows

    def ask(engine: Engine) -> Asked[Falls]:
        from keystore_audit.engine.alloy.fallen import smallest_sets
        from keystore_audit.engine.alloy.runner import analyzer_of

        with analyzer_of(engine, engines.timeout) as analyzer:
            return [fallen(system, most, smallest_sets(system, most, analyzer)) for system in systems], None

    return run_asked(lambda: [fallen(system, most) for system in systems], ask, engines, None)


def run_asked(
    natively: Callable[[], T], ask: Callable[[Engine], Asked[T]], engines: Engines, stage: Callable[[str], None] | None
) -> tuple[tuple[EngineRun, ...], Mapping[str, T]]:
    """How each chosen engine fared, and what the native engine and the Analyzer answered."""
    choice = engines.choice
    runs: list[EngineRun] = []
    answers: dict[str, T] = {}
    if choice == "native":
        runs.append(_not_run("alloy", "--engine native"))
    else:
        run, found = ask_alloy(ask, engines, stage)
        runs.append(run)
        if found is not None:
            answers["alloy"] = found
    if choice == "alloy":
        runs.append(_not_run("native", "--engine alloy"))
    else:
        answers["native"] = natively()
        runs.append(NATIVELY)
    return tuple(runs), answers


def ask_alloy(
    ask: Callable[[Engine], Asked[T]], engines: Engines, stage: Callable[[str], None] | None
) -> tuple[EngineRun, T | None]:
    """Alloy's answers, or why there are none. Once it was found, or asked for by name, its failure counts."""
    from keystore_audit.engine.alloy.install import find  # a twentieth of a second, which the native engine spares

    asked = engines.choice in ("alloy", "both") or engines.jar is not None
    version: str | None = None
    try:
        engine = find(engines.jar, offline=engines.offline, ci=in_ci(), progress=stage)
        version = engine.version
        if stage:
            stage("asking the Alloy Analyzer")
        found, atoms = ask(engine)
    except EngineError as error:
        status = _FAILURES.get(type(error), EngineStatus.FAILED)
        required = asked or status in (EngineStatus.TIMEOUT, EngineStatus.FAILED)
        run = EngineRun(name="alloy", version=version, status=status, reason=error.message, required=required)
        return replace(run, atoms=error.atoms) if isinstance(error, EngineOutOfScale) else run, None
    run = EngineRun(name="alloy", version=version, status=EngineStatus.OK, reason="", required=True, atoms=atoms)
    return run, found


def _statuses(answers: Mapping[str, Answer]) -> dict[str, Status]:
    return {name: answer.status for name, answer in answers.items()}


_FAILURES: Final[dict[type[EngineError], EngineStatus]] = {
    EngineMissing: EngineStatus.MISSING,
    EngineOutOfScale: EngineStatus.OUT_OF_SCALE,
    EngineTimeout: EngineStatus.TIMEOUT,
}
"""The status for each error; any other error is a failure."""


NATIVELY: Final = EngineRun(name="native", version=None, status=EngineStatus.OK, reason="", required=True)
"""The native engine, if it was asked: it always answers."""


def _not_run(name: str, reason: str) -> EngineRun:
    return EngineRun(name=name, version=None, status=EngineStatus.NOT_RUN, reason=reason, required=False)


# What they say together.


def combine(systems: Sequence[System], engines: Answers, profiles: Sequence[str]) -> tuple[PropertyResult, ...]:
    """The result of every property under every profile.

    A status is HOLDS or VIOLATED only where at least one engine answered and all that did say so in both
    readings.
    """
    asked = AskedSystems(systems, engines, profiles)

    def told(prop: Property) -> Tell:
        return lambda at, answer: describe(systems[at], prop, plainest(systems[at], answer.witnesses))

    return tuple(PropertyResult(prop=prop, profiles=asked.by_profile(prop.id, told(prop))) for prop in PROPERTIES)


def combine_claims(
    claims: Sequence[Claim], systems: Sequence[System], engines: Answers, profiles: Sequence[str]
) -> tuple[AssertedResult, ...]:
    """The result of every claim under every profile, as for properties."""
    asked = AskedSystems(systems, engines, profiles)
    kept: dict[int, KeptFlows] = {}

    def combined(number: int, claim: Claim) -> AssertedResult:
        results = asked.by_profile(
            claim.id, lambda at, answer: describe_claim(systems[at], systems[at].claims[number], answer)
        )
        if claim.kind is ClaimKind.NO_FLOW and claim.until is not None:
            kinds = {readings_of(systems, name): each for name, each in results.items() if each.status is Status.HOLDS}
            over = {kind: _over_time(number, kind, result, systems, kept) for kind, result in kinds.items()}
            results = {name: over.get(readings_of(systems, name), result) for name, result in results.items()}
        return asserted(claim, claim.attacker.value, results)

    return tuple(combined(number, claim) for number, claim in enumerate(claims))


def combine_falls(
    claim: Claim, systems: Sequence[System], engines: Mapping[str, Falls], profiles: Sequence[str]
) -> tuple[FallResult, ...]:
    """For a claim about compromised participants, each smallest set of them that violates it, in order of size.

    Its result is under the profiles for which it is a smallest set, in some reading and to some engine. Where no
    engine answered, it is unknown whether the claim needs anybody to be compromised.
    """
    named = {
        engine: [
            {frozenset(system.enclaves[each].label for each in fall.fallen): fall for fall in found}
            for system, found in zip(systems, told, strict=True)
        ]
        for engine, told in engines.items()
    }
    every = {names for told in named.values() for found in told for names in found} if engines else {frozenset[str]()}

    def answer(found: Mapping[frozenset[str], Fall], names: frozenset[str]) -> Answer:
        legs = next((fall.legs for smallest, fall in found.items() if smallest <= names), None)
        if not legs:  # whoever says so without one is not confirmed
            return Answer(status=Status.HOLDS if legs is None else Status.UNKNOWN)
        return Answer(status=Status.VIOLATED, witnesses=({},), path=legs)

    def tell(at: int, told: Answer) -> Counterexample:
        return describe_claim(systems[at], replace(systems[at].claims[0], attacker=Attacker.RELAYS), told)

    def result(names: frozenset[str]) -> FallResult:
        answers = {engine: [{claim.id: answer(each, names)} for each in told] for engine, told in named.items()}
        found = {at for told in named.values() for at, each in enumerate(told) if names in each}
        smallest = [each for each in profiles if not engines or found.intersection(readings_of(systems, each))]
        by_profile = AskedSystems(systems, answers, smallest).by_profile(claim.id, tell)
        return tuple(sorted(names)), asserted(claim, claim.attacker.value, by_profile)

    return tuple(map(result, sorted(every, key=lambda names: (len(names), sorted(names)))))


def _over_time(
    number: int, kind: tuple[int, ...], result: ProfileResult, systems: Sequence[System], kept: dict[int, KeptFlows]
) -> ProfileResult:
    """Whether what holds at each moment also holds over all of them, since receivers may keep what they get."""
    from keystore_audit.engine.native_claims import KeptFlows  # few claims are about a time

    kept.update({at: KeptFlows(systems[at]) for at in kind if at not in kept})
    flows = {at: kept[at].flow(systems[at].claims[number]) for at in kind}
    for at, stages in flows.items():
        if stages is not None:
            status = _both_readings([Status.HOLDS if each is None else Status.VIOLATED for each in flows.values()])
            example = describe_flow(systems[at], systems[at].claims[number], stages)
            return ProfileResult(status=status, engines={"native": status}, counterexample=example)
    if any(kept[at].looks_beyond(systems[at].claims[number]) for at in kind):
        return replace(result, engines={"native": result.status})
    return result


def combine_determinism(
    claims: Sequence[Determinism], systems: Sequence[System], engines: Answers, profiles: Sequence[str]
) -> tuple[AssertedResult, ...]:
    """The result of every claim of determinism under every profile, as for properties."""
    from keystore_audit.engine.native_determinism import describe_determinism, why_undecided

    asked = AskedSystems(systems, engines, profiles)

    def combined(number: int, claim: Determinism) -> AssertedResult:
        results = asked.by_profile(
            claim.id, lambda at, answer: describe_determinism(systems[at], systems[at].determinism[number], answer)
        )
        unknown = (readings_of(systems, name) for name, result in results.items() if result.status is Status.UNKNOWN)
        undecided = next((systems[kind[0]] for kind in unknown if kind), None)
        reason = why_undecided(undecided, undecided.determinism[number]) if undecided is not None else ""
        return replace(asserted(claim, "nobody", results), reason=reason)

    return tuple(combined(number, claim) for number, claim in enumerate(claims))


def asserted(claim: Claim | Determinism, attacker: str, results: Mapping[str, ProfileResult]) -> AssertedResult:
    """The result of what is claimed, as of a property."""
    prop = Property(
        id=claim.id,
        statement=claim.statement,
        attacker=attacker,
        clause=f"asserted in {claim.location.path}",
        roles=(),
    )
    return AssertedResult(
        prop=prop, profiles=results, severity=claim.severity, location=claim.location, meaning=claim.meaning
    )


def readings_of(systems: Sequence[System], profile: str) -> tuple[int, ...]:
    """The numbers of the systems that say how `profile` reads the keystore."""
    return tuple(number for number, system in enumerate(systems) if profile in system.profiles)


class AskedSystems(NamedTuple):
    """The systems that engines were asked about, what they said, and under which profiles it counts."""

    systems: Sequence[System]
    engines: Answers
    profiles: Sequence[str]

    def by_profile(self, name: str, tell: Tell) -> dict[str, ProfileResult]:
        """The result under each profile; profiles that read the keystore alike have one."""
        kinds = {profile: readings_of(self.systems, profile) for profile in self.profiles}
        results = {kind: self._result(name, kind, tell) for kind in dict.fromkeys(kinds.values())}
        return {profile: results[kind] for profile, kind in kinds.items()}

    def _result(self, name: str, kind: tuple[int, ...], tell: Tell) -> ProfileResult:
        statuses = {
            engine: _both_readings([_status(answers[number].get(name)) for number in kind])
            for engine, answers in self.engines.items()
        }
        distinct = set(statuses.values())
        status = distinct.pop() if len(distinct) == 1 else Status.UNKNOWN
        return ProfileResult(status=status, engines=statuses, counterexample=self._counterexample(name, kind, tell))

    def _counterexample(self, name: str, kind: tuple[int, ...], tell: Tell) -> Counterexample | None:
        """A counterexample in the user's names: from the MUST reading where it has one, since that is certain.

        The native engine's comes first, so that a finding tells the same story whichever engines ran.
        """
        native_first = sorted(self.engines, key=lambda engine: engine != "native")
        told = (number for number in kind if self.systems[number].assumed >= WORLD)  # else nothing here is why
        certain_first = sorted(told, key=lambda number: self.systems[number].may)
        for number in certain_first:
            for engine in native_first:
                answer = self.engines[engine][number].get(name)
                if answer is not None and answer.witnesses:
                    return tell(number, answer)
        return None


def _status(answer: Answer | None) -> Status:
    """The status of an answer; without an answer it is never HOLDS."""
    return Status.UNKNOWN if answer is None else answer.status


def _both_readings(statuses: Sequence[Status]) -> Status:
    """One status where all readings agree, else unknown; also unknown without any."""
    return statuses[0] if statuses and len(set(statuses)) == 1 else Status.UNKNOWN


def with_label_answers(claims: Sequence[Claim], results: Sequence[AssertedResult]) -> tuple[PropertyResult, ...]:
    """The results, parallel to `claims`, with one in place of all that the same two labels make."""
    pairs: dict[str, tuple[LabelPair, list[AssertedResult]]] = {}
    told: list[PropertyResult] = []
    for claim, result in zip(claims, results, strict=True):
        if claim.labels is None:
            told.append(result)
        else:
            pairs.setdefault(claim.labels.id, (claim.labels, []))[1].append(result)
    return (*told, *(_joint(pair, parts) for pair, parts in pairs.values()))


def _joint(pair: LabelPair, parts: Sequence[AssertedResult]) -> LabelResult:
    """Violated if one part is."""
    first = parts[0]
    return LabelResult(
        prop=replace(first.prop, id=pair.id),
        profiles={name: _worst([part.profiles[name] for part in parts]) for name in first.profiles},
        source=pair.source,
        target=pair.target,
        meaning="\0".join(part.meaning for part in parts),
        severity=first.severity,
        location=first.location,
        breaches=_together([part.breaches for part in parts]),
    )


def _together(parts: Sequence[tuple[str, ...] | None]) -> tuple[str, ...] | None:
    """What violates them; None where it is not known for one of them."""
    if None in parts:
        return None
    return tuple(f"{number}: {each}" for number, part in enumerate(parts) for each in part or ())


def _worst(parts: Sequence[ProfileResult]) -> ProfileResult:
    """The worst of the parts under one profile; engines that contradict each other about one part come first."""
    disputed = next((part for part in parts if len(set(part.engines.values())) > 1), None)
    if disputed is not None:
        return disputed
    order = (Status.VIOLATED, Status.UNKNOWN, Status.HOLDS)
    status = min((part.status for part in parts), key=order.index)
    alike = [part for part in parts if part.status is status]
    examples = [part.counterexample for part in alike if part.counterexample is not None]
    decided = frozenset.intersection(*(frozenset(part.engines) for part in parts)) or {"native"}
    return ProfileResult(
        status=status,
        engines=dict.fromkeys(sorted(decided), status),
        counterexample=min(examples, key=lambda example: len(example.steps), default=None),
    )
