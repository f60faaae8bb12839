"""A grant as a permissions document (DDS-Security 1.1, 9.4.1.3), ready to be signed.

Plain XML without comments, which implementations read in different ways.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.permissions import Criterion, Grant, Rule
from keystore_audit.text import html

_SCHEMA: Final = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd"
_DDS: Final = f'<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{_SCHEMA}">'
_INDENT: Final = "  "

_Line = tuple[int, str]
"""A line and how deep it stands in."""


def permissions_xml(grant: Grant) -> str:
    """The document with this one grant, ending in a line feed."""
    lines: list[_Line] = [(0, _DDS), (1, "<permissions>"), *_grant(grant), (1, "</permissions>"), (0, "</dds>")]
    return "".join(f"{_INDENT * depth}{line}\n" for depth, line in lines)


def _grant(grant: Grant) -> Iterator[_Line]:
    yield 2, f'<grant name="{html(grant.name)}">'
    yield 3, _element("subject_name", grant.subject_name)
    yield 3, "<validity>"
    yield 4, _element("not_before", grant.not_before)
    yield 4, _element("not_after", grant.not_after)
    yield 3, "</validity>"
    for rule in grant.rules:
        yield from _rule(rule)
    yield 3, f"<default>{'ALLOW' if grant.default_allow else 'DENY'}</default>"
    yield 2, "</grant>"


def _rule(rule: Rule) -> Iterator[_Line]:
    name = "allow_rule" if rule.allow else "deny_rule"
    yield 3, f"<{name}>"
    yield from _domains(rule.domains)
    for criterion in rule.criteria:
        yield from _criterion(criterion)
    yield 3, f"</{name}>"


def _domains(domains: Iterable[DomainRange]) -> Iterator[_Line]:
    yield 4, "<domains>"
    for each in domains:
        if each.low == each.high:
            yield 5, f"<id>{each.low}</id>"
        else:
            yield 5, "<id_range>"
            yield 6, f"<min>{each.low}</min>"
            yield 6, f"<max>{each.high}</max>"
            yield 5, "</id_range>"
    yield 4, "</domains>"


def _criterion(criterion: Criterion) -> Iterator[_Line]:
    """A criterion in the default partition."""
    yield 4, f"<{criterion.operation.value}>"
    yield 5, "<topics>"
    for topic in criterion.topics:
        yield 6, _element("topic", topic)
    yield 5, "</topics>"
    yield 4, f"</{criterion.operation.value}>"


def _element(name: str, text: Text) -> str:
    return f"<{name}>{html(text.text)}</{name}>"
