"""Makes a system smaller that the Alloy Analyzer is asked about, without changing any answer.

Instants on the same side of the audit instant become one; channels about which the rules of every grant say the same,
in the same order, become one; rules that follow each other and say the same become one; of enclaves that are alike but
for what is theirs alone, KEPT remain. Why that is sound, property by property, stands in docs/model.md ("Slices and
merging"). Nothing is decided here: which rule comes first, who is vouched for, who may write is asked of the Analyzer,
about what remains. What remains are atoms of the keystore, so that a counterexample is one, too.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.engine.alloy.mentions import mentions, surroundings
from keystore_audit.engine.alloy.moments import redated
from keystore_audit.engine.alloy.twins import find_twins
from keystore_audit.model.formal.claim import ClaimAtom, Place
from keystore_audit.model.formal.system import GrantAtom, RealmAtom, RuleAtom, System, easiest
from keystore_audit.properties.property import Answer, Hop, Role, Witness

KEPT: Final = 3
"""Enclaves that remain of those that are alike: no property, and no hop of a flow, is about more than three of them."""


class Merged(Struct, frozen=True, kw_only=True):
    """`system`: what remains. The others: by index there, the index in the system that it was made of."""

    system: System
    certificates: tuple[int, ...]
    documents: tuple[int, ...]
    enclaves: tuple[int, ...]
    channels: tuple[int, ...]

    def original(self, answer: Answer, moment: int) -> Answer:
        """Return an answer about `system` in the atoms of the one that it was made of.

        `moment`: of which the answer is, there (`moments.later`).
        """
        path = tuple(
            Hop(
                sender=None if hop.sender is None else self.enclaves[hop.sender],
                channel=self.channels[hop.channel],
                receiver=None if hop.receiver is None else self.enclaves[hop.receiver],
                instant=moment // 2,
            )
            for hop in answer.path
        )
        return replace(answer, witnesses=tuple(map(self._witness, answer.witnesses)), path=path)

    def _witness(self, witness: Witness) -> Witness:
        index: Mapping[Role, Sequence[int]] = {
            Role.ENCLAVE: self.enclaves,
            Role.OTHER: self.enclaves,
            Role.DOCUMENT: self.documents,
            Role.CHANNEL: self.channels,
            Role.OTHER_CHANNEL: self.channels,
            Role.CERTIFICATE: self.certificates,
            Role.OTHER_CERTIFICATE: self.certificates,
        }
        return {role: index[role][atom] if role in index else atom for role, atom in witness.items()}


def merge(system: System) -> Merged:
    """Return a system with the same answers to all properties and claims at its audit instant, and fewer atoms."""
    merged = Merged(
        system=_few_instants(_asked(system)),
        certificates=tuple(range(len(system.certificates))),
        documents=tuple(range(len(system.documents))),
        enclaves=tuple(range(len(system.enclaves))),
        channels=tuple(range(len(system.channels))),
    )
    merged = _without(merged, _Spare(documents=_idle(merged.system)))
    while True:
        smaller = _without(merged, _spare(merged.system))
        if len(smaller.channels) == len(merged.channels) and len(smaller.enclaves) == len(merged.enclaves):
            return replace(merged, system=_few_rules(merged.system))
        merged = smaller


def _asked(system: System) -> System:
    """The system without what properties and claims do not speak of."""
    return replace(system, determinism=(), places=(), nodes=(), left_out=())


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


class _Spare(Struct, frozen=True, kw_only=True):
    """What can be left out. `alike`: by channel that is left out, the one that remains in its place."""

    certificates: frozenset[int] = frozenset()
    documents: frozenset[int] = frozenset()
    enclaves: frozenset[int] = frozenset()
    channels: frozenset[int] = frozenset()
    alike: Mapping[int, int] = field(default_factory=dict)


def _spare(system: System) -> _Spare:
    """The channels of which an equal one remains; if there are none, enclaves of which enough alike remain."""
    said = mentions(system)
    if said is None:
        return _Spare()
    words: list[Hashable] = [tuple(frozenset(part.items()) for part in each) for each in said]
    met_by: dict[int, set[Hashable]] = {}
    for channel, others in enumerate(system.meets):
        for other in others:
            met_by.setdefault(other, set()).add(words[channel])
    alike: dict[Hashable, list[int]] = {}
    for channel, around in enumerate(surroundings(system)):
        alike.setdefault((around, words[channel], frozenset(met_by.get(channel, ()))), []).append(channel)
    remaining = ((easiest(system.channels, each), each) for each in alike.values())
    instead = {channel: told for told, each in remaining for channel in each if channel != told}
    if instead:
        return _Spare(channels=frozenset(instead), alike=instead)
    if any(any(enclave.by_itself) for enclave in system.enclaves):
        return _Spare()  # whether enclaves are alike is not asked of this: few keystores have it
    twins = find_twins(system, said)
    enclaves = [enclave for each in twins.classes for enclave in each[KEPT:]]
    atoms = [system.enclaves[enclave] for enclave in enclaves]
    return _Spare(
        certificates=frozenset(atom.identity for atom in atoms if atom.identity is not None),
        documents=frozenset(atom.permissions for atom in atoms if atom.permissions is not None),
        enclaves=frozenset(enclaves),
        channels=frozenset(channel for enclave in enclaves for channel in twins.own_channels[enclave]),
    )


def _idle(system: System) -> frozenset[int]:
    """Documents that no enclave has, that govern nothing and grant nothing: copies of a governance document."""
    used = {grant.document for grant in system.grants} | {enclave.permissions for enclave in system.enclaves}
    used |= {realm.governance for realm in system.realms}
    return frozenset(n for n, document in enumerate(system.documents) if n not in used and not document.opaque)


def _without(merged: Merged, spare: _Spare) -> Merged:
    """What remains without what is left out."""
    system = merged.system
    certificates = _rest(len(system.certificates), spare.certificates)
    documents = _rest(len(system.documents), spare.documents)
    enclaves = _rest(len(system.enclaves), spare.enclaves)
    channels = _rest(len(system.channels), spare.channels)
    return Merged(
        system=replace(
            _Restriction(system, certificates, documents, enclaves, channels).system(),
            meets=_meets(system.meets, channels, spare.alike),
        ),
        certificates=tuple(merged.certificates[n] for n in certificates),
        documents=tuple(merged.documents[n] for n in documents),
        enclaves=tuple(merged.enclaves[n] for n in enclaves),
        channels=tuple(merged.channels[n] for n in channels),
    )


def _meets(
    meets: Sequence[frozenset[int]], kept: Sequence[int], alike: Mapping[int, int]
) -> tuple[frozenset[int], ...]:
    """Which channels that remain meet which: each for those too that it stands for, whose rights are its own."""
    numbers = _numbers(kept)
    found: list[set[int]] = [set() for _ in kept]
    for channel, others in enumerate(meets):
        known = numbers.get(alike.get(channel, channel))
        if known is not None:
            found[known] |= _among(others, numbers) - {known}
    return tuple(map(frozenset, found)) if any(found) else ()


def _rest(count: int, left_out: Collection[int]) -> list[int]:
    return [number for number in range(count) if number not in left_out]


class _Restriction:
    """A system without some of its atoms, all others renumbered in their order."""

    def __init__(
        self,
        system: System,
        certificates: Sequence[int],
        documents: Sequence[int],
        enclaves: Sequence[int],
        channels: Sequence[int],
    ) -> None:
        self._system = system
        self._kept_enclaves = enclaves
        self._kept_channels = channels
        self._certificates = _numbers(certificates)
        self._documents = _numbers(documents)
        self._enclaves = _numbers(enclaves)
        self._channels = _numbers(channels)
        self._grants = _numbers(n for n, grant in enumerate(system.grants) if grant.document in self._documents)
        self._domain_rules = _numbers(n for n, r in enumerate(system.domain_rules) if r.document in self._documents)
        self._memo: dict[int, frozenset[int]] = {}

    def system(self) -> System:
        """What remains."""
        old = self._system
        return replace(
            old,
            certificates=tuple(
                replace(old.certificates[n], issuers=_among(old.certificates[n].issuers, self._certificates))
                for n in self._certificates
            ),
            documents=tuple(
                replace(old.documents[n], signers=_among(old.documents[n].signers, self._certificates))
                for n in self._documents
            ),
            realms=tuple(map(self._realm, old.realms)),
            enclaves=tuple(
                replace(
                    old.enclaves[n],
                    identity=_one(old.enclaves[n].identity, self._certificates),
                    permissions=_one(old.enclaves[n].permissions, self._documents),
                    reads_alone=self._named(old.enclaves[n].reads_alone),
                    writes_alone=self._named(old.enclaves[n].writes_alone),
                    refused_writes=self._named(old.enclaves[n].refused_writes),
                    refused_reads=self._named(old.enclaves[n].refused_reads),
                    later=(),
                )
                for n in self._kept_enclaves
            ),
            channels=tuple(old.channels[n] for n in self._kept_channels),
            domain_rules=tuple(
                replace(old.domain_rules[n], document=self._documents[old.domain_rules[n].document])
                for n in self._domain_rules
            ),
            topic_rules=tuple(
                replace(rule, domain_rule=self._domain_rules[rule.domain_rule], channels=self._named(rule.channels))
                for rule in old.topic_rules
                if rule.domain_rule in self._domain_rules
            ),
            grants=tuple(self._grant(old.grants[n]) for n in self._grants),
            rules=tuple(self._rule(rule) for rule in old.rules if rule.grant in self._grants),
            claims=tuple(map(self._claim, old.claims)),
        )

    def _realm(self, realm: RealmAtom) -> RealmAtom:
        return replace(
            realm,
            identity_ca=_among(realm.identity_ca, self._certificates),
            permissions_ca=_among(realm.permissions_ca, self._certificates),
            governance=_one(realm.governance, self._documents),
            revoked=_among(realm.revoked, self._certificates),
            refuses=_among(realm.refuses, self._certificates),
            revoked_later=(),
            refuses_later=(),
        )

    def _grant(self, grant: GrantAtom) -> GrantAtom:
        return replace(grant, document=self._documents[grant.document], names=_among(grant.names, self._certificates))

    def _rule(self, rule: RuleAtom) -> RuleAtom:
        return replace(
            rule,
            grant=self._grants[rule.grant],
            publish=self._named(rule.publish),
            subscribe=self._named(rule.subscribe),
            relay=self._named(rule.relay),
        )

    def _claim(self, claim: ClaimAtom) -> ClaimAtom:
        return replace(
            claim,
            source=self._place(claim.source),
            target=self._place(claim.target),
            through=_among(claim.through, self._enclaves),
            left_out=self._named(claim.left_out),
            stopping=frozenset(),
            starts=frozenset((self._enclaves[e], domain) for e, domain in claim.starts if e in self._enclaves),
            pairs=tuple(
                (self._place(one), self._place(other))
                for one, other in claim.pairs
                if (one.enclaves | other.enclaves) <= self._enclaves.keys()
            ),
        )

    def _place(self, place: Place) -> Place:
        return replace(
            place,
            enclaves=_among(place.enclaves, self._enclaves),
            channels=self._named(place.channels),
            certificates=_among(place.certificates, self._certificates),
        )

    def _named(self, channels: frozenset[int]) -> frozenset[int]:
        """The channels of a set that remain; rules share their sets."""
        if id(channels) not in self._memo:
            self._memo[id(channels)] = _among(channels, self._channels)
        return self._memo[id(channels)]


def _numbers(kept: Iterable[int]) -> dict[int, int]:
    """From the old index to the new one."""
    return {old: new for new, old in enumerate(kept)}


def _among(members: frozenset[int], numbers: Mapping[int, int]) -> frozenset[int]:
    return frozenset(numbers[member] for member in members if member in numbers)


def _one(index: int | None, numbers: Mapping[int, int]) -> int | None:
    return None if index is None else numbers[index]


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
            rules[last[rule.grant]] = replace(
                before,
                publish=before.publish | rule.publish,
                subscribe=before.subscribe | rule.subscribe,
                relay=before.relay | rule.relay,
            )
    return replace(system, rules=tuple(rules))
