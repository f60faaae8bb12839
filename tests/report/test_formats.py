"""SARIF, JUnit, Markdown and in-toto statements, held against schemas and readers that we did not write."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from google.protobuf import json_format
from hypothesis import given
from hypothesis import strategies as st
from in_toto_attestation.predicates.test_result.v0 import test_result_pb2
from in_toto_attestation.v1 import statement_pb2
from in_toto_attestation.v1.statement import Statement
from junitparser import Error, Failure, JUnitXml, Skipped
from msgspec.structs import replace

from keystore_audit.findings import Location, Outcome, Result, Severity
from keystore_audit.report import junit, markdown, sarif, statement
from keystore_audit.report.content import Report, Verdict
from keystore_audit.rules import RULES
from tests.report.outcomes import outcomes_of
from tests.report.sarif_schema import sarif_schema

MakeReport = Callable[..., Report]

FILES = (("enclaves/talker/cert.pem", "0" * 64), ("public/ca.cert.pem", "a" * 64))
HOSTILE = st.text(st.characters(), max_size=20) | st.sampled_from(
    ["\x1b]0;owned\x07", "\u202egnp.exe", "]]><failure/>", '"}],"verdict":"pass', "\udcff\udc80", "</script>", "\x00"]
)


def log(report: Report) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(sarif.render([report], RULES))
    return loaded


class TestSarif:
    @given(name=HOSTILE)
    def test_it_is_valid_whatever_things_are_called(self, name: str, make_report: MakeReport) -> None:
        found = log(make_report(name))
        found["runs"][0]["tool"]["driver"]["rules"] = []  # the same every time, and by far the largest
        sarif_schema().validate(found)

    def test_places_are_relative_to_where_a_pipeline_stands(self, make_report: MakeReport) -> None:
        """`./keys/talker` and the path within it, joined, so that a service finds the file in the repository."""
        result = log(make_report(keystore="./keys/a b"))["runs"][0]["results"][0]
        place = result["locations"][0]["physicalLocation"]
        assert place == {
            "artifactLocation": {"uri": "keys/a%20b/enclaves/talker/permissions.p7s"},
            "region": {"startLine": 41},
        }
        assert result["relatedLocations"][0]["physicalLocation"]["region"] == {"startLine": 1}

    def test_an_absolute_keystore_is_a_base(self, make_report: MakeReport) -> None:
        run = log(make_report(keystore="/srv/keys"))["runs"][0]
        assert run["originalUriBaseIds"] == {"KEYSTORE": {"uri": "file:///srv/keys/"}}
        assert run["results"][0]["locations"][0]["physicalLocation"]["artifactLocation"] == {
            "uri": "enclaves/talker/permissions.p7s",
            "uriBaseId": "KEYSTORE",
        }

    def test_an_incomplete_audit_was_not_successful(self, make_report: MakeReport) -> None:
        report = make_report(verdict=Verdict.INCOMPLETE, exit_code=4)
        (invocation,) = log(report)["runs"][0]["invocations"]
        assert (invocation["executionSuccessful"], invocation["exitCode"]) == (False, 4)
        assert any(note["level"] == "error" for note in invocation["toolExecutionNotifications"])
        assert log(make_report())["runs"][0]["invocations"][0]["executionSuccessful"] is True


def cases(text: str) -> dict[tuple[str, str], list[object]]:
    suites = JUnitXml.fromstring(text.encode())
    return {(case.classname, case.name): list(case.result) for suite in suites for case in suite}


class TestJunit:
    @given(name=HOSTILE)
    def test_a_reader_takes_it_whatever_things_are_called(self, name: str, make_report: MakeReport) -> None:
        report = make_report(name)
        parsed = JUnitXml.fromstring(junit.render([report]).encode())
        assert sum(len(list(suite)) for suite in parsed) == len(report.outcomes) + 2 == parsed.tests

    @pytest.mark.parametrize("path", ["enclaves/talker/key.pem", "keystore"])
    def test_a_rule_about_the_whole_keystore_fails_whatever_files_are_called(
        self, path: str, make_report: MakeReport
    ) -> None:
        whole = make_report().findings[0]
        low = replace(whole, severity=Severity.LOW, enclave=None, locations=(Location(path=path, line=1),))
        outcomes = (Outcome(rule=whole.code, subject="keystore", outcome=Result.FAIL),)
        report = make_report(findings=(whole, low), outcomes=outcomes_of(outcomes))
        found = cases(junit.render([report]))
        assert isinstance(found[whole.code, "keystore"][0], Failure)
        assert isinstance(found["keystore-audit", "no finding decides"][0], Failure)
        fine = cases(
            junit.render([make_report(findings=(low,), outcomes=outcomes_of(()), verdict=Verdict.PASS, exit_code=0)])
        )
        assert fine["keystore-audit", "no finding decides"] == []

    def test_what_is_open_is_an_error_and_so_is_an_incomplete_audit(self, make_report: MakeReport) -> None:
        outcomes = (
            Outcome(rule="KA906", subject="outsiders-cannot-read", outcome=Result.OPEN),
            Outcome(rule="KA205", subject="x", outcome=Result.NOT_APPLICABLE),
            Outcome(rule="KA420", subject="enclaves/governance.p7s", outcome=Result.FAIL),
        )
        report = make_report(outcomes=outcomes_of(outcomes), verdict=Verdict.INCOMPLETE, exit_code=4)
        found = cases(junit.render([report]))
        assert isinstance(found["KA906", "outsiders-cannot-read"][0], Error)
        assert isinstance(found["KA205", "x"][0], Skipped)
        assert isinstance(found["KA420", "enclaves/governance.p7s"][0], Skipped)  # accepted until 2026
        assert isinstance(found["keystore-audit", "the audit is complete"][0], Error)


class TestMarkdown:
    def test_the_verdict_comes_first_and_names_are_inert(self, make_report: MakeReport) -> None:
        text = markdown.render([make_report("![x](http://e)<b>")], Severity.INFO)
        scope = "DDS-Security 1.1, Fast DDS 2.6 (Humble), Cyclone DDS 0.10 (Humble, Jazzy, Kilted)"
        assert text.startswith(f"## keystore-audit: FAIL for {scope}\n")
        assert "![x]" not in text
        assert "<b>" not in text
        assert "weakened" in text


def parsed(text: str) -> Any:
    """The statement, as the framework's own library reads it."""
    message = json_format.Parse(text, statement_pb2.Statement())
    Statement.copy_from_pb(message).validate()
    return json_format.MessageToDict(message.predicate)


