"""A slice of the samples in every format: valid by official schemas and by readers that we did not write."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from google.protobuf import json_format
from in_toto_attestation.predicates.test_result.v0 import test_result_pb2
from in_toto_attestation.v1 import statement_pb2
from in_toto_attestation.v1.statement import Statement
from junitparser import Error, Failure, JUnitXml, Skipped

from keystore_audit.formats import FORMATS, render
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report, Verdict, View
from keystore_audit.report.sarif import _described
from keystore_audit.rules import RULES
from tests.report.sarif_schema import sarif_schema
from tests.schemas import schema
from tests.test_samples import EXPECTATIONS, SAMPLES, as_built, given_options, name

Audited = tuple[Report, Path]


@pytest.fixture
def audited(expectation: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, resident_analyzer: None) -> Audited:  # noqa: ARG001
    """The sample's report by its own options, made in this process, and where its files are."""
    monkeypatch.chdir(SAMPLES)
    keystore, _expected = as_built(expectation, tmp_path / "keystore")
    return audit(str(keystore), given_options(expectation, keystore)), keystore


def shown(kind: str, report: Report) -> str:
    return render(kind, [report], View(), several=False)


@pytest.mark.parametrize("expectation", EXPECTATIONS[::5], ids=name)
def test_a_sample_is_valid_in_every_format(audited: Audited) -> None:
    report, keystore = audited
    texts = {kind: shown(kind, report) for kind in FORMATS}
    _json(texts["json"], report)
    _sarif(texts["sarif"], report, keystore)
    _junit(texts["junit"], report)
    for kind in ("statement", "svr"):
        _statement(texts[kind], report, keystore)
    assert texts["markdown"].startswith(f"## keystore-audit: {report.verdict.value.upper()}")
    assert len(texts["markdown"]) < 65_536
    flat = " ".join(texts["text"].split())
    assert f"exit code {report.exit_code}" in flat
    assert ("keystore-audit explain KA" in flat) is (report.verdict is not Verdict.PASS)


def _json(text: str, report: Report) -> None:
    document = json.loads(text)
    schema("report").validate(_distinct(document))
    assert (document["exit_code"], len(document["findings"])) == (report.exit_code, len(report.findings))


def _distinct(document: dict[str, Any]) -> dict[str, Any]:
    """The report without what it says again: of equal answers of several profiles one, of each outcome one."""

    def once(entry: dict[str, Any]) -> dict[str, Any]:
        answers = {json.dumps(answer): (profile, answer) for profile, answer in entry["profiles"].items()}
        return {**entry, "profiles": dict(answers.values())}

    outcomes = {one["outcome"]: one for one in document["outcomes"] if one.keys() == {"rule", "subject", "outcome"}}
    strange = [one for one in document["outcomes"] if one.keys() != {"rule", "subject", "outcome"}]
    again = {key: [once(entry) for entry in document[key]] for key in ("enclaves", "properties")}
    return {**document, **again, "outcomes": [*outcomes.values(), *strange]}


def _sarif(text: str, report: Report, keystore: Path) -> None:
    assert len(gzip.compress(text.encode(), mtime=0)) < 10_000_000
    log = json.loads(text)
    (run,) = log["runs"]
    rules = run["tool"]["driver"]["rules"]
    results = run["results"]
    own = [{**rule, "properties": None} for rule in _rules()]
    assert [{**rule, "properties": None} for rule in rules] == own  # they are held against the schema below, once
    sarif_schema().validate({**log, "runs": [{**run, "tool": {"driver": {"name": "x"}}}]})
    assert [result["ruleId"] for result in results] == [finding.code for finding in report.findings]
    for result, finding in zip(results, report.findings, strict=True):
        assert rules[result["ruleIndex"]]["id"] == finding.code
        how_bad = [float(each["properties"]["security-severity"]) for each in (result, rules[result["ruleIndex"]])]
        assert 0 <= how_bad[0] <= how_bad[1] <= 10  # services take the rule's
        assert result["partialFingerprints"] == {"keystoreAudit/v1": finding.fingerprint}
        assert bool(result.get("suppressions")) is (finding.suppressed is not None)
        for place in _places(result):
            assert place["region"]["startLine"] >= 1
            _is_there(place, keystore)
    assert run["invocations"][0]["exitCode"] == report.exit_code
    assert report.exit_code == 0 or any(result["level"] == "error" for result in results)


