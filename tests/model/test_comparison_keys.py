"""Private keys: what several enclaves share, and what lies about, is a gain of whoever has it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
)
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Comparison, FailOn
from tests.keystore.builder import key
from tests.model.comparing import authority, compared
from tests.model.single_changes import BASE

IDENTITY, PERMISSIONS = authority("identityCA"), authority("permissionsCA")


def told(found: Comparison, *kinds: str) -> list[tuple[str, str, tuple[str, ...]]]:
    changes = [change for change in found.changes if change.kind in kinds]
    return sorted((change.kind, change.direction.value, change.enclaves) for change in changes)


Files = Mapping[str, bytes]


def changed(old: Files, new: Files, tmp_path: Path) -> Comparison:
    """What differs with these files in each."""
    return compared(replace(BASE, files=old), replace(BASE, files=new), tmp_path)


PATHS = {"/listener": "enclaves/listener/key.pem", "/talker": "enclaves/talker/key.pem"}
OWN = {path: key(path).private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()) for path in PATHS}
SEALED = key("sealed").private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"x"))


@pytest.mark.parametrize(
    ("old", "new", "expected", "whose"),
    [
        ((), (OWN["/listener"],), "gained", "CN=/listener"),
        ((OWN["/listener"],), (), "lost", "CN=/listener"),
        ((), (PERMISSIONS.key_pem,), "gained", "the authority CN=permissionsCA"),
        ((IDENTITY.key_pem,), (PERMISSIONS.key_pem,), "mixed", "the authority CN=permissionsCA"),
        ((), (authority("elsewhere").key_pem,), "gained", "nobody here"),
        ((), (SEALED,), "gained", "one that could not be read"),
        # its own key once more, and the same ones in another order
        ((), (OWN["/talker"],), None, ""),
        ((OWN["/listener"], IDENTITY.key_pem), (IDENTITY.key_pem, OWN["/listener"]), None, ""),
    ],
)
def test_other_private_keys_in_an_enclaves_key_file(
    old: tuple[bytes, ...], new: tuple[bytes, ...], expected: str | None, whose: str, tmp_path: Path
) -> None:
    one, other = ({PATHS["/talker"]: OWN["/talker"] + b"".join(keys)} for keys in (old, new))
    found = changed(one, other, tmp_path)
    if expected is None:
        assert not found.changes
        return
    (change,) = found.changes
    assert (change.layer.value, change.kind, change.direction.value) == ("trust", "private-key", expected)
    assert change.enclaves == ("/talker",)
    (aspect,) = change.aspects
    assert (aspect.new or aspect.old or "").startswith(whose)
    assert (change.new.path if change.new else None) == PATHS["/talker"]
    assert bool(found.failing(FailOn.GAINED)) is (expected != "lost")


def test_an_enclave_that_comes_with_anothers_key(tmp_path: Path) -> None:
    new = replace(BASE, files={PATHS["/talker"]: OWN["/talker"] + PERMISSIONS.key_pem})
    found = compared(BASE.without("/talker"), new, tmp_path)
    assert told(found, "private-key", "enclave-added") == [
        ("enclave-added", "gained", ("/talker",)),
        ("private-key", "gained", ("/talker",)),
    ]
