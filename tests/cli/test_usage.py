"""A wrong call ends in exit code 2 and a sentence, before any work."""

from __future__ import annotations

import os
import re
from datetime import datetime, timezone
from pathlib import Path

import click
import pytest

from keystore_audit.cli import options, output, places, types
from keystore_audit.cli.program import run


def test_an_option_with_escape_sequences_is_shown_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--fail-on", "\x1b[31mhigh", "x"]) == 2
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("2026-01-31", datetime(2026, 1, 31)),
        ("2026-01-31T12:30", datetime(2026, 1, 31, 12, 30)),
        ("2026-01-31 12:30:15.75", datetime(2026, 1, 31, 12, 30, 15)),
        ("2026-01-31T12:30:15Z", datetime(2026, 1, 31, 12, 30, 15)),
        ("2026-01-31T12:30:15+02:00", datetime(2026, 1, 31, 10, 30, 15)),
        ("1950-01-01T00:00:00+14:00", datetime(1949, 12, 31, 10)),
    ],
)
def test_instants_without_a_zone_are_utc(written: str, meant: datetime) -> None:
    assert types.instant(written) == meant.replace(tzinfo=timezone.utc)


@pytest.mark.parametrize(
    "written", ["", "2026", "20260131", "2026-01-31T", "2026-01-31T12", "٢٠٢٦-01-31", "2026-01-31T12:30Z\n", "-1-01-01"]
)
def test_other_times_are_refused(written: str) -> None:
    with pytest.raises(click.BadParameter):
        types.instant(written)


class TestOutputs:
    """Whether a report can be written is found out before anything is read."""

    @pytest.fixture
    def nowhere(self, tmp_path: Path) -> str:
        """A keystore that is not there: reading it would be exit code 3."""
        return str(tmp_path / "no-keystore")

    def test_no_such_directory(self, nowhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert run([nowhere, "-o", f"json={tmp_path}/a/b.json"]) == 2
        assert "No such file or directory" in capsys.readouterr().err

    def test_a_directory(self, nowhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert run([nowhere, "-o", f"json={tmp_path}"]) == 2
        assert "it is a directory" in capsys.readouterr().err

    def test_below_a_file(self, nowhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        (tmp_path / "file").touch()
        assert run([nowhere, "-o", f"json={tmp_path}/file/report"]) == 2
        assert "Not a directory" in capsys.readouterr().err

    def test_one_file_for_two_reports(self, nowhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        (tmp_path / "way").symlink_to(tmp_path)
        assert run([nowhere, "-o", f"json={tmp_path}/report", "-o", f"text={tmp_path}/way/report"]) == 2
        assert "Two reports cannot both be written" in capsys.readouterr().err

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
    def test_no_permission(self, nowhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        tmp_path.chmod(0o500)
        assert run([nowhere, "-o", f"json={tmp_path}/report"]) == 2
        assert "Permission denied" in capsys.readouterr().err

    def test_trying_leaves_nothing_behind(self, tmp_path: Path) -> None:
        (tmp_path / "old").write_text("old")
        output.check([output.target(f"json={tmp_path}/new"), output.target(f"text={tmp_path}/old")])
        assert [path.name for path in tmp_path.iterdir()] == ["old"]
        assert (tmp_path / "old").read_text() == "old"

    def test_a_report_replaces_the_file_and_keeps_its_mode(self, tmp_path: Path) -> None:
        file = tmp_path / "report"
        file.write_text("old and longer")
        file.chmod(0o640)
        output.write(output.target(f"json={file}"), "new \udc80")
        assert file.read_bytes() == b"new \\udc80"
        assert file.stat().st_mode & 0o777 == 0o640
        assert [path.name for path in tmp_path.iterdir()] == ["report"]

    @pytest.mark.parametrize("leads_to", ["old", "nowhere", "/dev/null"])
    def test_a_link_is_replaced_and_what_it_leads_to_stays(self, tmp_path: Path, leads_to: str) -> None:
        (tmp_path / "old").write_text("old")
        (tmp_path / "link").symlink_to(leads_to)
        wanted = output.target(f"json={tmp_path}/link")
        output.check([wanted])
        output.write(wanted, "new")
        assert not (tmp_path / "link").is_symlink()
        assert (tmp_path / "link").read_text() == "new"
        assert (tmp_path / "old").read_text() == "old"
        assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "old"]

    def test_below_the_directory_that_was_named_no_link_is_followed(self, tmp_path: Path) -> None:
        (tmp_path / "elsewhere").mkdir()
        (tmp_path / "out").mkdir()
        (tmp_path / "named").symlink_to("out")
        wanted = output.target(f"json={tmp_path}/named/")
        output.write(places.own_file(wanted, "robot/"), "new")
        assert (tmp_path / "out/robot/report.json").read_text() == "new"
        (tmp_path / "out/other").symlink_to(tmp_path / "elsewhere")
        with pytest.raises(output.Unwritable, match="Not a directory"):
            output.write(places.own_file(wanted, "other/"), "new")
        with pytest.raises(output.Unwritable, match="Not a directory"):
            output.remove(places.own_file(wanted, "other/"))
        assert list((tmp_path / "elsewhere").iterdir()) == []

    def test_a_device_is_not_replaced(self) -> None:
        wanted = output.target("json=/dev/null")
        output.check([wanted])
        output.write(wanted, "x")
        assert Path("/dev/null").is_char_device()

    def test_a_full_disk_leaves_the_old_report(self) -> None:
        with pytest.raises(output.Unwritable, match="No space left on device"):
            output.write(output.target("json=/dev/full"), "x")


@pytest.mark.parametrize(
    ("choice", "variables", "terminal", "coloured"),
    [
        ("auto", {}, True, True),
        ("auto", {}, False, False),
        ("auto", {"TERM": "dumb"}, True, False),
        ("auto", {"NO_COLOR": "1"}, True, False),
        ("auto", {"NO_COLOR": ""}, True, True),
        ("auto", {"FORCE_COLOR": "1"}, False, True),
        ("auto", {"FORCE_COLOR": "1", "NO_COLOR": "1"}, True, False),
        ("always", {"NO_COLOR": "1"}, False, True),
        ("never", {"FORCE_COLOR": "1"}, True, False),
    ],
)
def test_colour(
    choice: str, variables: dict[str, str], terminal: bool, coloured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert options.use_color(choice, terminal=terminal) is coloured


def test_each_option_of_an_audit_stands_in_one_group_of_its_help() -> None:
    from keystore_audit.cli.audit import GROUPS, command

    grouped = [name for names in GROUPS.values() for name in names]
    options = {each.name for each in command.params if isinstance(each, click.Option)}
    assert {*grouped} == options | {"distros", "rmws"}
    assert len(grouped) == len({*grouped})


def test_the_help_of_an_audit_has_three_examples_that_parse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", "--help"]) == 0
    shown = capsys.readouterr().out
    examples = [line.split()[1:] for line in shown.split("Examples:\n")[1].splitlines() if line.strip()]
    assert len(examples) == 3
    headings = re.findall(r"^(\w+):$", shown, re.MULTILINE)
    assert headings == ["Scope", "Inputs", "Output", "Gate", "Engine", "Other"]
    for words in examples:
        assert run([str(tmp_path / "none") if word.startswith("./") else word for word in words]) in (2, 3)
