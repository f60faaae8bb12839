"""What a run says, as rows of tables: the same for a keystore audited here and one audited on another machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any, Final

from keystore_audit.findings import Severity
from keystore_audit.keystore.identity import Identity
from keystore_audit.report.content import Report

Rows = Mapping[str, Sequence[tuple[Any, ...]]]
"""By table; each row has the values of its columns, in their order."""

COLUMNS: Final[Mapping[str, Mapping[str, str]]] = {
    "keystores": {
        "at": "instant",
        "keystore": "text",
        "digest": "text",
        "layout": "text",
        "verdict": "text",
        "exit_code": "number",
        "enclaves": "number",
        "safe_until": "instant",
        "safe_until_why": "text",
        **{severity.value: "number" for severity in Severity},
        "error": "text",
    },
    "findings": {
        "at": "instant",
        "keystore": "text",
        "code": "text",
        "name": "text",
        "severity": "text",
        "message": "text",
        "enclave": "text",
        "path": "text",
        "line": "number",
        "profiles": "texts",
        "fingerprint": "text",
        "explained_by": "texts",
        "accepted_until": "text",
    },
    "enclaves": {
        "at": "instant",
        "keystore": "text",
        "enclave": "text",
        "directory": "text",
        "subject": "text",
        "profile": "text",
        "usable": "answer",
        "reasons": "texts",
    },
    "identities": {
        "at": "instant",
        "keystore": "text",
        "enclave": "text",
        "path": "text",
        "subject": "text",
        "issuer": "text",
        "key": "text",
        "not_before": "instant",
        "not_after": "instant",
    },
    "properties": {
        "at": "instant",
        "keystore": "text",
        "property": "text",
        "profile": "text",
        "status": "text",
        "native": "text",
        "alloy": "text",
    },
}
"""Of each table its columns, and of each column what its values are; any may be null, but `at` and `keystore`.

`answer` is true, false, or null for unknown. An empty `profiles` means all.
"""


def rows_of(keystore: str, report: Report) -> Rows:
    """The rows of one report; `keystore`: its path as it was given."""
    counts = (report.summary[severity] for severity in Severity)
    start = (report.at, keystore)
    own = (
        *start,
        report.digest,
        report.layout,
        report.verdict.value,
        report.exit_code,
        len(report.enclaves),
        report.safe_until,
        report.safe_until_why or None,
        *counts,
        None,
    )
    return {
        "keystores": [own],
        "findings": list(_findings(start, report)),
        "enclaves": list(_enclaves(start, report)),
        "properties": list(_properties(start, report)),
    }


def rows_without_report(keystore: str, at: datetime, exit_code: int, error: str) -> Rows:
    """The row of a keystore that has no report; `error`: why."""
    return {"keystores": [(at, keystore, None, None, None, exit_code, *[None] * (3 + len(Severity)), error)]}


def rows_of_identities(keystore: str, at: datetime, identities: Sequence[Identity]) -> Rows:
    """The rows of a keystore's identities."""
    return {
        "identities": [
            (
                at,
                keystore,
                identity.enclave,
                identity.path,
                identity.subject,
                identity.issuer,
                identity.key,
                identity.not_before,
                identity.not_after,
            )
            for identity in identities
        ]
    }


def _findings(start: tuple[Any, ...], report: Report) -> Iterator[tuple[Any, ...]]:
    for finding in report.findings:
        place = finding.locations[0] if finding.locations else None
        yield (
            *start,
            finding.code,
            finding.name,
            finding.severity.value,
            finding.message,
            finding.enclave,
            place.path if place else None,
            place.line if place else None,
            list(finding.profiles),
            finding.fingerprint,
            list(finding.explained_by),
            finding.suppressed.until if finding.suppressed else None,
        )


def _enclaves(start: tuple[Any, ...], report: Report) -> Iterator[tuple[Any, ...]]:
    for entry in report.enclaves:
        for profile, usability in entry.profiles.items():
            who = (entry.path, entry.directory, entry.subject)
            yield (*start, *who, profile, usability.usable, list(usability.reasons))


def _properties(start: tuple[Any, ...], report: Report) -> Iterator[tuple[Any, ...]]:
    for result in report.properties:
        for profile, answer in result.profiles.items():
            said = {engine: status.value for engine, status in answer.engines.items()}
            yield (*start, result.prop.id, profile, answer.status.value, said.get("native"), said.get("alloy"))
