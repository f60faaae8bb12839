"""Which enclaves can start: those that cannot with their reasons, the others together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from keystore_audit.report.content import EnclaveEntry
from keystore_audit.report.html.element import Html, element, folded, items, joined, lines, name, some
from keystore_audit.report.html.sheet import FULL, Sheet
from keystore_audit.report.paragraph import by_answer
from keystore_audit.report.ros_nodes import nodes_beside
from keystore_audit.text import counted

MAX_REFUSED: Final = 100
"""Enclaves that cannot start, with their reasons."""

MAX_NAMED: Final = 1000
"""Enclaves that are named."""

_OPEN: Final = 30
_WORDS: Final[Mapping[bool | None, str]] = {True: "starts", False: "does not start", None: "cannot be told"}


def starting(sheet: Sheet) -> Html:
    """Return who can start, under which profiles."""
    entries = sheet.report.enclaves
    well = [entry for entry in entries if all(usability.usable for usability in entry.profiles.values())]
    refused = [entry for entry in entries if not all(usability.usable for usability in entry.profiles.values())]
    parts: list[Html] = [element("article", joined(_entry(sheet, entry))) for entry in refused[:MAX_REFUSED]]
    if len(refused) > MAX_REFUSED:
        parts.append(element("p", f"{len(refused) - MAX_REFUSED} more cannot start. {FULL}", class_="soft"))
    if well:
        listed = some([entry.path for entry in well], MAX_NAMED)
        head = f"{counted(len(well), 'enclave')} can start under every profile"
        parts.append(folded(head, items(listed, class_="names"), open_=len(well) <= _OPEN, class_="space"))
    if beside := nodes_beside(sheet.report.findings):
        parts.append(element("p", beside, class_="soft"))
    return lines(parts)


def _entry(sheet: Sheet, entry: EnclaveEntry) -> list[Html]:
    told = [element("p", name(entry.path), " ", element("code", entry.directory, class_="place"))]
    for usability, profiles in by_answer(entry.profiles).items():
        under = sheet.under(tuple(profiles)) or "under every profile"
        words = element("strong" if not usability.usable else "span", _WORDS[usability.usable])
        told.append(element("p", words, f" {under}", class_="under"))
        told.append(items(usability.reasons))
    return told
