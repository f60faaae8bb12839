"""Documents made of templates: whatever one prints is escaped in the way of its format, in one place."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

TEMPLATES: Final = Path(__file__).with_name("templates")


def ours(text: str) -> Markup:
    """What is a part of the document as it stands: no text of a keystore, or one that is escaped."""
    return Markup(text)  # noqa: S704


@cache
def environment(escape: Callable[[str], str], *, lines: bool = True) -> Environment:
    """Templates of a format; `escape` makes any text a part of it that is nothing but text.

    `lines`: those of a template are those of the document, but for lines that hold nothing but a block.
    """

    def printed(value: object) -> Markup:
        return value if isinstance(value, Markup) else ours(escape(value if isinstance(value, str) else str(value)))

    return Environment(
        autoescape=True,
        undefined=StrictUndefined,
        loader=FileSystemLoader(TEMPLATES),
        finalize=printed,
        trim_blocks=lines,
        lstrip_blocks=lines,
        keep_trailing_newline=lines,
    )
