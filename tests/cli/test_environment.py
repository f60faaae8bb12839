"""What `--env` says of robots and another option says otherwise: the option counts, and that is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.keystores import AT, answer

SECURE = "ROS_SECURITY_ENABLE=true\nROS_SECURITY_STRATEGY=Enforce\nROS_SECURITY_KEYSTORE=/k\n"


@pytest.mark.parametrize(
    ("variables", "given", "said"),
    [
        ("ROS_DOMAIN_ID=7", ["--domain", "0"], ["--domain 0 in place of ROS_DOMAIN_ID=7 in robot.env"]),
        ("ROS_DOMAIN_ID=x", ["--domain", "0"], ["--domain 0 in place of ROS_DOMAIN_ID=x in robot.env"]),
        ("ROS_DOMAIN_ID=0", ["--domain", "0"], []),
        ("", ["--domain", "7"], []),
        ("ROS_DOMAIN_ID=0", [], []),
        (
            "ROS_DISTRO=jazzy\nRMW_IMPLEMENTATION=rmw_cyclonedds_cpp",
            ["--profile", "fastdds-2.14"],
            ["--profile leaves out cyclonedds-0.10, which robots of robot.env may run"],
        ),
        ("ROS_DISTRO=jazzy\nRMW_IMPLEMENTATION=rmw_cyclonedds_cpp", ["--profile", "jazzy"], []),
        (
            "ROS_DISTRO=jazzy\nRMW_IMPLEMENTATION=rmw_cyclonedds_cpp",
            [],
            [],
        ),
        (
            "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp",
            [],
            [],
        ),
    ],
)
def test_an_option_that_passes_over_a_variable_is_said(
    variables: str, given: list[str], said: list[str], healthy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robot.env").write_text(f"{SECURE}{variables}\n")
    words = [healthy, "--env", "robot.env", *given, "--engine", "native", "--at", AT, "-f", "json"]
    weakened = json.loads(answer(*words)[1])["weakened"]
    assert [each for each in weakened if "robot.env" in each] == said
    assert given or not any("--profile" in each for each in weakened)
