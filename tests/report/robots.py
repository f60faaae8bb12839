"""A fleet of robots that are alike, five enclaves each, as `ros2 security` lays them out."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from keystore_audit.model.names import PARAMETER_SERVICES
from tests.cli.keystores import AT, answer, keystore, rule

SERVICES = (*PARAMETER_SERVICES, "get_type_description")
"""Of every node, since Iron (KA636)."""

ROLES = ("camera", "planner", "base", "arm", "gateway")


def robots(root: Path, enclaves: int) -> Path:
    """So many enclaves, five to a robot; the first one hears of the whole fleet and commands it."""
    made = {}
    for number in range(enclaves):
        role, robot = ROLES[number % 5], f"/robot_{number // 5:02}"
        path = f"{robot}/{role}"
        publish = ["rt/rosout", "rt/parameter_events", "ros_discovery_info", f"rt{path}/status"]
        publish += [f"rr{path}/{service}Reply" for service in SERVICES]
        subscribe = ["rt/parameter_events", "ros_discovery_info", "rt/clock", "rt/fleet/command"]
        subscribe += [f"rq{path}/{service}Request" for service in SERVICES]
        writes, reads = {
            "camera": (["image"], []),
            "planner": (["cmd_vel"], ["image"]),
            "base": (["odom"], ["cmd_vel"]),
            "arm": ([], ["arm/goal"]),
            "gateway": (["arm/goal"], ["odom"]),
        }[role]
        publish += [f"rt{robot}/{topic}" for topic in writes] + (["rt/fleet/state"] if role == "gateway" else [])
        subscribe += [f"rt{robot}/{topic}" for topic in reads]
        if number == 0:
            publish.append("rt/fleet/command")
            subscribe.append("rt/fleet/state")
        made[path] = (rule(tuple(publish), tuple(subscribe)),)
    return linked(keystore(root, made))


def linked(root: Path) -> Path:
    """Make one file of what all enclaves share, and links to it, as sros2 does."""
    (root / "public").mkdir()
    for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s"):
        shared = root / ("enclaves" if name.startswith("governance") else "public") / name
        for directory in sorted(path.parent for path in root.rglob("cert.pem")):
            own = directory / name
            if not shared.exists():
                shared.write_bytes(own.read_bytes())
            own.unlink()
            own.symlink_to(os.path.relpath(shared, directory))
    return root


def page_of(root: Path, *options: str) -> str:
    """The report as a page."""
    _code, page = answer("audit", root, "--engine", "native", "--at", AT, "-f", "html", *options)
    return page


@lru_cache
def page_of_robots(enclaves: int) -> str:
    """That of so many enclaves, for all who look at it: most of their time is its making."""
    with TemporaryDirectory() as folder:
        return page_of(robots(Path(folder), enclaves))
