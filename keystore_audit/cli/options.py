"""Types and options that commands share."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click
from click.core import ParameterSource

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.cli.completion import Directory, Known, Word
from keystore_audit.cli.scope import read, scope_options, together
from keystore_audit.options import FIRST_YEAR, LAST_DOMAIN, LAST_YEAR, MAX_SECONDS, declared_files, now
from keystore_audit.text import meant

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from keystore_audit.settings.settings import Settings

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

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
    from keystore_audit.model.local_time import time_zone

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
    from keystore_audit.cli.program import COMMANDS

    if value in COMMANDS:
        raise click.UsageError(f"A command comes first; for a directory called {value!r}, write ./{value}.")
    return value


keystore_path = Directory(_keystore_path)


def _be_verbose(ctx: click.Context, _param: click.Parameter, value: bool) -> bool:
    if value:
        ctx.ensure_object(dict)["verbose"] = True
    return value


def choice(*names: str, words: Sequence[str], **more: Any) -> Callable[[F], F]:
    """Return an option that takes one of `words`; a wrong one is answered with the nearest."""
    return click.option(*names, type=Word(tuple(words)), metavar=f"[{'|'.join(words)}]", show_default=True, **more)


def file(*names: str, metavar: str = "FILE", **more: Any) -> Callable[[F], F]:
    """Return an option that names a file or directory, whatever is there."""
    return click.option(*names, type=click.Path(path_type=Path), metavar=metavar, **more)


def alloy_jar(text: str) -> Callable[[F], F]:
    """Return the option `--alloy-jar`; the jar has to be there: a misspelt one would leave properties to one engine.

    That of the variable, which is for all commands, only where an engine asks for it.
    """

    def check(context: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
        named = context.get_parameter_source(parameter.name or "") is ParameterSource.COMMANDLINE
        unused = context.params.get("engine") == "native" or context.params.get("compromised") is not None
        if value is None or (unused and not named):
            return value
        there: Path = click.Path(exists=True, dir_okay=False, path_type=Path).convert(value, parameter, context)
        return there

    return click.option(
        "--alloy-jar",
        type=click.Path(path_type=Path),
        callback=check,
        envvar="KEYSTORE_AUDIT_ALLOY_JAR",
        show_envvar=True,
        metavar="FILE",
        help=text,
    )


def verbose_option(text: str = "Say where a fault is.", *, to_command: bool = False) -> Callable[[F], F]:
    """Return the option `-v`, known to whoever reports a fault, and to the command itself if wanted."""
    return click.option(
        "-v", "--verbose", is_flag=True, is_eager=True, callback=_be_verbose, expose_value=to_command, help=text
    )


_at = click.option(
    "--at", type=instant, metavar="ISO-TIME", help="Audit as of this time instead of now; without a zone: UTC."
)

_time_zone = click.option(
    "--time-zone",
    type=zone_name,
    metavar="NAME",
    help="The robots' time zone, e.g. Europe/Berlin: some implementations read dates of grants in it.",
)


def format_option(text: str, *words: str) -> Callable[[F], F]:
    """How an answer is written: as the first of `words`, if nobody says otherwise."""
    return choice("-f", "--format", "form", words=words, default=words[0], help=text)


def domain_option(text: str) -> Callable[[F], F]:
    """Return the option `--domain`."""
    return click.option("--domain", type=Number(0, LAST_DOMAIN), metavar="N", help=text)


_no_assume = click.option(
    "--no-assume",
    "not_assumed",
    type=Word(tuple(each.value for each in Assumption)),
    callback=lambda _context, _parameter, names: tuple(map(Assumption, names)),
    metavar="NAME",
    multiple=True,
    help="Decide without this assumption (repeatable; docs/assumptions.md has their names).",
)

reading_options: Final = together(scope_options, _at, _time_zone, _no_assume)
"""Those of a single question, which is about one domain: `reading` takes them."""

no_assume_option: Final = _no_assume
"""That of an audit, which takes more."""

roots_option: Final = file(
    "--root", "roots", metavar="DIR", multiple=True, help="Links of the keystore may lead into DIR (repeatable)."
)

file_options: Final = together(
    file("--settings", help="What is declared of the keystore's files and of enclaves with two names."), roots_option
)
"""What is declared of a keystore that is asked about, not audited: `reading` takes them."""

interpretation_options: Final = together(
    _at,
    _time_zone,
    scope_options,
    domain_option("The DDS domain the robots use (default: any of 0 to 232)."),
)
"""Those that decide what a keystore means."""

alloy_options: Final = together(
    click.option("--offline", is_flag=True, help="Never fetch the Alloy Analyzer."),
    alloy_jar("Use this jar of the Alloy Analyzer."),
    click.option("--timeout", type=seconds, default=120, metavar="SECONDS", help="The longest that Alloy may take."),
)
"""Those that say where the Alloy Analyzer is, and how long it may take."""


def named_settings(given: Mapping[str, Any], *keystores: str) -> Settings | None:
    """Return the settings that `--settings` names; raise UsageError for some that are none or lie in a keystore."""
    if given["settings"] is None:
        return None
    from keystore_audit.settings.settings import read_settings

    return read_settings(given["settings"], keystores)


def reading(given: Mapping[str, Any], settings: Settings | None) -> dict[str, Any]:
    """Return what the options mean that decide how keystores are read, as whoever reads them takes it."""
    from keystore_audit.profiles import resolve

    return {
        "declared": declared_files(settings, given["roots"]),
        "profiles": resolve(given["profiles"]),
        "at": given["at"] or now(),
        "zone": given["time_zone"],
        **({"assumed": EVERY.difference(given["not_assumed"])} if "not_assumed" in given else {}),
    }


def launch_argument(value: str) -> tuple[str, str]:
    """Return name and value of `NAME:=VALUE`."""
    name, separator, content = value.partition(":=")
    if not name or not separator:
        raise click.BadParameter(f"{value!r} is not NAME:=VALUE, e.g. robot_name:=anna.")
    return name, content


def check_launch_arguments(arguments: Collection[object], launches: Collection[Path]) -> None:
    """Raise UsageError for arguments of launch files where there are no such files: they would be without effect."""
    if arguments and not launches:
        raise click.UsageError("--launch-argument is for the files that --launch names.")


observation_options: Final = together(
    file("--graph", "graphs", multiple=True, help="A ROS graph in JSON: the nodes that use the keystore (repeatable)."),
    file(
        "--launch",
        "launches",
        multiple=True,
        help="A launch file, read and never run: the nodes that will use the keystore (repeatable).",
    ),
    click.option(
        "--launch-argument",
        "launch_arguments",
        type=launch_argument,
        multiple=True,
        metavar="NAME:=VALUE",
        help="Give an argument of the launch files its value (repeatable).",
    ),
)
"""Those that name graphs and launch files."""


authority_options: Final = together(
    *(
        click.option(
            f"--expect-{role}-ca",
            f"{role}_cas",
            multiple=True,
            metavar="FINGERPRINT|FILE",
            help=f"The {role} CA that you trust: sha256:... of certificate or key, or the certificate (repeatable).",
        )
        for role in ("identity", "permissions")
    )
)
"""Those that declare whom the user trusts."""


def use_color(choice: str, *, terminal: bool) -> bool:
    """Whether to colour: what `--color` says, else NO_COLOR, else FORCE_COLOR, else only a terminal that can."""
    if choice != "auto":
        return choice == "always"
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or (terminal and os.environ.get("TERM") != "dumb")
