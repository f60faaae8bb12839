"""The answers of `can`: for people, and as JSON by the interface contract (design section 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final

from msgspec import Struct

from keystore_audit.assumptions import Needed, holds_if
from keystore_audit.model.domains import Interval, describe
from keystore_audit.model.question import PARTLY, WORDS, Answer
from keystore_audit.profiles import Profile, at_work, declared
from keystore_audit.report.content import answered_if
from keystore_audit.report.json import encoded, picked
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.text import instant, terminal
from keystore_audit.truth import Truth


class Asked(Struct, frozen=True, kw_only=True):
    """The question in the user's words; `dds_names`: (operation, topic) of each DDS channel that it takes.

    `at`: when (aware UTC). `fleets`: on which. `governed`: the domains that the enclave's governance covers, where the
    user named none.
    """

    enclave: str
    operation: str
    name: str
    domain: int
    partitions: tuple[str, ...]
    dds_names: tuple[tuple[str, str], ...]
    at: datetime
    fleets: Sequence[Profile]
    governed: tuple[Interval, ...] = ()


def json(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """One line of ASCII."""
    document = {
        **picked(asked, "enclave", "operation", "name"),
        "dds_names": [name for _operation, name in asked.dds_names],
        "domain": asked.domain,
        "partition": asked.partitions[0] if len(asked.partitions) == 1 else asked.partitions,
        "decisions": {profile: _described(answer) for profile, answer in answers.items()},
        "at": instant(asked.at),
        "assumptions": [each.described for each in _assumptions(asked, answers)],
        **({"declared": mixed} if (mixed := declared(asked.fleets)) else {}),
    }
    return encoded(document) + "\n"


def _assumptions(asked: Asked, answers: Mapping[str, Answer]) -> tuple[Needed, ...]:
    """What it rests on that peers refuse something."""
    refused = [name for name, answer in answers.items() if answer.accepted == WORDS[Truth.NO]]
    return answered_if(each.name for each in at_work(asked.fleets, refused)) if refused else ()


def error(line: int, message: str) -> str:
    """What is said of a query that cannot be answered; `line` counts from 1."""
    return encoded({"line": line, "error": message}) + "\n"


def _described(answer: Answer) -> dict[str, object]:
    place = picked(answer.location, "path", "line") if answer.location else {"path": None, "line": None}
    described = {
        "usable": answer.usable.value,
        "decision": answer.decided,
        "effective": answer.accepted,
        "reason": answer.reason,
        **place,
    }
    halves = [
        {
            "dds_name": half.topic,
            "operation": half.operation,
            "decision": WORDS[half.decision],
            "effective": WORDS[half.effective],
        }
        for half in answer.halves
    ]
    return {**described, "halves": halves} if halves else described


def text(asked: Asked, answers: Mapping[str, Answer]) -> str:
    """For people: profiles that answer alike together, differences first."""
    where = f"domain {asked.domain}"
    if asked.partitions != ("",):
        word = "partition" if len(asked.partitions) == 1 else "all at once in partitions"
        where += f", {word} {', '.join(map(repr, asked.partitions))}"
    where += f", at {instant(asked.at)}"
    if mixed := declared(asked.fleets):
        where += f", {mixed}"
    lines = [terminal(f"May {asked.enclave} {asked.operation} {asked.name}? ({where})")]
    if [name for _operation, name in asked.dds_names] != [asked.name]:
        lines += [terminal(f"  in DDS: {operation} {name}") for operation, name in asked.dds_names]
    if asked.governed not in ((), ((asked.domain, asked.domain),)):
        covered = f"its governance covers domain {describe(asked.governed)}"
        lines.append(_sentence(f"{covered}; this is about {asked.domain}, --domain asks about another"))
    if asked.operation == "relay":
        lines.append("  No endpoint is made for relaying: this is what the rules say.")
    if conditions := holds_if(_assumptions(asked, answers)):
        lines.append(wrapped(f"What peers refuse {conditions}."))
    for answer, names in sorted(by_answer(answers).items(), key=lambda group: len(group[1])):
        lines += ["", *_answer(answer, profiles(names, answers))]
    return "\n".join(lines) + "\n"


def _answer(answer: Answer, under: str) -> list[str]:
    label = f"{answer.decided.upper():<8} "
    lines = [wrapped(under, label, " " * len(label))]
    lines.append(_sentence(answer.reason))
    if answer.location is not None:
        lines.append(terminal(f"  {answer.location}"))
    if answer.decided == PARTLY:
        halves = {truth: _halves(answer, truth, effective=False) for truth in Truth}
        said = [f"{words} {halves[truth]}" for truth, words in _ITSELF.items() if halves[truth]]
        lines.append(_sentence(f"its own implementation {'; '.join(said)}"))
    if answer.usable is not Truth.UNKNOWN:
        start = f"its participant {'starts' if answer.usable.must else 'does not start'}"
        but = "but " if answer.accepted != answer.decided else ""
        lines.append(_sentence(f"{start}; {but}{_accept(answer)}"))
    else:
        lines.append(_sentence(_accept(answer)))
    return lines


def _halves(answer: Answer, truth: Truth, *, effective: bool) -> str:
    """The DDS topics of a service or an action that are answered so."""
    return ", ".join(str(half) for half in answer.halves if (half.effective if effective else half.decision) is truth)


def _accept(answer: Answer) -> str:
    """What peers do; of a service or an action, with the halves that they accept where they do not accept it all."""
    aside = _ASIDE.get((answer.accepted, answer.decided), "")
    if answer.effective.must or not answer.halves:
        return _PEERS[answer.effective].format("what is asked") + aside
    halves = {truth: _halves(answer, truth, effective=True) for truth in Truth}
    return "; ".join(words.format(halves[truth]) for truth, words in _PEERS.items() if halves[truth]) + aside


_ITSELF: Final = {Truth.YES: "allows", Truth.NO: "denies", Truth.UNKNOWN: "may allow or deny"}
_PEERS: Final = {
    Truth.YES: "some peer accepts {}",
    Truth.NO: "no peer accepts {}",
    Truth.UNKNOWN: "whether any peer accepts {} cannot be told",
}
_ASIDE: Final = {
    ("allow", "deny"): " from whoever holds the enclave's keys and skips its own checks",
    ("allow", PARTLY): " from whoever holds the enclave's keys and skips its own checks",
    ("deny", "allow"): ", except one that attacks",
}
"""Where peers do something else than the enclave's own implementation."""


def _sentence(text: str) -> str:
    return wrapped(f"{text[:1].upper()}{text[1:]}.", "  ", "  ")
