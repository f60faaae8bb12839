"""Lines of documents that findings show: taken while the files are at hand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Final

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.text import shorten

MAX_EXCERPT: Final = 200
"""Characters of a line."""


def excerpts(keystore: Keystore, findings: Sequence[Finding]) -> dict[tuple[str, int], str]:
    """The lines of signed documents that findings name first: nothing of a file in which a private key may be."""
    files = chain((keystore.layout.governance,), *(each.files.every for each in keystore.enclaves))
    documents = {each.place: each for each in files if each is not None and each.place.endswith(".p7s")}
    split: dict[str, list[bytes]] = {}
    found = {}
    for finding in findings:
        place = next((each for each in finding.locations if each.line is not None), None)
        if place is None or place.line is None or not finding.severity.at_least(Severity.MEDIUM):
            continue
        file = documents.get(place.path)
        if file is None or file.content is None or file.holds_private_key:
            continue
        lines = split.get(place.path) or split.setdefault(place.path, file.content.split(b"\n"))
        line = lines[place.line - 1].decode("utf-8", "replace").strip() if place.line <= len(lines) else ""
        if line.startswith("<") and not line.startswith("<!"):  # of the XML, and of no signature, nor of a DTD
            found[place.path, place.line] = shorten(line, MAX_EXCERPT)
    return found
