"""The command line: options and exit codes, one module per command, and no logic."""

from __future__ import annotations

import gc
import sys
from typing import Final, NoReturn

EXIT_INTERRUPTED: Final = 130
"""128 + SIGINT, as a shell says it."""


def main() -> NoReturn:
    """Run `keystore-audit` with the arguments of this process and exit with its code.

    The process lives for one audit, which makes many values and hardly any cycles: rare collections save a fifth.
    At its end Python would look through all of them once more for cycles, a tenth; the system takes the memory anyway.
    """
    gc.set_threshold(1_000_000, 50, 50)
    try:
        from keystore_audit.cli.program import run

        code = run(sys.argv[1:])
    except KeyboardInterrupt:  # outside of what `run` watches: while it is imported, or says what went wrong
        code = EXIT_INTERRUPTED
    gc.freeze()
    sys.exit(code)
