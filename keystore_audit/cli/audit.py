"""`keystore-audit [audit] KEYSTORE...`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import formats, output, settings
from keystore_audit.cli import options as opt
from keystore_audit.cli.progress import Watch
from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_NOTHING_TO_AUDIT, AuditError, NothingToAudit, UsageError
from keystore_audit.findings import Severity
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from keystore_audit.audit import Options
    from keystore_audit.engine.alloy.user_file import UserFile
    from keystore_audit.keystore.identity import Identity
    from keystore_audit.report.content import Report
    from keystore_audit.settings import Settings

ENGINES: Final = ("auto", "both", "alloy", "native")
SEVERITIES: Final = tuple(severity.value for severity in Severity)
NEVER: Final = "never"
COLORS: Final = ("auto", "always", "never")

WIDTH: Final = 80
"""Columns of a text report that goes to no terminal: the same bytes everywhere."""

MAX_WIDTH: Final = 110
"""Columns on a wide terminal; longer lines are hard to read."""

WORST_FIRST: Final = (EXIT_INCOMPLETE, EXIT_NOTHING_TO_AUDIT, 1, 0)
"""How exit codes of several keystores combine: the first of these that occurs."""


@click.command("audit", short_help="Audit keystores: the default command.", context_settings={"show_default": True})
@click.argument("keystores", metavar="KEYSTORE...", nargs=-1, required=True, type=opt.keystore_path)
@click.option(
    "-f",
    "--format",
    "kind",
    type=opt.one_of(*formats.FORMATS),
    default="text",
    metavar="[" + "|".join(formats.FORMATS) + "]",
    help="The report on standard output.",
)
@click.option(
    "-o",
    "--output",
    "targets",
    type=output.target,
    multiple=True,
    metavar="FORMAT=FILE",
    help="Write a report to a file as well (repeatable).",
)
@click.option(
    "--fail-on",
    type=opt.one_of(*SEVERITIES, NEVER),
    default="high",
    metavar="[" + "|".join((*SEVERITIES, NEVER)) + "]",
    help="The least severity that makes the exit code 1.",
)
@click.option(
    "--min-severity",
    type=opt.one_of(*SEVERITIES),
    default="info",
    metavar="[" + "|".join(SEVERITIES) + "]",
    help="Hide findings below it in text; the exit code stays.",
)
@opt.interpretation_options
@opt.observation_options
@click.option(
    "--expires-within",
    type=click.IntRange(0, opt.MAX_DAYS),
    default=30,
    metavar="DAYS",
    help="Report what expires in the days to come.",
)
@click.option(
    "--env",
    "environment",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The variables that the robots start with (NAME=VALUE): security, middleware, domain.",
)
@click.option(
    "--policy",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Compare what is granted with this SROS2 policy, both ways.",
)
@click.option(
    "--policy-include",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="The policy may include files from below DIR (default: from beside it).",
)
@click.option(
    "--alloy-property",
    "alloy_properties",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="FILE",
    help="Properties of your own in Alloy, which Alloy alone decides (repeatable).",
)
@settings.option
@settings.baseline_option
@click.option("--deployed", is_flag=True, help="This tree goes on a robot: CA private keys in it are critical.")
@click.option(
    "--select", type=opt.rule_code, multiple=True, metavar="CODE", help="Only this rule or family (repeatable)."
)
@click.option(
    "--ignore", type=opt.rule_code, multiple=True, metavar="CODE", help="Not this rule or family (repeatable)."
)
@click.option(
    "--engine",
    type=opt.one_of(*ENGINES),
    default="auto",
    metavar="[auto|both|alloy|native]",
    help="Who decides the properties; auto: both, native alone where Alloy cannot be had.",
)
@click.option("--offline", is_flag=True, help="Never fetch the Alloy Analyzer.")
@click.option(
    "--alloy-jar",
    type=click.Path(path_type=Path),
    envvar="KEYSTORE_AUDIT_ALLOY_JAR",
    show_envvar=True,
    metavar="FILE",
    help="Use this jar of the Alloy Analyzer.",
)
@click.option("--timeout", type=opt.seconds, default=120, metavar="SECONDS", help="The longest that Alloy may take.")
@click.option("-q", "--quiet", is_flag=True, help="Only the verdict and the findings that decided it (text).")
@opt.verbose_option("Every rule's outcome too (text); on stderr, how long each stage took.", to_command=True)
@click.option(
    "--color", type=opt.one_of(*COLORS), default="auto", metavar="[auto|always|never]", help="Colour on a terminal."
)
def command(keystores: tuple[str, ...], **given: Any) -> int:
    """Audit each KEYSTORE directory and report what its signed artifacts really allow.

    \b
    Exit codes:
      0    nothing at or above --fail-on
      1    findings at or above --fail-on
      2    wrong usage, or a report that cannot be written
      3    nothing to audit there
      4    incomplete: something could not be decided
      130  interrupted
    Over several keystores: the first of 4, 3, 1, 0 that occurs.
    """  # noqa: D301 - click's mark for lines that stay as they are
    if given["quiet"] and given["verbose"]:
        raise click.UsageError("Choose --quiet or --verbose.")
    if given["policy_include"] is not None and given["policy"] is None:
        raise click.UsageError("--policy-include is for the files that a --policy includes.")
    if len(keystores) > 1 and (given["graphs"] or given["launches"]):
        raise click.UsageError("--graph and --launch show the nodes of one keystore: name one KEYSTORE.")
    output.check(given["targets"], keystores)
    reports, code = _audit_all(keystores, chosen(given, keystores), quiet=given["quiet"], verbose=given["verbose"])
    _deliver(reports, given, several=len(keystores) > 1)
    return code


def chosen(given: Mapping[str, Any], keystores: Sequence[str]) -> Options:
    """Return what the options mean, settings and baseline read. Raises errors.UsageError for files that are none."""
    from keystore_audit.audit import Options

    at: datetime | None = given["at"]
    asserted = settings.chosen(given, keystores)
    return Options(
        at=at or opt.now(),
        at_given=at is not None,
        profiles=given["profiles"],
        domain=given["domain"],
        time_zone=given["time_zone"],
        environment=given["environment"],
        policy=given["policy"],
        policy_include=given["policy_include"],
        engine=given["engine"],
        offline=given["offline"],
        alloy_jar=given["alloy_jar"],
        timeout=given["timeout"],
        fail_on=None if given["fail_on"] == NEVER else Severity(given["fail_on"]),
        expires_within=timedelta(days=given["expires_within"]),
        deployed=given["deployed"],
        select=given["select"],
        ignore=given["ignore"],
        graphs=given["graphs"],
        launches=given["launches"],
        launch_arguments=dict(given["launch_arguments"]),
        settings=asserted,
        baseline=settings.baseline(given, keystores),
        alloy_properties=_alloy_properties(given["alloy_properties"], asserted),
    )


def _alloy_properties(paths: Sequence[Path], asserted: Settings | None) -> tuple[UserFile, ...]:
    """Return the users' files in Alloy, whose ids differ from those of the settings."""
    if not paths:
        return ()
    from keystore_audit.engine.alloy.user_file import read_user_files

    return read_user_files(paths, asserted.claims if asserted else ())


