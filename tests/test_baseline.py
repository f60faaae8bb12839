"""Baselines: what `written` writes is what is read, and what was accepted of one keystore hides nothing of another."""

from __future__ import annotations

from collections import Counter
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.baseline import create, prune, written
from keystore_audit.findings import Location, Severity
from keystore_audit.given import GivenFile
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import VARIANTS
from keystore_audit.report.content import Verdict
from keystore_audit.settings.settings import Baseline, read_baseline
from keystore_audit.settings.suppressions import Fate, Suppression, acceptable, accepted, uses
from keystore_audit.text import terminal
from tests.schemas import schema
from tests.settings.files import plain
from tests.test_samples import SAMPLES, as_built, given_options, name

UNTIL = date(2027, 3, 31)

HOSTILE = st.text(st.characters(), min_size=1, max_size=40) | st.sampled_from(
    [
        '"""',
        "\\",
        "\x7f",
        "\x00\x1f",
        "\r\n[[accepted]]",
        "'''",
        "\u2028",
        "\udcff",
        "\U0010ffff",
        '" # ]',
        "\x85",
        "\ufeff",
    ]
)
MARKS = st.integers(0, 2**256 - 1).map(lambda number: f"{number:064x}")


def cleaned(text: str) -> str:
    """As `create` takes what people and keystores say."""
    return terminal(text) if text.strip() else "x"


ENTRIES = st.builds(
    Suppression,
    code=st.integers(100, 899).map(lambda number: f"KA{number}"),
    fingerprint=MARKS,
    severity=st.sampled_from(Severity),
    profiles=st.none() | st.frozensets(st.sampled_from(sorted(VARIANTS)), min_size=1),
    meaning=MARKS,
    reason=HOSTILE.map(cleaned),
    owner=HOSTILE.map(cleaned),
    until=st.dates(),
    location=st.just(Location(path="")),
    place=st.just(""),
    finding=HOSTILE.map(cleaned) | st.just(""),
)


@settings(
    max_examples=200, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(ENTRIES, max_size=4, unique_by=lambda entry: entry.fingerprint))
def test_what_is_written_is_what_is_read(tmp_path: Path, entries: list[Suppression]) -> None:
    path = tmp_path / "baseline.toml"
    path.write_text(written(entries), "utf-8")
    read = read_baseline(path, ()).suppressions

    def placeless(some: Any) -> list[Suppression]:
        bare = [replace(entry, location=Location(path=""), place="", until_place="") for entry in some]
        return sorted(bare, key=lambda entry: str(entry.fingerprint))

    assert placeless(read) == placeless(entries)
    assert [f"{path}:{entry.location.line}" for entry in read] == [entry.place for entry in read]
    lines = path.read_text("utf-8").split("\n")
    told = [lines[int(entry.until_place.split(":")[-1]) - 1] for entry in read]
    assert told == [f"until = {entry.until.isoformat()}" for entry in read]
    assert written(reversed(entries)) == path.read_text("utf-8"), "another order, and other bytes"
    assert written(read) == path.read_text("utf-8")
    schema("baseline").validate(plain(path.read_text("utf-8")))


# Of samples

DIVERSE = (
    "stock/talker_listener",
    "stock/sample_policy",
    "healthy/turtlesim",
    "unknown/ambiguous_enclave",
    "flows/turtlesim_shared_ca",
    "flows/vehicle_compromised_relay",
    "rules/KA109-ca-private-key-in-tree/bad",
    "rules/KA203-certificate-expired/bad",
    "rules/KA301-signer-not-permissions-ca/bad",
    "rules/KA402-governance-ambiguous/bad",
    "rules/KA640-policy-right-not-granted/bad",
    "rules/KA909-suppression-expired/bad",
)


def made(options: Options, keystore: Path, path: Path, **more: Any) -> Baseline:
    """A baseline of the keystore, read back from a file."""
    text = create(str(keystore), options, reason="It is so.", owner="Ada", until=UNTIL, **more).text
    path.write_text(text, "utf-8")
    return read_baseline(path, [keystore])


