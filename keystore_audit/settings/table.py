"""A file of settings in TOML, and its tables: every value is taken with what it is expected to be.

Whatever is wrong is an errors.UsageError with file, line and column, and says what was expected.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from datetime import date, datetime, time, timezone
from pathlib import Path
from typing import Any, Final, NoReturn

from keystore_audit import toml
from keystore_audit.errors import UsageError
from keystore_audit.findings import Location, Severity
from keystore_audit.given import GivenFile, check_beside, read_given
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.formal.claim import Attacker
from keystore_audit.settings.positions import Path as KeyPath
from keystore_audit.settings.positions import Position, positions
from keystore_audit.text import meant

_WHERE: Final = re.compile(r" \(at line (\d+), column (\d+)\)$")
OUTSIDER: Final = "outsider"

WORD: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
"""The name of a property or label."""


def read_table(path: Path, keystores: Iterable[str | Path], max_bytes: int) -> File:
    """The file at `path`.

    Raises errors.UsageError, with line and column, for what is no TOML; and for one that lies in one of the
    `keystores`, which could then absolve itself.
    """
    check_beside(path, keystores)
    return File(*read_given(path, max_bytes, "a settings file"))


class File:
    """The file, and how to say where something in it is wrong."""

    def __init__(self, given: GivenFile, text: str) -> None:
        self.path = given.path
        self.given = given
        text = text.replace("\r\n", "\n")
        try:
            self.values: Mapping[str, Any] = toml.loads(text)
            self._positions = positions(text)
        except (ValueError, RecursionError) as error:  # ValueError: integers of thousands of digits too
            message = str(error) or "too deeply nested"
            where = _WHERE.search(message)
            last = f":{text.count(chr(10)) + 1}:{len(text) - text.rfind(chr(10))}"
            place = f":{where[1]}:{where[2]}" if where else last
            what = "more than is read here" if isinstance(error, toml.BeyondLimits) else "this is not TOML"
            raise UsageError(f"{given.path}{place}: {what}: {_WHERE.sub('', message)}.") from error

    def position(self, path: KeyPath) -> Position:
        """Line and column of the key or item; where it has none of its own, those of what it stands in."""
        while path not in self._positions and path:
            path = path[:-1]
        return self._positions.get(path, Position(1, 1))

    def place(self, path: KeyPath) -> str:
        """`FILE:LINE:COLUMN`."""
        position = self.position(path)
        return f"{self.path}:{position.line}:{position.column}"

    def location(self, path: KeyPath) -> Location:
        """The same as a finding has it."""
        return Location(path=self.path, line=self.position(path).line, beside=True)

    @property
    def root(self) -> Table:
        """The whole file as a table."""
        return Table(self, (), self.values)


class Table:
    """A table of the file; every value is taken with what it is expected to be."""

    def __init__(self, file: File, path: KeyPath, values: Mapping[str, Any]) -> None:
        self.file = file
        self._path = path
        self.values = values
        self._marks: dict[str, str] = {}

    def wrong(self, key: str | None, message: str) -> NoReturn:
        """Raise UsageError for the key, None: for the table."""
        raise UsageError(f"{self.place(key)}: {message}.")

    def place(self, key: str | None = None) -> str:
        """`FILE:LINE:COLUMN` of the key, None: of the table."""
        return self.file.place(self._path if key is None else (*self._path, key))

    @property
    def marks(self) -> tuple[tuple[str, str], ...]:
        """Each glob on enclaves or DDS topics, or "outsider", that was taken from here or below, with its place."""
        return tuple(self._marks.items())

    @property
    def location(self) -> Location:
        """Where the table begins."""
        return self.file.location(self._path)

    def only(self, *known: str) -> None:
        """Refuse other keys: a misspelt one would be without effect."""
        for key in self.values:
            if key not in known:
                hint = meant(key, known, "; did you mean {!r}")
                self.wrong(key, f"unknown key {key!r}; expected {', '.join(known)}{hint}")

    def table(self, key: str) -> Table:
        """A table in this one, whose key is there."""
        if not isinstance(self.values[key], dict):
            self.wrong(key, f"expected a table, e.g. {key} = {{ ... }}")
        inner = Table(self.file, (*self._path, key), self.values[key])
        inner._marks = self._marks
        return inner

    def tables(self, key: str) -> Iterator[Table]:
        """The tables of an array of tables; none where the key is absent."""
        entries = self.values.get(key, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            self.wrong(key, f"expected tables, each headed [[{key}]]")
        for number, entry in enumerate(entries):
            yield Table(self.file, (*self._path, key, number), entry)

    def text(self, key: str) -> str:
        """A string that is not empty."""
        value = self.values.get(key)
        if not isinstance(value, str) or not value:
            self.wrong(key if key in self.values else None, f'expected {key} = "...", a string that is not empty')
        return value

    def described(self, otherwise: str) -> str:
        """What the `description` says, as a sentence with its full stop: more follows it in a message."""
        if "description" not in self.values:
            return otherwise
        said = self.text("description").rstrip()
        return said if said.endswith((".", "!", "?")) else f"{said}."

    def texts(self, key: str) -> tuple[str, ...]:
        """One string, or several in an array."""
        value = self.values.get(key)
        several = value if isinstance(value, list) else [value]
        if not several or not all(isinstance(one, str) and one for one in several):
            self.wrong(key if key in self.values else None, f'expected {key} = "...", or an array of such strings')
        return tuple(several)

    def choice(self, key: str, words: tuple[str, ...]) -> str:
        """One of the words; the first where the key is absent."""
        value = self.values.get(key, words[0])
        if value not in words:
            self.wrong(key, f"expected {' or '.join(repr(word) for word in words)}")
        return str(value)

    def severity(self) -> Severity:
        """That of a property; high where none is named."""
        return Severity(self.choice("severity", ("high", "critical", "medium", "low", "info")))

    def attacker(self) -> Attacker:
        """That of a flow; relays where none is named."""
        return Attacker(self.choice("attacker", ("relays", "source", "honest")))

    def flag(self, key: str) -> bool:
        """True or false; false where the key is absent."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self.wrong(key, "expected true or false")
        return value

    def number(self, key: str, default: int, least: int, most: int) -> int:
        """An integer from `least` to `most`."""
        value = self.values.get(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            self.wrong(key, f"expected {key} = a number from {least} to {most}")
        return value

    def day(self, key: str) -> date:
        """A date."""
        value = self.values.get(key)
        if not isinstance(value, date) or isinstance(value, datetime):
            named = key if key in self.values else None
            self.wrong(named, f"expected {key} = a date without quotes, e.g. 2027-01-31")
        return value

    def instant(self, key: str) -> datetime | None:
        """A date (its last second) or an instant; without a zone UTC."""
        value = self.values.get(key)
        if value is None:
            return None
        if isinstance(value, datetime):
            zoned = value if value.tzinfo is not None else value.replace(tzinfo=timezone.utc)
            try:
                return zoned.astimezone(timezone.utc).replace(microsecond=0)
            except OverflowError:
                self.wrong(key, "this instant has no UTC date")
        if not isinstance(value, date):
            self.wrong(key, "expected a date without quotes, e.g. 2027-01-31")
        return datetime.combine(value, time(23, 59, 59), timezone.utc)

    def enclaves(self, key: str) -> tuple[str, ...]:
        """Globs on enclave paths."""
        globs = self.texts(key)
        for glob in globs:
            if not glob.startswith("/"):
                self.wrong(key, f'{glob!r} is no enclave\'s path: it begins with /, e.g. "/arm/*"')
        return self._marked(key, globs)

    def topics(self, key: str) -> tuple[str, ...]:
        """Globs on ROS topics, or with dds: on DDS topics, as globs on DDS topics."""
        return self._marked(key, tuple(self._topic(key, glob) for glob in self.texts(key)))

    def _topic(self, key: str, glob: str) -> str:
        try:
            return dds_topic(glob)
        except ValueError as error:
            self.wrong(key, str(error))

    def place_of(self, key: str) -> Globs:
        """Where a flow begins or ends."""
        try:
            found = globs(self.texts(key))
        except ValueError as error:
            self.wrong(key, str(error))
        self._marked(key, found.enclaves or found.topics or (OUTSIDER,))
        return found

    def _marked(self, key: str, globs: tuple[str, ...]) -> tuple[str, ...]:
        """The globs, of which it is noted where each stands: whether they name anything is only known later."""
        for number, glob in enumerate(globs):
            self._marks.setdefault(glob, self.file.place((*self._path, key, number)))
        return globs


def dds_topic(glob: str) -> str:
    """A glob on DDS topics. Raises ValueError."""
    if glob.startswith("dds:") and len(glob) > len("dds:"):
        return glob[len("dds:") :]
    if not glob.startswith("/"):
        raise ValueError(f'{glob!r} is no topic: expected "/cmd_vel", or "dds:rt/cmd_vel" for a DDS topic')
    return f"rt{glob}"


def globs(words: tuple[str, ...]) -> Globs:
    """Enclaves, or topics, or the outsider. Raises ValueError for anything else."""
    if words == (OUTSIDER,):
        return Globs(outsider=True)
    topics = [word for word in words if word.startswith(("topic:", "dds:"))]
    if topics and len(topics) == len(words):
        return Globs(topics=tuple(dds_topic(word.removeprefix("topic:")) for word in words))
    bare = [word for word in words if word not in topics and not word.startswith("/")]
    if topics or bare:
        enclave, topic = (bare[0], bare[0]) if bare and bare[0] != OUTSIDER else ("arm/*", "cmd_vel")
        raise ValueError(
            f'{", ".join(map(repr, words))}: expected enclaves ("/{enclave}"), or topics ("topic:/{topic}", '
            f'"dds:rt/{topic}"), or "outsider", and one sort alone'
        )
    return Globs(enclaves=words)
