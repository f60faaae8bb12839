"""How tests ask the audit and the checker about one store."""

from __future__ import annotations

import json
from collections.abc import Iterator, Set
from datetime import datetime, timezone
from pathlib import Path
from random import Random
from typing import Any, Final

from keystore_audit.certificate.checking import (
    OVERHEARD,
    TAKEN,
    Checker,
    Compartment,
    Flow,
    Given,
    Implementation,
    NoFlow,
)
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.certificate.powers import OUTSIDER
from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import FlowQuestion, posed, questions
from keystore_audit.model.formal.asked import Attacker, search_of
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.flow import Flows
from keystore_audit.profiles import DEFAULT, resolve

AT: Final = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
EVERY: Final = Given(DEFAULT, AT)


def reading(profiles: tuple[str, ...] = DEFAULT) -> Circumstances:
    """How the audit reads a store."""
    return Circumstances(profiles=resolve(profiles), at=AT)


def reached(path: Path, asked: NoFlow) -> dict[str, set[str]]:
    """By profile, whom data gets to from the source as the engine has it, what could not be read doing anything."""
    question = FlowQuestion(
        source=asked.source,
        target=asked.target,
        attackers=(Attacker(asked.attacker),),
        through=asked.through,
        include_ambient=asked.include_ambient,
    )
    found = dict[str, set[str]]()
    for system in posed(path, questions(question), reading())[2].systems[::-1]:  # the larger reading is first
        there = Flows(system, trust_domain_views(system)).reached(search_of(system.claims[0]))
        labels = [*(enclave.label for enclave in system.enclaves), OUTSIDER]
        told = {labels[-1 if each is None else each] for each in there}
        found.update(dict.fromkeys(system.profiles, told))
    return found


def verdict(content: bytes, checker: Checker) -> str:
    """What the checker says."""
    try:
        checker.check(content)
    except Refused:
        return "refused"
    except CannotTell:
        return "cannot tell"
    return "accepted"


def forged(implementation: Implementation, inside: Set[str], *, bare: bool) -> Compartment:
    """A compartment of these participants with a reason for each hop, though not each is refused.

    Of a flow: that begins and ends nowhere; `bare`: without any name inside, else with those on which somebody inside
    does put something. Of rights: `bare`: without a word about whoever has the right.
    """
    honest, kind = implementation.hops, implementation.__class__

    def hops(*asked: Any) -> Iterator[tuple[str, bool, dict[str, bool]]]:
        for way, held, whom in honest(*asked):
            yield way, held, {who: False for who, does in whom.items() if not (bare and does)}

    implementation.__class__ = {Flow: Bare if bare else Lenient}.get(kind, kind)
    implementation.hops = hops  # type: ignore[method-assign]
    try:
        return implementation.compartment(inside)
    finally:
        implementation.__class__ = kind
        del implementation.hops


class Lenient(Flow):
    """One that finds that nobody gets anything, and begins or ends nowhere."""

    def gets(self, *_: Any) -> bool:
        return False

    def _in(self, *_: Any) -> bool:
        return False


class Bare(Lenient):
    """One that finds that nobody puts anything either."""

    def puts(self, *_: Any) -> bool:
        return False


def closed(implementation: Flow) -> set[str]:
    """Whom data gets to from the source by the hops of the checker itself.

    So no compartment that it accepts is smaller.
    """
    inside, before = {*implementation.source}, {"nobody"}
    while inside != before:
        before = {*inside}
        for peers, name in implementation.places:
            begins = implementation._in(implementation._asked.source, name)
            for way in (TAKEN, OVERHEARD):
                if begins or any(implementation.puts(peers, who, name, way) for who in before):
                    there = {*implementation.participants} - implementation._passed
                    inside |= {who for who in there if implementation.gets(peers, who, name, way)}
    return inside


def is_accepted(implementation: Implementation, compartment: Compartment) -> bool:
    """Whether the checker takes it for one."""
    try:
        implementation.check(compartment)
    except Refused:
        return False
    return True


def damaged(content: bytes, random: Random, count: int) -> Iterator[bytes]:
    """Certificates that differ from this one by one change of what it says."""
    whole = json.loads(content)
    for _ in range(count):
        found = json.loads(content)
        while found == whole:
            _change(found, random)
        yield json.dumps(found, indent=1, ensure_ascii=False).encode() + b"\n"


def _change(found: dict[str, Any], random: Random) -> None:
    compartment = random.choice(found["compartments"])
    refusal = random.choice(compartment["refused"])
    because = random.choice(refusal["because"])
    everybody = sorted({each["participant"] for each in compartment["refused"]} | {*compartment["participants"]})
    names = [
        {key: refusal[key] for key in ("peers", "domain", "topic")} | {"way": way} for way in ("taken", "overheard")
    ]
    kind = random.randrange(11)
    if kind == 0:
        compartment["refused"].remove(refusal)
    elif kind == 1:
        because["line"] += random.choice((-1, 1, 7))
    elif kind == 2:
        because["rule"] = random.choice(("rule", "default", "no grant", "protection", "ungoverned"))
    elif kind == 3:
        place = random.choice([*found["documents"]])
        digest = found["documents"][place]
        found["documents"][place] = digest[1:] + digest[0]
    elif kind == 4 and compartment["participants"]:
        compartment["participants"].remove(random.choice(compartment["participants"]))
    elif kind == 5:
        compartment["participants"] = sorted({*compartment["participants"], random.choice(everybody)})
    elif kind == 6 and compartment["names"]:
        compartment["names"].remove(random.choice(compartment["names"]))
    elif kind == 7:
        compartment["names"].append(random.choice(names))
        random.shuffle(compartment["names"])
    elif kind == 8:
        because["document"] = random.choice([*found["documents"], "enclaves/nowhere.p7s"])
    elif kind == 9:
        refusal["participant"] = random.choice(everybody)
    else:
        refusal[random.choice(("topic", "peers"))] += "x"
