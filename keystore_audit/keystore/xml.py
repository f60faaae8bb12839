"""Signed XML of which every implementation reads the same: parsed without entities, network or unbounded size.

Fast DDS reads with tinyxml2, Cyclone DDS with a parser of its own, OpenDDS with Xerces-C, we with libxml2. Where they
read one document differently it has no single meaning: a defect, never a guess (facts: x509-pkcs7-xml 4.1).
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Iterable, Iterator
from typing import Final

from lxml import etree

from keystore_audit.keystore.defect import Defect, Kind, Malformed
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.profiles import facts
from keystore_audit.text import shorten, terminal

MAX_BYTES: Final = 8 << 20
"""Longest text that is parsed: a file of 4 MB whose line ends were LF can double when they become CRLF."""

MAX_TAGS: Final = 200_000
"""Start and end tags of 100,000 elements: a million take 0.8 s and 166 MB; sros2's largest sample has 400."""

MAX_DEFECTS: Final = 20
"""Defects of one kind that are reported for a document: enough to repair it, and a hostile one has thousands."""

MAX_ATTRIBUTES: Final = 16
"""Attributes of one element that are looked at: the grammar knows 2, and lxml takes minutes for 100,000."""

MAX_QUOTED: Final = 80
"""Characters of a value or name that a defect quotes."""

_SCHEMA_INSTANCE: Final = "http://www.w3.org/2001/XMLSchema-instance"
SCHEMA_LOCATION: Final = f"{{{_SCHEMA_INSTANCE}}}noNamespaceSchemaLocation"

_CONTROLS: Final = bytes(code for code in (*range(0x20), 0x7F) if code not in b"\t\n\r")
_DECLARED_ENCODING: Final = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")
_MARKUP: Final = re.compile(rb"<!--.*?-->|<\?.*?\?>|<!\[CDATA\[|<!DOCTYPE", re.DOTALL)
BLANKS: Final = " \t\r\n"
"""What parsers trim, and no space beyond ASCII (measured on a space of no break)."""

_SPELLINGS: Final = (
    # What a tree does not show and parsers do not spell alike (measured: tinyxml2 9, Cyclone DDS 0.10.2).
    (re.compile(rb"</[^\s<>]+\s"), Kind.XML_AMBIGUOUS, facts.BLANK_IN_END_TAG),
    (
        re.compile(rb"&#(?:0*(?:9|10|13|32)|[xX]0*(?:9|[aA]|[dD]|20));"),
        Kind.XML_AMBIGUOUS,
        facts.REFERENCE_TO_BLANK,
    ),
    (
        re.compile(rb"""\s(?!xsi:noNamespaceSchemaLocation\s*=)[\w:.-]+\s*=\s*(?:"[^"<]*[\t\r\n]|'[^'<]*[\t\r\n])"""),
        Kind.XML_VARIES,
        "a tab or line end in an attribute, which some parsers turn into a blank",
    ),
)
_COMMENT: Final = re.compile(rb"<!--.*?-->", re.DOTALL)
QUOTES: Final = ('"', "'", "\u2018", "\u201c")
"""Signs that begin a string for Cyclone DDS, whatever follows."""

_LIMITS: Final = f"more than {MAX_BYTES} bytes or {MAX_TAGS} tags, which are not read here"
_SECOND_ROOT: Final = "Extra content at the end of the document"  # libxml2, XML_ERR_DOCUMENT_END

_MARK: Final = b"\xef\xbb\xbf"
_STOCK_NAMESPACE: Final = b'xmlns:xsi="%b"' % _SCHEMA_INSTANCE.encode()
_DOCUMENT_TYPE: Final = "a document type: entities and defaults in it are read by some parsers and not by others"
_CDATA: Final = facts.CDATA

_Said = tuple[Kind, int | None, str]
"""What a defect says of a line of the text."""


