"""What is done with one keystore of many: module functions, which other processes look up by their names."""

from __future__ import annotations

import gc
import os
import sys
from contextlib import suppress
from functools import _lru_cache_wrapper
from itertools import count
from threading import Lock
from typing import Final

from msgspec import Struct, field

from keystore_audit import __version__, formats
from keystore_audit.errors import EXIT_INCOMPLETE, AuditError, fault
from keystore_audit.fleet.tables import Rows, rows_of, rows_without_report
from keystore_audit.keystore.identity import Beside, Compared, read_identities
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report import text
from keystore_audit.report.content import PLAIN, Report, View
from keystore_audit.report.summary import Row, row, without_report

MEMORY: Final = 25
"""Audits after which a process forgets intermediate answers. These are cached by certificate and document, and each
would stay for as long as the process (40 MiB in 500 audits of four enclaves)."""

_ALONE = Lock()
"""Taken for an audit: threads of one process would take turns anyway, and warnings are set for all of them."""


class Task(Struct, frozen=True, kw_only=True):
    """A keystore to be audited, and what is made of its report where it is made.

    `beside`: what is known of the other keystores, None where there are none. `kinds`: formats of the reports with a
    file of their own, which look as `kept` says. `shown`: how the text on standard output looks, None: there is none.
    `whole`: the report itself is wanted; `tables`: rows are. `version`: of this package where the task comes from.
    """

    root: str
    options: Options
    kinds: tuple[str, ...] = ()
    kept: View = PLAIN
    shown: View | None = None
    whole: bool = False
    tables: bool = False
    verbose: bool = False
    beside: Beside | None = None
    version: str = field(default_factory=lambda: __version__)


class Audited(Struct, frozen=True, kw_only=True):
    """What became of a task; where there is no report, `row` says why and the rest is empty."""

    row: Row
    files: tuple[str, ...] = ()
    shown: str = ""
    report: Report | None = None
    tables: Rows | None = None


def identify(task: Task) -> tuple[str, Compared, frozenset[str]]:
    """The directory of a keystore, links resolved, what is compared of it, and the subjects that grants name there.

    For an unreadable keystore there is nothing: its audit takes the same steps and says why. An audit that reads others
    all the same is incomplete (KA666).
    """
    place = os.path.realpath(task.root)
    with _ALONE, suppress(Exception):
        if task.version == __version__:
            return (place, *read_identities(task.root, task.options.files))
    return place, Compared(), frozenset()


def carry_out(task: Task) -> Audited:
    """Audit a keystore; whatever goes wrong is in what is returned."""
    if task.version != __version__:
        said = f"a worker has keystore-audit {__version__}, expected {task.version}, that of the command"
        return lost(task, f"{task.root}: {said}.")
    try:
        with _ALONE:
            _forget_now_and_then()
            report = audit(task.root, task.options, beside=task.beside)
            return Audited(
                row=row(task.root, report),
                files=tuple(formats.render(kind, [report], task.kept, several=False) for kind in task.kinds),
                shown=text.render(report, task.shown) if task.shown is not None else "",
                report=report if task.whole else None,
                tables=rows_of(task.root, report) if task.tables else None,
            )
    except AuditError as error:
        return lost(task, error.message, error.exit_code)
    except Exception as error:  # noqa: BLE001 - one keystore's fault keeps no other from its report
        return lost(task, f"{task.root}: {fault(error, verbose=task.verbose)}")


def lost(task: Task, error: str, exit_code: int = EXIT_INCOMPLETE) -> Audited:
    """The result without a report, and why there is none."""
    tables = rows_without_report(task.root, task.options.at, exit_code, error) if task.tables else None
    return Audited(row=without_report(task.root, exit_code, error), tables=tables)


_audits = count()


def _forget_now_and_then() -> None:
    """Empty every cache of this package, and collect what was in them."""
    if next(_audits) % MEMORY:
        return
    for name, module in list(sys.modules.items()):
        if name.startswith("keystore_audit."):
            for value in vars(module).values():
                if isinstance(value, _lru_cache_wrapper):
                    value.cache_clear()
    gc.collect()
