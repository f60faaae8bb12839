"""A Dask scheduler and its workers, as a user starts them: a lost worker loses no keystore."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.cli.program import run as run_here
from tests.cli.keystores import AT, answer, keystore, rule

ROBOTS = 40
NATIVE = ("--engine", "native", "--at", AT)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("fleet")
    first = keystore(root / "r000", {"/talker": (rule(("rt/chatter",)),)})
    for number in range(1, ROBOTS):
        shutil.copytree(first, root / f"r{number:03}")
    return root


class Dask:
    """A scheduler of this machine and the workers that a test starts."""

    def __init__(self, directory: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{free.getsockname()[1]}"
        self._directory = directory
        self._log = (directory / "log").open("wb")
        self.processes: list[subprocess.Popen[bytes]] = []
        self._start("scheduler", "--host", "127.0.0.1", "--port", self.address.rpartition(":")[2])

    def worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", f"tcp://{self.address}", "--nthreads", "1", "--no-nanny")

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options, "--no-dashboard"]
        log = {"stdout": self._log, "stderr": subprocess.STDOUT}
        self.processes.append(subprocess.Popen(command, cwd=self._directory, **log))  # type: ignore[call-overload]
        return self.processes[-1]

    def end(self) -> None:
        for process in reversed(self.processes):
            process.kill()
            process.wait()
        self._log.close()


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[Dask]:
    started = Dask(tmp_path)
    try:
        yield started
    finally:
        started.end()


def summary(directory: Path) -> Any:
    return json.loads((directory / "summary.json").read_text())


@pytest.mark.slow
def test_every_keystore_is_audited_once_though_a_worker_is_killed(fleet: Path, tmp_path: Path, dask: Dask) -> None:
    first, second = dask.worker(), dask.worker()
    command = [sys.executable, "-m", "keystore_audit", "-r", str(fleet), *NATIVE, "-o", f"json={tmp_path}/out/"]
    running = subprocess.Popen(
        [*command, "--executor", f"dask://{dask.address}"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    end = time.monotonic() + 60
    while len(list((tmp_path / "out").rglob("report.json"))) < 5:
        assert time.monotonic() < end
        time.sleep(0.01)
    first.kill()
    out, err = running.communicate(timeout=120)
    rows = summary(tmp_path / "out")["keystores"]
    assert (running.returncode, err) == (1, b"")
    assert second.poll() is None
    assert [row["path"] for row in rows] == [str(fleet / f"r{number:03}") for number in range(ROBOTS)]
    assert {row["verdict"] for row in rows} == {"fail"}
    assert {reason["code"] for row in rows for reason in row["failing"]} >= {"KA666"}
    assert out.splitlines()[-1].startswith(b"40 keystores: 0 incomplete, 40 fail, 0 pass")

    here = tmp_path / "here"
    answer("-r", fleet, *NATIVE, "-o", f"json={here}/")
    assert summary(here) == summary(tmp_path / "out")
    for row in rows:
        assert (here / row["report"]).read_bytes() == (tmp_path / "out" / row["report"]).read_bytes()


@pytest.mark.slow
def test_a_worker_of_another_version_is_no_pass(
    fleet: Path, tmp_path: Path, dask: Dask, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    dask.worker()
    monkeypatch.setattr("keystore_audit.fleet.task.__version__", "0.0.1")
    targets = ("-o", f"json={tmp_path}/out/", "--executor", f"dask://{dask.address}")
    assert run_here(["audit", str(fleet / "r000"), *NATIVE, *targets]) == 4
    assert "expected 0.0.1" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["127.0.0.1:8786", "dask://", "dask://host", "tcp://host:1", "dask://host:x"])
def test_an_address_that_is_none(address: str, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(fleet / "r000", *NATIVE, "--executor", address) == (2, "")
    assert "dask://HOST:PORT" in capsys.readouterr().err


def test_a_scheduler_that_does_not_answer(
    fleet: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("keystore_audit.fleet.pools.SCHEDULER_PATIENCE", 0.5)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # bound and not listening
        address = f"dask://127.0.0.1:{nobody.getsockname()[1]}"
        assert answer(fleet / "r000", *NATIVE, "--executor", address) == (2, "")
    assert "No Dask scheduler answers" in capsys.readouterr().err
