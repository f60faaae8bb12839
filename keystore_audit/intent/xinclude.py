"""XInclude in SROS2 policies: other files of one directory put in, and no other file ever.

libxml2's own XInclude reads whatever file or address an `href` names. Here each is looked up below one directory
(`keystore.root`: regular files, bounded, no way out by links), and what is read is what sros2's policies have: an
`href` and an XPointer that is a path of child elements, `xpointer(/profile/*)`. Anything else is an error.
"""

from __future__ import annotations

import copy
import os
import posixpath
import re
from collections.abc import Sequence
from typing import Final

from lxml import etree

from keystore_audit.errors import NothingToAudit, UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.source import MAX_DETAIL, malformed, reason, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.files import File
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.xml import parse_unsigned, source_line
from keystore_audit.text import percent_path, shorten

MAX_NESTING: Final = 16
"""Files that include each other: sros2's policies need three."""

MAX_ELEMENTS: Final = 400_000
"""Elements put in: 20,000 nodes with the twelve of common/node.xml each; a few files can name thousands of millions."""

MAX_BYTES: Final = 64 << 20
"""Bytes of all files put in, each as often as it is: those 20,000 nodes need 16 MB."""

BASE: Final = "{http://www.w3.org/XML/1998/namespace}base"

_INCLUDES: Final = ("{http://www.w3.org/2001/XInclude}include", "{http://www.w3.org/2003/XInclude}include")
"""XInclude 1.0, and its draft: sros2's own files use both, and libxml2 reads both."""

_HREF: Final = re.compile(r"[\w.-][\w./-]*", re.ASCII)
_POINTER: Final = re.compile(r"\s*xpointer\(\s*((?:/(?:[A-Za-z_][\w.-]*|\*))+)\s*\)\s*", re.ASCII)


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
        holders = (holder.get(BASE) for holder in (element, *element.iterancestors()))
        number = next((number for number in holders if number is not None), "0")
        return Location(path=self._files[int(number)], line=source_line(element), beside=True)


def expand(path: str | os.PathLike[str], directory: str | os.PathLike[str] | None = None) -> Expanded:
    """Read the document at `path` with all that it includes from below `directory` (None: where the document is).

    Raises UsageError, naming file and line, for what cannot be read.
    """
    given = os.fspath(path)
    real = os.path.realpath(given)
    home, name = os.path.split(real)
    inside = home if directory is None else os.path.realpath(os.fspath(directory))
    with _open(home, given) as beside, _open(inside, given if directory is None else os.fspath(directory)) as root:
        expansion = _Expansion(given, home, inside, root)
        document = expansion.document(beside.file(name), name, percent_path(given), ())
        return Expanded(document, expansion.files, expansion.read)


def _open(directory: str, named: str) -> Root:
    try:
        return Root.open(directory)
    except NothingToAudit:
        raise UsageError(f"{percent_path(named)}: expected a directory that can be read, found none.") from None


