"""Certificates of what holds (docs/certificates.md): the engine finds who is inside, the checker gives the reasons."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from keystore_audit.certificate.checking import Checker, Compartment, Given, Property, encoded
from keystore_audit.certificate.powers import OUTSIDER
from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import FlowAnswer, FlowQuestion, find_flow, reached
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.properties.result import Status


def prove(path: Path, asked: Property, given: Circumstances, told: Given) -> tuple[FlowAnswer, bytes | None]:
    """What the audit answers about the keystore at `path`; and the certificate, None unless it holds for certain.

    `told` is what the checker is to be told.

    Raises certificate.errors.NotAccepted where the checker cannot follow, and what `find_flow` raises.
    """
    question = FlowQuestion(
        source=asked.source,
        target=asked.target,
        attackers=(Attacker(asked.attacker),),
        through=asked.through,
        include_ambient=asked.include_ambient,
    )
    answer = find_flow(path, question, given)
    if answer.status is not Status.HOLDS:
        return answer, None
    checker, inside = Checker(path, asked, told), reached(path, question, given)
    alike: dict[Compartment, list[str]] = {}
    for name in told.profiles:
        participants = {OUTSIDER if each is None else each for each in inside[name]}
        alike.setdefault(checker.implementation(name).compartment(participants), []).append(name)
    compartments = tuple(replace(each, profiles=tuple(names)) for each, names in alike.items())
    content = encoded(checker.certificate(compartments))
    checker.check(content)
    return answer, content