def read_xml(signed: SignedDocument) -> tuple[etree._Element | None, tuple[Defect, ...]]:
    """Parse the signed text; return its root, and every place that implementations read differently.

    The root is None where the text is no XML or has no one structure. Never raises.
    """
    content = signed.content
    if content is None:
        return None, ()
    root: etree._Element | None = None
    said: list[_Said] = []
    refused = _refused(content)
    if refused is None:
        said += itertools.islice(_spelled(content), MAX_DEFECTS)
        refused = next(_markup(content, b"<!DOCTYPE", _DOCUMENT_TYPE), None)
    if refused is None:
        try:
            root = _parsed(content)
        except Malformed as error:
            second = facts.SECOND_ROOT
            refused = (
                (Kind.XML_AMBIGUOUS, error.line, second)
                if _SECOND_ROOT in error.detail
                else (Kind.XML_MALFORMED, error.line, error.detail)
            )
        else:
            said += itertools.islice(_ambiguities(root, content), MAX_DEFECTS - len(said))
    said += [refused] if refused is not None else []
    return root, tuple(signed.defect(*each) for each in said[:MAX_DEFECTS])


def parse_unsigned(content: bytes) -> etree._Element:
    """Parse a text that the user names and no implementation reads; bounded, without document type and network.

    Raises Malformed.
    """
    if _is_beyond_limits(content):
        raise Malformed(1, _LIMITS)
    if b"\0" in content or _declared_encoding(content) is not None:
        raise Malformed(1, "expected UTF-8, found another encoding")
    for _kind, line, _detail in _markup(content, b"<!DOCTYPE", _DOCUMENT_TYPE):
        raise Malformed(line or 1, "a document type, which is not read")
    return _parsed(content)


def _is_beyond_limits(content: bytes) -> bool:
    return len(content) > MAX_BYTES or content.count(b"<") > MAX_TAGS


def _declared_encoding(content: bytes) -> str | None:
    """The encoding that the text says it has, where that is neither UTF-8 nor ASCII."""
    declared = _DECLARED_ENCODING.match(content, 0, 512)
    if declared is None or declared[1].upper() in (b"UTF-8", b"US-ASCII"):
        return None
    return declared[1].decode("ascii", "backslashreplace")


def _parsed(content: bytes) -> etree._Element:
    """The root; CDATA and comments are kept. Raises Malformed."""
    # A new parser each time: it costs 2 µs and shares no state between documents.
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        strip_cdata=False,
        remove_comments=False,
        remove_pis=False,
        collect_ids=False,
    )
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise Malformed(error.lineno or 1, f"the text is no well-formed XML: {error.msg}") from None
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise Malformed(1, f"the text is no XML: {error}") from None
    for element in root.iter(etree.Element) if content.count(b"=") > MAX_ATTRIBUTES else ():
        if len(element.attrib) > MAX_ATTRIBUTES:
            detail = f"an element with more than {MAX_ATTRIBUTES} attributes, which is not read"
            raise Malformed(1, detail)
    return root


# --- before parsing


def _refused(content: bytes) -> _Said | None:
    """Why parsing the text makes no sense."""
    if _is_beyond_limits(content):
        return Kind.BEYOND_LIMIT, 1, _LIMITS
    if not content.strip():
        return Kind.EMPTY_ELEMENT, 1, "the document is empty"
    if content.startswith((b"\xff\xfe", b"\xfe\xff", b"\x00<", b"<\x00", b"\x00\x00")):
        detail = f"expected UTF-8, found UTF-16 or UTF-32, {facts.CANNOT_READ}"
        return Kind.XML_AMBIGUOUS, 1, detail
    if len(content.translate(None, _CONTROLS)) != len(content):
        at = content.find(b"\0")
        read = facts.END_AT_NUL
        if at < 0:
            at = next(position for position, byte in enumerate(content) if byte in _CONTROLS)
            read = facts.ACCEPT_CONTROLS
        return Kind.XML_AMBIGUOUS, _line_of(content, at), f"the control character 0x{content[at]:02x}: {read}"
    name = _declared_encoding(content)
    if name is not None:
        detail = f"expected encoding UTF-8, found {_shown(name)}, {facts.IGNORE_ENCODING}"
        return Kind.XML_AMBIGUOUS, 1, detail
    return None


