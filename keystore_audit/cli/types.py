"""What the values of options are: read where they are given, and completed by shells (docs/integrations.md)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from keystore_audit.errors import UsageError
from keystore_audit.options import FIRST_YEAR, LAST_YEAR, MAX_SECONDS
from keystore_audit.text import meant

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from click.shell_completion import CompletionItem

    TextType = click.ParamType[str]
else:
    TextType = click.ParamType  # generic only in newer releases

T = TypeVar("T")

COMMANDS: Final = {
    "audit": ("audit", "command"),
    "can": ("can", "command"),
    "access": ("can", "access_command"),
    "flow": ("flow", "command"),
    "prove": ("prove", "command"),
    "check": ("check", "command"),
    "diff": ("diff", "command"),
    "suggest": ("suggest", "command"),
    "baseline": ("baseline", "command"),
    "rules": ("explain", "rules_command"),
    "explain": ("explain", "command"),
    "engine": ("engine", "command"),
    "model": ("engine", "model_command"),
}
"""Each with the module of this package in which it is, imported only when it is asked for, and its name there."""


def read(by: Callable[[str], T], value: str) -> T:
    """What the value means to `by`, which raises UsageError."""
    try:
        return by(value)
    except UsageError as error:
        raise click.BadParameter(error.message) from error


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
        raise click.BadParameter(unknown(f"{value!r} is not one of", value, words))
    return value


class Directory(Known):
    """A directory, which the shell completes; it need not be there. `check` returns the value or raises UsageError."""

    name = "directory"

    def __init__(self, check: Callable[[str], str]) -> None:
        """Take what `check` lets through."""
        super().__init__(check, tuple)

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


_INSTANT: Final = re.compile(
    r"(?P<day>[0-9]{4}-[0-9]{2}-[0-9]{2})"
    r"(?:[T ](?P<minute>[0-9]{2}:[0-9]{2})(?P<second>:[0-9]{2})?(?:\.[0-9]+)?(?P<zone>Z|[+-][0-9]{2}:[0-9]{2})?)?"
)


def instant(value: str) -> datetime:
    """Return an ISO 8601 time as aware UTC; without a zone it is UTC, and fractions of a second are cut off."""
    match = _INSTANT.fullmatch(value)
    if match is None:
        raise click.BadParameter(f"{value!r} is no time such as 2026-01-31T12:00:00Z (without a zone: UTC).")
    zone = match["zone"] or "Z"
    clock = (match["minute"] or "00:00") + (match["second"] or ":00")
    try:
        moment = datetime.fromisoformat(f"{match['day']}T{clock}{'+00:00' if zone == 'Z' else zone}")
    except ValueError as error:
        raise click.BadParameter(f"{value!r} is no time: {error}.") from error
    if not FIRST_YEAR <= moment.year <= LAST_YEAR:
        raise click.BadParameter(f"{value!r} is not between the years {FIRST_YEAR} and {LAST_YEAR}.")
    return moment.astimezone(timezone.utc)


def seconds(value: str | float) -> float:
    """Return a duration greater than zero."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0 < number <= MAX_SECONDS:  # not true of NaN either
        raise click.BadParameter(f"{value!r} is no number of seconds greater than 0, {MAX_SECONDS:g} at most.")
    return number


class Number(click.IntRange):
    """A whole number within bounds."""

    name = "whole number"


def codes() -> Iterable[str]:
    """The codes of all rules and families."""
    from keystore_audit.rules import RULES

    return (*dict.fromkeys(rule.family for rule in RULES), *(rule.code for rule in RULES))


def zone_name(value: str) -> ZoneInfo:
    """Return the zone of the IANA database that is called so."""
    from keystore_audit.model.validity import time_zone

    return read(time_zone, value)


def rule_code(value: str) -> str:
    """Return the code of a rule or of a family (`KA2`); KA9, the audit itself, always runs."""
    from keystore_audit.rules.registry import rule_code as code

    return read(code, value)


RULE: Final = Known(rule_code, codes)
"""What names a rule or a family."""


def rule_family(value: str) -> str:
    """Return the code of a family (`KA2`) in capitals."""
    from keystore_audit.rules import RULES

    families = sorted({rule.family for rule in RULES})
    if value.upper() not in families:
        raise click.BadParameter(f"{value!r} is no family. Known: {', '.join(families)}.")
    return value.upper()


def unknown(sentence: str, word: str, known: Sequence[str]) -> str:
    """Return `sentence` continued with the `known` words and the nearest one to `word`."""
    return f"{sentence} {', '.join(known)}.{meant(word, known, ' Did you mean {!r}?')}"


def _keystore_path(value: str) -> str:
    """Return the path of a keystore; raise UsageError for the bare name of a command.

    `keystore-audit -q rules` would otherwise audit a directory called `rules`.
    """
    if value in COMMANDS:
        raise click.UsageError(f"A command comes first; for a directory called {value!r}, write ./{value}.")
    return value


keystore_path = Directory(_keystore_path)


def launch_argument(value: str) -> tuple[str, str]:
    """Return name and value of `NAME:=VALUE`."""
    name, separator, content = value.partition(":=")
    if not name or not separator:
        raise click.BadParameter(f"{value!r} is not NAME:=VALUE, e.g. robot_name:=anna.")
    return name, content


def listening(value: str) -> tuple[str, str]:
    """Return path and address of `ENCLAVE=HOST:PORT`."""
    path, _sign, address = value.partition("=")
    if not path or not re.fullmatch(r"[A-Za-z0-9.-]+:[0-9]{1,5}", address):
        raise click.BadParameter(f"{value!r} is not ENCLAVE=HOST:PORT, e.g. /arm=10.0.0.5:7447.")
    return path, address


def executor_address(value: str) -> str:
    """Return HOST:PORT of `dask://HOST:PORT`."""
    scheme, separator, address = value.partition("://")
    host, colon, port = address.rpartition(":")
    if scheme != "dask" or not (separator and host and colon and port.isdecimal()):
        raise click.BadParameter(f"{value!r} is not dask://HOST:PORT, e.g. dask://10.0.0.5:8786.")
    return address


def profile_name(value: str) -> str:
    """Return the name of a variant of an implementation, or an alias, as it was given."""
    from keystore_audit.profiles import resolve

    read(lambda name: resolve((name,)), value)
    return value
