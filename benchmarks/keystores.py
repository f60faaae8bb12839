"""Keystores and fleets as `ros2 security` makes them, in the shapes that users have; made once and kept."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from tests.keystore.builder import sros2
from tests.keystore.documents import grant, permissions, pub, rule, sub

ROOT = Path(gettempdir()) / "keystore-audit-benchmarks"
"""Where they are made."""

ROBOT = tuple(f"/node{number}" for number in range(5))
"""The enclaves of one robot."""

PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)

READERS = 2
"""Of each topic, where nodes are wired at random."""


def node(path: str, publish: Sequence[str], subscribe: Sequence[str]) -> str:
    """Permissions for these DDS topics, the usual topics of a node and its parameter services."""
    publish = [*publish, "rt/rosout", "rt/parameter_events"]
    subscribe = [*subscribe, "rt/parameter_events"]
    publish += [f"rr{path}/{service}Reply" for service in PARAMETER_SERVICES]
    subscribe += [f"rq{path}/{service}Request" for service in PARAMETER_SERVICES]
    rules = (rule(pub(*publish), sub(*subscribe)), rule(pub("ros_discovery_info"), sub("ros_discovery_info")))
    return permissions(grant(path, *rules, name=path))


def talker(path: str) -> str:
    """Two topics that all have, and two of its own."""
    return node(path, ["rt/chatter", f"rt{path}/status"], ["rt/clock", f"rt{path}/command"])


def prefixed(path: str) -> str:
    """Whatever begins with the name of its robot, in place of topics of its own."""
    return node(path, ["rt/chatter", f"rt{path.rpartition('/')[0]}/*"], ["rt/clock"])


def crossed(path: str) -> str:
    """Whatever begins with its name, and whatever ends with it: each of these meets each of those."""
    name = path.replace("/", "")
    return node(path, [f"rt/{name}/*"], [f"rt/*/{name}"])


SHAPES: Mapping[str, Mapping[str, Any]] = {
    "stock": {"document": talker},
    "own": {"document": talker, "own_governances": True},
    "prefixes": {"document": prefixed},
    "crossed": {"document": crossed},
    "copies": {"document": talker, "links": False},
    "split": {"document": talker, "split": True},
}
"""What differs from what sros2 makes, by the name of the shape."""


def wired(paths: Sequence[str], topics: int, seed: int) -> Mapping[str, str]:
    """By enclave, permissions: of each topic a writer and readers drawn at random, so that no two nodes are alike."""
    chance = random.Random(seed)
    drawn = [chance.sample(paths, 1 + READERS) for _ in range(topics)]
    named = [(f"rt/topic{number}", writer, readers) for number, (writer, *readers) in enumerate(drawn)]
    return {
        path: node(path, [t for t, writer, _ in named if writer == path], [t for t, _, all_ in named if path in all_])
        for path in paths
    }


def build(enclaves: int, shape: str = "stock") -> Path:
    """A keystore with so many enclaves, ten for each robot."""
    paths = [f"/robot{number // 10}/node{number % 10}" for number in range(enclaves)]
    return _once(f"{shape}-{enclaves}", lambda place: sros2(place, paths, **SHAPES[shape]))


def build_wired(enclaves: int, topics: int) -> Path:
    """A keystore of enclaves that are wired at random."""
    documents = wired([f"/part{number}" for number in range(enclaves)], topics, enclaves * topics)
    return _once(f"wired-{enclaves}-{topics}", lambda place: sros2(place, [*documents], document=documents.__getitem__))


def build_fleet(count: int, *, different: bool) -> Path:
    """A directory of so many keystores, each of a robot with authorities of its own; `different`: in what it grants."""

    def make(place: Path) -> None:
        for number in range(count):
            documents = wired(ROBOT, 2 * len(ROBOT), number) if different else {path: talker(path) for path in ROBOT}
            sros2(place / f"robot{number:04}", ROBOT, document=documents.__getitem__)

    return _once(f"fleet-{'different' if different else 'alike'}-{count}", make)


def _once(name: str, make: Callable[[Path], object]) -> Path:
    """The directory of this name, made unless it is there."""
    place, unfinished = ROOT / name, ROOT / f"{name}.unfinished"
    if not place.exists():
        make(unfinished)
        unfinished.rename(place)
    return place
