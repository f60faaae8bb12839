"""The smallest change of rights after which nothing gets through: what to take from whom.

Whatever lets something through rests on rights of those at its hops. Each sufficient change takes at least one of these
away. So these are tried, one, then two together, and each time the changed keystore is read again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, Final

from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import Engines, run_engines, run_falls
from keystore_audit.engine.native import NativeEngine
from keystore_audit.engine.native_claims import first_fall
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Criterion, Grant, Operation, Permissions, PermissionsFile, Rule
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.flow import Leg
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import stated_systems
from keystore_audit.properties.result import Change, EngineStatus, Right, Status

MAX_TAKEN: Final = 3
"""Rights that a change takes at most."""

MAX_TRIED: Final = 300
"""Changes that are tried: 300 times what one answer takes."""


def smallest_change(
    keystore: Keystore, claim: Claim, most: int, able: Sequence[Claim], given: Circumstances, engines: Engines
) -> Change:
    """The change after which nothing gets through with `most` compromised participants, and `able` still holds.

    Raises errors.BudgetExceeded, as every question about the keystore does.
    """
    asked = (claim, *able)
    systems = _systems(keystore, asked, given)
    kept = _holding(systems, able, Engines())
    edge = sorted((frozenset({right}) for right in _rights_of_a_flow(systems, most) or ()), key=sorted)
    tried = 1  # the keystore as it is
    for _size in range(MAX_TAKEN):
        wider: set[frozenset[Right]] = set()
        for taken in edge:
            tried += 1
            if tried > MAX_TRIED:
                return Change(None, len(able))
            changed = _systems(_without(keystore, taken), asked, given)
            if not kept <= _holding(changed, able, Engines()):
                continue
            rights = _rights_of_a_flow(changed, most)
            if rights is not None:
                wider.update(taken | {right} for right in rights)
            elif _confirmed(changed, most, able, kept, engines):
                return Change(tuple(sorted(taken)), len(able))
        edge = sorted(wider, key=sorted)
    return Change(None, len(able))


def _systems(keystore: Keystore, claims: tuple[Claim, ...], given: Circumstances) -> tuple[System, ...]:
    return stated_systems(keystore, given.profiles, given.at, given.accesses(keystore), given.domain, claims)


def _about(systems: Sequence[System], claims: slice) -> list[System]:
    return [replace(system, claims=system.claims[claims]) for system in systems]


def _holding(systems: Sequence[System], able: Sequence[Claim], engines: Engines) -> frozenset[tuple[str, str]]:
    """By profile which of the claims hold in both readings, for each engine that is asked."""
    if not able:
        return frozenset()
    asked = _about(systems, slice(1, None))
    _runs, told = run_engines(NativeEngine(asked), engines, None, claims=True)
    every = {(profile, claim.id) for system in asked for profile in system.profiles for claim in able}
    failed = {
        (profile, name)
        for answers in told.values()
        for system, answered in zip(asked, answers, strict=True)
        for name, answer in answered.items()
        for profile in system.profiles
        if answer.status is not Status.HOLDS
    }
    return frozenset(every - failed) if told else frozenset()


def _rights_of_a_flow(systems: Sequence[System], most: int) -> set[Right] | None:
    """The rights on which a flow with some set of compromised participants may rest; None where there is none."""
    for system in _about(systems, slice(1)):
        fall = first_fall(system, most)
        if fall is not None:
            return {right for leg in fall.legs for right in _rights_at(system, leg)}
    return None


def _rights_at(system: System, leg: Leg) -> Iterator[Right]:
    """All rights that may let a sample over at a hop: of those at its ends, or with their keys, there or met there.

    Who reads can forge, so each operation counts.
    """
    at_it = {each for each in (leg.sender, leg.receiver) if each is not None}
    keys = {system.key_of(each) for each in at_it} - {None}
    at_it |= {number for number in range(len(system.enclaves)) if system.key_of(number) in keys}
    channels = {leg.channel, *(number for number, met in enumerate(system.meets) if leg.channel in met)}
    certificates = {system.enclaves[each].identity: system.enclaves[each].label for each in sorted(at_it, reverse=True)}
    for rule in (rule for rule in system.rules if rule.allow):
        named = system.grants[rule.grant].names & certificates.keys()
        for operation, channel in product(Operation, channels if named else ()):
            if channel in rule.named(operation):
                place = system.place(rule, operation, channel)
                text = place.message or system.channels[channel].topic
                if place.line is not None:
                    yield Right(place.path, place.line, text, min(map(certificates.__getitem__, named)))


def _confirmed(
    systems: Sequence[System], most: int, able: Sequence[Claim], kept: Collection[tuple[str, str]], engines: Engines
) -> bool:
    """Whether all engines that are asked confirm it for the changed keystore."""
    runs, told = run_falls(_about(systems, slice(1)), most, engines)
    answered = all(run.status is EngineStatus.OK for run in runs if run.required)
    survives = answered and bool(told) and not any(falls for answers in told.values() for falls in answers)
    return survives and (not able or _holding(systems, able, engines) >= frozenset(kept))


# The keystore without some rights, as if its documents had been signed again.


def _permissions(keystore: Keystore) -> Iterator[PermissionsFile]:
    carried = (enclave.permissions for enclave in keystore.enclaves)
    found = (*carried, *(each.document for each in keystore.unmanaged))
    return (file for file in found if isinstance(file, PermissionsFile))


def _without(keystore: Keystore, taken: Collection[Right]) -> Keystore:
    by_place: dict[str, set[tuple[int, str]]] = {}
    for right in taken:
        by_place.setdefault(right.path, set()).add((right.line, right.expression))
    files = {id(file): _changed(file, by_place) for file in _permissions(keystore)}

    def enclave(each: Enclave) -> Enclave:
        return replace(each, permissions=files.get(id(each.permissions)))

    return replace(
        keystore,
        enclaves=tuple(map(enclave, keystore.enclaves)),
        unmanaged=tuple(
            replace(each, document=files.get(id(each.document), each.document)) for each in keystore.unmanaged
        ),
    )


def _changed(file: PermissionsFile, by_place: Mapping[str, Collection[tuple[int, str]]]) -> PermissionsFile:
    """The file without these rights; the same object where it has none of them, since files compare by identity."""
    gone = by_place.get(file.signed.file.place)
    if gone is None:
        return file

    def criterion(each: Criterion) -> Criterion:
        return replace(each, topics=tuple(text for text in each.topics if (text.line, text.text) not in gone))

    def rule(each: Rule) -> Rule:
        left = (found for found in map(criterion, each.criteria) if found.topics)
        return replace(each, criteria=tuple(left)) if each.allow else each

    def grant(each: Grant) -> Grant:
        return replace(each, rules=tuple(map(rule, each.rules)))

    def read(each: Any) -> Any:
        if not isinstance(each, Permissions):
            return each
        return replace(each, grants=tuple(map(grant, each.grants)))

    changed = {syntax: read(each) for syntax, each in file.readings.by_syntax.items()}
    return replace(file, readings=replace(file.readings, by_syntax=changed))
