"""What every section of a page is drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Finding, Severity
from keystore_audit.properties.property import Status
from keystore_audit.report.content import Report
from keystore_audit.report.html.element import Html, element

FULL: Final = "The JSON report has all (--format json)."
"""Where to find what a page leaves out."""


class Sheet(Struct, frozen=True, kw_only=True):
    """One report on the page. `prefix`: of every id of its part. `shown`: its findings that are not hidden.

    `numbers`: by enclave path, a number for ids.
    """

    report: Report
    prefix: str
    shown: tuple[Finding, ...]
    profiles: tuple[str, ...]
    numbers: Mapping[str, int]

    def anchor(self, kind: str, number: int | str = "") -> str:
        """Return the id of a part of this report."""
        return f"{self.prefix}{kind}{f'-{number}' if number != '' else ''}"

    def under(self, names: tuple[str, ...]) -> str:
        """Return for which profiles something holds, in words; empty for all."""
        return "" if not names or set(self.profiles) <= set(names) else f"under {', '.join(names)}"


def sheet(report: Report, prefix: str, least: Severity) -> Sheet:
    """Return the sheet of a report; findings below `least` are hidden."""
    return Sheet(
        report=report,
        prefix=prefix,
        shown=report.shown(least),
        profiles=report.judged_profiles,
        numbers={entry.path: number for number, entry in enumerate(report.enclaves)},
    )


_MARKS: Final = {
    Severity.CRITICAL: "◆",
    Severity.HIGH: "▲",
    Severity.MEDIUM: "■",
    Severity.LOW: "●",
    Severity.INFO: "○",
}
"""A shape for each severity, so that none is known by its colour alone."""

_STATUS_MARKS: Final = {Status.HOLDS: "✓", Status.VIOLATED: "✗", Status.UNKNOWN: "?"}


def severity(value: Severity) -> Html:
    """Return a severity: shape, word and colour."""
    mark = element("span", _MARKS[value], class_="mark", aria_hidden="true")
    return element("span", mark, value.value, class_=f"chip {value.value}")


def status(value: Status) -> Html:
    """Return the status of a property: shape, word and colour."""
    mark = element("span", _STATUS_MARKS[value], class_="mark", aria_hidden="true")
    return element("span", mark, value.value, class_=f"chip {value.value}")
