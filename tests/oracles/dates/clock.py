"""The vendors' plugins at any time and in any zone: which grants do they take for being in force?"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from pathlib import Path

from tests.conftest import lacking
from tests.keystore.documents import PERMISSIONS
from tests.oracles.xml.ours import DocumentKind
from tests.oracles.xml.parsers import compiled
from tests.oracles.xml.plugins import Plugin

_SOURCE = Path(__file__).parent / "set_clock.c"

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)

_CERTIFICATES = {
    "start": datetime(1950, 1, 1, tzinfo=timezone.utc),
    "end": datetime(9999, 12, 31, tzinfo=timezone.utc),
}
"""Good whatever the clock shows: X.509's first and last year."""

_VALIDITY = b"<not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T00:00:00</not_after>"

MALFORMED = ("Malformed permissions file", "without Validity", "crash")
"""Words of a refusal that is not about when."""


def seconds(instant: datetime) -> int:
    """Since 1970, rounded down."""
    return (instant - EPOCH) // timedelta(seconds=1)


def permissions(not_before: str, not_after: str) -> bytes:
    """Those of /talker, with other dates."""
    assert _VALIDITY in PERMISSIONS
    return PERMISSIONS.replace(
        _VALIDITY, f"<not_before>{not_before}</not_before><not_after>{not_after}</not_after>".encode()
    )


class ClockedPlugin:
    """A vendor's plugin in a process whose clock the tests set, unless `clock` is None."""

    def __init__(self, plugin: Plugin, clock: Path | None) -> None:
        self.plugin = plugin
        self._clock = clock
        self._sign = lru_cache(maxsize=64)(plugin.sign)

    def refusal(self, not_before: str, not_after: str, at: int) -> str | None:
        """Why the enclave does not start `at` (seconds since 1970) with these dates; None: it starts."""
        if self._clock is not None:
            _set(self._clock, at)
        message = self._sign(permissions(not_before, not_after))
        return self.plugin.ask(message, DocumentKind.PERMISSIONS).refused


def _set(clock: Path, at: int) -> None:
    """In place: processes have the file mapped."""
    with clock.open("r+b") as file:
        file.write(at.to_bytes(8, sys.byteorder, signed=True))


def _preload(compiler: str, directory: Path) -> Path:
    library = directory / "set_clock.so"
    command = [compiler, "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", str(library), str(_SOURCE)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lacking(f"what compiles {_SOURCE.name}: {done.stderr[:400]}")
    return library


@contextmanager
def clocked(
    find: Callable[[str], str], directory: Path, asked: Sequence[tuple[str, str]], *, settable: bool = True
) -> Iterator[dict[tuple[str, str], ClockedPlugin]]:
    """By vendor and zone; without compiler, header or library the test skips, in CI it fails.

    Not `settable`: the machine's own clock.
    """
    library = _preload(find("cc"), directory)
    programs = {
        "cyclone": compiled(find("cc"), "cyclone_access_control.c", directory, "-lddsc", "-ldl"),
        "fastdds": compiled(find("c++"), "fastdds_access_control.cpp", directory, "-lfastrtps", "-lfastcdr"),
    }
    with ExitStack() as stack:
        plugins = {}
        for number, (vendor, zone) in enumerate(asked):
            files = directory / str(number)
            files.mkdir()
            clock = files / "clock"
            clock.write_bytes(bytes(8))
            preload = {"LD_PRELOAD": str(library), "SET_CLOCK": str(clock)} if settable else {}
            command = (programs[vendor], files)[: 2 if vendor == "fastdds" else 1]
            plugin = Plugin(*command, environment={"TZ": zone} | preload, **_CERTIFICATES)
            stack.callback(plugin.close)
            plugins[vendor, zone] = ClockedPlugin(plugin, clock if settable else None)
        yield plugins
