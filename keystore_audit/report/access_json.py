"""The access table for programs: as JSON (docs/reference.md, `schemas/access.schema.json`), and as CSV."""

from __future__ import annotations

import csv as writer
from collections.abc import Iterable, Iterator
from io import StringIO
from typing import Any, Final

from keystore_audit import __version__
from keystore_audit.model.formal.rights import Safeguard
from keystore_audit.model.names import ros_name
from keystore_audit.model.question import Ruling
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable, EnclaveRights, Group
from keystore_audit.report.content import answered_if
from keystore_audit.report.encoded import array, document, encoded, keys, picked
from keystore_audit.text import csv_cell, instant

SCHEMA_VERSION: Final = 1

HEADER: Final = (
    "profiles", "enclave", "usable", "operation", "name", "topic", "partition", "decision", "effective",
)  # fmt: skip
_USABLE: Final = {True: "yes", False: "no", None: "unknown"}


def json(table: AccessTable) -> str:
    """A line for each name, enclave and right; ends in a newline."""
    head = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "keystore-audit", "version": __version__},
        "keystore": {"path": table.root},
        "at": instant(table.at),
        "domain": table.domain,
        "complete": not table.has_unknown,
        "assumptions": [each.described for each in answered_if(n for group in table.groups for n in group.profiles)],
    }
    names = array("names", [encoded(_name(table, number)) for number in range(len(table.names))])
    return document([*keys(head), names, array("groups", [_group(table, group) for group in table.groups])])


def _name(table: AccessTable, number: int) -> dict[str, Any]:
    named = table.names[number]
    ros = ros_name(named.topic) if named.ros else None
    one = not named.several
    return {**picked(named, "topic", "partition"), "ros": ros, "one": one, "expressions": named.expressions}


def _group(table: AccessTable, group: Group) -> str:
    enclaves = [encoded(_enclave(table, path, enclave)) for path, enclave in group.enclaves.items()]
    parts = [
        f'      "profiles": {encoded(group.profiles)}',
        array("protection", [encoded([*map(_safeguard, several)]) for several in group.safeguards], 6),
        array("enclaves", enclaves, 6),
        array("rights", [encoded(right) for right in _rights(table, group)], 6),
    ]
    return "{\n" + ",\n".join(parts) + "\n    }"


def _safeguard(safeguard: Safeguard) -> dict[str, Any]:
    return {
        **picked(safeguard, "governed", "encrypted", "authenticated"),
        "read_access_control": safeguard.read_controlled,
        "write_access_control": safeguard.write_controlled,
        "unauthenticated_participants": safeguard.unauthenticated,
    }


def _enclave(table: AccessTable, path: str, enclave: EnclaveRights) -> dict[str, Any]:
    otherwise = {operation: _rulings(enclave.otherwise(operation, table.rest)) for operation in enclave.rights}
    return {"path": path, **picked(enclave, "usable", "reasons"), "otherwise": otherwise}


def _rights(table: AccessTable, group: Group) -> Iterator[dict[str, Any]]:
    """Where something else holds than `otherwise`."""
    for path, enclave in group.enclaves.items():
        for operation in enclave.rights:
            for number, *rulings in enclave.exceptions(operation, table.rest):
                named = picked(table.names[number], "topic", "partition")
                yield {"enclave": path, "operation": operation, **named, **_rulings(rulings)}


def _rulings(both: Iterable[Ruling]) -> dict[str, Ruling]:
    return dict(zip(("decision", "effective"), both, strict=True))


def csv(table: AccessTable) -> str:
    """RFC 4180, one row a right, safe to open in a spreadsheet; what is denied by everybody has no row."""
    out = StringIO()
    rows = writer.writer(out, lineterminator="\r\n")
    rows.writerow(HEADER)
    for group in table.groups:
        for row in _csv_rows(table, group):
            rows.writerow([csv_cell(cell) for cell in row])
    return out.getvalue()


def _csv_rows(table: AccessTable, group: Group) -> Iterator[tuple[str, ...]]:
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
