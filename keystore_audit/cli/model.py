"""`keystore-audit model KEYSTORE -o DIR`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from keystore_audit.cli import once, output
from keystore_audit.cli import options as opt
from keystore_audit.errors import UsageError
from keystore_audit.text import terminal


@click.command("model", cls=once.Command, short_help="Write the Alloy model of a keystore.")
@click.argument("keystore", metavar="KEYSTORE", type=opt.keystore_path)
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
def command(keystore: str, directory: Path, **given: Any) -> int:
    """Write the Alloy model of KEYSTORE, ready for the Alloy Analyzer.

    With --graph, --launch or --policy it has the nodes and their wiring too.
    """
    from keystore_audit.export import export_model
    from keystore_audit.intent.observed import read_observed
    from keystore_audit.options import user_files

    opt.check_launch_arguments(given["launch_arguments"], given["launches"])
    output.check_outside(directory, (keystore,))
    files = user_files(given["alloy_properties"], None, (keystore,))
    arguments = dict(given["launch_arguments"])
    intents = read_observed(given["graphs"], given["launches"], arguments, given["policy"])
    try:
        export_model(
            keystore,
            directory,
            **opt.reading(given, opt.named_settings(given, keystore)),
            domain=given["domain"],
            intents=intents,
            files=files,
        )
    except OSError as error:
        raise UsageError(f"Cannot write the model to {directory}: {error.strerror or error}.") from error
    click.echo(f"The model is in {terminal(str(directory))}.", err=True)
    return 0
