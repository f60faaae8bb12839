"""The last lines of a text about several keystores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from keystore_audit.report.content import NoReport, Verdict
from keystore_audit.report.page import Page
from keystore_audit.text import shorten

MAX_PATH: Final = 400
"""Characters of a path."""


def render_total(
    verdicts: Sequence[Verdict], missing: Sequence[NoReport] = (), *, width: int, color: bool = False
) -> str:
    """Return the line that sums up several reports, after one for each keystore that has none."""
    counts = Counter(verdicts)
    page = Page(width=width, color=color)
    for each in missing:
        said = f"{shorten(each.path, MAX_PATH)}: {each.reason}"
        page.labelled("NO REPORT", said, indent=0, column=11, style="bold magenta")
    words = [f"{counts[verdict]} {verdict.value}" for verdict in Verdict]
    if missing:
        words.insert(0, f"{len(missing)} without a report")
    page.put((f"{len(verdicts) + len(missing)} keystores: {', '.join(words)}", "bold"))
    return page.render()
