"""SROS2 policies, 0.2.0 (Foxy and later) and 0.1.0 (Crystal to Eloquent): what each enclave's nodes are to do.

The form is that of the ROS 2 design article "SROS2 access control policies". sros2's permissions.xsl says what names
mean.

What they include is put in here, since libxml2's own XInclude reads whatever file or address an `href` names. Each file
is looked up below one directory (`keystore.root`: regular files, bounded, no way out by links). Read is only what
sros2's policies have: an `href`, and an XPointer that is a path of child elements, `xpointer(/profile/*)`. Anything
else is an error.
"""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from lxml import etree
from msgspec import Struct

from keystore_audit.errors import NothingToAudit, UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.intent import Action, IntendedNode, IntendedRight, Intent, Origin
from keystore_audit.intent.source import MAX_DETAIL, Directory, Source, Unreadable, malformed, read_source, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.grammar import elements, joined
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.xml import parse_unsigned, source_line
from keystore_audit.resources import schemas
from keystore_audit.text import percent_path, shorten

OLD: Final = "0.1.0"
CURRENT: Final = "0.2.0"

MAX_NAME: Final = 1024
"""Characters of a name or path: rmw takes 247 in a name."""

_FORMS: Final = {OLD: "profiles", CURRENT: "enclaves"}
"""The one element that a policy of the version holds."""

_PRINTABLE: Final = re.compile(r"[!-~]+")


class Profiles(Struct, frozen=True, kw_only=True):
    """A `<profiles>` of an enclave (0.1.0: a `<profile>`), of which sros2 makes one grant.

    `lost`: why no implementation asks that grant, a sentence ("" if it counts). Of several grants with one subject the
    first in force decides. Of several `<enclave>` elements with one path sros2 translates the first.
    """

    enclave: str
    location: Location
    nodes: tuple[IntendedNode, ...]
    rights: tuple[IntendedRight, ...]
    lost: str


class Policy(Struct, frozen=True, kw_only=True):
    """A policy with all that it includes, in order. `path`: as the user gave it."""

    path: str
    version: str
    files: tuple[GivenFile, ...]
    profiles: tuple[Profiles, ...]

    @property
    def intent(self) -> Intent:
        """What its author means: everything it says, what is lost on the way included."""
        enclaves: dict[str, Location] = {}
        for profiles in self.profiles:
            enclaves.setdefault(profiles.enclave, profiles.location)
        return Intent(
            origin=Origin.POLICY,
            path=self.path,
            files=self.files,
            enclaves=tuple(enclaves.items()),
            nodes=tuple(node for profiles in self.profiles for node in profiles.nodes),
            rights=tuple(right for profiles in self.profiles for right in profiles.rights),
        )


def read_policy(path: str | os.PathLike[str], include: str | os.PathLike[str] | None = None) -> Policy:
    """Read the policy at `path`; what it includes has to be below the directory `include` (None: its own).

    Raises UsageError, naming file and line, for a policy that is none or cannot be read.
    """
    if os.fspath(path).endswith((".yaml", ".yml")):
        gone = "policies in YAML, which Ardent and Bouncy had, are not supported"
        raise UsageError(
            f"{percent_path(os.fspath(path))}: expected an SROS2 policy in XML (Crystal and later): {gone}."
        )
    expanded = expand(path, include)
    root = expanded.root
    _validate(expanded)
    version = str(root.get("version"))
    form = elements(root)[0]
    if form.tag != _FORMS[version]:
        expected = f"expected <{_FORMS[version]}> in a policy of version {version}, found <{form.tag!s}>"
        raise malformed(expanded.location(form), expected)
    found = _Reader(expanded, version).profiles(form)
    return Policy(path=os.fspath(path), version=version, files=expanded.read, profiles=tuple(found))


