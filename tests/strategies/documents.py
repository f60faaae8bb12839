"""Governance and permissions documents as hypothesis strategies: valid ones, and such with a few changes.

The grammar is written down here once more, from the tables of DDS-Security 1.1, 9.4.1.2 and 9.4.1.3, so that what is
generated does not follow from the schemas that it tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Final

from hypothesis import strategies as st
from lxml import etree
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.document import Grammar

Draw = st.DrawFn

_SCHEMA_INSTANCE: Final = "http://www.w3.org/2001/XMLSchema-instance"


class Tree(Struct, frozen=True):
    """One element. Text stands before the children; what is valid has only one of them."""

    tag: str
    children: tuple[Tree, ...] = ()
    text: str = ""
    attributes: tuple[tuple[str, str], ...] = ()

    def element(self) -> etree._Element:
        """The element as libxml2 would have parsed it."""
        made = etree.Element(self.tag, dict(self.attributes))
        made.text = self.text or None
        made.extend([child.element() for child in self.children])
        return made

    def xml(self) -> bytes:
        """The document with this root."""
        return etree.tostring(self.element(), xml_declaration=True, encoding="UTF-8")

    @classmethod
    def of(cls, element: etree._Element) -> Tree:
        """What was parsed; blanks between elements are left out."""
        children = tuple(cls.of(child) for child in element)
        text = "" if children else element.text or ""
        attributes = tuple((str(name), str(value)) for name, value in element.attrib.items())
        return cls(str(element.tag), children, text, attributes)

    def walk(self, path: tuple[int, ...] = ()) -> Iterator[tuple[int, ...]]:
        """The path of every element, this one's first."""
        yield path
        for number, child in enumerate(self.children):
            yield from child.walk((*path, number))

    def at(self, path: Sequence[int]) -> Tree:
        """The element at a path."""
        return self if not path else self.children[path[0]].at(path[1:])

    def with_(self, path: Sequence[int], new: Tree) -> Tree:
        """This tree with another element at a path."""
        if not path:
            return new
        children = list(self.children)
        children[path[0]] = children[path[0]].with_(path[1:], new)
        return replace(self, children=tuple(children))


_Parts = st.SearchStrategy[tuple[Tree, ...]]

# --- values that the grammar allows

