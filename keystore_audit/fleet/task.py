"""What is done with one keystore of many: module functions, which other processes look up by their names."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import _lru_cache_wrapper
from itertools import count
from threading import Lock
from typing import Any, Final

from msgspec import Struct, field

from keystore_audit import __version__
from keystore_audit.errors import EXIT_INCOMPLETE, AuditError
from keystore_audit.keystore.identity import Beside, Compared, read_identities
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report

MEMORY: Final = 25
"""Audits whose intermediate answers a process keeps: they are cached by certificate and document, each of which would
stay for as long as the process (40 MiB in 500 audits of four enclaves)."""

_ALONE = Lock()
"""Taken for an audit: threads of one process would take turns anyway, and warnings are set for all of them."""


class Task(Struct, frozen=True, kw_only=True):
    """A keystore to be audited.

    `beside`: what is known of the other keystores, None where there are none. `make`: what to make of the report where
    it is made. `explain`: says a fault of this program in a sentence. Both, and `options`, go to
    other processes. `version`: of this package where the task comes from.
    """

    root: str
    options: Options
    make: Callable[[Report], Any]
    explain: Callable[[Exception], str]
    beside: Beside | None = None
    version: str = field(default_factory=lambda: __version__)


class Audited(Struct, frozen=True, kw_only=True):
    """What became of a task: what was `made` of the report, or (then it is None) the `error`, raw text.

    `exit_code`: the keystore's own, or that of the error.
    """

    exit_code: int
    made: Any = None
    error: str = ""


def identify(task: Task) -> tuple[str, Compared, frozenset[str]]:
    """The directory of a keystore, links resolved, what is compared of it, and the subjects that grants name there.

    Of one that cannot be read there is nothing, since its audit, which takes the same steps, says why. An audit that
    reads others all the same is incomplete (KA666).
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
        return Audited(exit_code=EXIT_INCOMPLETE, error=f"{task.root}: {said}.")
    try:
        with _ALONE:
            _forget_now_and_then()
            report = audit(task.root, task.options, beside=task.beside)
            return Audited(exit_code=report.exit_code, made=task.make(report))
    except AuditError as error:
        return Audited(exit_code=error.exit_code, error=error.message)
    except Exception as error:  # noqa: BLE001 - one keystore's fault keeps no other from its report
        return Audited(exit_code=EXIT_INCOMPLETE, error=f"{task.root}: {task.explain(error)}")


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
