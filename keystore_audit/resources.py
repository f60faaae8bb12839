"""What the machine has: our data folders in every kind of installation, CI, files opened without following links."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from keystore_audit.errors import AuditError

_PACKAGE: Final = Path(__file__).resolve().parent


def schemas() -> Path:
    """Return the folder of the XSDs and JSON Schemas; raise AuditError if the installation lacks it."""
    return _folder("schemas")


def alloy() -> Path:
    """Return the folder of the hand-written Alloy modules; raise AuditError if the installation lacks it."""
    return _folder("alloy")


def _folder(name: str) -> Path:
    """Find `name` where a wheel puts it, else in the source tree that an editable installation points to.

    The source tree is known by its pyproject.toml: beside an installed package stand other people's folders.
    """
    installed = _PACKAGE / "_data" / name
    if installed.is_dir():
        return installed
    tree = _PACKAGE.parent
    if (tree / "pyproject.toml").is_file() and (tree / name).is_dir():
        return tree / name
    raise AuditError(f"Incomplete installation: {name!r} is neither at {installed} nor at {tree / name}.")


def in_ci() -> bool:
    """Whether the variable CI is set, and not to say no."""
    return os.environ.get("CI", "").lower() not in ("", "0", "false")


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