def _spelled(content: bytes) -> Iterator[_Said]:
    """What makes the text itself differ between readers."""
    if content.count(b"\r") != content.count(b"\r\n"):
        detail = "a carriage return without line feed: parsers read it differently"
        yield Kind.XML_AMBIGUOUS, _line_of(content, content.replace(b"\r\n", b"\n\n").find(b"\r")), detail
    text = _COMMENT.sub(_emptied, content) if b"<!--" in content else content
    for pattern, kind, detail in _SPELLINGS:
        match = pattern.search(text)
        if match is not None:
            yield kind, _line_of(text, match.start()), detail
    if content.startswith(_MARK):
        yield Kind.XML_AMBIGUOUS, 1, facts.BYTE_ORDER_MARK
    characters = "" if content.isascii() else content.removeprefix(_MARK).decode("utf-8", "replace")
    invisible = _unseen(characters) - set(BLANKS)
    for seen in re.finditer(f"[{re.escape(''.join(invisible))}]", characters) if invisible else ():
        detail = f"the invisible character U+{ord(seen.group()):04X}: what people see is not what is read"
        yield Kind.XML_AMBIGUOUS, characters.count("\n", 0, seen.start()) + 1, detail
    yield from _markup(content, b"<![CDATA[", _CDATA)


def _markup(content: bytes, sign: bytes, detail: str) -> Iterator[_Said]:
    """Find what a tree does not show: CDATA sections, and a document type, with which no parser is handed the text.

    Even with `load_dtd=False` lxml 6.1 tries to open an external one.
    """
    for match in _MARKUP.finditer(content) if sign in content else ():
        if match.group() == sign:
            yield Kind.XML_AMBIGUOUS, _line_of(content, match.start()), detail


# --- after parsing


def _ambiguities(root: etree._Element, content: bytes) -> Iterator[_Said]:
    """What the nodes show, declarations of namespaces first."""
    if content.count(b"xmlns") != content.count(_STOCK_NAMESPACE):
        for element in root.iter(etree.Element):
            outer = element.getparent()
            inherited: dict[str | None, str] = {"xsi": _SCHEMA_INSTANCE} if outer is None else dict(outer.nsmap)
            for prefix, name in element.nsmap.items():
                if inherited.get(prefix) != name:
                    found = f"{_shown(prefix or 'no prefix')} for {_shown(name)}"
                    detail = f"expected no namespace but xmlns:xsi on the root, found {found}"
                    yield _at(element, f"{detail}: {facts.NAMESPACE_DECLARED}")
    for node in itertools.chain(root.itersiblings(preceding=True), root.iter(), root.itersiblings()):
        if _is(node, etree.ProcessingInstruction):
            yield _at(node, f"the instruction {_shown(node)}, which some parsers refuse")
        elif isinstance(node.tag, str):
            yield from _of_element(node, node.tag)


def _at(element: etree._Element, detail: str, kind: Kind = Kind.XML_VARIES) -> _Said:
    return kind, source_line(element), detail


