"""Paragraphs of plain text, as answers to one question have them; a report of an audit is a `page`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Final, TypeVar

from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.properties.result import ProfileResult
from keystore_audit.report.content import STATUSES
from keystore_audit.text import some, terminal

WIDTH: Final = 80
"""Columns, as far as names allow."""

MAX_DOUBTS: Final = 5
"""Places named that could not be read."""

_A = TypeVar("_A")


def wrapped(text: str, first: str = "", rest: str = "", *, width: int = WIDTH, break_long_words: bool = True) -> str:
    """The text, escaped, behind `first` on its first line and `rest` on the others."""
    return fill(
        terminal(text),
        width,
        initial_indent=first,
        subsequent_indent=rest,
        break_on_hyphens=False,
        break_long_words=break_long_words,
    )


def unbroken(text: str, first: str = "", rest: str = "") -> str:
    """The same, with long names in one piece, whatever the width."""
    return wrapped(text, first, rest, break_long_words=False)


def rests_on(doubts: Sequence[Location]) -> str:
    """What an unknown answer rests on, a sentence."""
    return f"It depends on what could not be read: {some((place.path for place in doubts), MAX_DOUBTS)}."


def by_answer(answers: Mapping[str, _A]) -> dict[_A, list[str]]:
    """By answer the profiles under which it is given."""
    return grouped(answers, answers.__getitem__)


def worst_first(
    answers: Mapping[str, ProfileResult], told: Callable[[ProfileResult], object]
) -> list[tuple[ProfileResult, list[str]]]:
    """Profiles with one status of which the same is told, each group with the answer of its first."""
    groups = grouped(answers, lambda name: (answers[name].status, told(answers[name])))
    first = ((answers[names[0]], names) for names in groups.values())
    return sorted(first, key=lambda group: STATUSES.index(group[0].status))


def profiles(names: Sequence[str], every: Mapping[str, object]) -> str:
    """Some of the profiles that were asked about."""
    return "every profile" if len(names) == len(every) else ", ".join(names)
