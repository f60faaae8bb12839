"""Whom a real participant completes a handshake with: what `able` takes for granted of enclaves that start.

Keys of some kinds sign nothing in it, and permissions may be too large for its messages.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec, ed448, ed25519
from msgspec.structs import replace

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.claims.ability import sent, talks
from keystore_audit.profiles import VARIANTS
from tests.keystore.builder import PrivateKey, certificate, rsa_key
from tests.oracles.vendors.ours import PROFILES
from tests.oracles.vendors.pairs import PATIENCE, Pairs, Side
from tests.oracles.vendors.pairs_case import CAS, PLAIN_FIRST, PLAIN_SECOND
from tests.oracles.vendors.pairs_material import EVERYTHING, Enclave, grant, permissions

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # the programs are compiled once


def of(key: PrivateKey) -> Enclave:
    """The second enclave, its identity with this key."""
    return replace(PLAIN_SECOND, identity=certificate("/second", CAS.identity, key=key))


def large(blanks: int) -> Enclave:
    """The second enclave, its permissions with so many blanks."""
    document = permissions(grant("CN=/second", EVERYTHING)).replace(
        b"</permissions>", b" " * blanks + b"</permissions>"
    )
    return replace(PLAIN_SECOND, permissions=CAS.sign(document))


ENCLAVES = {
    "RSA 1024": of(rsa_key(1024)),
    "RSA 2048": of(rsa_key()),
    "RSA 4096": of(rsa_key(4096)),
    "P-224": of(ec.generate_private_key(ec.SECP224R1())),
    "P-384": of(ec.generate_private_key(ec.SECP384R1())),
    "P-521": of(ec.generate_private_key(ec.SECP521R1())),
    "secp256k1": of(ec.generate_private_key(ec.SECP256K1())),
    "Ed25519": of(ed25519.Ed25519PrivateKey.generate()),
    "Ed448": of(ed448.Ed448PrivateKey.generate()),
    "62 kB to send": large(59_500),
    "64 kB to send": large(61_500),
    "1 MB to send": large(1_000_000),
}


def _meet(vendor: Pairs, enclave: Enclave, directory: Path) -> bool | None:
    """Whether it and the plain first one hear each other; None where it does not start."""
    first, second = (
        Side(enclave=each.write(directory / "enclaves" / name), endpoints=())
        for name, each in (("first", PLAIN_FIRST), ("second", enclave))
    )
    try:
        meeting = vendor.meet(first, second, 2 * PATIENCE)
    except (AssertionError, BrokenPipeError):
        return False  # what is too large ends the process of the side that answers with it
    return None if meeting.sides[1] is None else meeting.met


@pytest.fixture(scope="module")
def heard(vendors: dict[str, Pairs], tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], bool | None]:
    """By vendor and title; all meet at once, since they mostly wait."""
    asked = [(name, title, tmp_path_factory.mktemp("k")) for name in vendors for title in ENCLAVES]
    with ThreadPoolExecutor(10) as pool:
        answers = pool.map(lambda each: _meet(vendors[each[0]], ENCLAVES[each[1]], each[2]), asked)
        return {(name, title): answer for (name, title, _place), answer in zip(asked, answers, strict=True)}


@pytest.mark.parametrize("title", ENCLAVES)
@pytest.mark.parametrize("name", PROFILES)
def test_whoever_starts_talks_as_we_say(
    name: str, title: str, heard: dict[tuple[str, str], bool | None], vendors: dict[str, Pairs], tmp_path: Path
) -> None:
    ENCLAVES[title].write(tmp_path / "enclaves/second")
    (enclave,) = read_keystore(tmp_path).enclaves
    expected = (None, talks(enclave, VARIANTS[PROFILES[name]].local))
    # That nothing was heard may be a busy machine.
    assert heard[name, title] in expected or _meet(vendors[name], ENCLAVES[title], tmp_path / "again") in expected
    assert (sent(enclave) > 62_000) is ("to send" in title)
