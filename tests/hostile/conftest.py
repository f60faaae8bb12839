"""One server that audits hostile keystores, and what has to hold for every one of them."""

from __future__ import annotations

import json
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct

from tests.hostile.client import AT, Guard, Server
from tests.hostile.store import ANY, OUTSIDE, Base, Case, Store, build, secrets_of, steering

MEMORY = 200 << 20
"""Bytes above the baseline that a hostile keystore may cost (issue 4)."""


class Audit(Struct, frozen=True):
    """What came of auditing one keystore by the command line."""

    exit: int
    text: bytes
    errors: bytes
    report: dict[str, Any]
    peak: int
    opens: int

    def findings(self) -> set[tuple[str, str, int | None]]:
        return {
            (finding["code"], place["path"], place["line"])
            for finding in self.report["findings"]
            for place in finding["locations"]
        }

    def outcomes(self, enclave: str) -> set[tuple[str, str, str]]:
        """What the rules say about one enclave; not KA626, which asks whether others read."""
        return {
            (each["rule"], each["subject"], each["outcome"])
            for each in self.report["outcomes"]
            if each["rule"] != "KA626" and f"/{enclave}" in each["subject"]
        }


@pytest.fixture(scope="session")
def scratch() -> Iterator[Path]:
    """A directory that every user of the machine may enter."""
    with tempfile.TemporaryDirectory(prefix="hostile") as folder:
        path = Path(folder).resolve()
        path.chmod(0o755)
        yield path


@pytest.fixture(scope="session")
def base(scratch: Path) -> Base:
    return build(scratch / "base")


@pytest.fixture(scope="session")
def listener() -> Iterator[socket.socket]:
    """A server that nobody may call."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.setblocking(False)
        yield listening


@pytest.fixture(scope="session")
def server(repository: Path, scratch: Path) -> Iterator[Server]:
    running = Server(repository)
    written = scratch / "written"
    written.mkdir()
    written.chmod(0o777)
    yield running
    running.close()


@pytest.fixture(scope="session")
def audit_at(server: Server, base: Base, scratch: Path) -> Callable[..., Audit]:
    """Audits the keystore at a path, watched; whatever is there, these things hold."""
    secrets = tuple(secrets_of(base))

    def audit(root: Path, *options: str, nobody: bool = False) -> Audit:
        written = scratch / "written/report.json"
        written.unlink(missing_ok=True)
        chosen = ("--engine", "native", "--at", AT, "--color", "always", "-v", *options)
        answer = server.ask(
            argv=["audit", str(root), *chosen, "-o", f"json={written}"],
            root=str(root),
            written=f"{written.parent}/",
            nobody=nobody,
        )
        text, errors = answer["stdout"].encode("latin-1"), answer["stderr"].encode("latin-1")
        assert answer["exit"] in (0, 1, 4), (answer["exit"], text[-2000:], errors)  # a negative one is a signal
        assert b"Traceback" not in text + errors
        assert b"fault in keystore-audit" not in errors
        assert b"Warning" not in errors
        assert answer["strangers"] == []
        raw = written.read_bytes()
        report = json.loads(raw)
        assert report["exit_code"] == answer["exit"]
        assert not [secret for secret in secrets if secret in text + errors + raw]
        assert OUTSIDE not in text + errors + raw
        assert steering(text) == steering(errors) == []
        assert raw.isascii()
        return Audit(answer["exit"], text, errors, report, answer["peak"], answer["opens"])

    return audit


@pytest.fixture(scope="session")
def healthy(base: Base, audit_at: Callable[..., Audit], server: Server) -> Audit:
    """What is said of the keystore before it is spoiled: it passes, so that no 4 or 1 is its own."""
    options = ["--engine", "native", "--at", AT]
    server.ask(argv=["audit", str(base.root), *options], root=str(base.root), written="/dev/null/", warm=True)
    audited = audit_at(base.root)
    assert audited.exit == 0
    assert audited.outcomes("victim")
    assert audited.outcomes("bystander")
    return audited


@pytest.fixture(scope="session")
def hostile(
    base: Base, audit_at: Callable[..., Audit], healthy: Audit, scratch: Path, listener: socket.socket
) -> Callable[[Case], Audit]:
    """Spoils a copy of the keystore as a case says, audits it and looks at everything that the case promises."""

    def check(case: Case) -> Audit:
        folder = Path(tempfile.mkdtemp(dir=scratch))
        folder.chmod(0o755)
        store = Store.copy(base, folder, f"http://127.0.0.1:{listener.getsockname()[1]}")
        try:
            case.spoil(store)
            guard = Guard(store.outside)
            try:
                audited = audit_at(store.root, *case.options, nobody=case.nobody)
                assert guard.seen() == b"", "a file outside the keystore was opened"
            finally:
                guard.close()
            with pytest.raises(BlockingIOError):
                listener.accept()
            _holds(case, store, audited, healthy)
        finally:
            if store.victim.is_dir():
                store.victim.chmod(0o755)
            shutil.rmtree(folder)
        return audited

    return check


def _holds(case: Case, store: Store, audited: Audit, healthy: Audit) -> None:
    found = audited.findings()
    told = "\n".join(sorted(f"{each}" for each in found - healthy.findings()))
    for wanted in case.finds:
        line = wanted.line_in(store.root)
        places = {(code, path, ANY if line == ANY else where) for code, path, where in found}
        assert (wanted.code, wanted.path, line) in places, f"{wanted} at line {line} is not in\n{told}"
    assert audited.exit == case.exit, told
    assert audited.report["verdict"] == {0: "pass", 1: "fail", 4: "incomplete"}[case.exit]
    if not case.bystander_changes:
        assert audited.outcomes("bystander") == healthy.outcomes("bystander")
    output = audited.text + audited.errors + json.dumps(audited.report).encode()
    assert not [secret for secret in case.secrets if secret in output]
    assert audited.peak - healthy.peak < MEMORY
