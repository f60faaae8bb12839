"""`keystore-audit engine` and `keystore-audit engine install`."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command, Group
from keystore_audit.cli.progress import Watch
from keystore_audit.errors import EXIT_INCOMPLETE, EngineMissing
from keystore_audit.text import terminal


@click.group(
    "engine",
    cls=Group,
    short_help="Say which engines there are, or install Alloy's.",
    invoke_without_command=True,
    subcommand_metavar="[install]",
)
@opt.alloy_jar("Ask about this jar.")
@opt.verbose_option()
@click.pass_context
def command(context: click.Context, alloy_jar: Path | None) -> int:
    """Say which engines there are; nothing is fetched.

    Exit code 0, also where Alloy is missing; 4 where it is there and wrong.
    """
    if context.invoked_subcommand is not None:
        return 0
    from keystore_audit import __version__
    from keystore_audit.engine.alloy import archive
    from keystore_audit.engine.alloy.install import locate

    try:
        found = locate(alloy_jar, offline=True, ci=False, progress=None)
    except EngineMissing as error:
        alloy = f"missing: {error.message}"
    else:
        kept = archive.find(found.java) or "no classes; `keystore-audit engine install` keeps them (Java 25 or newer)"
        alloy = f"{found.version}\n        jar   {found.jar}\n        java  {found.java}\n        kept  {kept}"
    lines = (f"native  {__version__} (part of keystore-audit)", f"alloy   {alloy}")
    output.write_stdout("".join(f"{terminal(line)}\n" for text in lines for line in text.split("\n")))
    return 0


@command.command("install", short_help="Fetch or import the Alloy Analyzer.")
@click.option(
    "--from",
    "source",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Import this jar instead of fetching one.",
)
def install_command(source: Path | None) -> int:
    """Fetch the Alloy Analyzer, or import it with --from, and check its hash.

    With Java 25 or newer it is started once, and what it loads is kept: later starts take less.
    """
    from keystore_audit.engine.alloy import archive
    from keystore_audit.engine.alloy.install import find_java, install
    from keystore_audit.engine.alloy.runner import make_archive

    with Watch(visible=sys.stderr.isatty()) as watch:
        jar = install(source, watch.stage)
        with suppress(EngineMissing):  # Java may come later
            java = find_java(os.environ)
            if archive.content(java) is None:
                watch.stage("starting it once, and keeping what it loads")
                make_archive(java, jar)
    click.echo(f"The Alloy Analyzer is at {terminal(str(jar))}.", err=True)
    return 0


@click.command("model", cls=Command, short_help="Write the Alloy model of a keystore.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@click.option(
    "-o",
    "--output",
    "directory",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    metavar="DIR",
    help="Where to; made if it is not there.",
)
@opt.interpretation_options
@opt.network_option
@opt.file_options
@opt.observation_options
@opt.file("--policy", help="An SROS2 policy: the nodes that it is about, and what they are to do.")
@opt.file(
    "--alloy-property",
    "alloy_properties",
    multiple=True,
    help="Properties of your own in Alloy, to stand beside the model (repeatable).",
)
@opt.verbose_option()
def model_command(keystore: str, directory: Path, **given: Any) -> int:
    """Write the Alloy model of KEYSTORE, ready for the Alloy Analyzer.

    With --graph, --launch or --policy it has the nodes and their wiring too. With --zenoh it is that of sessions and
    routers, by release; exit code 4: not all of them could be read.
    """
    from keystore_audit.export import export_model, export_network
    from keystore_audit.intent import read_observed
    from keystore_audit.options import user_files

    output.check_outside(directory, (keystore,))
    complete = True
    if given["network"] is not None:
        refused = ("domain", "graphs", "launches", "launch_arguments", "policy", "alloy_properties")
        asked_of = opt.in_network(given, opt.named_settings(given, keystore), *refused)
        complete = export_network(keystore, directory, *asked_of)
    else:
        opt.check_launch_arguments(given["launch_arguments"], given["launches"])
        files = user_files(given["alloy_properties"], None, (keystore,))
        arguments = dict(given["launch_arguments"])
        intents = read_observed(given["graphs"], given["launches"], arguments, given["policy"])
        reading = opt.reading(given, opt.named_settings(given, keystore))
        export_model(keystore, directory, reading, intents=intents, files=files)
    click.echo(f"The model is in {terminal(str(directory))}.", err=True)
    return 0 if complete else EXIT_INCOMPLETE