class _Reader:
    """Reads a valid policy."""

    def __init__(self, expanded: Expanded, version: str) -> None:
        self._expanded = expanded
        self._version = version
        self._seen: dict[str, Location] = {}

    def profiles(self, form: etree._Element) -> Iterator[Profiles]:
        """What becomes a grant each, in order."""
        for element in elements(form):
            if self._version == OLD:
                yield self._grant(_qualified(self._namespace(element), self._name(element, "node")), element, [element])
                continue
            path = self._name(element, "path")
            if not path.startswith("/"):
                raise self._malformed(
                    element, f"expected the path of an enclave such as '/talker', found {shown(path)}"
                )
            again = self._seen.get(path)
            for profiles in elements(element):
                nodes = [child for child in elements(profiles) if child.tag == "profile"]
                yield self._grant(path, profiles, nodes, again)

    def _grant(
        self, enclave: str, element: etree._Element, nodes: list[etree._Element], again: Location | None = None
    ) -> Profiles:
        location = self._expanded.location(element)
        first = self._seen.setdefault(enclave, location)
        lost = ""
        if again is not None:
            lost = f"of several <enclave> elements with one path the first is translated (line {again.line})"
        elif first is not location:
            lost = f"of several grants for one enclave the first decides (line {first.line})"
        return Profiles(
            enclave=enclave,
            location=location,
            nodes=tuple(self._node(enclave, node) for node in nodes),
            rights=tuple(right for node in nodes for right in self._rights(enclave, node)),
            lost=lost,
        )

    def _node(self, enclave: str, profile: etree._Element) -> IntendedNode:
        name = _qualified(self._namespace(profile), self._name(profile, "node"))
        return IntendedNode(enclave=enclave, name=name, location=self._expanded.location(profile))

    def _rights(self, enclave: str, profile: etree._Element) -> Iterator[IntendedRight]:
        namespace, node = self._namespace(profile), self._name(profile, "node")
        for group in elements(profile):
            # Version 0.1.0 has no other attributes either; xml:base is not among the actions.
            actions = [(action, str(group.get(action.value))) for action in Action if group.get(action.value)]
            for entry in elements(group):
                location = self._expanded.location(entry)
                name = self._expanded_name(entry, namespace, node)
                for action, qualifier in actions:
                    yield IntendedRight(
                        enclave=enclave,
                        node=_qualified(namespace, node),
                        action=action,
                        name=name,
                        allow=qualifier == "ALLOW",
                        location=location,
                    )

    def _expanded_name(self, entry: etree._Element, namespace: str, node: str) -> str:
        """The name as permissions.xsl has it: `/x` as it is, `~x` behind the node's name, else below the namespace.

        0.2.0 puts what follows the `~` straight behind the name. Crystal and Dashing put a `/` between: their `~x` is
        the later `~/x`. Of `~/x` Dashing made `//`; it is read as Eloquent does.
        """
        text = joined(entry)
        if not _is_plain(text):
            raise self._malformed(entry, f"expected a name without blanks in ASCII, found {shown(text)}")
        if text.startswith("/"):
            return text
        if text.startswith("~"):
            between = "/" if self._version == OLD and text[1:2] not in ("", "/") else ""
            return _qualified(namespace, node) + between + text[1:]
        return _qualified(namespace, text)

    def _namespace(self, profile: etree._Element) -> str:
        namespace = str(profile.get("ns", ""))
        if namespace and (not namespace.startswith("/") or _PRINTABLE.fullmatch(namespace) is None):
            raise self._malformed(profile, f"expected an absolute namespace, found ns {shown(namespace)}")
        return namespace

    def _name(self, element: etree._Element, attribute: str) -> str:
        text = str(element.get(attribute, ""))
        if not _is_plain(text):
            raise self._malformed(element, f"expected a {attribute} without blanks in ASCII, found {shown(text)}")
        return text

    def _malformed(self, element: etree._Element, detail: str) -> UsageError:
        return malformed(self._expanded.location(element), detail)


def _is_plain(name: str) -> bool:
    return len(name) <= MAX_NAME and _PRINTABLE.fullmatch(name) is not None


def _qualified(namespace: str, name: str) -> str:
    return f"{namespace}{name}" if namespace.endswith("/") else f"{namespace}/{name}"


def _validate(expanded: Expanded) -> None:
    """Raises UsageError for the first place where the policy is not what the schema has."""
    schema = _schema()
    if schema.validate(expanded.root):
        return
    log: Any = schema.error_log  # the stubs do not know what is in it
    for entry in log:
        detail = shorten(str(entry.message).rstrip("."), MAX_DETAIL)
        raise malformed(expanded.location(_at(expanded.root, entry.path)), f"this is no SROS2 policy: {detail}")
    raise malformed(expanded.location(expanded.root), "this is no SROS2 policy")


