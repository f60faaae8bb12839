"""Governance and permissions for the tests of their readers, and what it takes to hand them over."""

from __future__ import annotations

from pathlib import Path

from keystore_audit.keystore.smime import SignedDocument
from tests.keystore.builder import PERMISSIONS as _PERMISSIONS
from tests.keystore.builder import present

SHARED = Path(__file__).resolve().parents[3] / "shared"
"""The workplace's folder of facts and reference data, which a user's clone does not have."""

FIRST_LINE = 9
"""Where the XML of a stock message begins."""

PERMISSIONS = _PERMISSIONS.format(name="/talker").encode()


def signed(content: bytes | None, first_line: int | None = FIRST_LINE) -> SignedDocument:
    """A document whose envelope was read: `content` is its signed text."""
    return SignedDocument(
        file=present(b"", "enclaves/permissions.p7s"),
        content=content,
        first_line=first_line,
        embedded=(),
        signatures=(),
        defects=(),
    )
