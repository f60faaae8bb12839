"""Reports larger than what services take: cut, and what is cut is said."""

from __future__ import annotations

import gzip
import json
import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity, Suppressed
from keystore_audit.properties.result import Counterexample, Step
from keystore_audit.report import junit, markdown, sarif, text
from keystore_audit.report.causes_text import MAX_ABOUT, MAX_ALIKE, MAX_MEDIUM, MAX_MINOR
from keystore_audit.report.content import Report, Verdict
from keystore_audit.rules import RULES

MakeReport = Callable[..., Report]

COMMENT = 65_536
"""Characters that the comments of code hosting services take."""


def logged(*reports: Report) -> tuple[str, list[dict[str, Any]]]:
    text = sarif.render(reports, RULES)
    return text, json.loads(text)["runs"]


def notes(run: dict[str, Any]) -> str:
    return " ".join(note["message"]["text"] for note in run["invocations"][0]["toolExecutionNotifications"])


def many(report: Report, count: int, seed: int = 1) -> Report:
    """So many findings, as hard to compress as names can make them."""
    chance = random.Random(seed)
    (first, *_rest) = report.findings
    names = (f"{chance.getrandbits(3200):0800x}" for _ in range(count))
    return replace(report, findings=tuple(replace(first, message=name, fingerprint=name[:64]) for name in names))


