"""What to do first: the last line that people read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.findings import Finding
from keystore_audit.report.content import Report, Verdict

OF_THE_AUDIT: Final = "KA9"
"""The family of what the audit says of itself: it follows from something else, or nobody can mend it in a keystore."""


def next_step(report: Report) -> str:
    """Which finding to mend first and how to read more of it; empty where nothing stands in the way."""
    wanted = _in_the_way(report)
    if not wanted:
        return ""
    first = min(wanted, key=lambda finding: finding.code.startswith(OF_THE_AUDIT))  # the report's order: worst first
    inside = [location for location in first.locations if not location.beside]  # what is asserted elsewhere is no fault
    place = next(iter((*inside, *first.locations)), None)
    where = "" if place is None else f" ({place.path}{'' if place.line is None else f':{place.line}'})"
    more = sum(first.fingerprint in finding.explained_by for finding in report.findings)
    follow = f", from which {more} other{'' if more == 1 else 's'} follow{'s' if more == 1 else ''}" if more else ""
    rest = len(wanted) - 1 - sum(first.fingerprint in finding.explained_by for finding in wanted)
    others = f" Then {rest} more." if rest > 0 else ""
    told = f"{first.code} {first.name}{where}{follow}"
    return f"Mend first: {told}.{others} `keystore-audit explain {first.code}` says more."


def _in_the_way(report: Report) -> Sequence[Finding]:
    """The findings without which the verdict would be better, in the report's order."""
    counted = [finding for finding in report.findings if finding.suppressed is None]
    if report.verdict is Verdict.INCOMPLETE:
        return [finding for finding in counted if finding.undecided]
    if report.verdict is Verdict.FAIL:
        failing = [finding for finding in counted if report.fails(finding)]
        marks = {finding.fingerprint for finding in counted}
        causes = [finding for finding in failing if not marks.intersection(finding.explained_by)]
        return [*causes, *(finding for finding in failing if marks.intersection(finding.explained_by))]
    return ()
