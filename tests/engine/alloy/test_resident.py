"""The class that calls the Analyzer is what its source says, and the archive of classes is used only as it was made."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from keystore_audit.engine.alloy import archive, install
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.kept import kept
from keystore_audit.engine.alloy.runner import examine, make_archive
from keystore_audit.errors import EngineFailed
from keystore_audit.properties import Status
from tests.conftest import lacking
from tests.engine.systems import healthy, random_system
from tools import resident_class

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

CLASS = Path(install.__file__).with_name(install.CLASS)


def test_the_class_is_that_of_its_source(analyzer: Engine) -> None:
    try:
        compiled = resident_class.compiled(analyzer)
    except (OSError, RuntimeError) as error:  # requests' errors are OSErrors
        lacking(f"the Eclipse compiler ({error})")
    assert compiled == CLASS.read_bytes()


def test_another_class_is_not_run(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (install.CLASS, "install.py"):
        shutil.copy(CLASS.with_name(name), tmp_path / name)
    content = bytearray((tmp_path / install.CLASS).read_bytes())
    content[100] ^= 1
    (tmp_path / install.CLASS).write_bytes(content)
    monkeypatch.setattr(install, "__file__", str(tmp_path / "install.py"))
    with pytest.raises(EngineFailed, match="damaged"):
        examine([healthy()], java=analyzer.java, jar=analyzer.jar, timeout=120)


@pytest.fixture(scope="module")
def kept_classes(analyzer: Engine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with an archive."""
    place = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(place))
        install.install(analyzer.jar)
        old = place / "keystore-audit/alloy-classes-0123456789abcdef-0.aot"
        old.touch()
        made = make_archive(analyzer.java, analyzer.jar)
        if made is None:
            lacking("a Java that keeps classes")
        assert archive.find(analyzer.java) == made
        assert not old.exists()
    return place


@pytest.fixture
def cache(kept_classes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(kept_classes, tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/keystore-audit"


def loaded_from_it(analyzer: Engine, tmp_path: Path, *, release: bytes = b"") -> bool:
    """Whether a JVM of the program takes the Analyzer's classes from the archive; it answers in any case."""
    java, log = tmp_path / "bin/java", tmp_path / "classes.log"
    java.parent.mkdir()
    java.write_text(f"#!/bin/sh\nexec '{analyzer.java}' -Xlog:class+load:file='{log}' \"$@\"\n")
    java.chmod(0o755)
    real = analyzer.java.resolve().parents[1] / "release"
    (tmp_path / "release").write_bytes(release or real.read_bytes())
    (found,) = examine([healthy()], java=java, jar=analyzer.jar, timeout=120)
    assert {answer.status for answer in found.answers.values()} == {Status.HOLDS}
    (line,) = [line for line in log.read_text().splitlines() if " edu.mit.csail.sdg.parser.CompModule " in line]
    return "shared objects file" in line


def test_classes_come_from_the_archive(analyzer: Engine, cache: Path, tmp_path: Path) -> None:
    assert len([*cache.glob("*.aot")]) == 1
    assert loaded_from_it(analyzer, tmp_path)


def test_without_one_the_jar_is_read(analyzer: Engine, cache: Path, tmp_path: Path) -> None:
    (found,) = cache.glob("*.aot")
    found.unlink()
    assert not loaded_from_it(analyzer, tmp_path)


@pytest.mark.parametrize("place", [5_000, -1])
def test_one_byte_makes_it_another_archive(place: int, analyzer: Engine, cache: Path, tmp_path: Path) -> None:
    (found,) = cache.glob("*.aot")
    content = bytearray(found.read_bytes())
    content[place] ^= 1
    found.write_bytes(content)
    assert archive.content(analyzer.java) is None, "so that `engine install` makes another"
    assert not loaded_from_it(analyzer, tmp_path)


def test_one_that_others_may_write_is_not_used(analyzer: Engine, cache: Path, tmp_path: Path) -> None:
    (found,) = cache.glob("*.aot")
    found.chmod(0o602)
    assert not loaded_from_it(analyzer, tmp_path)


def test_one_of_another_java_is_not_used(analyzer: Engine, cache: Path, tmp_path: Path) -> None:  # noqa: ARG001
    assert not loaded_from_it(analyzer, tmp_path, release=b'JAVA_VERSION="25.0.3"\n')


def test_an_older_java_keeps_none(tmp_path: Path) -> None:
    (tmp_path / "release").write_text('JAVA_VERSION="24.0.1"\n')
    assert not archive.is_made_by(tmp_path / "bin/java")
    (tmp_path / "release").write_text('JAVA_VERSION="25"\n')
    assert archive.is_made_by(tmp_path / "bin/java")


def test_one_jvm_does_not_fill_its_memory(analyzer: Engine) -> None:
    """What a question leaves is less than a megabyte."""
    with kept():
        for number in range(12):
            systems = [random_system(number)]
            assert examine(systems, java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=40)
