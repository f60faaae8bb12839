"""Types of values that a shell can complete (docs/integrations.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    TextType = click.ParamType[str]
else:
    TextType = click.ParamType  # generic only in newer releases


class Known(TextType):
    """What `check` lets through, as it returns it or raises UsageError; `words` are offered."""

    name = "name"

    def __init__(self, check: Callable[[str], str], words: Callable[[], Iterable[str]]) -> None:
        """Both are asked for where they are needed alone: the words may take long to load."""
        self._check, self._words = check, words

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:  # noqa: ARG002
        """Return what the check makes of it."""
        return self._check(value)

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's signature
        param: click.Parameter,  # noqa: ARG002
        incomplete: str,
    ) -> list[CompletionItem]:
        """Offer the words that begin so; of codes, which are in capitals, small letters will do."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(word) for word in self._words() if word.startswith((incomplete, incomplete.upper()))]


class Word(Known):
    """One of some words."""

    name = "word"

    def __init__(self, words: tuple[str, ...]) -> None:
        """Take `words` and no other."""
        super().__init__(lambda value: _one_of(value, words), lambda: words)


def _one_of(value: str, words: tuple[str, ...]) -> str:
    """The word; a wrong one is answered with the nearest."""
    if value not in words:
        from keystore_audit.cli.options import unknown

        raise click.BadParameter(unknown(f"{value!r} is not one of", value, words))
    return value


class Directory(TextType):
    """A directory, which the shell completes; it need not be there. `check` returns the value or raises UsageError."""

    name = "directory"

    def __init__(self, check: Callable[[str], str]) -> None:
        """Take what `check` lets through."""
        self._check = check

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:  # noqa: ARG002
        """Return the path as it was given."""
        return self._check(value)

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's signature
        param: click.Parameter,  # noqa: ARG002
        incomplete: str,
    ) -> list[CompletionItem]:
        """Leave it to the shell."""
        return directories(incomplete)


def directories(incomplete: str) -> list[CompletionItem]:
    """What makes the shell complete directories."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(incomplete, type="dir")]
