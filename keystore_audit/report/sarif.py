"""The report as SARIF 2.1.0 (OASIS, errata 01), as code scanning services take it.

One run for each keystore. Pure ASCII, and the same bytes for the same value. Services limit results, places, steps and
bytes. What is beyond is cut from the end, since findings come worst first, and a notification of the run says so.
"""

from __future__ import annotations

import zlib
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, Protocol
from urllib.parse import quote

from keystore_audit import __version__
from keystore_audit.findings import Finding, Location, Remedy, Severity, fingerprint
from keystore_audit.properties.result import Counterexample, PropertyResult
from keystore_audit.report.content import NoReport, Report, Verdict
from keystore_audit.report.json import TOOL, encoded, fix, picked
from keystore_audit.text import markdown, percent_path, shorten

SCHEMA: Final = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
KEYSTORE_BASE: Final = "KEYSTORE"
"""What places are relative to where the keystore was given by an absolute path."""

MAX_RESULTS: Final = 25_000
MAX_LOCATIONS: Final = 1_000
MAX_STEPS: Final = 1_000
MAX_RUNS: Final = 20
MAX_COMPRESSED: Final = 10_000_000
MAX_MESSAGE: Final = 1_000
"""Limits of GitHub code scanning ("SARIF results exceed limits"), the last but one in bytes of the file after gzip."""

_REST: Final = 200_000
"""Compressed bytes that one run takes beside its results, at most, and that the packer may hold back."""

_LEVELS: Final = {
    Severity.CRITICAL: ("error", "9.5"),
    Severity.HIGH: ("error", "8.0"),
    Severity.MEDIUM: ("warning", "5.5"),
    Severity.LOW: ("note", "2.0"),
    Severity.INFO: ("note", "0.0"),
}
"""The level, and a number to sort by, in the ranges of CVSS: over 9.0 critical, 7.0 high, 4.0 medium, 0.1 low."""


_UNDECIDED: Final = "KA901"
"""The rule of what is not decided."""


