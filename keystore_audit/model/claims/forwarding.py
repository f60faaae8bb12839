"""What comes to the topics that a claim of determinism is about, in one system, as long as nobody attacks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels
from keystore_audit.model.claims.globs import by_default, matching, means_everybody, named_paths, nearest, region_of
from keystore_audit.model.claims.named import UNREAD, Declared, Determinism, Forward
from keystore_audit.model.claims.stated import check_granted, granted_channels, marked
from keystore_audit.model.domains import contains
from keystore_audit.model.formal.asked import (
    Behaviour,
    DeterminismAtom,
    Differs,
    ForwardAtom,
    InputAtom,
    Meeting,
    Passage,
    SlotAtom,
    Spread,
)
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.flow import Flows, Lane
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.rights import OwnRights
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.question import Usability


class _Plan(Struct, frozen=True, kw_only=True):
    """What is asked about in one domain; `holders`: by slot, whose it is."""

    domain: int
    topics: tuple[str, ...]
    slots: tuple[SlotAtom, ...]
    holders: tuple[int, ...]


class Forwarding:
    """The declared forwards in the atoms of one system."""

    def __init__(
        self,
        system: System,
        declared: Declared,
        channels: Channels,
        keystore: Keystore,
        usability: Mapping[tuple[str, str], Usability],
        domain: int | None,
    ) -> None:
        self.system = system
        self._declared = declared
        self._usability = usability
        self._directories = {enclave.path: enclave.files.directory for enclave in keystore.enclaves}
        self._number = {enclave.label: number for number, enclave in enumerate(system.enclaves)}
        self._doing = {forward.enclave for forward in declared.forwards}
        permissions = Permissions(system)
        self._within = permissions.channels_in
        self._domains = [
            number for number, each in enumerate(channels.domains) if domain is None or contains(each.intervals, domain)
        ]
        views = trust_domain_views(system, permissions)
        self._own = [OwnRights(system, view) for view in views]
        self._lanes = Flows(system, views).by_right()
        regions = channels.regions
        topics = {t for f in declared.forwards for t in (*f.sources, *f.targets)}
        topics |= {t for claim in declared.claims for t in (*claim.low, *claim.high.topics)}
        self._anywhere = {topic: bits(regions[region_of((topic,))]) for topic in topics}
        self._by_default = {topic: bits(regions[by_default(topic)]) for topic in topics}
        self._forwards = [
            (
                self._number[f.enclave],
                union(self._by_default[t] for t in f.sources),
                union(self._by_default[t] for t in f.targets),
            )
            for f in declared.forwards
            if f.enclave in self._number
        ]
        """Whose it is, and the channels from and to which each goes."""
        self._ambient = bits(regions[region_of(AMBIENT)])

    def atom(self, claim: Determinism) -> DeterminismAtom:
        """The claim as facts."""
        forwards = claim.forwards
        undecided = next(filter(None, map(self._stopped, forwards)), "")
        domains = () if undecided else self._domains
        possible = {d: [f for f in forwards if self._lacking(f, d) is None] for d in domains}
        if not undecided and not any(len(there) == len(forwards) for there in possible.values()):
            undecided = self._impossible(forwards)
        spread = self._spread(claim)
        differs = self._differs(claim, spread.inside)
        found = [self._behaviour(claim, there, domain, differs) for domain, there in possible.items()]
        behaviours = tuple(each for each in found if each.seen())
        if not undecided and not behaviours:
            undecided = f"nobody may publish {', '.join(claim.low)}"
        if undecided:
            return DeterminismAtom(id=claim.id, behaviours=(), undecided=undecided, location=claim.location)
        return DeterminismAtom(
            id=claim.id,
            behaviours=behaviours,
            undecided="",
            location=claim.location,
            meetings=tuple(each for d, there in possible.items() for each in self._meetings(claim, there, d)),
            spread=spread,
        )

    def told(self, atom: DeterminismAtom) -> object:
        """The atom with names for indices, which readings of one keystore have in common."""

        def name(enclave: int | None) -> str | None:
            return None if enclave is None else self.system.enclaves[enclave].label

        inputs = [[(name(i.enclave), i.topic, i.differs, i.reaches) for i in b.inputs] for b in atom.behaviours]
        forwards = [[(name(f.enclave), f.targets, f.reaches) for f in b.forwards] for b in atom.behaviours]
        return (atom.undecided, inputs, forwards, [(b.domain, b.topics, b.slots) for b in atom.behaviours])

    def _stopped(self, forward: Forward) -> str:
        """Why the forward cannot be, whatever the domain; empty where it can."""
        if forward.enclave not in self._number:
            return f"{forward.enclave} could not be read"
        starts = [self._usability[self._directories[forward.enclave], p].usable for p in self.system.profiles]
        return (
            ""
            if all(each.must for each in starts)
            else f"{forward.enclave}, whose forwards are declared, may not start"
        )

    def _lacking(self, forward: Forward, domain: int) -> str | None:
        """A topic that the forward's enclave may not use in the domain by its own permissions; None where it may."""
        number = self._number[forward.enclave]
        able = self._own[self.system.enclaves[number].trust_domain].abilities(number)
        here = self._within[domain]
        for topic in forward.sources:
            if not able.may_read & self._by_default[topic] & here:
                return f"subscribe to {topic}"
        for topic in forward.targets:
            if not able.may_write & self._by_default[topic] & here:
                return f"publish {topic}"
        return None

    def _impossible(self, forwards: Sequence[Forward]) -> str:
        for forward in forwards:
            missing = [self._lacking(forward, domain) for domain in self._domains]
            if missing and all(missing):
                return f"the declared forwards are impossible: {forward.enclave} may not {missing[0]}"
        return "no single domain allows all declared forwards"

    def _behaviour(
        self, claim: Determinism, forwards: Sequence[Forward], domain: int, differs: Sequence[Differs]
    ) -> Behaviour:
        """What comes to the low topics in one domain."""
        topics = tuple(dict.fromkeys([*claim.low, *(t for f in forwards for t in f.sources)]))
        slots = tuple(
            SlotAtom(forward=place, topic=topics.index(topic))
            for place, forward in enumerate(forwards)
            for topic in forward.sources
        )
        holders = tuple(self._number[forwards[slot.forward].enclave] for slot in slots)
        plan = _Plan(domain=domain, topics=topics, slots=slots, holders=holders)
        return Behaviour(
            domain=domain,
            topics=topics,
            forwards=tuple(self._forward(forward, plan) for forward in forwards),
            slots=slots,
            inputs=tuple(_few(self._inputs(claim, plan, differs))),
            low=frozenset(topics.index(topic) for topic in claim.low),
        )

    def _forward(self, forward: Forward, plan: _Plan) -> ForwardAtom:
        sender = self._number[forward.enclave]
        targets = [topic for topic in forward.targets if topic in plan.topics]
        reaches = [self._reached(sender, topic, plan) for topic in targets]
        return ForwardAtom(
            enclave=sender,
            scheduler=forward.scheduler,
            targets=frozenset(map(plan.topics.index, targets)),
            reaches=frozenset[int]().union(*reaches),
        )

    def _inputs(self, claim: Determinism, plan: _Plan, differs: Sequence[Differs]) -> Iterator[InputAtom]:
        """What enclaves without declared forwards may publish on the topics, and anybody on those that are high."""
        for place, topic in enumerate(plan.topics):
            if topic in claim.high.topics:
                everywhere = frozenset(n for n, slot in enumerate(plan.slots) if slot.topic == place)
                yield InputAtom(enclave=None, topic=place, differs=Differs.ALWAYS, reaches=everywhere)
                continue
            for sender, enclave in enumerate(self.system.enclaves):
                if enclave.label in self._doing:
                    continue
                reaches = self._reached(sender, topic, plan)
                if reaches or (topic in claim.low and self._puts(sender, topic, plan.domain)):
                    yield InputAtom(enclave=sender, topic=place, differs=differs[sender], reaches=reaches)

    def _reached(self, sender: int, topic: str, plan: _Plan) -> frozenset[int]:
        """The slots that get what the enclave puts on the topic."""
        return frozenset(
            place
            for place, (slot, holder) in enumerate(zip(plan.slots, plan.holders, strict=True))
            if plan.topics[slot.topic] == topic and self._hops(sender, topic, holder, plan.domain)
        )

    def _differs(self, claim: Determinism, inside: frozenset[int]) -> list[Differs]:
        """By enclave, of what it publishes. `inside`: those that something high can come to."""
        high = self._high(claim)
        perhaps = [Differs.PERHAPS if n in inside else Differs.NEVER for n in range(len(self.system.enclaves))]
        return [Differs.ALWAYS if n in high else each for n, each in enumerate(perhaps)]

    def _hops(self, sender: int, topic: str, receiver: int, domain: int) -> bool:
        """Whether a sample of the topic goes over, in the domain."""
        here = self._by_default[topic] & self._within[domain]
        return any(lane.puts[sender] & here and lane.gets[receiver] & here for lane in self._lanes)

    def _puts(self, sender: int, topic: str, domain: int) -> bool:
        here = self._anywhere[topic] & self._within[domain]
        return any(lane.puts[sender] & here for lane in self._lanes)

    def _meetings(self, claim: Determinism, forwards: Sequence[Forward], domain: int) -> Iterator[Meeting]:
        """Who hands samples to whom, of all that a behaviour in this domain rests on."""
        here, everybody = self._within[domain], range(len(self.system.enclaves))
        for holder, topic in dict.fromkeys((self._number[f.enclave], topic) for f in forwards for topic in f.sources):
            yield Meeting(
                channels=frozenset(members(self._by_default[topic] & here)),
                receiver=holder,
                senders=frozenset(n for n in everybody if self._hops(n, topic, holder, domain)),
            )
        for topic in claim.low:
            yield Meeting(
                channels=frozenset(members(self._anywhere[topic] & here)),
                receiver=None,
                senders=frozenset(n for n in everybody if self._puts(n, topic, domain)),
            )

    def _high(self, claim: Determinism) -> frozenset[int]:
        return frozenset(
            n
            for n, enclave in enumerate(self.system.enclaves)
            for glob in claim.high.enclaves
            if (means_everybody(glob) if enclave.unmanaged else matching(glob, [enclave.label]))
        )

    def _spread(self, claim: Determinism) -> Spread:
        """Where something high can come to, nodes without declared forwards passing on anything, in any domain."""
        left_out = 0 if claim.include_ambient else self._ambient
        first = union(self._anywhere[topic] for topic in claim.high.topics)
        lanes = [self._passed_on(lane, ~left_out) for lane in self._lanes]
        reached, before = self._high(claim), None
        while reached != before:
            before, sent = reached, [first | union(lane.puts[each] for each in reached) for lane in lanes]
            reached = before.union(*(lane.getting(each) for lane, each in zip(lanes, sent, strict=True)))
        enclaves = len(self.system.enclaves)
        return Spread(
            inside=frozenset(each for each in reached if each < enclaves),
            declared=frozenset(self._number[label] for label in self._doing if label in self._number),
            first=frozenset(members(first)),
            left_out=frozenset(members(left_out)),
            passages=tuple(
                Passage(
                    enclave=enclave,
                    sources=frozenset(members(sources)),
                    targets=frozenset(members(targets)),
                    reached=place in reached,
                )
                for place, (enclave, sources, targets) in enumerate(self._forwards, enclaves + 1)
            ),
        )

    def _passed_on(self, lane: Lane, usable: int) -> Lane:
        """The lane with declared forwards, after the outsider, in the place of the enclaves that have them."""
        free = [*(enclave.label not in self._doing for enclave in self.system.enclaves), True]
        puts = [put & usable if each else 0 for put, each in zip(lane.puts, free, strict=True)]
        gets = [got if each else 0 for got, each in zip(lane.gets, free, strict=True)]
        return Lane(
            puts=[*puts, *(lane.puts[enclave] & targets for enclave, _sources, targets in self._forwards)],
            gets=[*gets, *(lane.gets[enclave] & sources for enclave, sources, _targets in self._forwards)],
        )


