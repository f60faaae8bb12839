"""What we say of the keystores that the vendors are asked about: the one place that asks us."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.question import Answer, Question
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.oracles.vendors.enclave import Endpoint

PROFILES = {"cyclone": "cyclonedds-0.10", "fastdds": "fastdds-2.9"}
"""The profile of what is installed, by the name that the tests give the vendor."""

Answers = tuple[tuple[Answer, ...], ...]
"""For each endpoint an answer for each of its partitions."""


class Asked:
    """A keystore's enclave, asked about a domain and endpoints in it."""

    def __init__(
        self,
        keystore: Path,
        enclave: str,
        domain: int,
        endpoints: Sequence[Endpoint],
        at: datetime,
        time_zone: str = "UTC",
    ) -> None:
        def question(endpoint: Endpoint, partition: str) -> Question:
            return Question(
                enclave=enclave,
                operation=endpoint.operation,
                topic=endpoint.topic,
                domain=domain,
                partition=partition,
            )

        self._starts = question(Endpoint(operation=Operation.PUBLISH, topic="started"), "")
        self._asked = [[question(each, partition) for partition in each.partitions or ("",)] for each in endpoints]
        questions = [self._starts, *(question for several in self._asked for question in several)]
        profiles = tuple(VARIANTS[name] for name in PROFILES.values())
        self._access = Access(keystore, questions, Circumstances(profiles=profiles, at=at, zone=ZoneInfo(time_zone)))

    def starts(self, vendor: str) -> Answer:
        """What is said of the participant."""
        return self._answer(self._starts, vendor)

    def endpoints(self, vendor: str) -> Answers:
        """What is said of the endpoints."""
        return tuple(tuple(self._answer(question, vendor) for question in several) for several in self._asked)

    def _answer(self, question: Question, vendor: str) -> Answer:
        return self._access.answers(question)[PROFILES[vendor]]


def of_all(rulings: Sequence[Truth]) -> Truth:
    """An endpoint in several partitions may be what it may be in each of them."""
    return next(ruling for ruling in (Truth.NO, Truth.UNKNOWN, Truth.YES) if ruling in rulings)


def is_exact(vendor: str, partitions: Sequence[object]) -> bool:
    """Whether what an endpoint may in each of its partitions is all it needs.

    Fast DDS asks the one rule that decides about each partition; Cyclone DDS wants one criterion that lists all.
    """
    return vendor == "fastdds" or len(partitions) == 1


def agree(vendor: str, rulings: Sequence[Truth], theirs: bool) -> bool:
    """Whether the vendor does as we say, by our ruling on each partition; not where we do not know."""
    ours = of_all(rulings)
    return ours is Truth(theirs) or (ours is Truth.YES and not is_exact(vendor, rulings))
