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
from keystore_audit.keystore.skeleton import Skeleton
from keystore_audit.keystore.smime import SignedDocument
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
_STOCK_START: Final = re.compile(
    rb'(?:<\?xml version="1\.0"(?: encoding="[Uu][Tt][Ff]-8")?\?>\s*)?'
    rb'<dds(?:\s+xmlns:xsi="http://www\.w3\.org/2001/XMLSchema-instance"'
    rb'(?:\s+xsi:noNamespaceSchemaLocation="[^"<&]*")?)?\s*>'
)
_LOCATION: Final = f"{{{_SCHEMA_INSTANCE}}}noNamespaceSchemaLocation"

_CONTROLS: Final = bytes(code for code in (*range(0x20), 0x7F) if code not in b"\t\n\r")
_DECLARED_ENCODING: Final = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")
_MARKUP: Final = re.compile(rb"<!--.*?-->|<\?.*?\?>|<!\[CDATA\[|<!DOCTYPE", re.DOTALL)
_BLANKS: Final = " \t\r\n"
_BLANK_IN_END_TAG: Final = re.compile(rb"</[^\s<>]+\s")
_REFERENCE_TO_BLANK: Final = re.compile(rb"&#(?:0*(?:9|10|13|32)|[xX]0*(?:9|[aA]|[dD]|20));")
_BROKEN_ATTRIBUTE: Final = re.compile(rb"""\s[\w:.-]+\s*=\s*(?:"[^"<]*[\t\r\n]|'[^'<]*[\t\r\n])""")
_COMMENT: Final = re.compile(rb"<!--.*?-->", re.DOTALL)
_QUOTES: Final = ('"', "'", "\u2018", "\u201c")
"""Signs that begin a string for Cyclone DDS, whatever follows."""
_ODD_STARTS: Final = (" ", *_QUOTES)

_SECOND_ROOT: Final = "Extra content at the end of the document"  # libxml2, XML_ERR_DOCUMENT_END


def read_xml(signed: SignedDocument) -> tuple[etree._Element | None, tuple[Defect, ...]]:
    """Parse the signed text; return its root, and every place that implementations read differently.

    The root is None where the text is no XML or has no one structure. Never raises.
    """
    content = signed.content
    if content is None:
        return None, ()
    reading = _Reading(signed)
    if len(content) > MAX_BYTES or content.count(b"<") > MAX_TAGS:
        reading.add(Kind.BEYOND_LIMIT, 1, f"more than {MAX_BYTES} bytes or {MAX_TAGS} tags, which are not read here")
        return None, reading.found()
    if not content.strip():
        reading.add(Kind.EMPTY_ELEMENT, 1, "the document is empty")
        return None, reading.found()
    if not reading.plain_bytes(content):
        return None, reading.found()
    try:
        root = etree.fromstring(content, _parser())
    except etree.XMLSyntaxError as error:
        reading.syntax_error(error)
        return None, reading.found()
    except (ValueError, LookupError) as error:  # an unknown encoding
        reading.add(Kind.XML_MALFORMED, 1, f"the text is no XML: {error}")
        return None, reading.found()
    if _only_elements(content):
        reading.values(root)
        return root, reading.found()
    if any(len(element.attrib) > MAX_ATTRIBUTES for element in root.iter(etree.Element)):
        reading.add(Kind.XML_MALFORMED, 1, f"an element with more than {MAX_ATTRIBUTES} attributes, which is not read")
        return None, reading.found()
    reading.nodes(root)
    return root, reading.found()


