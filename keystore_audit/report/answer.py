"""The answers of `can`: for people, and as JSON by the interface contract (design section 5)."""

from __future__ import annotations

import json as encoder
from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import fill
from typing import Final

from keystore_audit.model.question import Answer, Ruling
from keystore_audit.text import terminal

WIDTH: Final = 80
"""Columns of the text."""

_USABLE: Final = {True: "starts", False: "does not start", None: "may start"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """The question in the user's words; `dds_names`: (operation, topic) of each DDS channel that it takes."""

    enclave: str
    operation: str
    name: str
    domain: int
    partition: str
    dds_names: tuple[tuple[str, str], ...]


def json(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """One line of ASCII."""
    document = {
        "enclave": asked.enclave,
        "operation": asked.operation,
        "name": asked.name,
        "dds_names": [name for _operation, name in asked.dds_names],
        "domain": asked.domain,
        "partition": asked.partition,
        "decisions": {profile: _described(answer) for profile, answer in answers.items()},
    }
    return encoder.dumps(document) + "\n"


def error(line: int, message: str) -> str:
    """What is said of a query that cannot be answered; `line` counts from 1."""
    return encoder.dumps({"line": line, "error": message}) + "\n"


def _described(answer: Answer) -> dict[str, object]:
    return {
        "usable": answer.usable,
        "decision": answer.decision.value,
        "effective": answer.effective.value,
        "reason": answer.reason,
        "path": answer.location.path if answer.location else None,
        "line": answer.location.line if answer.location else None,
    }


def text(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """For people: profiles that answer alike together, differences first."""
    where = f"domain {asked.domain}" + (f", partition {asked.partition!r}" if asked.partition else "")
    lines = [terminal(f"May {asked.enclave} {asked.operation} {asked.name}? ({where})")]
    if [name for _operation, name in asked.dds_names] != [asked.name]:
        lines += [terminal(f"  takes: {operation} {name}") for operation, name in asked.dds_names]
    groups: dict[Answer, list[str]] = {}
    for profile, answer in answers.items():
        groups.setdefault(answer, []).append(profile)
    for answer, profiles in sorted(groups.items(), key=lambda group: len(group[1])):
        lines += ["", *_answer(answer, "every profile" if len(groups) == 1 else ", ".join(profiles))]
    return "\n".join(lines) + "\n"


def _answer(answer: Answer, profiles: str) -> list[str]:
    lines = [f"{answer.decision.value.upper():<8} {profiles}"]
    lines.append(_filled(f"{answer.reason[:1].upper()}{answer.reason[1:]}."))
    if answer.location is not None:
        line = f":{answer.location.line}" if answer.location.line is not None else ""
        lines.append(terminal(f"  {answer.location.path}{line}"))
    started = f"Its participant {_USABLE[answer.usable]}"
    if answer.effective is answer.decision:
        lines.append(_filled(f"{started}; peers {_ACCEPT[answer.effective]}."))
    else:
        lines.append(_filled(f"{started}; but peers {_ACCEPT[answer.effective]}, whatever it is itself."))
    return lines


_ACCEPT: Final = {
    Ruling.ALLOW: "accept it",
    Ruling.DENY: "do not accept it",
    Ruling.UNKNOWN: "may accept it, which cannot be told",
}


def _filled(sentence: str) -> str:
    return fill(terminal(sentence), WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
