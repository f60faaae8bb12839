"""The report as JUnit XML: a suite for each family of rules, a case for each rule and subject.

A case fails where a finding of it decides the verdict: at or above `--fail-on`, and not accepted. Findings below are
told in the case's output. What could not be decided is an error, since a pipeline must not go on over it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from lxml import etree

from keystore_audit.findings import WHOLE, Finding, Outcome, Result
from keystore_audit.report.content import NoReport, Report, Verdict
from keystore_audit.text import instant, terminal

FAMILIES: Final[Mapping[str, str]] = {
    "KA1": "layout and files",
    "KA2": "certificates and keys",
    "KA3": "signatures",
    "KA4": "governance",
    "KA5": "permissions",
    "KA6": "access across documents",
    "KA7": "formal properties and information flow",
    "KA8": "sessions and routers",
    "KA9": "the audit itself",
}

ASSERTED: Final = "KA740"
"""The rule of what users assert, whose subjects are the names of properties."""

MAX_CASES: Final = 200_000
"""Cases of one report; beyond it (3,000 enclaves) those that passed are left out, and the suite says how many."""


def render(reports: Sequence[Report], missing: Sequence[NoReport] = ()) -> str:
    """Return the document of all reports, ending in a newline; `missing`: those of which there is none, as errors."""
    root = etree.Element("testsuites", name="keystore-audit")
    for report in reports:
        _keystore(root, report)
    for each in missing:
        suite = etree.SubElement(root, "testsuite", name=f"{terminal(each.path)}: verdict")
        _failed(_case(suite, "keystore-audit", "there is a report"), "error", each.reason, "incomplete")
    for suite in root:
        _count(suite, [suite])
    _count(root, [*root])
    etree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + etree.tostring(root, encoding="unicode") + "\n"


def _count(about: etree._Element, suites: Sequence[etree._Element]) -> None:
    tags = {
        "tests": "testcase",
        "failures": "testcase/failure",
        "errors": "testcase/error",
        "skipped": "testcase/skipped",
    }
    for name, path in tags.items():
        about.set(name, str(sum(len(suite.findall(path)) for suite in suites)))


def _keystore(root: etree._Element, report: Report) -> None:
    by_family: dict[str, list[Outcome]] = defaultdict(list)
    few = len(report.outcomes) <= MAX_CASES
    left_out = 0
    for outcome in report.outcomes:
        if few or outcome.outcome in (Result.FAIL, Result.OPEN):
            by_family[outcome.rule[:3]].append(outcome)
        else:
            left_out += 1
    found = _Findings(report.findings)
    beside = {(ASSERTED, result.prop.id): result.beside for result in report.properties if result.beside}
    for family, outcomes in sorted(by_family.items()):
        suite = _suite(root, report, f"{family} {FAMILIES[family]}")
        for outcome in outcomes:
            _outcome(suite, report, outcome, found.of(outcome), beside.get((outcome.rule, outcome.subject), ""))
    _verdict(_suite(root, report, "verdict"), report, left_out)


def _suite(root: etree._Element, report: Report, name: str) -> etree._Element:
    at = instant(report.at).removesuffix("Z")
    return etree.SubElement(root, "testsuite", name=f"{terminal(report.keystore)}: {name}", timestamp=at)


def _case(suite: etree._Element, of: str, name: str) -> etree._Element:
    return etree.SubElement(suite, "testcase", classname=of, name=terminal(name), time="0")


def _failed(case: etree._Element, tag: str, message: str, kind: str, said: str | None = None) -> None:
    """One failure or error, since readers take one for each case."""
    etree.SubElement(case, tag, message=terminal(message), type=kind).text = said


class _Findings:
    """Findings by their rule and what they are about."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self._by_rule: dict[str, list[Finding]] = defaultdict(list)
        self._by_subject: dict[tuple[str, str], list[Finding]] = defaultdict(list)
        for finding in findings:
            self._by_rule[finding.code].append(finding)
            places = {location.path for location in finding.locations[:1]}
            for subject in {finding.enclave or "", finding.name, *places, *finding.properties}:
                self._by_subject[finding.code, subject].append(finding)

    def of(self, outcome: Outcome) -> Sequence[Finding]:
        """Those of the outcome's subject; all of the rule where none names it, and where it is the whole keystore.

        A file may be called as the whole keystore is.
        """
        if outcome.outcome in (Result.PASS, Result.NOT_APPLICABLE):
            return ()
        if outcome.subject == WHOLE:
            return self._by_rule.get(outcome.rule, [])
        return self._by_subject.get((outcome.rule, outcome.subject), self._by_rule.get(outcome.rule, []))


def _outcome(suite: etree._Element, report: Report, outcome: Outcome, findings: Sequence[Finding], beside: str) -> None:
    """`beside`: what is to be known of a property, whether it holds or not."""
    case = _case(suite, outcome.rule, outcome.subject)
    if outcome.outcome is Result.NOT_APPLICABLE:
        etree.SubElement(case, "skipped", message="there is nothing here that the rule is about")
        return
    rest = [each for each in findings if not each.fails(report.fail_on)]
    deciding = [each for each in findings if each.fails(report.fail_on)]
    if outcome.outcome is Result.OPEN:
        _tell(case, "error", findings, "undecided")
        rest = []
    elif deciding:
        _tell(case, "failure", deciding, deciding[0].severity.value)
    elif findings and (accepted := findings[0].suppressed) and all(each.suppressed for each in findings):
        message = f"accepted until {accepted.until}: {accepted.reason}"
        etree.SubElement(case, "skipped", message=terminal(message))
    if told := [*map(_said, rest), *([terminal(beside)] if beside else [])]:
        etree.SubElement(case, "system-out").text = "\n\n".join(told)


def _tell(case: etree._Element, tag: str, findings: Sequence[Finding], kind: str) -> None:
    message = findings[0].message if findings else "This could not be decided."
    more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
    _failed(case, tag, message + more, kind, "\n\n".join(map(_said, findings)))


def _said(finding: Finding) -> str:
    places = [f"  {place}" for place in finding.locations[:20]]
    lines = [
        f"{finding.severity.value} {finding.code} {finding.name}: {finding.message}",
        *places,
        f"  what to do: {finding.fix.text}",
        f"  clause: {finding.clause}",
    ]
    return "\n".join(map(terminal, lines))


def _verdict(suite: etree._Element, report: Report, left_out: int) -> None:
    """The last suite: the verdict itself, which is red whatever the cases say."""
    properties = etree.SubElement(suite, "properties")
    for name, value in (
        ("verdict", report.verdict.value),
        ("digest", report.digest),
        ("holds if", report.holds_if.removeprefix("HOLDS IF ")),
        ("weakened", ", ".join(report.weakened)),
        ("accepted findings", str(len(report.accepted))),
        ("cases that passed and are left out", str(left_out)),
    ):
        etree.SubElement(properties, "property", name=name, value=terminal(value))
    case = _case(suite, "keystore-audit", "the audit is complete")
    if report.holds_if:
        etree.SubElement(case, "system-out").text = terminal(report.holds_if)
    if report.verdict is Verdict.INCOMPLETE:
        _failed(case, "error", "Something could not be decided.", "incomplete")
    case = _case(suite, "keystore-audit", "no finding decides")
    if report.failing:
        _failed(case, "failure", f"Findings that decide the verdict: {len(report.failing)}.", report.verdict.value)
