"""How implementations read XML that is not of the plain form: rewritten in the form of the schema, or refused.

DDS-Security 1.1, 9.4.1, has a schema and does not say what becomes of a document that breaks it. Fast DDS reads the
elements in the order of the schema and takes the text as it stands. Cyclone DDS takes elements in any order and trims
text. Measured, element by element (tests/oracles/vendors); what was not measured is unknown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Final

from lxml import etree

from keystore_audit.keystore.grammar import Grammar, elements, is_valid, joined
from keystore_audit.keystore.xml import BLANKS, QUOTES, REPEATABLE, SCHEMA_LOCATION
from keystore_audit.profiles import Syntax

_FLAGS: Final = frozenset(
    {"allow_unauthenticated_participants", "enable_join_access_control", "enable_discovery_protection"}
    | {"enable_liveliness_protection", "enable_read_access_control", "enable_write_access_control"}
)
_KINDS: Final = frozenset(
    {f"{what}_protection_kind" for what in ("discovery", "liveliness", "rtps", "metadata", "data")}
)
_NUMBERS: Final = frozenset({"id", "min", "max"})
_DATES: Final = frozenset({"not_before", "not_after"})
_NAMES: Final = frozenset({"subject_name", "topic_expression", "topic", "partition", "default", "name", "value"})
_BASIC: Final = ("NONE", "SIGN", "ENCRYPT")
_BY_ORIGIN: Final = ("SIGN_WITH_ORIGIN_AUTHENTICATION", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
_LEAVES: Final = _FLAGS | _KINDS | _NUMBERS | _DATES | _NAMES

_ORDER: Final[Mapping[str, int]] = {
    name: place
    for place, names in enumerate(
        (
            ("subject_name", "domains", "topic_expression", "min"),
            ("validity", "not_before", "max", "allow_unauthenticated_participants", "enable_discovery_protection"),
            ("not_after", "enable_join_access_control", "enable_liveliness_protection"),
            ("discovery_protection_kind", "enable_read_access_control"),
            ("liveliness_protection_kind", "enable_write_access_control"),
            ("rtps_protection_kind", "metadata_protection_kind"),
            ("topic_access_rules", "data_protection_kind", "allow_rule", "deny_rule", "publish"),
            ("default", "subscribe"),
            ("relay",),
        )
    )
    for name in names
}
"""Where elements stand among those beside them; what is not here may stand anywhere or is unknown."""

_KNOWN: Final = (
    _LEAVES
    | {*_ORDER, "dds", "domain_access_rules", "domain_rule", "id_range", "topic_rule", "permissions", "grant"}
    | {"topics", "partitions", "data_tags", "tag"}
)
_COMMENT: Final = type(etree.Comment())
_CRITERIA: Final = ("publish", "subscribe", "relay")
_TAGS: Final = ("tag", "name", "value")
_LISTS: Final = ("topics", "partitions")
_PLAIN_NUMBER: Final = re.compile(r"\+?[0-9]{1,9}")


class Refused(Exception):
    """The implementation rejects the document; the message says why."""


class Unclear(Exception):
    """Nobody has measured what the implementation makes of an element of the document."""

    def __init__(self, element: etree._Element | None, what: str) -> None:
        """Keep both, in words."""
        super().__init__(f"how {what} is read was not measured")
        self.element = element


def as_read(root: etree._Element, grammar: Grammar, syntax: Syntax) -> etree._Element:
    """The document as the implementation reads it, in the form of the schema, every element with its line.

    Raises Refused and Unclear.
    """
    read = FORMS[syntax](grammar).whole(root)
    if not is_valid(read, grammar, any_date=syntax is not Syntax.SCHEMA):
        raise Refused("it breaks the schema")
    return read


class _BySchema:
    """Elements that the schema refuses are not read; comments and blanks count as XML and the schema have it."""

    def __init__(self, grammar: Grammar) -> None:
        self.grammar = grammar

    def whole(self, root: etree._Element) -> etree._Element:
        """The document, rewritten."""
        return self._made(root)

    def _made(self, element: etree._Element) -> etree._Element:
        made = etree.Element(self._tag(element))
        made.sourceline = element.sourceline
        for name, value in self._attributes(element):
            made.set(name, value)
        tag, children = str(made.tag), elements(element)
        if tag not in _LEAVES:
            self._check_text(element)
            made.extend(self._arranged(tag, [self._made(child) for child in self._kept(tag, children)]))
        elif not children:
            made.text = self._value(tag, element)
        else:
            raise Unclear(element, f"elements in the value of <{tag}>")
        return made

    def _tag(self, element: etree._Element) -> str:
        return str(element.tag)

    def _attributes(self, element: etree._Element) -> Iterator[tuple[str, str]]:
        return ((str(name), str(value)) for name, value in element.items())

    def _check_text(self, element: etree._Element) -> None:
        """Text beside elements."""
        if _beside(element):
            raise Refused(f"text beside the elements of <{element.tag}>")

    def _kept(self, _tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        """Those of an element's children that are looked at."""
        return children

    def _arranged(self, _tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        """The children, rewritten and in the order of the schema."""
        return children

    def _value(self, tag: str, element: etree._Element) -> str:
        text = joined(element)
        if tag not in _FLAGS | _NUMBERS | _DATES:
            return text
        text = text.strip(BLANKS)
        if tag in _FLAGS and text in ("TRUE", "FALSE"):  # the OMG's own documents have these
            return text.lower()
        return str(int(text)) if tag in _NUMBERS and _PLAIN_NUMBER.fullmatch(text) else text


class _InOrder(_BySchema):
    """Elements in the order of the schema, of a text the first piece, as it stands; attributes are passed over."""

    def whole(self, root: etree._Element) -> etree._Element:
        behind = chain(root.iter(etree.ProcessingInstruction), root.itersiblings(etree.ProcessingInstruction))
        if next(behind, None) is not None:
            raise Refused("an instruction behind the start of the root")
        last = root[-1] if self.grammar is Grammar.GOVERNANCE and len(root) else None
        if last is not None and (type(last) is _COMMENT or (last.tail or "").strip(BLANKS)):
            raise Refused("something behind </domain_access_rules>")
        return self._made(root)

    def _tag(self, element: etree._Element) -> str:
        return etree.QName(element).localname

    def _attributes(self, element: etree._Element) -> Iterator[tuple[str, str]]:
        name = element.get("name") if self._tag(element) == "grant" else None
        return iter([] if name is None else [("name", name)])

    def _check_text(self, element: etree._Element) -> None:
        """Text beside elements is passed over."""

    def _kept(self, tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        tags = [self._tag(child) for child in children]
        if tag == "data_tags":
            return []
        if tag == "dds" and self.grammar is Grammar.PERMISSIONS and tags[:1] == ["permissions"]:
            return children[:1]
        if tag == "validity" and tags[:2] == ["not_before", "not_after"]:
            return children[:2]
        if tag == "id_range" and children and sorted(tags) not in (["max"], ["max", "min"], ["min"]):
            raise Unclear(children[0], "an <id_range> of other parts")
        return children[: tags.index("default") + 1] if tag == "grant" and "default" in tags else children

    def _arranged(self, tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        if tag == "data_tags":
            return _some_tags()
        if tag == "id_range":
            return _in_order(children)
        tags = [str(child.tag) for child in children]
        if tag in ("allow_rule", "deny_rule") and {*tags[1:]} <= {*_CRITERIA}:
            return [*children[:1], *_in_order([each for each in children[1:] if not _is_idle(each)])]
        return _merged(children) if tag in _CRITERIA else children

    def _value(self, tag: str, element: etree._Element) -> str:
        pieces = [element.text, *(child.tail for child in element if tag not in _FLAGS | _NUMBERS)]
        text = str(next((each for each in pieces if (each or "").strip(BLANKS)), ""))
        if not text and len(element):
            raise Refused(f"a comment before the value of <{tag}>")
        if tag in _FLAGS:
            return _flag(text, element)
        if tag in _NUMBERS:
            return _number(text.strip(BLANKS), element)
        if tag == "subject_name" and not text:
            raise Refused("an empty <subject_name>")
        return text


def _some_tags() -> Sequence[etree._Element]:
    """What stands for data tags, whose content is never looked at."""
    tag = etree.Element("tag")
    tag.extend(etree.Element(name) for name in ("name", "value"))
    return [tag]


def _flag(text: str, element: etree._Element) -> str:
    """A flag as tinyxml2 reads it: its words, and numbers."""
    if text in ("true", "TRUE", "True", "false", "FALSE", "False"):
        return text.lower()
    if re.fullmatch("[0-9]{1,9}", text):
        return "true" if int(text) else "false"
    if re.search("[0-9]", text):
        raise Unclear(element, f"{text[:40]!r} for true or false")
    raise Refused(f"{text[:40]!r} for true or false")


def _number(text: str, element: etree._Element) -> str:
    if _PLAIN_NUMBER.fullmatch(text):
        return str(int(text))
    if re.search("[0-9]", text):
        raise Unclear(element, f"{text[:40]!r} for a number")
    raise Refused(f"{text[:40]!r} for a number")


class _AnyOrder(_BySchema):
    """Elements in any order and any case, of those that stand once the last; texts without the blanks around them.

    What is passed over for a later one has to be valid all the same.
    """

    def _tag(self, element: etree._Element) -> str:
        if element.nsmap.keys() - {"xsi"}:
            raise Refused("a namespace")
        tag = str(element.tag).lower()
        if tag not in _KNOWN:
            raise Refused(f"the element <{element.tag!s}>")
        return tag

    def _attributes(self, element: etree._Element) -> Iterator[tuple[str, str]]:
        names = {*map(str, element.keys())} - {SCHEMA_LOCATION}
        if self._tag(element) == "grant":
            names.discard("name")
            yield "name", str(element.get("name", ""))
        if names:
            raise Refused(f"the attribute {min(names)}")

    def _check_text(self, element: etree._Element) -> None:
        if element.tag != "data_tags":
            super()._check_text(element)

    def _kept(self, tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        if self.grammar is Grammar.GOVERNANCE:
            return children
        passed_over = _TAGS if tag in _CRITERIA else {*_TAGS, "data_tags"}
        return [child for child in children if self._tag(child) not in passed_over] if tag != "data_tags" else []

    def _arranged(self, tag: str, children: list[etree._Element]) -> Sequence[etree._Element]:
        if tag == "data_tags":
            return _some_tags()
        last = {str(child.tag): child for child in children}
        if tag == "topic_rule" and "topic_expression" not in last:  # the process ends, or does not
            raise Unclear(next(iter(children), None), "a <topic_rule> without expression")
        kept = [child for child in children if child.tag in REPEATABLE or last[str(child.tag)] is child]
        if tag == "grant":
            kept = [child for child in kept if not _is_nowhere(child)]
            if "default" not in last:
                kept.append(etree.Element("default"))
                kept[-1].text = "DENY"
        if tag in ("allow_rule", "deny_rule"):
            kept = [child for child in kept if not _is_empty(child, allows=tag == "allow_rule")]
        return _in_order(kept)

    def _value(self, tag: str, element: etree._Element) -> str:
        text = joined(element).strip(BLANKS)
        if text.startswith(QUOTES):  # it is refused, unless something behind it closes the string
            raise Unclear(element, "a value that begins with a quote")
        if tag in _FLAGS:
            if text.lower() not in ("true", "false", "1", "0", ""):
                raise Refused(f"{text[:40]!r} for true or false")
            return text.lower() or "false"
        if tag in _KINDS:
            kinds = _BASIC if tag == "data_protection_kind" else (*_BASIC, *_BY_ORIGIN)
            if text and text not in kinds:
                raise Refused(f"{text[:40]!r} for a protection kind")
            return text or kinds[-1]  # the value stays 0, the strongest kind
        if tag in _NUMBERS:
            if not text:
                raise Unclear(element, f"an empty <{tag}>")
            return _number(text, element)
        if tag == "default":
            if not text:
                raise Unclear(element, "an empty <default>")
            return text if text == "ALLOW" else "DENY"
        if tag == "subject_name" and not text:
            raise Refused("an empty <subject_name>")
        return text


def _beside(element: etree._Element) -> bool:
    """Whether there is text beside the elements of an element."""
    return bool((element.text or "").strip(BLANKS)) or any((child.tail or "").strip(BLANKS) for child in element)


def _in_order(children: Sequence[etree._Element]) -> list[etree._Element]:
    return sorted(children, key=lambda child: _ORDER.get(str(child.tag), 0))


def _is_nowhere(rule: etree._Element) -> bool:
    """Whether it is a rule for no domain at all."""
    domains = rule.find("domains")
    return domains is not None and len(domains) == 0


def _is_idle(criterion: etree._Element) -> bool:
    """Whether a criterion lists no topics at all. Raises Unclear where it has something else."""
    if criterion.tag in _CRITERIA and criterion.find("topics") is None:
        if len(criterion):
            raise Unclear(criterion, f"a <{criterion.tag!s}> without <topics>")
        return True
    return False


def _is_empty(criterion: etree._Element, *, allows: bool) -> bool:
    """Whether a criterion is about no topic, or no partition. Raises Unclear where a deny rule is about none."""
    if criterion.tag not in _CRITERIA or not {str(each.tag) for each in criterion} <= {*_LISTS, "data_tags"}:
        return False
    topics, partitions = criterion.find("topics"), criterion.find("partitions")
    if partitions is not None and not len(partitions):
        if not allows:
            raise Unclear(criterion, "an empty <partitions> that denies")
        return True
    return topics is None or not len(topics)


def _merged(children: Sequence[etree._Element]) -> list[etree._Element]:
    """The lists of a criterion, those of one name as one; an empty one stays, for the schema to refuse."""
    first: dict[str, etree._Element] = {}
    if any(child.tag in _LISTS and not len(child) for child in children):
        return [*children]
    for child in children:
        if child.tag in _LISTS and child.tag in first:
            first[str(child.tag)].extend(child)
        else:
            first[str(child.tag)] = child
    return [*first.values()]


FORMS: Final[Mapping[Syntax, type[_BySchema]]] = {
    Syntax.SCHEMA: _BySchema,
    Syntax.IN_ORDER: _InOrder,
    Syntax.ANY_ORDER: _AnyOrder,
}
