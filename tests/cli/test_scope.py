"""`--distro` and `--rmw` choose profiles by what distributions ship."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from keystore_audit.profiles import DEFAULT, VARIANTS, scope_of
from tests.cli.keystores import answer, run_at

STOCK = Path(__file__).parents[2] / "sample_keystores/stock"
AT = ("--engine", "native", "--at", "2026-11-23T00:00:00Z")


def judged(*scope: str) -> tuple[int, tuple[str, ...]]:
    """The exit code, and the profiles that enclaves are judged under."""
    code, text = answer("audit", STOCK / "talker_listener", *AT, *scope, "-f", "json")
    return code, tuple(json.loads(text)["enclaves"][0]["profiles"])


@pytest.mark.parametrize(
    ("scope", "code", "profiles"),
    [
        (("--distro", "jazzy", "--rmw", "fastdds"), 0, ("fastdds-2.14",)),
        (("--distro", "jazzy", "--rmw", "rmw_fastrtps_cpp"), 0, ("fastdds-2.14",)),
        (("--distro", "jazzy", "--rmw", "cyclonedds"), 1, ("cyclonedds-0.10",)),
        (("--distro", "jazzy"), 1, ("fastdds-2.14", "cyclonedds-0.10")),
        (("--distro", "lyrical", "--distro", "rolling"), 0, ("fastdds-3.6", "cyclonedds-11")),
        (("--rmw", "cyclonedds"), 1, ("cyclonedds-0.10", "cyclonedds-11")),
        (("--distro", "humble", "--profile", "all", "--rmw", "fastdds"), 0, ("fastdds-2.6",)),
    ],
)
def test_a_scope_is_what_is_shipped(scope: tuple[str, ...], code: int, profiles: tuple[str, ...]) -> None:
    assert judged(*scope) == (code, profiles)


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted", "lyrical", "rolling"])
def test_a_distribution_is_all_that_it_ships(distribution: str) -> None:
    shipped = tuple(name for name, profile in VARIANTS.items() if distribution in profile.distributions)
    assert len(shipped) >= 2
    assert judged("--distro", distribution)[1] == shipped


@pytest.mark.parametrize(
    ("scope", "said"),
    [
        (("--rmw", "zenoh"), "Name its files with --zenoh DIR"),
        (("--rmw", "rmw_zenoh_cpp"), "Name its files with --zenoh DIR"),
        (("--rmw", "fastrtps"), "--rmw: 'fastrtps' is not one of fastdds, cyclonedds, "),
        (("--distro", "jazy"), "Did you mean jazzy?"),
        (("--distro", "jazzy", "--profile", "fastdds-3.6"), "No known implementation matches"),
    ],
)
def test_what_is_no_scope(scope: tuple[str, ...], said: str) -> None:
    for command in ("audit", "can", "access"):
        done = run_at(STOCK, command, "talker_listener", *scope)
        assert done.returncode == 2
        assert said in " ".join(done.stderr.split())


def test_a_question_has_a_scope_too() -> None:
    asked = ("can", STOCK / "talker_listener", "/talker", "publish", "/chatter", "--at", "2026-11-23T00:00:00Z")
    _code, text = answer(*asked, "--distro", "jazzy", "--rmw", "fastdds", "-f", "json")
    assert '"fastdds-2.14"' in text
    assert "cyclonedds" not in text


def test_a_narrow_scope_is_said_in_the_first_lines() -> None:
    """It is no weaker gate: the verdict is about something else, and rests on it."""
    asked = ("audit", STOCK / "talker_listener", *AT)
    narrow = ("--distro", "jazzy", "--rmw", "fastdds")
    _code, text = answer(*asked, *narrow)
    assert "\nPASS for Jazzy with Fast DDS 2.14  " in text
    assert "every robot in the domain runs what the scope names" in " ".join(text.split())
    assert answer(*asked, *narrow, "-q")[1].startswith("PASS for Jazzy with Fast DDS 2.14  ")
    _code, text = answer(*asked, "--distro", "jazzy")
    assert "\n      scope: Jazzy with Fast DDS 2.14 and Cyclone DDS 0.10\n" in text
    whole = answer(*asked)[1]
    assert "scope" not in whole
    report = json.loads(answer(*asked, *narrow, "-f", "json")[1])
    assert report["scope"] == "Jazzy with Fast DDS 2.14"
    assert report["weakened"] == ["--at 2026-11-23T00:00:00Z (dates are judged as of then)"]
    assert report["stated"] == ["Every robot in the domain runs what the scope names: Jazzy with Fast DDS 2.14."]
    assert json.loads(answer(*asked, "-f", "json")[1])["scope"] is None
    for form in ("markdown", "html", "sarif"):
        assert "Jazzy with Fast DDS 2.14" in answer(*asked, *narrow, "-f", form)[1]


@pytest.mark.parametrize(
    ("names", "scope"),
    [
        (("fastdds-2.14",), "Jazzy with Fast DDS 2.14"),
        (("cyclonedds-0.10",), "Humble or Jazzy or Kilted with Cyclone DDS 0.10"),
        (
            ("fastdds-2.6", "fastdds-2.14"),
            "Fast DDS 2.6 (Humble), Fast DDS 2.14 (Jazzy)",
        ),
        ((), ""),
        (DEFAULT, ""),
        (tuple(VARIANTS), ""),
    ],
)
def test_scopes_have_names(names: tuple[str, ...], scope: str) -> None:
    assert scope_of([VARIANTS[name] for name in names]) == scope


def test_a_narrower_scope_attests_itself_alone(repository: Path, tmp_path: Path) -> None:
    """A deployment gate that asks for PASS gets none."""
    keystore = repository / "sample_keystores/healthy/turtlesim"
    for role in ("identity", "permissions"):
        shutil.copyfile(keystore / f"public/{role}_ca.cert.pem", tmp_path / role)
    given = [word for role in ("identity", "permissions") for word in (f"--expect-{role}-ca", tmp_path / role)]
    asked = ("audit", keystore, "--engine", "native", "-f", "svr", *given)
    whole = json.loads(answer(*asked)[1])["predicate"]["properties"]
    assert any(each.startswith("KEYSTORE_AUDIT_PASS_IF_") for each in whole)
    (only,) = json.loads(answer(*asked, "--rmw", "fastdds", "--distro", "jazzy")[1])["predicate"]["properties"]
    assert only.startswith("KEYSTORE_AUDIT_PASS_JAZZY_WITH_FAST_DDS_2_14")
    tested = (
        "audit",
        keystore,
        "--engine",
        "native",
        "-f",
        "statement",
        *given,
        "--rmw",
        "fastdds",
        "--distro",
        "jazzy",
    )
    predicate = json.loads(answer(*tested)[1])["predicate"]
    assert predicate["result"] == "WARNED"
    assert [each.startswith("pass-jazzy-with-fast-dds-2-14") for each in predicate["passedTests"]] == [True]


@pytest.mark.parametrize(
    ("declared", "given", "code", "judged_as"),
    [
        ('distro = ["jazzy"]\nrmw = ["fastdds"]', (), 0, ["fastdds-2.14"]),
        ('distro = ["jazzy"]', (), 1, ["fastdds-2.14", "cyclonedds-0.10"]),
        ('distro = ["jazzy"]', ("--profile", "all"), 1, None),
        ('distro = ["jazzy"]', ("--distro", "jazzy", "--rmw", "fastdds"), 2, None),
        ('rmw = ["fastdds"]', ("--distro", "lyrical"), 2, None),
        ('distro = ["jazy"]', (), 2, None),
    ],
)
def test_settings_declare_the_scope_of_a_gate(
    declared: str, given: tuple[str, ...], code: int, judged_as: list[str] | None, tmp_path: Path
) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(f"[scope]\n{declared}\n")
    done = run_at(STOCK, "audit", "talker_listener", *AT, "--settings", str(settings), *given, "-f", "json")
    assert done.returncode == code, done.stderr
    if judged_as is not None:
        assert [*json.loads(done.stdout)["enclaves"][0]["profiles"]] == judged_as
    if code == 2:
        assert "settings.toml" in done.stderr


@pytest.mark.parametrize(("given", "judged"), [((), ["fastdds-2.14"]), (("--profile", "spec"), ["spec"])])
def test_questions_go_by_the_scope_that_settings_declare(
    given: tuple[str, ...], judged: list[str], tmp_path: Path
) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text('[scope]\ndistro = ["jazzy"]\nrmw = ["fastdds"]\n')
    at = ("--at", "2026-11-23T00:00:00Z")
    asked = ("can", "talker_listener", "/talker", "publish", "/chatter", *at, "--settings", str(settings), *given)
    assert [*json.loads(run_at(STOCK, *asked, "-f", "json").stdout)["decisions"]] == judged
