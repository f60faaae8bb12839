"""The release gate of docs/ci.md, taken out of the page and run: what it blocks, what it lets through and leaves."""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes

from tests.test_samples import SAMPLES, as_built
from tools.samples.healthy import TURTLESIM, healthy
from tools.samples.store import write

pytestmark = [pytest.mark.alloy]


@pytest.fixture(scope="module")
def scripts(repository: Path) -> dict[str, str]:
    """The blocks of the page that have a name."""
    page = (repository / "docs" / "ci.md").read_text("utf-8")
    return dict(re.findall(r"<!-- (\w+\.sh) -->\n```bash\n(.*?)```", page, re.DOTALL))


class Workspace:
    """A folder as a pipeline has it, with `keystore-audit` on the path."""

    def __init__(self, folder: Path, repository: Path, scripts: dict[str, str]) -> None:
        self.folder = folder
        self._scripts = scripts
        programs = folder.parent / "bin"
        programs.mkdir()
        program, installed = programs / "keystore-audit", Path(sys.executable).parent / "keystore-audit"
        program.write_text(f'#!/bin/sh\nexec {shlex.quote(str(installed))} "$@"\n')
        program.chmod(0o755)
        kept = {name: value for name, value in os.environ.items() if name not in ("CI", "STEP_SUMMARY")}
        path = f"{programs}{os.pathsep}{os.environ['PATH']}"
        self._environment = {**kept, "PATH": path, "PYTHONPATH": str(repository)}

    def take(self, sample: str) -> None:
        """Make `keys/` of a sample, with the time of its samples."""
        as_built(SAMPLES / f"{sample}.toml", self.folder / "keys")
        self.declare()

    def declare(self) -> None:
        """Declare the authorities of `keys/` as the gate wants it."""
        lines = ["[authorities]"]
        for role in ("identity", "permissions"):
            pem = (self.folder / f"keys/public/{role}_ca.cert.pem").read_bytes()
            digest = x509.load_pem_x509_certificate(pem).fingerprint(hashes.SHA256())
            lines.append(f'{role} = ["sha256:{digest.hex()}"]')
        (self.folder / "keystore-audit.toml").write_text("\n".join(lines))

    def run(self, script: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", self._scripts[script]],
            cwd=self.folder,
            env={**self._environment, **more},
            capture_output=True,
            text=True,
            timeout=120,
        )

    def report(self, name: str) -> dict[str, Any]:
        loaded: dict[str, Any] = json.loads((self.folder / "reports" / name).read_text())
        return loaded


@pytest.fixture
def workspace(tmp_path: Path, repository: Path, scripts: dict[str, str]) -> Workspace:
    folder = tmp_path / "work"
    folder.mkdir()
    return Workspace(folder, repository, scripts)


@pytest.mark.parametrize(
    ("sample", "code"),
    [("stock/talker_listener", 1), ("unknown/unreadable_enclave", 4)],
)
def test_bad_and_broken_releases_are_blocked(workspace: Workspace, sample: str, code: int) -> None:
    workspace.take(sample)
    done = workspace.run("gate.sh", STEP_SUMMARY=str(workspace.folder / "summary.md"))
    assert done.returncode == code, done.stderr
    assert not (workspace.folder / "release").exists()
    assert workspace.report("keys.statement.json")["predicate"]["result"] == "FAILED"
    assert workspace.report("keys.svr.json")["predicate"]["properties"] == []
    assert (workspace.folder / "summary.md").read_text().startswith("## keystore-audit: ")
    assert sorted(path.name for path in (workspace.folder / "reports").iterdir()) == [
        "keys.html", "keys.md", "keys.sarif", "keys.statement.json", "keys.svr.json", "keys.xml",
    ]  # fmt: skip
    assert workspace.run("check.sh", PYTHONOPTIMIZE="1").returncode != 0


def test_whatever_says_0_without_a_report_ships_nothing(workspace: Workspace) -> None:
    workspace.take("healthy/turtlesim")
    (workspace.folder.parent / "bin" / "keystore-audit").write_text("#!/bin/sh\n")
    assert workspace.run("gate.sh").returncode == 4
    assert not (workspace.folder / "release").exists()


def test_what_fails_on_the_way_ships_nothing(workspace: Workspace) -> None:
    workspace.take("healthy/turtlesim")
    assert workspace.run("gate.sh", STEP_SUMMARY=str(workspace.folder)).returncode != 0
    assert not (workspace.folder / "release").exists()
    shutil.rmtree(workspace.folder / "keys" / "public")
    assert workspace.run("gate.sh").returncode != 0
    assert not (workspace.folder / "release").exists()


def test_a_good_release_passes_and_its_attestation_speaks_of_these_very_files(workspace: Workspace) -> None:
    keys = workspace.folder / "keys"  # of its own: a sample's are published, and no good on a robot
    write(healthy(secrets.token_hex(8), TURTLESIM, private_keys=True).tree(), keys)
    workspace.declare()
    done = workspace.run("gate.sh")
    assert (done.returncode, done.stderr) == (0, "")
    release = workspace.folder / "release"
    statement = workspace.report("keys.svr.json")
    passed = "KEYSTORE_AUDIT_PASS_IF_NOTHING_ELSE_CERTIFIED_AND_TRUTHFUL_ANNOUNCEMENTS"
    assert passed in statement["predicate"]["properties"]
    assert workspace.report("keys.statement.json")["predicate"]["result"] in ("PASSED", "WARNED")
    assert statement["predicate"]["verifier"]["keystoreAudit"]["weakened"] == []
    assert statement["predicate"]["verifier"]["keystoreAudit"]["engines"].keys() == {"alloy", "native"}
    files = {path.relative_to(release).as_posix() for path in release.rglob("*") if path.is_file()}
    hashes = {subject["name"]: subject["digest"]["sha256"] for subject in statement["subject"]}
    assert hashes.keys() == {name for name in files if not (release / name).is_symlink()}
    for name, digest in hashes.items():
        assert hashlib.sha256((release / name).read_bytes()).hexdigest() == digest
    checked = workspace.run("check.sh")
    assert (checked.returncode, checked.stderr) == (0, "")
    (workspace.folder / "json.py").write_text("raise SystemExit('a module of the working directory')\n")
    assert workspace.run("check.sh").returncode == 0
    _tampered(workspace, release)


def _tampered(workspace: Workspace, release: Path) -> None:
    """Every way to change a release after its audit breaks the check, and taking it back mends it."""
    kept = release.with_name("kept")
    shutil.copytree(release, kept, symlinks=True)
    random, keyboard = release / "enclaves" / "random", release / "enclaves" / "keyboard"

    def retarget() -> None:
        (random / "governance.p7s").unlink()
        (random / "governance.p7s").symlink_to("../keyboard/permissions.p7s")

    for change in (
        lambda: shutil.copyfile(keyboard / "permissions.p7s", random / "permissions.p7s"),  # swapped
        lambda: (random / "cert.pem").write_bytes((random / "cert.pem").read_bytes() + b"\n"),
        lambda: (random / "permissions_old.p7s").write_bytes((keyboard / "permissions.p7s").read_bytes()),  # added
        lambda: shutil.copytree(random, release / "enclaves" / "another", symlinks=True),
        lambda: (random / "permissions.xml").unlink(missing_ok=False),
        retarget,
    ):
        change()
        assert workspace.run("check.sh").returncode != 0
        shutil.rmtree(release)
        shutil.copytree(kept, release, symlinks=True)
    assert workspace.run("check.sh").returncode == 0
