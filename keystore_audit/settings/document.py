"""A TOML file that users write, read into typed tables: whatever is wrong is said with its file and line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import date, datetime, time, timezone
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn, TypeVar

import msgspec
from msgspec import Meta

from keystore_audit import toml
from keystore_audit.errors import UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile, check_beside, read_given
from keystore_audit.model.claims.globs import Globs
from keystore_audit.text import meant

T = TypeVar("T")

Keys = tuple[str | int, ...]
"""From the root of a document to a value."""

OUTSIDER: Final = "outsider"

Text = Annotated[str, Meta(min_length=1)]
Texts = Text | Annotated[list[Text], Meta(min_length=1)]
"""One, or several in an array: `several` has them."""

Word = Annotated[
    str, Meta(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*\Z", description='letters a to z, digits and hyphens, e.g. "no-leak"')
]
"""The name of a property or label."""

Enclave = Annotated[str, Meta(pattern="^/", description='an enclave\'s path, which begins with /, e.g. "/arm/*"')]
Enclaves = Enclave | Annotated[list[Enclave], Meta(min_length=1)]

Topic = Annotated[
    str, Meta(pattern="^(/|dds:.)", description='a topic as "/cmd_vel", or "dds:rt/cmd_vel" for a DDS topic')
]
Topics = Topic | Annotated[list[Topic], Meta(min_length=1)]


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a document. Another key than those declared is an error: a misspelt one would be without effect."""


class Source:
    """A document, or the table or value in it that `keys` lead to: where it stands, and how to say that it is wrong."""

    def __init__(self, path: str, lines: Mapping[Keys, int], keys: Keys = ()) -> None:
        self._path, self._lines, self._keys = path, lines, keys

    def at(self, *keys: str | int) -> Source:
        """What the keys lead to from here."""
        return Source(self._path, self._lines, (*self._keys, *keys))

    @property
    def line(self) -> int:
        """Of its key; where that is not known, of what it stands in."""
        keys = self._keys
        while keys and keys not in self._lines:
            keys = keys[:-1]
        return self._lines.get(keys, 1)

    @property
    def place(self) -> str:
        """`FILE:LINE`."""
        return f"{self._path}:{self.line}"

    @property
    def location(self) -> Location:
        """The same as a finding has it."""
        return Location(self._path, self.line, beside=True)

    def wrong(self, message: str) -> NoReturn:
        """Raise errors.UsageError."""
        raise UsageError(f"{self.place}: {message}.")

    def marks(self, table: Table) -> tuple[tuple[str, str], ...]:
        """Each glob on enclaves or DDS topics of the table and those in it, with its place."""
        found: list[tuple[str, str]] = []
        for name, key in zip(table.__struct_fields__, table.__struct_encode_fields__, strict=True):
            value, here = getattr(table, name), self.at(key)
            if isinstance(value, Table):
                found += here.marks(value)
            for text in several(value) if isinstance(value, str | list) else ():
                topic = text.removeprefix("topic:")
                found += ((glob, here.place) for glob in (text, f"rt{topic}", text.removeprefix("dds:")))
        return tuple(found)


def read_document(path: Path, keystores: Iterable[str | Path], most: int, kind: type[T]) -> tuple[GivenFile, T, Source]:
    """The file at `path`, of `most` bytes at most, as a table of this kind.

    Raises errors.UsageError, with a line, for what is no TOML or no such table. Raises it too for a file in one of the
    `keystores`, which could then absolve itself.
    """
    check_beside(path, keystores)
    given, text = read_given(path, most, "a settings file")
    text = text.replace("\r\n", "\n")
    try:
        values = toml.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: integers of thousands of digits too
        message = str(error) or "too deeply nested"
        where = re.search(r"\(at line (\d+)", message)
        line = where[1] if where else text.count("\n") + 1
        what = "more than is read here" if isinstance(error, toml.BeyondLimits) else "this is not TOML"
        raise UsageError(f"{given.path}:{line}: {what}: {message}.") from error
    source = Source(given.path, lines_of(text))
    try:
        return given, msgspec.convert(values, kind, builtin_types=(date, datetime)), source
    except msgspec.ValidationError as error:
        message, keys = _told(str(error), kind)
        source.at(*keys).wrong(message)


_PART: Final = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*')"""
_KEY: Final = rf"{_PART}(?:[ \t]*\.[ \t]*{_PART})*"
_DEFINED: Final = re.compile(
    rf"^[ \t]*(?:(?P<header>\[\[?[ \t]*{_KEY}[ \t]*\]\]?)[ \t]*(?:#[^\n]*)?$|(?P<key>{_KEY})[ \t]*=)"
    rf"|#[^\n]*|{toml.STRING}",
    re.MULTILINE | re.DOTALL,
)
"""A header or key at the beginning of a line; what only looks like one in strings and comments is passed over."""