def parse_unsigned(content: bytes) -> etree._Element:
    """Parse a text that the user names and no implementation reads; bounded, without document type and network.

    Raises Malformed.
    """
    if len(content) > MAX_BYTES or content.count(b"<") > MAX_TAGS:
        raise Malformed(1, f"more than {MAX_BYTES} bytes or {MAX_TAGS} tags, which are not read")
    declared = _DECLARED_ENCODING.match(content, 0, 512)
    if b"\0" in content or (declared is not None and declared[1].upper() not in (b"UTF-8", b"US-ASCII")):
        raise Malformed(1, "expected UTF-8, found another encoding")
    for match in _MARKUP.finditer(content) if b"<!DOCTYPE" in content else ():
        if match.group() == b"<!DOCTYPE":
            raise Malformed(_line_of(content, match.start()), "a document type, which is not read")
    try:
        root = etree.fromstring(content, _parser())
    except etree.XMLSyntaxError as error:
        raise Malformed(error.lineno or 1, f"the text is no well-formed XML: {error.msg}") from None
    except (ValueError, LookupError) as error:
        raise Malformed(1, f"the text is no XML: {error}") from None
    for element in root.iter(etree.Element):
        if len(element.attrib) > MAX_ATTRIBUTES:
            raise Malformed(source_line(element) or 1, f"more than {MAX_ATTRIBUTES} attributes, which are not read")
    return root


def _only_elements(content: bytes) -> bool:
    """Whether there is nothing but elements and text in it, which every document of sros2's is.

    No comment, instruction, CDATA, character reference, and no attribute but those on the root and names of grants.
    """
    start = _STOCK_START.match(content)
    if start is None:
        return False
    end = start.end()
    # Cheap to look for, nearly always absent: the detailed look is right for every document, only slower.
    if any(content.find(sign, end) >= 0 for sign in (b"!", b"?", b"&", b"'", b"<xsi:")):
        return False
    return content.count(b'"', end) == 2 * content.count(b'<grant name="', end)


