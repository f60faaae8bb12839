"""Of two permissions CAs of one name, what the second signs: as `openssl smime -verify` finds its way."""

from __future__ import annotations

import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from cryptography import x509

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.profiles import VARIANTS
from keystore_audit.model.trust.signer_path import path_refusal
from keystore_audit.model.trust.verdicts import Acceptance, document_verdict
from tests.keystore.builder import END, START, Signed, authority, certificate
from tests.oracles.vendors.recipes_signers import PAST, _ca

USAGES = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"),
    *("key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)
FIRST, SECOND, EXPIRED, OTHER = authority("p"), authority("p"), authority("p", **PAST), authority("q")
USAGE = x509.KeyUsage(*(name == "crl_sign" for name in USAGES))
LATER = authority("p", start=START + timedelta(days=200), end=END + timedelta(days=200))
IDLE = authority("p", key=SECOND.key, extensions=[(USAGE, True)])
LEAF = certificate("/mallory", SECOND)
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
}


def lost_to_us_and_openssl(authorities: bytes, signer: Signed, root: Path, *options: str) -> tuple[bool, bool]:
    """Whether no path is found for the signer, by us and by OpenSSL with these options."""
    enclave = root / "enclaves/talker"
    _ca("of the test", authorities, signer).build(enclave)
    read = read_keystore(root).enclaves[0]
    assert read.permissions is not None
    assert read.permissions_ca is not None
    row = VARIANTS["fastdds-2.9"].trust
    assert document_verdict(read.permissions.signed, read.permissions_ca, row) is Acceptance.ACCEPTED
    refusal = path_refusal(read.permissions.signed, read.permissions_ca, row, datetime.now(timezone.utc))
    assert path_refusal(read.permissions.signed, read.permissions_ca, VARIANTS["fastdds-2.14"].trust) is None
    message = ["-text", *options, "-CAfile", "permissions_ca.cert.pem", "-in", "permissions.p7s"]
    verified = subprocess.run(["openssl", "smime", "-verify", *message], cwd=enclave, capture_output=True, check=False)
    return refusal is not None, verified.returncode != 0


@pytest.mark.parametrize(("authorities", "signer", "lost"), CASES.values(), ids=CASES.keys())
def test_the_first_of_the_name_is_tried_alone(authorities: bytes, signer: Signed, lost: bool, tmp_path: Path) -> None:
    assert lost_to_us_and_openssl(authorities, signer, tmp_path) == (lost, lost)


@pytest.mark.parametrize(("first", "lost"), [(OTHER, False), (FIRST, True)])
def test_one_that_has_expired_is_found_in_its_place(first: Signed, lost: bool, tmp_path: Path) -> None:
    """That it has is refused for itself, and no reason to say that another stands there."""
    found = lost_to_us_and_openssl(first.pem + EXPIRED.pem, EXPIRED, tmp_path, "-no_check_time")
    assert found == (lost, lost)
