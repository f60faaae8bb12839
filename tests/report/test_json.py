"""The JSON report keeps the contract of docs/reference.md, whatever the keystore's author calls things."""

from __future__ import annotations

import json as stdlib_json
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.findings import Severity
from keystore_audit.report import json
from keystore_audit.report.content import Report
from keystore_audit.text import instant
from tests.schemas import schema

MakeReport = Callable[..., Report]

HOSTILE = st.text(st.characters(), max_size=20) | st.sampled_from(
    ["\x1b]0;owned\x07", "\u202egnp.exe", "[bold]x[/bold]", '"}],"verdict":"pass', "\udcff\udc80", "</script>", "\x00"]
)

REPORT_KEYS = [
    "schema_version", "tool", "keystore", "settings", "baseline", "inputs", "at", "safe_until", "verdict", "exit_code",
    "scope", "weakened", "holds_if", "assumptions", "stated", "authorities", "engines", "engines_agree", "enclaves",
    "properties", "findings", "blast_radius", "summary", "outcomes",
]  # fmt: skip
FINDING_KEYS = [
    "code", "name", "severity", "message", "fix", "clause", "enclave", "locations", "profiles", "explained_by",
    "fingerprint", "meaning", "suppressed",
]  # fmt: skip


def validate(text: str) -> dict[str, Any]:
    document: dict[str, Any] = stdlib_json.loads(text)
    schema("report").validate(document)
    return document


def test_keys_stand_in_the_order_of_the_contract(make_report: MakeReport) -> None:
    document = validate(json.render(make_report()))
    assert list(document) == REPORT_KEYS
    assert all(list(finding) == FINDING_KEYS for finding in document["findings"])
    assert list(document["summary"]) == [severity.value for severity in Severity]
    assert document["settings"] is None


def test_several_keystores(make_report: MakeReport) -> None:
    document = validate(json.render_several([make_report("a"), make_report("b")]))
    assert list(document) == ["schema_version", "reports", "missing", "summary"]
    assert [report["keystore"]["path"] for report in document["reports"]] == ["./keys/a", "./keys/b"]
    assert document["summary"] == {"critical": 2, "high": 2, "medium": 2, "low": 0, "info": 2}


@settings(max_examples=60)
@given(name=HOSTILE)
def test_hostile_names_are_data(name: str, make_report: MakeReport) -> None:
    text = json.render(make_report(name))
    assert text.isascii()
    assert not any(ord(character) < 0x20 for character in text if character != "\n")
    document = stdlib_json.loads(text)
    schema("report").validate(document)
    assert document["verdict"] == "fail"
    readable = name.encode("utf-8", "backslashreplace").decode()
    assert [enclave["path"] for enclave in document["enclaves"]] == ["/listener", f"/{readable}"]
    stdlib_json.dumps(document, ensure_ascii=False).encode()  # no lone surrogate is left


@pytest.mark.parametrize(
    ("moment", "written"),
    [
        (datetime(2025, 6, 1, 12, 30, 15, 999999, tzinfo=timezone.utc), "2025-06-01T12:30:15Z"),
        (datetime(2025, 6, 1, 1, tzinfo=timezone(timedelta(hours=2))), "2025-05-31T23:00:00Z"),
        (datetime(999, 1, 1, tzinfo=timezone.utc), "0999-01-01T00:00:00Z"),
    ],
)
def test_instants(moment: datetime, written: str) -> None:
    assert instant(moment) == written


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda d: d.update(extra=1), id="unknown key"),
        pytest.param(lambda d: d.update(verdict="pass"), id="pass with exit code 1"),
        pytest.param(lambda d: d.update(verdict="fail", exit_code=4), id="fail with exit code 4"),
        pytest.param(lambda d: d.pop("engines_agree"), id="missing key"),
        pytest.param(lambda d: d["findings"][0].update(severity="bad"), id="severity"),
        pytest.param(lambda d: d["findings"][0]["locations"][0].update(line=0), id="line 0"),
        pytest.param(lambda d: d["enclaves"][0]["profiles"].update({"Fast DDS": {}}), id="profile"),
        pytest.param(lambda d: d["summary"].pop("low"), id="four severities"),
        pytest.param(lambda d: d.update(at="2025-06-01 00:00"), id="time"),
    ],
)
def test_the_schema_is_strict(make_report: MakeReport, spoil: Any) -> None:
    document = stdlib_json.loads(json.render(make_report()))
    validator = schema("report")
    assert validator.is_valid(document)
    spoil(document)
    assert not validator.is_valid(document)
