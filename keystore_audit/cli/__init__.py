"""The command line: options and exit codes, one module per command, and no logic."""

from __future__ import annotations

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run `keystore-audit` with the arguments of this process and exit with its code."""
    from keystore_audit.cli.program import run

    sys.exit(run(sys.argv[1:]))
