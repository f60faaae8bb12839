"""SARIF, JUnit, Markdown and in-toto statements, held against schemas and readers that we did not write."""

from __future__ import annotations

import json
import re
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

from keystore_audit.findings import Act, FixKind, Location, Outcome, Remedy, Result, Severity, Step
from keystore_audit.given import GivenFile
from keystore_audit.properties import Status
from keystore_audit.report import junit, markdown, sarif, statement
from keystore_audit.report.content import Report, Verdict
from keystore_audit.rules import RULES
from keystore_audit.text import markdown as escaped
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
    def test_the_message_is_whole_and_the_steps_are_carried(self, make_report: MakeReport) -> None:
        report = make_report()
        steps = (Step(text="Decide."), Step(text="Sign it.", act=Act.SIGN).at(("enclaves/a/permissions.p7s",)))
        fix = Remedy(kind=FixKind.DECISION, steps=steps)
        one = replace(report.findings[0], message="long " * 400, fix=fix)
        (result,) = log(replace(report, findings=(one,)))["runs"][0]["results"]
        assert one.message in result["message"]["text"]
        assert result["message"]["text"].endswith("What to do: Decide. Sign it: enclaves/a/permissions.p7s.")
        assert result["properties"]["fix"] == {
            "kind": "decision",
            "steps": [
                {"text": "Decide."},
                {
                    "text": "Sign it: enclaves/a/permissions.p7s.",
                    "act": "sign",
                    "paths": ["enclaves/a/permissions.p7s"],
                },
            ],
            "command": ["keystore-audit", "explain", one.code, "--for", report.keystore],
        }

    @given(name=HOSTILE)
    def test_it_is_valid_whatever_things_are_called(self, name: str, make_report: MakeReport) -> None:
        found = log(make_report(name))
        found["runs"][0]["tool"]["driver"]["rules"] = []  # the same every time, and by far the largest
        sarif_schema().validate(found)

    def test_the_help_of_a_rule_keeps_its_paragraphs(self, make_report: MakeReport) -> None:
        for rule in log(make_report())["runs"][0]["tool"]["driver"]["rules"]:
            assert "x0a" not in rule["help"]["markdown"]
            assert rule["help"]["markdown"].count("\n\n") == rule["help"]["text"].count("\n\n")

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

    def test_levels_fingerprints_flows_and_what_was_accepted(self, make_report: MakeReport) -> None:
        report = make_report()
        results = log(report)["runs"][0]["results"]
        assert [result["level"] for result in results] == ["error", "error", "warning", "warning", "note"]
        assert [result["properties"]["security-severity"] for result in results] == ["9.5", "8.0", "5.5", "5.5", "0.0"]
        prints = [result["partialFingerprints"]["keystoreAudit/v1"] for result in results]
        assert prints == [finding.fingerprint for finding in report.findings]
        (flow,) = results[1]["codeFlows"]
        (step,) = flow["threadFlows"][0]["locations"]
        assert step["location"]["physicalLocation"]["region"] == {"startLine": 41}
        assert ["suppressions" in result for result in results] == [False, False, False, True, False]

    def test_an_incomplete_audit_was_not_successful(self, make_report: MakeReport) -> None:
        report = make_report(verdict=Verdict.INCOMPLETE, exit_code=4)
        (invocation,) = log(report)["runs"][0]["invocations"]
        assert (invocation["executionSuccessful"], invocation["exitCode"]) == (False, 4)
        assert any(note["level"] == "error" for note in invocation["toolExecutionNotifications"])
        assert log(make_report())["runs"][0]["invocations"][0]["executionSuccessful"] is True

    def test_what_services_limit_is_cut_from_the_end_and_said(
        self, make_report: MakeReport, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(sarif, "MAX_RESULTS", 2)
        monkeypatch.setattr(sarif, "MAX_LOCATIONS", 1)
        run = log(make_report())["runs"][0]
        assert [result["ruleId"] for result in run["results"]] == ["KA302", "KA705"]
        assert all("relatedLocations" not in result for result in run["results"])
        assert any("3 more" in note["message"]["text"] for note in run["invocations"][0]["toolExecutionNotifications"])


def cases(text: str) -> dict[tuple[str, str], list[object]]:
    suites = JUnitXml.fromstring(text.encode())
    return {(case.classname, case.name): list(case.result) for suite in suites for case in suite}


class TestJunit:
    @given(name=HOSTILE)
    def test_a_reader_takes_it_whatever_things_are_called(self, name: str, make_report: MakeReport) -> None:
        report = make_report(name)
        parsed = JUnitXml.fromstring(junit.render([report]).encode())
        assert sum(len(list(suite)) for suite in parsed) == len(report.outcomes) + 2 == parsed.tests

    def test_only_what_decides_the_verdict_fails(self, make_report: MakeReport) -> None:
        found = cases(junit.render([make_report()]))
        (failure,) = found["KA302", "enclaves/talker/permissions.p7s"]
        assert isinstance(failure, Failure)
        assert "signed by the identity" in failure.message
        assert found["KA205", "enclaves/listener/cert.pem"] == []  # medium, and --fail-on is high
        lax = make_report(fail_on=None)
        assert not any(cases(junit.render([lax])).values())
        (failure,) = cases(junit.render([make_report(fail_on=Severity.MEDIUM)]))["KA205", "enclaves/listener/cert.pem"]
        assert isinstance(failure, Failure)

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

    def test_long_reports_fit_into_a_comment(self, make_report: MakeReport) -> None:
        report = make_report()
        finding = report.findings[0]
        many = [replace(finding, message=f"Number {n}.", fingerprint=f"{n:064x}") for n in range(2000)]
        text = markdown.render([make_report(findings=tuple(many))], Severity.INFO)
        assert len(text) < 65_536
        said = re.search(r"(\d+) more findings", text)
        assert said is not None
        assert int(said[1]) + text.count("critical KA302") == 2000

    def test_what_follows_and_what_is_the_same_elsewhere_stands_at_its_cause(self, make_report: MakeReport) -> None:
        """A property is not told again, and what the audit leaves open comes behind what leaves it open."""
        report = make_report()
        first = replace(report.findings[0], enclave="/a", message="/a is wrong.")
        other = replace(first, enclave="/b", message="/b is wrong.", fingerprint="b" * 64)
        so = replace(report.findings[1], explained_by=(first.fingerprint,), fingerprint="c" * 64)
        open_ = replace(first, code="KA906", enclave=None, message="Undecided.", fingerprint="d" * 64)
        for hidden in (False, True):
            found = (open_, *(() if hidden else (first, other)), so)
            text = markdown.render([replace(report, findings=found)], Severity.INFO)
            assert text.count(f"\n- **{so.severity.value} {so.code}") == hidden, "its cause is not shown"
            assert (f"  - so {so.severity.value} {so.code}" in text) is not hidden
            if not hidden:
                assert f"  *Also:* {escaped(f'/b ({first.locations[0]})')}  \n" in text
                assert "is wrong" in text.partition("Undecided")[0]
                assert text.count("is wrong") == 1
            assert "more findings are in the full report" not in text

    def test_less_severe_findings_are_counted_and_not_shown(self, make_report: MakeReport) -> None:
        text = markdown.render([make_report()], Severity.HIGH)
        assert "1 medium" in text
        assert "KA205" not in text


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

    def test_subjects_are_the_files_that_were_read(self, make_report: MakeReport) -> None:
        loaded = json.loads(statement.render_svr([sound(make_report)]))
        assert [(each["name"], each["digest"]["sha256"]) for each in loaded["subject"]] == list(FILES)

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

    def test_properties_are_those_that_hold(self, make_report: MakeReport) -> None:
        report = sound(make_report)
        holding = [result.prop.id for result in report.properties if result.status is Status.HOLDS]
        assert holding == ["documents-signed-by-the-permissions-ca"]
        assert parsed(statement.render_svr([report]))["properties"] == [
            "KEYSTORE_AUDIT_PASS_IF_TRUTHFUL_ANNOUNCEMENTS",
            "KEYSTORE_AUDIT_DOCUMENTS_SIGNED_BY_THE_PERMISSIONS_CA_IF_TRUTHFUL_ANNOUNCEMENTS",
        ]

    def test_settings_are_the_policy(self, make_report: MakeReport) -> None:
        report = sound(make_report, settings=GivenFile(path="keystore-audit.toml", sha256="b" * 64))
        expected = [{"name": "keystore-audit.toml", "digest": {"sha256": "b" * 64}}]
        assert parsed(statement.render_svr([report]))["verifier"]["policies"] == expected
