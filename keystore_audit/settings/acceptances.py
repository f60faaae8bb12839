"""Accepted findings in settings (`[[suppression]]`) and in baselines (`[[accepted]]`), table by table."""

from __future__ import annotations

import re
from typing import Final

from keystore_audit.findings import MAX_OWNER, MAX_REASON, OF_THE_AUDIT, SEVERITIES, Severity
from keystore_audit.profiles import VARIANTS
from keystore_audit.settings.suppressions import ALL, Acceptance
from keystore_audit.settings.table import Table

_CODE: Final = re.compile(r"KA[0-9]{3}")
_DIGEST: Final = re.compile(r"[0-9a-f]{64}")


def read_suppressions(root: Table) -> tuple[Acceptance, ...]:
    """The `[[suppression]]` tables of settings. Raises errors.UsageError."""
    return tuple(_suppression(table) for table in root.tables("suppression"))


def _suppression(table: Table) -> Acceptance:
    table.only("code", "where", "fingerprint", "meaning", "severity", "profiles", "reason", "owner", "until")
    if ("where" in table.values) == ("fingerprint" in table.values):
        table.wrong(None, "expected exactly one of where, fingerprint")
    by_place = "where" in table.values
    if by_place and "meaning" in table.values:
        table.wrong("meaning", "this belongs to a fingerprint, and here is where")
    return _acceptance(
        table,
        where=_where(table) if by_place else (),
        fingerprint=None if by_place else _digest(table, "fingerprint"),
        severity=Severity(table.choice("severity", SEVERITIES)) if "severity" in table.values else None,
        profiles=_profiles(table),
        meaning=None if by_place else _digest(table, "meaning"),
    )


def read_accepted(root: Table) -> tuple[Acceptance, ...]:
    """The `[[accepted]]` tables of a baseline. Raises errors.UsageError."""
    seen: dict[str | None, str] = {}
    read = []
    for table in root.tables("accepted"):
        accepted = _accepted(table)
        if accepted.fingerprint in seen:
            table.wrong("fingerprint", f"this one is accepted already, at {seen[accepted.fingerprint]}")
        seen[accepted.fingerprint] = accepted.place
        read.append(accepted)
    return tuple(read)


def _accepted(table: Table) -> Acceptance:
    table.only("code", "fingerprint", "meaning", "severity", "profiles", "finding", "reason", "owner", "until")
    if "severity" not in table.values:
        table.wrong(None, f"expected severity = one of {', '.join(SEVERITIES)}, the worst that is accepted")
    return _acceptance(
        table,
        fingerprint=_digest(table, "fingerprint"),
        severity=Severity(table.choice("severity", SEVERITIES)),
        profiles=_profiles(table),
        meaning=_digest(table, "meaning"),
        finding=table.text("finding") if "finding" in table.values else "",
    )


def _acceptance(
    table: Table,
    *,
    where: tuple[str, ...] = (),
    fingerprint: str | None,
    severity: Severity | None,
    profiles: frozenset[str] | None = None,
    meaning: str | None,
    finding: str = "",
) -> Acceptance:
    code = table.text("code")
    if not _CODE.fullmatch(code):
        table.wrong("code", f"{code!r} is no rule's code; expected one rule, e.g. KA203, and no family")
    if code.startswith(OF_THE_AUDIT):
        table.wrong("code", f"{code} is about the audit itself, which nothing accepts")
    return Acceptance(
        code=code,
        where=where,
        fingerprint=fingerprint,
        severity=severity,
        profiles=profiles,
        meaning=meaning,
        reason=_sentence(table, "reason", MAX_REASON),
        owner=_sentence(table, "owner", MAX_OWNER),
        until=table.day("until"),
        location=table.location,
        place=table.place(),
        until_place=table.place("until"),
        finding=finding,
    )


def _where(table: Table) -> tuple[str, ...]:
    globs = table.texts("where")
    if ALL in globs and len(globs) > 1:
        table.wrong("where", f'"{ALL}" is everything: expected it alone')
    for glob in globs:
        if glob.startswith("./") or "//" in glob or ".." in glob.split("/"):
            table.wrong("where", f'{glob!r}: expected an enclave ("/arm/*"), or a path in the keystore ("public/*")')
    return globs


def _digest(table: Table, key: str) -> str:
    value = table.text(key)
    if not _DIGEST.fullmatch(value):
        table.wrong(key, "expected 64 digits 0 to 9 and a to f, as in the JSON report")
    return value


def _profiles(table: Table) -> frozenset[str] | None:
    """Variants by their canonical names, as in reports: what an alias stands for changes from version to version."""
    if "profiles" not in table.values:
        return None
    names = table.texts("profiles")
    for name in names:
        if name not in VARIANTS:
            table.wrong("profiles", f"{name!r} is no profile; expected names as in reports, e.g. fastdds-3.6")
    return frozenset(names)


def _sentence(table: Table, key: str, most: int) -> str:
    text = table.text(key)
    if not text.strip():
        table.wrong(key, f"expected {key} = words, and found only spaces")
    if len(text) > most:
        table.wrong(key, f"expected at most {most} characters, found {len(text)}")
    return text
