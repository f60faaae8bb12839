"""Revocation lists in one place or another: what is taken back is compared where each implementation looks."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from itertools import permutations
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.comparison.change import Comparison, Direction, FailOn
from keystore_audit.model.comparison.compare import compare
from keystore_audit.profiles import VARIANTS, resolve
from tests.keystore.builder import START, crl
from tests.model.comparing import AT, authority, shapes
from tests.model.single_changes import BASE, EVERYBODY

IDENTITY, STRANGER = authority("identityCA"), authority("stranger")
STOLEN = 900
"""The number of an identity that is on no robot of this keystore."""

Lists = Mapping[str, bytes]
"""What stands in crl.pem, and what is appended to the CA file."""


def listed(*serials: int) -> bytes:
    return crl(IDENTITY, serials).public_bytes(Encoding.PEM)


LAYOUTS: Mapping[str, Lists] = {
    "nowhere": {},
    "crl.pem": {"crl.pem": listed(STOLEN)},
    "CA file": {"CA": listed(STOLEN)},
    "both": {"crl.pem": listed(STOLEN), "CA": listed(STOLEN)},
    "second in crl.pem": {"crl.pem": listed() + listed(STOLEN)},
    "empty": {"crl.pem": listed()},
    "a stranger's": {"crl.pem": crl(STRANGER, (STOLEN,)).public_bytes(Encoding.PEM)},
}


def refused(layout: str, profile: str) -> bool:
    """Whether the stolen identity is refused, by docs/security-model.md; where no list is of use, everybody is."""
    if profile.startswith("opendds"):
        return False
    if profile.startswith("fastdds"):
        return layout in ("crl.pem", "CA file", "both", "a stranger's")
    return layout in ("crl.pem", "both", "a stranger's")


def write(root: Path, lists: Lists) -> Path:
    BASE.write(root)
    for path in EVERYBODY:
        directory = root / "enclaves" / path.strip("/")
        if "crl.pem" in lists:
            (directory / "crl.pem").write_bytes(lists["crl.pem"])
        if "CA" in lists:
            file = directory / "identity_ca.cert.pem"
            file.write_bytes(file.read_bytes() + lists["CA"])
    return root


def told(old: Lists, new: Lists, root: Path, *profiles: str) -> Comparison:
    one, other = (read_keystore(write(root / name, lists)) for name, lists in (("old", old), ("new", new)))
    chosen = resolve(profiles)
    found = compare(one, other, chosen, AT)
    assert shapes(found, turned=True) == shapes(compare(other, one, chosen, AT))
    return found


@pytest.mark.parametrize(("old", "new"), tuple(permutations(LAYOUTS, 2)))
def test_what_is_taken_back_is_told_under_those_that_look_there(old: str, new: str, tmp_path: Path) -> None:
    found = told(LAYOUTS[old], LAYOUTS[new], tmp_path, *VARIANTS)
    revocations = [change for change in found.changes if change.kind == "revocation" and change.aspects]
    for direction, gained in ((Direction.GAINED, True), (Direction.LOST, False)):
        expected = {name for name in VARIANTS if refused(old, name) is gained and refused(new, name) is not gained}
        assert {name for each in revocations if each.direction is direction for name in each.profiles} >= expected
        others = {name for name in VARIANTS if refused(old, name) is refused(new, name) is False}
        assert not {name for each in revocations for name in each.profiles} & others
    assert {each.enclaves for each in revocations} <= {EVERYBODY}


def test_who_is_on_a_list_that_counts_later_is_compared(tmp_path: Path) -> None:
    """Of two in force the newer one counts, which has not begun; then the old ones are void, save one."""
    beyond = (AT - START).days + 30

    def lists(*later: int, until: int = 3650) -> Lists:
        first = crl(IDENTITY, (STOLEN,), end=START + timedelta(days=beyond + 20)).public_bytes(Encoding.PEM)
        end = START + timedelta(days=until)
        return {"crl.pem": first, "CA": crl(IDENTITY, later, days=beyond, end=end).public_bytes(Encoding.PEM)}

    (change,) = told(lists(STOLEN), lists(), tmp_path / "spared", "fastdds-3.6").changes
    assert (change.kind, change.direction) == ("revocation", Direction.GAINED)
    (change,) = told(lists(), lists(STOLEN), tmp_path / "taken", "fastdds-3.6").changes
    assert (change.kind, change.direction) == ("revocation", Direction.LOST)
    (change,) = told(lists(STOLEN), lists(STOLEN, until=beyond + 25), tmp_path / "void", "fastdds-3.6").changes
    assert (change.kind, change.direction) == ("revocation", Direction.CHANGED)
    assert not told(lists(), lists(), tmp_path / "same", "fastdds-3.6").changes


def test_a_list_that_moves_into_the_ca_file_lets_the_identity_in_again(tmp_path: Path) -> None:
    """Cyclone DDS and the specification look into crl.pem alone; under Fast DDS nothing changes."""
    found = told(LAYOUTS["crl.pem"], LAYOUTS["CA file"], tmp_path)
    (change,) = found.failing(FailOn.GAINED)
    assert (change.kind, change.direction) == ("revocation", Direction.GAINED)
    assert change.profiles == tuple(each.name for each in resolve(()) if not each.name.startswith("fastdds"))
    assert not told(LAYOUTS["crl.pem"], LAYOUTS["CA file"], tmp_path / "fast", "fastdds-2.6").changes


def test_lists_that_an_implementation_does_not_read_are_no_change_to_it(tmp_path: Path) -> None:
    assert not told(LAYOUTS["nowhere"], LAYOUTS["CA file"], tmp_path / "cyclone", "cyclonedds-11").changes
    assert not told(LAYOUTS["crl.pem"], LAYOUTS["nowhere"], tmp_path / "opendds", "opendds").changes