class _Expansion:
    """One document in the making: the `files` so far, as messages name them, and how much was put in."""

    def __init__(self, given: str, home: str, inside: str, root: Root) -> None:
        beside = os.path.dirname(given)
        self.files: list[str] = []
        self.read: list[GivenFile] = []
        self._shown_home = beside if os.path.realpath(beside) == home else home
        self._home = home
        self._inside = inside
        self._root = root
        self._documents: dict[str, etree._Element] = {}
        self._sizes: dict[str, int] = {}
        self._elements = 0
        self._bytes = 0

    def document(self, file: File, relative: str, named: str, within: tuple[str, ...]) -> etree._Element:
        """The root of a file with everything put in; `within`: the files that lead here, by their relative paths."""
        if file.content is None:
            raise malformed(Location(path=named), reason(file))
        number = str(len(self.files))
        self.files.append(named)
        self.read.append(GivenFile.of(named, file.content))
        before = self._bytes
        try:
            root = parse_unsigned(file.content)
        except Malformed as error:
            raise malformed(Location(path=named, line=error.line), shorten(error.detail, MAX_DETAIL)) from None
        if root.tag in _INCLUDES:
            raise malformed(Location(path=named, line=source_line(root)), "an include is no document")
        for element in root.iter(etree.Element):
            element.attrib.pop(BASE, "")  # ours says which file an element is from; theirs has no meaning to sros2
        for include in [*root.iter(*_INCLUDES)]:
            holder = include.getparent()
            location = Location(path=named, line=source_line(include))
            if holder is not None:
                at = holder.index(include)
                include.tail = None
                holder[at : at + 1] = self._included(include, (*within, relative), location)
        self._sizes[relative] = len(file.content) + self._bytes - before
        root.set(BASE, number)
        return root

    def _included(self, include: etree._Element, within: tuple[str, ...], location: Location) -> list[etree._Element]:
        href, steps = _asked(include, location)
        relative = posixpath.normpath(posixpath.join(posixpath.dirname(within[-1]), href))
        if relative in within or len(within) > MAX_NESTING:
            raise malformed(
                location,
                f"{shown(href)} includes itself, or files more than {MAX_NESTING} deep, which are not followed",
            )
        if relative not in self._documents:
            below = os.path.relpath(os.path.join(self._home, relative), self._inside)
            if below.split("/", 1)[0] == "..":
                raise malformed(location, f"{shown(href)} leads out of {percent_path(self._inside)}; it was not read")
            file = self._root.file(below)
            if file.content is None:
                raise malformed(location, f"{shown(href)} cannot be put in: {reason(file)}")
            named = percent_path(posixpath.join(self._shown_home, relative))
            self._documents[relative] = self.document(file, relative, named, within)
        chosen = _select(self._documents[relative], steps, location)
        self._elements += sum(1 for each in chosen for _element in each.iter(etree.Element))
        self._bytes += self._sizes[relative]
        if self._elements > MAX_ELEMENTS or self._bytes > MAX_BYTES:
            limits = f"more than {MAX_ELEMENTS} elements or {MAX_BYTES} bytes put in, which are not followed"
            raise malformed(location, limits)
        number = str(self._documents[relative].get(BASE))
        found = []
        for element in chosen:
            copied = copy.deepcopy(element)
            copied.tail = None
            copied.set(BASE, copied.get(BASE, number))
            found.append(copied)
        return found


def _asked(include: etree._Element, location: Location) -> tuple[str, tuple[str, ...] | None]:
    """The relative path and the steps of the pointer that an inclusion names."""
    href, pointer = str(include.get("href", "")), include.get("xpointer")
    if {*map(str, include.attrib)} - {"href", "xpointer"} or len(include):
        raise malformed(location, "expected an include of href and xpointer alone, without fallback")
    if _HREF.fullmatch(href) is None:
        raise malformed(location, f"expected the relative path of a file, found href {shown(href)}")
    match = _POINTER.fullmatch(str(pointer))
    if pointer is not None and match is None:
        expected = "expected a path of child elements such as xpointer(/profile/*)"
        raise malformed(location, f"{expected}, found {shown(str(pointer))}")
    return href, tuple(match[1].split("/")[1:]) if match is not None else None


def _select(root: etree._Element, steps: tuple[str, ...] | None, location: Location) -> list[etree._Element]:
    """The elements on the path, in order; one of them may have been put in only if the path ends in `*` there."""
    first, *more = steps or ("*",)
    chosen = [root] if first in ("*", root.tag) else []
    path = f"the pointer /{'/'.join((first, *more))}"
    for number, step in enumerate(more, start=1):
        children = [child for parent in chosen for child in parent.iterchildren(etree.Element)]
        open_end = step == "*" and number == len(more)
        if not open_end and any(child.get(BASE) is not None for child in children):
            raise malformed(location, f"{path} leads over an inclusion, which has no one meaning")
        chosen = [child for child in children if step in ("*", child.tag)]
    if not chosen:
        raise malformed(location, f"{path} matches nothing there")
    return chosen
