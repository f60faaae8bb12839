"""The files that graphs and launch files are read from: regular and bounded; included ones below one directory.

JSON and YAML in them are read so that every value knows its line; their own libraries tell only lines of mistakes. They
have one meaning: one document, no duplicate keys, no lone surrogates. JSON has no NaN, fractions and great numbers.
YAML has no anchors, aliases and tags, so that none makes an object. Every scalar is the text as written.
"""

from __future__ import annotations

import json
import os
import posixpath
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.errors import NothingToAudit, UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.root import Root
from keystore_audit.text import percent_path, shorten

MAX_QUOTED: Final = 80
"""Characters of a name from a file that a message quotes."""

MAX_DETAIL: Final = 480
"""Characters of what a parser says."""


class Source(Struct, frozen=True, kw_only=True):
    """The text of one file.

    `file`: its path as the user gave it, or below what the user gave, percent-encoded. `real`: where it is, absolute,
    links resolved.
    """

    file: GivenFile
    real: str
    text: str

    @property
    def path(self) -> str:
        """As the user gave it."""
        return self.file.path

    @property
    def directory(self) -> str:
        """The directory that it is in, absolute."""
        return os.path.dirname(self.real)

    def location(self, line: int | None) -> Location:
        """A place in it."""
        return Location(self.path, line)

    def malformed(self, line: int | None, detail: str) -> UsageError:
        """The error for something that cannot be read; `detail` becomes the rest of the sentence."""
        return malformed(self.location(line), detail)


class Unreadable(Exception):
    """An included file that is not read; the message is the reason, words to go into a sentence."""


def malformed(location: Location, detail: str) -> UsageError:
    """The error for something at the place that cannot be read; `detail` becomes the rest of the sentence."""
    return UsageError(f"{location}: {detail}.")


def shown(text: str) -> str:
    """Return `text` from a file as messages quote it: short, in quotes, on one line."""
    return repr(shorten(text, MAX_QUOTED))


def read_source(path: Path) -> Source:
    """Read the file that the user named, UTF-8, links followed.

    Raises UsageError if it is no regular file, larger than 4 MB, unreadable or not UTF-8.
    """
    given = os.fspath(path)
    named = percent_path(given)
    try:
        real = os.path.realpath(given)
        with Root.open(os.path.dirname(real)) as beside:
            file = beside.file(os.path.basename(real))
    except (NothingToAudit, ValueError):  # a NUL character in the path
        raise UsageError(f"{named}: there is no such file.") from None
    if file.status is not Status.PRESENT or file.content is None:
        raise UsageError(f"{named}: {reason(file)}.")
    return _source(named, real, file.content)


class Directory:
    """A directory below which other files may be included, most often that of a file that the user named."""

    def __init__(self, given: str, real: str, root: Root) -> None:
        """Take the open `root` of the directory `real`, links resolved, which the user named `given`."""
        self._given = given
        self._real = real
        self._root = root

    def included(self, path: str) -> Source:
        """Read the file at `path`, absolute or relative to this directory.

        Raises Unreadable if there is none below the directory, and UsageError if it is not UTF-8.
        """
        if "\0" in path:
            raise Unreadable("the path holds a NUL character")
        try:
            os.fsencode(path)
        except UnicodeEncodeError:  # as a text of Python may be
            raise Unreadable("the path holds half of a surrogate pair") from None
        below = os.path.relpath(os.path.join(self._real, path), self._real)
        if below.split(os.sep, 1)[0] == os.pardir:
            raise Unreadable(f"it is not below {percent_path(self._given or os.curdir)}, and was not read")
        file = self._root.file(below)
        if file.status is not Status.PRESENT or file.content is None:
            raise Unreadable(reason(file))
        named = percent_path(posixpath.join(self._given, below))
        return _source(named, os.path.join(self._real, below), file.content)


def reason(file: File) -> str:
    """Why there is no content, in words that do not speak of a keystore."""
    return {
        Status.MISSING: "there is no such file",
        Status.DANGLING: "it links to nothing",
        Status.LOOP: "its links lead in a circle",
        Status.OUTSIDE: "it leads out of the directory that may be read",
    }.get(file.status, file.detail or "it cannot be read")


def _source(named: str, real: str, content: bytes) -> Source:
    return Source(real=real, text=_decoded(named, content), file=GivenFile.of(named, content))


