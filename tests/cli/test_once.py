"""An option that takes one value takes it once: the last of two would count, and the first be asked by nobody."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from keystore_audit.cli.program import program, run
from keystore_audit.cli.types import Word

FITTING = {
    "--alloy-jar": __file__,
    "--at": "2026-11-21",
    "--batch": __file__,
    "--executor": "dask://localhost:8786",
    "--family": "KA2",
    "--from": __file__,
    "--time-zone": "UTC",
    "--until": "2026-12-31",
}
"""Values that the options take which do not take 1."""


def every_command(command: click.Command, *path: str) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from every_command(below, *path, name)


COMMANDS = dict(every_command(program))
OPTIONS = [
    (path, option)
    for path, command in COMMANDS.items()
    for option in command.params
    if isinstance(option, click.Option) and not option.is_flag
]


def name_of(option: click.Option) -> str:
    return max(option.opts, key=len)


def fitting(option: click.Option) -> str:
    words = [*option.type._words()] if isinstance(option.type, Word) else ("1",)
    return FITTING.get(name_of(option), words[0])


def called(path: tuple[str, ...], *words: str) -> list[str]:
    """The command with the arguments and options that it cannot do without, and `words`."""
    params = COMMANDS[path].params
    options = [
        each for each in params if isinstance(each, click.Option) and each.required and name_of(each) not in words
    ]
    arguments = ["/nowhere" for each in params if isinstance(each, click.Argument) and each.required]
    return [*path, *(word for each in options for word in (name_of(each), fitting(each))), *words, *arguments]


def identity(given: tuple[tuple[str, ...], click.Option]) -> str:
    return " ".join((*given[0], name_of(given[1])))


@pytest.mark.parametrize("given", [each for each in OPTIONS if not each[1].multiple], ids=identity)
def test_a_second_value_is_wrong_usage(
    given: tuple[tuple[str, ...], click.Option], capsys: pytest.CaptureFixture[str]
) -> None:
    path, option = given
    name, value = name_of(option), fitting(option)
    first = (name, *[value] * option.nargs)
    assert run(called(path, *first, *([f"{name}={value}"] if option.nargs == 1 else first))) == 2
    assert f"{name} is given twice and takes one value: give it once.\n" in capsys.readouterr().err


def test_whatever_takes_several_values_takes_them(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--profile", "humble", "--profile", "jazzy", "--ignore", "KA2", "--ignore", "KA3"]
    assert run([*words, "/nowhere"]) == 3
    assert "twice" not in capsys.readouterr().err


def test_a_flag_given_twice_is_no_other_wish(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "--quiet", "--offline", "--offline", "/nowhere"]) == 3
    assert "twice" not in capsys.readouterr().err


def test_a_variable_is_no_second_value(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("KEYSTORE_AUDIT_ALLOY_JAR", __file__)
    assert run(["--alloy-jar", __file__, "/nowhere"]) == 3
    assert "twice" not in capsys.readouterr().err


def test_help_is_given_all_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", "--domain", "1", "--domain", "2", "--help"]) == 0
    assert capsys.readouterr().out.startswith("Usage: keystore-audit audit")


def test_the_first_settings_are_not_forgotten(healthy: Path, tmp_path: Path) -> None:
    """They are violated, the second ones hold: it was a pass."""
    violated, holding = tmp_path / "violated.toml", tmp_path / "holding.toml"
    violated.write_text('[[property]]\nname = "p"\nno_flow = { from = "/talker", to = "/listener" }\n')
    holding.write_text('[[property]]\nname = "p"\nno_flow = { from = "/listener", to = "/talker" }\n')
    words = [str(healthy), "--engine", "native", "--at", "2026-11-21", "-q"]
    assert [run([*words, "--settings", str(each)]) for each in (violated, holding)] == [1, 0]
    assert run([*words, "--settings", str(violated), "--settings", str(holding)]) == 2
