"""`keystore-audit diff OLD NEW`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.flow import exit_code
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.profiles import facts

if TYPE_CHECKING:
    from keystore_audit.diff import Intended
    from keystore_audit.model.claims.globs import Globs
    from keystore_audit.model.comparison.change import Comparison, FailOn
    from keystore_audit.settings.settings import Settings

EXIT_CHANGED: Final = 1
FORMATS: Final = ("text", "json", "markdown")
ENGINES: Final = ("native", "auto", "both")
FAIL_ON: Final = ("gained", "any", "none")


@click.command("diff", cls=Command, short_help="Say what changed in meaning between two keystores.")
@click.argument("old", metavar="OLD", type=types.keystore_path)
@click.argument("new", metavar="NEW", type=types.keystore_path)
@opt.choice("--fail-on", words=FAIL_ON, default="gained", help="Which changes make the exit code 1.")
@click.option(
    "--label",
    "labels",
    multiple=True,
    metavar="LABEL",
    help="A change fails only where it is about something with this label of the settings; repeatable.",
)
@opt.file("--settings", help="Properties that a change is not to break, and what --label refers to.")
@opt.file("--policy", help="An SROS2 policy: a right that it names is not to be lost, and no other to stay in use.")
@click.option(
    "--rolling",
    is_flag=True,
    help="Say instead what fails while enclaves are updated one by one, in any order, and after that.",
)
@opt.choice("--engine", words=ENGINES, default="native", help="Who decides about --rolling.")
@opt.alloy_options
@opt.file(
    facts.NETWORK_OPTION,
    "network",
    nargs=2,
    metavar="OLD_DIR NEW_DIR",
    is_eager=True,  # before the scope, which may be of that middleware alone
    help="Compare what the files of sessions and routers in these folders let enclaves do, instead.",
)
@opt.observation_options
@opt.interpretation_options
@opt.no_assume_option
@opt.roots_option
@opt.format_option("How the changes are written.", *FORMATS)
@opt.verbose_option()
def command(old: str, new: str, **given: Any) -> int:
    """Say what changed in meaning from the keystore OLD to the keystore NEW.

    Order, layout of the XML, comments and new signatures do not count.

    \b
    --fail-on:
      gained  anything is worse than before: more than it was, or another thing; or less than --policy,
              --graph or a property of the settings asks for
      any     any change of meaning
      none    no change
    \b
    Exit codes:
      0   no change that fails; --rolling: nothing that holds fails on the way
      1   some
      2   wrong usage
      3   nothing to look at there
      4   something is unknown
    """  # noqa: D301 - click's mark for lines that stay as they are
    read = opt.named_settings(given, old, new)
    if given["network"]:
        return _networks(old, new, read, given)
    if given["rolling"]:
        return _rolling(old, new, read, given)
    opt.refuse(("engine", "alloy_jar"), "a comparison of both keystores alone")
    from keystore_audit.diff import compare_keystores
    from keystore_audit.model.comparison.change import FailOn

    comparison = compare_keystores(
        old,
        new,
        opt.reading(given, read, uniform="diff"),
        labels=_labels(given["labels"], read),
        intended=_intended(given, read),
    )
    fail_on = FailOn(given["fail_on"])
    output.write_stdout(_rendered(comparison, fail_on, given["form"]))
    if comparison.unknown:
        return EXIT_INCOMPLETE
    return EXIT_CHANGED if comparison.failing(fail_on) else 0


def _networks(old: str, new: str, settings: Settings | None, given: Mapping[str, Any]) -> int:
    """What the files of sessions and routers let enclaves do, and the exit code."""
    refused = ("labels", "policy", "rolling", "graphs", "launches", "launch_arguments", "engine", "alloy_jar")
    folders, reading, asked = opt.in_network(given, settings, *refused, uniform="diff")
    if given["form"] == "markdown":
        raise click.UsageError("What changed in files of sessions and routers is told as text or json.")
    from keystore_audit.access import routed_tables
    from keystore_audit.report import routed_access
    from keystore_audit.zenoh.answers import changes

    before, after = routed_tables([*zip((old, new), folders, strict=True)], reading, asked)
    found = changes(before, after)
    render = routed_access.changes_json if given["form"] == "json" else routed_access.changes_text
    output.write_stdout(render(before, after, found))
    if before.has_unknown or after.has_unknown:
        return EXIT_INCOMPLETE
    failing = [each for each in found if given["fail_on"] == "any" or each.gained.may]
    return EXIT_CHANGED if failing and given["fail_on"] != "none" else 0


def _rolling(old: str, new: str, settings: Settings | None, given: Mapping[str, Any]) -> int:
    """What fails on the way, and the exit code."""
    opt.refuse(("fail_on", "labels", "policy", "graphs", "launches", "launch_arguments"), "--rolling")
    if given["form"] == "markdown":
        raise click.UsageError("--rolling is answered as text or json.")
    from keystore_audit.report import rolling
    from keystore_audit.rolling import find_passages

    answer = find_passages(
        old,
        new,
        opt.reading(given, settings, uniform="diff --rolling"),
        settings.claims if settings else (),
        opt.engines(given),
    )
    output.write_stdout((rolling.json if given["form"] == "json" else rolling.text)(answer))
    return exit_code(answer.status)


def _labels(labels: tuple[str, ...], settings: Settings | None) -> dict[str, Globs] | None:
    """By label what has it. Raises errors.UsageError for settings without any, and for a label without anything."""
    if not labels:
        return None
    if settings is None:
        raise click.UsageError("--label needs --settings: FILE says what has the label.")
    from keystore_audit.model.comparison.compare import label_globs

    if settings.labels is None:
        raise click.UsageError("--label: the settings have no [[label]].")
    return label_globs(settings.labels, labels)


def _intended(given: dict[str, Any], settings: Settings | None) -> Intended:
    from keystore_audit.diff import Intended
    from keystore_audit.intent import read_observed
    from keystore_audit.intent.policy import read_policy

    return Intended(
        policy=read_policy(given["policy"], None) if given["policy"] is not None else None,
        intents=read_observed(given["graphs"], given["launches"], given["launch_arguments"]),
        claims=[each for each in settings.claims if each.labels is None] if settings is not None else (),
    )


def _rendered(comparison: Comparison, fail_on: FailOn, kind: str) -> str:
    if kind == "json":
        from keystore_audit.report import diff_json

        return diff_json.json(comparison, fail_on)
    from keystore_audit.report import diff_text

    return (diff_text.markdown if kind == "markdown" else diff_text.text)(comparison, fail_on)