def _of_element(element: etree._Element, tag: str) -> Iterator[_Said]:
    if tag[0] == "{":
        parent = element.getparent()
        if parent is None or str(parent.tag)[0] != "{":
            detail = f"the element {_shown(tag)} in a namespace: {facts.NAMESPACE_OF_ELEMENT}"
            yield _at(element, detail, Kind.XML_AMBIGUOUS if element.prefix else Kind.XML_VARIES)
    for name, value in element.items():
        if str(name)[0] == "{" and (name != SCHEMA_LOCATION or element.getparent() is not None):
            yield _at(element, f"the attribute {_shown(name)}, {facts.ATTRIBUTE}")
        elif _unseen(str(value)):
            what = f"a control character in the attribute {_shown(name)}: {_shown(value)}"
            yield _at(element, what, Kind.XML_AMBIGUOUS)
    first = str(element.text or "")
    if len(element) == 0:
        if _unseen(first.strip(BLANKS)):
            what = f"a control or invisible character in the value {_shown(first)} of <{_name(element)}>"
            yield _at(element, what, Kind.XML_AMBIGUOUS)
        elif read := _read_apart(first):
            yield _at(element, f"the value of <{_name(element)}> is {_shown(first)}{read}")
    elif not any(isinstance(child.tag, str) for child in element):  # comments, instructions, entity references
        joined = first + "".join(str(child.tail or "") for child in element)
        told = all(_is(child, etree.Comment) for child in element)
        what = f"{'a comment' if told else 'other nodes'} inside the value of <{_name(element)}>"
        read = facts.PIECES.format(first=_shown(first), joined=_shown(joined))
        yield _at(element, f"{what}: {read}", Kind.XML_VARIES if told else Kind.XML_AMBIGUOUS)
    elif tag == "dds" and _is(element[-1], etree.Comment) and element.find("domain_access_rules") is not None:
        yield _at(element[-1], facts.COMMENT_AT_END)


def _read_apart(text: str) -> str:
    """How implementations read a value differently; "" where they do not."""
    if text.strip(BLANKS) != text:
        return f" with blanks around it: {facts.BLANKS_AROUND}"
    return f", which begins with a quote: {facts.QUOTE_AT_START}" if text.startswith(QUOTES) else ""


def _unseen(text: str) -> set[str]:
    """Its control and invisible characters, spaces of other widths apart: what reports have to make visible."""
    if text.isascii() and text.isprintable():
        return set()
    return {sign for sign in set(text) if terminal(sign) != sign and unicodedata.category(sign) != "Zs"}


def _shown(text: object) -> str:
    return repr(shorten(str(text), MAX_QUOTED))


def _name(element: etree._Element) -> str:
    return shorten(str(element.tag), MAX_QUOTED)


def _is(node: etree._Element, factory: object) -> bool:
    """Whether the node is one of those whose `tag` is the function that makes them: comments, instructions."""
    tag: object = node.tag
    return tag is factory


def source_line(element: etree._Element) -> int | None:
    """The line of the text at which the start tag of `element` ends."""
    line: object = element.sourceline
    return line if isinstance(line, int) else None


def _line_of(content: bytes, offset: int) -> int:
    return content.count(b"\n", 0, offset) + 1


def _emptied(comment: re.Match[bytes]) -> bytes:
    return b"\n" * comment[0].count(b"\n")


REPEATABLE: Final = frozenset(
    {"domain_rule", "id", "id_range", "topic_rule", "grant", "allow_rule", "deny_rule"}
    | {"publish", "subscribe", "relay", "topic", "partition", "tag", "name", "value"}
)
"""Elements that may stand several times beside each other (DDS-Security 1.1, 9.4.1.2 and 9.4.1.3)."""


def duplicates(root: etree._Element, signed: SignedDocument) -> tuple[Defect, ...]:
    """Elements that may stand once and stand twice: Cyclone DDS takes the last or merges them, Fast DDS the first."""
    return tuple(
        signed.defect(Kind.XML_VARIES, line, detail) for line, detail in _duplicates(root.iter(etree.Element))
    )[:MAX_DEFECTS]


def _duplicates(parents: Iterable[etree._Element]) -> Iterator[tuple[int | None, str]]:
    for parent in parents:
        seen: set[str] = set()
        for child in parent.iterchildren(etree.Element):
            tag = etree.QName(child).localname
            if tag in seen and tag not in REPEATABLE:
                detail = f"a second <{tag}> in <{etree.QName(parent).localname}>: {facts.ELEMENT_TWICE}"
                yield source_line(child), detail
            seen.add(tag)
