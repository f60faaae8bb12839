"""Which settings a command goes by."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from keystore_audit.ci import in_ci
from keystore_audit.cli import options as opt

if TYPE_CHECKING:
    from keystore_audit.settings.settings import Settings

STATEMENTS: Final = ("statement", "svr")
"""Formats that others take as a promise, which nobody makes with a file that merely lay there."""

FILE_NAME: Final = "keystore-audit.toml"
"""What is read from the working directory where no file is named."""

option = opt.file(
    "--settings",
    help=f"What is asserted of the keystore (else ./{FILE_NAME}, save in CI, with --deployed and for statements).",
)


baseline_option = opt.file(
    "--baseline", help="Findings that are accepted one by one, as `keystore-audit baseline create` writes them."
)


def chosen(given: Mapping[str, Any], keystores: Sequence[str]) -> Settings | None:
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
