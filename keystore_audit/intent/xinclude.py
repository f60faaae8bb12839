"""XInclude in SROS2 policies: other files of one directory put in, and no other file ever.

libxml2's own XInclude reads whatever file or address an `href` names. Here each is looked up below one directory
(`keystore.root`: regular files, bounded, no way out by links), and of XPointer only paths of child elements are read,
which is what policies have: `xpointer(/profile/*)`. Anything else is an error, never left out.
"""

from __future__ import annotations

import copy
import os
import posixpath
import re
from collections.abc import Iterator, Sequence
from typing import Final
from urllib.parse import unquote

from lxml import etree

from keystore_audit.errors import NothingToAudit, UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.source import MAX_DETAIL, malformed, reason, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.xml import parse_unsigned, source_line
from keystore_audit.text import percent_path, shorten

MAX_INCLUDES: Final = 20_000
"""Inclusions followed for one policy: sros2's common/node.xml costs four for each node."""

MAX_NESTING: Final = 16
"""Files that include each other: sros2's policies need three."""

MAX_ELEMENTS: Final = 400_000
"""Elements put in: 20,000 nodes with the twelve of common/node.xml each; a few files can name thousands of millions."""

MAX_BYTES: Final = 64 << 20
"""Bytes of all files put in, each as often as it is: those 20,000 nodes need 16 MB."""

NAMESPACES: Final = ("http://www.w3.org/2001/XInclude", "http://www.w3.org/2003/XInclude")
"""XInclude 1.0, and its draft: sros2's own files use both, and libxml2 reads both."""

BASE: Final = "{http://www.w3.org/XML/1998/namespace}base"

_POINTER: Final = re.compile(r"xpointer\(\s*((?:/(?:[A-Za-z_][\w.-]*|\*))+)\s*\)", re.ASCII)
_SCHEME: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_ATTRIBUTES: Final = frozenset({"href", "xpointer", "parse", BASE})
_INCLUDES: Final = frozenset(f"{{{namespace}}}include" for namespace in NAMESPACES)


class Expanded:
    """A document with everything put in that it includes; `root` is its root element.

    `read`: the files that were read, the document first.
    """

    def __init__(self, root: etree._Element, files: list[str], read: Sequence[GivenFile]) -> None:
        self.root = root
        self.read = tuple(read)
        self._files = files

    def location(self, element: etree._Element) -> Location:
        """Where the element stands: in the file that it was written in."""
        holder: etree._Element | None = element
        while holder is not None:
            number = holder.get(BASE)
            if number is not None:
                return Location(path=self._files[int(number)], line=source_line(element), beside=True)
            holder = holder.getparent()
        return Location(path=self._files[0], line=source_line(element), beside=True)


def expand(path: str | os.PathLike[str], directory: str | os.PathLike[str] | None = None) -> Expanded:
    """Read the document at `path` with all that it includes from below `directory` (None: where the document is).

    Raises UsageError, naming file and line, for what cannot be read.
    """
    given = os.fspath(path)
    real = os.path.realpath(given)
    inside = os.path.realpath(os.fspath(directory)) if directory is not None else os.path.dirname(real)
    with _open(os.path.dirname(real), given) as beside:
        file = beside.file(os.path.basename(real))
    with _open(inside, os.fspath(directory) if directory is not None else given) as root:
        return _Expansion(given, real, inside, root).document(file)


def _open(directory: str, named: str) -> Root:
    try:
        return Root.open(directory)
    except NothingToAudit:
        raise UsageError(f"{percent_path(named)}: expected a directory that can be read, found none.") from None


