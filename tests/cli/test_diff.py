"""`keystore-audit diff`: formats, exit codes, and what people read."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.cli.program import run
from keystore_audit.diff import compare_keystores
from keystore_audit.model.comparison.change import FailOn
from keystore_audit.profiles import resolve
from keystore_audit.report.diff_text import markdown
from keystore_audit.report.markdown import MAX_LENGTH
from tests.cli.keystores import AT, answer, keystore, rule
from tests.hostile.names import MARK, NAMES
from tests.schemas import schema

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
VEHICLE = SAMPLES / "flows/vehicle_healthy"
WEAKER = SAMPLES / "flows/vehicle_governance_flag"
WIDER = SAMPLES / "flows/vehicle_plain_grant"
FORMATS = ("text", "json", "markdown")

Diff = Callable[..., tuple[int, str]]


@pytest.fixture
def diff(capsys: pytest.CaptureFixture[str]) -> Diff:
    def told(old: Path, new: Path, *arguments: str) -> tuple[int, str]:
        code = run(["diff", str(old), str(new), "--at", AT, *arguments])
        return code, capsys.readouterr().out

    return told


def document(out: str) -> dict[str, Any]:
    """The JSON, valid against its schema."""
    answer: dict[str, Any] = json.loads(out)
    schema("diff").validate(answer)
    return answer


STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff\U000e0000-\U000e007f]")


@pytest.mark.parametrize("what", NAMES)
def test_hostile_names_are_shown_and_steer_nothing(diff: Diff, tmp_path: Path, what: str) -> None:
    """Topics as far as XML can hold them, and directories."""
    printable = "".join(each for each in NAMES[what] if each >= " ")
    topic = printable.translate(dict.fromkeys(map(ord, "*?[\\")))
    path = "/" + MARK + NAMES[what].replace("/", "")[:16]
    plain = (rule(publish=("rt/x",)),)
    old = keystore(tmp_path / "old", {"/a": plain})
    new = keystore(tmp_path / "new", {"/a": (rule(publish=("rt/x", MARK + topic)),), path: plain})
    for kind in FORMATS:
        code, out = diff(old, new, "-f", kind)
        assert code in (1, 4)
        assert MARK in out
        assert not STEERS.search(out), kind
    comment = diff(old, new, "-f", "markdown")[1]
    assert not re.search(r"(?<!\\)[<`|\]]", comment)
    document(diff(old, new, "-f", "json")[1])


def test_a_comment_on_a_pull_request_has_a_limit() -> None:
    """What does not fit is counted, and no change is shown in part."""
    found = compare_keystores(
        VEHICLE, WIDER, Circumstances(profiles=resolve(()), at=datetime.fromisoformat(AT.replace("Z", "+00:00")))
    )
    (first, *_others) = found.changes
    many = replace(found, changes=tuple(replace(first, enclaves=(f"/e{n}", "/x")) for n in range(1000)))
    out = markdown(many, FailOn.GAINED)
    assert len(out) <= MAX_LENGTH + 100
    shown = out.count("- **gained**")
    assert 0 < shown < 1000
    assert out.count("  - so *gained*") == shown * len(first.consequences)
    assert f"{1000 - shown} more entries" in out


def test_changes_alike_but_for_the_enclaves_paths_are_shown_once(diff: Diff, tmp_path: Path) -> None:
    stores = [
        keystore(
            tmp_path / name,
            {f"/r{n}/arm": (rule(publish=("rt/a", *([f"rt/r{n}/arm/state"] if more else []))),) for n in range(20)},
        )
        for name, more in (("old", False), ("new", True))
    ]
    _code, out = diff(*stores)
    assert out.count("may publish") == 1
    assert "and 16 more" in out
    changes = document(diff(*stores, "-f", "json")[1])["changes"]
    assert len([each for each in changes if each["layer"] == "grants"]) == 20


def test_the_keystores_are_left_as_they_are(diff: Diff, tmp_path: Path) -> None:
    copies = [shutil.copytree(each, tmp_path / each.name, symlinks=True) for each in (VEHICLE, WEAKER)]
    before = [_listing(copy) for copy in copies]
    diff(*copies)
    assert [_listing(copy) for copy in copies] == before


def _listing(root: Path) -> list[tuple[str, int]]:
    return sorted((str(path), path.lstat().st_mtime_ns) for path in root.rglob("*"))


@pytest.fixture
def vehicles(tmp_path: Path) -> tuple[Path, Path]:
    """The same vehicle, of which the second gives a wider grant."""
    for name, sample in (("old", VEHICLE), ("new", WIDER)):
        shutil.copytree(sample, tmp_path / name, symlinks=True)
    return tmp_path / "old", tmp_path / "new"


@pytest.mark.parametrize("name", ["identity_ca", "permissions_ca"])
@pytest.mark.parametrize("change", ["more", "fewer"])
def test_other_authorities_are_told_first(name: str, change: str, vehicles: tuple[Path, Path], diff: Diff) -> None:
    """Before what is gained by a grant, also where one is taken out."""
    theirs = (SAMPLES / "rules/KA223-unexpected-authority/bad/public/identity_ca.cert.pem").read_bytes()
    old, new = vehicles
    kinds = [each["kind"] for each in document(diff(old, new, "-f", "json")[1])["changes"]]
    assert "authority" not in kinds
    assert kinds
    file = (new if change == "more" else old) / f"public/{name}.cert.pem"
    file.write_bytes(file.read_bytes() + theirs[theirs.rindex(b"-----BEGIN") :])
    changes = document(diff(old, new, "-f", "json")[1])["changes"]
    assert changes[0]["kind"] == "authority"
    assert changes[0]["direction"] == ("gained" if change == "more" else "lost")
    assert kinds[0] in [each["kind"] for each in changes]


def test_an_authority_of_new_enclaves_alone_is_told(vehicles: tuple[Path, Path], diff: Diff) -> None:
    """In public/, from where enclaves that are made later get it, or of an enclave that OLD has not."""
    old, _new = vehicles
    other = SAMPLES / "rules/KA223-unexpected-authority/good/public/identity_ca.cert.pem"
    new = old.with_name("again")
    shutil.copytree(old, new, symlinks=True)
    assert diff(old, new)[0] == 0
    enclave = next((new / "enclaves").glob("*/cert.pem")).parent
    shutil.copytree(enclave, new / "enclaves/late")
    late = new / "enclaves/late/identity_ca.cert.pem"
    late.write_bytes(other.read_bytes())
    first = document(diff(old, new, "-f", "json")[1])["changes"][0]
    assert (first["kind"], first["direction"]) == ("authority", "gained")


@pytest.mark.parametrize("where", ["old", "new"])
def test_a_file_that_nobody_read_is_unknown_where_it_is_new(where: str, tmp_path: Path) -> None:
    stores = {side: tmp_path / side for side in ("old", "new")}
    for store in stores.values():
        shutil.copytree(SAMPLES / "healthy/turtlesim", store, symlinks=True)
    with (stores[where] / "maps.bag").open("wb") as bag:
        bag.truncate(1 << 33)
    code, told = answer("diff", str(stores["old"]), str(stores["new"]), "--at", AT)
    assert (code, "maps.bag" in told) == ((0, False) if where == "old" else (4, True))
