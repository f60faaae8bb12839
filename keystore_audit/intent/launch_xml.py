"""Launch files in XML: their elements, with attributes and lines."""

from __future__ import annotations

from typing import Final

from lxml import etree

from keystore_audit.intent.launch_entities import Entity
from keystore_audit.intent.source import Source, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.keystore.xml import parse_unsigned, source_line

MAX_CHARACTERS: Final = 1 << 18
"""Length of a launch file in XML: the largest are a tenth."""


def read(source: Source) -> Entity:
    """Read the elements of a launch file. Raises UsageError, naming file and line."""
    if len(source.text) > MAX_CHARACTERS:
        raise source.malformed(None, f"more than {MAX_CHARACTERS} characters of XML, which are not read")
    try:
        root = parse_unsigned(source.text.encode())
    except Malformed as error:
        raise source.malformed(error.line, error.detail) from None
    if root.tag != "launch":
        raise source.malformed(source_line(root), f"expected <launch>, found <{shown(str(root.tag))[1:-1]}>")
    return _entity(root)


def _entity(element: etree._Element) -> Entity:
    """The element; the parser lets none lie deeper than 256."""
    return Entity(
        kind=str(element.tag).replace("-", "_"),
        line=source_line(element) or 1,
        attributes={str(name): str(value) for name, value in element.items()},
        children=tuple(_entity(child) for child in element.iterchildren(etree.Element)),
    )
