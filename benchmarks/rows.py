"""The rows of the table: what is measured, against what, and which figure is the goal."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import mean
from typing import NamedTuple

from benchmarks import example, hostile
from benchmarks.keystores import build, build_fleet, build_wired
from benchmarks.program import LIMIT, NotDecided, Run, audit, measured
from keystore_audit.engine.alloy.answers import Command
from keystore_audit.engine.alloy.install import locate
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import run as analyze

SAMPLES = Path(__file__).resolve().parent.parent / "sample_keystores"
FEW = (SAMPLES / "healthy/turtlesim", SAMPLES / "stock/sample_policy")
"""Keystores of 4 and 7 enclaves."""

LOADED = """
import sys
from importlib.metadata import packages_distributions
from keystore_audit.cli.program import run
run(["audit", "--engine", "native", "--format", "json", sys.argv[1]])
others = set(packages_distributions()) - {"keystore_audit", "benchmarks", "tests"}
print("import", ", ".join(sorted(name for name in sys.modules if name.partition(".")[0] in others)), file=sys.stderr)
"""
"""Says which modules of libraries an audit has loaded."""


class Figure(NamedTuple):
    """What came out, and what was measured: the program, and what it is held against."""

    value: str
    ours: str = ""
    peer: str = ""


class Row(NamedTuple):
    """`measure` takes the share of the usual counts that is to be measured: 1, or less to be quick.

    `what`: the two that are compared; `goal`: where we want to be; `limit`: what nobody can be better than.
    """

    what: str
    goal: str
    limit: str
    measure: Callable[[float], Figure]


ROWS: dict[str, Row] = {}
"""By name."""


def row(what: str, goal: str = "", limit: str = "") -> Callable[[Callable[[float], Figure]], Callable[[float], Figure]]:
    """Make a row of the function, which has its name."""

    def added(measure: Callable[[float], Figure]) -> Callable[[float], Figure]:
        ROWS[measure.__name__.replace("_", "-")] = Row(what, goal, limit, measure)
        return measure

    return added


def ratio(ours: Run, peer: Run) -> Figure:
    """Of processor seconds."""
    return Figure(f"{ours.cpu / peer.cpu:.2f}", f"{ours}", f"{peer}")


def least(times: int, *measures: Callable[[], Run]) -> list[Run]:
    """The runs in turns, of each the one that took least: others use the machine too."""
    rounds = [[measure() for measure in measures] for _ in range(times)]
    return [min(runs) for runs in zip(*rounds, strict=True)]


def count(usual: int, share: float) -> int:
    """So many, at least 10."""
    return max(10, round(usual * share))


def alone(engine: str, keystore: Path, limit: float = LIMIT) -> Run:
    """One keystore audited."""
    return audit("--engine", engine, "--format", "json", keystore, limit=limit)


def fleet(engine: str, directory: Path) -> Run:
    """Each keystore of a fleet audited after the other, with a report of each."""
    with tempfile.TemporaryDirectory() as reports:
        asked = ("--engine", engine, "--recursive", directory, "--jobs", "1", "--output", f"json={reports}/")
        return audit(*asked, limit=3 * LIMIT)


def floor(directory: Path) -> Run:
    """Every file below the directory opened, parsed, verified and validated once."""
    return measured([sys.executable, "-m", "benchmarks.floor", str(directory)])


def held_against(peer: Run, measure: Callable[[], Run]) -> Figure:
    """The ratio, or why there is none."""
    try:
        return ratio(measure(), peer)
    except NotDecided as undecided:
        return Figure(f"{undecided}", "", f"{peer}")


# One robot.


@row("4 enclaves natively / a bare import of the libraries that this loads", "1.8", "1")
def start(_share: float) -> Figure:
    said = subprocess.run([sys.executable, "-c", LOADED, str(FEW[0])], capture_output=True, text=True, check=True)
    bare = [sys.executable, "-c", said.stderr.strip().rpartition("\n")[2]]
    return ratio(*least(7, lambda: alone("native", FEW[0]), lambda: measured(bare)))


@row("Alloy's part for 4 to 7 enclaves / a JVM that solves one trivial command", "1.3", "1")
def alloy(_share: float) -> Figure:
    def runs(keystore: Path) -> list[Run]:
        return least(3, lambda: alone("native", keystore), lambda: alone("auto", keystore), trivial_command)

    native, both, trivial = (mean(run.cpu for run in each) for each in zip(*map(runs, FEW), strict=True))
    return Figure(f"{(both - native) / trivial:.2f}", f"{both - native:.2f} s", f"{trivial:.2f} s")


@row("an audit of 4 enclaves with both engines, by the clock", "0.8 s")
def both(_share: float) -> Figure:
    (run,) = least(5, lambda: alone("auto", FEW[0]))
    return Figure(f"{run.clock:.2f} s", f"{run}")


@row("4 enclaves with both engines / the example model of TurtleSim", "3", "1")
def example_few(_share: float) -> Figure:
    return ratio(*least(3, lambda: alone("auto", FEW[0]), lambda: example_model(example.EXAMPLE)))


@row("100 enclaves on 200 topics with both engines / the example model of as many", "3", "1")
def example_many(share: float) -> Figure:
    model, keystore, settings = example.build_both(count(100, share), count(200, share))
    return ratio(*least(2, lambda: audit("--settings", settings, keystore), lambda: example_model(model)))


def example_model(place: Path) -> Run:
    """All commands of the example model, as the Analyzer's own command line solves them."""
    if not place.is_dir():
        raise NotDecided(f"{place} is not here")
    engine = locate(None, offline=True, ci=False)
    with tempfile.TemporaryDirectory() as out:
        given = ("exec", "-f", "-d", "0", "-s", "sat4j", "-o", out, str(place / "audit.als"))
        return measured([str(engine.java), "-Xss64m", "-jar", str(engine.jar), *given])


