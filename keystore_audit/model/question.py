"""Questions about rights and their answers: may this enclave do that on this topic?"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from keystore_audit.dataclass import dataclass, replace
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation


class Ruling(str, Enum):
    """The three values of a decision (design section 3)."""

    ALLOW = "allow"
    DENY = "deny"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """May the enclave (its path) do this on a DDS topic, in a domain of 0..232 and a partition ("": the default)?"""

    enclave: str
    operation: Operation
    topic: str
    domain: int = 0
    partition: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What is answered of one of the DDS topics of a service or an action."""

    operation: Operation
    topic: str
    decision: Ruling
    effective: Ruling

    def __str__(self) -> str:
        return f"{self.operation.value} {self.topic}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Of one profile.

    `usable`: whether a participant is created in the domain. `decision`: whether its own implementation lets it; deny
    where it is not usable. `effective`: whether some peer in the keystore accepts it. `reason`: of the decision, a
    sentence without its full stop; `location`: the line that decides, if there is one. `parts`: of a service or an
    action, whose answer is that to whether all of it may be done.
    """

    usable: bool | None
    decision: Ruling
    effective: Ruling
    reason: str
    location: Location | None
    parts: tuple[Part, ...] = ()

    def ruling(self, *, effective: bool) -> Ruling:
        """What peers accept, or the decision."""
        return self.effective if effective else self.decision

    def denied(self, *, effective: bool) -> Ruling:
        """The same to whether none of it is done: what is sent counts.

        Servers carry out a request whether or not its sender may read the reply, and clients take a reply.
        """
        sent = [part for part in self.parts if part.operation is Operation.PUBLISH]
        if not sent:
            return self.ruling(effective=effective)
        return max((part.effective if effective else part.decision for part in sent), key=_OBSTACLES.index)


_OBSTACLES = (Ruling.DENY, Ruling.UNKNOWN, Ruling.ALLOW)


def joint(questions: Sequence[Question], answers: Sequence[Answer]) -> Answer:
    """One answer to whether all of it may be done; of several questions, it says which one decides.

    Deny outranks unknown, since one channel denied is enough.
    """
    question, decisive = min(zip(questions, answers, strict=True), key=lambda each: _OBSTACLES.index(each[1].decision))
    reason = decisive.reason
    if len(questions) > 1 and decisive.usable:
        which = "" if decisive.decision is not Ruling.ALLOW else f"each of the {len(questions)} is allowed, e.g. "
        reason = f"{which}{question.operation.value} {question.topic}: {reason}"
    effective = min((answer.effective for answer in answers), key=_OBSTACLES.index)
    parts = tuple(
        Part(operation=asked.operation, topic=asked.topic, decision=answer.decision, effective=answer.effective)
        for asked, answer in zip(questions, answers, strict=True)
    )
    return replace(decisive, effective=effective, reason=reason, parts=parts if len(parts) > 1 else ())
