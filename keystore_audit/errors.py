"""Why an audit could not look; what it looked at and found bad is a finding, never an exception.

Every message is raw text and may quote names from a keystore: whoever prints one sends it through
`keystore_audit.text` first. No message ever holds private key material.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import ClassVar

EXIT_USAGE = 2
EXIT_NOTHING_TO_AUDIT = 3
EXIT_INCOMPLETE = 4
EXIT_INTERRUPTED = 130
"""128 + SIGINT, as a shell says it."""


class AuditError(Exception):
    """The audit could not be done, or not completely; the base of everything this package raises itself.

    Raised as such only where no subclass says it better, e.g. for a damaged installation.
    """

    exit_code: ClassVar[int] = EXIT_INCOMPLETE
    """What the command line exits with when nothing handles the error before (design section 5)."""

    def __init__(self, message: str) -> None:
        """Keep `message`: one or more sentences for the user, saying what was expected and what was there."""
        super().__init__(message)
        self.message = message


class UsageError(AuditError):
    """The call itself is wrong: an unknown enclave, rule code or profile, or an output not to be written."""

    exit_code: ClassVar[int] = EXIT_USAGE


class NothingToAudit(AuditError):
    """There is no keystore at the path: no directory, an empty one, or one without an enclave."""

    exit_code: ClassVar[int] = EXIT_NOTHING_TO_AUDIT


class BudgetExceeded(AuditError):
    """An input would need more work than a named limit allows; whatever depends on it stays unknown."""


class EngineError(AuditError):
    """An engine gave no answer that can be trusted; no property reads as "holds" because of it."""


class EngineMissing(EngineError):
    """The engine is not there and cannot be had: no Java, no jar and nothing to fetch it from."""


class EngineFailed(EngineError):
    """The engine was there and did not do its work: wrong hash, crash, killed, unparsable model or answer."""


class EngineTimeout(EngineError):
    """The engine was still working when its time (`--timeout`, seconds) ran out and was ended."""


class EngineOutOfScale(EngineError):
    """The model is larger than what the engine is known to decide; it was not started.

    `atoms`: its size, and that of what the engine would be asked about; None where size is not the reason.
    """

    def __init__(self, message: str, atoms: tuple[int, int] | None = None) -> None:
        """As every error; see the class."""
        super().__init__(message)
        self.atoms = atoms


def not_installed(error: Exception) -> str:
    """That the audit lacks a package, as when it runs from a clone without its environment; nothing of other errors."""
    module = error.name if isinstance(error, ModuleNotFoundError) else None
    if module is None or module.startswith("keystore_audit"):
        return ""
    return (
        f"The Python module {module} is not installed for {sys.executable}, so nothing is decided. `pip install .` in "
        "the program's directory installs what it needs."
    )


def fault(error: Exception, *, verbose: bool) -> str:
    """Say that this program is at fault; the error's text stays out, since it may quote what it was reading.

    A module that is missing is no fault of the program: it runs from a clone, or with another Python.
    """
    if missing := not_installed(error):
        return missing
    sentence = "A fault in keystore-audit itself stopped it, so nothing is decided. Please report it."
    if not verbose:
        return f"{sentence} With -v it says where."
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = f" at {Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}" if trace is not None else ""
    return f"{sentence} ({type(error).__name__}{where})"
