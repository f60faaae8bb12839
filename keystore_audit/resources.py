"""Where the data folders are: schemas (XSD, JSON Schema) and Alloy modules, in every kind of installation."""

from __future__ import annotations

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