def _decoded(named: str, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{named}:{line}: expected UTF-8, found the byte 0x{content[error.start]:02x}.") from None


# JSON and YAML of which every value knows its line


MAX_DEPTH: Final = 32
"""Arrays and objects within each other: a graph has four, and each group of a launch file takes three."""

MAX_VALUES: Final = 200_000
"""Values of one text: 3,000 nodes with twenty endpoints each; 4 MB of empty arrays would be two million."""

MAX_STRING: Final = 4096
"""Characters of a string as it is written: names are shorter."""

_TOKEN: Final = re.compile(r'[\n\[\]{}]|"(?:[^"\\]|\\.)*"|[^\s\[\]{},:"]+')
_SCALAR: Final = re.compile(r'".*"|-?[0-9]{1,15}|true|false|null', re.DOTALL)

Event = tuple[int, str, str | int | bool | None]
"""A line, and what begins or ends there (`[`, `]`, `{`, `}`), or a scalar ("")."""


class Value(Struct, frozen=True, kw_only=True):
    """A value with the line it begins at; what is inside an array or object are Values again.

    `repeated`: keys of the object that stand in it again, where a language lets them.
    """

    line: int
    content: str | float | bool | tuple[Value, ...] | Mapping[str, Value] | None
    repeated: tuple[Value, ...] = ()


def parse_json(text: str) -> Value:
    """Read a whole JSON text. Raises Malformed."""
    try:
        json.loads(text, parse_int=str, parse_float=str, parse_constant=str)
    except json.JSONDecodeError as error:
        raise Malformed(error.lineno, f"this is not JSON: {error.msg}") from None
    except RecursionError:
        raise Malformed(1, f"more than {MAX_DEPTH} deep, which is not read") from None
    return _tree(_json_events(text))


def _json_events(text: str) -> Iterator[Event]:
    """The events of a valid text."""
    line = 1
    for match in _TOKEN.finditer(text):
        word = match[0]
        if word == "\n":
            line += 1
        elif word in "[]{}":
            yield line, word, None
        elif not _SCALAR.fullmatch(word) or len(word) > MAX_STRING:
            limits = f"of numbers, integers of at most 15 digits; of strings, {MAX_STRING} characters"
            raise Malformed(line, f"expected a JSON value ({limits})")
        else:
            yield line, "", json.loads(word)


def parse_yaml(text: str) -> Value:
    """Read a whole YAML text. Raises Malformed."""
    from yaml import YAMLError

    try:
        return _tree(_yaml_events(text))
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "it has characters that YAML does not allow"
        # At the end of the text, libyaml is one line further.
        line = min(mark.line, text.rstrip("\n").count("\n")) + 1 if mark is not None else 1
        raise Malformed(line, f"the text is no YAML: {problem}") from None


def _yaml_events(text: str) -> Iterator[Event]:
    import yaml

    signs = {
        yaml.SequenceStartEvent: "[",
        yaml.SequenceEndEvent: "]",
        yaml.MappingStartEvent: "{",
        yaml.MappingEndEvent: "}",
    }
    for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
        line = event.start_mark.line + 1 if event.start_mark is not None else 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise Malformed(line, "an anchor or alias, which is not read")
        tag = getattr(event, "tag", None)
        if tag not in (None, "!"):
            raise Malformed(line, f"the tag {shown(str(tag))}, which is not read")
        if isinstance(event, yaml.ScalarEvent):
            yield line, "", str(event.value)
        elif type(event) in signs:
            yield line, signs[type(event)], None


def _tree(events: Iterable[Event]) -> Value:
    """The one value that the events make. Raises Malformed."""
    begun: list[int] = []
    inside: list[list[Value]] = [[]]
    for number, (line, sign, scalar) in enumerate(events):
        if len(inside) > MAX_DEPTH + 1 or number > 2 * MAX_VALUES:
            raise Malformed(line, f"more than {MAX_DEPTH} deep or {MAX_VALUES} values, which are not read")
        if not begun and inside[0]:
            raise Malformed(line, "expected one document, found a second")
        if sign in ("[", "{"):
            begun.append(line)
            inside.append([])
            continue
        if sign:
            values = inside.pop()
            content = tuple(values) if sign == "]" else _mapping(values)
            inside[-1].append(Value(line=begun.pop(), content=content))
            continue
        if isinstance(scalar, str) and any("\ud800" <= character <= "\udfff" for character in scalar):
            raise Malformed(line, "half of a surrogate pair, which is no character")
        inside[-1].append(Value(line=line, content=scalar))
    if not inside[0]:
        raise Malformed(1, "expected a document, found an empty one")
    return inside[0][0]


def _mapping(values: list[Value]) -> Mapping[str, Value]:
    found: dict[str, Value] = {}
    for key, value in zip(values[::2], values[1::2], strict=True):
        if not isinstance(key.content, str):
            raise Malformed(key.line, "expected a text as a key")
        if key.content in found or key.content == "<<":
            raise Malformed(key.line, f"the key {shown(key.content)} a second time, or a merge")
        found[key.content] = value
    return found
