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
from tests.oracles.vendors.enclave import Endpoint

PROFILES = {"cyclone": "cyclonedds-0.10", "fastdds": "fastdds-2.9"}
"""The profile of what is installed, by the name that the tests give the vendor."""

_ASKED = PROFILES | {"cyclone-11": "cyclonedds-11"}
"""And of what was asked once (test_cyclonedds_11.py)."""


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
        def question(endpoint: Endpoint) -> Question:
            return Question(
                enclave=enclave,
                operation=endpoint.operation,
                topic=endpoint.topic,
                domain=domain,
                partitions=endpoint.partitions or ("",),
            )

        self._starts = question(Endpoint(operation=Operation.PUBLISH, topic="started"))
        self._asked = [*map(question, endpoints)]
        questions = [self._starts, *self._asked]
        profiles = tuple(VARIANTS[name] for name in _ASKED.values())
        self._access = Access(keystore, questions, Circumstances(profiles=profiles, at=at, zone=ZoneInfo(time_zone)))

    def starts(self, vendor: str) -> Answer:
        """What is said of the participant."""
        return self._answer(self._starts, vendor)

    def endpoints(self, vendor: str) -> tuple[Answer, ...]:
        """What is said of the endpoints."""
        return tuple(self._answer(question, vendor) for question in self._asked)

    def _answer(self, question: Question, vendor: str) -> Answer:
        return self._access.answers(question)[_ASKED[vendor]]
