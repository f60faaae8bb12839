"""The program as a user starts it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.keystores import run_at
from tests.oracles.zenoh.deployment import Configuration, tls, written

Done = subprocess.CompletedProcess[bytes]
Run = Callable[..., Done]
Network = Callable[..., Path]

CLEAN = {"NO_COLOR", "FORCE_COLOR", "COLUMNS", "CI", "KEYSTORE_AUDIT_ALLOY_JAR"}


@pytest.fixture(scope="session")
def environment(repository: Path) -> dict[str, str]:
    """This process's variables, less those that the program heeds."""
    kept = {name: value for name, value in os.environ.items() if name not in CLEAN}
    return {**kept, "PYTHONPATH": str(repository)}


@pytest.fixture
def keystore_audit() -> Run:
    """Runs `keystore-audit` in this process, as one of its own would be; whatever happens, no traceback comes out."""

    def run(*args: str | Path, env: dict[str, str] | None = None, cwd: Path | None = None) -> Done:
        kept = {name: os.environ.pop(name) for name in CLEAN & os.environ.keys()}
        try:
            done = run_at(cwd or Path.cwd(), *map(str, args), **(env or {}))
        finally:
            os.environ.update(kept)
        assert "Traceback" not in done.stdout + done.stderr, done.stderr
        return Done(done.args, done.returncode, done.stdout.encode(), done.stderr.encode())

    return run


@pytest.fixture(scope="session")
def process(environment: dict[str, str]) -> Run:
    """The same in a process of its own."""

    def run(*args: str | Path, env: dict[str, str] | None = None, **more: object) -> Done:
        done: Done = subprocess.run(
            [sys.executable, "-m", "keystore_audit", *map(str, args)],
            capture_output="stdout" not in more,
            env={**environment, **(env or {})},
            timeout=120,
            check=False,
            **more,  # type: ignore[call-overload]
        )
        assert b"Traceback" not in (done.stdout or b"") + (done.stderr or b""), done.stderr
        return done

    return run


@pytest.fixture(scope="session")
def healthy(repository: Path) -> Path:
    return repository / "sample_keystores/healthy/talker_listener"


@pytest.fixture(scope="session")
def stock(repository: Path) -> Path:
    return repository / "sample_keystores/stock/talker_listener"


@pytest.fixture
def many_enclaves(healthy: Path, tmp_path: Path) -> Path:
    """A keystore of 25 enclaves, which is enough for a progress bar."""
    root = tmp_path / "many"
    shutil.copytree(healthy, root, symlinks=True)
    below = root / "enclaves"
    enclave = next(path.parent for path in sorted(below.rglob("cert.pem")))
    for number in range(25):
        shutil.copytree(enclave, enclave.with_name(f"copy{number}"), symlinks=True)
    return root


@pytest.fixture
def network(tmp_path: Path, keys: Path) -> Network:
    """Writes files of these names into a folder; a configuration gets the certificate of the enclave of its name."""

    def network(**files: Configuration | str | bytes) -> Path:
        folder = tmp_path / "network"
        folder.mkdir()
        for name, each in files.items():
            content = written({**tls(keys, name), **each}) if isinstance(each, dict) else each
            place = folder / (name.replace("_", ".") if "_" in name else f"{name}.json5")
            place.write_bytes(content if isinstance(content, bytes) else content.encode())
        return folder

    return network
