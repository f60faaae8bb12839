"""The formats of an audit's report; each writer is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from keystore_audit.report.content import NoReport, Report, View

FORMATS: Final = ("text", "json", "sarif", "junit", "markdown", "html", "statement", "svr")
"""`statement` and `svr`: unsigned in-toto statements with the predicate test-result/v0.1, or svr/v0.2."""

HTML: Final = "html"
"""The format that draws: an audit has to work out what pictures show (`Options.overview`)."""


def pieces(
    kind: str, reports: Sequence[Report], view: View, *, several: bool, missing: Sequence[NoReport] = ()
) -> Iterable[str]:
    """What `render` returns, in pieces where that spares memory."""
    if kind != "json" or several:
        return (render(kind, reports, view, several=several, missing=missing),)
    from keystore_audit.report import json

    return json.pieces(reports[0])


def render(kind: str, reports: Sequence[Report], view: View, *, several: bool, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports in a format; `several`: more than one keystore was given, whatever came of them.

    `missing`: those of which there is no report. Each format says so, save statements: they are about files that were
    read.
    """
    if kind == "json":
        from keystore_audit.report import json

        return json.render_several(reports, missing) if several else json.render(reports[0])
    if kind == "sarif":
        from keystore_audit.report import sarif
        from keystore_audit.rules import RULES

        return sarif.render(reports, RULES, missing)
    if kind == "junit":
        from keystore_audit.report import junit

        return junit.render(reports, missing)
    if kind == "markdown":
        from keystore_audit.report import markdown

        return markdown.render(reports, view.min_severity, missing)
    if kind == HTML:
        from keystore_audit.report import html

        return html.render(reports, view.min_severity, missing)
    if kind in ("statement", "svr"):
        from keystore_audit.report import statement

        return statement.render_svr(reports) if kind == "svr" else statement.render_test_result(reports)
    from keystore_audit.report import text

    return text.render_several(reports, view, missing) if several else text.render(reports[0], view)
