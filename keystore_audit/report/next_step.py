"""What to do first: the last line that people read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.findings import OF_THE_AUDIT, Finding
from keystore_audit.report.content import Report, Verdict
from keystore_audit.text import counted, some

PROPERTY: Final = "KA906"
"""A property that is undecided: it follows from whatever else is."""

MAX_CODES: Final = 6
"""Codes named of what is left."""


def next_step(report: Report) -> str:
    """Which finding to mend first and how to read more of it; empty where nothing stands in the way."""
    undecided = [finding for finding in report.findings if finding.undecided]
    failing = [finding for finding in report.findings if finding.fails(report.fail_on) and not finding.undecided]
    if report.verdict is Verdict.PASS or not (undecided or failing):
        return ""
    first = _first(undecided or failing)
    inside = [location for location in first.locations if not location.beside]  # what is asserted elsewhere is no fault
    place = next(iter((*inside, *first.locations)), None)
    where = "" if place is None else f" ({place})"
    more = sum(first.fingerprint in finding.explained_by for finding in report.findings)
    follow = f", from which {counted(more, 'other')} follow{'s' if more == 1 else ''}" if more else ""
    told = f"{first.code} {first.name}{where}{follow}"
    left = _besides(first, failing)
    then = _then(len(_besides(first, undecided)), len(left), _causes(left))
    return f"Mend first: {told}.{then} `keystore-audit explain {first.code}` says more."


def _first(wanted: Sequence[Finding]) -> Finding:
    """The cause of the worst of these, itself where none of them is; of equal ones the report's first that is a cause.

    A cause may be less bad than what follows from it, and worse than what stands above it.
    """
    places = {finding.fingerprint: place for place, finding in enumerate(wanted)}
    ranked = [
        (
            wanted[cause].code.startswith(OF_THE_AUDIT),  # it follows, or nobody can mend it in a keystore
            wanted[cause].code == PROPERTY,
            finding.severity.rank,
            bool(wanted[cause].explained_by),
            cause,
        )
        for place, finding in enumerate(wanted)
        for cause in [places[mark] for mark in finding.explained_by if mark in places] or [place]
    ]
    return wanted[min(ranked)[-1]]


def _besides(first: Finding, findings: Sequence[Finding]) -> list[Finding]:
    """What is left when `first` is mended."""
    mark = first.fingerprint
    return [each for each in findings if each.fingerprint != mark and mark not in each.explained_by]


def _causes(findings: Sequence[Finding]) -> str:
    """The codes of those that follow from none of the others, the worst first: a critical one may stand far above."""
    marks = {each.fingerprint for each in findings}
    codes = dict.fromkeys(each.code for each in findings if not marks & {*each.explained_by})
    return some(codes, MAX_CODES)


def _then(undecided: int, failing: int, codes: str) -> str:
    """What is left then, and of what: so many findings that leave the audit open, so many that fail the gate."""
    told = []
    if undecided:
        told.append(f"{undecided} more that leave{'s' if undecided == 1 else ''} the audit open")
    if failing:
        more = "" if undecided else "more "
        told.append(f"{failing} {more}that fail{'s' if failing == 1 else ''} the gate: {codes}")
    return f" Then {' and '.join(told)}." if told else ""