def _few(inputs: Iterable[InputAtom]) -> Iterator[InputAtom]:
    """Of inputs that are alike, one where it may differ anyhow, else two, of which either may be the newest."""
    seen: dict[InputAtom, int] = {}
    for each in inputs:
        kind = replace(each, enclave=None)
        seen[kind] = seen.get(kind, 0) + 1
        if seen[kind] <= (1 if each.differs is Differs.ALWAYS else 2):
            yield each


def with_determinism(
    systems: Sequence[System],
    declared: Declared,
    channels: Channels,
    keystore: Keystore,
    usability: Mapping[tuple[str, str], Usability],
    domain: int | None,
) -> tuple[System, ...]:
    """The systems with the claims of determinism as facts. `usability`: by directory and profile. `domain`: the one
    that the robots use, None: any.

    Raises errors.UsageError for what is declared of something that is not in the keystore.
    """
    if not declared.claims or not systems:
        return tuple(systems)
    _check(declared, systems, channels, keystore)
    resolved = [Forwarding(system, declared, channels, keystore, usability, domain) for system in systems]
    atoms = [[each.atom(claim) for claim in declared.claims] for each in resolved]
    for number in range(len(declared.claims)):
        read: dict[tuple[str, ...], object] = {}
        for each, found in zip(resolved, atoms, strict=True):
            told = each.told(found[number])
            if read.setdefault(each.system.profiles, told) != told:
                read[each.system.profiles] = None
        for each, found in zip(resolved, atoms, strict=True):
            if read[each.system.profiles] is None:
                found[number] = replace(found[number], behaviours=(), undecided=UNREAD)
    return tuple(replace(each.system, determinism=tuple(found)) for each, found in zip(resolved, atoms, strict=True))


def _check(declared: Declared, systems: Sequence[System], channels: Channels, keystore: Keystore) -> None:
    """Raises errors.UsageError for names that find nothing, and for an enclave that is high and has forwards."""
    paths = [enclave.path for enclave in keystore.enclaves]
    used = granted_channels(systems)
    for forward in declared.forwards:
        if forward.enclave not in paths:
            near = nearest(forward.enclave, paths)
            raise UsageError(
                f"{marked(forward, forward.enclave)}: {forward.enclave!r} is no enclave of this keystore{near}."
            )
        for topic in (*forward.sources, *forward.targets):
            check_granted(topic, channels, used, marked(forward, topic))
    for claim in declared.claims:
        for topic in (*claim.low, *claim.high.topics):
            check_granted(topic, channels, used, marked(claim, topic))
        for glob in claim.high.enclaves:
            found = named_paths(glob, paths, marked(claim, glob))
            for forward in declared.forwards:
                if forward.enclave in found:
                    raise UsageError(
                        f"{claim.place}: {forward.enclave!r} is high, but {forward.place} declares what it does. "
                        "Name the topics that it gets instead."
                    )
