"""Of two permissions CAs of one name, what the second signs: as `openssl smime -verify` finds its way."""

from __future__ import annotations

import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from cryptography import x509
from msgspec.structs import replace

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.trust.chain import path_refusal
from keystore_audit.model.trust.verdicts import document_verdict
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.keystore.builder import END, START, Signed, authority, certificate, usage
from tests.oracles.vendors.recipe import Recipe
from tests.oracles.vendors.recipes_signers import PAST, _ca, with_options

FIRST, SECOND, EXPIRED, OTHER = authority("p"), authority("p"), authority("p", **PAST), authority("q")
LATER = authority("p", start=START + timedelta(days=200), end=END + timedelta(days=200))
IDLE = authority("p", key=SECOND.key, extensions=[usage("crl_sign")])
LEAF = certificate("/mallory", SECOND)
NAMED = x509.AuthorityKeyIdentifier(
    None, [x509.DirectoryName(FIRST.certificate.issuer)], FIRST.certificate.serial_number
)
CROSS = certificate("p", FIRST, ca=True, extensions=[(NAMED, False)])
TOP = certificate("top", ca=True, length=None)
MIDDLE = certificate("middle", TOP, ca=True, length=None)
LOWER = certificate("lower", MIDDLE, ca=True)
LOWEST = certificate("/mallory", LOWER)
GONE = certificate("middle", TOP, key=MIDDLE.key, ca=True, length=None, end=START + timedelta(days=30))
SHORT = certificate("top", key=TOP.key, ca=True, length=0)
CASES = {
    "the second": (FIRST.pem + SECOND.pem, SECOND, True),
    "the first": (FIRST.pem + SECOND.pem, FIRST, False),
    "a leaf of the second": (FIRST.pem + SECOND.pem, LEAF, True),
    "a leaf of the first": (SECOND.pem + FIRST.pem, LEAF, False),
    "the second, the first has expired": (EXPIRED.pem + SECOND.pem, SECOND, False),
    "the second, the first has its key and may not sign": (IDLE.pem + SECOND.pem, SECOND, True),
    "a leaf of the second, the first has its key and may not sign": (IDLE.pem + SECOND.pem, LEAF, True),
    "the second, made later": (FIRST.pem + LATER.pem, LATER, True),
    "the second, which was there before": (LATER.pem + FIRST.pem, FIRST, True),
    "a leaf of the second, made later": (FIRST.pem + LATER.pem, certificate("/mallory", LATER), True),
    "the second, of another name": (OTHER.pem + SECOND.pem, SECOND, False),
    "one that names another of its name as its issuer": (CROSS.pem + FIRST.pem, CROSS, False),
    "one that names another of its name as its issuer, behind a third": (
        CROSS.pem + SECOND.pem + FIRST.pem,
        CROSS,
        False,
    ),
}
BETWEEN = {
    "all in the file": (LOWER.pem + MIDDLE.pem + TOP.pem, (), False),
    "all in the message": (TOP.pem, (LOWER, MIDDLE), False),
    "the upper one in the file": (MIDDLE.pem + TOP.pem, (LOWER,), False),
    "the lower one in the file": (LOWER.pem + TOP.pem, (MIDDLE,), True),
    "the root behind itself as it was, for fewer below it": (SHORT.pem + TOP.pem, (LOWER, MIDDLE), True),
    "the root before itself as it was, for fewer below it": (TOP.pem + SHORT.pem, (LOWER, MIDDLE), False),
    "one in the file that is over, and in the message": (GONE.pem + TOP.pem, (LOWER, MIDDLE), True),
    "one in the file that is over, and its renewal": (GONE.pem + MIDDLE.pem + TOP.pem, (LOWER,), False),
}
"""Authorities between a leaf that signs and the root, whether of the file or of the message."""


def lost_to_us_and_openssl(recipe: Recipe, root: Path, *options: str) -> tuple[bool, bool]:
    """Whether no path is found for the signer, by us and by OpenSSL with these options."""
    enclave = recipe.build(root / "enclaves/talker")
    read = read_keystore(root).enclaves[0]
    assert read.permissions is not None
    assert read.permissions_ca is not None
    row = VARIANTS["fastdds-2.9"].trust
    assert document_verdict(read.permissions.signed, read.permissions_ca, row) is Truth.YES
    refusal = path_refusal(read.permissions.signed, read.permissions_ca, row, datetime.now(timezone.utc))
    assert path_refusal(read.permissions.signed, read.permissions_ca, VARIANTS["fastdds-2.14"].trust) is None
    message = ["-text", *options, "-CAfile", "permissions_ca.cert.pem", "-in", "permissions.p7s"]
    verified = subprocess.run(["openssl", "smime", "-verify", *message], cwd=enclave, capture_output=True, check=False)
    return refusal is not None, verified.returncode != 0


@pytest.mark.parametrize(("authorities", "signer", "lost"), CASES.values(), ids=CASES.keys())
def test_the_first_of_the_name_is_tried_alone(authorities: bytes, signer: Signed, lost: bool, tmp_path: Path) -> None:
    assert lost_to_us_and_openssl(_ca("of the test", authorities, signer), tmp_path) == (lost, lost)


@pytest.mark.parametrize(("first", "lost"), [(OTHER, False), (FIRST, True)])
def test_one_that_has_expired_is_found_in_its_place(first: Signed, lost: bool, tmp_path: Path) -> None:
    """That it has is refused for itself, and no reason to say that another stands there."""
    recipe = _ca("of the test", first.pem + EXPIRED.pem, EXPIRED)
    assert lost_to_us_and_openssl(recipe, tmp_path, "-no_check_time") == (lost, lost)


@pytest.mark.parametrize(("authorities", "brought", "lost"), BETWEEN.values(), ids=BETWEEN.keys())
def test_above_an_authority_of_the_file_its_issuer_is_looked_for_there_alone(
    authorities: bytes, brought: tuple[Signed, ...], lost: bool, tmp_path: Path
) -> None:
    along = tmp_path / "along.pem"
    along.write_bytes(b"".join(each.pem for each in brought))
    options = ("smime", "-text", *(("-certfile", str(along)) if brought else ()))
    signed = replace(_ca("of the test", authorities, LOWEST), sign_permissions=with_options(options, LOWEST))
    assert lost_to_us_and_openssl(signed, tmp_path / "keystore") == (lost, lost)
