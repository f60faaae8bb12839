"""`--distro` and `--rmw` choose profiles by what distributions ship."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from keystore_audit.model.profiles import VARIANTS
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
        (("--rmw", "zenoh"), "--rmw zenoh: rmw_zenoh is not modelled"),
        (("--rmw", "rmw_zenoh_cpp"), "--rmw rmw_zenoh_cpp: rmw_zenoh is not modelled"),
        (("--rmw", "fastrtps"), "--rmw: 'fastrtps' is not one of fastdds, cyclonedds, "),
        (("--distro", "jazy"), "Did you mean jazzy?"),
        (("--distro", "jazzy", "--profile", "fastdds-3.6"), "No known implementation is all that"),
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


def test_a_narrow_scope_is_named_below_the_verdict() -> None:
    said = "\n      scope: Fast DDS 2.14 (Jazzy)\n"
    assert said in answer("audit", STOCK / "talker_listener", *AT, "--distro", "jazzy", "--rmw", "fastdds")[1]
    assert "scope:" not in answer("audit", STOCK / "talker_listener", *AT)[1]