KINDS: Final = ("NONE", "SIGN", "ENCRYPT")
ORIGIN_KINDS: Final = (*KINDS, "SIGN_WITH_ORIGIN_AUTHENTICATION", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
_STRINGS = st.one_of(
    st.sampled_from(("", "*", "rt/chatter", "CN=/talker", " x ", "a[b", "\\")),
    st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs")), max_size=8),
)
_BOOLEANS = st.sampled_from(("true", "false", "1", "0"))
_DOMAINS = st.one_of(st.integers(0, 232), st.integers(0, 10**20)).map(str)
_DATES = st.builds(
    lambda at, fraction, zone: f"{at:%Y-%m-%dT%H:%M:%S}{fraction}{zone}",
    st.datetimes(datetime(1000, 1, 1), datetime(9999, 12, 31)),
    st.sampled_from(("", "", ".5", ".123456789")),
    st.sampled_from(("", "", "Z", "+14:00", "-00:30")),
)


def _leaf(tag: str, values: st.SearchStrategy[str]) -> _Parts:
    return values.map(lambda text: (Tree(tag, text=text),))


def _joined(parts: tuple[tuple[Tree, ...], ...] | list[tuple[Tree, ...]]) -> tuple[Tree, ...]:
    return tuple(tree for part in parts for tree in part)


def _sequence(*parts: _Parts) -> _Parts:
    return st.tuples(*parts).map(_joined)


def _many(part: _Parts, low: int = 1, high: int = 2) -> _Parts:
    return st.lists(part, min_size=low, max_size=high).map(_joined)


def _element(tag: str, children: _Parts, attributes: tuple[tuple[str, str], ...] = ()) -> _Parts:
    return children.map(lambda found: (Tree(tag, children=found, attributes=attributes),))


_MIN, _MAX = _leaf("min", _DOMAINS), _leaf("max", _DOMAINS)
_DOMAIN_SET = _element(
    "domains",
    _many(st.one_of(_leaf("id", _DOMAINS), _element("id_range", st.one_of(_MIN, _MAX, _sequence(_MIN, _MAX))))),
)


def _topic_rule(*, liveliness: bool) -> _Parts:
    flags = ("discovery_protection", *(["liveliness_protection"] if liveliness else []))
    flags += ("read_access_control", "write_access_control")
    return _element(
        "topic_rule",
        _sequence(
            _leaf("topic_expression", _STRINGS),
            *(_leaf(f"enable_{flag}", _BOOLEANS) for flag in flags),
            _leaf("metadata_protection_kind", st.sampled_from(ORIGIN_KINDS)),
            _leaf("data_protection_kind", st.sampled_from(KINDS)),
        ),
    )


def _governance(*, liveliness: bool) -> st.SearchStrategy[Tree]:
    rule = _sequence(
        _DOMAIN_SET,
        _leaf("allow_unauthenticated_participants", _BOOLEANS),
        _leaf("enable_join_access_control", _BOOLEANS),
        *(_leaf(f"{what}_protection_kind", st.sampled_from(ORIGIN_KINDS)) for what in ("discovery", "liveliness")),
        _leaf("rtps_protection_kind", st.sampled_from(ORIGIN_KINDS)),
        _element("topic_access_rules", _many(_topic_rule(liveliness=liveliness))),
    )
    root = _element("dds", _element("domain_access_rules", _many(_element("domain_rule", rule))))
    return root.map(lambda found: found[0])


def _criterion(tag: str) -> _Parts:
    pairs = _many(_sequence(_leaf("name", _STRINGS), _leaf("value", _STRINGS)))
    optional = st.lists(
        st.sampled_from(
            (
                _element("partitions", _many(_leaf("partition", _STRINGS))),
                _element("data_tags", _many(_element("tag", pairs))),
            )
        ),
        unique_by=id,
        max_size=2,
    )
    topics = _element("topics", _many(_leaf("topic", _STRINGS)))
    parts = optional.flatmap(lambda chosen: st.permutations([topics, *chosen]))
    return _element(tag, parts.flatmap(lambda ordered: _sequence(*ordered)))


def _permissions(*, mixed: bool) -> st.SearchStrategy[Tree]:
    criteria = [_criterion(tag) for tag in ("publish", "subscribe", "relay")]
    free = _many(st.one_of(*criteria), 0, 3)
    ordered = _sequence(*(_many(criterion, 0, 1) for criterion in criteria))
    rule = _sequence(_DOMAIN_SET, free if mixed else ordered)
    grant = _sequence(
        _leaf("subject_name", _STRINGS),
        _element("validity", _sequence(_leaf("not_before", _DATES), _leaf("not_after", _DATES))),
        _many(st.one_of(_element("allow_rule", rule), _element("deny_rule", rule)), 0, 2),
        _leaf("default", st.sampled_from(("ALLOW", "DENY"))),
    )
    grants = _many(_element("grant", grant, (("name", "g"),)))
    return _element("dds", _element("permissions", grants)).map(lambda found: found[0])


_VALID: Final = {
    (Grammar.GOVERNANCE, "1.1"): _governance(liveliness=True),
    (Grammar.GOVERNANCE, "1.0"): _governance(liveliness=False),
    (Grammar.PERMISSIONS, "1.1"): _permissions(mixed=False),
    (Grammar.PERMISSIONS, "1.0"): _permissions(mixed=True),
}


def valid(grammar: Grammar, version: str = "1.1") -> st.SearchStrategy[Tree]:
    """Documents that the grammar of DDS-Security 1.1 (20170901) or 1.0 (20160303) allows."""
    return _VALID[grammar, version]


# --- changes

_ODD_VALUES: Final = (
    *(
        "0",
        "7",
        "+0",
        "00",
        "-0",
        " 0 ",
        "-1",
        "1.0",
        "1e3",
        "0x1",
        "١",
        "\u00a01",
        "1\u2003",
        "9" * 23,
        "9" * 40,
        "",
        " ",
        "\n",
    ),
    *("true", "false", "TRUE", "True", "FALSE", "1", " true ", "yes"),
    *(*ORIGIN_KINDS, "none", " NONE", "SIGN ", "ENCRYPT_WITH_ORIGIN", "ALLOW", "DENY", "Deny", "allow"),
    *("2024-01-01T00:00:00", "2024-01-01", "2024-02-30T00:00:00", "2024-02-29T00:00:00", "2023-02-29T00:00:00"),
    *("2024-01-01T24:00:00", "2024-01-01T24:00:01", "2024-01-01T00:00:60", "2024-01-01T00:00:00+15:00"),
    *("2024-01-01T00:00:00-14:00", "2024-01-01T00:00:00+14:01", "0000-01-01T00:00:00", "-0001-01-01T00:00:00"),
    *("99999-01-01T00:00:00", "2024-01-01T00:00:00.", "2024-01-01T00:00:00.123456789Z", " 2024-01-01T00:00:00Z "),
    *("2024-1-01T00:00:00", "2024-01-01 00:00:00", "2024-01-01t00:00:00z", "02024-01-01T00:00:00", "x"),
)
_TAGS: Final = (
    *("dds", "domain_access_rules", "domain_rule", "domains", "id", "id_range", "min", "max", "topic_rule"),
    *("enable_liveliness_protection", "data_protection_kind", "topic_expression", "permissions", "grant", "default"),
    *("allow_rule", "deny_rule", "publish", "subscribe", "relay", "topics", "topic", "partitions", "partition"),
    *("data_tags", "tag", "name", "value", "validity", "not_before", "x", "{urn:x}topics"),
)
_ATTRIBUTES: Final = ("name", "x", "NAME", "{urn:x}name", f"{{{_SCHEMA_INSTANCE}}}noNamespaceSchemaLocation")


def _change(draw: Draw, root: Tree) -> Tree:
    paths = list(root.walk())
    leaves = [path for path in paths if not root.at(path).children]
    kind = draw(st.sampled_from(("value", "value", "value", "children", "children", "name", "attribute", "text")))
    path = draw(st.sampled_from(leaves if kind == "value" else paths))
    found = root.at(path)
    if kind == "value":
        return root.with_(path, replace(found, text=draw(st.sampled_from(_ODD_VALUES))))
    if kind == "text":
        return root.with_(path, replace(found, text=draw(st.sampled_from(("x", " ", "\r\n\t", "true")))))
    if kind == "attribute":
        name = draw(st.sampled_from(_ATTRIBUTES))
        kept = tuple(pair for pair in found.attributes if pair[0] != name)
        added = ((name, "v"),) if len(kept) == len(found.attributes) else ()
        return root.with_(path, replace(found, attributes=(*kept, *added)))
    if kind == "name":
        tag = found.tag
        names = (*_TAGS, tag.upper(), tag.capitalize(), f"{{urn:x}}{tag.rpartition('}')[2]}")
        return root.with_(path, replace(found, tag=draw(st.sampled_from(names))))
    return root.with_(path, replace(found, children=_other_children(draw, found.children)))


def _other_children(draw: Draw, children: tuple[Tree, ...]) -> tuple[Tree, ...]:
    """Other order, one less, one twice, or a foreign one."""
    changed = list(children)
    kind = draw(st.sampled_from(("order", "missing", "doubled", "foreign"))) if changed else "foreign"
    place = draw(st.integers(0, max(len(changed) - 1, 0)))
    other = draw(st.integers(0, max(len(changed) - 1, 0)))
    if kind == "order":
        changed[place], changed[other] = changed[other], changed[place]
    elif kind == "missing":
        del changed[place]
    elif kind == "doubled":
        changed.insert(other, changed[place])
    else:
        changed.insert(place, Tree(draw(st.sampled_from(_TAGS))))
    return tuple(changed)


def single_changes(root: Tree) -> Iterator[Tree]:
    """Every element left out, doubled, swapped with the next, named otherwise, and with every odd value."""
    for path in root.walk():
        found = root.at(path)
        for text in _ODD_VALUES if not found.children else ("x",):
            yield root.with_(path, replace(found, text=text))
        yield root.with_(path, replace(found, tag=found.tag.upper()))
        yield root.with_(path, replace(found, tag=f"{{urn:x}}{found.tag}"))
        yield root.with_(path, replace(found, attributes=()))
        yield root.with_(path, replace(found, attributes=(*found.attributes, ("x", "v"))))
        siblings = found.children
        for n, child in enumerate(siblings):
            for others in (
                siblings[:n] + siblings[n + 1 :],
                (*siblings[:n], child, *siblings[n:]),
                (*siblings[:n], *siblings[n + 1 : n + 2], child, *siblings[n + 2 :]),
                (*siblings[:n], Tree("x"), *siblings[n:]),
            ):
                yield root.with_(path, replace(found, children=others))


@st.composite
def changed(draw: Draw, grammar: Grammar, version: str = "1.1") -> Tree:
    """Documents of the grammar with one to three changes; most of them are invalid then, not all."""
    root = draw(valid(grammar, version))
    for _ in range(draw(st.sampled_from((1, 1, 2, 3)))):
        root = _change(draw, root)
    return root


def documents(grammar: Grammar) -> st.SearchStrategy[Tree]:
    """Valid and changed documents of both versions."""
    return st.one_of(valid(grammar, "1.1"), changed(grammar, "1.1"), changed(grammar, "1.1"), changed(grammar, "1.0"))
