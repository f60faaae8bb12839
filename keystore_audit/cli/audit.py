"""`keystore-audit [audit] KEYSTORE...`."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec.structs import replace

from keystore_audit import formats
from keystore_audit.cli import options as opt
from keystore_audit.cli import output, places, types
from keystore_audit.cli.check import accepted, stated, told
from keystore_audit.cli.program import Command
from keystore_audit.cli.progress import Watch
from keystore_audit.errors import AuditError, NothingToAudit, UsageError
from keystore_audit.findings import SEVERITIES, Severity
from keystore_audit.options import ENGINES, MAX_DAYS, options_of
from keystore_audit.profiles import facts
from keystore_audit.resources import in_ci
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from keystore_audit.options import Options
    from keystore_audit.report.content import Report
    from keystore_audit.settings.settings import Settings

NEVER: Final = "never"
COLORS: Final = ("auto", "always", "never")


MAX_JOBS: Final = 1024
"""Processes at a time: more than any machine has use for."""


STATEMENTS: Final = ("statement", "svr")
"""Formats that others take as a promise, which nobody makes with a file that merely lay there."""

FILE_NAME: Final = "keystore-audit.toml"
"""What is read from the working directory where no file is named."""

settings_option = opt.file(
    "--settings",
    help=f"What is asserted of the keystore (else ./{FILE_NAME}, except in CI, with --deployed and for statements).",
)


baseline_option = opt.file(
    "--baseline", help="Findings that are accepted one by one, as `keystore-audit baseline create` writes them."
)


def named_or_found(given: Mapping[str, Any], keystores: Sequence[str]) -> Settings | None:
    """The settings named, else those in the working directory, but never where the directory may be anybody's.

    Raises errors.UsageError for a file that is none.
    """
    path: Path | None = given["settings"]
    if path is None:
        path = Path(FILE_NAME)
        if _why_not_found(given) or not os.path.lexists(path):
            return None
    from keystore_audit.settings.settings import read_settings

    return read_settings(path, keystores)


def passed_over(given: Mapping[str, Any]) -> str:
    """That settings in the working directory were not used, and why; empty where there are none or they count.

    What they assert was not asked then, so that a pass says less than the same command does elsewhere.
    """
    why = _why_not_found(given)
    if given["settings"] is not None or not why or not os.path.lexists(FILE_NAME):
        return ""
    return f"./{FILE_NAME} was not used, since {' and '.join(why)}; name it with --settings"


def _why_not_found(given: Mapping[str, Any]) -> list[str]:
    """Why settings count only where they are named."""
    return [
        *(["the variable CI is set"] if in_ci() else ()),
        *(["--deployed is given"] if given["deployed"] else ()),
        *([] if formats_of(given).isdisjoint(STATEMENTS) else ["a statement is written"]),
    ]


def formats_of(given: Mapping[str, Any]) -> set[str | None]:
    """All formats that are written."""
    return {given.get("kind"), *(wanted.format for wanted in given.get("targets", ()))}


GROUPS: Final = {
    "Scope": ("distros", "rmws", "profiles", "domain", "at", "time_zone", "deployed", "not_assumed"),
    "Inputs": (
        "recursive", "settings", "roots", "identity_cas", "permissions_cas", "environment", "network", "policy",
        "policy_include", "graphs", "launches", "launch_arguments", "alloy_properties", "certificates",
    ),
    "Output": ("kind", "targets", "min_severity", "quiet", "verbose", "color"),
    "Gate": ("fail_on", "expires_within", "launch_complete", "select", "ignore", "baseline"),
    "Engine": ("engine", "timeout", "alloy_jar", "offline", "jobs", "executor"),
}  # fmt: skip
"""The options in the help, by what they are about."""

EXAMPLES: Final = f"""\b
Examples:
  keystore-audit ./keys --distro jazzy --rmw {facts.EXAMPLE_MIDDLEWARE}
  keystore-audit ./keys --settings keystore-audit.toml -o sarif=out.sarif
  keystore-audit --recursive ./fleet -o html=reports/"""


@click.command(
    "audit",
    cls=Command,
    groups=GROUPS,
    epilog=EXAMPLES,
    short_help="Audit keystores: the default command.",
    context_settings={"show_default": True},
)
@click.argument("keystores", metavar="KEYSTORE...", nargs=-1, required=True, type=types.keystore_path)
@opt.choice("-f", "--format", "kind", words=formats.FORMATS, default="text", help="The report on standard output.")
@click.option(
    "-o",
    "--output",
    "targets",
    type=output.target,
    multiple=True,
    metavar="FORMAT=FILE",
    help="Write a report to a file as well; to DIR/, one of each keystore; parquet=DIR, tables of all (repeatable).",
)
@click.option("-r", "--recursive", is_flag=True, help="Audit every keystore below the directories named.")
@click.option(
    "-j",
    "--jobs",
    type=types.Number(1, MAX_JOBS),
    metavar="N",
    help="Audit so many keystores at a time (default: as processors allow); 1: one process in all.",
)
@click.option(
    "--executor",
    type=types.executor_address,
    metavar="dask://HOST:PORT",
    help="Hand the keystores to the workers of this Dask scheduler.",
)
@opt.choice(
    "--fail-on", words=(*SEVERITIES, NEVER), default="high", help="The least severity that makes the exit code 1."
)
@opt.choice(
    "--min-severity", words=SEVERITIES, default="info", help="Hide findings below it in text; the exit code stays."
)
@opt.interpretation_options
@opt.no_assume_option
@opt.observation_options
@click.option(
    "--launch-complete",
    is_flag=True,
    help="Exit with 4 where a launch file is not read as a whole, or something of it cannot be told.",
)
@click.option(
    "--expires-within",
    type=types.Number(0, MAX_DAYS),
    default=30,
    metavar="DAYS",
    help="Report what expires in the days to come.",
)
@opt.file(
    "--env",
    "environment",
    help="The variables that the robots start with (NAME=VALUE): security, middleware, domain.",
)
@opt.network_option
@opt.file("--policy", help="Compare what is granted with this SROS2 policy, both ways.")
@opt.file(
    "--policy-include", metavar="DIR", help="The policy may include files from below DIR (default: from beside it)."
)
@opt.file(
    "--alloy-property",
    "alloy_properties",
    multiple=True,
    help="Properties of your own in Alloy, which Alloy alone decides (repeatable).",
)
@click.option(
    "--certificate",
    "certificates",
    nargs=2,
    type=(click.Path(path_type=Path), str),
    multiple=True,
    metavar="FILE PROPERTY",
    help="Name in the report a certificate, which has to prove PROPERTY as `check` decides (repeatable).",
)
@opt.authority_options
@opt.roots_option
@settings_option
@baseline_option
@click.option("--deployed", is_flag=True, help="This tree goes on a robot: CA private keys in it are critical.")
@click.option(
    "--select",
    type=types.RULE,
    multiple=True,
    metavar="CODE",
    help="Only this rule or family (repeatable).",
)
@click.option(
    "--ignore",
    type=types.RULE,
    multiple=True,
    metavar="CODE",
    help="Not this rule or family (repeatable).",
)
@opt.choice(
    "--engine",
    words=ENGINES,
    default="auto",
    help="Who decides the properties; auto: both, native alone where Alloy cannot be had.",
)
@opt.alloy_options
@click.option("-q", "--quiet", is_flag=True, help="Only the verdict and the headings of what decided it (text).")
@opt.verbose_option("All that is known, not one screen (text); on stderr, how long each stage took.", to_command=True)
@opt.choice("--color", words=COLORS, default="auto", help="Colour on a terminal.")
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
    several = len(keystores) > 1 or given["recursive"]
    if several and (given["graphs"] or given["launches"] or given["network"] or given["certificates"]):
        named = f"--graph, --launch, {facts.NETWORK_OPTION} and --certificate"
        raise click.UsageError(f"{named} are about one keystore: name one KEYSTORE.")
    if several or given["executor"] or any(wanted.each or wanted.tables for wanted in given["targets"]):
        from keystore_audit.cli import fleet

        return fleet.run(keystores, given, lambda found: chosen(given, found))
    output.check(given["targets"], keystores)
    return _audit_one(keystores[0], chosen(given, keystores), given)


def chosen(given: Mapping[str, Any], keystores: Sequence[str]) -> Options:
    """Return what the options mean, settings and baseline read. Raises errors.UsageError for files that are none."""
    opt.check_launch_arguments(given["launch_arguments"], given["launches"])
    if given["launch_complete"] and not given["launches"]:
        raise click.UsageError("--launch-complete is about the files that --launch names.")
    if given["baseline"] is not None and len(keystores) > 1:  # what is accepted in one may look the same in another
        raise click.UsageError("--baseline is of one keystore: name one KEYSTORE.")
    more = {
        "fail_on": None if given["fail_on"] == NEVER else Severity(given["fail_on"]),
        "expires_within": timedelta(days=given["expires_within"]),
        "launch_arguments": dict(given["launch_arguments"]),
        "overview": formats.HTML in formats_of(given),
        "settings_passed_over": passed_over(given),
    }
    return options_of({**given, **more}, keystores, named_or_found(given, keystores))


def _audit_one(keystore: str, options: Options, given: Mapping[str, Any]) -> int:
    from keystore_audit.pipeline import audit

    watch = Watch(visible=not given["quiet"] and sys.stderr.isatty())
    try:
        with watch:
            report = _proved(audit(keystore, options, progress=watch), options, given)
    except UsageError:
        raise
    except AuditError as error:
        hint = places.command_meant(keystore) if isinstance(error, NothingToAudit) else ""
        output.say(f"{error.message}{hint}")
        output.say_not_written(given["targets"])
        return error.exit_code
    for stage, seconds in watch.durations if given["verbose"] else ():
        click.echo(f"{seconds:8.3f} s  {terminal(stage)}", err=True)
    output.deliver([report], given, several=False)
    return report.exit_code


def _proved(report: Report, options: Options, given: Mapping[str, Any]) -> Report:
    """The report with the certificates; raises UsageError for one that the checker does not accept of what was read."""
    for path, words in given["certificates"]:
        from keystore_audit.certificate.errors import NotAccepted
        from keystore_audit.model.trust.chain import Authorities

        trusted = options.authorities or Authorities()
        circumstances = told(report.judged_profiles, report.at, options.not_assumed, trusted)
        try:
            file, digests = accepted(path, report.keystore, stated(words.split(), {}), circumstances)
        except NotAccepted as why:
            raise UsageError(f"{path} does not prove {words}: {why}.") from why
        mixed = options.settings is not None and options.settings.runs
        if mixed or not digests.items() <= dict(report.files).items():
            raise UsageError(
                f"{path} does not prove {words} of a mixed fleet, nor of files that were changed meanwhile."
            )
        said = f"{path} (SHA-256 {file.sha256}) proves {words}."
        report = replace(report, inputs=(*report.inputs, ("--certificate", file)), stated=(*report.stated, said))
    return report
