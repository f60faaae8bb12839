"""Private keys: what several enclaves share, and what lies about, is a gain of whoever has it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.comparison import Comparison, Direction, FailOn
from keystore_audit.model.comparison_run import compare
from keystore_audit.model.profiles import resolve
from tests.model.comparing import AT, authority, compared
from tests.model.single_changes import BASE, EVERYBODY

IDENTITY, PERMISSIONS = authority("identityCA"), authority("permissionsCA")


def told(found: Comparison, *kinds: str) -> list[tuple[str, str, tuple[str, ...]]]:
    changes = [change for change in found.changes if change.kind in kinds]
    return sorted((change.kind, change.direction.value, change.enclaves) for change in changes)


def test_an_identity_with_the_key_of_another(tmp_path: Path) -> None:
    shared = BASE.member("/talker", key="/listener", serial=103)
    found = compared(BASE, shared, tmp_path)
    expected = [("identity-shared", "gained", (path,)) for path in EVERYBODY]
    assert told(found, "identity-shared") == expected
    assert len(found.failing(FailOn.GAINED)) == 2


def test_shared_as_before_is_no_change(tmp_path: Path) -> None:
    shared = BASE.member("/talker", key="/listener", serial=103)
    assert not told(compared(shared, BASE.member("/talker", key="/listener", serial=104), tmp_path), "identity-shared")


Leave = Callable[[Path], None]


def left(name: str, content: bytes) -> Leave:
    def leave(root: Path) -> None:
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_bytes(content)

    return leave


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ([], [left("docs/read.me", PERMISSIONS.key_pem)], ("private-key", "gained")),
        ([left("docs/read.me", PERMISSIONS.key_pem)], [left("read.me", PERMISSIONS.key_pem)], None),
        (
            [left("docs/read.me", PERMISSIONS.key_pem)],
            [left("docs/read.me", IDENTITY.key_pem)],
            ("private-key", "mixed"),
        ),
        (
            [left("private/identity_ca.key.pem", IDENTITY.key_pem)],
            [
                left("private/identity_ca.key.pem", IDENTITY.key_pem),
                left("private/permissions_ca.key.pem", PERMISSIONS.key_pem),
            ],
            ("authority-key", "gained"),
        ),
    ],
)
def test_private_keys_that_lie_about(
    old: list[Leave], new: list[Leave], expected: tuple[str, str] | None, tmp_path: Path
) -> None:
    keystores = []
    for name, leaves in (("old", old), ("new", new)):
        root = BASE.write(tmp_path / name)
        for leave in leaves:
            leave(root)
        keystores.append(read_keystore(root))
    profiles = resolve(())
    one, other = keystores
    there, back = compare(one, other, profiles, AT), compare(other, one, profiles, AT)
    found = [(each.kind, each.direction.value) for each in there.changes if each.direction is not Direction.INFO]
    assert found == ([expected] if expected else [])
    assert bool(there.failing(FailOn.GAINED)) is (expected is not None)
    turned = {"gained": "lost", "mixed": "mixed"}
    assert [(change.kind, change.direction.value) for change in back.changes] == [
        (kind, turned[direction]) for kind, direction in found
    ]
