"""What violates claims and properties: all of it, in names.

A report tells one example. Who accepts that a telematics unit may publish a command has not accepted that the
infotainment system may, so what a finding is about holds all that violates it, as far as it can be told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice, product
from typing import Final

from msgspec.structs import replace

from keystore_audit.engine.kept import KeptFlows
from keystore_audit.engine.native_claims import Claims, claims_at
from keystore_audit.model.formal.asked import ATTACKERS, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.permission import Decisions
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Answer, AssertedResult, PropertyResult, Role, Status, Witness

MAX_STEPS: Final = 200_000
"""Of one claim, pairs of places that are looked at, times moments and, of flows, enclaves: some seconds at worst."""

MAX_STEPS_IN_ALL: Final = 5 * MAX_STEPS
"""Of all claims together; the keystore as a whole stands for those that come after."""

MAX_BREACHES: Final = 10_000
"""What is told apart; beyond it the keystore stands for it as a whole."""


_Names = Mapping[int, str]
"""What each channel stands for: rules that tell no names apart make one channel of them."""


class _TooManyPairs(Exception):
    """Looking for a flow between all of them would take too long."""


def with_breaches(results: Sequence[AssertedResult], systems: Sequence[System]) -> tuple[AssertedResult, ...]:
    """The results, parallel to the claims of each system, each with all that violates it, unless that is too much."""
    budget = _Budget()
    return tuple(_with_its_own(number, result, systems, budget) for number, result in enumerate(results))


class _Budget:
    """The steps that are left for all claims."""

    def __init__(self) -> None:
        self._left = MAX_STEPS_IN_ALL

    def take(self, steps: int) -> None:
        """Raises _TooManyPairs for more than one claim may take, or than are left."""
        if steps > min(MAX_STEPS, self._left):
            raise _TooManyPairs
        self._left -= steps


def _with_its_own(number: int, result: AssertedResult, systems: Sequence[System], budget: _Budget) -> AssertedResult:
    try:
        found = set(islice(_under_profiles(number, result, systems, budget), MAX_BREACHES + 1))
    except _TooManyPairs:
        return result
    return result if len(found) > MAX_BREACHES else replace(result, breaches=tuple(sorted(found)))


def _under_profiles(number: int, result: AssertedResult, systems: Sequence[System], budget: _Budget) -> Iterator[str]:
    """What violates it under each profile that it is violated under."""
    for system in systems:
        profiles = _violated(result, system)
        if profiles:  # of what must be possible, what for certain is not
            for breach in _breaches(system, system.claims[number], budget):
                yield from (f"{profile}: {breach}" for profile in profiles)


def _breaches(system: System, claim: ClaimAtom, budget: _Budget) -> Iterator[str]:
    """What violates the claim now, and what else at some moment until its end.

    Who accepts what comes later has not accepted that it comes now.
    """
    first = 2 * system.now
    last = first if claim.until is None else max(first, 2 * claim.until)
    names = {number: channel.topic for number, channel in enumerate(system.channels)} | dict(claim.names)
    sources, targets = _each(system, names, claim.source), _each(system, names, claim.target)
    each = len(system.enclaves) if claim.kind is ClaimKind.NO_FLOW else 1
    budget.take(len(sources) * len(targets) * each * (last - first + 1))
    decisions = Decisions(system)

    def at(moment: int, claim: ClaimAtom) -> Iterator[str]:
        asked = claims_at(system, moment, decisions)
        if claim.kind is ClaimKind.NO_FLOW:
            flows = partial(_is_violated, asked)
            yield from _flows(system, flows, claim, names, product(sources, targets))
        elif claim.kind is ClaimKind.ABLE and claim.pairs:
            places = (claim.pairs[number] for number in asked.cut_off(claim))
            yield from (f"{_named(system, names, one)} -> {_named(system, names, other)}" for one, other in places)
        else:
            for witness, _path in asked.violations(claim):
                yield told(system, names, witness) + ("\0anybody" if asked.by_anybody(claim, witness) else "")

    starting = replace(claim, through=claim.through - claim.stopping)
    now = set(islice(at(first, starting), MAX_BREACHES + 1))
    yield from now
    for moment in range(first + 1, last + 1):
        yield from (f"later: {each}" for each in at(moment, claim) if each not in now)
    if claim.kind is ClaimKind.NO_FLOW and claim.until is not None:
        kept = _flows(system, KeptFlows(system).takes_time, claim, names, product(sources, targets))
        yield from (f"kept: {each}" for each in kept)


def _each(system: System, names: _Names, place: Place) -> list[Place]:
    """Its enclaves one by one, its topics by their names and domains, and who has no key."""
    topics: dict[str, set[int]] = {}
    for channel in sorted(place.channels):
        topics.setdefault(_topic(system, names, channel), set()).add(channel)
    found = [Place(enclaves=frozenset({enclave})) for enclave in sorted(place.enclaves)]
    found += [Place(channels=frozenset(channels)) for channels in topics.values()]
    return [*found, Place(outsider=True)] if place.outsider else found


def _is_violated(asked: Claims, claim: ClaimAtom) -> bool:
    return asked.violation(claim) is not None


def _flows(
    system: System,
    flows: Callable[[ClaimAtom], bool],
    claim: ClaimAtom,
    names: _Names,
    pairs: Iterable[tuple[Place, Place]],
) -> Iterator[str]:
    """Between which of them there is a flow, and the least attacker who makes one."""
    attackers = ATTACKERS[: ATTACKERS.index(claim.attacker) + 1]
    for source, target in pairs:
        for attacker in attackers:
            one = replace(claim, source=source, target=target, attacker=attacker)
            if flows(one):
                yield f"{attacker.value}: {_named(system, names, source)} -> {_named(system, names, target)}"
                break


def _named(system: System, names: _Names, place: Place) -> str:
    enclaves = [_called(system, enclave) for enclave in sorted(place.enclaves)]
    topics = sorted({_topic(system, names, channel) for channel in place.channels})
    return ", ".join([*enclaves, *topics, *(["outsider"] if place.outsider else [])])


def _topic(system: System, names: _Names, channel: int) -> str:
    return f"topic {names[channel]} in {system.domains[system.channels[channel].domain].label}"


def _called(system: System, number: int) -> str:
    """An enclave by its path; an unmanaged identity also by all of its subject, of which its label holds a part."""
    enclave = system.enclaves[number]
    if not enclave.unmanaged or enclave.identity is None:
        return enclave.label
    return f"{enclave.label} {system.certificates[enclave.identity].label}"


def told(system: System, names: _Names, witness: Witness) -> str:
    """Who, on what and where, by names that do not hang on the order of atoms; a trust domain has none."""
    told = []
    for role, atom in sorted(witness.items()):
        if role in (Role.ENCLAVE, Role.OTHER):
            told.append(_called(system, atom))
        elif role is Role.CERTIFICATE:
            told.append(system.certificates[atom].label)
        elif role is Role.CHANNEL:
            channel = system.channels[atom]
            told += [names[atom], channel.partition, system.domains[channel.domain].label]
        elif role is Role.DOMAIN:
            told.append(system.domains[atom].label)
    return "\0".join(told)


def with_violations(
    results: Iterable[PropertyResult], systems: Sequence[System], answers: Sequence[Mapping[str, Answer]]
) -> tuple[PropertyResult, ...]:
    """The results, each with what violates it under each profile, as far as the native engine keeps it."""
    return tuple(replace(each, violations=tuple(sorted(set(_violations(each, systems, answers))))) for each in results)


def _violations(
    result: PropertyResult, systems: Sequence[System], answers: Sequence[Mapping[str, Answer]]
) -> Iterator[str]:
    for system, answered in zip(systems, answers, strict=True):
        profiles = _violated(result, system)
        names = {number: channel.topic for number, channel in enumerate(system.channels)} if profiles else {}
        for witness in answered[result.prop.id].witnesses if profiles else ():
            yield from (f"{profile}: {told(system, names, witness)}" for profile in profiles)


def _violated(result: PropertyResult, system: System) -> list[str]:
    """The profiles of a system under which it is violated: of what must not be, all that may be."""
    found = {name for name, each in result.profiles.items() if each.status is Status.VIOLATED}
    return sorted(found.intersection(system.profiles)) if system.may else []
