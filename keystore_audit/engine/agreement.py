"""Brings the answers of engines, readings and kinds of implementation together, failing closed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.assumptions import WORLD
from keystore_audit.engine.counterexample import describe
from keystore_audit.engine.counterexample_case import plainest
from keystore_audit.engine.counterexample_claims import describe_claim, forgers
from keystore_audit.engine.shorter_subjects import shorter_subjects
from keystore_audit.model.claims.forwards import Determinism
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import Reading, System
from keystore_audit.properties import PROPERTIES, Answer, Status
from keystore_audit.properties.counterexample import Counterexample
from keystore_audit.properties.property import Property
from keystore_audit.properties.result import ANYBODY, AssertedResult, ProfileResult, PropertyResult

if TYPE_CHECKING:
    from keystore_audit.engine.kept import KeptFlows

Tell = Callable[[int, Answer], Counterexample]
"""Says what an answer about the system of this number means."""


class EngineAnswers(Struct, frozen=True, kw_only=True):
    """What one engine said of each system, parallel to the systems asked."""

    engine: str
    answers: tuple[Mapping[str, Answer], ...]


def combine(
    systems: Sequence[System], engines: Sequence[EngineAnswers], profiles: Sequence[str]
) -> tuple[PropertyResult, ...]:
    """The result of every property under every profile.

    A status is HOLDS or VIOLATED only where at least one engine answered and all that did say so in both
    readings.
    """
    asked = _Asked(systems, engines, profiles)
    return tuple(
        PropertyResult(prop=prop, profiles=asked.by_profile(prop, partial(_told, systems, prop))) for prop in PROPERTIES
    )


def _told(systems: Sequence[System], prop: Property, number: int, answer: Answer) -> Counterexample:
    return describe(systems[number], prop, plainest(systems[number], answer.witnesses))


def combine_claims(
    claims: Sequence[Claim], systems: Sequence[System], engines: Sequence[EngineAnswers], profiles: Sequence[str]
) -> tuple[AssertedResult, ...]:
    """The result of every claim under every profile, as for properties."""
    asked = _Asked(systems, engines, profiles)
    kept: dict[int, KeptFlows] = {}
    return tuple(_asserted(number, claim, asked, kept) for number, claim in enumerate(claims))


def _asserted(number: int, claim: Claim, asked: _Asked, kept: dict[int, KeptFlows]) -> AssertedResult:
    systems, prop = asked.systems, _as_property(claim, claim.attacker.value)

    def tell(at: int, answer: Answer) -> Counterexample:
        return describe_claim(systems[at], systems[at].claims[number], answer)

    only = claim.kind is ClaimKind.ONLY_PUBLISH
    results = asked.by_profile(prop, tell)
    if claim.kind is ClaimKind.NO_FLOW and claim.until is not None:
        kinds = {asked.kind(profile): result for profile, result in results.items() if result.status is Status.HOLDS}
        over = {kind: _over_time(number, kind, result, asked.systems, kept) for kind, result in kinds.items()}
        results = {profile: over.get(asked.kind(profile), result) for profile, result in results.items()}
    return AssertedResult(
        prop=prop,
        profiles=results,
        severity=claim.severity,
        location=claim.location,
        meaning=claim.meaning,
        forgers=_forgers(number, systems) if only else None,
        also_named=_also_named(number, systems) if only else None,
    )


def _over_time(
    number: int, kind: tuple[int, ...], result: ProfileResult, systems: Sequence[System], kept: dict[int, KeptFlows]
) -> ProfileResult:
    """Of what holds at each moment, whether it does over all of them, since who gets something may keep it."""
    from keystore_audit.engine.kept import KeptFlows, describe_kept, kept_status  # few claims are about a time

    kept.update({at: KeptFlows(systems[at]) for at in kind if at not in kept})
    flows = {at: kept[at].flow(systems[at].claims[number]) for at in kind}
    for at, stages in flows.items():
        if stages is not None:
            status, example = kept_status(flows), describe_kept(systems[at], systems[at].claims[number], stages)
            return ProfileResult(status=status, engines={"native": status}, counterexample=example)
    if any(kept[at].looks_beyond(systems[at].claims[number]) for at in kind):
        return replace(result, engines={"native": result.status})
    return result


def _forgers(number: int, systems: Sequence[System]) -> tuple[str, ...]:
    """Who could forge as some implementation reads the keystore, ANYBODY last."""
    found = dict.fromkeys(name for system in systems for name in forgers(system, system.claims[number]))
    return (*(name for name in found if name != ANYBODY), *([ANYBODY] if ANYBODY in found else []))


def _also_named(number: int, systems: Sequence[System]) -> Mapping[str, str]:
    """Whom grants name besides as some implementation compares subjects, by their own."""
    found: dict[str, str] = {}
    for system in systems:
        for text, subject in shorter_subjects(system, system.claims[number]).items():
            found.setdefault(text, subject)
    return found


def combine_determinism(
    claims: Sequence[Determinism], systems: Sequence[System], engines: Sequence[EngineAnswers], profiles: Sequence[str]
) -> tuple[AssertedResult, ...]:
    """The result of every claim of determinism under every profile, as for properties."""
    asked = _Asked(systems, engines, profiles)
    return tuple(_deterministic(number, claim, asked) for number, claim in enumerate(claims))


def _deterministic(number: int, claim: Determinism, asked: _Asked) -> AssertedResult:
    from keystore_audit.engine.counterexample_determinism import describe_determinism, why_undecided

    systems, prop = asked.systems, _as_property(claim, "nobody")

    def tell(at: int, answer: Answer) -> Counterexample:
        return describe_determinism(systems[at], systems[at].determinism[number], answer)

    results = asked.by_profile(prop, tell)
    unknown = (asked.kind(profile) for profile, result in results.items() if result.status is Status.UNKNOWN)
    undecided = next((systems[kind[0]] for kind in unknown if kind), None)
    reason = why_undecided(undecided, undecided.determinism[number]) if undecided is not None else ""
    return AssertedResult(
        prop=prop,
        profiles=results,
        severity=claim.severity,
        location=claim.location,
        meaning=claim.meaning,
        reason=reason,
    )


def _as_property(claim: Claim | Determinism, attacker: str) -> Property:
    """What is claimed, as a property."""
    return Property(
        id=claim.id,
        statement=claim.statement,
        attacker=attacker,
        clause=f"asserted in {claim.location.path}",
        roles=(),
    )


class _Asked(NamedTuple):
    """The systems that engines were asked about, what they said, and under which profiles it counts."""

    systems: Sequence[System]
    engines: Sequence[EngineAnswers]
    profiles: Sequence[str]

    def by_profile(self, prop: Property, tell: Tell) -> dict[str, ProfileResult]:
        """The result under each profile; profiles that read the keystore alike have one."""
        kinds = {profile: self.kind(profile) for profile in self.profiles}
        results = {kind: self._result(prop, kind, tell) for kind in dict.fromkeys(kinds.values())}
        return {profile: results[kind] for profile, kind in kinds.items()}

    def kind(self, profile: str) -> tuple[int, ...]:
        """The systems that say how `profile` reads the keystore."""
        return tuple(number for number, system in enumerate(self.systems) if profile in system.profiles)

    def _result(self, prop: Property, kind: tuple[int, ...], tell: Tell) -> ProfileResult:
        statuses = {
            engine.engine: _both_readings([_status(engine.answers[number].get(prop.id)) for number in kind])
            for engine in self.engines
        }
        distinct = set(statuses.values())
        status = distinct.pop() if len(distinct) == 1 else Status.UNKNOWN
        return ProfileResult(status=status, engines=statuses, counterexample=self._counterexample(prop, kind, tell))

    def _counterexample(self, prop: Property, kind: tuple[int, ...], tell: Tell) -> Counterexample | None:
        """A counterexample in the user's names: from the MUST reading where it has one, since that is certain.

        The native engine's comes first, so that a finding tells the same story whichever engines ran.
        """
        native_first = sorted(self.engines, key=lambda engine: engine.engine != "native")
        told = (number for number in kind if self.systems[number].assumed >= WORLD)  # else nothing here is why
        certain_first = sorted(told, key=lambda number: self.systems[number].reading is Reading.MAY)
        for number in certain_first:
            for engine in native_first:
                answer = engine.answers[number].get(prop.id)
                if answer is not None and answer.witnesses:
                    return tell(number, answer)
        return None


def _status(answer: Answer | None) -> Status:
    """No answer is no "holds"."""
    return Status.UNKNOWN if answer is None else answer.status


def _both_readings(statuses: Sequence[Status]) -> Status:
    """One status where all readings agree, else unknown; unknown as well where there is none."""
    return statuses[0] if statuses and len(set(statuses)) == 1 else Status.UNKNOWN
