"""`baseline create` and `baseline prune` as a user starts them."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import pytest

from tests.cli.keystores import answer
from tests.test_samples import SAMPLES, as_built

AT = "2026-11-21T12:00:00Z"
NATIVE = ("--engine", "native", "--at", AT)
WHY = ("--reason", "Mended in the release of January", "--owner", "Ada", "--until", "2027-01-31")


@pytest.fixture
def stock(tmp_path: Path) -> Path:
    keystore, _expected = as_built(SAMPLES / "stock/talker_listener.toml", tmp_path / "keys")
    return keystore


def audited(keystore: Path, *options: str | Path) -> tuple[int, dict[str, int], list[str]]:
    """The exit code, the counts and what weakens the gate."""
    code, text = answer("audit", keystore, *NATIVE, "-f", "json", *options)
    report = json.loads(text)
    return code, report["summary"], report["weakened"]


def test_from_a_failing_gate_to_a_passing_one_and_back(
    stock: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "accepted.toml"
    assert audited(stock)[0] == 1
    assert answer("baseline", "create", stock, "-o", file, *NATIVE, *WHY) == (0, "")
    said = capsys.readouterr().err
    count = int(re.findall(r"accepted\.toml: (\d+) findings accepted until 2027-01-31\.", said)[0])
    assert file.read_text().count("[[accepted]]") == count

    code, summary, weakened = audited(stock, "--baseline", file)
    assert (code, sum(summary.values())) == (0, 0)
    assert f"{count} findings accepted by {file}" in weakened

    before = file.read_bytes()
    assert answer("baseline", "prune", file, stock, *NATIVE) == (0, "")
    assert f"0 entries dropped, {count} kept." in capsys.readouterr().err
    assert file.read_bytes() == before

    shutil.rmtree(stock / "enclaves" / "listener")
    code, dropped = answer("baseline", "prune", file, stock, *NATIVE)
    said = capsys.readouterr().err
    lines = dropped.splitlines()
    assert (code, bool(lines)) == (0, True)
    told = r"KA\d{3} with fingerprint [0-9a-f]{12} \((nothing of the kind was found|what it is about has changed)\): .+"
    assert all(re.fullmatch(told, line) for line in lines), lines
    assert f"{len(lines)} entries dropped, {count - len(lines)} kept." in said
    assert file.read_text().count("[[accepted]]") == count - len(lines) > 0
    _code, text = answer("audit", stock, *NATIVE, "--baseline", file, "-f", "json")
    report = json.loads(text)
    assert sum(each["suppressed"] is not None for each in report["findings"]) == count - len(lines)
    assert "KA910" not in {each["code"] for each in report["findings"]}

    code, dropped = answer("baseline", "prune", file, stock, "--engine", "native", "--at", "2027-02-01T00:00:00Z")
    assert (code, len(dropped.splitlines())) == (0, count - len(lines))
    assert "(until 2027-01-31)" in dropped
    assert "[[accepted]]" not in file.read_text()


def test_what_is_there_already_is_not_written_over(
    stock: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "accepted.toml"
    file.write_text("mine")
    dangling = tmp_path / "dangling.toml"
    dangling.symlink_to(tmp_path / "nowhere")
    for path in (file, dangling):
        assert answer("baseline", "create", stock, "-o", path, *NATIVE, *WHY) == (2, "")
        assert "is there already" in capsys.readouterr().err
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            ("--until", "2027-05-21"),
            "keystore-audit: --until: 2027-05-21 is too far away: expected 2027-05-20 or sooner, 180 days",
        ),
        (("--until", "2026-11-20"), "--until 2026-11-20 has passed"),
        (("--until", "31.1.2027"), "'31.1.2027' is no day such as 2027-01-31"),
        (("--reason", "  "), "Words are wanted"),
        (("--owner", "x" * 201), "At most 200 characters are wanted, and these are 201."),
        (("--owner", "\x1b" * 51), "these are 204."),
        (("--min-severity", "never"), "'never' is not one of"),
    ],
    ids=" ".join,
)
def test_wrong_calls_write_nothing(
    stock: Path, tmp_path: Path, changed: tuple[str, str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "accepted.toml"
    options = {**dict(zip(WHY[::2], WHY[1::2], strict=True)), changed[0]: changed[1]}
    given = (word for option in options.items() for word in option)
    assert answer("baseline", "create", stock, "-o", file, *NATIVE, *given) == (2, "")
    assert words in capsys.readouterr().err
    assert not file.exists()


def test_nothing_is_written_into_the_keystore(stock: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "way").symlink_to(stock)
    for path in (stock / "accepted.toml", tmp_path / "way" / "accepted.toml"):
        assert answer("baseline", "create", stock, "-o", path, *NATIVE, *WHY) == (2, "")
        assert "lies in the keystore" in capsys.readouterr().err
    inside = stock / "accepted.toml"
    inside.write_text("")
    assert answer("baseline", "prune", inside, stock, *NATIVE) == (2, "")
    assert "would judge itself" in capsys.readouterr().err
    assert answer("baseline", "create", stock, "-o", tmp_path / "no" / "x.toml", *NATIVE, *WHY)[0] == 2
    assert answer("baseline", "create", tmp_path / "no", "-o", tmp_path / "x.toml", *NATIVE, *WHY)[0] == 3


def test_an_undecided_audit_is_said_and_not_accepted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keystore, _expected = as_built(SAMPLES / "unknown/unreadable_enclave.toml", tmp_path / "keys")
    file = tmp_path / "accepted.toml"
    assert answer("baseline", "create", keystore, "-o", file, *NATIVE, *WHY) == (4, "")
    assert re.search(
        r"\d+ findings? left, which nothing accepts: about the audit itself, or undecided\.", capsys.readouterr().err
    )
    assert '"KA9' not in file.read_text()
    assert audited(keystore, "--baseline", file)[0] == 4
    assert answer("baseline", "prune", file, keystore, *NATIVE) == (4, "")


def test_words_of_people_and_names_of_keystores_steer_no_file(
    stock: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile = 'enclave"\n[[accepted]]\n\x1b]0;x\x07'
    os.rename(stock / "enclaves/listener", stock / "enclaves" / hostile)
    file = tmp_path / "accepted.toml"
    code, _out = answer(
        "baseline", "create", stock, "-o", file, *NATIVE, "--until", "2027-01-31",
        "--reason", '"\n[[accepted]]\ncode = "KA101"', "--owner", "\x1b[31mAda",
    )  # fmt: skip
    said = capsys.readouterr().err
    assert code in (0, 4), said
    text = file.read_text()
    assert not set(text + said) & {"\x1b", "\x07", "\r"}
    entries = text.count("\n[[accepted]]\n")
    assert f"{entries} findings accepted" in said
    assert answer("baseline", "prune", file, stock, *NATIVE) == (code, "")


def test_the_profiles_of_an_audit_that_asked_few_are_the_limit(stock: Path, tmp_path: Path) -> None:
    file = tmp_path / "accepted.toml"
    assert answer("baseline", "create", stock, "-o", file, *NATIVE, *WHY, "--profile", "spec")[0] == 0
    assert audited(stock, "--baseline", file, "--profile", "spec")[0] == 0
    assert audited(stock, "--baseline", file)[0] == 1, "accepted under one profile, found under others"


def test_an_edit_of_session_files_ends_what_was_accepted_of_them_alone(tmp_path: Path) -> None:
    """What was accepted of DDS does not rest on them."""
    network = tmp_path / "network"
    shutil.copytree(SAMPLES / "networks/turtlesim_generated", network)

    def meanings() -> dict[str, set[str]]:
        text = answer("audit", SAMPLES / "zenoh/turtlesim_generated", *NATIVE, "--zenoh", network, "-f", "json")[1]
        found: dict[str, set[str]] = {}
        for each in json.loads(text)["findings"]:
            found.setdefault(each["code"], set()).add(each["meaning"])
        return found

    before = meanings()
    edited = next(network.glob("**/*.json5"))
    edited.write_text(f"// reviewed\n{edited.read_text()}")
    changed = {code for code, each in meanings().items() if each != before[code]}
    assert changed == {code for code in before if code.startswith("KA8")} != set()
