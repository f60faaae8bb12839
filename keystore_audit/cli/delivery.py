"""How a report is shown, and where it goes."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from keystore_audit import formats
from keystore_audit.cli import options as opt
from keystore_audit.cli import output
from keystore_audit.findings import Severity

if TYPE_CHECKING:
    from keystore_audit.report.content import NoReport, Report
    from keystore_audit.report.text import View

WIDTH: Final = 80
"""Columns of a text report that goes to no terminal: the same bytes everywhere."""

MAX_WIDTH: Final = 110
"""Columns on a wide terminal; longer lines are hard to read."""


def deliver(
    reports: Sequence[Report],
    given: Mapping[str, Any],
    *,
    several: bool,
    stdout: bool = True,
    missing: Sequence[NoReport] = (),
) -> None:
    """Write every report that was asked for, to standard output if `stdout`; none where there was nothing to report on.

    `missing`: keystores without a report, which documents about several name, so that none of them looks like a pass.

    Targets that take a report of each keystore are left to whoever audits several.
    """
    targets = [wanted for wanted in given["targets"] if not (wanted.each or wanted.tables)]
    if not reports:
        say_not_written(targets)
        return
    if stdout:
        shown = view(given, stdout=True)
        output.write_stdout(formats.render(given["kind"], reports, shown, several=several, missing=missing))
    kept = view(given, stdout=False)
    for wanted in targets:
        output.write(wanted, formats.render(wanted.format, reports, kept, several=several, missing=missing))


def say_not_written(targets: Sequence[output.Target]) -> None:
    """Say of each file that it is not there, or is an older one."""
    for wanted in targets:
        output.say(f"No report was written to {wanted.path}.")


def view(given: Mapping[str, Any], *, stdout: bool) -> View:
    """Return how the options want a report shown; files look the same everywhere."""
    from keystore_audit.report.text import View

    return View(
        width=columns() if stdout else WIDTH,
        color=stdout and opt.use_color(given["color"], terminal=is_terminal()),
        quiet=given["quiet"],
        verbose=given["verbose"],
        min_severity=Severity(given["min_severity"]),
    )


def is_terminal() -> bool:
    """Whether standard output is one."""
    return sys.stdout is not None and sys.stdout.isatty()


def columns(most: int = MAX_WIDTH) -> int:
    """How many columns standard output has, `most` of them."""
    if not is_terminal():
        return WIDTH
    from shutil import get_terminal_size

    return min(get_terminal_size((WIDTH, 24)).columns, most)
