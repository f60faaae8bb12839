"""Opening files below a directory without following links, on systems that can."""

from __future__ import annotations

import os

from keystore_audit.errors import AuditError


def flags(*names: str) -> int:
    """The flags of open(2) (POSIX.1-2017) with these names, as far as this system has them (`check_system`)."""
    return sum(getattr(os, name, 0) for name in names)


def check_system() -> None:
    """Raise AuditError where links would be followed: Windows has no such calls."""
    if not hasattr(os, "O_NOFOLLOW") or os.stat not in os.supports_dir_fd:
        raise AuditError(
            "This system cannot open files below a directory without following links, so nothing is decided: run it "
            "on Linux or macOS."
        )