@cache
def _rules() -> list[dict[str, Any]]:
    return [json.loads(_described(entry, entry.severity)) for entry in RULES]


def _places(result: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for location in (*result["locations"], *result.get("relatedLocations", [])):
        yield location["physicalLocation"]
    for flow in result.get("codeFlows", []):
        for thread in flow["threadFlows"]:
            assert 0 < len(thread["locations"]) <= 1000
            for step in thread["locations"]:
                yield step["location"]["physicalLocation"]


def _is_there(place: dict[str, Any], keystore: Path) -> None:
    """A place names something that is there, and a line that it has."""
    where = unquote(place["artifactLocation"]["uri"])
    inside = place["artifactLocation"].get("uriBaseId") is not None
    file = (keystore if inside else SAMPLES) / where
    if file.is_file():
        assert place["region"]["startLine"] <= max(1, file.read_bytes().count(b"\n") + 1)
    else:  # what is missing has a place too
        assert inside, where
        assert place["region"]["startLine"] == 1


def _junit(text: str, report: Report) -> None:
    parsed = JUnitXml.fromstring(text.encode())
    cases = [case for suite in parsed for case in suite]
    assert len(cases) == parsed.tests == len(report.outcomes) + 2
    red = [case for case in cases if any(isinstance(result, Failure | Error) for result in case.result)]
    assert bool(red) is (report.exit_code != 0)
    assert any(isinstance(result, Error) for case in red for result in case.result) is (report.exit_code == 4)
    skipped = [one.message for case in cases for one in case.result if isinstance(one, Skipped)]
    accepted = {finding.fingerprint for finding in report.findings if finding.suppressed}
    assert any(str(message).startswith("accepted until") for message in skipped) <= bool(accepted)


def _statement(text: str, report: Report, keystore: Path) -> None:
    message = json_format.Parse(text, statement_pb2.Statement())
    Statement.copy_from_pb(message).validate()
    document = json.loads(text)
    predicate = document["predicate"]
    for subject in document["subject"]:
        content = (keystore / unquote(subject["name"])).read_bytes()
        assert subject["digest"]["sha256"] == hashlib.sha256(content).hexdigest()
    if document["predicateType"].endswith("svr/v0.2"):
        assert predicate["properties"] == []  # --at weakens, and nobody declared whom to trust
        assert predicate["timeCreated"] == f"{report.at:%Y-%m-%dT%H:%M:%SZ}"
    else:
        json_format.ParseDict(predicate, test_result_pb2.TestResult(), ignore_unknown_fields=True)
        assert predicate["result"] == ("WARNED" if report.verdict is Verdict.PASS else "FAILED")  # --at weakens


def test_the_rules_of_every_log_are_valid() -> None:
    driver = {"name": "keystore-audit", "rules": _rules()}
    sarif_schema().validate({"version": "2.1.0", "runs": [{"tool": {"driver": driver}}]})


SEEDS = ("0", "4711")
HASHED = ("stock/sample_policy", "flows/vehicle_compromised_relay", "rules/KA909-suppression-expired/good")


@pytest.mark.parametrize("sample", HASHED)
def test_the_bytes_do_not_hang_on_the_order_of_sets(sample: str, repository: Path, tmp_path: Path) -> None:
    keystore, expected = as_built(SAMPLES / f"{sample}.toml", tmp_path / "keystore")
    written: list[dict[str, bytes]] = []
    for seed in SEEDS:
        folder = tmp_path / seed
        folder.mkdir()
        outputs = [word for kind in FORMATS for word in ("-o", f"{kind}={folder / kind}")]
        command = [sys.executable, "-m", "keystore_audit", "-q", "--engine", "native", "--at", expected["at"]]
        done = subprocess.run(
            [*command, *expected["options"], *outputs, str(keystore)],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(repository)},
            cwd=SAMPLES,
            capture_output=True,
        )
        assert done.returncode == expected["exit_code"], done.stderr
        written.append({kind: (folder / kind).read_bytes() for kind in FORMATS})
    assert written[0] == written[1]
