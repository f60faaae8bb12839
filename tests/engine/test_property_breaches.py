"""Where what violates a property stands."""

from __future__ import annotations

from pathlib import Path

from keystore_audit.engine.breaches import _Files
from keystore_audit.keystore.keystore import read_keystore
from tests.model.test_at_large import written


def test_only_what_was_read_is_a_copy_of_something(tmp_path: Path) -> None:
    root = written(tmp_path, {})
    governances = [f"enclaves/{name}/governance.p7s" for name in ("listener", "motor", "talker")]
    assert {*_Files(read_keystore(root)).copies(governances[0])} == {*governances}
    for path in governances[1:]:
        (root / path).unlink()
        (root / path).mkdir()
    for path in governances:
        assert {*_Files(read_keystore(root)).copies(path)} == {path}
