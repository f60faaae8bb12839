"""`[files]`: what settings say of the files of a keystore, and what comes of it."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from keystore_audit.cli.program import run
from keystore_audit.errors import UsageError
from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.settings.settings import read_settings
from tests.keystore.builder import sros2

POLICY = """<policy version="0.2.0"><enclaves><enclave path="/motor"><profiles><profile node="motor" ns="/">
<topics publish="ALLOW"><topic>chatter</topic></topics></profile></profiles></enclave></enclaves></policy>"""


def read(tmp_path: Path, text: str) -> DeclaredFiles:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    return read_settings(path, ()).files


def test_every_key_is_read(tmp_path: Path) -> None:
    digest = hashlib.sha256(b"x").hexdigest()
    text = f'[files]\nforeign = "maps/**"\naccepted = ["sha256:{digest}"]\nkey_group = 998\naliases = ["/motor-v2"]\n'
    assert read(tmp_path, text) == DeclaredFiles(
        foreign=("maps/**",), accepted=frozenset({digest}), key_group=998, aliases=("/motor-v2",)
    )
    assert read(tmp_path, "[files]\n") == read(tmp_path, "") == DeclaredFiles()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('foreign = ["/maps"]', "expected a path in the keystore"),
        ('foreign = ["maps/../keys"]', "expected a path in the keystore"),
        ('accepted = ["sha256:abc"]', "64 digits"),
        (f'accepted = ["{"0" * 64}"]', "64 digits"),
        ('key_group = "ros"', "Expected `int`, got `str`"),
        ("key_group = -1", "Expected `int` >= 0"),
        ('aliases = ["motor"]', "expected an enclave's path"),
        ('roots = ["/opt"]', "unknown key"),
    ],
)
def test_what_is_wrong_is_said(line: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=said):
        read(tmp_path, f"[files]\n{line}\n")


def test_a_root_is_named_on_the_command_line_and_in_the_report(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, image = sros2(tmp_path / "k", ["/motor", "/talker"], links=False), tmp_path / "image"
    image.mkdir()
    shutil.move(path / "enclaves/motor", image / "motor")
    (path / "enclaves/motor").symlink_to("../../image/motor")
    asked = [str(path), "--engine", "native", "--at", "2026-11-21T12:00:00Z", "--fail-on", "never"]
    assert run(asked) == 4
    assert "KA104" in capfd.readouterr().out
    assert run([*asked, "--root", str(image), "-v"]) == 0
    told = capfd.readouterr().out
    assert "KA104 directory" not in told
    assert f"linksinto{image}" in "".join(told.split()), "a long path is broken between lines"


ASKED = {
    "can": ["can", "KEYS", "/motor", "subscribe", "/chatter"],
    "access": ["access", "KEYS"],
    "flow": ["flow", "KEYS", "/talker", "/motor"],
    "flow of one": ["flow", "KEYS", "--from-compromised", "/motor"],
    "suggest": ["suggest", "KEYS", "--policy", "POLICY"],
    "model": ["model", "KEYS", "-o", "MODEL"],
    "diff": ["diff", "KEYS", "KEYS"],
}


@pytest.mark.parametrize("words", ASKED.values(), ids=ASKED)
def test_whatever_is_asked_goes_by_the_roots(
    words: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, image = sros2(tmp_path / "k", ["/motor", "/talker"], links=False), tmp_path / "image"
    image.mkdir()
    shutil.move(path / "enclaves/motor", image / "motor")
    (path / "enclaves/motor").symlink_to("../../image/motor")
    (tmp_path / "policy.xml").write_text(POLICY)
    places = {"KEYS": str(path), "POLICY": str(tmp_path / "policy.xml"), "MODEL": str(tmp_path / "model")}
    asked = [*(places.get(word, word) for word in words), "--at", "2026-11-21T12:00:00Z"]

    def answered(*more: str) -> tuple[int, tuple[str, str], list[bytes]]:
        shutil.rmtree(tmp_path / "model", ignore_errors=True)
        code = run([*asked, *more])
        return code, capfd.readouterr(), [each.read_bytes() for each in sorted(tmp_path.glob("model/*/*.als"))]

    without, found = answered(), answered("--root", str(image))
    assert found[0] in (0, 1)
    assert found != without


def test_an_alias_is_no_other_enclave_to_whoever_asks(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, settings = sros2(tmp_path / "k", ["/motor-v2", "/talker"]), tmp_path / "s.toml"
    (path / "enclaves/motor").symlink_to("motor-v2")
    settings.write_text('[files]\naliases = ["/motor-v2"]\n')
    for given, known in ([], True), (["--settings", str(settings)], False):
        assert run(["access", str(path), "-f", "csv", *given]) == 0
        assert ("/motor-v2" in capfd.readouterr().out) is known