def _parser() -> etree.XMLParser:
    """A new parser each time: it costs 2 µs and shares no state between documents. CDATA and comments are kept."""
    return etree.XMLParser(
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


class _Reading:
    """Collects the defects of one document."""

    def __init__(self, signed: SignedDocument) -> None:
        self._signed = signed
        self._defects: list[Defect] = []
        self._skeleton = Skeleton()

    def found(self) -> tuple[Defect, ...]:
        return tuple(self._defects)

    def add(self, kind: Kind, line: int | None, detail: str) -> None:
        if len(self._defects) < MAX_DEFECTS:
            self._defects.append(self._signed.defect(kind, line, detail))

    @property
    def full(self) -> bool:
        return len(self._defects) >= MAX_DEFECTS

    def ambiguous(self, line: int | None, detail: str) -> None:
        self.add(Kind.XML_AMBIGUOUS, line, detail)

    # --- before parsing

    def plain_bytes(self, content: bytes) -> bool:
        """Look for what makes the text itself differ between readers; False where parsing it makes no sense."""
        if content.startswith((b"\xff\xfe", b"\xfe\xff", b"\x00<", b"<\x00", b"\x00\x00")):
            self.ambiguous(1, "expected UTF-8, found UTF-16 or UTF-32, which Fast DDS and Cyclone DDS cannot read")
            return False
        if len(content.translate(None, _CONTROLS)) != len(content):
            line, code = next((_line_of(content, i), byte) for i, byte in enumerate(content) if byte in _CONTROLS)
            read = "Fast DDS and Cyclone DDS accept it, others refuse the text"
            if b"\0" in content:
                line, code = _line_of(content, content.find(b"\0")), 0
                read = "Fast DDS and Cyclone DDS ignore everything behind it, others refuse the text"
            self.ambiguous(line, f"the control character 0x{code:02x}: {read}")
            return False
        declared = _DECLARED_ENCODING.match(content, 0, 512)
        if declared is not None and declared[1].upper() not in (b"UTF-8", b"US-ASCII"):
            name = declared[1].decode("ascii", "backslashreplace")
            self.ambiguous(1, f"expected encoding UTF-8, found {_shown(name)}, which Fast DDS and Cyclone DDS ignore")
            return False
        if content.count(b"\r") != content.count(b"\r\n"):
            self.ambiguous(_lone_return(content), "a carriage return without line feed: parsers read it differently")
        self._spelling(content)
        if not content.isascii():
            self._invisible(content)
        return not (b"!" in content and self._has_document_type(content))

    def _spelling(self, content: bytes) -> None:
        """Find what a tree does not show and parsers do not spell alike (measured: tinyxml2 9, Cyclone DDS 0.10.2)."""
        text = _COMMENT.sub(_emptied, content) if b"<!--" in content else content
        self._skeleton = Skeleton(text)
        if not self._skeleton.odd:
            return
        for pattern, detail in (
            (_BLANK_IN_END_TAG, "a blank in an end tag, which Cyclone DDS refuses"),
            (_REFERENCE_TO_BLANK, "a character reference to a blank, which Cyclone DDS does not take for one"),
            (_BROKEN_ATTRIBUTE, "a tab or line end in an attribute, which some parsers turn into a blank"),
        ):
            if pattern is _BROKEN_ATTRIBUTE and not self._skeleton.broken:
                continue
            match = pattern.search(text)
            if match is not None:
                self.ambiguous(_line_of(text, match.start()), detail)

    def _invisible(self, content: bytes) -> None:
        if content.startswith(b"\xef\xbb\xbf"):
            self.ambiguous(1, "a byte order mark, which Cyclone DDS refuses and Fast DDS skips")
            content = content[3:]
        text = content.decode("utf-8", "replace")
        invisible = _unseen(text) - set(_BLANKS)
        for match in re.finditer(f"[{re.escape(''.join(invisible))}]", text) if invisible else ():
            line = text.count("\n", 0, match.start()) + 1
            self.ambiguous(
                line, f"the invisible character U+{ord(match.group()):04X}: what people see is not what is read"
            )
            if self.full:
                break

    def syntax_error(self, error: etree.XMLSyntaxError) -> None:
        line = error.lineno or 1
        if _SECOND_ROOT in str(error.msg):
            detail = "text behind the end of the document: Fast DDS reads the first root alone, other parsers refuse it"
            self.ambiguous(line, detail)
        else:
            self.add(Kind.XML_MALFORMED, line, f"the text is no well-formed XML: {error.msg}")

    def _has_document_type(self, content: bytes) -> bool:
        """Find what a tree does not show: CDATA sections, and a document type, with which no parser is handed the text.

        Even with `load_dtd=False` lxml 6.1 tries to open an external one.
        """
        for match in _MARKUP.finditer(content):
            if match.group() == b"<!DOCTYPE":
                detail = "a document type: entities and defaults in it are read by some parsers and not by others"
                self.ambiguous(_line_of(content, match.start()), detail)
                return True
            if match.group() == b"<![CDATA[" and not self.full:
                detail = "a CDATA section: Fast DDS reads only the first piece of a value, others the whole"
                self.ambiguous(_line_of(content, match.start()), detail)
        return False

    # --- after parsing

    def values(self, root: etree._Element) -> None:
        """Look at the values of a text in which there is nothing but elements. Blanks but " " are not printable."""
        for element in root.iter() if self._skeleton.remarkable else ():
            text = element.text if len(element) == 0 else None
            if text and (not text.isprintable() or text[0] in _ODD_STARTS or text[-1] == " "):
                self._value(element, text)

    def nodes(self, root: etree._Element) -> None:
        """Look at every node, until there are defects enough."""
        self._declarations(root)
        for node in itertools.chain(root.itersiblings(preceding=True), root.iter(), root.itersiblings()):
            if self.full:
                return
            if _is(node, etree.ProcessingInstruction):
                self.ambiguous(source_line(node), f"the instruction {_shown(node)}, which some parsers refuse")
            elif isinstance(node.tag, str):
                self._element(node, node.tag)

    def _declarations(self, root: etree._Element) -> None:
        for element in root.iter(etree.Element):
            if self.full:
                return
            outer = element.getparent()
            inherited: dict[str | None, str] = {"xsi": _SCHEMA_INSTANCE} if outer is None else dict(outer.nsmap)
            for prefix, name in element.nsmap.items():
                if inherited.get(prefix) != name:
                    found = f"{_shown(prefix or 'no prefix')} for {_shown(name)}"
                    detail = f"expected no namespace but xmlns:xsi on the root, found {found}"
                    self.ambiguous(source_line(element), f"{detail}: Cyclone DDS refuses it, Fast DDS ignores it")

    def _element(self, element: etree._Element, tag: str) -> None:
        line = source_line(element)
        parent = element.getparent()
        if tag[0] == "{" and (parent is None or str(parent.tag)[0] != "{"):
            detail = f"the element {_shown(tag)} in a namespace: Fast DDS and Cyclone DDS go by the name alone"
            self.ambiguous(line, detail)
        for name, value in element.items():
            if str(name)[0] == "{" and (name != _LOCATION or parent is not None):
                self.ambiguous(line, f"the attribute {_shown(name)}, which Cyclone DDS refuses and Fast DDS ignores")
            elif _unseen(str(value)):
                self.ambiguous(line, f"a control character in the attribute {_shown(name)}: {_shown(value)}")
        if len(element) == 0:
            self._value(element, str(element.text or ""))
        elif not any(isinstance(child.tag, str) for child in element):
            self._pieces(element)
        elif tag == "dds" and _is(element[-1], etree.Comment) and element.find("domain_access_rules") is not None:
            detail = "a comment behind </domain_access_rules>: Fast DDS refuses the document"
            self.ambiguous(source_line(element[-1]), detail)

    def _value(self, element: etree._Element, text: str) -> None:
        if text.strip(_BLANKS) != text:
            detail = f"{_shown(text)} with blanks around it: Cyclone DDS trims them, Fast DDS does not"
            self.ambiguous(source_line(element), f"the value of <{_name(element)}> is {detail}")
        elif text.startswith(_QUOTES):
            detail = f"{_shown(text)}, which begins with a quote: Cyclone DDS refuses the document"
            self.ambiguous(source_line(element), f"the value of <{_name(element)}> is {detail}")
        elif _unseen(text):
            detail = f"a control or invisible character in the value {_shown(text)} of <{_name(element)}>"
            self.ambiguous(source_line(element), detail)

    def _pieces(self, element: etree._Element) -> None:
        """A value with comments, instructions or entity references in it."""
        first = str(element.text or "")
        joined = first + "".join(str(child.tail or "") for child in element)
        what = "a comment" if all(_is(child, etree.Comment) for child in element) else "other nodes"
        read = f"Fast DDS reads only the first piece, {_shown(first)}, Cyclone DDS and OpenDDS {_shown(joined)}"
        self.ambiguous(source_line(element), f"{what} inside the value of <{_name(element)}>: {read}")


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


def _lone_return(content: bytes) -> int:
    match = re.search(rb"\r(?!\n)", content)
    return 1 if match is None else _line_of(content, match.start())


REPEATABLE: Final = frozenset(
    {"domain_rule", "id", "id_range", "topic_rule", "grant", "allow_rule", "deny_rule"}
    | {"publish", "subscribe", "relay", "topic", "partition", "tag", "name", "value"}
)
"""Elements that may stand several times beside each other (DDS-Security 1.1, 9.4.1.2 and 9.4.1.3)."""


def duplicates(root: etree._Element, signed: SignedDocument) -> tuple[Defect, ...]:
    """Elements that may stand once and stand twice: Cyclone DDS takes the last or merges them, Fast DDS the first."""
    return tuple(
        signed.defect(Kind.XML_AMBIGUOUS, line, detail) for line, detail in _duplicates(root.iter(etree.Element))
    )[:MAX_DEFECTS]


def _duplicates(parents: Iterable[etree._Element]) -> Iterator[tuple[int | None, str]]:
    for parent in parents:
        seen: set[str] = set()
        for child in parent.iterchildren(etree.Element):
            tag = etree.QName(child).localname
            if tag in seen and tag not in REPEATABLE:
                detail = (
                    f"a second <{tag}> in <{etree.QName(parent).localname}>: Cyclone DDS takes the last or joins them"
                )
                yield source_line(child), f"{detail}, Fast DDS takes the first or refuses the document"
            seen.add(tag)
