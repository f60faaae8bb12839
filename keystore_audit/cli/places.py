"""Which keystores a command line means, and where the report of each goes."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from msgspec.structs import replace

from keystore_audit.cli.output import Target
from keystore_audit.cli.types import COMMANDS
from keystore_audit.errors import UsageError
from keystore_audit.text import meant

if TYPE_CHECKING:
    from keystore_audit.fleet.run import Found
    from keystore_audit.options import Options

FILE_NAMES: Final = {
    "text": "report.txt",
    "junit": "report.xml",
    "markdown": "report.md",
    "statement": "report.statement.json",
    "svr": "report.svr.json",
    "json": "report.json",
}
"""What the report of one keystore is called in its directory; others `report.FORMAT`."""

SUMMARY: Final = "summary.json"

MAX_ENTRIES: Final = 200_000
"""Files and directories below where reports go among which older ones are looked for: a second at worst."""

_OWN_NAMES: Final = ("report.", SUMMARY)
"""What names of files here begin with; directories that are called so are written otherwise."""


def found(named: Sequence[str], *, recursive: bool) -> Found:
    """Return the keystores named, or those below the directories named, each once.

    A directory named in which there is none is among them, unless there is none at all: its audit says so.
    """
    from keystore_audit.fleet.run import Found, find_keystores

    if not recursive:
        return Found(keystores=tuple(named), unseen=())
    searched = [find_keystores(directory, beside=named) for directory in named]
    if any(each.keystores for each in searched):
        searched = [
            each if each.keystores or each.unseen else replace(each, keystores=(directory,))
            for directory, each in zip(named, searched, strict=True)
        ]
    once = {os.path.realpath(path): path for each in reversed(searched) for path in reversed(each.keystores)}
    chosen = set(once.values())
    return Found(
        keystores=tuple(dict.fromkeys(path for each in searched for path in each.keystores if path in chosen)),
        unseen=tuple(unseen for each in searched for unseen in each.unseen),
    )


def everywhere(found: Found, options: Options) -> tuple[Found, Options]:
    """Return both with absolute paths, which mean the same in whatever directory a worker runs."""

    def absolute(path: Path | None) -> Path | None:
        return None if path is None else path.absolute()

    keystores = tuple(os.path.abspath(path) for path in found.keystores)
    return replace(found, keystores=keystores), replace(
        options,
        policy=absolute(options.policy),
        policy_include=absolute(options.policy_include),
        environment=absolute(options.environment),
        alloy_jar=absolute(options.alloy_jar),
        graphs=tuple(path.absolute() for path in options.graphs),
        launches=tuple(path.absolute() for path in options.launches),
        roots=tuple(path.absolute() for path in options.roots),
    )


def reports(keystores: Sequence[str], named: Sequence[str], given: Mapping[str, Any]) -> dict[str, str]:
    """Return the directory of each keystore's reports by its path, below where reports go: empty, or ending in `/`.

    It is the keystore's path as it was given, or relative to the one directory that was searched. Raises
    errors.UsageError if there are to be reports of each, and two would have the same.
    """
    base = named[0] if given["recursive"] and len(named) == 1 else None  # relpath makes both absolute
    directories = {path: _directory(path if base is None else os.path.relpath(path, base)) for path in keystores}
    if any(wanted.each for wanted in given["targets"]) and len(set(directories.values())) < len(keystores):
        raise UsageError("One keystore is named twice, so that its reports would be written twice to one place.")
    return directories


def check_outside(keystores: Sequence[str], directories: Mapping[str, str], targets: Sequence[Target]) -> None:
    """Raise errors.UsageError if a keystore's report would be written into one of the keystores."""
    real = {os.path.realpath(path) for path in keystores}
    for wanted in targets:
        for directory in directories.values() if wanted.each else ():
            place = Path(os.path.realpath(wanted.path / directory))
            if str(place) in real or any(str(parent) in real for parent in place.parents):
                raise UsageError(
                    f"{wanted.path / directory} lies in a keystore that is audited; write the reports elsewhere."
                )


def own_file(wanted: Target, directory: str) -> Target:
    """Return where one keystore's report goes."""
    name = FILE_NAMES.get(wanted.format, f"report.{wanted.format}")
    return Target(format=wanted.format, path=Path(wanted.path, directory, name), folder=wanted.path)


def older_files(wanted: Target, written: Collection[Path]) -> list[Path]:
    """Return the reports of that name below where reports go that are not among those `written`, in order.

    They are of an earlier run: of keystores that this one was not about, or did not come to. Of a directory with a
    great many entries only the first are looked at.
    """
    name = own_file(wanted, "").path.name
    found = []
    looked_at = 0
    for directory, _below, files in os.walk(wanted.path):
        looked_at += 1 + len(files)
        if looked_at > MAX_ENTRIES:
            break
        path = Path(directory, name)
        if name in files and path not in written:
            found.append(path)
    return sorted(found)


def summary_file(wanted: Target) -> Target:
    """Return where the summary of all goes."""
    return Target(format=wanted.format, path=Path(wanted.path, SUMMARY), folder=wanted.path)


def _directory(path: str) -> str:
    parts = [part for part in path.split("/") if part not in ("", ".")]
    return "".join(f"{_name(part)}/" for part in parts)


def _name(part: str) -> str:
    """Return a name that leads nowhere else and is no file of ours."""
    if part == ".." or part.startswith(_OWN_NAMES):
        return part.replace(".", "%2E")
    return part


def command_meant(keystore: str) -> str:
    """Return a hint where what is no directory looks like the misspelt name of a command."""
    return "" if Path(keystore).exists() else meant(keystore, COMMANDS, " Did you mean the command {!r}?")
