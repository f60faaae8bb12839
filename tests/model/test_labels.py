"""Labels: which flows violate them, counted out label by label, against the claims that they become."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping

import pytest

from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import (
    Claim,
    CyclicOrder,
    Declassifier,
    Labelled,
    Labelling,
    Lattice,
    chain,
    ordered,
    powerset,
    turned,
)
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Status
from tests.amount import tried
from tests.engine.flows_by_hand import OUTSIDER, ByHand, Flow
from tests.engine.systems import random_system

HERE = Location(path="keystore-audit.toml", line=1, beside=True)
LATTICES = (
    chain(("public", "internal", "secret")),
    turned(chain(("low", "high"))),
    powerset({"none": (), "a": ("a",), "b": ("b",), "both": ("a", "b")}),
    ordered({"public": (), "left": ("public",), "right": ("public",), "apart": ()}),
)


def labelling(lattice: Lattice, labelled: Iterable[Labelled], attacker: Attacker, *trusted: Declassifier) -> Labelling:
    return Labelling(
        lattice=lattice,
        labelled=tuple(labelled),
        declassifiers=trusted,
        attacker=attacker,
        include_ambient=True,
        location=HERE,
        place="keystore-audit.toml:1:1",
    )


def atom(system: System, claim: Claim) -> ClaimAtom:
    """The claim in the system, whose names the globs are."""

    def place(globs: Globs) -> Place:
        return Place(
            enclaves=frozenset(n for n, e in enumerate(system.enclaves) if e.label in globs.enclaves),
            channels=frozenset(n for n, c in enumerate(system.channels) if c.topic in globs.topics),
        )

    return ClaimAtom(
        id=claim.id,
        kind=claim.kind,
        attacker=claim.attacker,
        source=place(claim.source),
        target=place(claim.target),
        through=place(Globs(enclaves=claim.through)).enclaves,
        left_out=frozenset(),
        until=None,
        location=HERE,
    )


def violated(system: System, given: Labelling) -> set[tuple[str, str]]:
    """The pairs of labels that the engine finds violated."""
    claims = {claim.id: claim for claim in given.claims()}
    asked = System(**{**_fields(system), "claims": tuple(atom(system, claim) for claim in claims.values())})
    answers = NativeEngine([asked]).claim_answers()[0]
    return {
        (claim.labels.source, claim.labels.target)
        for name, claim in claims.items()
        if claim.labels is not None and answers[name].status is Status.VIOLATED
    }


def _fields(system: System) -> dict[str, object]:
    return {name: getattr(system, name) for name in system.__struct_fields__}


class Tokens:
    """Data of each label, followed from everywhere it comes from: what docs/model.md says of labels, word by word."""

    def __init__(self, system: System, given: Labelling) -> None:
        self.system, self.given, self.hand = system, given, ByHand(system)
        self.people = [*self.hand.enclaves, OUTSIDER]
        self.trusted = {
            number: declassifier
            for declassifier in given.declassifiers
            for number, enclave in enumerate(system.enclaves)
            if enclave.label in declassifier.enclaves
        }

    def label(self, enclave: int) -> str | None:
        if enclave == OUTSIDER:
            return None
        path = self.system.enclaves[enclave].label
        return next((one.label for one in self.given.labelled if path in one.enclaves), None)

    def takes(self, person: int) -> str | None:
        return self.trusted[person].taken if person in self.trusted else self.label(person)

    def gives(self, person: int) -> str | None:
        return self.trusted[person].given if person in self.trusted else self.label(person)

    def channels(self, label: str) -> set[int]:
        names = {topic for one in self.given.labelled if one.label == label for topic in one.topics}
        return {number for number, channel in enumerate(self.system.channels) if channel.topic in names}

    def violations(self) -> set[tuple[str, str]]:
        return {(source, target) for source in self.given.lattice for target in self._wrong(source)}

    def _wrong(self, label: str) -> set[str]:
        """Labels of what data of this label gets to, though it may not."""
        begun = {person for person in self.people if self.gives(person) == label}
        flow = Flow(self.hand, self._claim(begun))
        got = set[int]().union(*map(flow.getters, self.channels(label)))
        hops = {(sender, receiver) for sender, _channel, receiver in flow.hops}
        reached, arrived = set(begun), set(got)
        waiting = [*begun, *(p for p in got if p not in self.trusted and p not in begun)]
        reached.update(waiting)
        while waiting:
            sender = waiting.pop()
            for receiver in self.people:
                if (sender, receiver) in hops:
                    arrived.add(receiver)
                    if receiver not in reached and receiver not in self.trusted:
                        reached.add(receiver)
                        waiting.append(receiver)
        found = {self.takes(person) for person in arrived}
        for person in reached:
            put = flow.put(person)
            found |= {other for other in self.given.lattice if put & self.channels(other)}
        return {other for other in found if other is not None and other not in self.given.lattice[label]}

    def _claim(self, begun: set[int]) -> ClaimAtom:
        """Who attacks: `source` means those at which data of the label begins."""
        return ClaimAtom(
            id="x",
            kind=ClaimKind.NO_FLOW,
            attacker=self.given.attacker,
            source=Place(enclaves=frozenset(begun - {OUTSIDER})),
            target=Place(),
            through=frozenset(),
            left_out=frozenset(),
            until=None,
            location=HERE,
        )


def chance(seed: int, attacker: Attacker) -> tuple[System, Labelling]:
    """A system with labels on some of what is in it, each enclave and topic at most one."""
    draw = random.Random(f"labels {seed}")
    system = random_system(seed)
    lattice = LATTICES[seed % len(LATTICES)]
    labels = list(lattice)
    enclaves: dict[str, list[str]] = {label: [] for label in labels}
    topics: dict[str, list[str]] = {label: [] for label in labels}
    trusted = []
    for path in sorted({enclave.label for enclave in system.enclaves}):
        lot = draw.random()
        if lot < 0.25:
            taken, given = draw.sample(labels, 2)
            trusted.append(Declassifier(enclaves=(path,), taken=taken, given=given, place="x:1:1"))
        elif lot < 0.7:
            enclaves[draw.choice(labels)].append(path)
    for topic in sorted({channel.topic for channel in system.channels}):
        if draw.random() < 0.4:
            topics[draw.choice(labels)].append(topic)
    marked = (
        Labelled(label=label, enclaves=tuple(enclaves[label]), topics=tuple(topics[label]), place="x:1:1")
        for label in labels
    )
    return system, labelling(lattice, marked, attacker, *trusted)


@pytest.mark.parametrize("attacker", [Attacker.HONEST, Attacker.RELAYS])
@pytest.mark.parametrize("start", range(0, tried(240, 80), 80))
def test_claims_say_what_labels_say(start: int, attacker: Attacker) -> None:
    told = {True: 0, False: 0}
    for seed in range(start, start + 80):
        system, given = chance(seed, attacker)
        found, expected = violated(system, given), Tokens(system, given).violations()
        assert found == expected, seed
        told[bool(found)] += 1
    assert min(told.values()) > 5


def test_an_attacking_source_is_everything_with_the_label() -> None:
    found = 0
    for seed in range(tried(160, 60)):
        system, given = chance(seed, Attacker.SOURCE)
        plain = [one for one in given.labelled if one.enclaves]
        apart = labelling(
            given.lattice,
            (Labelled(label=one.label, enclaves=one.enclaves, place=one.place) for one in plain),
            Attacker.SOURCE,
            *given.declassifiers,
        )
        expected = Tokens(system, apart).violations()
        assert violated(system, apart) == expected, seed
        found += bool(expected)
    assert found > tried(10)


def test_with_labels_on_everything_every_violation_is_of_one_right() -> None:
    """Bell and LaPadula: no read up, no write down; what is transitive is more only where something has no label."""
    told = {True: 0, False: 0}
    for seed in range(tried(200, 60)):
        system = random_system(seed)
        draw = random.Random(f"everything {seed}")
        lattice = LATTICES[seed % len(LATTICES)]
        labels = list(lattice)
        enclaves = {e.label: draw.choice(labels) for e in system.enclaves}
        topics = {c.topic: draw.choice(labels) for c in system.channels}
        given = labelling(
            lattice,
            (
                Labelled(label=mark, enclaves=keys(enclaves, mark), topics=keys(topics, mark), place="")
                for mark in labels
            ),
            Attacker.HONEST,
        )
        hand = ByHand(system)
        trust_domains = range(len(system.trust_domains))
        bad = False
        for number, enclave in enumerate(system.enclaves):
            mine = enclaves[enclave.label]
            written = {c for trust_domain in trust_domains for c in hand.powers(number, trust_domain).honest_writes}
            bad = bad or any(topics[system.channels[c].topic] not in lattice[mine] for c in written)
            bad = bad or any(
                mine not in lattice[topics[system.channels[c].topic]]
                for c in hand.powers(number, enclave.trust_domain).honest_reads
            )
        assert bool(violated(system, given)) == bad, seed
        told[bad] += 1
    assert min(told.values()) > 20


def keys(marks: Mapping[str, str], label: str) -> tuple[str, ...]:
    return tuple(name for name, mark in marks.items() if mark == label)


@pytest.mark.parametrize("lattice", [*LATTICES, *(turned(one) for one in LATTICES)])
def test_lattices_are_partial_orders(lattice: Lattice) -> None:
    labels = list(lattice)
    for one in labels:
        assert one in lattice[one]
        for other in labels:
            assert one == other or not (other in lattice[one] and one in lattice[other])
            for third in labels:
                if other in lattice[one] and third in lattice[other]:
                    assert third in lattice[one]


@pytest.mark.parametrize("below", [{"a": ("a",)}, {"a": ("b",), "b": ("c",), "c": ("a",), "d": ("a",)}])
def test_an_order_in_a_circle_is_none(below: dict[str, tuple[str, ...]]) -> None:
    with pytest.raises(CyclicOrder) as caught:
        ordered(below)
    assert set(caught.value.labels) == set(below) - {"d"}
