"""The access table as CSV: one row a right, safe to open in a spreadsheet."""

from __future__ import annotations

import csv as writer
from collections.abc import Iterator
from io import StringIO
from typing import Final

from keystore_audit.model.question import Ruling
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable, Group
from keystore_audit.text import csv_cell

HEADER: Final = (
    "profiles", "enclave", "usable", "operation", "name", "topic", "partition", "decision", "effective",
)  # fmt: skip
_USABLE: Final = {True: "yes", False: "no", None: "unknown"}


def csv(table: AccessTable) -> str:
    """RFC 4180, with a header; what is denied by everybody has no row."""
    out = StringIO()
    rows = writer.writer(out, lineterminator="\r\n")
    rows.writerow(HEADER)
    for group in table.groups:
        for row in _rows(table, group):
            rows.writerow([csv_cell(cell) for cell in row])
    return out.getvalue()


def _rows(table: AccessTable, group: Group) -> Iterator[tuple[str, ...]]:
    profiles = " ".join(group.profiles)
    for path, enclave in group.enclaves.items():
        for operation in enclave.rights:
            start = (profiles, path, _USABLE[enclave.usable], operation.value)
            otherwise = enclave.otherwise(operation, table.rest)
            if any(ruling is not Ruling.DENY for ruling in otherwise):
                yield (*start, "any other name", "", "", *(ruling.value for ruling in otherwise))
            for number, decision, effective in enclave.exceptions(operation, table.rest):
                named = table.names[number]
                yield (
                    *start, label(table, number), named.topic, named.partition, decision.value, effective.value,
                )  # fmt: skip
