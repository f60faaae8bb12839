"""What a run says, as rows of tables, the same wherever a keystore is audited; and the tables as Apache Parquet.

A table is a directory, with parts that are there whole or not at all.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.keystore.identity import Identity
from keystore_audit.report.content import Report
from keystore_audit.resources import flags

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
            (at, keystore, *(getattr(identity, column) for column in [*COLUMNS["identities"]][2:]))
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
            yield (*start, *who, profile, usability.usable.value, list(usability.reasons))


def _properties(start: tuple[Any, ...], report: Report) -> Iterator[tuple[Any, ...]]:
    for result in report.properties:
        for profile, answer in result.profiles.items():
            said = {engine: status.value for engine, status in answer.engines.items()}
            yield (*start, result.prop.id, profile, answer.status.value, said.get("native"), said.get("alloy"))


PART: Final = 20_000
"""Rows of a part: some MiB in memory, and a fleet has few files."""


def check_available() -> None:
    """Raise errors.UsageError, with what to install, if Parquet cannot be written here."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise UsageError("Parquet needs pyarrow: install keystore-audit[fleet].") from error


class Datasets:
    """The tables of one run below `directory`, which holds nothing else; a context manager, which writes what is left.

    Raises OSError where a part cannot be written.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._waiting: dict[str, list[tuple[Any, ...]]] = {table: [] for table in COLUMNS}
        self._parts: dict[str, int] = dict.fromkeys(COLUMNS, 0)

    def __enter__(self) -> Datasets:
        """Write rows until the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Write what is waiting; a table without rows has one part without rows."""
        for table, rows in self._waiting.items():
            if rows or not self._parts[table]:
                self._write(table)

    def add(self, rows: Rows) -> None:
        """Take rows, and write the parts that are full."""
        for table, added in rows.items():
            self._waiting[table] += added
            if len(self._waiting[table]) >= PART:
                self._write(table)

    def _write(self, table: str) -> None:
        from pyarrow import parquet

        folder = self._directory / table
        folder.mkdir(parents=True, exist_ok=True)
        name = f"part-{self._parts[table]:05}.parquet"
        draft = f".{name}.tmp"
        here = os.open(folder, flags("O_DIRECTORY", "O_NOFOLLOW"))
        try:
            descriptor = os.open(draft, flags("O_WRONLY", "O_CREAT", "O_EXCL", "O_NOFOLLOW"), 0o666, dir_fd=here)
            try:
                with open(descriptor, "wb") as file:
                    parquet.write_table(_table(COLUMNS[table], self._waiting[table]), file, compression="zstd")
                os.replace(draft, name, src_dir_fd=here, dst_dir_fd=here)
            except BaseException:
                os.unlink(draft, dir_fd=here)
                raise
        finally:
            os.close(here)
        self._parts[table] += 1
        self._waiting[table] = []


def _table(columns: Mapping[str, str], rows: list[tuple[Any, ...]]) -> Any:
    import pyarrow as pa

    kinds = {
        "text": pa.string(),
        "texts": pa.list_(pa.string()),
        "number": pa.int32(),
        "answer": pa.bool_(),
        "instant": pa.timestamp("s", tz="UTC"),
    }
    arrays = [
        pa.array([_value(row[place], kind) for row in rows], type=kinds[kind])
        for place, kind in enumerate(columns.values())
    ]
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    return pa.Table.from_arrays(arrays, schema=schema)


def _value(value: Any, kind: str) -> Any:
    """The value; of a text that is no Unicode (a path of odd bytes), what stands for it in every report."""
    if kind == "text" and value is not None:
        return _unicode(value)
    return [_unicode(each) for each in value] if kind == "texts" else value


def _unicode(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode()