def _at(root: etree._Element, path: str | None) -> etree._Element:
    """The element at a path as libxml2 tells it; the root where the path has prefixes, which are declared elsewhere."""
    try:
        found: Any = root.getroottree().xpath(path) if path else None
    except etree.XPathError:
        found = None
    return found[0] if isinstance(found, list) and found and etree.iselement(found[0]) else root


@lru_cache(maxsize=1)
def _schema() -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(str(schemas() / "policy.xsd")))


# XInclude: other files of one directory put in, and no other file ever


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

    def __init__(self, root: etree._Element, sources: Sequence[Source]) -> None:
        self.root = root
        self.read = tuple(source.file for source in sources)

    def location(self, element: etree._Element) -> Location:
        """Where the element stands: in the file that it was written in."""
        holders = (holder.get(BASE) for holder in (element, *element.iterancestors()))
        number = next((number for number in holders if number is not None), "0")
        return Location(self.read[int(number)].path, source_line(element), beside=True)


def expand(path: str | os.PathLike[str], directory: str | os.PathLike[str] | None = None) -> Expanded:
    """Read the document at `path` with all that it includes from below `directory` (None: where the document is).

    Raises UsageError, naming file and line, for what cannot be read.
    """
    source = read_source(Path(path))
    named = os.path.dirname(path) if directory is None else os.fspath(directory)
    real = source.directory if directory is None else os.path.realpath(directory)
    try:
        root = Root.open(real)
    except NothingToAudit:
        raise UsageError(f"{percent_path(named)}: expected a directory that can be read, found none.") from None
    with root:
        expansion = _Expansion(Directory(named, real, root))
        return Expanded(expansion.document(source, ()), expansion.sources)


class _Expansion:
    """One document in the making: the files so far, and how much was put in."""

    def __init__(self, directory: Directory) -> None:
        self.sources: list[Source] = []
        self._directory = directory
        self._documents: dict[str, tuple[etree._Element, int]] = {}
        self._elements = 0
        self._bytes = 0

    def document(self, source: Source, within: tuple[str, ...]) -> etree._Element:
        """The root of a file with everything put in; `within`: the files that lead here."""
        number, before = str(len(self.sources)), self._bytes
        self.sources.append(source)
        try:
            root = parse_unsigned(source.text.encode())
        except Malformed as error:
            raise source.malformed(error.line, shorten(error.detail, MAX_DETAIL)) from None
        if root.tag in _INCLUDES:
            raise source.malformed(source_line(root), "an include is no document")
        for element in root.iter(etree.Element):
            element.attrib.pop(BASE, "")  # ours says which file an element is from; theirs has no meaning to sros2
        for include in [*root.iter(*_INCLUDES)]:
            holder = include.getparent()
            if holder is not None:
                at = holder.index(include)
                include.tail = None
                holder[at : at + 1] = self._included(include, source, (*within, source.real))
        root.set(BASE, number)
        self._documents[source.real] = root, len(source.text) + self._bytes - before
        return root

    def _included(self, include: etree._Element, source: Source, within: tuple[str, ...]) -> list[etree._Element]:
        location = source.location(source_line(include))
        href, steps = _asked(include, location)
        try:
            included = self._directory.included(os.path.join(source.directory, href))
        except Unreadable as error:
            raise malformed(location, f"{shown(href)} cannot be put in: {error}") from None
        if included.real in within or len(within) > MAX_NESTING:
            limits = f"includes itself, or files more than {MAX_NESTING} deep, which are not followed"
            raise malformed(location, f"{shown(href)} {limits}")
        if included.real not in self._documents:
            self.document(included, within)
        root, size = self._documents[included.real]
        found = [copy.deepcopy(element) for element in _select(root, steps, location)]
        self._elements += sum(1 for each in found for _element in each.iter(etree.Element))
        self._bytes += size
        if self._elements > MAX_ELEMENTS or self._bytes > MAX_BYTES:
            limits = f"more than {MAX_ELEMENTS} elements or {MAX_BYTES} bytes put in, which are not followed"
            raise malformed(location, limits)
        for element in found:
            element.tail = None
            element.set(BASE, element.get(BASE, str(root.get(BASE))))
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