class _Rule(Hashable, Protocol):
    """What is said of a registered rule; `description` is Markdown-free text in paragraphs."""

    @property
    def code(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def severity(self) -> Severity: ...
    @property
    def clause(self) -> str: ...
    @property
    def remedy(self) -> Remedy: ...
    @property
    def description(self) -> str: ...


def render(reports: Sequence[Report], rules: Sequence[_Rule], missing: Sequence[NoReport] = ()) -> str:
    """Return the log of all reports; `rules`: every registered rule, so that each result finds its own.

    `missing`: keystores without a report, each a run that was not successful, with one result that says so.
    """
    number = len(reports) + len(missing)
    told = [*(_run(report, rules, number) for report in reports), *(_no_run(each, rules) for each in missing)]
    runs = ",\n    ".join(told)
    return f'{{\n  "$schema": {encoded(SCHEMA)},\n  "version": "2.1.0",\n  "runs": [\n    {runs}\n  ]\n}}\n'


def _run(report: Report, rules: Sequence[_Rule], runs: int) -> str:
    """One run of so many, a line for each rule and result."""
    index = {rule.code: number for number, rule in enumerate(rules)}
    paths = {result.prop.id: _violated(result) for result in report.properties}
    base = _Base(report.keystore)
    results = [
        encoded(_result(finding, index[finding.code], report.keystore, base, paths.get(finding.name, ())))
        for finding in report.findings[:MAX_RESULTS]
    ]
    if runs <= MAX_RUNS:  # of more, services take nothing
        results = results[: _fitting(results, MAX_COMPRESSED // runs - _REST)]
    properties = {
        **picked(report, "verdict", "digest"),
        "scope": report.scope or None,
        "weakened": report.weakened,
        "holdsIf": report.holds_if or None,
        "assumptions": [each.described for each in report.assumptions],
        "stated": report.stated,
        "vacuous": [result.prop.id for result in report.properties if result.vacuous],
        "notChecked": report.checked.not_checked,
    }
    notes = _notes(report, len(results), runs)
    head = {
        **_head(report.keystore, report.verdict, report.exit_code, notes),
        **base.declared(),
        "properties": properties,
    }
    return _assembled(report.version, [_worst(finding) for finding in report.findings], rules, head, results)


def _no_run(each: NoReport, rules: Sequence[_Rule]) -> str:
    """The run of a keystore without a report."""
    result = {
        "ruleId": _UNDECIDED,
        "ruleIndex": next(number for number, rule in enumerate(rules) if rule.code == _UNDECIDED),
        "level": "error",
        "message": {"text": shorten(f"Nothing is decided about {each.path}: {each.reason}", MAX_MESSAGE)},
        "locations": [_location(Location(each.path, beside=True), _Base(each.path))],
        "partialFingerprints": {"keystoreAudit/v1": fingerprint(_UNDECIDED, None, each.path, "no report")},
    }
    head = _head(each.path, Verdict.INCOMPLETE, each.exit_code, [("error", each.reason)])
    return _assembled(__version__, (), rules, head, [encoded(result)])


def _head(keystore: str, verdict: Verdict, exit_code: int, notes: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """How the audit went: an incomplete one was not successful, whatever it found. `notes`: each behind its level."""
    invocation = {
        "executionSuccessful": verdict is not Verdict.INCOMPLETE,
        "exitCode": exit_code,
        "toolExecutionNotifications": [{"level": level, "message": {"text": text}} for level, text in notes],
    }
    return {
        "automationDetails": {"id": f"{TOOL}/{_uri(keystore)}/"},
        "columnKind": "utf16CodeUnits",
        "invocations": [invocation],
    }


def _assembled(
    version: str,
    found: Iterable[tuple[str, Severity]],
    rules: Sequence[_Rule],
    head: Mapping[str, Any],
    results: Sequence[str],
) -> str:
    """One run. `found`: the codes of findings, each with how much it matters."""
    driver = {
        "name": TOOL,
        "semanticVersion": version,
        "version": version,
        "informationUri": "https://design.ros2.org/articles/ros2_dds_security.html",
    }
    worst = {rule.code: rule.severity for rule in rules}
    for code, severity in found:
        worst[code] = min(worst[code], severity, key=lambda each: each.rank)
    described = ",\n      ".join(_described(rule, worst[rule.code]) for rule in rules)
    tool = encoded(driver)[:-1] + f', "rules": [\n      {described}\n    ]}}'
    listed = ",\n      ".join(results)
    return f'{{"tool": {{"driver": {tool}}}, {encoded(head)[1:-1]}, "results": [\n      {listed}\n    ]}}'


def _worst(finding: Finding) -> tuple[str, Severity]:
    """The code, and how much the finding matters: what leaves the audit undecided stops a release, as high does."""
    severity = finding.severity
    undecided = finding.undecided and not severity.at_least(Severity.HIGH)
    return finding.code, Severity.HIGH if undecided else severity


def _fitting(results: Sequence[str], room: int) -> int:
    """How many of the results, from the first, take no more than so many bytes once they are compressed."""
    if sum(map(len, results)) <= room:
        return len(results)
    packer = zlib.compressobj(1)  # the least that gzip does: services may pack it better
    used = 0
    for number, result in enumerate(results):
        used += len(packer.compress(result.encode("ascii")))
        if used > room:
            return number
    return len(results)


def _notes(report: Report, shown: int, runs: int) -> Iterator[tuple[str, str]]:
    """What is not decided, what weakens the gate, and what is not in this log, or may not be taken from it."""
    for run in report.silent:
        yield "error" if run.required else "note", f"Engine {run.name}: {run.status.value}. {run.reason}".rstrip()
    if report.verdict is Verdict.INCOMPLETE:
        yield "error", "The audit is incomplete: something could not be decided."
    if report.weakened:
        yield "warning", f"This gate was weakened: {', '.join(report.weakened)}."
    if shown < len(report.findings):
        more = len(report.findings) - shown
        yield "warning", f"{more} more findings are left out; the text and JSON reports have all."
    if any(len(path.steps) > MAX_STEPS for result in report.properties for path in _violated(result)):
        yield "warning", f"Of the ways in which properties are violated, the first {MAX_STEPS} steps are told."
    if runs > MAX_RUNS:
        told = f"This log has {runs} runs, and code scanning services take {MAX_RUNS}: audit fewer keystores at once."
        yield "warning", told


class _Base:
    """How the places of one keystore are written: relative to the working directory, or to the keystore."""

    def __init__(self, keystore: str) -> None:
        self._keystore = keystore
        self._absolute = keystore.startswith("/")

    def declared(self) -> dict[str, Any]:
        if not self._absolute:
            return {}
        return {"originalUriBaseIds": {KEYSTORE_BASE: {"uri": f"file://{_uri(self._keystore).rstrip('/')}/"}}}

    def artifact(self, location: Location) -> dict[str, str]:
        if location.beside:
            return {"uri": _uri(location.path)}
        path = _quoted(location.path) or "."
        if self._absolute:
            return {"uri": path, "uriBaseId": KEYSTORE_BASE}
        root = _uri(self._keystore).rstrip("/").removeprefix("./")
        return {"uri": path if root in ("", ".") else f"{root}/{path}"}


def _uri(path: str) -> str:
    """A path as a relative reference (RFC 3986, 4.2): a colon in its first segment would make it a scheme."""
    return _quoted(percent_path(path))


def _quoted(path: str) -> str:
    """What is percent-encoded already stays."""
    return quote(path.encode("utf-8", "backslashreplace"), safe="/%+,=@~")


@lru_cache(maxsize=1_000)
def _described(rule: _Rule, worst: Severity) -> str:
    """A rule. `worst`: the severity of its worst finding in the run, or its own: services take no result's."""
    first, _, _ = rule.description.partition("\n\n")
    described = "\n".join(map(markdown, rule.description.split("\n")))
    remedy, clause = rule.remedy.text, rule.clause
    shown = f"{described}\n\n**What to do:** {markdown(remedy)}\n\n**Clause:** {markdown(clause)}"
    entry = {
        "id": rule.code,
        "name": "".join(word.capitalize() for word in rule.name.split("-")),
        "shortDescription": {"text": rule.name.replace("-", " ")},
        "fullDescription": {"text": shorten(" ".join(first.split()), MAX_MESSAGE)},
        "help": {"text": f"{rule.description}\n\nWhat to do: {remedy}\n\nClause: {clause}", "markdown": shown},
        "defaultConfiguration": {"level": _LEVELS[rule.severity][0]},
        "properties": {
            "tags": ["security", "ros2", "dds-security", rule.code[:3]],
            "security-severity": _LEVELS[worst][1],
            "precision": "very-high",
            "problem.severity": "error" if worst.at_least(Severity.HIGH) else "warning",
        },
    }
    return encoded(entry)


def _result(finding: Finding, rule: int, keystore: str, base: _Base, paths: Sequence[Counterexample]) -> dict[str, Any]:
    """One finding. Services need a place and a line: a finding without any is at the keystore, at line 1."""
    first, *others = finding.locations[:MAX_LOCATIONS] or (Location(""),)
    level, number = _LEVELS[_worst(finding)[1]]
    result: dict[str, Any] = {
        "ruleId": finding.code,
        "ruleIndex": rule,
        "level": level,
        "message": {"text": _said(finding)},
        "locations": [_location(first, base)],
        "partialFingerprints": {"keystoreAudit/v1": finding.fingerprint},
        "properties": {
            "severity": finding.severity,
            "security-severity": number,
            **picked(finding, "enclave", "profiles", "clause"),
            "fix": fix(finding, keystore),
            "explainedBy": finding.explained_by,
        },
    }
    if others:
        result["relatedLocations"] = [{"id": n, **_location(place, base)} for n, place in enumerate(others, 1)]
    if flows := [_code_flow(path, base) for path in paths if any(step.path for step in path.steps)]:
        result["codeFlows"] = flows
    if (accepted := finding.suppressed) is not None:
        reason = f"{accepted.reason} (until {accepted.until}, {accepted.owner}, {accepted.source})"
        result["suppressions"] = [{"kind": "external", "status": "accepted", "justification": reason}]
    return result


def _said(finding: Finding) -> str:
    about = f"{finding.enclave}: " if finding.enclave is not None and finding.enclave not in finding.message else ""
    return f"{about}{finding.message} What to do: {finding.fix.text}"


def _location(location: Location, base: _Base, message: str = "") -> dict[str, Any]:
    region = {"startLine": location.line or 1}
    place = {"physicalLocation": {"artifactLocation": base.artifact(location), "region": region}}
    said = message or location.message
    return {**place, "message": {"text": said}} if said else place


def _violated(result: PropertyResult) -> Sequence[Counterexample]:
    """The counterexamples of a property, each once."""
    found = (answer.counterexample for answer in result.profiles.values())
    return [*dict.fromkeys(each for each in found if each is not None)]


def _code_flow(counterexample: Counterexample, base: _Base) -> Mapping[str, Any]:
    """The steps of a counterexample that are somewhere, in order."""
    locations = [
        {
            "location": _location(
                Location(step.path, step.line),
                base,
                f"{step.enclave or 'anybody'}: {step.channel or step.witness}",
            )
        }
        for step in counterexample.steps[:MAX_STEPS]
        if step.path is not None
    ]
    return {"message": {"text": shorten(counterexample.text, MAX_MESSAGE)}, "threadFlows": [{"locations": locations}]}
