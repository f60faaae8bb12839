"""`keystore-audit model KEYSTORE -o DIR`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from keystore_audit.cli import once, output
from keystore_audit.cli import options as opt
from keystore_audit.errors import UsageError
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from keystore_audit.intent.intent import Intent


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
@opt.observation_options
@opt.file("--policy", help="An SROS2 policy: the nodes that it is about, and what they are to do.")
@opt.file(
    "--alloy-property",
    "alloy_properties",
    multiple=True,
    help="Properties of your own in Alloy, to stand beside the model (repeatable).",
)
@opt.verbose_option()
def command(
    keystore: str,
    directory: Path,
    domain: int | None,
    profiles: tuple[str, ...],
    time_zone: ZoneInfo | None,
    at: datetime | None,
    graphs: tuple[Path, ...],
    launches: tuple[Path, ...],
    launch_arguments: tuple[tuple[str, str], ...],
    policy: Path | None,
    alloy_properties: tuple[Path, ...],
) -> int:
    """Write the Alloy model of KEYSTORE, ready for the Alloy Analyzer.

    With --graph, --launch or --policy it has the nodes and their wiring too.
    """
    from keystore_audit.engine.alloy.user_file import read_user_files
    from keystore_audit.export import export_model

    opt.check_launch_arguments(launch_arguments, launches)
    output.check_outside(directory, (keystore,))
    files = read_user_files(alloy_properties, keystores=(keystore,))
    try:
        export_model(
            keystore,
            directory,
            at=at or opt.now(),
            profiles=profiles,
            domain=domain,
            time_zone=time_zone,
            intents=_intents(graphs, launches, dict(launch_arguments), policy),
            files=files,
        )
    except OSError as error:
        raise UsageError(f"Cannot write the model to {directory}: {error.strerror or error}.") from error
    click.echo(f"The model is in {terminal(str(directory))}.", err=True)
    return 0


def _intents(
    graphs: Sequence[Path], launches: Sequence[Path], arguments: Mapping[str, str], policy: Path | None
) -> tuple[Intent, ...]:
    """What the files say of the nodes. Raises errors.UsageError for files that are none."""
    from keystore_audit.intent.observed import read_observed
    from keystore_audit.intent.policy import read_policy

    observed = read_observed(graphs, launches, arguments)
    return observed if policy is None else (*observed, read_policy(policy).intent)