def trivial_command() -> Run:
    """The Analyzer, started as the program starts it."""
    engine = locate(None, offline=True, ci=False)
    command = Command(kind="run", name="Trivial")
    job = Job(files={"trivial.als": "run Trivial {} for 0\n"}, main="trivial.als", commands=[command], atoms=0)
    before, start = os.times(), time.perf_counter()
    analyze([job], Analyzer(java=engine.java, jar=engine.jar, timeout=60, memory_mb=1024), lambda *_: None)
    clock, after = time.perf_counter() - start, os.times()
    used = (after.children_user + after.children_system) - (before.children_user + before.children_system)
    return Run(used, 0, clock)


# Fleets.


@row("a fleet of 500 keystores of 5, alike robots: both engines / native", "1.5", "1")
def fleet_alike(share: float) -> Figure:
    robots = build_fleet(count(500, share), different=False)
    return held_against(fleet("native", robots), lambda: fleet("auto", robots))


@row("a fleet of 500 keystores of 5, all models different: both engines / native", "6", "5")
def fleet_different(share: float) -> Figure:
    robots = build_fleet(count(500, share), different=True)
    return held_against(fleet("native", robots), lambda: fleet("auto", robots))


@row("one more keystore of 5 in a fleet, natively / the floor of its files", "5", "1")
def fleet_floor(share: float) -> Figure:
    few, many = count(10, share), count(500, share)

    def runs(number: int) -> list[Run]:
        robots = build_fleet(number, different=False)
        return least(2, lambda: fleet("native", robots), lambda: floor(robots))

    ours, peer = ((last.cpu - first.cpu) / (many - few) for first, last in zip(runs(few), runs(many), strict=True))
    return Figure(f"{ours / peer:.1f}", f"{ours * 1000:.1f} ms", f"{peer * 1000:.1f} ms")


# Large keystores, and shapes that users have.


@row("1,000 enclaves natively / the floor of their files", "2.5", "1")
def thousand(share: float) -> Figure:
    store = build(count(1000, share))
    return ratio(*least(3, lambda: alone("native", store), lambda: floor(store)))


def against_stock(shape: str, enclaves: int, engine: str = "native") -> Figure:
    """A keystore of this shape, held against as large a one as sros2 makes it."""
    return held_against(alone(engine, build(enclaves)), lambda: alone(engine, build(enclaves, shape)))


@row("1,000 enclaves, the same governance signed for each by itself / stock shape", "1.5", "1.1")
def own(share: float) -> Figure:
    return against_stock("own", count(1000, share))


@row("1,000 enclaves, a wildcard prefix for each robot / stock shape", "1.5", "1.1")
def prefixes(share: float) -> Figure:
    return against_stock("prefixes", count(1000, share))


@row("200 enclaves, a prefix and a suffix for each, which all meet / stock shape")
def crossed(share: float) -> Figure:
    return against_stock("crossed", count(200, share))


@row("1,000 enclaves, copies in place of links / stock shape", "1.5", "1.1")
def copies(share: float) -> Figure:
    return against_stock("copies", count(1000, share))


@row("1,000 enclaves, an authority for each role / stock shape", "1.5", "1.1")
def split(share: float) -> Figure:
    return against_stock("split", count(1000, share))


@row("100 enclaves with both engines, the same governance signed for each by itself / stock shape", "2", "1")
def own_alloy(share: float) -> Figure:
    return against_stock("own", count(100, share), "auto")


@row("100 enclaves on 200 topics, wired at random: both engines / native")
def wired(share: float) -> Figure:
    store = build_wired(count(100, share), count(200, share))
    return held_against(alone("native", store), lambda: alone("auto", store))


@row("memory of one more enclave, of 10,000", "40 KB", "10 KB")
def memory(share: float) -> Figure:
    few, many = count(1_000, share), count(10_000, share)  # fewer take less than what starts them
    first, last = (alone("native", build(number), 3 * LIMIT) for number in (few, many))  # about memory, not time
    one = (last.memory - first.memory) * 1024 / (many - few)
    return Figure(f"{one:.0f} KB", f"{last.memory:.0f} MB, {last}", f"{first.memory:.0f} MB, {first}")


@row("the slowest hostile keystore, and the largest above a healthy one", "1 s, 200 MB")
def hostile_files(_share: float) -> Figure:
    healthy, rows = hostile.rows()
    slowest, largest = max(rows, key=lambda each: each.cpu), max(rows, key=lambda each: each.megabytes)
    told = f"{slowest.name}, {largest.name}"
    return Figure(f"{slowest.cpu:.2f} s, {largest.megabytes:.0f} MB", told, f"{healthy:.2f} s")