@pytest.mark.parametrize("sample", DIVERSE)
def test_a_baseline_accepts_what_was_found_and_nothing_of_the_audit_itself(
    sample: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(SAMPLES)
    expectation = SAMPLES / f"{sample}.toml"
    keystore, _expected = as_built(expectation, tmp_path / "keys")
    options = given_options(expectation, keystore)
    before = audit(str(keystore), options)
    baseline = made(options, keystore, tmp_path / "baseline.toml")
    after = audit(str(keystore), replace(options, baseline=baseline))

    assert Counter(f.fingerprint for f in after.findings) == Counter(f.fingerprint for f in before.findings)
    for finding in after.findings:
        assert (finding.suppressed is not None) is acceptable(finding), finding
    incomplete = before.verdict is Verdict.INCOMPLETE
    assert after.verdict is (Verdict.INCOMPLETE if incomplete else Verdict.PASS)
    if baseline.suppressions:
        assert any(f"accepted by {baseline.file.path}" in reason for reason in after.weakened)

    kept = prune(baseline, str(keystore), options)
    assert (kept.kept, kept.dropped, kept.text) == (
        len(baseline.suppressions),
        (),
        Path(baseline.file.path).read_text(),
    )
    assert kept.complete is not incomplete
    later = replace(options, at=options.at.replace(year=2028))
    gone = prune(baseline, str(keystore), later)
    assert (gone.kept, {use.fate for use in gone.dropped} <= {Fate.ENDED}) == (0, True)


def test_entries_that_nothing_matches_stay_while_anything_is_undecided(tmp_path: Path) -> None:
    expectation = SAMPLES / "unknown/unreadable_enclave.toml"
    keystore, _expected = as_built(expectation, tmp_path / "keys")
    options = given_options(expectation, keystore)
    entry = Suppression(
        code="KA203", fingerprint="a" * 64, severity=Severity.LOW, meaning="a" * 64, reason="r", owner="o",
        until=UNTIL, location=Location(path="b.toml", line=1), place="b.toml:1:1",
    )  # fmt: skip
    left = prune(Baseline(file=GivenFile.of("b.toml", b""), suppressions=(entry,)), str(keystore), options)
    assert (left.kept, left.dropped, left.doubtful, left.complete) == (1, (), 1, False)
    healthy, _expected = as_built(SAMPLES / "healthy/turtlesim.toml", tmp_path / "healthy")
    left = prune(Baseline(file=GivenFile.of("b.toml", b""), suppressions=(entry,)), str(healthy), options)
    assert ([use.suppression for use in left.dropped], left.kept, left.complete) == ([entry], 0, True)


# What was accepted of the good keystore hides nothing that makes the bad one bad

PAIRS = sorted(
    path.parent
    for path in (SAMPLES / "rules").glob("*/bad.toml")
    if path.with_name("good.toml").exists()
    and not path.parent.name.startswith("KA9")
    and "--alloy-property" not in path.read_text()  # which the native engine alone cannot decide
)


@pytest.mark.parametrize("pair", PAIRS[::2], ids=name)
def test_a_baseline_of_the_good_sample_hides_no_defect_of_the_bad_one(
    pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the other way round: whatever one lists, only what is the same finding of the other is accepted."""
    monkeypatch.chdir(SAMPLES)
    reports = {}
    for side in ("good", "bad"):
        keystore, _expected = as_built(pair / f"{side}.toml", tmp_path / side)
        reports[side] = audit(str(keystore), given_options(pair / f"{side}.toml", keystore))
    code = pair.name.partition("-")[0]
    names = [profile for entry in reports["bad"].enclaves for profile in entry.profiles]
    found = {side: {(f.fingerprint, f.meaning): f for f in report.findings} for side, report in reports.items()}
    entries = [
        Suppression(
            code=f.code, fingerprint=f.fingerprint, severity=f.severity, profiles=frozenset(f.profiles) or None,
            meaning=f.meaning, reason="r", owner="o", until=UNTIL,
            location=Location(path="b.toml", line=1), place="",
        )
        for f in reports["good"].findings
    ]  # fmt: skip
    shown = accepted(reports["bad"].findings, uses(reports["bad"].findings, entries, reports["bad"].at, names))
    bad = [f for f in shown if f.code == code and (f.fingerprint, f.meaning) not in found["good"]]
    assert bad, "the rule's finding has the fingerprint of one of the good sample"
    assert all(f.suppressed is None for f in bad)
    for f in shown:
        if f.suppressed is not None:
            before = found["good"][f.fingerprint, f.meaning]
            assert (f.code, f.enclave) == (before.code, before.enclave)
            assert before.severity.at_least(f.severity)
