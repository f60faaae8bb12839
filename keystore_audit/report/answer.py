"""The answers of `can`: for people, and as JSON by the interface contract (design section 5)."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Final

from msgspec import Struct

from keystore_audit.assumptions import Needed, holds_if
from keystore_audit.model.domains import Interval, describe
from keystore_audit.model.question import Answer, Ruling
from keystore_audit.report.content import answered_if
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.report.suggested import encoded, picked
from keystore_audit.text import instant, terminal


class Asked(Struct, frozen=True, kw_only=True):
    """The question in the user's words; `dds_names`: (operation, topic) of each DDS channel that it takes.

    `at`: when (aware UTC). `governed`: the domains that the enclave's governance covers, where the user named none.
    """

    enclave: str
    operation: str
    name: str
    domain: int
    partition: str
    dds_names: tuple[tuple[str, str], ...]
    at: datetime
    governed: tuple[Interval, ...] = ()


def json(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """One line of ASCII."""
    document = {
        **picked(asked, "enclave", "operation", "name"),
        "dds_names": [name for _operation, name in asked.dds_names],
        **picked(asked, "domain", "partition"),
        "decisions": {profile: _described(answer) for profile, answer in answers.items()},
        "at": instant(asked.at),
        "assumptions": [each.described for each in _assumptions(answers)],
    }
    return encoded(document) + "\n"


def _assumptions(answers: Mapping[str, Answer]) -> tuple[Needed, ...]:
    """What it rests on that peers refuse something."""
    refused = [name for name, answer in answers.items() if answer.effective is Ruling.DENY]
    return answered_if(refused) if refused else ()


def error(line: int, message: str) -> str:
    """What is said of a query that cannot be answered; `line` counts from 1."""
    return encoded({"line": line, "error": message}) + "\n"


def _described(answer: Answer) -> dict[str, object]:
    place = picked(answer.location, "path", "line") if answer.location else {"path": None, "line": None}
    described = {**picked(answer, "usable", "decision", "effective", "reason"), **place}
    halves = [{"dds_name": half.topic, **picked(half, "operation", "decision", "effective")} for half in answer.halves]
    return {**described, "halves": halves} if halves else described


def text(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """For people: profiles that answer alike together, differences first."""
    where = f"domain {asked.domain}" + (f", partition {asked.partition!r}" if asked.partition else "")
    where += f", at {instant(asked.at)}"
    lines = [terminal(f"May {asked.enclave} {asked.operation} {asked.name}? ({where})")]
    if [name for _operation, name in asked.dds_names] != [asked.name]:
        lines += [terminal(f"  in DDS: {operation} {name}") for operation, name in asked.dds_names]
    if asked.governed not in ((), ((asked.domain, asked.domain),)):
        covered = f"its governance covers domain {describe(asked.governed)}"
        lines.append(_sentence(f"{covered}; this is about {asked.domain}, --domain asks about another"))
    if asked.operation == "relay":
        lines.append("  No endpoint is made for relaying: this is what the rules say.")
    if conditions := holds_if(_assumptions(answers)):
        lines.append(wrapped(f"What peers refuse {conditions}."))
    for answer, names in sorted(by_answer(answers).items(), key=lambda group: len(group[1])):
        lines += ["", *_answer(answer, profiles(names, answers))]
    return "\n".join(lines) + "\n"


def _answer(answer: Answer, under: str) -> list[str]:
    label = f"{answer.decision.value.upper():<8} "
    lines = [wrapped(under, label, " " * len(label))]
    lines.append(_sentence(answer.reason))
    if answer.location is not None:
        lines.append(terminal(f"  {answer.location}"))
    if answer.decision is Ruling.PARTLY:
        halves = {ruling: _halves(answer, ruling, effective=False) for ruling in Ruling}
        said = [f"{words} {halves[ruling]}" for ruling, words in _ITSELF.items() if halves[ruling]]
        lines.append(_sentence(f"its own implementation {'; '.join(said)}"))
    if answer.usable is not None:
        start = f"its participant {'starts' if answer.usable else 'does not start'}"
        but = "but " if answer.effective is not answer.decision else ""
        lines.append(_sentence(f"{start}; {but}{_accept(answer)}"))
    else:
        lines.append(_sentence(_accept(answer)))
    return lines


def _halves(answer: Answer, ruling: Ruling, *, effective: bool) -> str:
    """The DDS topics of a service or an action that are answered so."""
    return ", ".join(str(half) for half in answer.halves if (half.effective if effective else half.decision) is ruling)


def _accept(answer: Answer) -> str:
    """What peers do; of a service or an action, with the halves that they accept where they do not accept it all."""
    if answer.effective is Ruling.ALLOW or not answer.halves:
        return _PEERS[answer.effective].format("what is asked") + _ASIDE.get((answer.effective, answer.decision), "")
    halves = {ruling: _halves(answer, ruling, effective=True) for ruling in Ruling}
    told = [words.format(halves[ruling]) for ruling, words in _PEERS.items() if halves[ruling]]
    return "; ".join(told) + _ASIDE.get((answer.effective, answer.decision), "")


_ITSELF: Final = {Ruling.ALLOW: "allows", Ruling.DENY: "denies", Ruling.UNKNOWN: "may allow or deny"}
_PEERS: Final = {
    Ruling.ALLOW: "some peer accepts {}",
    Ruling.DENY: "no peer accepts {}",
    Ruling.UNKNOWN: "whether any peer accepts {} cannot be told",
}
_ASIDE: Final = {
    (Ruling.ALLOW, Ruling.DENY): " from whoever holds the enclave's keys and skips its own checks",
    (Ruling.ALLOW, Ruling.PARTLY): " from whoever holds the enclave's keys and skips its own checks",
    (Ruling.DENY, Ruling.ALLOW): ", except one that attacks",
}
"""Where peers do something else than the enclave's own implementation."""


def _sentence(text: str) -> str:
    return wrapped(f"{text[:1].upper()}{text[1:]}.", "  ", "  ")
