"""The sample networks on real sessions: what we say of generated files happens, and the other form holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.oracles.zenoh.asking import real_answers
from tests.oracles.zenoh.case import Case

SAMPLES = Path(__file__).resolve().parents[3] / "sample_keystores"
FIRST_PORT = 20500
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all


def sessions(name: str, port: int, *without_file: str) -> dict[str, Any]:
    """The files of a sample, with keys of the sample's keystore; some enclaves have dropped theirs."""
    found = {}
    for path in sorted((SAMPLES / "networks" / name).iterdir()):
        text = (
            path.read_text("utf-8").replace("/etc/keystore", f"{SAMPLES / 'zenoh' / name}").replace("7447", f"{port}")
        )
        found[path.stem] = json.loads(text)
        if path.stem in without_file:
            found[path.stem].pop("access_control")
    return found


@pytest.mark.parametrize(
    ("network", "who", "whom", "topic", "without_file", "delivered"),
    [
        ("turtlesim_generated", "random", "multiplexer", "high_priority", (), "no"),
        ("turtlesim_generated", "random", "multiplexer", "high_priority", ("random",), "yes"),
        ("turtlesim_generated", "keyboard", "multiplexer", "high_priority", (), "yes"),
        ("turtlesim_clients", "random", "multiplexer", "high_priority", (), "no"),
        ("turtlesim_clients", "random", "multiplexer", "high_priority", ("random",), "no"),
        ("turtlesim_clients", "keyboard", "multiplexer", "high_priority", (), "yes"),
        ("turtlesim_clients", "random", "multiplexer", "low_priority", (), "yes"),
        ("turtlesim_clients", "multiplexer", "turtlesim", "move_turtle", (), "yes"),
        ("turtlesim_clients", "keyboard", "turtlesim", "move_turtle", ("keyboard",), "no"),
        ("vehicle_router", "infotainment", "motor", "motor_limit", (), "yes"),
        ("vehicle_router", "telematics", "motor", "motor_limit", ("telematics",), "no"),
        ("turtlesim_clients", "zenohd", "multiplexer", "rosout", (), "no"),
        ("turtlesim_clients", "zenohd", "multiplexer", "rosout", ("zenohd",), "yes"),
    ],
)
def test_a_sample_does_what_we_say(
    network: str, who: str, whom: str, topic: str, without_file: tuple[str, ...], delivered: str, request: Any
) -> None:
    port = FIRST_PORT + request.node.callspec.indices["network"]
    key = f"0/{topic}/std_msgs::msg::dds_::String_/RIHS01_0"
    case = Case("", "", sessions(network, port, *without_file), (), who, whom, key=key, at=key)
    assert real_answers([case], {"": delivered}) == {"": delivered}
