"""Where reports go: standard output, and files that are there whole or not at all."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec import Struct

from keystore_audit import formats
from keystore_audit.cli.options import use_color
from keystore_audit.cli.types import unknown
from keystore_audit.findings import Severity
from keystore_audit.given import real_path
from keystore_audit.resources import check_system, flags
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from keystore_audit.report.content import NoReport, Report, View


class Unwritable(click.ClickException):
    """A report could not be delivered: exit code 2."""


TABLES: Final = "parquet"
"""What is no report but tables, which take rows of many keystores."""


class Target(Struct, frozen=True, kw_only=True):
    """A report in `format` for the file `path`, or (`each`) a file for each keystore in the directory `path`.

    `folder`: the directory that was named, links of which are followed; those below it are not. None: the file's own.
    """

    format: str
    path: Path
    each: bool = False
    folder: Path | None = None

    @property
    def tables(self) -> bool:
        """Whether it is a directory of tables, for all keystores together."""
        return self.format == TABLES


def target(value: str) -> Target:
    """Return what `FORMAT=FILE` or `FORMAT=DIR/` means; neither need be there yet."""
    kind, separator, name = value.partition("=")
    if not separator or not name:
        raise click.BadParameter(f"{value!r} is not FORMAT=FILE, e.g. json=report.json.")
    if kind not in (*formats.FORMATS, TABLES):
        raise click.BadParameter(unknown(f"{kind!r} is no format; there are", kind, (*formats.FORMATS, TABLES)))
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
        check_outside(wanted.path, roots)
        place = real_path(wanted.path) / wanted.format if wanted.each else _place(wanted.path)
        if place in seen:
            raise Unwritable(f"Two reports cannot both be written to {wanted.path}.")
        seen.add(place)
        try:
            if wanted.each or wanted.tables:
                _prepare(wanted, empty=wanted.tables)
            elif _is_special(wanted.path):
                if not os.access(wanted.path, os.W_OK):
                    raise PermissionError(0, "permission denied")
            else:
                _probe(wanted)
        except OSError as error:
            raise Unwritable(_reason(wanted, error)) from error


def check_outside(path: Path, keystores: Iterable[str]) -> None:
    """Raise Unwritable if the file or directory, which may not exist yet, lies in one of the keystores."""
    roots = [real_path(keystore) for keystore in keystores]
    if any(place.is_relative_to(root) for place in (real_path(path), _place(path)) for root in roots):
        raise Unwritable(f"{path} lies in the keystore that is audited; write it elsewhere.")


def write(wanted: Target, text: str) -> None:
    """Write the report, whole or not at all; raise Unwritable with the reason.

    A link in its place is replaced, whatever it leads to; directories below the one that was named are made.
    """
    data = text.encode("utf-8", "backslashreplace")
    try:
        if _is_special(wanted.path):  # /dev/stderr, a FIFO: nothing that could be replaced
            wanted.path.write_bytes(data)
        else:
            with _folder(wanted, make=True) as (folder, name):
                _replace(folder, name, data)
    except OSError as error:
        raise Unwritable(_reason(wanted, error)) from error


def remove(wanted: Target) -> None:
    """Remove what an earlier run wrote, if it did, where `write` would write; raise Unwritable with the reason."""
    try:
        if not _is_special(wanted.path):
            with suppress(FileNotFoundError), _folder(wanted) as (folder, name):
                os.unlink(name, dir_fd=folder)
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


def _place(path: Path) -> Path:
    """Where a file is written: a link that it may be is replaced, not followed."""
    return real_path(path.parent) / path.name


def _is_special(path: Path) -> bool:
    """Whether it is a device or the like; of links to one, those of the system (`/dev/stderr`)."""
    system = any(_place(path).is_relative_to(folder) for folder in ("/dev", "/proc"))
    return (system or not path.is_symlink()) and path.exists() and not path.is_file() and not path.is_dir()


def _prepare(wanted: Target, *, empty: bool) -> None:
    """Make the directory, try it out; one for tables must be empty, since older rows would count as well."""
    wanted.path.mkdir(parents=True, exist_ok=True)
    if empty and any(wanted.path.iterdir()):
        raise OSError(0, "the directory is not empty")
    _probe(Target(format=wanted.format, path=wanted.path / "report"))


def _probe(wanted: Target) -> None:
    path = wanted.path
    if path.is_dir():
        raise IsADirectoryError(0, "it is a directory")
    if path.exists() and not path.is_symlink() and not os.access(path, os.W_OK):
        raise PermissionError(0, "permission denied")
    with _folder(wanted, make=True) as (folder, name):
        trial = _draft(name)
        os.close(os.open(trial, _CREATE, 0o600, dir_fd=folder))
        os.unlink(trial, dir_fd=folder)


@contextmanager
def _folder(wanted: Target, *, make: bool = False) -> Iterator[tuple[int, str]]:
    """The directory that the file goes to, open, and its name there. Below the one named no link is followed."""
    check_system()
    named = wanted.folder or wanted.path.parent
    *between, name = wanted.path.relative_to(named).parts
    folder = os.open(named, _DIRECTORY)
    try:
        for part in between:
            if make:
                with suppress(FileExistsError):
                    os.mkdir(part, dir_fd=folder)
            inner = os.open(part, _DIRECTORY | flags("O_NOFOLLOW"), dir_fd=folder)
            os.close(folder)
            folder = inner
        yield folder, name
    finally:
        os.close(folder)


def _replace(folder: int, name: str, data: bytes) -> None:
    draft = _draft(name)
    descriptor = os.open(draft, _CREATE, 0o666, dir_fd=folder)
    try:
        with open(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            with suppress(FileNotFoundError):
                before = os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode
                if stat.S_ISREG(before):
                    os.fchmod(descriptor, stat.S_IMODE(before))
            os.fsync(descriptor)
        os.replace(draft, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:  # an interrupt too: no draft is left behind
        with suppress(FileNotFoundError):
            os.unlink(draft, dir_fd=folder)
        raise


_CREATE: Final = flags("O_WRONLY", "O_CREAT", "O_EXCL", "O_NOFOLLOW", "O_CLOEXEC")
_DIRECTORY: Final = flags("O_DIRECTORY", "O_CLOEXEC")


def _draft(name: str) -> str:
    """A new name in the same directory: only there is a rename atomic."""
    return f".{name[:200]}.{os.urandom(8).hex()}.tmp"


def _reason(wanted: Target, error: OSError) -> str:
    return f"Cannot write the {wanted.format} report to {wanted.path}: {error.strerror or error}."


WIDTH: Final = 80
"""Columns of a text report that goes to no terminal: the same bytes everywhere."""

MAX_WIDTH: Final = 110
"""Columns on a wide terminal; longer lines are hard to read."""


def deliver(
    reports: Sequence[Report],
    given: Mapping[str, Any],
    *,
    several: bool,
    stdout: bool = True,
    missing: Sequence[NoReport] = (),
) -> None:
    """Write every report that was asked for, to standard output if `stdout`; none where there was nothing to report on.

    `missing`: keystores without a report, which documents about several name, so that none of them looks like a pass.

    Targets that take a report of each keystore are left to whoever audits several.
    """
    targets = [wanted for wanted in given["targets"] if not (wanted.each or wanted.tables)]
    if not reports:
        say_not_written(targets)
        return
    if stdout:
        shown = view(given, stdout=True)
        for piece in formats.pieces(given["kind"], reports, shown, several=several, missing=missing):
            write_stdout(piece)
    kept = view(given, stdout=False)
    for wanted in targets:
        write(wanted, formats.render(wanted.format, reports, kept, several=several, missing=missing))


def say_not_written(targets: Sequence[Target]) -> None:
    """Say of each file that it is not there, or is an older one."""
    for wanted in targets:
        say(f"No report was written to {wanted.path}.")


def view(given: Mapping[str, Any], *, stdout: bool) -> View:
    """Return how the options want a report shown; files look the same everywhere."""
    from keystore_audit.report.content import View

    return View(
        width=columns() if stdout else WIDTH,
        color=stdout and use_color(given["color"], terminal=is_terminal()),
        quiet=given["quiet"],
        verbose=given["verbose"],
        min_severity=Severity(given["min_severity"]),
    )


def is_terminal() -> bool:
    """Whether standard output is one."""
    return sys.stdout is not None and sys.stdout.isatty()


def columns(most: int = MAX_WIDTH) -> int:
    """How many columns standard output has, `most` of them."""
    if not is_terminal():
        return WIDTH
    from shutil import get_terminal_size

    return min(get_terminal_size((WIDTH, 24)).columns, most)
