"""The report as JSON: the interface contract, key by key (docs/reference.md, `schemas/report.schema.json`).

Pure ASCII, so that no name of a keystore steers whatever shows it, and the same bytes for the same value.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from keystore_audit.findings import Finding, Outcomes, Result, Severity
from keystore_audit.given import GivenFile
from keystore_audit.properties.result import AssertedResult, Counterexample, EngineRun, ProfileResult, PropertyResult
from keystore_audit.report.content import MAX_RANKED, EnclaveEntry, NoReport, Report
from keystore_audit.text import instant

SCHEMA_VERSION: Final = 1
"""Rises when a key is removed or changes its meaning."""

TOOL: Final = "keystore-audit"


def render(report: Report) -> str:
    """Return the report of one keystore, ending in a newline."""
    return "".join(pieces(report))


def pieces(report: Report) -> Iterator[str]:
    """The same piece by piece: most of it are outcomes, 100 MB for 10,000 enclaves."""
    values = _report(report, lambda items: map(encoded, items))
    return _pieces({**values, "outcomes": _encoded(report.outcomes)})


def render_several(reports: Sequence[Report], missing: Sequence[NoReport] = ()) -> str:
    """Return the reports of several keystores in the order given, with the sum of their counts.

    `missing`: those that have no report (there was nothing to audit, or a fault).
    """
    values = {
        "schema_version": SCHEMA_VERSION,
        "reports": [{**_report(report, list), "outcomes": _outcomes(report.outcomes)} for report in reports],
        "missing": [picked(each, "path", "reason", "exit_code") for each in missing],
        "summary": total(report.summary for report in reports),
    }
    return "".join(_pieces(values))


def total(counts: Iterable[Mapping[Severity, int]]) -> dict[Severity, int]:
    """The sum of counts of findings by severity, all five of them."""
    every = [*counts]
    return {severity: sum(each[severity] for each in every) for severity in Severity}


def _pieces(values: Mapping[str, Any]) -> Iterator[str]:
    """A line for each key, and for each item of several; those of an iterator are JSON already."""
    before = "{\n"
    for key, value in values.items():
        yield before
        items = map(encoded, value) if isinstance(value, (list, tuple)) else value
        yield from _items(key, items) if isinstance(items, Iterator) else keys({key: value})
        before = ",\n"
    yield END


def _report(report: Report, several: Callable[[Iterable[Any]], Any]) -> dict[str, Any]:
    """`several`: makes one value of what may be thousands."""
    return {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": TOOL, "version": report.version},
        "keystore": {"path": report.keystore, **picked(report, "layout", "digest", "roots")},
        "settings": _file(report.settings),
        "baseline": _file(report.baseline),
        "inputs": [{"option": option, **picked(file, "path", "sha256")} for option, file in report.inputs],
        "at": instant(report.at),
        "safe_until": report.safe_until and instant(report.safe_until),
        **picked(report, "verdict", "exit_code"),
        "scope": report.scope or None,
        "weakened": report.weakened,
        "holds_if": report.holds_if or None,
        "assumptions": [each.described for each in report.assumptions],
        "stated": report.stated,
        "authorities": authorities(report),
        "engines": {run.name: _engine(run) for run in report.engines},
        "engines_agree": report.engines_agree,
        "enclaves": several(map(_enclave, report.enclaves)),
        "properties": several(map(_property, report.properties)),
        "findings": several(_finding(finding, report.keystore) for finding in report.findings),
        "blast_radius": _rankings(report),
        "summary": report.summary,
    }


def _file(file: GivenFile | None) -> dict[str, Any] | None:
    return None if file is None else picked(file, "path", "sha256")


def _outcomes(outcomes: Outcomes) -> list[dict[str, str]]:
    return [each._asdict() for each in outcomes]


def _encoded(outcomes: Outcomes) -> Iterator[str]:
    """What `_outcomes` says, many items in a piece: a thousand enclaves have 80,000, of few rules and subjects."""
    ends = {outcome: f', "outcome": {encoded(outcome)}}}' for outcome in Result}
    known: dict[str, str] = {}
    for rule, subjects, results in outcomes.rows:
        start, place = f'{{"rule": {encoded(rule)}, "subject": ', 0
        names = [known.get(subject) or known.setdefault(subject, encoded(subject)) for subject in subjects]
        for outcome, count in results:
            told = names[place : place + count]
            yield f"{start}{f'{ends[outcome]}{BETWEEN}{start}'.join(told)}{ends[outcome]}"
            place += count


def authorities(report: Report) -> dict[str, Any]:
    """Who is trusted in each role, with what declares it."""
    return {
        each.role: {
            "declared": [f"sha256:{one}" for one in each.declared],
            "here": [
                {
                    **picked(one, "subject", "path"),
                    "certificate": f"sha256:{one.sha256}",
                    "key": f"sha256:{one.key}",
                }
                for one in each.here
            ],
        }
        for each in report.authorities
    }


def _rankings(report: Report) -> list[dict[str, Any]] | None:
    """Whatever other formats are asked for, the same: up to MAX_RANKED enclaves."""
    if report.blast_radius is None or len(report.enclaves) > MAX_RANKED:
        return None
    return [
        {
            "profiles": ranking.profiles,
            "enclaves": [
                {
                    "enclave": one.path,
                    **picked(one, "topics_written", "topics_forged", "topics_read", "endless", "passes_for"),
                    **picked(one, "enclaves_reached_alone", "enclaves_reached"),
                }
                for one in ranking.enclaves
            ],
        }
        for ranking in report.blast_radius
    ]


def _engine(run: EngineRun) -> dict[str, Any]:
    atoms = None if run.atoms is None else {"keystore": run.atoms[0], "asked": run.atoms[1]}
    return {**picked(run, "version", "status", "reason"), "atoms": atoms}


def _enclave(entry: EnclaveEntry) -> dict[str, Any]:
    profiles = {name: {"usable": u.usable.value, "reasons": u.reasons} for name, u in entry.profiles.items()}
    return {**picked(entry, "path", "directory", "subject"), "profiles": profiles}


def _property(result: PropertyResult) -> dict[str, Any]:
    asserted = picked(result, "forgers", "also_named") if isinstance(result, AssertedResult) else {}
    return {
        **picked(result.prop, "id", "statement"),
        "status": result.status,
        "profiles": {name: _answer(answer) for name, answer in result.profiles.items()},
        **{key: value for key, value in asserted.items() if value is not None},
        **({"vacuous": True} if result.vacuous else {}),
    }


def _answer(answer: ProfileResult) -> dict[str, Any]:
    counterexample = told(answer.counterexample)
    said = {"counterexample": counterexample, **picked(answer, "needs", "survives_without")}
    return {**picked(answer, "status", "engines"), **said}


def _finding(finding: Finding, keystore: str) -> dict[str, Any]:
    accepted = finding.suppressed
    return {
        **picked(finding, "code", "name", "severity", "message"),
        "fix": fix(finding, keystore),
        **picked(finding, "clause", "enclave"),
        "locations": [picked(location, "path", "line", "message") for location in finding.locations],
        **picked(finding, "profiles", "explained_by", "fingerprint", "meaning"),
        "suppressed": None if accepted is None else picked(accepted, "reason", "until", "owner", "source"),
    }


def fix(finding: Finding, keystore: str) -> dict[str, Any]:
    """What to do about it. `command` prints the script, where there is one."""
    steps = [
        {"text": step.text, **(picked(step, "act", "paths") if step.act and step.paths else {})}
        for step in finding.fix.steps
    ]
    command = {"command": script_command(finding, keystore)} if finding.fix.scripted else {}
    return {"kind": finding.fix.kind, "steps": steps, **command}


def script_command(finding: Finding, keystore: str) -> tuple[str, ...]:
    """The command that prints the script about a finding; its keystore as the user gave it."""
    return TOOL, "explain", finding.code, "--for", keystore


# Values in JSON as every report writes them: a line of ASCII that every reader takes.


_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_MARKER: Final = re.compile("#(?=#)|:(?=:)")
"""Where what runners of pipelines take for a command begins (`##vso[`, `::error::`), as `text.terminal` has it."""


def encoded(value: Any) -> str:
    r"""One value on one line. Lone surrogates (bytes that are no text), which readers refuse, are shown: `\udc80`.

    Nothing in it is a command to the runner of a pipeline: the first sign of one is written as `\u0023` or `\u003a`.
    """
    text = json.dumps(value)  # without arguments: the one form for which Python keeps its encoder
    if r"\ud" in text:
        shown = _SURROGATE.sub(lambda match: rf"\\u{ord(match[0]):04x}", json.dumps(value, ensure_ascii=False))
        text = json.dumps(json.loads(shown))
    if "##" in text or "::" in text:  # in strings alone, in which a reader takes the one form for the other
        text = _MARKER.sub(lambda match: rf"\u{ord(match[0]):04x}", text)
    return text


def picked(value: object, *names: str) -> dict[str, Any]:
    """The fields of a value that a report calls as we do. JSON takes our words for strings, and tuples for arrays."""
    return {name: getattr(value, name) for name in names}


def keys(values: Mapping[str, Any]) -> list[str]:
    """A line for each key of a document."""
    return [f"  {encoded(key)}: {encoded(value)}" for key, value in values.items()]


BETWEEN: Final = ",\n    "
"""What stands between items of a key of a document."""


END: Final = "\n}\n"
"""What ends a document."""


def array(key: str, items: Iterable[str], indent: int = 2) -> str:
    """A key of a document with a line for each of its items, which are JSON already."""
    return "".join(_items(key, items, indent))


def _items(key: str, items: Iterable[str], indent: int = 2) -> Iterator[str]:
    space = " " * indent
    yield f"{space}{encoded(key)}: ["
    before = "\n"
    for item in items:
        yield f"{before}{space}  {item}"
        before = ",\n"
    yield f"\n{space}]" if before != "\n" else "]"


def document(parts: Iterable[str]) -> str:
    """Lines for keys as one document: fit to read and to diff, ten times faster than indenting."""
    return "{\n" + ",\n".join(parts) + END


def told(counterexample: Counterexample | None) -> dict[str, Any] | None:
    """A counterexample, or a way of data, as every report tells it."""
    if counterexample is None:
        return None
    steps = [picked(step, "enclave", "channel", "witness", "path", "line") for step in counterexample.steps]
    return {"text": counterexample.text, "steps": steps}
