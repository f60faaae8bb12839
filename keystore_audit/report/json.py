"""The report as JSON: the interface contract, key by key (docs/reference.md, `schemas/report.schema.json`).

Pure ASCII, so that no name of a keystore steers whatever shows it, and the same bytes for the same value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from keystore_audit.findings import Finding, Location, Outcomes, Result, Severity, Suppression
from keystore_audit.given import GivenFile
from keystore_audit.properties.result import AssertedResult, EngineRun, ProfileResult, PropertyResult
from keystore_audit.report.content import MAX_RANKED, Anchors, EnclaveEntry, NoReport, Report
from keystore_audit.report.encoded import BETWEEN, array, document, encoded, keys, told
from keystore_audit.text import instant

if TYPE_CHECKING:
    from keystore_audit.model.blast_radius import Ranking

SCHEMA_VERSION: Final = 1
"""Rises when a key is removed or changes its meaning."""

TOOL: Final = "keystore-audit"


def render(report: Report) -> str:
    """Return the report of one keystore, ending in a newline."""
    return _dump(_report(report), {"outcomes": _encoded(report.outcomes)})


def render_several(reports: Sequence[Report], missing: Sequence[NoReport] = ()) -> str:
    """Return the reports of several keystores in the order given, with the sum of their counts.

    `missing`: those that have no report (there was nothing to audit, or a fault).
    """
    summary = dict.fromkeys(Severity, 0)
    for report in reports:
        for severity, count in report.summary.items():
            summary[severity] += count
    described = [{**_report(report), "outcomes": _outcomes(report.outcomes)} for report in reports]
    values = {
        "schema_version": SCHEMA_VERSION,
        "reports": described,
        "missing": [{"path": each.path, "reason": each.reason, "exit_code": each.exit_code} for each in missing],
        "summary": counts(summary),
    }
    return _dump(values, {})


def _dump(values: Mapping[str, Any], ready: Mapping[str, Sequence[str]]) -> str:
    """A line for each key and for each item of a list. `ready`: the last keys, lists whose items are JSON already."""
    lines: list[str] = []
    for key, value in values.items():
        lines += [array(key, [*map(encoded, value)])] if isinstance(value, list) else keys({key: value})
    return document([*lines, *(array(key, items) for key, items in ready.items())])


def _report(report: Report) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": TOOL, "version": report.version},
        "keystore": {
            "path": report.keystore,
            "layout": report.layout,
            "digest": report.digest,
            "roots": list(report.roots),
        },
        "settings": None if report.settings is None else _file(report.settings),
        "baseline": None if report.baseline is None else _file(report.baseline),
        "inputs": [{"option": option, **_file(file)} for option, file in report.inputs],
        "at": instant(report.at),
        "safe_until": None if report.safe_until is None else instant(report.safe_until),
        "verdict": report.verdict.value,
        "exit_code": report.exit_code,
        "scope": report.scope or None,
        "weakened": list(report.weakened),
        "holds_if": report.holds_if or None,
        "assumptions": [each.described for each in report.assumptions],
        "stated": list(report.stated),
        "authorities": {each.role: anchors(each) for each in report.authorities},
        "engines": {run.name: _engine(run) for run in report.engines},
        "engines_agree": report.engines_agree,
        "enclaves": [_enclave(entry) for entry in report.enclaves],
        "properties": [_property(result) for result in report.properties],
        "findings": [_finding(finding, report.keystore) for finding in report.findings],
        "blast_radius": _rankings(report),
        "summary": counts(report.summary),
    }


def _outcomes(outcomes: Outcomes) -> list[dict[str, str]]:
    return [{"rule": rule, "subject": subject, "outcome": outcome.value} for rule, subject, outcome in outcomes]


def _encoded(outcomes: Outcomes) -> list[str]:
    """What `_outcomes` says, many items in a piece: a thousand enclaves have 80,000, of few rules and subjects."""
    ends = {outcome: f', "outcome": {encoded(outcome.value)}}}' for outcome in Result}
    known: dict[str, str] = {}
    pieces: list[str] = []
    for rule, subjects, results in outcomes.rows:
        start, place = f'{{"rule": {encoded(rule)}, "subject": ', 0
        names = [known.get(subject) or known.setdefault(subject, encoded(subject)) for subject in subjects]
        for outcome, count in results:
            told = names[place : place + count]
            pieces.append(f"{start}{f'{ends[outcome]}{BETWEEN}{start}'.join(told)}{ends[outcome]}")
            place += count
    return pieces


def anchors(found: Anchors) -> dict[str, Any]:
    """Who is trusted in a role, with what declares it."""
    return {
        "declared": [f"sha256:{each}" for each in found.declared],
        "here": [
            {
                "subject": each.subject,
                "path": each.path,
                "certificate": f"sha256:{each.sha256}",
                "key": f"sha256:{each.key}",
            }
            for each in found.here
        ],
    }


def counts(summary: Mapping[Severity, int]) -> dict[str, int]:
    """By the names of the severities, all five of them."""
    return {severity.value: summary[severity] for severity in Severity}


def _rankings(report: Report) -> list[dict[str, Any]] | None:
    """Whatever other formats are asked for, the same: up to MAX_RANKED enclaves."""
    if report.blast_radius is None or len(report.enclaves) > MAX_RANKED:
        return None
    return [_ranking(each) for each in report.blast_radius]


def _ranking(ranking: Ranking) -> dict[str, Any]:
    return {
        "profiles": list(ranking.profiles),
        "enclaves": [
            {
                "enclave": one.path,
                "topics_written": one.topics_written,
                "topics_forged": one.topics_forged,
                "topics_read": one.topics_read,
                "endless": one.endless,
                "passes_for": one.passes_for,
                "enclaves_reached_alone": one.enclaves_reached_alone,
                "enclaves_reached": one.enclaves_reached,
            }
            for one in ranking.enclaves
        ],
    }


def _engine(run: EngineRun) -> dict[str, Any]:
    atoms = None if run.atoms is None else {"keystore": run.atoms[0], "asked": run.atoms[1]}
    return {"version": run.version, "status": run.status.value, "reason": run.reason, "atoms": atoms}


def _enclave(entry: EnclaveEntry) -> dict[str, Any]:
    return {
        "path": entry.path,
        "directory": entry.directory,
        "subject": entry.subject,
        "profiles": {
            name: {"usable": usability.usable, "reasons": list(usability.reasons)}
            for name, usability in entry.profiles.items()
        },
    }


def _property(result: PropertyResult) -> dict[str, Any]:
    forgers, named = (result.forgers, result.also_named) if isinstance(result, AssertedResult) else (None, None)
    return {
        "id": result.prop.id,
        "statement": result.prop.statement,
        "status": result.status.value,
        "profiles": {name: _answer(answer) for name, answer in result.profiles.items()},
        **({"forgers": list(forgers)} if forgers is not None else {}),
        **({"also_named": dict(named)} if named is not None else {}),
        **({"vacuous": True} if result.vacuous else {}),
    }


def _answer(answer: ProfileResult) -> dict[str, Any]:
    return {
        "status": answer.status.value,
        "engines": {name: status.value for name, status in answer.engines.items()},
        "counterexample": told(answer.counterexample),
        "needs": [each.value for each in answer.needs],
    }


def _finding(finding: Finding, keystore: str) -> dict[str, Any]:
    return {
        "code": finding.code,
        "name": finding.name,
        "severity": finding.severity.value,
        "message": finding.message,
        "fix": fix(finding, keystore),
        "clause": finding.clause,
        "enclave": finding.enclave,
        "locations": [_location(location) for location in finding.locations],
        "profiles": list(finding.profiles),
        "explained_by": list(finding.explained_by),
        "fingerprint": finding.fingerprint,
        "meaning": finding.meaning,
        "suppressed": None if finding.suppressed is None else _suppression(finding.suppressed),
    }


def fix(finding: Finding, keystore: str) -> dict[str, Any]:
    """What to do about it. `command` prints the script, where there is one."""
    steps = [
        {"text": step.text, **({"act": step.act.value, "paths": list(step.paths)} if step.act and step.paths else {})}
        for step in finding.fix.steps
    ]
    command = {"command": [*script_command(finding, keystore)]} if finding.fix.scripted else {}
    return {"kind": finding.fix.kind.value, "steps": steps, **command}


def script_command(finding: Finding, keystore: str) -> tuple[str, ...]:
    """The command that prints the script about a finding; its keystore as the user gave it."""
    return TOOL, "explain", finding.code, "--for", keystore


def _location(location: Location) -> dict[str, Any]:
    return {"path": location.path, "line": location.line, "message": location.message}


def _file(file: GivenFile) -> dict[str, Any]:
    return {"path": file.path, "sha256": file.sha256}


def _suppression(suppression: Suppression) -> dict[str, Any]:
    return {
        "reason": suppression.reason,
        "until": suppression.until,
        "owner": suppression.owner,
        "source": suppression.source,
    }
