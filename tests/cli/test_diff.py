"""`keystore-audit diff`: formats, exit codes, and what people read."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

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
HEALTHY = SAMPLES / "healthy/talker_listener"
VEHICLE = SAMPLES / "flows/vehicle_healthy"
WEAKER = SAMPLES / "flows/vehicle_governance_flag"
WIDER = SAMPLES / "flows/vehicle_plain_grant"
UNREADABLE = SAMPLES / "unknown/unreadable_enclave"
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


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("old", "new", "fail_on", "code"),
    [
        (VEHICLE, VEHICLE, "any", 0),
        (VEHICLE, WEAKER, "gained", 1),
        (VEHICLE, WEAKER, "none", 0),
        (WEAKER, VEHICLE, "gained", 0),
        (WEAKER, VEHICLE, "any", 1),
        (HEALTHY, UNREADABLE, "none", 4),
        (UNREADABLE, HEALTHY, "none", 4),
        (UNREADABLE, UNREADABLE, "gained", 4),
    ],
)
def test_exit_codes(diff: Diff, old: Path, new: Path, fail_on: str, code: int, kind: str) -> None:
    assert diff(old, new, "--fail-on", fail_on, "-f", kind)[0] == code


@pytest.mark.parametrize("side", ["old", "new"])
def test_no_keystore_on_either_side(capsys: pytest.CaptureFixture[str], tmp_path: Path, side: str) -> None:
    sides = (tmp_path, HEALTHY) if side == "old" else (HEALTHY, tmp_path)
    assert run(["diff", *map(str, sides)]) == 3
    done = capsys.readouterr()
    assert done.out == ""
    assert str(tmp_path) in done.err


@pytest.mark.parametrize(
    "wrong", [["--fail-on", "lost"], ["--format", "sarif"], ["--domain", "233"], ["--profile", "nobody"], ["third"]]
)
def test_usage(capsys: pytest.CaptureFixture[str], wrong: list[str]) -> None:
    assert run(["diff", str(HEALTHY), str(HEALTHY), *wrong]) == 2
    assert capsys.readouterr().out == ""


def test_the_first_line_says_which_way_rights_went(diff: Diff) -> None:
    assert diff(WIDER, VEHICLE)[1].splitlines()[0].endswith("; effective rights shrank")
    stock, healthy = (VEHICLE.parents[1] / kind / "turtlesim" for kind in ("stock", "healthy"))
    assert diff(stock, healthy)[1].splitlines()[0].endswith("; effective rights grew and shrank")
    assert diff(VEHICLE, VEHICLE)[1].splitlines()[0] == "NO CHANGE in meaning"


def test_text_names_the_cause_with_its_lines_and_what_follows(diff: Diff) -> None:
    code, out = diff(VEHICLE, WIDER)
    assert code == 1
    assert out.startswith("FAIL: 2 of 2 changes fail; effective rights grew\n")
    told = re.sub(r"\s+", " ", out)
    assert (
        "Grants + /gateway may publish /motor_limit (topic) in domain 0. old enclaves/gateway/permissions.p7s:11 "
        "new enclaves/gateway/permissions.p7s:38 + so data can now get from /gateway to /motor (/gateway → "
        "/motor_limit (topic) → /motor), and between 4 more pairs of enclaves" in told
    )
    assert max(map(len, out.splitlines()[2:])) <= 80


def test_no_change_is_one_sentence(diff: Diff) -> None:
    _code, out = diff(VEHICLE, VEHICLE)
    assert out.startswith("NO CHANGE in meaning\n")
    assert " ".join(out.split()) == (
        f"NO CHANGE in meaning {VEHICLE} → {VEHICLE}, at 2026-11-21T12:00:00Z That there are no other rights HOLDS IF "
        "peers announce endpoints truthfully (Cyclone DDS does not check); authorities certified nothing beyond this "
        "list."
    )


@pytest.mark.parametrize(("old", "new", "side"), [(HEALTHY, UNREADABLE, "new"), (UNREADABLE, HEALTHY, "old")])
def test_unknown_is_told_with_its_side_and_line(diff: Diff, old: Path, new: Path, side: str) -> None:
    answer = document(diff(old, new, "-f", "json")[1])
    assert not answer["complete"]
    (unknown,) = answer["unknown"]
    assert (unknown["side"], unknown["enclave"]) == (side, "/listener")
    assert unknown["location"] == {"path": "enclaves/listener/permissions.p7s", "line": 47}
    rights = [each for each in answer["changes"] if each["layer"] != "trust"]
    assert rights
    assert not [each for each in rights if "/listener" in each["enclaves"]], "it is not known what it may do"
    for kind in ("text", "markdown"):
        out = diff(old, new, "-f", kind)[1]
        assert "UNKNOWN" in out.splitlines()[0]
        assert "could not be read" in out


STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff\U000e0000-\U000e007f]")


@pytest.mark.parametrize("what", NAMES)
def test_hostile_names_are_shown_and_steer_nothing(diff: Diff, tmp_path: Path, what: str) -> None:
    """Topics as far as XML can hold them, and directories."""
    printable = "".join(each for each in NAMES[what] if each >= " ")
    topic = escape(printable).translate(dict.fromkeys(map(ord, "*?[\\")))
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


def test_domains_and_profiles_narrow_it(diff: Diff) -> None:
    bridged = SAMPLES / "flows/vehicle_bridged_domain"
    assert diff(VEHICLE, bridged)[0] == 1
    assert diff(VEHICLE, bridged, "--domain", "0", "--profile", "cyclonedds")[0] == 0
    code, out = diff(VEHICLE, bridged, "--domain", "0", "-f", "json")  # Fast DDS applies rules of domain 1 there too
    told = {
        (each["kind"], tuple(sorted({p.split("-")[0] for p in each["profiles"]}))) for each in document(out)["changes"]
    }
    assert (code, told) == (1, {("own-endpoint", ("fastdds",))})
    answer = document(diff(VEHICLE, bridged, "--domain", "1", "--profile", "fastdds-2.6", "-f", "json")[1])
    assert (answer["domain"], answer["profiles"]) == (1, ["fastdds-2.6"])
    assert {each["names"]["domains"] for each in answer["changes"]} == {"1"}


def test_the_keystores_are_left_as_they_are(diff: Diff, tmp_path: Path) -> None:
    copies = [shutil.copytree(each, tmp_path / each.name, symlinks=True) for each in (VEHICLE, WEAKER)]
    before = [_listing(copy) for copy in copies]
    diff(*copies)
    assert [_listing(copy) for copy in copies] == before


def _listing(root: Path) -> list[tuple[str, int]]:
    return sorted((str(path), path.lstat().st_mtime_ns) for path in root.rglob("*"))


@pytest.mark.parametrize(("profile", "told"), [("cyclonedds-11", True), ("fastdds-3.6", False)])
@pytest.mark.parametrize("kind", FORMATS)
def test_what_an_attacker_is_assumed_to_announce_is_said(diff: Diff, profile: str, kind: str, told: bool) -> None:
    _code, out = diff(VEHICLE, WEAKER, "--profile", profile, "-f", kind)
    told_of = " ".join(out.split())
    assert ("announce endpoints truthfully" in told_of or "announces truthfully" in told_of) == told


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


def test_without_an_assumption_nothing_is_told_to_rest_on_it() -> None:
    old = new = str(SAMPLES / "healthy/turtlesim")
    code, with_it = answer("diff", old, new, "--at", AT)
    without, told = answer("diff", old, new, "--at", AT, "--no-assume", "truthful-announcements")
    assert (code, without) == (0, 0)
    assert "announce endpoints truthfully" in " ".join(with_it.split())
    assert "announce endpoints truthfully" not in " ".join(told.split())
    assert "HOLDS IF" in told


@pytest.mark.parametrize("where", ["old", "new"])
def test_a_file_that_nobody_read_is_unknown_where_it_is_new(where: str, tmp_path: Path) -> None:
    stores = {side: tmp_path / side for side in ("old", "new")}
    for store in stores.values():
        shutil.copytree(SAMPLES / "healthy/turtlesim", store, symlinks=True)
    with (stores[where] / "maps.bag").open("wb") as bag:
        bag.truncate(1 << 33)
    code, told = answer("diff", str(stores["old"]), str(stores["new"]), "--at", AT)
    assert (code, "maps.bag" in told) == ((0, False) if where == "old" else (4, True))
