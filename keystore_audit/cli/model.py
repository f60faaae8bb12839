"""`keystore-audit model KEYSTORE -o DIR`."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from keystore_audit.cli import options as opt
from keystore_audit.errors import UsageError
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo


@click.command("model", short_help="Write the Alloy model of a keystore.")
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
@opt.verbose_option("Say where a fault is.")
def command(
    keystore: str,
    directory: Path,
    domain: int | None,
    profiles: tuple[str, ...],
    time_zone: ZoneInfo | None,
    at: datetime | None,
) -> int:
    """Write the Alloy model of KEYSTORE, ready for the Alloy Analyzer."""
    from keystore_audit.export import export_model

    try:
        export_model(keystore, directory, at=at or opt.now(), profiles=profiles, domain=domain, time_zone=time_zone)
    except OSError as error:
        raise UsageError(f"Cannot write the model to {directory}: {error.strerror or error}.") from error
    click.echo(f"The model is in {terminal(str(directory))}.", err=True)
    return 0