def sound(make_report: MakeReport, **changes: object) -> Report:
    """A report that passes at full strength, without any finding, of declared authorities."""
    given = {
        "authorities": tuple(replace(each, declared=("a" * 64,)) for each in make_report().authorities),
        "verdict": Verdict.PASS,
        "exit_code": 0,
        "weakened": (),
        "scope": "",
        "findings": (),
        "outcomes": outcomes_of(()),
        "files": FILES,
    }
    return make_report(**{**given, **changes})


class TestStatements:
    @given(name=HOSTILE)
    def test_the_framework_s_library_takes_them(self, name: str, make_report: MakeReport) -> None:
        report = make_report(name, files=FILES)
        predicate = parsed(statement.render_test_result([report]))
        json_format.ParseDict(predicate, test_result_pb2.TestResult(), ignore_unknown_fields=True)
        assert predicate["result"] == "FAILED"
        assert predicate["failedTests"] == ["KA302"]
        assert parsed(statement.render_svr([report]))["properties"] == []

    def test_only_a_whole_audit_at_full_strength_passes(self, make_report: MakeReport) -> None:
        def results(report: Report) -> tuple[str, bool]:
            svr = parsed(statement.render_svr([report]))["properties"]
            return parsed(statement.render_test_result([report]))[
                "result"
            ], "KEYSTORE_AUDIT_PASS_IF_TRUTHFUL_ANNOUNCEMENTS" in svr

        assert results(sound(make_report)) == ("PASSED", True)
        assert results(sound(make_report, weakened=("--ignore KA2",))) == ("WARNED", False)
        assert results(sound(make_report, authorities=make_report().authorities)) == ("WARNED", False)
        assert results(sound(make_report, verdict=Verdict.INCOMPLETE, exit_code=4)) == ("FAILED", False)
        assert results(sound(make_report, verdict=Verdict.FAIL, exit_code=1)) == ("FAILED", False)
        low = (Outcome(rule="KA205", subject="x", outcome=Result.FAIL),)
        assert results(sound(make_report, outcomes=outcomes_of(low))) == ("WARNED", True)
