"""What must be possible: from each of the places to each of the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import AT, answer, keystore, properties, rule

ENCLAVES = {
    "/button/left": (rule(("rt/stop",)),),
    "/button/right": (rule(("rt/stop",)),),
    "/button/broken": (rule(("rt/other",)),),
    "/motor": (rule((), ("rt/stop",)),),
    "/brake": (rule((), ("rt/stop",)),),
}


def asked(root: Path, able: str) -> dict[str, Any]:
    return properties(root, f'[[property]]\nname = "stop"\nable = {{ {able} }}\n', "--profile", "jazzy")["stop"]


def why(found: dict[str, Any]) -> str:
    text: str = found["profiles"]["fastdds-2.14"]["counterexample"]["text"]
    return text


@pytest.mark.parametrize(
    ("able", "cut_off"),
    [
        ('from = ["/button/left", "/button/right"], to = "/motor"', ""),
        ('from = ["/button/left", "/button/broken"], to = "/motor"', "from /button/broken to /motor"),
        ('from = "/button/*", to = "/motor"', "from /button/broken to /motor"),
        ('from = "/button/[lr]*", to = ["/motor", "/brake"]', ""),
        ('from = "/button/left", to = ["/motor", "/button/right"]', "from /button/left to /button/right"),
        ('from = "/button/left", to = "topic:/stop"', ""),
        ('from = "/button/left", to = ["topic:/stop", "topic:/other"]', "from /button/left to /other"),
        ('from = ["topic:/stop", "topic:/other"], to = "/motor"', "from /other to /motor"),
        ('from = "topic:/*", to = "/motor"', ""),
        ('from = ["/button/left", "/motor"], to = "/motor"', ""),
    ],
)
def test_every_pair_counts(tmp_path: Path, able: str, cut_off: str) -> None:
    found = asked(keystore(tmp_path / "keys", ENCLAVES), able)
    assert found["status"] == ("violated" if cut_off else "holds")
    if cut_off:
        assert cut_off in why(found).replace(" (topic)", "")


def test_one_that_does_not_start_is_cut_off(tmp_path: Path) -> None:
    root = keystore(tmp_path / "keys", ENCLAVES)
    able = 'from = ["/button/left", "/button/right"], to = "/motor"'
    assert asked(root, able)["status"] == "holds"
    (root / "enclaves/button/right/key.pem").unlink()
    found = asked(root, able)
    assert found["status"] == "violated"
    assert "from /button/right to /motor" in why(found)


def test_one_that_cannot_be_read_leaves_it_open(tmp_path: Path) -> None:
    root = keystore(tmp_path / "keys", ENCLAVES)
    able = 'from = ["/button/left", "/button/right"], to = "/motor"'
    (root / "enclaves/button/right/identity_ca.cert.pem").write_bytes(b"#" * 5_000_000)
    assert asked(root, able)["status"] != "holds"
    assert asked(root, 'from = "/button/left", to = "/motor"')["status"] == "holds"


def test_too_many_pairs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("keystore_audit.model.ability.MAX_PAIRS", 3)
    settings = tmp_path / "keystore-audit.toml"
    settings.write_text('[[property]]\nname = "stop"\nable = { from = "/button/*", to = "/*" }\n', "utf-8")
    root = keystore(tmp_path / "keys", ENCLAVES)
    assert answer("audit", root, "--engine", "native", "--at", AT, "--settings", settings)[0] == 2
