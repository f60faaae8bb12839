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
        place = place_of(finding)
        if place is None or not finding.severity.at_least(Severity.MEDIUM):
            continue
        path, number = place
        file = documents.get(path)
        if file is None or file.content is None or file.holds_private_key:
            continue
        lines = split.get(path) or split.setdefault(path, file.content.split(b"\n"))
        line = lines[number - 1].decode("utf-8", "replace").strip() if number <= len(lines) else ""
        if line.startswith("<") and not line.startswith("<!"):  # of the XML, and of no signature, nor of a DTD
            found[place] = shorten(line, MAX_EXCERPT)
    return found


def place_of(finding: Finding) -> tuple[str, int] | None:
    """The path and the number of the line that the finding names first; None where it names none."""
    return next(((each.path, each.line) for each in finding.locations if each.line is not None), None)
