"""Lines of styled text on a page of fixed width: the only module that knows rich.

Every string that enters is escaped for terminals here, so no caller can forget it; styles are ours alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from keystore_audit.text import terminal

if TYPE_CHECKING:
    from rich.text import Text

Piece = tuple[str, str]
"""A text, escaped or not, and the rich style to show it in (empty: plain)."""

MIN_WIDTH: Final = 40
"""Columns: below this, indented text would be a column of single words."""

MIN_TEXT: Final = 24
"""Columns that a paragraph beside a label has at least."""


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

    def labelled(self, label: str, *pieces: Piece | str, indent: int, column: int, style: str = "dim") -> None:
        """Add a paragraph at `column` with `label` before its first line, at `indent`.

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
