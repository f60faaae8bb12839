"""Makes a system smaller that the Alloy Analyzer is asked about, without changing any answer.

Instants on the same side of the audit instant become one. Channels become one where the rules of every grant say the
same about them, in the same order. Rules that follow each other and say the same become one. Of enclaves that differ
only in what is theirs alone, KEPT remain. docs/model.md ("Slices and merging") says why this is sound for each
property. Nothing is decided here: the Analyzer decides about what remains. That consists of atoms of the keystore, so
a counterexample does as well.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from typing import Any, Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.alloy.atoms import ROLE_SORTS
from keystore_audit.engine.alloy.facts import CHILDREN, REFERENCES
from keystore_audit.engine.alloy.twins import find_twins, mentions, surroundings
from keystore_audit.engine.moments import redated
from keystore_audit.grouped import gathered
from keystore_audit.model.formal.asked import ClaimAtom
from keystore_audit.model.formal.system import (
    RuleAtom,
    System,
    easiest,
)
from keystore_audit.properties.result import Answer

KEPT: Final = 3
"""Enclaves that remain of those that are alike: no property, and no hop of a flow, is about more than three of them."""

_NAMED: Final[Mapping[str, Mapping[str, str]]] = {
    **{sort: {parent: parents} for sort, (_relation, parent, parents) in CHILDREN.items()},
    "claims": {"through": "enclaves", "left_out": "channels"},
    "places": {"enclaves": "enclaves", "channels": "channels", "certificates": "certificates"},
}
"""By sort: what `REFERENCES` does not say; claims and their places name atoms too."""

Numbers = Mapping[str, Mapping[int, int]]
"""By sort, from the index of an atom that remains to its new one."""


class Merged(Struct, frozen=True, kw_only=True):
    """`system`: what remains. `origin`: by sort and index there, the index in the system that it was made of."""

    system: System
    origin: Mapping[str, Sequence[int]]

    def original(self, answer: Answer) -> Answer:
        """Return an answer about `system` in the atoms of the one that it was made of."""
        witnesses = (
            {role: self._before(ROLE_SORTS.get(role, ""), atom) for role, atom in witness.items()}
            for witness in answer.witnesses
        )
        return replace(answer, witnesses=tuple(witnesses))

    def _before(self, sort: str, atom: int) -> int:
        return self.origin[sort][atom] if sort in self.origin else atom


def merge(system: System, *, twins: bool = True) -> Merged:
    """Return a system with the same answers to all properties and claims at its audit instant, and fewer atoms.

    `twins`: of enclaves that are alike some are left out.
    """
    asked = _few_instants(replace(system, determinism=(), places=(), nodes=(), left_out=()))
    sorts = ("certificates", "documents", "enclaves", "channels")
    merged = Merged(system=asked, origin={sort: range(len(getattr(asked, sort))) for sort in sorts})
    merged = _without(merged, {"documents": _idle(asked)}, {})
    while True:
        smaller = _without(merged, *_spare(merged.system, twins=twins))
        if smaller.origin == merged.origin:
            return replace(merged, system=_few_rules(merged.system))
        merged = smaller


def _few_instants(system: System) -> System:
    """The audit instant, and of those before it and after it one each: nothing is asked but on which side dates are."""
    now = system.now
    chosen = [*([now - 1] if now else []), now, *([now + 1] if now + 1 < len(system.instants) else [])]

    def side(instant: int) -> int:
        return chosen.index(min(max(instant, now - 1), now + 1))

    return replace(
        system,
        instants=tuple(system.instants[instant] for instant in chosen),
        now=chosen.index(now),
        certificates=redated(system.certificates, side),
        grants=redated(system.grants, side),
        claims=tuple(replace(claim, until=None) for claim in system.claims),
    )


def _spare(system: System, *, twins: bool) -> tuple[dict[str, Collection[int]], dict[int, int]]:
    """What can be left out, by sort: channels of which an equal one remains. If there are none: enclaves of which
    enough remain, with what is theirs. Also, for each channel left out, the one that replaces it.
    """
    said = mentions(system)
    if said is None:
        return {}, {}
    words: list[Hashable] = [tuple(frozenset(part.items()) for part in each) for each in said]
    met_by: dict[int, set[Hashable]] = {}
    for channel, others in enumerate(system.meets):
        for other in others:
            met_by.setdefault(other, set()).add(words[channel])
    around = surroundings(system)
    alike = gathered(
        ((around[channel], words[channel], frozenset(met_by.get(channel, ()))), channel)
        for channel in range(len(system.channels))
    )
    remaining = ((easiest(system.channels, each), each) for each in alike.values())
    instead = {channel: told for told, each in remaining for channel in each if channel != told}
    if instead or not twins or any(any(enclave.by_itself) for enclave in system.enclaves):
        return {"channels": instead}, instead  # few keystores have the latter: whether enclaves are alike is not asked
    classes, own_channels = find_twins(system, said)
    enclaves = [enclave for each in classes for enclave in each[KEPT:]]
    atoms = [system.enclaves[enclave] for enclave in enclaves]
    spare: dict[str, Collection[int]] = {
        "certificates": {atom.identity for atom in atoms if atom.identity is not None},
        "documents": frozenset[int]().union(*(atom.permissions for atom in atoms)),
        "enclaves": set(enclaves),
        "channels": {channel for enclave in enclaves for channel in own_channels[enclave]},
    }
    return spare, {}


def _idle(system: System) -> frozenset[int]:
    """Documents that no enclave has, that govern nothing and grant nothing: copies of a governance document."""
    used = {grant.document for grant in system.grants} | {each.governance for each in system.trust_domains}
    used = used.union(*(enclave.permissions for enclave in system.enclaves))
    return frozenset(n for n, document in enumerate(system.documents) if n not in used and not document.opaque)


def _without(merged: Merged, spare: Mapping[str, Collection[int]], alike: Mapping[int, int]) -> Merged:
    """What remains without what is left out, all other atoms renumbered in their order."""
    old = merged.system
    kept = {
        sort: [n for n in range(len(origin)) if n not in spare.get(sort, ())] for sort, origin in merged.origin.items()
    }
    numbers = {sort: {before: after for after, before in enumerate(each)} for sort, each in kept.items()}
    for sort, (_relation, parent, parents) in CHILDREN.items():
        staying = (n for n, entry in enumerate(getattr(old, sort)) if getattr(entry, parent) in numbers[parents])
        numbers[sort] = {before: after for after, before in enumerate(staying)}
    of = _renumbering(numbers)
    remaining = {sort: tuple(of(sort, getattr(old, sort)[n]) for n in each) for sort, each in numbers.items()}
    remaining["enclaves"] = tuple(replace(each, later=()) for each in remaining["enclaves"])
    system = replace(
        old,
        **remaining,
        trust_domains=tuple(
            replace(of("trust_domains", trust_domain), revoked_later=(), refuses_later=())
            for trust_domain in old.trust_domains
        ),
        claims=tuple(_claim(claim, of, numbers["enclaves"]) for claim in old.claims),
        meets=_meets(old.meets, numbers["channels"], alike),
    )
    return Merged(system=system, origin={sort: [merged.origin[sort][n] for n in each] for sort, each in kept.items()})


def _renumbering(numbers: Numbers) -> Callable[[str, Any], Any]:
    """Gives an atom with all that it names by their new numbers; of sets, what remains."""
    known: dict[tuple[int, str], frozenset[int]] = {}  # rules share their sets

    def renumbered(named: Any, sort: str) -> Any:
        if named is None or isinstance(named, int):
            return None if named is None else numbers[sort][named]
        if (id(named), sort) not in known:
            known[id(named), sort] = frozenset(numbers[sort][each] for each in named if each in numbers[sort])
        return known[id(named), sort]

    def of(sort: str, atom: Any) -> Any:
        fields = {**_NAMED.get(sort, {}), **REFERENCES.get(sort, {})}
        changed = {field: renumbered(getattr(atom, field), to) for field, to in fields.items()}
        return replace(atom, **changed) if changed else atom

    return of


def _claim(claim: ClaimAtom, of: Callable[[str, Any], Any], enclaves: Mapping[int, int]) -> ClaimAtom:
    pairs = [pair for pair in claim.pairs if (pair[0].enclaves | pair[1].enclaves) <= enclaves.keys()]
    renumbered: ClaimAtom = of("claims", claim)
    return replace(
        renumbered,
        source=of("places", claim.source),
        target=of("places", claim.target),
        stopping=frozenset(),
        starts=frozenset((enclaves[enclave], domain) for enclave, domain in claim.starts if enclave in enclaves),
        pairs=tuple((of("places", one), of("places", other)) for one, other in pairs),
    )


def _meets(
    meets: Sequence[frozenset[int]], numbers: Mapping[int, int], alike: Mapping[int, int]
) -> tuple[frozenset[int], ...]:
    """Which channels that remain meet which: each for those too that it stands for, whose rights are its own."""
    found: list[set[int]] = [set() for _ in numbers]
    for channel, others in enumerate(meets):
        known = numbers.get(alike.get(channel, channel))
        if known is not None:
            found[known] |= {numbers[other] for other in others if other in numbers} - {known}
    return tuple(map(frozenset, found)) if any(found) else ()


def _few_rules(system: System) -> System:
    """Rules of a grant that follow each other with one qualifier and the same domains become one."""
    rules: list[RuleAtom] = []
    last: dict[int, int] = {}
    for rule in system.rules:
        before = rules[last[rule.grant]] if rule.grant in last else None
        if before is None or before.allow is not rule.allow or before.domains != rule.domains:
            last[rule.grant] = len(rules)
            rules.append(rule)
        else:
            operations = ("publish", "subscribe", "relay")
            together = {name: getattr(before, name) | getattr(rule, name) for name in operations}
            rules[last[rule.grant]] = replace(before, **together)
    return replace(system, rules=tuple(rules))
