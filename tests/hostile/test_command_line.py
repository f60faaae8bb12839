"""The hostile keystores and the program as a user starts it: what the kernel saw it open, and its exit codes."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.hostile import credentials, directories, documents, envelopes, names
from tests.hostile.client import AT
from tests.hostile.server import PATIENCE, SECONDS, installation
from tests.hostile.store import OUTSIDE, Base, Case, Store, secrets_of, steering

pytestmark = pytest.mark.filterwarnings("ignore:Attribute's length")  # of long names, while they are made

EVERY = {
    case.name: case
    for module in (documents, envelopes, credentials, directories, names)
    for case in module.CASES
    if not case.nobody and not case.fault
}
ADDRESS_SPACE = 1 << 30
"""Bytes that the whole program may map, libraries included; a healthy keystore takes a quarter."""

CALL = re.compile(r"^\d+ +(?P<name>\w+)\((?P<arguments>.*)\) += (?P<result>-?\d+)(?:<(?P<path>.*)>)?")
TRACED = "open,openat,openat2,creat,connect,socket,execve,execveat,fork,vfork,ptrace"

SYSTEM = re.compile(r"/dev/null|/etc/ld\.so\.cache|/etc/mime\.types|/(usr/)?lib(64)?/.*\.so(\.[0-9.]+)?")
"""What modules open that are imported late: xmlschema asks urllib for our own schemas."""


def bounded() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))


def environment(repository: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(repository), "LC_ALL": "C.UTF-8"}


def spoiled(base: Base, folder: Path, case: Case) -> Store:
    folder.mkdir(mode=0o755)
    store = Store.copy(base, folder, "http://127.0.0.1:9")
    case.spoil(store)
    return store


@pytest.mark.parametrize(
    "name",
    [
        "a billion laughs",
        "an external entity that names a file",
        "80,000 comments",
        "300,000 levels of indefinite length",
        "signed by the enclave itself",
        "a key with a password",
        "100,000 PEM blocks",
        "a named pipe for a key",
        "a link to /dev/zero",
        "a file of 10 GB",
        "a subject with a screen that is cleared",
    ],
)
@pytest.mark.parametrize("form", ["text", "json"])
def test_a_process_of_its_own(
    name: str, form: str, base: Base, repository: Path, scratch: Path, tmp_path: Path
) -> None:
    """Bounded by the kernel in memory and time, it ends as the same audit does in the server of the other tests."""
    case = EVERY[name]
    store = spoiled(base, tmp_path / "case", case)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "keystore_audit",
            "--engine",
            "native",
            "--at",
            AT,
            "-f",
            form,
            *case.options,
            store.root,
        ],
        capture_output=True,
        env=environment(repository),
        cwd=scratch,
        timeout=PATIENCE,
        preexec_fn=bounded,
        check=False,
    )
    output = done.stdout + done.stderr
    assert done.returncode == case.exit, done.stderr
    assert b"Traceback" not in output
    assert steering(output) == []
    assert not [secret for secret in (*secrets_of(base), *case.secrets, OUTSIDE) if secret in output]
    assert (b'"exit_code": %d' % case.exit if form == "json" else b"/bystander") in output


REACHING = (*documents.TYPES, *documents.STRUCTURE, *directories.LINKS, *directories.KINDS, *credentials.KEYS)
"""The cases that try to have something else opened, or run."""


def test_the_kernel_sees_no_open_outside(
    base: Base, repository: Path, scratch: Path, tmp_path: Path, oracle: Callable[[str], str]
) -> None:
    """strace(1) names what each descriptor really is, whichever library asked for it.

    In one process: several meet in a socket of multiprocessing's, and read as this one does.
    """
    strace = oracle("strace")
    cases = [case for case in REACHING if case.name in EVERY]
    stores = [spoiled(base, tmp_path / str(number), case) for number, case in enumerate(cases)]
    log = tmp_path / "log"
    command = [sys.executable, "-m", "keystore_audit", "-j", "1", "--engine", "native", "--at", AT, "-f", "json"]
    done = subprocess.run(
        [strace, "-f", "-y", "--seccomp-bpf", "-o", log, "-e", f"trace={TRACED}", *command, *(s.root for s in stores)],
        capture_output=True,
        env=environment(repository),
        cwd=scratch,
        timeout=120,
        check=False,
    )
    assert done.returncode == 4, done.stderr
    calls = [match for line in log.read_text("utf-8", "replace").splitlines() if (match := CALL.match(line))]
    opened = [call["path"] for call in calls if call["path"] is not None]
    first = next(number for number, path in enumerate(opened) if path == str(stores[0].root))
    allowed = (*(f"{store.root}/" for store in stores), *installation())
    strangers = {path for path in opened[first:] if not f"{path}/".startswith(allowed)}
    assert not {path for path in strangers if not SYSTEM.fullmatch(path)}
    assert len({path for path in opened if path.startswith(str(tmp_path))}) > 10 * len(stores)
    others = [call.group() for call in calls if not call["name"].startswith("open")]
    assert len(others) == 1, others  # the program itself
    assert "execve" in others[0]
