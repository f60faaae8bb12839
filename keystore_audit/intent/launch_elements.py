"""What launch files of every form consist of: elements with attributes, and texts with substitutions in them.

Read here from XML and YAML, which have the same elements (launch's and launch_ros's `expose_action`, Humble to
Rolling), and in `launch_python` from Python. Of substitutions `$(var name default)`, `$(env name)` and `$(dirname)`
are followed; their grammar is launch's (`launch/frontend/parse_substitution.py`, `grammar.lark`).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, RMW, STRATEGY
from keystore_audit.intent.intent import ROOT, joined
from keystore_audit.intent.source import Source, Value, parse_yaml, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.xml import parse_unsigned, source_line
from keystore_audit.profiles import facts

MAX_CHARACTERS: Final = 1 << 18
"""Length of a launch file: the largest are a tenth; PyYAML without libyaml takes seconds for more."""

MAX_TEXT: Final = 4096
"""Characters of a text: names and paths are shorter, and `$(var x)$(var x)` doubles each time."""

MAX_PARTS: Final = 256
"""Pieces of one text: `x + x` doubles each time in Python."""


class Reference(Struct, frozen=True, kw_only=True):
    """The value of an argument or (`environment`) of a variable, `default` where an argument has none."""

    name: str
    default: str | None = None
    environment: bool = False


class Unknown(Struct, frozen=True):
    """A piece of text that only a running launch knows; `reason`: why, words such as "the result of a command"."""

    reason: str


Part = str | Reference | Unknown
Text = tuple[Part, ...]
"""A text in pieces, which join without anything between them."""

INSTALLED: Final = {
    **dict.fromkeys(("find-pkg-share", "FindPackageShare"), "where a package is installed"),
    **dict.fromkeys(("find-pkg-prefix", "FindPackagePrefix"), "where a package is installed"),
    **dict.fromkeys(("get_package_share_directory", "get_package_prefix"), "where a package is installed"),
    **dict.fromkeys(("find-exec", "exec-in-pkg", "FindExecutable"), "where a program is installed"),
    "anon": "a name with a part that is new each time",
}
"""Substitutions, as XML and as Python call them, that depend on where launch runs."""

COMMANDS: Final = {
    **dict.fromkeys(("command", "Command"), "the output of a command, which is not run"),
    **dict.fromkeys(("eval", "PythonExpression"), "the result of an expression, which is not evaluated"),
}
"""Substitutions that hold code, which is not read."""

OF_ROS_1: Final = "{} is of ROS 1 (roslaunch): ROS 2 does not start this file, and it is not read"
"""The message about what only ROS 1 has; its launch files have the same names and root element."""

REQUIRED: Final[Mapping[str, tuple[str, ...]]] = {
    "arg": ("name",),
    "let": ("name", "value"),
    "set_env": ("name", "value"),
    "append_env": ("name", "value"),
    "unset_env": ("name",),
    "env": ("name", "value"),
    "set_remap": ("from", "to"),
    "remap": ("from", "to"),
    "push_ros_namespace": ("namespace",),
    "push_namespace": ("namespace",),
    "include": ("file",),
    **dict.fromkeys(("node", "lifecycle_node", "node_container"), ("exec",)),
    "composable_node": ("plugin",),
    "load_composable_node": ("target",),
}
"""What an element of the kind has to have."""

_SPEAKING: Final = re.compile(
    f"ROS_SECURITY[A-Z_]*|ROS_DOMAIN_ID|RMW_IMPLEMENTATION|{facts.CONFIGURATION_VARIABLES}|enclave"
)
"""Variables of security, of the middleware and of its configuration, and the option `--enclave`."""

NAMES: Final[tuple[str, ...]] = (OVERRIDE, ENABLE, STRATEGY, KEYSTORE, DOMAIN, RMW)
"""What rcl and rmw read before they take an enclave (rcl's `security.c`, `domain_id.c`, rmw_implementation)."""

_TRUE: Final = frozenset({"true", "1"})
_FALSE: Final = frozenset({"false", "0"})

_SPECIAL: Final = re.compile(r"\\.|\$\(", re.DOTALL)
_INSIDE: Final = re.compile(r"""\\.|\$\(|[)'"]""", re.DOTALL)


class Element(Struct, frozen=True, kw_only=True):
    """An element with its attributes and the elements in it; `kind`: its name, `-` written as `_`."""

    kind: str
    line: int
    attributes: Mapping[str, Text] = {}
    children: tuple[Element, ...] = ()

    def called(self, *kinds: str) -> tuple[Element, ...]:
        """The elements in it of these kinds."""
        return tuple(child for child in self.children if child.kind in kinds)

    def words(self) -> str:
        """All that is written in it and in the elements in it, each once, as far as it is known."""
        waiting, seen = [self], dict[int, Element]()
        while waiting:
            element = waiting.pop()
            if id(element) not in seen:
                seen[id(element)] = element
                waiting += element.children
        return " ".join(written(text) for element in seen.values() for text in element.attributes.values())


def speaks_of(*texts: str) -> str:
    """The first word of security in the texts; empty where there is none."""
    found = (_SPEAKING.search(text) for text in texts)
    return next((match[0] for match in found if match), "")


def written(text: Text) -> str:
    """The text; `$` stands for what has to be computed."""
    return "".join(part if isinstance(part, str) else "$" for part in text)


def words(text: Text) -> Iterator[Text]:
    """A command line: split at blanks as a shell does, but for what substitutions give. Raises ValueError."""
    word: list[Part] = []
    for part in text:
        tokens = shlex.split(part) if isinstance(part, str) else [part]
        if word and (not tokens or (isinstance(part, str) and part[0].isspace())):
            yield tuple(word)
            word = []
        for number, token in enumerate(tokens):
            if number:
                yield tuple(word)
                word = []
            word.append(token)
        if word and isinstance(part, str) and part[-1].isspace():
            yield tuple(word)
            word = []
    if word:
        yield tuple(word)


def bounded(parts: Iterable[Part]) -> Text:
    """A text of these pieces, strings joined; an Unknown where it is too long."""
    found: list[Part] = []
    for part in parts:
        if isinstance(part, str) and found and isinstance(found[-1], str):
            found[-1] += part
        elif part != "":
            found.append(part)
        if len(found) > MAX_PARTS or (found and isinstance(found[-1], str) and len(found[-1]) > MAX_TEXT):
            return (Unknown(f"a text of more than {MAX_TEXT} characters"),)
    return tuple(found)


class Scope(Struct, kw_only=True):
    """All that is set at one point. An Unknown stands where something is set and cannot be told.

    `remaps`: names that are remapped for all nodes; `environment` may hold other variables than `NAMES`, too.
    """

    arguments: dict[str, str | Unknown]
    environment: dict[str, str | Unknown] = {}
    namespace: str | Unknown = ROOT
    remaps: tuple[str, ...] = ()

    def copy(self) -> Scope:
        """The same, to be changed apart."""
        return Scope(
            arguments=dict(self.arguments),
            environment=dict(self.environment),
            namespace=self.namespace,
            remaps=self.remaps,
        )

    def doubt(self, other: Scope, reason: Unknown) -> None:
        """Take in what may have become of this scope, `other`: what differs cannot be told any longer."""
        for mine, theirs in ((self.arguments, other.arguments), (self.environment, other.environment)):
            for name in {*mine, *theirs}:
                if mine.get(name) != theirs.get(name):
                    mine[name] = reason
        if self.namespace != other.namespace:
            self.namespace = reason
        self.remaps = other.remaps

    def known(self, text: Text) -> str | Unknown:
        """Work out the text, or say why not."""
        whole = ""
        for part in text:
            piece = self._piece(part)
            if isinstance(piece, Unknown):
                return piece
            whole += piece
            if len(whole) > MAX_TEXT:
                return Unknown(f"a text of more than {MAX_TEXT} characters")
        return whole

    def _piece(self, part: Part) -> str | Unknown:
        if isinstance(part, (str, Unknown)):
            return part
        if part.environment:
            # What the file sets is known; this machine's environment says nothing about the robot's.
            return self.environment.get(part.name, Unknown(f"the environment variable {shown(part.name)}"))
        unset = Unknown(f"the argument {shown(part.name)}, which nothing sets")
        return self.arguments.get(part.name, unset if part.default is None else part.default)

    def shows(self, text: Text) -> str:
        """The text, with `$` for what cannot be told."""
        pieces = map(self._piece, text)
        return "".join(piece if isinstance(piece, str) else "$" for piece in pieces)

    def holds(self, element: Element) -> bool | Unknown:
        """Whether the conditions of the element hold, as far as it can be told."""
        doubt: Unknown | None = None
        for word, wanted in (("if", _TRUE), ("unless", _FALSE)):
            text = self.known(element.attributes.get(word, ("true" if word == "if" else "false",)))
            told = text.strip().lower() if isinstance(text, str) else ""
            if isinstance(text, Unknown):
                doubt = doubt or text
            elif told not in _TRUE | _FALSE:
                doubt = doubt or Unknown(f"{shown(text)}, which is neither true nor false")
            elif told not in wanted:
                return False
        return True if doubt is None else doubt

    def below(self, element: Element) -> str | Unknown:
        """The namespace that the element says: below that of the scope unless it begins with `/`."""
        text = self.known(element.attributes.get("namespace", ()))
        if isinstance(text, Unknown):
            return text
        path = text.rstrip("/")
        if text.startswith("/"):
            return path or ROOT
        return self.namespace if isinstance(self.namespace, Unknown) or not path else joined(self.namespace, path)


def read_xml(source: Source) -> Element:
    """Read the elements of a launch file in XML. Raises UsageError, naming file and line."""
    reader = _Reader(source)
    try:
        root = parse_unsigned(source.text.encode())
    except Malformed as error:
        raise source.malformed(error.line, error.detail) from None
    if root.tag != "launch":
        raise source.malformed(source_line(root), f"expected <launch>, found <{shown(str(root.tag))[1:-1]}>")
    return reader.whole(reader.xml(child) for child in root.iterchildren(etree.Element))


def read_yaml(source: Source) -> Element:
    """Read the elements of a launch file in YAML. Raises UsageError, naming file and line."""
    reader = _Reader(source)
    try:
        tree = parse_yaml(source.text)
    except Malformed as error:
        raise source.malformed(error.line, error.detail) from None
    if not isinstance(tree.content, Mapping) or [*tree.content] != ["launch"]:
        raise source.malformed(tree.line, "expected a map with the one key 'launch'")
    return reader.whole(reader.yaml(tree.content["launch"]))


class _Reader:
    """Reads elements and their texts. `speaking`: substitutions that are not followed and speak of security."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._speaking: list[Element] = []
        if len(source.text) > MAX_CHARACTERS:
            form = source.path.rpartition(".")[2].upper()
            raise source.malformed(None, f"more than {MAX_CHARACTERS} characters of {form}, which are not read")

    def whole(self, elements: Iterable[Element]) -> Element:
        children = tuple(elements)
        return Element(kind="launch", line=1, children=(*self._speaking, *children))

    def xml(self, element: etree._Element) -> Element:
        """An element; the parser lets none lie deeper than 256."""
        return self._element(
            str(element.tag),
            source_line(element) or 1,
            {str(name): str(value) for name, value in element.items()},
            map(self.xml, element.iterchildren(etree.Element)),
        )

    def yaml(self, value: Value) -> Iterator[Element]:
        """The elements of a list, each a map of one key."""
        if not isinstance(value.content, tuple):
            raise self._source.malformed(value.line, "expected a list of elements such as '- node:'")
        for item in value.content:
            if not isinstance(item.content, Mapping) or len(item.content) != 1:
                raise self._source.malformed(item.line, "expected an element: a map of one key, such as 'node:'")
            ((kind, content),) = item.content.items()
            yield self._yaml_element(kind, item.line, content)

    def _yaml_element(self, kind: str, line: int, content: Value) -> Element:
        if isinstance(content.content, tuple):
            return self._element(kind, line, {}, self.yaml(content))
        entries = content.content if isinstance(content.content, Mapping) else {}
        attributes = {name: each.content for name, each in entries.items() if isinstance(each.content, str)}
        children: list[Element] = []
        for name, value in entries.items():
            if name == "children":
                children += self.yaml(value)
            else:  # what an attribute such as `remap` holds: maps, each an element of that name; other lists are none
                items = value.content if isinstance(value.content, tuple) else (value,)
                maps = (item for item in items if isinstance(item.content, Mapping))
                children += (self._yaml_element(name, item.line, item) for item in maps)
        return self._element(kind, line, attributes, children)

    def _element(self, kind: str, line: int, attributes: Mapping[str, str], children: Iterable[Element]) -> Element:
        kind = kind.replace("-", "_")
        if kind == "node" and "type" in attributes and "exec" not in attributes:
            raise self._source.malformed(line, OF_ROS_1.format("a node with 'type' and no 'exec'"))
        texts = {name: self._text(name, value, line) for name, value in attributes.items()}
        for name in REQUIRED.get(kind, ()):
            if name not in texts:
                raise self._source.malformed(line, f"expected {kind!r} to have {name!r}, found none")
        return Element(kind=kind, line=line, attributes=texts, children=tuple(children))

    def _text(self, name: str, written: str, line: int) -> Text:
        try:
            return bounded(self._parts(written, line))
        except ValueError as error:
            raise self._source.malformed(line, f"in {name!r} {error}") from None

    def _parts(self, text: str, line: int) -> Iterator[Part]:
        at = 0
        while match := _SPECIAL.search(text, at):
            yield text[at : match.start()]
            at = match.end()
            if match[0] == "$(":
                at = _end(text, match.end())
                yield self._substitution(text[match.end() : at - 1], line)
            else:
                yield match[0][1:]
        yield text[at:]

    def _substitution(self, inner: str, line: int) -> Part:
        """What stands for a substitution. Raises ValueError."""
        if not inner.strip():
            raise ValueError("a substitution '$()' without a name")
        if "$(" not in inner:
            match shlex.split(inner):
                case ["var", name, *default] if len(default) < 2:
                    return Reference(name=name, default=default[0] if default else None)
                case ["env" | "optenv", name, *default] if len(default) < 2:
                    return Reference(name=name, environment=True)
                case ["dirname"]:
                    return self._source.directory
        name = inner.split(maxsplit=1)[0]
        if name in INSTALLED:
            return Unknown(INSTALLED[name])
        if name in ("arg", "find"):
            raise self._source.malformed(line, OF_ROS_1.format(f"the substitution $({name} ...)"))
        if word := speaks_of(inner):
            self._speaking.append(Element(kind="speaks", line=line, attributes={"word": (word,)}))
        return Unknown(COMMANDS.get(name, f"a substitution of the sort {shown(name)}"))


def _end(text: str, at: int) -> int:
    """The offset behind the substitution whose inside begins at `at`. Raises ValueError."""
    quotes = [""]
    """The quote that is open in each of the substitutions within each other."""
    for match in _INSIDE.finditer(text, at):
        sign = match[0]
        if sign == "$(":
            quotes.append("")
        elif sign == ")" and not quotes[-1]:
            quotes.pop()
            if not quotes:
                return match.end()
        elif sign == quotes[-1]:
            quotes[-1] = ""
        elif sign in ("'", '"') and not quotes[-1]:
            quotes[-1] = sign
    raise ValueError("a substitution '$(' without its ')', or a quote opened and never closed")
