"""Where reports go: standard output, and files that are there whole or not at all."""

from __future__ import annotations

import os
import secrets
import stat
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import click

from keystore_audit.dataclass import dataclass
from keystore_audit.formats import FORMATS
from keystore_audit.given import real_path
from keystore_audit.text import terminal


class Unwritable(click.ClickException):
    """A report could not be delivered: exit code 2."""


TABLES: Final = "parquet"
"""What is no report but tables, which take rows of many keystores."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A report in `format` for the file `path`, or (`each`) a file for each keystore in the directory `path`."""

    format: str
    path: Path
    each: bool = False

    @property
    def tables(self) -> bool:
        """Whether it is a directory of tables, for all keystores together."""
        return self.format == TABLES


def target(value: str) -> Target:
    """Return what `FORMAT=FILE` or `FORMAT=DIR/` means; neither need be there yet."""
    from keystore_audit.cli.options import unknown

    kind, separator, name = value.partition("=")
    if not separator or not name:
        raise click.BadParameter(f"{value!r} is not FORMAT=FILE, e.g. json=report.json.")
    if kind not in (*FORMATS, TABLES):
        raise click.BadParameter(unknown(f"{kind!r} is no format; there are", kind, (*FORMATS, TABLES)))
    if name == "-":
        raise click.BadParameter("For standard output, use --format.")
    return Target(format=kind, path=Path(name), each=name.endswith("/") and kind != TABLES)


def check(targets: Iterable[Target], keystores: Iterable[str] = ()) -> None:
    """Make sure, before any work, that every target can be written; raise Unwritable with the reason.

    Nothing is written into a keystore that is audited: the report could replace what it speaks of.

    A file is tried out beside the target, since that is how it will be written, and removed again at once.
    """
    seen: set[Path] = set()
    roots = tuple(keystores)
    for wanted in targets:
        path = real_path(wanted.path)
        check_outside(wanted.path, roots)
        place = path / wanted.format if wanted.each else path
        if place in seen:
            raise Unwritable(f"Two reports cannot both be written to {wanted.path}.")
        seen.add(place)
        try:
            if wanted.each or wanted.tables:
                _prepare(path, empty=wanted.tables)
            elif _is_special(path):
                if not os.access(path, os.W_OK):
                    raise PermissionError(0, "permission denied")
            else:
                _probe(path)
        except OSError as error:
            raise Unwritable(_reason(wanted, error)) from error


def check_outside(path: Path, keystores: Iterable[str]) -> None:
    """Raise Unwritable if the file or directory, which may not exist yet, lies in one of the keystores."""
    real = real_path(path)
    if any(real.is_relative_to(real_path(keystore)) for keystore in keystores):
        raise Unwritable(f"{path} lies in the keystore that is audited; write it elsewhere.")


def write(wanted: Target, text: str) -> None:
    """Write the report, whole or not at all; raise Unwritable with the reason."""
    path = real_path(wanted.path)
    data = text.encode("utf-8", "backslashreplace")
    try:
        if _is_special(path):  # /dev/stderr, a FIFO: nothing that could be replaced
            path.write_bytes(data)
        else:
            _replace(path, data)
    except OSError as error:
        raise Unwritable(_reason(wanted, error)) from error


def remove(wanted: Target) -> None:
    """Remove what an earlier run wrote, if it did, where `write` would write; raise Unwritable with the reason."""
    path = real_path(wanted.path)
    try:
        if not _is_special(path):
            path.unlink(missing_ok=True)
    except OSError as error:
        raise Unwritable(_reason(wanted, error)) from error


def say(sentence: str) -> None:
    """Write a sentence about the run to standard error."""
    click.echo(f"keystore-audit: {terminal(sentence)}", err=True)


def write_stdout(text: str) -> None:
    """Write the report to standard output; a reader that has gone away (`| head`) is no error.

    What the terminal's encoding cannot show is written as an escape. Raises Unwritable with the reason.
    """
    stream = sys.stdout
    if stream is None:  # type: ignore[redundant-expr,unused-ignore] # closed by the caller: `>&-`
        raise Unwritable("Cannot write the report: standard output is closed.")
    try:
        stream.flush()
        stream.buffer.write(text.encode(stream.encoding or "utf-8", "backslashreplace"))
        stream.flush()
    except BrokenPipeError:
        # Python flushes once more at exit, and would complain there.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except OSError as error:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - open until the process ends
        raise Unwritable(f"Cannot write the report to standard output: {error.strerror}.") from error


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()


def _prepare(directory: Path, *, empty: bool) -> None:
    """Make the directory, try it out; one for tables must be empty, since older rows would count as well."""
    directory.mkdir(parents=True, exist_ok=True)
    if empty and any(directory.iterdir()):
        raise OSError(0, "the directory is not empty")
    _probe(directory / "report")


def _probe(path: Path) -> None:
    if path.is_dir():
        raise IsADirectoryError(0, "it is a directory")
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(0, "permission denied")
    trial = _beside(path)
    os.close(os.open(trial, _CREATE, 0o600))
    trial.unlink()


def _replace(path: Path, data: bytes) -> None:
    draft = _beside(path)
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else None
    descriptor = os.open(draft, _CREATE, 0o666)
    try:
        with open(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        if mode is not None:
            draft.chmod(mode)
        draft.replace(path)
    except BaseException:  # an interrupt too: no draft is left behind
        draft.unlink(missing_ok=True)
        raise


_CREATE: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC


def _beside(path: Path) -> Path:
    """Return a new name in the same directory: only there is a rename atomic."""
    return path.with_name(f".{path.name[:200]}.{secrets.token_hex(8)}.tmp")


def _reason(wanted: Target, error: OSError) -> str:
    return f"Cannot write the {wanted.format} report to {wanted.path}: {error.strerror or error}."