def _audit_all(keystores: Sequence[str], options: Options, *, quiet: bool, verbose: bool) -> tuple[list[Report], int]:
    """Audit one keystore after the other; one that cannot be audited is said on stderr and hides no other."""
    from keystore_audit.audit import audit

    reports: list[Report] = []
    codes: list[int] = []
    identities = _identities(keystores)
    for keystore in keystores:
        watch = Watch(visible=not quiet and sys.stderr.isatty())
        try:
            with watch:
                report = audit(keystore, options, progress=watch, elsewhere=_elsewhere(keystore, identities))
        except UsageError:
            raise
        except AuditError as error:
            hint = _command_meant(keystore) if isinstance(error, NothingToAudit) else ""
            click.echo(f"keystore-audit: {terminal(error.message)}{hint}", err=True)
            codes.append(error.exit_code)
        except Exception as error:
            if len(keystores) == 1:
                raise
            from keystore_audit.cli.program import fault

            click.echo(f"keystore-audit: {terminal(keystore)}: {fault(error, verbose=verbose)}", err=True)
            codes.append(EXIT_INCOMPLETE)
        else:
            reports.append(report)
            codes.append(report.exit_code)
        for stage, seconds in watch.durations if verbose else ():
            click.echo(f"{seconds:8.3f} s  {terminal(stage)}", err=True)
    return reports, min(codes, key=WORST_FIRST.index)


def _elsewhere(keystore: str, identities: Mapping[str, tuple[Identity, ...]]) -> tuple[Identity, ...]:
    """Return the identities of the other keystores; one directory named twice is no other."""
    here = Path(keystore).resolve()
    return tuple(each for other, found in identities.items() if Path(other).resolve() != here for each in found)


def _identities(keystores: Sequence[str]) -> dict[str, tuple[Identity, ...]]:
    """Return the identities of several keystores; of one that cannot be read none: that is said when it is its turn."""
    from keystore_audit.keystore.identity import read_identities

    found: dict[str, tuple[Identity, ...]] = {}
    for keystore in keystores if len(keystores) > 1 else ():
        with suppress(Exception):  # its audit takes the same steps and meets the same fault
            found[keystore] = read_identities(keystore)
    return found


def _command_meant(keystore: str) -> str:
    """Return a hint where what is no directory looks like the misspelt name of a command."""
    from keystore_audit.cli.program import COMMANDS

    nearest = get_close_matches(keystore, COMMANDS, n=1)
    return f" Did you mean the command {nearest[0]!r}?" if nearest and not Path(keystore).exists() else ""


def _deliver(reports: Sequence[Report], given: dict[str, Any], *, several: bool) -> None:
    """Write every report that was asked for; none where there was nothing to report on."""
    if not reports:
        for wanted in given["targets"]:
            click.echo(f"keystore-audit: No report was written to {terminal(str(wanted.path))}.", err=True)
        return
    output.write_stdout(_render(given["kind"], reports, given, several=several, stdout=True))
    for wanted in given["targets"]:
        output.write(wanted, _render(wanted.format, reports, given, several=several, stdout=False))


def _render(kind: str, reports: Sequence[Report], given: dict[str, Any], *, several: bool, stdout: bool) -> str:
    from keystore_audit.report.text import View

    view = View(
        width=_width() if stdout else WIDTH,
        color=stdout and opt.use_color(given["color"], terminal=_is_terminal()),
        quiet=given["quiet"],
        verbose=given["verbose"],
        min_severity=Severity(given["min_severity"]),
    )
    return formats.render(kind, reports, view, several=several)


def _is_terminal() -> bool:
    return sys.stdout is not None and sys.stdout.isatty()


def _width() -> int:
    from shutil import get_terminal_size

    return min(get_terminal_size((WIDTH, 24)).columns, MAX_WIDTH) if _is_terminal() else WIDTH