class _Expansion:
    """One document in the making: the files read so far, and how much was put in."""

    def __init__(self, given: str, real: str, inside: str, root: Root) -> None:
        self._given = given
        self._home, self._name = os.path.split(real)
        beside = os.path.dirname(given)
        self._shown_home = beside if os.path.realpath(beside) == self._home else self._home
        self._inside = inside
        self._root = root
        self._files: list[str] = []
        self._read: list[GivenFile] = []
        self._numbers: dict[str, int] = {}
        self._documents: dict[str, tuple[etree._Element, int]] = {}
        self._includes = 0
        self._elements = 0
        self._bytes = 0

    def document(self, file: File) -> Expanded:
        """The document of that file, expanded."""
        self._numbers[self._name] = 0
        self._files.append(percent_path(self._given))
        root = self._parsed(file, Location(path=self._files[0]))
        if root.tag in _INCLUDES:
            raise malformed(Location(path=self._files[0], line=source_line(root)), "an include is no document")
        self._expand(root, ("",), 0)
        return Expanded(root, self._files, self._read)

    def _number(self, relative: str) -> int:
        """The number of a file, named relative to the document's own directory."""
        if relative not in self._numbers:
            self._numbers[relative] = len(self._files)
            self._files.append(percent_path(posixpath.join(self._shown_home, relative)))
        return self._numbers[relative]

    def _parsed(self, file: File, asked: Location) -> etree._Element:
        if file.status is not Status.PRESENT or file.content is None:
            raise malformed(asked, reason(file))
        self._read.append(GivenFile.of(asked.path, file.content))
        try:
            root = parse_unsigned(file.content)
        except Malformed as error:
            raise malformed(Location(path=asked.path, line=error.line), shorten(error.detail, MAX_DETAIL)) from None
        for element in root.iter(etree.Element):
            element.attrib.pop(BASE, "")  # ours says which file an element is from; theirs has no meaning to sros2
        return root

    def _expand(self, parent: etree._Element, within: tuple[str, ...], number: int) -> None:
        """Replace every inclusion below `parent`, which is from file `number`; `within`: the files that lead here."""
        for include in [element for element in parent.iter(etree.Element) if element.tag in _INCLUDES]:
            location = Location(path=self._files[number], line=source_line(include))
            holder = include.getparent()
            if holder is None:
                raise malformed(location, "an include is no document")
            if holder.tag in _INCLUDES:
                raise malformed(location, "an include within an include")
            found = list(self._included(include, within, location))
            at = holder.index(include)
            include.tail = None
            holder[at : at + 1] = found

    def _included(
        self, include: etree._Element, within: tuple[str, ...], location: Location
    ) -> Iterator[etree._Element]:
        href, pointer = _asked(include, location)
        self._includes += 1
        if self._includes > MAX_INCLUDES:
            raise malformed(location, f"more than {MAX_INCLUDES} inclusions, which are not followed")
        if len(within) > MAX_NESTING:
            raise malformed(location, f"inclusions more than {MAX_NESTING} deep, which are not followed")
        relative = posixpath.normpath(posixpath.join(posixpath.dirname(within[-1]), href))
        if relative in within or relative == self._name:
            raise malformed(location, f"{shown(href)} includes itself")
        root, size = self._document(relative, href, location)
        self._bytes += size
        if self._bytes > MAX_BYTES:
            raise malformed(location, f"more than {MAX_BYTES} bytes put in, which are not read")
        chosen = [root] if pointer is None else _select(root, pointer, location)
        number = self._number(relative)
        for element in chosen:
            # An inclusion is expanded where it was put, so that what holds it is there to be replaced in.
            holder = etree.Element("included")
            holder.append(self._copied(element, location))
            self._expand(holder, (*within, relative), number)
            for child in list(holder):
                if child.get(BASE) is None:
                    child.set(BASE, str(number))
                yield child

    def _copied(self, element: etree._Element, location: Location) -> etree._Element:
        self._elements += sum(1 for _ in element.iter(etree.Element))
        if self._elements > MAX_ELEMENTS:
            raise malformed(location, f"more than {MAX_ELEMENTS} elements put in, which are not read")
        copied = copy.deepcopy(element)
        copied.tail = None
        return copied

    def _document(self, relative: str, href: str, location: Location) -> tuple[etree._Element, int]:
        """The root of an included file, as it is written, and the file's size in bytes."""
        if relative not in self._documents:
            below = os.path.relpath(os.path.join(self._home, relative), self._inside)
            if below.split("/", 1)[0] == "..":
                raise malformed(location, f"{shown(href)} leads out of {percent_path(self._inside)}; it was not read")
            file = self._root.file(below)
            if file.status is not Status.PRESENT:
                raise malformed(location, f"{shown(href)} cannot be put in: {reason(file)}")
            asked = Location(path=self._files[self._number(relative)])
            self._documents[relative] = self._parsed(file, asked), len(file.content or b"")
        return self._documents[relative]


def _asked(include: etree._Element, location: Location) -> tuple[str, tuple[str, ...] | None]:
    """The relative path and the steps of the pointer that an inclusion names."""
    unknown = [str(name) for name in include.attrib if name not in _ATTRIBUTES]
    if unknown:
        raise malformed(location, f"expected href and xpointer, found {shown(unknown[0])}")
    if include.get("parse", "xml") != "xml":
        raise malformed(location, "expected XML to put in, found parse=" + shown(str(include.get("parse"))))
    if any(isinstance(child.tag, str) for child in include):
        raise malformed(location, "an xi:fallback is not read: what is included has to be there")
    href = unquote(str(include.get("href", "")))
    if not href or "\0" in href or href.startswith("/") or "#" in href or _SCHEME.match(href):
        raise malformed(location, f"expected the relative path of a file, found href {shown(href)}")
    pointer = include.get("xpointer")
    if pointer is None:
        return href, None
    match = _POINTER.fullmatch(str(pointer).strip())
    if match is None:
        expected = "expected a path of child elements such as xpointer(/profile/*)"
        raise malformed(location, f"{expected}, found {shown(str(pointer))}")
    return href, tuple(match[1].split("/")[1:])


def _select(root: etree._Element, steps: tuple[str, ...], location: Location) -> list[etree._Element]:
    """The elements on the path, in order; one of them may be an inclusion only if the path ends in `*` there."""
    chosen = [root] if steps[0] in ("*", root.tag) else []
    for number, step in enumerate(steps[1:], start=2):
        children = [child for parent in chosen for child in parent.iterchildren(etree.Element)]
        open_end = step == "*" and number == len(steps)
        if not open_end and any(child.tag in _INCLUDES for child in children):
            raise malformed(
                location, f"the pointer /{'/'.join(steps)} leads over an inclusion, which has no one meaning"
            )
        chosen = [child for child in children if step in ("*", child.tag)]
    if not chosen:
        raise malformed(location, f"the pointer /{'/'.join(steps)} matches nothing there")
    return chosen
