"""`keystore-audit baseline create` and `keystore-audit baseline prune`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from keystore_audit.cli import audit, output, types
from keystore_audit.cli import options as opt
from keystore_audit.cli.program import Group
from keystore_audit.cli.progress import Watch
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.findings import MAX_OWNER, MAX_REASON, SEVERITIES
from keystore_audit.text import counted, terminal

if TYPE_CHECKING:
    from keystore_audit.options import Options

F = TypeVar("F", bound=Callable[..., Any])

_NOT_HERE: Final = {
    "keystores", "kind", "targets", "fail_on", "min_severity", "baseline", "select", "ignore", "quiet", "color",
    "verbose",
}  # fmt: skip
"""Parameters of `audit` that decide which findings are shown, not which there are."""

_UNSET: Final = {"fail_on": audit.NEVER, "select": (), "ignore": (), "baseline": None}


def audit_options(command: F) -> F:
    """Add the options of `audit` on which it depends which findings there are."""
    taken = [param for param in audit.command.params if param.name not in _NOT_HERE]
    vars(command).setdefault("__click_params__", []).extend(reversed(taken))
    return command


def _day(value: str) -> date:
    try:
        return datetime.strptime(value, "%Y-%m-%d").date()  # noqa: DTZ007 - a day has no zone
    except ValueError as error:
        raise click.BadParameter(f"{value!r} is no day such as 2027-01-31.") from error


def _words(most: int) -> Callable[[str], str]:
    def convert(value: str) -> str:
        if not value.strip():
            raise click.BadParameter("Words are wanted, not an empty text.")
        if len(terminal(value)) > most:
            raise click.BadParameter(f"At most {most} characters are wanted, and these are {len(terminal(value))}.")
        return value

    return convert


@click.group(
    "baseline",
    cls=Group,
    short_help="Accept the findings of today, each until a day.",
    subcommand_metavar="COMMAND",
    invoke_without_command=True,  # click's own answer would be the whole help, as an error
)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Write, or tidy up, a file of accepted findings for `keystore-audit audit --baseline FILE`."""
    if ctx.invoked_subcommand is None:
        raise click.UsageError("Name what to do with a baseline: create or prune.")


@command.command("create", short_help="Accept what an audit finds now.", context_settings={"show_default": True})
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@opt.file("-o", "--output", "file", required=True, help="The new baseline.")
@click.option("--reason", type=_words(MAX_REASON), required=True, metavar="TEXT", help="Why they are accepted.")
@click.option("--owner", type=_words(MAX_OWNER), required=True, metavar="NAME", help="Who answers for that.")
@click.option("--until", type=_day, required=True, metavar="DAY", help="Their last day (UTC), 180 days off at most.")
@opt.choice("--min-severity", "least", words=SEVERITIES, default="info", help="The least severity that is accepted.")
@audit_options
@opt.verbose_option()
def create_command(keystore: str, file: Path, reason: str, owner: str, until: date, least: str, **given: Any) -> int:
    """Accept every finding of an audit of KEYSTORE, each by its fingerprint.

    Give the options that your audits have. Nothing accepts what the audit says of itself (KA9), nor what leaves it
    undecided.

    \b
    Exit codes:
      0   the file is written
      2   wrong usage, or the file is there or cannot be written
      3   nothing to audit there
      4   the file is written, and something could not be decided
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.baseline import create
    from keystore_audit.findings import Severity

    if file.exists() or file.is_symlink():
        raise click.UsageError(f"{file} is there already, with reasons of its own: prune it, or name another file.")
    target = output.Target(format="baseline", path=file)
    output.check([target], [keystore])
    with Watch(visible=sys.stderr.isatty()) as watch:
        made = create(
            keystore,
            _options(given, [keystore]),
            reason=reason,
            owner=owner,
            until=until,
            least=Severity(least),
            progress=watch,
        )
    output.write(target, made.text)
    _say(f"{file}: {counted(made.accepted, 'finding')} accepted until {until}.")
    if made.refused:
        _say(f"{counted(made.refused, 'finding')} left, which nothing accepts: about the audit itself, or undecided.")
    return 0 if made.complete else EXIT_INCOMPLETE


@command.command("prune", short_help="Drop what has ended or accepts nothing.", context_settings={"show_default": True})
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@audit_options
@opt.verbose_option()
def prune_command(file: Path, keystore: str, **given: Any) -> int:
    """Drop the entries of FILE that have ended, or that accept nothing in an audit of KEYSTORE, and say which.

    Give the options that your audits have. Comments in FILE are not kept.

    \b
    Exit codes:
      0   done, also where nothing was dropped
      2   wrong usage, or the file is no baseline or cannot be written
      3   nothing to audit there
      4   something could not be decided: only what has ended was dropped
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.baseline import prune
    from keystore_audit.settings.settings import read_baseline

    baseline = read_baseline(file, [keystore])
    target = output.Target(format="baseline", path=file)
    output.check([target], [keystore])
    with Watch(visible=sys.stderr.isatty()) as watch:
        left = prune(baseline, keystore, _options(given, [keystore]), progress=watch)
    if left.dropped:
        output.write(target, left.text)
    lines = (f"{use.suppression.what} ({use.why}): {use.suppression.finding}" for use in left.dropped)
    output.write_stdout("".join(f"{terminal(line.removesuffix(': '))}\n" for line in lines))
    _say(f"{file}: {counted(len(left.dropped), 'entry', 'entries')} dropped, {left.kept} kept.")
    if left.doubtful:
        _say(f"{left.doubtful} of those kept accept nothing, but the audit could not decide everything.")
    return 0 if left.complete else EXIT_INCOMPLETE


def _options(given: Mapping[str, Any], keystores: Sequence[str]) -> Options:
    return audit.chosen({**given, **_UNSET}, keystores)


def _say(sentence: str) -> None:
    click.echo(terminal(sentence), err=True)
