"""What a process keeps of the keystores that it has audited: nothing that grows."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest

from keystore_audit.cli.types import instant
from keystore_audit.fleet import task
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.options import Options
from tests.cli.keystores import AT, keystore, rule


def alive() -> int:
    gc.collect()
    return sum(type(each) in (Certificate, PermissionsFile) for each in gc.get_objects())


def test_certificates_and_documents_do_not_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "MEMORY", 2)
    options = Options(at=instant(AT), engine="native")
    left = []
    for number in range(8):
        root = keystore(tmp_path / str(number), {"/talker": (rule(("rt/chatter",)),)})
        work = task.Task(root=str(root), options=options)
        assert task.carry_out(work).row.exit_code == 0
        left.append(alive())
    assert max(left[4:]) <= max(left[:4])
