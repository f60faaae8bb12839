"""Tasks in this process and in others: each has one result, whatever becomes of the process that was at it."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import psutil
import pytest

from keystore_audit.fleet.pools import Lost, Pool, Processes, carried_out
from tests.fleet import work


@pytest.mark.parametrize("pool", [None, Processes(1), Processes(3)], ids=["in turn", "one", "three"])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_each_task_has_its_result_once(pool: Pool | None, count: int) -> None:
    results = list(carried_out(pool, work.square, range(count)))
    assert sorted(results) == [(number, number * number) for number in range(count)]


def test_tasks_are_taken_as_they_are_needed() -> None:
    taken = 0

    def endless() -> Iterator[int]:
        nonlocal taken
        while True:
            taken += 1
            yield taken

    with closing(carried_out(Processes(2), work.square, endless())) as results:
        for _ in range(50):
            next(results)
    assert taken <= 60


def test_processes_are_kept_and_work_where_this_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = [result for _number, result in carried_out(Processes(2), work.where, range(12))]
    assert {directory for _process, directory in found} == {str(tmp_path)}  # type: ignore[misc]
    assert len({process for process, _directory in found}) <= 2  # type: ignore[misc]


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (work.end_at_three, "ended early"),
        (work.leave_at_three, "ended early"),
        (work.end_amid_the_answer, "ended early"),
        (work.fail_at_three, "MemoryError"),
        (work.unsendable_at_three, "could not be carried out"),
    ],
)
@pytest.mark.parametrize("processes", [1, 2])
def test_what_ends_a_process_loses_its_task_alone(function: Callable[[int], int], words: str, processes: int) -> None:
    results = dict(carried_out(Processes(processes), function, range(8)))
    lost = results.pop(3)
    assert isinstance(lost, Lost)
    assert words in lost.reason
    assert results == {number: function(number) for number in range(8) if number != 3}


def test_a_task_that_cannot_be_sent_is_lost_alone() -> None:
    results = dict(carried_out(Processes(2), work.square, [1, lambda: 0, 3]))  # type: ignore[list-item]
    lost = results.pop(1)
    assert isinstance(lost, Lost)
    assert "could not be carried out" in lost.reason
    assert results == {0: 1, 2: 9}


def test_nothing_is_left_running() -> None:
    before = set(psutil.Process().children(recursive=True))
    with closing(carried_out(Processes(2), work.where, itertools.count())) as results:
        processes = {result[0] for _number, result in itertools.islice(results, 10)}  # type: ignore[index]
    assert processes
    assert not [pid for pid in processes if psutil.pid_exists(pid)]
    left = set(psutil.Process().children(recursive=True)) - before
    assert not {process.pid for process in left} & processes


def test_nothing_is_imported_from_where_the_audit_runs(tmp_path: Path) -> None:
    """What is audited may hold modules that are called like Python's own."""
    script = tmp_path / "bin/script.py"
    script.parent.mkdir()
    script.write_text(
        "from keystore_audit.fleet.pools import Processes, carried_out\n"
        "from tests.fleet import work\n"
        "if __name__ == '__main__':\n"
        "    print(sorted(result for _number, result in carried_out(Processes(2), work.square, [1, 2])))\n"
    )
    here = tmp_path / "workspace"
    here.mkdir()
    for module in ("selectors", "signal", "struct", "tempfile", "socket"):
        (here / f"{module}.py").write_text("open('imported', 'w')\nraise SystemExit(1)\n")
    path = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, script], cwd=here, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert (done.stdout, done.stderr, done.returncode) == ("[1, 4]\n", "", 0)
    assert not (here / "imported").exists()
