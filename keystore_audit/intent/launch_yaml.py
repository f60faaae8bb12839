"""Launch files in YAML: their elements, with attributes and lines.

Made of the parser's events, so that no tag ever makes an object: one document, no anchors and aliases, no tags, no
duplicate keys, and every scalar is the text that is written.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from keystore_audit.intent.launch_entities import Entity
from keystore_audit.intent.source import Source, shown

if TYPE_CHECKING:
    from yaml import Event

MAX_CHARACTERS: Final = 1 << 18
"""Length of a launch file in YAML: the largest are a tenth; PyYAML without libyaml takes seconds for more."""

MAX_DEPTH: Final = 32
"""Lists and maps within each other: each group takes three."""


class _Tree(Struct, frozen=True, kw_only=True):
    """A scalar, a list or a map (as pairs), with its line."""

    line: int
    scalar: str | None = None
    items: tuple[_Tree, ...] | None = None
    pairs: tuple[tuple[_Tree, _Tree], ...] | None = None


def read(source: Source) -> Entity:
    """Read the elements of a launch file. Raises UsageError, naming file and line."""
    if len(source.text) > MAX_CHARACTERS:
        raise source.malformed(None, f"more than {MAX_CHARACTERS} characters of YAML, which are not read")
    tree = _Reader(source).document()
    pairs = tree.pairs or ()
    if len(pairs) != 1 or pairs[0][0].scalar != "launch":
        raise source.malformed(tree.line, "expected a map with the one key 'launch'")
    return Entity(kind="launch", line=tree.line, attributes={}, children=_children(pairs[0][1], source))


def _children(tree: _Tree, source: Source) -> tuple[Entity, ...]:
    """The elements of a list, each a map of one key."""
    if tree.items is None:
        raise source.malformed(tree.line, "expected a list of elements such as '- node:'")
    found = []
    for item in tree.items:
        if item.pairs is None or len(item.pairs) != 1:
            raise source.malformed(item.line, "expected an element: a map of one key, such as 'node:'")
        key, content = item.pairs[0]
        found.append(_entity(key, content, source))
    return tuple(found)


def _entity(key: _Tree, content: _Tree, source: Source) -> Entity:
    kind = (key.scalar or "").replace("-", "_")
    if content.items is not None:
        return Entity(kind=kind, line=key.line, attributes={}, children=_children(content, source))
    attributes: dict[str, str] = {}
    children: list[Entity] = []
    for name, value in content.pairs or ():
        if value.scalar is not None:
            attributes[name.scalar or ""] = value.scalar
        elif name.scalar == "children":
            children += _children(value, source)
        else:
            children += _parts(name, value, source)
    return Entity(kind=kind, line=key.line, attributes=attributes, children=tuple(children))


def _parts(name: _Tree, value: _Tree, source: Source) -> Iterator[Entity]:
    """What an attribute such as `remap` holds: maps, each an element of that name; other lists are none."""
    for item in value.items if value.items is not None else (value,):
        if item.pairs is not None:
            yield _entity(_Tree(line=item.line, scalar=name.scalar), item, source)


class _Reader:
    def __init__(self, source: Source) -> None:
        self._source = source

    def document(self) -> _Tree:
        from yaml import YAMLError

        try:
            return self._document()
        except YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            problem = getattr(error, "problem", None) or "it has characters that YAML does not allow"
            # At the end of the text, libyaml is one line further.
            line = min(mark.line, self._source.text.rstrip("\n").count("\n")) + 1 if mark is not None else None
            raise self._source.malformed(line, f"the text is no YAML: {problem}") from None

    def _document(self) -> _Tree:
        import yaml

        events = iter(yaml.parse(self._source.text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
        tree: _Tree | None = None
        for event in events:
            if isinstance(event, yaml.NodeEvent):
                if tree is not None:
                    raise self._source.malformed(_line(event), "expected one document, found a second")
                tree = self._node(event, events, 0)
        if tree is None:
            raise self._source.malformed(None, "expected a launch file, found an empty one")
        return tree

    def _node(self, event: Event, events: Iterator[Event], depth: int) -> _Tree:
        import yaml

        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise self._source.malformed(_line(event), "an anchor or alias, which is not read")
        tag = getattr(event, "tag", None)
        if tag not in (None, "!"):
            raise self._source.malformed(_line(event), f"the tag {shown(str(tag))}, which is not read")
        if isinstance(event, yaml.ScalarEvent):
            return _Tree(line=_line(event), scalar=str(event.value))
        if depth >= MAX_DEPTH:
            raise self._source.malformed(_line(event), f"more than {MAX_DEPTH} deep, which is not read")
        if isinstance(event, yaml.SequenceStartEvent):
            return _Tree(line=_line(event), items=tuple(self._inside(events, depth + 1)))
        nodes = tuple(self._inside(events, depth + 1))
        pairs = tuple(zip(nodes[::2], nodes[1::2], strict=True))
        self._check_keys(pairs)
        return _Tree(line=_line(event), pairs=pairs)

    def _inside(self, events: Iterator[Event], depth: int) -> Iterator[_Tree]:
        import yaml

        for event in events:
            if isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
                return
            yield self._node(event, events, depth)

    def _check_keys(self, pairs: tuple[tuple[_Tree, _Tree], ...]) -> None:
        seen: set[str] = set()
        for key, _value in pairs:
            if key.scalar is None:
                raise self._source.malformed(key.line, "expected a text as a key")
            if key.scalar in seen or key.scalar == "<<":
                raise self._source.malformed(key.line, f"the key {shown(key.scalar)} a second time, or a merge")
            seen.add(key.scalar)


def _line(event: Event) -> int:
    return 1 if event.start_mark is None else event.start_mark.line + 1
