"""Tables of a run: they say what the reports say, and answer the questions of docs/fleet.md."""

from __future__ import annotations

import contextlib
import datetime as dt
import io
import json
import re
import shutil
import zoneinfo
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.cli.types import instant
from keystore_audit.fleet import tables
from keystore_audit.fleet.tables import COLUMNS
from tests.cli.keystores import AT, answer, keystore, rule, signed_keystore

NATIVE = ("--engine", "native", "--at", AT)

_GRANT = """<?xml version="1.0" encoding="UTF-8"?>
<dds>
  <permissions>
    <grant name="g">
      <subject_name>{subject}</subject_name>
      <validity><not_before>2024-01-01T00:00:00</not_before><not_after>{end}</not_after></validity>
{rules}
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"""


def grant(subject: str, end: str = "2034-01-01T00:00:00") -> dict[str, bytes]:
    return {"/talker": _GRANT.format(subject=subject, end=end, rules=rule(("rt/chatter",))).encode()}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five robots: two of one image, one whose grant ends soon, one that Humble alone takes, and an empty one."""
    root = tmp_path_factory.mktemp("run")
    image = keystore(root / "fleet/a", {"/talker": (rule(("rt/chatter",)),)})
    shutil.copytree(image, root / "fleet/b")
    signed_keystore(root / "fleet/ends", grant("CN=/talker", "2026-12-01T00:00:00"))
    # Fast DDS 2.6 stops reading at an empty piece, and later ones do not (Permissions.cpp, rfc2253_string_compare).
    signed_keystore(root / "fleet/odd", grant("CN=/talker,,O=acme"))
    (root / "fleet/empty/enclaves").mkdir(parents=True)
    code, _page = answer("-r", root / "fleet", *NATIVE, "-o", f"json={root}/out/", "-o", f"parquet={root}/results")
    assert code in (3, 4)
    return root


def table(run: Path, name: str) -> list[dict[str, Any]]:
    from pyarrow import dataset

    found: list[dict[str, Any]] = dataset.dataset(run / "results" / name).to_table().to_pylist()
    return found


def reports(run: Path) -> dict[str, dict[str, Any]]:
    documents = [json.loads(path.read_text()) for path in (run / "out").rglob("report.json")]
    return {document["keystore"]["path"]: document for document in documents}


def test_tables_say_what_reports_say(run: Path) -> None:
    documents = reports(run)
    rows = {row["keystore"]: row for row in table(run, "keystores")}
    assert len(rows) == len(documents) + 1
    assert [row["error"] is None for row in rows.values()].count(False) == 1
    for path, document in documents.items():
        row = rows[path]
        assert (row["verdict"], row["exit_code"], row["digest"]) == (
            document["verdict"],
            document["exit_code"],
            document["keystore"]["digest"],
        )
        assert {name: row[name] for name in document["summary"]} == document["summary"]
    findings = Counter((row["keystore"], row["code"], row["fingerprint"]) for row in table(run, "findings"))
    assert findings == Counter(
        (path, finding["code"], finding["fingerprint"])
        for path, document in documents.items()
        for finding in document["findings"]
    )
    usable = {(row["keystore"], row["enclave"], row["profile"]): row["usable"] for row in table(run, "enclaves")}
    assert usable == {
        (path, enclave["path"], profile): said["usable"]
        for path, document in documents.items()
        for enclave in document["enclaves"]
        for profile, said in enclave["profiles"].items()
    }
    answers = {(row["keystore"], row["property"], row["profile"]): row["status"] for row in table(run, "properties")}
    assert answers == {
        (path, prop["id"], profile): said["status"]
        for path, document in documents.items()
        for prop in document["properties"]
        for profile, said in prop["profiles"].items()
    }
    assert {row["at"] for name in COLUMNS for row in table(run, name)} == {instant(AT)}


def printed(repository: Path, run: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the program of this number in the manual prints, each line a value."""
    manual = (repository / "docs/fleet.md").read_text()
    program = re.findall(r"```python\n(.*?)```", manual, re.DOTALL)[number]
    monkeypatch.chdir(run)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    names = {"datetime": dt, "zoneinfo": zoneinfo}
    return [eval(line, names) for line in out.getvalue().splitlines()]


def name(path: str) -> str:
    return Path(path).name


def test_what_ends_soon(repository: Path, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    identities, keystores = printed(repository, run, 0, monkeypatch)
    assert identities == []
    assert [name(row["keystore"]) for row in keystores] == ["ends"]
    assert keystores[0]["safe_until"] - instant(AT) < dt.timedelta(days=30)


def test_where_humble_accepts_what_jazzy_refuses(repository: Path, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (rows,) = printed(repository, run, 2, monkeypatch)
    assert [(name(row["keystore"]), row["enclave"]) for row in rows] == [("odd", "/talker")]


def test_parts_are_written_as_they_fill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "PART", 3)
    with tables.Datasets(tmp_path) as datasets:
        for number in range(4):
            datasets.add({"identities": [(instant(AT), "k\udcff", str(number), *["x"] * 4, None, None)] * 2})
    parts = sorted(path.name for path in (tmp_path / "identities").iterdir())
    assert parts == ["part-00000.parquet", "part-00001.parquet"]
    rows = table_at(tmp_path / "identities")
    assert sorted(row["enclave"] for row in rows) == [str(number) for number in range(4) for _ in range(2)]
    assert {row["keystore"] for row in rows} == {r"k\udcff"}
    assert table_at(tmp_path / "findings") == []


def table_at(place: Path) -> list[dict[str, Any]]:
    from pyarrow import dataset

    found: list[dict[str, Any]] = dataset.dataset(place).to_table().to_pylist()
    return found


@pytest.mark.parametrize(("module", "option"), [("pyarrow", "parquet"), ("distributed", "dask")])
def test_without_the_extra_it_says_what_to_install(
    module: str,
    option: str,
    run: Path,
    tmp_path: Path,
    without: Callable[[str], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    without(module)
    more = {"parquet": ("-o", f"parquet={tmp_path}/x"), "dask": ("--executor", "dask://127.0.0.1:9")}[option]
    assert answer(run / "fleet/a", *NATIVE, *more) == (2, "")
    assert "keystore-audit[fleet]" in capsys.readouterr().err


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes a package one that is not installed."""
    import sys

    def hide(package: str) -> None:
        for loaded in [name for name in sys.modules if name.split(".")[0] == package]:
            monkeypatch.delitem(sys.modules, loaded)
        monkeypatch.setitem(sys.modules, package, None)

    return hide
