"""Text for people: pages of styled lines, as an audit has, and paragraphs, as answers to one question.

The only module that knows rich. Every string that enters is escaped for terminals here, so no caller can forget it;
styles are ours alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Final, TypeVar

from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.properties.result import ProfileResult
from keystore_audit.report.content import STATUSES
from keystore_audit.text import some, terminal

if TYPE_CHECKING:
    from rich.text import Text

Piece = tuple[str, str]
"""A text, escaped or not, and the rich style to show it in (empty: plain)."""

WIDTH: Final = 80
"""Columns, as far as names allow."""

MAX_DOUBTS: Final = 5
"""Places named that could not be read."""

MIN_WIDTH: Final = 40
"""Columns: below this, indented text would be a column of single words."""

MIN_TEXT: Final = 24
"""Columns that a paragraph beside a label has at least."""


_A = TypeVar("_A")


class Page:
    """Collects lines, wrapped at `width` columns; `render` gives them, with ANSI colour if `color`.

    Nothing is read from the environment: the same lines give the same string.
    """

    def __init__(self, *, width: int, color: bool) -> None:
        """Start an empty page; rich is imported here because it costs more than the program's start."""
        from io import StringIO

        from rich.console import Console

        self.width = max(width, MIN_WIDTH)
        self._out = StringIO()
        self._console = Console(
            file=self._out,
            width=self.width,
            height=100,
            force_terminal=color,
            force_jupyter=False,
            color_system="standard" if color else None,
            no_color=not color,
            markup=False,
            emoji=False,
            highlight=False,
            legacy_windows=False,
            _environ={},
        )
        self._lines: list[Text] = []

    def blank(self) -> None:
        """Leave one empty line; never two, and none at the top."""
        from rich.text import Text

        if self._lines and self._lines[-1].plain:
            self._lines.append(Text())

    def put(self, *pieces: Piece | str, indent: int = 0) -> None:
        """Add a paragraph whose every line starts at column `indent`."""
        self.labelled("", *pieces, indent=indent, column=indent)

    def verbatim(self, line: str) -> None:
        """Add one line as it is, however long: it is there to be copied."""
        from rich.text import Text

        self._lines.append(Text(terminal(line), "bold"))

    def labelled(self, label: str, *pieces: Piece | str, indent: int = 0, column: int, style: str = "dim") -> None:
        """Add a paragraph at `column` with `label` before its first line, at `indent`, the margin unless it is told.

        A label that reaches into the paragraph's column has a line of its own. A narrow page moves the
        paragraph to the left, so that `MIN_TEXT` columns are left for it.
        """
        from rich.text import Text

        text = Text()
        for content, own_style in (_piece(piece) for piece in pieces):
            text.append(terminal(content), own_style or None)
        column = max(indent, min(column, self.width - MIN_TEXT))
        margin = Text(" " * column)
        first = Text(" " * indent).append(terminal(label), style) if label else margin
        if label and first.cell_len >= column:
            self.put((label, style), indent=indent)
            first = margin
        first = first + Text(" " * (column - first.cell_len))
        room = self.width - column
        wrapped = [text] if text.cell_len <= room else text.wrap(self._console, room, overflow="fold")
        for number, line in enumerate(wrapped):
            whole = (first if number == 0 else margin) + line
            whole.rstrip()
            self._lines.append(whole)

    def render(self) -> str:
        """Return the page; it ends in one newline."""
        from rich.text import Text

        while self._lines and not self._lines[-1].plain:
            self._lines.pop()
        self._console.print(Text("\n").join(self._lines), soft_wrap=True)
        return self._out.getvalue()


def _piece(piece: Piece | str) -> Piece:
    return (piece, "") if isinstance(piece, str) else piece


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


def profiles(names: Sequence[str], every: Collection[str]) -> str:
    """Some of the profiles that were asked about."""
    return "every profile" if len(names) == len(every) else ", ".join(names)
