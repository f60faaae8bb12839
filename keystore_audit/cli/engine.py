"""`keystore-audit engine` and `keystore-audit engine install`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from keystore_audit.cli import once
from keystore_audit.cli import options as opt
from keystore_audit.cli.progress import Watch
from keystore_audit.errors import EngineMissing
from keystore_audit.text import terminal


@click.group(
    "engine",
    cls=once.Group,
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
    from keystore_audit.cli.output import write_stdout
    from keystore_audit.engine.alloy.install import locate

    try:
        found = locate(alloy_jar, offline=True, ci=False, progress=None)
    except EngineMissing as error:
        alloy = f"missing: {error.message}"
    else:
        alloy = f"{found.version}\n        jar   {found.jar}\n        java  {found.java}"
    lines = (f"native  {__version__} (part of keystore-audit)", f"alloy   {alloy}")
    write_stdout("".join(f"{terminal(line)}\n" for text in lines for line in text.split("\n")))
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
    """Fetch the Alloy Analyzer, or import it with --from, and check its hash."""
    from keystore_audit.engine.alloy.install import install

    with Watch(visible=sys.stderr.isatty()) as watch:
        jar = install(source, watch.stage)
    click.echo(f"The Alloy Analyzer is at {terminal(str(jar))}.", err=True)
    return 0
