"""The answers of `can` about a network of sessions and routers: for people, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.model.question import WORDS
from keystore_audit.report.json import encoded, picked
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.text import instant, terminal
from keystore_audit.truth import Truth
from keystore_audit.zenoh.answers import Reached, RoutedAnswer, RoutedAnswers

ASSUMED: Final = (
    "Holds if every process starts with its file in {}, no other takes part, and addresses lead to whom they name. "
    "Neither governance nor permissions have a say."
)
APART: Final = "Flows are apart from /clock, /parameter_events, /rosout and ros_discovery_info."
_COULD = {Truth.YES: "it can", Truth.NO: "it cannot", Truth.UNKNOWN: "cannot be told"}


def json(asked: RoutedAnswers) -> str:
    """One line of ASCII: `decision` is with its own file, `effective` without it."""
    document = {
        **picked(asked, "enclave", "operation", "name"),
        "keys": asked.keys,
        "domain": asked.domain,
        "decisions": {
            release: {
                "decision": answer.decided,
                "effective": answer.accepted,
                **_described(answer.works),
                "without_its_file": _described(answer.could),
            }
            for release, answer in asked.answers.items()
        },
        "at": instant(asked.at),
        "unknown": unknown(asked.doubts),
    }
    return encoded(document) + "\n"


def unknown(doubts: Sequence[tuple[Location, str]]) -> list[dict[str, object]]:
    """Why nothing is denied for certain."""
    return [{**picked(place, "path", "line"), "reason": why} for place, why in doubts]


def _described(reached: Reached) -> dict[str, object]:
    place = picked(reached.location, "path", "line") if reached.location else {"path": None, "line": None}
    return {"reason": reached.reason, **place, "over": [tie.far.name for tie in reached.way]}


def text(asked: RoutedAnswers) -> str:
    """For people: releases that answer alike together."""
    where = f"domain {asked.domain}, at {instant(asked.at)}"
    lines = [terminal(f"May {asked.enclave} {asked.operation} {asked.name}? ({where})")]
    lines += [terminal(f"  about {key}") for key in asked.keys]
    lines.append(wrapped(ASSUMED.format(asked.folder), "  ", "  "))
    for answer, names in by_answer(asked.answers).items():
        label = f"{WORDS[answer.works.truth].upper():<8} "
        lines += ["", wrapped(profiles(names, asked.answers), label, " " * len(label)), *_told(answer)]
    return "\n".join([*lines, *doubted(asked.doubts)]) + "\n"


def doubted(doubts: Sequence[tuple[Location, str]]) -> list[str]:
    """Why nothing is denied for certain, where that is so."""
    if not doubts:
        return []
    place, why = doubts[0]
    more = f" ({len(doubts)} such places)" if len(doubts) > 1 else ""
    return ["", wrapped(f"Nothing is denied for certain: {place}: {why}{more}.", "  ", "  ")]


def _told(answer: RoutedAnswer) -> list[str]:
    """What becomes of it with the file, and without it: by whom, and why."""
    works, could = answer.works, answer.could
    lines = [*_sentence(f"with its own file: {works.reason}{_whom(works)}", works)]
    why = f": {could.reason}{_whom(could)}" if could.way else ""
    return [*lines, *_sentence(f"without its file, {_COULD[could.truth]}{why}", could)]


def _whom(reached: Reached) -> str:
    if not reached.way:
        return ""
    names = [tie.far.name for tie in reached.way]
    return f"; it reaches {names[-1]}" + (f" over {', '.join(names[:-1])}" if names[:-1] else "")


def _sentence(words: str, reached: Reached) -> list[str]:
    place = [terminal(f"  {reached.location}")] if reached.location is not None else []
    return [wrapped(f"{words[:1].upper()}{words[1:]}.", "  ", "  "), *place]
