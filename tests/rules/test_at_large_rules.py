"""What the audit says of identities at large: each once, with what follows from it below."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from keystore_audit.findings import Finding
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from tests.cli.keystores import answer
from tests.model.comparing import AT, authority
from tests.model.test_at_large import HELD, LYING_ABOUT, NOBODYS, Files, identity, written


def report(root: Path) -> Report:
    return audit(root, Options(at=AT, engine="native"))


def causes(report: Report) -> dict[str, set[str]]:
    """By code of a violated property about identities, the codes of the findings that explain it."""
    by_mark: dict[str, Finding] = {finding.fingerprint: finding for finding in report.findings}
    told = [finding for finding in report.findings if finding.code in ("KA702", "KA704", "KA707")]
    return {finding.code: {by_mark[mark].code for mark in finding.explained_by} for finding in told}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, {}),
        (HELD, {"KA704": {"KA228"}, "KA707": {"KA228"}}),
        ({"public/x_ca.cert.pem": identity("/admin", "/talker").pem}, {"KA704": {"KA228"}}),
        ({"public/x_ca.cert.pem": identity("/listener", "/talker", authority("other")).pem}, {}),
        ({"public/x_ca.cert.pem": identity("/talker", "/talker", serial=9).pem}, {}),
        (LYING_ABOUT, {}),
        (NOBODYS, {}),
        ({"backup/cert.pem": identity("/admin", "/talker").pem}, {"KA704": set()}),
    ],
)
def test_what_follows_is_told_below_what_it_follows_from(
    files: Files, expected: dict[str, set[str]], tmp_path: Path
) -> None:
    assert causes(report(written(tmp_path, files))) == expected


def test_the_example_names_the_certificate_with_its_line(tmp_path: Path) -> None:
    root = written(tmp_path, HELD)
    shared = next(finding for finding in report(root).findings if finding.code == "KA704")
    assert "CN=/listener (public/x_ca.cert.pem, no enclave)" in shared.message
    assert ("public/x_ca.cert.pem", 1) in {(place.path, place.line) for place in shared.locations}


def test_a_subject_without_end_is_cut(tmp_path: Path) -> None:
    units = (x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, f"{number:064}") for number in range(200))
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "/admin"), *units])
    root = written(tmp_path, {"public/x_ca.cert.pem": identity(name, "/talker").pem})
    for words in (("audit", root, "--engine", "native"), ("flow", root, "--from-compromised", "/talker")):
        _code, output = answer(*words, "--at", "2026-11-21T12:00:00Z")
        assert "no enclave)" in " ".join(output.split())
        assert "0100" not in output, "what stands in its middle"


def test_a_flow_names_the_certificate_with_its_line(tmp_path: Path) -> None:
    for name, files, question in (
        ("a", HELD, ["topic:/chatter", "/talker"]),
        ("b", LYING_ABOUT, ["/talker", "/motor"]),
    ):
        root = written(tmp_path / name, files)
        code, output = answer("flow", root, *question, "-f", "json", "--at", "2026-11-21T12:00:00Z")
        assert code == 1
        (certificate,) = (path for path in files if path.endswith("cert.pem"))
        steps = [step for each in _examples(json.loads(output)) for step in each["steps"]]
        assert {step["line"] for step in steps if step["path"] == certificate} == {1}


def _examples(found: object) -> list[dict[str, list[dict[str, object]]]]:
    """All counterexamples of a document, wherever they stand."""
    if isinstance(found, dict):
        own = [found] if found.get("steps") else []
        return [*own, *(each for value in found.values() for each in _examples(value))]
    return [each for value in found for each in _examples(value)] if isinstance(found, list) else []


def test_whom_a_key_passes_for_beside_the_enclaves(tmp_path: Path) -> None:
    words = []
    for name, files in (("a", {}), ("b", HELD)):
        _code, output = answer("flow", written(tmp_path / name, files), "--from-compromised", "/talker")
        words.append(" ".join(output.split()))
    assert ["no enclave)" in each for each in words] == [False, True]
    assert "passes for no other enclave" in words[0]
    assert "passes for CN=/listener (public/x_ca.cert.pem, no enclave) reaches" in words[1]
    assert "reaches 1 of 3 enclaves while the others stay honest: /listener" in words[1]
