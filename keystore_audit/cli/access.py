"""`keystore-audit access KEYSTORE`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import delivery, once, output
from keystore_audit.cli import options as opt
from keystore_audit.errors import EXIT_INCOMPLETE

if TYPE_CHECKING:
    from keystore_audit.model.tables.access_table import AccessTable

FORMATS: Final = ("text", "json", "csv")
MAX_WIDTH: Final = 200
"""A line longer than that is lost to the eye."""


@click.command("access", cls=once.Command, short_help="Show who may do what: enclaves and topics.")
@click.argument("keystore", metavar="KEYSTORE", type=opt.keystore_path)
@opt.format_option("How the table is written.", *FORMATS)
@opt.domain_option("In which domain (default: the lowest that a governance covers).")
@opt.reading_options
@opt.file_options
@opt.verbose_option()
def command(keystore: str, **given: Any) -> int:
    """Show who may do what in KEYSTORE: its enclaves and all topics, for each implementation.

    \b
    Exit codes:
      0   everything is decided
      3   nothing to look at there
      4   something is unknown
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.access import read_access_table

    table = read_access_table(
        keystore, **opt.reading(given, opt.named_settings(given, keystore)), domain=given["domain"]
    )
    output.write_stdout(_rendered(table, given["form"]))
    return EXIT_INCOMPLETE if table.has_unknown else 0


def _rendered(table: AccessTable, kind: str) -> str:
    if kind == "json":
        from keystore_audit.report import access_json

        return access_json.json(table)
    if kind == "csv":
        from keystore_audit.report import access_json

        return access_json.csv(table)
    from keystore_audit.report import access_text

    return access_text.text(table, max(delivery.WIDTH, delivery.columns(MAX_WIDTH)))
