"""Expressions put into signed permissions, and topics asked of the vendors' own access control plugins."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from keystore_audit.model.matching.expression import Pattern
from tests.keystore.documents import PERMISSIONS
from tests.oracles.fnmatch.libraries import Column
from tests.oracles.xml.ours import DocumentKind
from tests.oracles.xml.plugins import Plugin

_CRITERIA = b"<publish><topics><topic>rt/chatter</topic></topics></publish>"
assert _CRITERIA in PERMISSIONS


def ask_two(plugin: Plugin, first: Pattern, second: Pattern, names: Sequence[str]) -> tuple[Column, Column]:
    """One as what may be published, one as what may be subscribed: two columns for one document."""
    criteria = "".join(
        f"<{operation}><topics><topic>{escape(pattern.text)}</topic></topics></{operation}>"
        for operation, pattern in (("publish", first), ("subscribe", second))
    )
    document = PERMISSIONS.replace(_CRITERIA, criteria.encode())
    answer = plugin.ask(plugin.sign(document), DocumentKind.PERMISSIONS, *names)
    assert answer.refused is None, (first.text, second.text, answer.refused)
    flags = [answer.topics[name] for name in names]
    return [flag[0] == "w" for flag in flags], [flag[1] == "r" for flag in flags]
