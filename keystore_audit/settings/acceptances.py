"""Accepted findings in settings (`[[suppression]]`) and in baselines (`[[accepted]]`), table by table."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Annotated, Final

from msgspec import Meta

from keystore_audit.findings import MAX_OWNER, MAX_REASON, OF_THE_AUDIT, Severity
from keystore_audit.profiles import VARIANTS, facts
from keystore_audit.settings.document import Source, Table, Texts, several
from keystore_audit.settings.suppressions import ALL, Acceptance

Code = Annotated[str, Meta(pattern=r"^KA[0-9]{3}\Z", description="one rule's code, e.g. KA203, and no family")]
Digest = Annotated[
    str, Meta(pattern=r"^[0-9a-f]{64}\Z", description="64 digits 0 to 9 and a to f, as in the JSON report")
]
_WORDS: Final = "words, and not only spaces"


class _AcceptanceTable(Table, frozen=True, kw_only=True):
    """What both kinds of tables have. `profiles`: None, any; `until`: the last day."""

    code: Code
    profiles: Texts | None = None
    reason: Annotated[str, Meta(max_length=MAX_REASON, pattern=r"\S", description=_WORDS)]
    owner: Annotated[str, Meta(max_length=MAX_OWNER, pattern=r"\S", description=_WORDS)]
    until: date


class SuppressionTable(_AcceptanceTable, frozen=True, kw_only=True):
    """A `[[suppression]]`: at places, or with a fingerprint."""

    where: Texts | None = None
    fingerprint: Digest | None = None
    meaning: Digest | None = None
    severity: Severity | None = None


class AcceptedTable(_AcceptanceTable, frozen=True, kw_only=True):
    """An `[[accepted]]` finding. `severity`: the worst that is accepted; `finding`: what it says, for people."""

    fingerprint: Digest
    meaning: Digest
    severity: Severity
    finding: str = ""


def read_suppressions(tables: Sequence[SuppressionTable], source: Source) -> tuple[Acceptance, ...]:
    """The `[[suppression]]` tables of settings. Raises errors.UsageError."""
    return tuple(_suppression(table, source.at(number)) for number, table in enumerate(tables))


def _suppression(table: SuppressionTable, source: Source) -> Acceptance:
    if (table.where is None) == (table.fingerprint is None):
        source.wrong("expected exactly one of where, fingerprint")
    if table.where is not None and table.meaning is not None:
        source.at("meaning").wrong("this belongs to a fingerprint, and here is where")
    if table.fingerprint is not None and table.meaning is None:
        source.wrong("missing key `meaning`")
    where, here = several(table.where), source.at("where")
    if ALL in where and len(where) > 1:
        here.wrong(f'"{ALL}" is everything: expected it alone')
    for glob in where:
        if glob.startswith("./") or "//" in glob or ".." in glob.split("/"):
            here.wrong(f'{glob!r}: expected an enclave ("/arm/*"), or a path in the keystore ("public/*")')
    return _acceptance(table, source, where)


def read_accepted(tables: Sequence[AcceptedTable], source: Source) -> tuple[Acceptance, ...]:
    """The `[[accepted]]` tables of a baseline. Raises errors.UsageError."""
    seen: dict[str, str] = {}
    read = []
    for number, table in enumerate(tables):
        here = source.at(number)
        if table.fingerprint in seen:
            here.at("fingerprint").wrong(f"this one is accepted already, at {seen[table.fingerprint]}")
        seen[table.fingerprint] = here.place
        read.append(_acceptance(table, here, (), table.finding))
    return tuple(read)


def _acceptance(
    table: SuppressionTable | AcceptedTable,
    source: Source,
    where: tuple[str, ...],
    finding: str = "",
) -> Acceptance:
    if table.code.startswith(OF_THE_AUDIT):
        source.at("code").wrong(f"{table.code} is about the audit itself, which nothing accepts")
    for name in several(table.profiles):
        if name not in VARIANTS:  # what an alias stands for changes from version to version
            expected = f"expected names as in reports, e.g. {facts.EXAMPLE_PROFILE}"
            source.at("profiles").wrong(f"{name!r} is no profile; {expected}")
    return Acceptance(
        code=table.code,
        where=where,
        fingerprint=table.fingerprint,
        severity=table.severity,
        profiles=None if table.profiles is None else frozenset(several(table.profiles)),
        meaning=table.meaning,
        reason=table.reason,
        owner=table.owner,
        until=table.until,
        location=source.location,
        place=source.place,
        until_place=source.at("until").place,
        finding=finding,
    )
