"""The Python interface: what the command says, with types."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from datetime import date, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import api
from keystore_audit.formats import FORMATS
from tests.cli.keystores import answer

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)


@pytest.fixture(scope="module")
def samples(repository: Path) -> Path:
    return repository / "sample_keystores"


@pytest.mark.parametrize("sample", ["healthy/turtlesim", "stock/talker_listener"])
def test_it_says_what_the_command_says(samples: Path, sample: str) -> None:
    words = ("--at", "2026-11-21T12:00:00Z", "--engine", "native", "--deployed", "--domain", "7")
    code, text = answer(samples / sample, *words, "--profile", "humble", "--ignore", "ka105", "-f", "json")
    report = api.audit(
        samples / sample, at=AT, engine="native", deployed=True, domain=7, profiles=["humble"], ignore=["ka105"]
    )
    assert (report.exit_code, api.render(report)) == (code, text)
    assert report.weakened


def test_the_default_instant_is_now_and_weakens_nothing(samples: Path) -> None:
    before = datetime.now(timezone.utc).replace(microsecond=0)
    report = api.audit(samples / "healthy/turtlesim", engine="native")
    assert before <= report.at <= datetime.now(timezone.utc)
    assert report.weakened == ()
    assert api.audit(samples / "healthy/turtlesim", engine="native", fail_on=None).weakened == ("--fail-on never",)


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_is_rendered(samples: Path, form: str) -> None:
    assert api.render(api.audit(samples / "stock/turtlesim", engine="native", at=AT, pictures=form == "html"), form)


def test_files_are_taken(samples: Path, tmp_path: Path) -> None:
    settings = tmp_path / "s.toml"
    settings.write_text("")
    report = api.audit(samples / "healthy/turtlesim", engine="native", at=AT, settings=settings)
    assert report.settings is not None
    policy = samples / "policies/turtlesim.policy.xml"
    compared = api.audit(samples / "healthy/turtlesim", engine="native", at=AT, policy=policy)
    assert "--policy" not in " ".join(compared.checked.not_checked)
    shutil.copytree(samples / "policies", tmp_path / "shared")
    moved = tmp_path / "robot" / "turtlesim.policy.xml"
    moved.parent.mkdir()
    moved.write_text(policy.read_text().replace("common/", "../shared/common/"))
    with pytest.raises(api.UsageError, match="cannot be put in: it is not below"):
        api.audit(samples / "healthy/turtlesim", engine="native", at=AT, policy=moved)
    with pytest.raises(api.UsageError, match="there is no policy"):
        api.audit(samples / "healthy/turtlesim", engine="native", at=AT, policy_include=tmp_path)
    shared = api.audit(samples / "healthy/turtlesim", engine="native", at=AT, policy=moved, policy_include=tmp_path)
    assert [each.code for each in shared.findings if each.code.startswith("KA64")] == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"engine": "none"},
        {"at": datetime(2026, 1, 1)},
        {"domain": 233},
        {"profiles": ["fastdd"]},
        {"time_zone": "Nowhere/Town"},
        {"ignore": ["KA901"]},
        {"select": ["KA0"]},
        {"settings": "/nowhere.toml"},
        {"alloy_properties": ["/nowhere.als"]},
        {"at": datetime(9999, 12, 31, tzinfo=timezone.utc)},
        {"at": datetime(1, 1, 1, tzinfo=timezone(timedelta(hours=14)))},
        {"at": "2026-01-01"},
        {"at": date(2026, 1, 1)},
        {"domain": "0"},
        {"domain": True},
        {"fail_on": "high"},
        {"profiles": "fastdds"},
        {"profiles": [1]},
        {"timeout": "5"},
        {"timeout": -1.0},
        {"timeout": float("nan")},
        {"timeout": 1e9},
        {"expires_within": 30},
        {"expires_within": timedelta.max},
        {"expires_within": timedelta(-1)},
        {"graphs": "graph.json"},
        {"launches": [3]},
        {"launch_arguments": ["a"]},
        {"launch_complete": "yes"},
        {"settings": 3},
        {"time_zone": 3},
        {"engine": None},
        {"deployed": "no"},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_what_makes_no_sense_is_a_usage_error(samples: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(api.UsageError):
        api.audit(samples / "healthy/turtlesim", **{"engine": "native", **wrong})


@pytest.mark.parametrize("path", ["a\0b", Path("a\ud800b")])
def test_a_path_that_no_file_can_have_is_a_usage_error(path: str | Path, samples: Path) -> None:
    files = ("alloy_jar", "settings", "baseline", "policy", "policy_include", "environment")
    several = ("graphs", "launches", "alloy_properties")
    for wrong in (*({name: path} for name in files), *({name: [path]} for name in several)):
        with pytest.raises(api.UsageError, match=r": A path holds"):
            api.audit(samples / "healthy/turtlesim", engine="native", **wrong)  # type: ignore[arg-type]
    with pytest.raises(api.UsageError, match=r": A path holds"):
        api.audit(path)


def test_what_is_of_a_wrong_type_is_named_with_what_was_expected(samples: Path) -> None:
    with pytest.raises(api.UsageError, match=r"^fail_on: Expected `.*Severity \| None`, got `str`\.$"):
        api.audit(samples / "healthy/turtlesim", fail_on="high")  # type: ignore[arg-type]
    with pytest.raises(api.UsageError, match=r"^path: Expected `str`, got `int`\.$"):
        api.audit(3)  # type: ignore[arg-type]


def test_every_argument_is_checked(samples: Path) -> None:
    from inspect import signature

    for name in signature(api.audit).parameters:
        wrong: dict[str, Any] = {"path": samples, name: object()}
        with pytest.raises(api.UsageError, match=f"^{name}: Expected "):
            api.audit(**wrong)


def test_nothing_there_is_no_report(tmp_path: Path) -> None:
    with pytest.raises(api.NothingToAudit):
        api.audit(tmp_path)
    with pytest.raises(api.UsageError):
        api.render(None, "pdf")  # type: ignore[arg-type]


def manual(repository: Path) -> str:
    return (repository / "docs/python-api.md").read_text()


def test_the_example_of_the_manual_runs(repository: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", manual(repository), re.DOTALL)
    monkeypatch.chdir(repository)
    exec(program, {})
    assert re.search(r"[0-9a-f]{64}\n$", capsys.readouterr().out)


@pytest.mark.parametrize("function", [api.audit, api.render])
def test_the_manual_names_every_argument(repository: Path, function: Callable[..., object]) -> None:
    from inspect import signature

    for name in signature(function).parameters:
        assert name in ("path", "report", "form") or f"`{name}`" in manual(repository)


def test_reports_are_json_by_the_schema_s_keys(samples: Path) -> None:
    report = api.audit(samples / "healthy/turtlesim", engine="native", at=AT)
    assert json.loads(api.render(report))["verdict"] == report.verdict.value == "pass"


def test_the_package_has_the_names_of_the_interface() -> None:
    import keystore_audit

    assert keystore_audit.__all__ == api.__all__
    for name in api.__all__:
        assert getattr(keystore_audit, name) is getattr(api, name)
    with pytest.raises(AttributeError, match="has no attribute 'audits'"):
        _ = keystore_audit.audits
