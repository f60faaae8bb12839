"""Measures a run over many keystores of four enclaves: the rate, and whether memory stays flat.

With `--dask`, the same through a scheduler and two workers of Dask, one of which is killed on the way.
"""

from __future__ import annotations

import argparse
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import psutil

from benchmarks import keystores

ENCLAVES = 4
MIB = 2**20


def build(root: Path, count: int) -> None:
    """So many keystores, each of a robot with a CA of its own, made once."""
    for number in range(count):
        keystores.build(root / f"site{number // 100:02}/robot{number:04}", ENCLAVES, "ec")


def chosen(root: Path, count: int, place: Path) -> Path:
    """A directory of links' targets: the first so many keystores, as hard links."""
    for robot in sorted(root.glob("site*/robot*"))[:count]:
        shutil.copytree(robot, place / robot.relative_to(root), symlinks=True, copy_function=_link)
    return place


def _link(source: str, target: str) -> None:
    Path(target).hardlink_to(source)


class Memory:
    """The largest resident sets while a program runs, in MiB: its own, and that of its largest child."""

    def __init__(self, pid: int) -> None:
        self.own = self.child = 0.0
        self._process = psutil.Process(pid)
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while True:
            try:
                self.own = max(self.own, self._process.memory_info().rss / MIB)
                children = [child.memory_info().rss / MIB for child in self._process.children(recursive=True)]
                self.child = max([self.child, *children])
            except psutil.Error:
                return
            time.sleep(0.2)


def audited(directory: Path, out: Path, *options: str) -> tuple[float, Memory]:
    """The seconds that a run takes, and its memory."""
    command = [sys.executable, "-m", "keystore_audit", "-r", str(directory), "--engine", "native", "-o", f"json={out}/"]
    start = time.perf_counter()
    running = subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL)
    memory = Memory(running.pid)
    running.wait()
    seconds = time.perf_counter() - start
    rows = json.loads((out / "summary.json").read_text())["keystores"]
    found = len(list(out.rglob("report.json")))
    print(f"  exit code {running.returncode}, {len(rows)} rows, {found} reports")
    return seconds, memory


def through_dask(directory: Path, out: Path) -> None:
    """A scheduler and two workers; one is killed when a tenth of the reports are there."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": scratch}
        own = ["--host", "127.0.0.1", "--no-dashboard"]
        scheduler = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_scheduler", *own, "--port", str(port)], **quiet
        )
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--no-nanny"]
        workers = [subprocess.Popen([*worker, "--nthreads", "1", "--no-dashboard"], **quiet) for _ in range(2)]
        try:
            total = sum(1 for _ in directory.glob("site*/robot*"))
            threading.Thread(target=_kill_later, args=(workers[0], out, total // 10), daemon=True).start()
            seconds, memory = audited(directory, out, "--executor", f"dask://127.0.0.1:{port}")
            print(
                f"  dask, one of two workers killed: {seconds:.1f} s, {total / seconds:.1f}/s, own {memory.own:.0f} MiB"
            )
        finally:
            for process in (*workers, scheduler):
                process.kill()
                process.wait()


def _kill_later(worker: subprocess.Popen[bytes], out: Path, reports: int) -> None:
    while sum(1 for _ in out.rglob("report.json")) < reports:
        time.sleep(0.5)
    worker.kill()
    print(f"  worker killed with {sum(1 for _ in out.rglob('report.json'))} reports written")


def main() -> None:
    """Print a line for each size."""
    parser = argparse.ArgumentParser()
    parser.add_argument("counts", type=int, nargs="*", default=[500, 1000, 2000])
    parser.add_argument("--root", type=Path, default=Path(tempfile.gettempdir()) / "keystore-audit-fleet")
    parser.add_argument("--dask", action="store_true")
    arguments = parser.parse_args()
    build(arguments.root, max(arguments.counts))
    for count in arguments.counts:
        with tempfile.TemporaryDirectory(dir=arguments.root.parent) as scratch:
            directory = chosen(arguments.root, count, Path(scratch, "fleet"))
            if arguments.dask:
                through_dask(directory, Path(scratch, "out"))
                continue
            seconds, memory = audited(directory, Path(scratch, "out"))
            print(
                f"{count:6} keystores: {seconds:6.1f} s, {count / seconds:5.1f}/s, "
                f"resident: command {memory.own:.0f} MiB, largest worker {memory.child:.0f} MiB"
            )


if __name__ == "__main__":
    main()
