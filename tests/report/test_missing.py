"""Keystores without a report beside others that pass: no document about all of them looks like a pass.

And no SARIF log of an audit that fails: services look at levels, and at what rules say of how bad they are.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.formats import FORMATS, render
from keystore_audit.report import sarif
from keystore_audit.report.content import NoReport, Report, Verdict, View
from keystore_audit.rules import RULES
from tests.report.sarif_schema import sarif_schema

MakeReport = Callable[..., Report]

GONE = NoReport(path="robots/gone", reason="robots/gone does not exist.", exit_code=3)
ATTESTATIONS = ("statement", "svr")


def rendered(kind: str, make_report: MakeReport, *missing: NoReport) -> str:
    passes = make_report(verdict=Verdict.PASS, exit_code=0, fail_on=None)
    return render(kind, [passes], View(), several=True, missing=missing)


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind not in ATTESTATIONS])
def test_every_format_names_what_has_no_report(kind: str, make_report: MakeReport) -> None:
    assert GONE.path in rendered(kind, make_report, GONE).replace("\\", "")
    assert GONE.path not in rendered(kind, make_report)


@pytest.mark.parametrize("kind", ATTESTATIONS)
def test_there_is_no_statement_about_it(kind: str, make_report: MakeReport) -> None:
    assert rendered(kind, make_report, GONE) == rendered(kind, make_report)


def test_it_is_an_error_in_junit(make_report: MakeReport) -> None:
    root = etree.fromstring(rendered("junit", make_report, GONE).encode())
    (error,) = root.iterfind(".//error")
    assert (root.get("errors"), error.get("message")) == ("1", GONE.reason)


def test_it_is_an_error_in_sarif(make_report: MakeReport) -> None:
    log = json.loads(rendered("sarif", make_report, GONE))
    sarif_schema().validate(log)
    run = log["runs"][-1]
    assert not run["invocations"][0]["executionSuccessful"]
    assert [(result["ruleId"], result["level"]) for result in run["results"]] == [("KA901", "error")]
    assert run["tool"]["driver"]["rules"][run["results"][0]["ruleIndex"]]["id"] == "KA901"


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind not in ATTESTATIONS])
@given(name=st.text(st.characters(), max_size=20) | st.sampled_from(["]]><x/>", "\x1b]0;x\x07", "\udcff", "</script>"]))
def test_its_name_steers_nothing(kind: str, name: str, make_report: MakeReport) -> None:
    text = rendered(kind, make_report, NoReport(path=name, reason=name, exit_code=4))
    text.encode()
    assert "\x1b" not in text
    assert "</script>" not in text or kind in ("text", "json", "sarif")  # shown on no page
    if kind == "junit":
        etree.fromstring(text.encode())


def _log(report: Report) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    run = json.loads(sarif.render([report], RULES))["runs"][0]
    return run["results"], {rule["id"]: rule for rule in run["tool"]["driver"]["rules"]}


@pytest.mark.parametrize("severity", list(Severity))
def test_rules_in_sarif_are_as_bad_as_their_worst_finding(severity: Severity, make_report: MakeReport) -> None:
    """Measured: of KA109 with --deployed the finding was critical, and the rule 0.0, which is what services show."""
    report = make_report()
    found = replace(report.findings[0], code="KA109", severity=severity)
    (result,), rules = _log(replace(report, findings=(found,)))
    assert rules["KA109"]["properties"]["security-severity"] == result["properties"]["security-severity"]
    assert rules["KA118"]["properties"]["security-severity"] == "9.5"  # nothing was found: its own


@pytest.mark.parametrize("severity", list(Severity))
def test_what_is_undecided_is_an_error_in_sarif(severity: Severity, make_report: MakeReport) -> None:
    report = make_report(verdict=Verdict.INCOMPLETE, exit_code=4)
    found = replace(report.findings[0], code="KA111", severity=severity, undecided=True)
    (result,), rules = _log(replace(report, findings=(found,)))
    assert result["level"] == "error"
    assert result["properties"]["severity"] == severity.value
    assert float(rules["KA111"]["properties"]["security-severity"]) >= 7
