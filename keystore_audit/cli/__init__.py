"""The command line: options and exit codes, one module per command, and no logic."""

from __future__ import annotations

import gc
import os
import sys
from contextlib import suppress
from typing import Any, NoReturn, TextIO

from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_INTERRUPTED, not_installed


class _StandardError:
    """Standard error, which may be full or closed: what is said there beside a report changes no exit code."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = open(os.devnull, "w", encoding="utf-8") if stream is None else stream  # noqa: SIM115

    def write(self, text: str) -> int:
        """Write, if it can be."""
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, if it can be."""
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def main() -> NoReturn:
    """Run `keystore-audit` with the arguments of this process and exit with its code.

    The process lives for one audit, which makes many values and hardly any cycles: rare collections save a fifth.
    At its end Python would look through all of them once more for cycles, a tenth; the system takes the memory anyway.
    """
    gc.set_threshold(1_000_000, 50, 50)
    sys.stderr = _StandardError(sys.stderr)
    try:
        from keystore_audit.cli.program import run

        code = run(sys.argv[1:])
    except ModuleNotFoundError as error:  # without click there is no program that says it
        missing = not_installed(error)
        if not missing:
            raise
        print(f"keystore-audit: {missing}", file=sys.stderr)  # noqa: T201
        code = EXIT_INCOMPLETE
    except KeyboardInterrupt:  # outside of what `run` watches: while it is imported, or says what went wrong
        code = EXIT_INTERRUPTED
    gc.freeze()
    sys.exit(code)
