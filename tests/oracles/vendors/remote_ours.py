"""What the product says that peers accept from the remote enclave of a keystore: the one place that asks it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.model.question import Answer, Question
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.oracles.vendors.enclave import Endpoint

PROFILES = {"cyclone": "cyclonedds-0.10", "fastdds": "fastdds-2.9"}
"""The profile of what is installed, by the name that the tests give the vendor."""


def effective(
    keystore: Path, enclave: str, domain: int, endpoints: Sequence[Endpoint], vendor: str
) -> tuple[Truth | None, ...]:
    """For each endpoint of the enclave what the most permissive peer accepts; None where no question asks for it."""
    found = answers(keystore, enclave, domain, endpoints, vendor)
    return tuple(None if answer is None else answer.effective for answer in found)


def answers(
    keystore: Path, enclave: str, domain: int, endpoints: Sequence[Endpoint], vendor: str
) -> tuple[Answer | None, ...]:
    """For each endpoint of the enclave all that we say; None where no question asks for it."""
    asked = [_question(enclave, domain, endpoint) for endpoint in endpoints]
    questions = [question for question in asked if question is not None]
    profile = VARIANTS[PROFILES[vendor]]
    access = Access(keystore, questions, Circumstances(profiles=[profile], at=datetime.now(timezone.utc)))
    return tuple(None if question is None else access.answers(question)[profile.name] for question in asked)


def _question(enclave: str, domain: int, endpoint: Endpoint) -> Question | None:
    """A question is about one partition."""
    if len(endpoint.partitions) > 1:
        return None
    partition = endpoint.partitions[0] if endpoint.partitions else ""
    return Question(
        enclave=enclave, operation=endpoint.operation, topic=endpoint.topic, domain=domain, partition=partition
    )
