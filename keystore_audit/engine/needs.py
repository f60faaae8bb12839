"""Which assumptions a "holds" needs: the fewest under which it still holds, found by leaving them out.

Fewer assumptions never make anything hold (`tests/engine/test_assumptions.py`). So an assumption without which all
others do not suffice is in every set that suffices. Mostly these suffice together, which is asked again; they are then
the one smallest set. Else others are left out one by one, and the set is one of the smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

from msgspec.structs import replace

from keystore_audit.assumptions import DOCUMENTS, IDENTITIES, WORLD, Assumption
from keystore_audit.engine.engines import Engines, ask_alloy, readings_of
from keystore_audit.engine.native import NativeEngine
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.system import System
from keystore_audit.profiles import VARIANTS
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import EngineRun, EngineStatus, ProfileResult, PropertyResult

if TYPE_CHECKING:
    from keystore_audit.engine.alloy.install import Engine

R = TypeVar("R", bound=PropertyResult)

Needs = frozenset[Assumption]

_TRUTHFUL: Final = frozenset({Assumption.TRUTHFUL_ANNOUNCEMENTS})

_READ_TOGETHER: Final = (
    frozenset({Assumption.ROBOTS_ENFORCE}),
    IDENTITIES,
    DOCUMENTS,
    _TRUTHFUL,
)
"""Of these the engines ask only whether all are made."""


class Minimal(NamedTuple):
    """A system in which no more is taken for granted than these need to hold: properties and claims, by id."""

    system: System
    names: frozenset[str]


def with_needs(
    results: Sequence[R], native: NativeEngine, made: frozenset[Assumption]
) -> tuple[tuple[R, ...], tuple[Minimal, ...]]:
    """The results; those that hold under a profile with what they need for it. And each such set, with what needs it.

    `made`: what is taken for granted and not known. What is not asked again, since it is about a time, needs all.
    """
    holding: dict[str, list[str]] = {}
    for result in results:
        for profile, each in result.profiles.items():
            if each.status is Status.HOLDS:
                holding.setdefault(profile, []).append(result.prop.id)
    needs: dict[tuple[str, str], Needs] = {}
    by_profile = {profile: system for system in native.systems for profile in system.profiles}
    believing = {name for name in holding if any(map(_is_announced_to, (name, *by_profile[name].others)))}
    found: list[Minimal] = []
    for numbers, alike in grouped(holding, lambda profile: readings_of(native.systems, profile)).items():
        asked = _Asked(native, [native.systems[number] for number in numbers], made)
        for announced, profiles in grouped(alike, believing.__contains__).items():
            names = frozenset(name for profile in profiles for name in holding[profile])
            known = frozenset[Assumption]() if announced else _TRUTHFUL
            for least, those in asked.needs(names, made - known, known).items():
                needs.update({(profile, name): least for profile in profiles for name in those})
                enough = (replace(each, profiles=tuple(profiles)) for each in asked.assuming(known | least))
                found += [Minimal(_of(each, those), frozenset(those)) for each in enough]

    def needing(result: R) -> R:
        def needed(profile: str, held: ProfileResult) -> ProfileResult:
            every = made if profile in believing else made - _TRUTHFUL
            found = needs.get((profile, result.prop.id), every)
            return replace(held, needs=_ordered(found.union(held.needs)), survives_without=_ordered(every - found))

        return _where_it_holds(result, needed)

    return tuple(map(needing, results)), tuple(found)


def solved_again(
    results: tuple[R, ...],
    minimal: Sequence[Minimal],
    runs: tuple[EngineRun, ...],
    engines: Engines,
    stage: Callable[[str], None] | None,
) -> tuple[tuple[R, ...], tuple[EngineRun, ...]]:
    """The results, and how engines fared, after Alloy was asked whether these sets suffice.

    Each set is a run of its own, and all take longer than the audit. So it is done only where Alloy was asked for by
    name. What does not hold there is unknown.
    """

    def ask(engine: Engine) -> tuple[list[frozenset[str]], None]:
        from keystore_audit.engine.alloy.runner import examine

        systems, names = zip(*minimal, strict=True)
        expected = [dict.fromkeys(each, Status.HOLDS) for each in names]
        told = examine(
            systems, java=engine.java, jar=engine.jar, timeout=engines.timeout, expected=expected, names=names
        )
        return [
            frozenset(name for name in those if each.answers[name].status is not Status.HOLDS)
            for those, each in zip(names, told, strict=True)
        ], None

    answered = any(run.name == "alloy" and run.status is EngineStatus.OK for run in runs)
    if engines.choice not in ("both", "alloy") or not (answered and minimal):
        return results, runs
    run, refused = ask_alloy(ask, engines, stage)
    if refused is None:
        return results, tuple(run if each.name == run.name else each for each in runs)
    doubtful = {
        (profile, name)
        for each, names in zip(minimal, refused, strict=True)
        for name in names
        for profile in each.system.profiles
    }

    def again(result: R) -> R:
        def doubted(profile: str, held: ProfileResult) -> ProfileResult:
            if (profile, result.prop.id) not in doubtful:
                return held
            return replace(held, status=Status.UNKNOWN, engines={**held.engines, run.name: Status.VIOLATED})

        return _where_it_holds(result, doubted)

    return tuple(map(again, results)), runs


def _where_it_holds(result: R, change: Callable[[str, ProfileResult], ProfileResult]) -> R:
    """The result, changed under each profile under which it holds."""
    held = {name: change(name, each) for name, each in result.profiles.items() if each.status is Status.HOLDS}
    return replace(result, profiles={**result.profiles, **held})


def with_sessions(claims: Iterable[Claim], results: Sequence[R], assumed: Collection[Assumption]) -> tuple[R, ...]:
    """The results; claims about a time are unknown where sessions may outlast their grants."""
    over_time = {claim.id for claim in claims if claim.until is not None}
    return _resting(Assumption.SESSIONS_END_WITH_GRANTS, results, assumed, lambda name, _profile: name in over_time)


def with_rounds(results: Sequence[R], systems: Sequence[System], assumed: Collection[Assumption]) -> tuple[R, ...]:
    """The results of claims of determinism; they are unknown where forwards may act in their own time."""
    forwarded = {
        (claim.id, profile)
        for system in systems
        for claim in system.determinism
        for behaviour in claim.behaviours
        if max(behaviour.seen(), default=0) >= len(behaviour.inputs)
        for profile in system.profiles
    }
    return _resting(Assumption.LOCKSTEP_ROUNDS, results, assumed, lambda *those: those in forwarded)


def _resting(
    on: Assumption, results: Iterable[R], assumed: Collection[Assumption], rests: Callable[[str, str], bool]
) -> tuple[R, ...]:
    """The results; those that rest on the assumption, by id and profile, are unknown where it is not made."""

    def changed(result: R) -> R:
        def change(profile: str, held: ProfileResult) -> ProfileResult:
            if not rests(result.prop.id, profile):
                return held
            return replace(held, needs=(on,)) if on in assumed else replace(held, status=Status.UNKNOWN)

        return _where_it_holds(result, change)

    return tuple(map(changed, results))


class _Asked:
    """The systems that say how some implementations read the keystore, with fewer assumptions.

    They are taken to go by what peers announce of their endpoints. That matters only where announcements are not
    assumed to be true. Each is asked once for all that reads alike.
    """

    def __init__(self, native: NativeEngine, systems: Sequence[System], made: frozenset[Assumption]) -> None:
        self._native = native
        self._systems = [each if each.mixed else _asking_announced(each) for each in systems]
        self._known = systems[0].assumed.difference(made)
        claims = (claim.id for each in systems for claim in each.claims if claim.until is None)
        self._answered = frozenset((*BY_ID, *claims))
        self._told: dict[object, dict[str, bool]] = {}

    def needs(self, names: frozenset[str], made: Needs, known: Needs) -> dict[Needs, list[str]]:
        """By the smallest set of `made`, what holds under it; only for those that are asked about an instant."""
        idle = self._under(known, names & self._answered)
        names = (names & self._answered) - idle
        fails = {each: names - self._under(known | made - {each}, names) for each in _ordered(made)}
        needed = gathered((frozenset(each for each in made if name in fails[each]), name) for name in sorted(names))
        found = {frozenset[Assumption](): sorted(idle)} if idle else {}
        for least, those in needed.items():
            enough = self._under(known | least, frozenset(those))
            for name in those:
                kept = least if name in enough else self._left(name, made, known)
                found.setdefault(kept, []).append(name)
        return found

    def _left(self, name: str, made: Needs, known: Needs) -> Needs:
        """What is left after leaving out one after the other, as long as it holds."""
        kept = made
        for each in _ordered(made):
            if self._under(known | kept - {each}, frozenset({name})):
                kept -= {each}
        return kept

    def _under(self, assumed: Needs, names: frozenset[str]) -> frozenset[str]:
        """Which of them hold where no more is assumed."""
        known = self._known | assumed
        told = self._told.setdefault(tuple(known >= together for together in _READ_TOGETHER), {})
        asked = names.difference(told)
        if asked:
            every = [self._native.statuses_of(_of(each, asked), asked) for each in self.assuming(assumed)]
            told.update({name: all(each[name] is Status.HOLDS for each in every) for name in asked})
        return frozenset(name for name in names if told[name])

    def assuming(self, assumed: Needs) -> Iterator[System]:
        """The systems with no more assumed. MUST always assumes what nobody can see."""
        known = self._known | assumed
        for each in self._systems:
            yield replace(each, assumed=known if each.may else known | WORLD)


def _asking_announced(system: System) -> System:
    return replace(system, readings=tuple(replace(each, asks_announced_only=True) for each in system.readings))


def _of(system: System, names: Collection[str]) -> System:
    """The system with those claims alone, about an instant."""
    claims = (claim for claim in system.claims if claim.id in names and claim.until is None)
    return replace(system, claims=tuple(claims), determinism=())


def _ordered(needs: Iterable[Assumption]) -> tuple[Assumption, ...]:
    order = list(Assumption)
    return tuple(sorted(needs, key=order.index))


def taken_for_granted(
    keystore: Keystore, assumed: Collection[Assumption], *, authorities_declared: bool = False
) -> frozenset[Assumption]:
    """What answers at an instant may rest on: what is assumed and not known of this keystore."""
    known = {
        Assumption.SESSIONS_END_WITH_GRANTS,
        Assumption.LOCKSTEP_ROUNDS,
        *([Assumption.AUTHORITIES_AS_FOUND] if authorities_declared else []),
        *([] if keystore.unread_foreign else [Assumption.NOTHING_IN_UNREAD_FILES]),
    }
    return frozenset(assumed) - known


def _is_announced_to(profile: str) -> bool:
    """Whether the implementation goes by what peers announce of their endpoints."""
    return VARIANTS[profile].trust.trusts_declarations
