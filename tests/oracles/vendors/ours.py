"""What we say of the keystores that the vendors are asked about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

from msgspec import Struct

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.question import Answer, Question
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.oracles.vendors import enclave

PROFILES = {"cyclone": VARIANTS["cyclonedds-0.10"], "fastdds": VARIANTS["fastdds-2.9"]}
"""What we call the vendors that are installed."""


class Verdict(Struct, frozen=True, kw_only=True):
    """Whether a participant starts and why not, and the decision on each endpoint.

    An endpoint in several partitions may be created only if it may be in each of them; `exact` says of each whether
    that is all it needs.
    """

    usable: Truth
    reason: str
    endpoints: tuple[Truth, ...]
    exact: tuple[bool, ...]


def decide(
    keystore: Path, domain: int, endpoints: Sequence[enclave.Endpoint], at: datetime, time_zone: str
) -> dict[str, Verdict]:
    """What both do with the enclave /talker, by the vendor's name here."""
    asked = {endpoint: _questions(endpoint, domain) for endpoint in endpoints}
    questions = [question for each in asked.values() for question in each]
    starts = Question(enclave="/talker", operation=Operation.PUBLISH, topic="started", domain=domain)
    profiles = tuple(PROFILES.values())
    access = Access(keystore, [starts, *questions], Circumstances(profiles=profiles, at=at, zone=ZoneInfo(time_zone)))
    answers = {question: access.answers(question) for question in [starts, *questions]}
    return {vendor: _verdict(vendor, asked, starts, answers) for vendor in PROFILES}


def _questions(endpoint: enclave.Endpoint, domain: int) -> list[Question]:
    return [
        Question(
            enclave="/talker",
            operation=endpoint.operation,
            topic=endpoint.topic,
            domain=domain,
            partition=partition,
        )
        for partition in endpoint.partitions or ("",)
    ]


def _verdict(
    vendor: str,
    asked: Mapping[enclave.Endpoint, Sequence[Question]],
    starts: Question,
    answers: Mapping[Question, Mapping[str, Answer]],
) -> Verdict:
    name = PROFILES[vendor].name
    started = answers[starts][name]
    rulings = []
    for questions in asked.values():
        each = {answers[question][name].decision for question in questions}
        rulings.append(next(ruling for ruling in (Truth.NO, Truth.UNKNOWN, Truth.YES) if ruling in each))
    # Fast DDS asks the one rule that decides about each partition; Cyclone DDS wants one criterion that lists all.
    exact = tuple(vendor == "fastdds" or len(questions) == 1 for questions in asked.values())
    return Verdict(usable=started.usable, reason=started.reason, endpoints=tuple(rulings), exact=exact)
