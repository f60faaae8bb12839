"""Baselines: today's findings, accepted one by one until a day (docs/settings.md, `schemas/baseline.schema.json`)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from datetime import date
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.options import Options, Progress
from keystore_audit.pipeline import audit
from keystore_audit.profiles import DEFAULT
from keystore_audit.report.content import Verdict
from keystore_audit.settings.settings import MAX_BASELINE_BYTES, Baseline
from keystore_audit.settings.suppressions import MAX_DAYS, Fate, Suppression, Use, acceptable, check_dates, uses
from keystore_audit.text import shorten, terminal

HEAD: Final = """\
# Findings that are accepted, each by its fingerprint: docs/settings.md of keystore-audit.
# Written by `keystore-audit baseline create` and `keystore-audit baseline prune`.
"""

MAX_NOTE: Final = 300
"""Characters of what is noted of a finding."""


class Created(Struct, frozen=True, kw_only=True):
    """A new baseline: its text, how many findings it accepts, and how many of those found nobody may accept.

    `complete`: whether the audit could decide everything.
    """

    text: str
    accepted: int
    refused: int
    complete: bool


class Pruned(Struct, frozen=True, kw_only=True):
    """A baseline without what no longer does anything: its text, how many entries it keeps, and those it loses.

    `complete`: whether the audit could decide everything. Where it could not, entries that nothing matches are kept,
    and are `doubtful`.
    """

    text: str
    kept: int
    dropped: tuple[Use, ...]
    doubtful: int
    complete: bool


def create(
    keystore: str,
    options: Options,
    *,
    reason: str,
    owner: str,
    until: date,
    least: Severity = Severity.INFO,
    progress: Progress | None = None,
) -> Created:
    """Accepts every finding of severity `least` or worse that may be accepted and is not yet.

    Raises errors.UsageError for a date that has passed or is too far away, and what `audit.audit` raises.
    """
    entry = Suppression(
        code="KA101",
        reason=terminal(reason),
        owner=terminal(owner),
        until=until,
        location=Location(""),
        place="--until",
    )
    if options.at > entry.end:
        raise UsageError(f"--until {until} has passed at the audit's time.")
    check_dates([entry], options.at, options.settings.max_suppression_days if options.settings else MAX_DAYS)
    report = audit(keystore, replace(options, baseline=None), progress=progress)
    found = [f for f in report.findings if f.severity.at_least(least) and f.suppressed is None]
    chosen = frozenset(report.judged_profiles)
    accepted = [_suppression(entry, finding, chosen) for finding in found if acceptable(finding)]
    text = written(accepted)
    if len(text.encode()) > MAX_BASELINE_BYTES:
        raise UsageError(f"{len(accepted)} findings are too many for a baseline: fix some, or see --min-severity.")
    return Created(
        text=text,
        accepted=len(accepted),
        refused=len(found) - len(accepted),
        complete=report.verdict is not Verdict.INCOMPLETE,
    )


def prune(baseline: Baseline, keystore: str, options: Options, progress: Progress | None = None) -> Pruned:
    """Drops the entries that have ended, and those that accept nothing in an audit that could decide everything.

    Raises what `audit.audit` raises.
    """
    report = audit(keystore, replace(options, baseline=None), progress=progress)
    complete = report.verdict is not Verdict.INCOMPLETE
    files = uses(report.findings, baseline.suppressions, options.at, report.judged_profiles)
    told = [use for file in files for use in file.uses]
    dropped = [use for use in told if use.fate is Fate.ENDED or (use.fate is Fate.UNUSED and complete)]
    kept = [use.suppression for use in told if use not in dropped]
    return Pruned(
        text=written(kept),
        kept=len(kept),
        dropped=tuple(dropped),
        doubtful=sum(use.fate is Fate.UNUSED for use in told if not complete),
        complete=complete,
    )


def written(suppressions: Iterable[Suppression]) -> str:
    """The entries as TOML, in an order of their own: the same for the same entries."""
    ordered = sorted(suppressions, key=lambda each: (each.code, each.finding, each.fingerprint or ""))
    return HEAD + "".join("\n[[accepted]]\n" + "".join(f"{line}\n" for line in _lines(each)) for each in ordered)


def _lines(entry: Suppression) -> Iterator[str]:
    yield f"code = {_quoted(entry.code)}"
    yield f"fingerprint = {_quoted(entry.fingerprint or '')}"
    yield f"meaning = {_quoted(entry.meaning or '')}"
    if entry.severity is not None:
        yield f"severity = {_quoted(entry.severity.value)}"
    if entry.profiles is not None:
        yield f"profiles = [{', '.join(map(_quoted, sorted(entry.profiles)))}]"
    if entry.finding:
        yield f"finding = {_quoted(entry.finding)}"
    yield f"reason = {_quoted(entry.reason)}"
    yield f"owner = {_quoted(entry.owner)}"
    yield f"until = {entry.until.isoformat()}"


def _quoted(text: str) -> str:
    """A basic string of TOML: JSON's, but for DEL, which TOML has escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _suppression(entry: Suppression, finding: Finding, chosen: frozenset[str]) -> Suppression:
    """The entry for one finding; `chosen`: what a finding without profiles is about, None standing for all of them."""
    path = finding.locations[0].path if finding.locations else ""
    note = f"{' '.join(filter(None, (finding.enclave, path)))}: {finding.message}".removeprefix(": ")
    everywhere = not finding.profiles and chosen.issuperset(DEFAULT)
    return replace(
        entry,
        code=finding.code,
        fingerprint=finding.fingerprint,
        severity=finding.severity,
        profiles=None if everywhere else frozenset(finding.profiles) or chosen,
        meaning=finding.meaning,
        finding=shorten(terminal(note), MAX_NOTE),
    )
