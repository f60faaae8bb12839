"""Reports that cannot be delivered: said before the work starts, and never half of one under its final name."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

AT = ("--engine", "native", "--at", "2026-11-21T12:00:00Z")
OLD = "a report of yesterday\n"

Done = subprocess.CompletedProcess[bytes]
Start = Callable[..., Done]


@pytest.fixture
def start(environment: dict[str, str]) -> Start:
    """Runs the program, with files of `limit` bytes at most if given."""

    def run(*args: str | Path, limit: int | None = None, stdout: int = subprocess.PIPE) -> Done:
        def limited() -> None:
            if limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        return subprocess.run(
            # -B: with a limit Python leaves compiled modules behind that are cut off, for everybody
            [sys.executable, "-B", "-m", "keystore_audit", *map(str, args)],
            stdout=stdout,
            stderr=subprocess.PIPE,
            env=environment,
            preexec_fn=limited,
            timeout=120,
        )

    return run


@pytest.mark.parametrize("kind", ["json", "sarif", "junit", "text"])
def test_a_report_that_does_not_fit_leaves_what_was_there(start: Start, stock: Path, tmp_path: Path, kind: str) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_text(OLD)
    for path in (old, new):
        done = start(stock, *AT, "-o", f"{kind}={path}", limit=1000)
        assert done.returncode == 2
        assert done.stderr == f"keystore-audit: Cannot write the {kind} report to {path}: File too large.\n".encode()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"old": OLD}


@pytest.fixture
def full(tmp_path: Path) -> Iterator[Path]:
    """A file system of 16 pages."""
    place = tmp_path / "small"
    place.mkdir()
    mount = shutil.which("mount")
    if mount is None or os.geteuid() != 0:
        pytest.skip("only root mounts a file system")
    if subprocess.run([mount, "-t", "tmpfs", "-o", "size=64k", "tmpfs", place], capture_output=True).returncode != 0:
        pytest.skip("no file system may be mounted here")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_full_disk_leaves_what_was_there(start: Start, stock: Path, full: Path) -> None:
    (full / "report.json").write_text(OLD)
    done = start(stock, *AT, "-o", f"json={full}/report.json")
    assert done.returncode == 2
    assert b"No space left on device" in done.stderr
    assert b"Traceback" not in done.stderr
    assert {path.name: path.read_text() for path in full.iterdir()} == {"report.json": OLD}
    baseline = ("--reason", "r" * 900, "--owner", "o", "--until", "2027-01-31", "--min-severity", "info")
    (full / "filler").write_bytes(b"x" * 60_000)
    done = start("baseline", "create", stock, "-o", full / "accepted.toml", *AT, *baseline)
    assert done.returncode == 2, done.stderr
    assert sorted(path.name for path in full.iterdir()) == ["filler", "report.json"]


def test_stdout_that_nobody_reads_keeps_no_file_from_being_written(start: Start, stock: Path, tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = start(stock, *AT, "-o", f"json={tmp_path}/report.json", stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b"")
    assert json.loads((tmp_path / "report.json").read_text())["exit_code"] == 1


@pytest.mark.parametrize("command", ["rules", "explain KA203", "--help", "audit --help", "engine"])
def test_nor_does_it_trouble_other_commands(start: Start, command: str) -> None:
    read, write = os.pipe()
    os.close(read)
    done = start(*command.split(), stdout=write)
    os.close(write)
    assert done.stderr == b""


class TestIntoTheKeystore:
    """A report there would change, or replace, what it speaks of."""

    @pytest.fixture
    def keys(self, stock: Path, tmp_path: Path) -> Path:
        return shutil.copytree(stock, tmp_path / "keys", symlinks=True)

    def test_by_its_path_and_over_links(self, start: Start, keys: Path, tmp_path: Path) -> None:
        (tmp_path / "way").symlink_to(keys / "enclaves")
        (tmp_path / "file").symlink_to(keys / "enclaves" / "new.json")
        (tmp_path / "alias").symlink_to(keys)
        before = sorted(path.relative_to(keys) for path in keys.rglob("*"))
        for keystore, target in (
            (keys, keys / "report.json"),
            (keys, keys / "enclaves" / ".." / "report.json"),
            (keys, tmp_path / "way" / "report.json"),
            (keys, tmp_path / "file"),
            (tmp_path / "alias", keys / "report.json"),
            (keys, keys / "enclaves" / "governance.p7s"),
        ):
            done = start(keystore, *AT, "-o", f"json={target}")
            assert (done.returncode, done.stdout) == (2, b""), target
            assert b"lies in the keystore that is audited" in done.stderr
        assert sorted(path.relative_to(keys) for path in keys.rglob("*")) == before

    def test_a_hard_link_is_replaced_and_the_keystore_stays(self, start: Start, keys: Path, tmp_path: Path) -> None:
        inside = keys / "enclaves" / "governance.p7s"
        content = inside.read_bytes()
        os.link(inside, tmp_path / "report.json")
        done = start(keys, *AT, "-o", f"json={tmp_path}/report.json")
        assert done.returncode == 1
        assert inside.read_bytes() == content
        assert json.loads((tmp_path / "report.json").read_text())["verdict"] == "fail"

    def test_of_several_keystores_none_is_written_into(self, start: Start, keys: Path, healthy: Path) -> None:
        done = start(healthy, keys, *AT, "-o", f"json={keys}/report.json")
        assert (done.returncode, done.stdout) == (2, b"")


def test_what_cannot_be_written_is_said_before_the_work_starts(start: Start, tmp_path: Path) -> None:
    """Reading this keystore would be exit code 3."""
    for target in (f"json={tmp_path}/no/report", f"json={tmp_path}"):
        done = start(tmp_path / "no-keystore", *AT, "-o", target)
        assert (done.returncode, done.stdout) == (2, b""), target
    twice = ("-o", f"json={tmp_path}/a", "-o", f"sarif={tmp_path}/./a")
    done = start(tmp_path / "no-keystore", *AT, *twice)
    assert (done.returncode, b"Two reports cannot both be written" in done.stderr) == (2, True)