def lines_of(text: str) -> dict[Keys, int]:
    """The line of each table, and of each key that does not stand in an array or an inline table."""
    lines: dict[Keys, int] = {}
    counts: dict[Keys, int] = {}  # arrays of tables: how many there are so far
    table: Keys = ()
    line, counted = 1, 0
    for found in _DEFINED.finditer(text):
        header, key = found["header"], found["key"]
        if header is None and key is None:
            continue
        line, counted = line + text.count("\n", counted, found.start()), found.start()
        parts = _parts(header or f"{key} = 0")
        path: Keys = () if header else table
        for number, part in enumerate(parts, start=1):
            path = (*path, part)
            lines.setdefault(path, line)
            if header and header.startswith("[[") and number == len(parts):
                counts[path] = counts.get(path, 0) + 1
            if path in counts:
                path = (*path, counts[path] - 1)
                lines.setdefault(path, line)
        table = path if header else table
    return lines


@cache
def _parts(definition: str) -> tuple[str, ...]:
    """The parts of the key of a document that has one."""
    value: Any = toml.loads(definition)
    parts = []
    while isinstance(value, dict) and value:
        ((key, value),) = value.items()
        parts.append(key)
        value = value[0] if isinstance(value, list) else value
    return tuple(parts)


_IN_OUR_WORDS: Final = {
    "Object missing required field": "missing key",
    "`object": "`table",
    " | null": "",
    "`date`": "`date` without quotes, e.g. 2027-01-31",
}


def _told(error: str, kind: type) -> tuple[str, Keys]:
    """What msgspec says is wrong, with the words that are expected there, and the keys that lead there."""
    message, _, path = error.partition(" - at `$")
    for theirs, ours in _IN_OUR_WORDS.items():
        message = message.replace(theirs, ours)
    keys: Keys = tuple(name or int(number) for name, number in re.findall(r"\.([\w-]+)|\[(\d+)\]", path))
    schema = msgspec.json.schema(kind)
    words = _expected(schema, keys, schema["$defs"])
    expected = f"expected {', '.join(words)}"
    if "unknown field" in message:
        key = message.partition("`")[2].removesuffix("`")
        return f"unknown key {key!r}; {expected}{meant(key, words, '; did you mean {!r}')}", (*keys, key)
    if "regex" in message:
        message = expected
    elif words and ("enum" in message or "length" in message):
        message = f"{message}; {expected}"
    name = next((f"{key}: " for key in keys[::-1] if isinstance(key, str)), "")
    return f"{name}{message}", keys


def _expected(schema: dict[str, Any], keys: Keys, defined: dict[str, Any]) -> list[str]:
    """The words of a JSON Schema that may stand where the keys lead, or what has to stand there."""
    schema = defined.get(schema.get("$ref", "").rpartition("/")[2], schema)
    if "anyOf" in schema:
        return [word for each in schema["anyOf"] for word in _expected(each, keys, defined)]
    if keys:
        below = schema.get("properties", {}).get(keys[0]) or schema.get("items")
        return _expected(below, keys[1:], defined) if below else []
    return [*(schema.get("enum") or schema.get("properties") or filter(None, [schema.get("description")]))]


def several(value: str | Sequence[str] | None) -> tuple[str, ...]:
    """The strings of an array, or the one that stands for it."""
    return (value,) if isinstance(value, str) else tuple(value or ())


def instant(value: object, source: Source) -> datetime | None:
    """A date's last second, or an instant; without a zone UTC. Raises errors.UsageError for anything else."""
    if value is None:
        return None
    if isinstance(value, datetime):
        zoned = value if value.tzinfo is not None else value.replace(tzinfo=timezone.utc)
        try:
            return zoned.astimezone(timezone.utc).replace(microsecond=0)
        except OverflowError:
            source.wrong("this instant has no UTC date")
    if not isinstance(value, date):
        source.wrong("expected a date without quotes, e.g. 2027-01-31")
    return datetime.combine(value, time(23, 59, 59), timezone.utc)


def dds_topic(glob: str) -> str:
    """A glob on DDS topics. Raises ValueError."""
    if glob.startswith("dds:") and len(glob) > len("dds:"):
        return glob[len("dds:") :]
    if not glob.startswith("/"):
        raise ValueError(f'{glob!r} is no topic: expected "/cmd_vel", or "dds:rt/cmd_vel" for a DDS topic')
    return f"rt{glob}"


def dds_topics(value: str | Sequence[str]) -> tuple[str, ...]:
    """Globs on DDS topics."""
    return tuple(map(dds_topic, several(value)))


def globs(words: Sequence[str]) -> Globs:
    """Enclaves, or topics, or the outsider. Raises ValueError for anything else."""
    if (*words,) == (OUTSIDER,):
        return Globs(outsider=True)
    if all(word.startswith(("topic:", "dds:")) for word in words):
        return Globs(topics=tuple(dds_topic(word.removeprefix("topic:")) for word in words))
    if not all(word.startswith("/") for word in words):
        raise ValueError(
            f'{", ".join(map(repr, words))}: expected enclaves ("/arm/*"), or topics ("topic:/cmd_vel", '
            f'"dds:rt/cmd_vel"), or "outsider", and one sort alone'
        )
    return Globs(enclaves=tuple(words))


def place_of(value: str | Sequence[str], source: Source) -> Globs:
    """Where a flow begins or ends. Raises errors.UsageError."""
    try:
        return globs(several(value))
    except ValueError as error:
        source.wrong(str(error))


def described(description: str | None, otherwise: str) -> str:
    """What the description says, as a sentence with its full stop: more follows it in a message."""
    said = (description or otherwise).rstrip()
    return said if said.endswith((".", "!", "?")) else f"{said}."