def test_sarif_stays_below_its_size_and_says_what_is_left_out(
    make_report: MakeReport, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sarif.MAX_COMPRESSED == 10_000_000
    monkeypatch.setattr(sarif, "MAX_COMPRESSED", 2_000_000)
    report = many(make_report(), 6_000)
    text, (run,) = logged(report)
    packed = len(gzip.compress(text.encode(), 6, mtime=0))
    assert 1_500_000 < packed < 2_000_000
    kept = len(run["results"])
    assert 0 < kept < 6_000
    assert f"{6_000 - kept} more findings are left out" in notes(run)
    assert [r["partialFingerprints"]["keystoreAudit/v1"] for r in run["results"][:50]] == [
        finding.fingerprint for finding in report.findings[:50]
    ]


def test_text_shows_the_worst_causes_of_a_code_and_counts_the_others(make_report: MakeReport) -> None:
    report = make_report()
    (first, *_rest) = report.findings
    kept = [replace(first, message=f"seen {number}", fingerprint=f"{number}") for number in range(MAX_ALIKE)]
    worse = replace(first, message="the worst", fingerprint="worse", severity=Severity.CRITICAL)
    every = (*(replace(each, severity=Severity.HIGH) for each in kept), worse)
    for verbose in (False, True):
        shown = text.render(replace(report, findings=every, properties=()), text.View(verbose=verbose))
        assert "the worst" in shown
        assert f"seen {MAX_ALIKE - 2}" in shown
        assert f"seen {MAX_ALIKE - 1}" not in shown
        assert f"and 1 more of {first.code}, about /talker (all are in the JSON report)" in shown
    assert "more of" not in text.render(replace(report, findings=every[1:], properties=()))
    of_one = tuple(replace(each, enclave="/a") for each in every)
    alike = tuple(replace(each, enclave="/b", fingerprint=f"b{each.fingerprint}") for each in every)
    shown = text.render(replace(report, findings=of_one + alike, properties=()))
    assert f"and 1 more of {first.code}, about /a, /b (all are in the JSON report)" in shown


def in_enclaves(finding: Finding, count: int, **changes: Any) -> tuple[Finding, ...]:
    """The same finding about so many enclaves."""
    return tuple(
        replace(finding, enclave=f"/e{number:02}", message=f"about {number:02}", fingerprint=f"f{number:02}", **changes)
        for number in range(count)
    )


@pytest.mark.parametrize(("verbose", "most"), [(False, MAX_MEDIUM), (True, MAX_MINOR)])
def test_what_does_not_fail_and_stands_in_many_enclaves_is_shown_of_some(
    make_report: MakeReport, verbose: bool, most: int
) -> None:
    report = replace(make_report(), properties=(), fail_on=Severity.HIGH)
    (first, *_rest) = report.findings
    count = most + MAX_ABOUT + 2
    every = in_enclaves(first, count, severity=Severity.MEDIUM, suppressed=None, explained_by=())
    shown = text.render(replace(report, findings=every), text.View(verbose=verbose))
    assert f"about {most - 1:02}" in shown
    assert f"about {most:02}" not in shown
    last = " ".join(shown.split())
    assert f"and {MAX_ABOUT + 2} more of {first.code}, about /e{most:02}, " in last
    assert f"/e{count - 3} and 2 more (all are in the JSON report)" in last
    assert f"{count} causes at medium" in shown
    few = text.render(replace(report, findings=every[:most]), text.View(verbose=verbose))
    assert "more of" not in few


@pytest.mark.parametrize(
    ("gate", "changes"),
    [
        (Severity.LOW, {"severity": Severity.LOW}),
        (None, {"severity": Severity.HIGH}),
        (Severity.HIGH, {"severity": Severity.LOW, "undecided": True}),
    ],
)
def test_what_fails_or_is_open_or_high_is_shown_of_every_enclave(
    make_report: MakeReport, gate: Severity | None, changes: dict[str, Any]
) -> None:
    report = replace(make_report(), properties=(), fail_on=gate)
    (first, *_rest) = report.findings
    every = in_enclaves(replace(first, suppressed=None, explained_by=()), MAX_MINOR + 2, severity=Severity.LOW)
    every = tuple(replace(finding, **changes) for finding in every)
    shown = text.render(replace(report, findings=every))
    assert all(finding.message in shown for finding in every)
    assert "more of" not in shown


def test_a_cause_is_told_in_full_with_what_follows_wherever_it_is(make_report: MakeReport) -> None:
    report = replace(make_report(), properties=(), fail_on=Severity.HIGH)
    (first, *_rest) = report.findings
    every = in_enclaves(first, MAX_MINOR + 2, severity=Severity.LOW, suppressed=None, explained_by=())
    follows = replace(
        every[0], code="KA799", fingerprint="so", message="so it is", explained_by=(every[-1].fingerprint,)
    )
    shown = text.render(replace(report, findings=(*every, follows)), text.View(verbose=True))
    assert every[-1].message in shown
    assert "so it is" in shown


def test_what_is_of_the_whole_keystore_is_told_in_full(make_report: MakeReport) -> None:
    report = replace(make_report(), properties=(), fail_on=Severity.HIGH)
    (first, *_rest) = report.findings
    every = in_enclaves(replace(first, suppressed=None, explained_by=()), MAX_MINOR + 2, severity=Severity.LOW)
    whole = tuple(replace(finding, enclave=None) for finding in every)
    shown = text.render(replace(report, findings=whole), text.View(verbose=True))
    assert all(finding.message in shown for finding in whole)
    assert "more of" not in shown


def test_long_ways_are_cut_and_said(make_report: MakeReport) -> None:
    report = make_report()
    step = Step(enclave="/a", channel="domain 0, topic rt/a", witness="rt/a", path="enclaves/a/permissions.p7s", line=3)
    way = Counterexample(text="Long.", steps=(step,) * 1_500)
    first, second = report.properties
    answers = {name: replace(answer, counterexample=way) for name, answer in second.profiles.items()}
    _text, (run,) = logged(replace(report, properties=(first, replace(second, profiles=answers))))
    (flow,) = (flow for result in run["results"] for flow in result.get("codeFlows", []))
    assert len(flow["threadFlows"][0]["locations"]) == 1_000
    assert "the first 1000 steps are told" in notes(run)


def accepted(report: Report, count: int, words: str) -> Report:
    """With so many findings that somebody accepts."""
    mark = Suppressed(reason=words, until="2027-01-31", owner=words, source="b.toml:1")
    (first, *rest) = report.findings
    some = tuple(replace(first, message=f"{number} {words}", suppressed=mark) for number in range(count))
    return replace(report, findings=(*rest, *some))


HOSTILE = st.sampled_from(["a", "\u202e" * 300, "<b>" * 400, "|" * 4000, "x\n" * 2000, "[a](b)" * 200])


@settings(max_examples=25, derandomize=True, deadline=None)
@given(words=HOSTILE, count=st.sampled_from([0, 1, 9, 10, 11, 300]), keystores=st.sampled_from([1, 2, 7, 30, 250]))
def test_markdown_fits_into_a_comment_whatever_there_is(
    words: str, count: int, keystores: int, make_report: MakeReport
) -> None:
    report = accepted(make_report(), count, words)
    report = replace(
        report,
        keystore=words,
        findings=report.findings * (1 + count // 10),
        properties=report.properties * (1 + count // 4),
        weakened=tuple(f"--ignore KA{number} {words}" for number in range(count)),
        safe_until_why=words,
        verdict=Verdict.FAIL,
    )
    text = markdown.render([report] * keystores, Severity.INFO)
    assert len(text) <= COMMENT
    assert text.count("<details>") == text.count("</details>")
    assert "fail" in text.lower()


def test_markdown_counts_what_it_does_not_show(make_report: MakeReport) -> None:
    report = accepted(make_report(), 2_000, "so")
    text = markdown.render([report], Severity.INFO)
    shown = text.count("\n- Accepted until")
    assert 0 < shown < 2_001
    assert f"{2_001 - shown} more accepted findings are in the full report." in text
    assert "2001 accepted" in text.split("\n")[2]


def test_markdown_tells_the_worst_of_many_keystores(make_report: MakeReport) -> None:
    reports = [make_report(keystore=f"robot{n}", verdict=Verdict.PASS) for n in range(150)]
    reports[77] = make_report(keystore="bad", verdict=Verdict.INCOMPLETE)
    text = markdown.render(reports, Severity.INFO)
    lines = text.split("\n")
    assert lines[0] == "## keystore-audit: 150 keystores"
    assert lines[4].startswith("| bad | incomplete |")
    assert "50 more keystores are in the full report." in text
    assert "## keystore-audit: INCOMPLETE" in text
    assert "keystores are told in the full report alone." in text


def test_junit_of_many_cases_keeps_those_that_matter(make_report: MakeReport, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(junit, "MAX_CASES", 2)
    text = junit.render([make_report()])
    assert 'name="cases that passed and are left out" value="1"' in text
    assert text.count("<failure") == 2  # of the rule, and of the verdict
