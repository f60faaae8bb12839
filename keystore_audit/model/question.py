"""Questions about rights and their answers: may this enclave do that on this topic?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.truth import Truth

WORDS: Final = {Truth.YES: "allow", Truth.NO: "deny", Truth.UNKNOWN: "unknown"}
"""What a decision is called."""

PARTLY: Final = "partly"
"""The decision about a service or an action of which some is allowed and some is denied."""


class Usability(Struct, frozen=True, kw_only=True):
    """Whether a participant of the enclave would be created in some domain. Each reason is a sentence."""

    usable: Truth
    reasons: tuple[str, ...]


class Doubt(Struct, frozen=True, kw_only=True):
    """Something unread, so that it counts as able to do anything.

    `enclave`: the enclave's path, None where it concerns several or an unnamed one. `profiles`: those that may act on
    it. `narrows`: it may lead to less being accepted, and never to more.
    """

    enclave: str | None
    location: Location
    reason: str
    profiles: tuple[str, ...] = ()
    narrows: bool = False


class Question(Struct, frozen=True, kw_only=True):
    """May the enclave (its path) do this on a DDS topic, in a domain of 0..232?

    `partitions`: all those that the endpoint is in at once, at least one; "" is the default one.
    """

    enclave: str
    operation: Operation
    topic: str
    domain: int = 0
    partitions: tuple[str, ...] = ("",)

    @property
    def point(self) -> tuple[str, ...]:
        """The topic, and the partitions."""
        return self.topic, *self.partitions


class Half(Struct, frozen=True, kw_only=True):
    """The answer for one of the DDS topics of a service or an action."""

    operation: Operation
    topic: str
    decision: Truth
    effective: Truth

    def __str__(self) -> str:
        return f"{self.operation.value} {self.topic}"


class Answer(Struct, frozen=True, kw_only=True):
    """The answer of one profile.

    `usable`: whether a participant is created in the domain. `decision`: whether its own implementation lets it; deny
    where it is not usable. `effective`: whether some peer in the keystore accepts it. `reason`: of the decision, a
    sentence without its full stop; `location`: the line that decides, if there is one. `halves`: of a service or an
    action.
    """

    usable: Truth
    decision: Truth
    effective: Truth
    reason: str
    location: Location | None
    halves: tuple[Half, ...] = ()

    @property
    def decided(self) -> str:
        """The decision in a word."""
        return self._word(self.decision, {half.decision for half in self.halves})

    @property
    def accepted(self) -> str:
        """What peers do in a word."""
        return self._word(self.effective, {half.effective for half in self.halves})

    def _word(self, whole: Truth, halves: set[Truth]) -> str:
        """Half of a service is no denial of it. Servers carry out a request even if its sender may not read the reply,
        and clients take a reply (measured).
        """
        return PARTLY if halves >= {Truth.YES, Truth.NO} else WORDS[whole]


_OBSTACLES: Final = (Truth.NO, Truth.UNKNOWN, Truth.YES)
"""The order in which one of a service's or action's channels gives the reason."""


def joint(questions: Sequence[Question], answers: Sequence[Answer]) -> Answer:
    """One answer about all of it, with the reason of the first obstacle."""
    if len(questions) == 1:
        return answers[0]
    question, decisive = min(zip(questions, answers, strict=True), key=lambda each: _OBSTACLES.index(each[1].decision))
    reason = decisive.reason
    if decisive.usable.must:
        which = "" if decisive.decision is not Truth.YES else f"each of the {len(questions)} is allowed, e.g. "
        reason = f"{which}{question.operation.value} {question.topic}: {reason}"
    return replace(
        decisive,
        decision=_together({answer.decision for answer in answers}),
        effective=_together({answer.effective for answer in answers}),
        reason=reason,
        halves=tuple(
            Half(operation=asked.operation, topic=asked.topic, decision=answer.decision, effective=answer.effective)
            for asked, answer in zip(questions, answers, strict=True)
        ),
    )


def _together(parts: set[Truth]) -> Truth:
    """Whether all of it may be done."""
    if parts >= {Truth.YES, Truth.NO}:
        return Truth.NO
    return Truth.UNKNOWN if Truth.UNKNOWN in parts else parts.pop()
