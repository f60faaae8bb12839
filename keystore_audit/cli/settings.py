"""Which settings a command goes by."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from keystore_audit.settings import Baseline, Settings

STATEMENTS: Final = ("statement", "svr")
"""Formats that others take as a promise."""

FILE_NAME: Final = "keystore-audit.toml"
"""What is read from the working directory where no file is named."""

option = click.option(
    "--settings",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help=f"What is asserted of the keystore (else ./{FILE_NAME}, save in CI, with --deployed and for statements).",
)


baseline_option = click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Findings that are accepted one by one, as `keystore-audit baseline create` writes them.",
)


def baseline(given: Mapping[str, Any], keystores: Sequence[str]) -> Baseline | None:
    """The baseline named.

    Raises errors.UsageError for a file that is none, and for several keystores: what is accepted in one may look the
    same in another.
    """
    path: Path | None = given["baseline"]
    if path is None:
        return None
    if len(keystores) > 1:
        raise click.UsageError("--baseline is of one keystore: name one KEYSTORE.")
    from keystore_audit.settings import read_baseline

    return read_baseline(path, keystores)


def chosen(given: Mapping[str, Any], keystores: Sequence[str]) -> Settings | None:
    """The settings named, else those in the working directory, but never where the directory may be anybody's.

    Raises errors.UsageError for a file that is none.
    """
    path: Path | None = given["settings"]
    if path is None:
        in_ci = os.environ.get("CI", "").lower() not in ("", "0", "false")
        path = Path(FILE_NAME)
        if in_ci or given["deployed"] or _attests(given) or not os.path.lexists(path):
            return None
    from keystore_audit.settings import read_settings

    return read_settings(path, keystores)


def _attests(given: Mapping[str, Any]) -> bool:
    """Whether any of the reports is a statement, which nobody makes with a file that merely lay there."""
    formats = {given.get("kind"), *(target.format for target in given.get("targets", ()))}
    return not formats.isdisjoint(STATEMENTS)
