"""Measures the whole audit against the number of enclaves and of topics, with both engines and natively.

`python -m benchmarks.alloy_scale` prints the table of docs/performance.md, by the clock and in processor seconds
(children included); `wired-100x200 fleet-1000 …` chooses rows. `wired-500x1000`, the largest, is measured only if it
is named.
*turtlesim*, *sample-policy*: keystores of sample_keystores/, without properties of users; the others have three.
*fleet*: enclaves that are alike but for their names, as `ros2 security` makes them for one robot after the other.
*wired*: each topic has a writer and two readers drawn at random, so that no two enclaves and no two topics are alike.
"""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path
from typing import Any

from benchmarks.keystores import ROOT, build, build_with, wired_permissions
from benchmarks.program import run

SAMPLES = {"turtlesim": "healthy/turtlesim", "sample-policy": "stock/sample_policy"}
"""Rows about keystores of sample_keystores/."""

ROWS = (*SAMPLES, "fleet-100", "fleet-1000", "wired-20x50", "wired-100x200")
"""Rows that are measured unasked."""

TARGETS = {"turtlesim": 2.5, "sample-policy": 4, "wired-100x200": 8, "wired-500x1000": 40}
"""Seconds by the clock for the audit with both engines, on an idle machine with two cores."""

READERS = 2
"""Readers of each topic."""

PROPERTIES = """\
[[property]]
name = "first-never-reaches-last"
no_flow = {{ from = "{first}", to = "{last}", attacker = "source" }}

[[property]]
name = "last-is-reached"
able = {{ from = "{first}", to = "{last}", include_ambient = true }}

[[property]]
name = "parameters-stay-secret"
encrypted = {{ topic = "{topic}", against = "insider" }}
"""
"""Three properties of users, two of them about flows."""


def wired(enclaves: int, topics: int) -> Path:
    """A keystore of so many enclaves on so many topics."""
    chance = random.Random(enclaves * topics)
    paths = [f"/part{number}" for number in range(enclaves)]
    publish: dict[str, list[str]] = {path: [] for path in paths}
    subscribe: dict[str, list[str]] = {path: [] for path in paths}
    for number in range(topics):
        writer, *readers = chance.sample(paths, 1 + READERS)
        publish[writer].append(f"rt/topic{number}")
        for reader in readers:
            subscribe[reader].append(f"rt/topic{number}")
    documents = {path: wired_permissions(path, publish[path], subscribe[path]) for path in paths}
    return build_with(ROOT / f"wired-{enclaves}x{topics}", "ec", documents)


def keystore(row: str) -> tuple[Path, str]:
    """The keystore of a row, and settings with properties for it."""
    if row in SAMPLES:
        return Path(__file__).parent.parent / "sample_keystores" / SAMPLES[row], ""
    kind, _, size = row.partition("-")
    if kind == "fleet":
        store = build(ROOT, int(size), "ec")
        last = int(size) - 1
        names = ("/robot0/node0", f"/robot{last // 10}/node{last % 10}", "/chatter")
    else:
        enclaves, topics = map(int, size.split("x"))
        store = wired(enclaves, topics)
        names = ("/part0", f"/part{enclaves - 1}", "/topic1")
    return store, PROPERTIES.format(first=names[0], last=names[1], topic=names[2])


def audit(store: Path, settings: Path, engine: str) -> tuple[float, float, dict[str, Any]]:
    """Seconds of one audit, CPU seconds of it and its children, and its report."""
    options = ("--format", "json", "--timeout", "600", "--settings", str(settings))
    done = run("audit", "--engine", engine, *options, str(store), incomplete=True)
    return done.clock, done.cpu, json.loads(done.output)


def main() -> None:
    """Prints one line for each row."""
    print("| keystore | atoms | asked about | native, clock (CPU) | both, clock (CPU) | target, clock |")
    print("|---|---|---|---|---|---|")
    for row in sys.argv[1:] or ROWS:
        store, properties = keystore(row)
        settings = ROOT / f"{row}.toml"
        settings.write_text(properties)
        native, both = audit(store, settings, "native"), audit(store, settings, "both")
        status = both[2]["engines"]["alloy"]
        atoms = status["atoms"] or {"keystore": "", "asked": status["reason"] or status["status"]}
        seconds = " | ".join(f"{clock:.1f} s ({cpu:.1f} s)" for clock, cpu, _report in (native, both))
        target = f"{TARGETS[row]} s" if row in TARGETS else ""
        print(f"| {row} | {atoms['keystore']} | {atoms['asked']} | {seconds} | {target} |", flush=True)


if __name__ == "__main__":
    main()
