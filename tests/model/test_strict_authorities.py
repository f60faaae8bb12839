"""What Fast DDS since 2.6.10 asks of the first certificate of a CA file: what `openssl verify -x509_strict` does."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from datetime import timedelta
from itertools import combinations
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.refusals import strict_refusal
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import VARIANTS
from tests.keystore.builder import Signed, certificate, evidence
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import AT as NOW
from tests.model.comparing import Member, Store, authority
from tests.oracles.vendors.recipes_signers import usage

Extension = tuple[x509.ExtensionType, bool]
AT = "1750000000"
ROOT_KEY, KEY = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
CRITICAL, NOT_CRITICAL = ((x509.BasicConstraints(ca=True, path_length=None), critical) for critical in (True, False))
SIGNS = usage("key_cert_sign", "crl_sign")
OWN = (x509.SubjectKeyIdentifier.from_public_key(KEY.public_key()), False)
ABOVE = (x509.AuthorityKeyIdentifier.from_issuer_public_key(ROOT_KEY.public_key()), False)
ROOT = certificate(
    "root",
    key=ROOT_KEY,
    ca=None,
    extensions=(CRITICAL, SIGNS, (x509.SubjectKeyIdentifier.from_public_key(ROOT_KEY.public_key()), False)),
)


def loaded(first: Signed, directory: Path) -> bool:
    """Whether OpenSSL takes it, the first of a file with the root behind it."""
    (directory / "ca").write_bytes(first.pem + ROOT.pem)
    (directory / "first").write_bytes(first.pem)
    command = ["openssl", "verify", "-x509_strict", "-check_ss_sig", "-attime", AT, "-CAfile", "ca", "first"]
    return subprocess.run(command, cwd=directory, capture_output=True, check=False).returncode == 0


BELOW = [(CRITICAL, *some) for count in range(4) for some in combinations((SIGNS, OWN, ABOVE), count)]


@pytest.mark.parametrize("extensions", [*BELOW, (NOT_CRITICAL, SIGNS, OWN, ABOVE), (NOT_CRITICAL,)])
def test_one_below_a_root_is_refused_where_openssl_refuses_it(extensions: Sequence[Extension], tmp_path: Path) -> None:
    first = certificate("below", ROOT, key=KEY, ca=None, extensions=extensions)
    assert (strict_refusal(evidence(first)) is None) == loaded(first, tmp_path)


NONE = x509.BasicConstraints(ca=False, path_length=None), True
IDLE = usage("digital_signature")
AS_ROOT = [(CRITICAL,), (NOT_CRITICAL,), (), (SIGNS,), (CRITICAL, usage("crl_sign")), (IDLE,), (NONE, IDLE), (NONE,)]


@pytest.mark.parametrize("extensions", AS_ROOT)
def test_a_root_is_refused_where_openssl_refuses_it(extensions: Sequence[Extension], tmp_path: Path) -> None:
    first = certificate("alone", key=KEY, ca=None, extensions=extensions)
    assert (strict_refusal(evidence(first)) is None) == loaded(first, tmp_path)


@pytest.mark.parametrize("name", ["old", "new"])
def test_one_out_of_date_is_refused_where_it_comes_first(name: str, tmp_path: Path) -> None:
    """When the file is loaded, whichever of its authorities issued the identity, and though its key was renewed."""
    new, old = authority("new"), authority(name, end=NOW - timedelta(1), serial=8)
    sends = permissions(grant("/talker", rule(criterion("publish", "rt/chatter"))))
    for number, file in enumerate(((old, new), (new, old))):
        talker = Member(permissions=sends, issuer=new)
        keystore = read_keystore(Store(members={"/talker": talker}, identity=file).write(tmp_path / str(number)))
        usabilities = Usabilities(None, AccessViews(documents_of(keystore), NOW, None))
        for profile in ("fastdds-3.6", "fastdds-2.9", "spec"):
            strict = VARIANTS[profile].trust.strict_authorities
            assert usabilities.of(keystore.enclaves[0], NOW, VARIANTS[profile]).usable.must is not (
                strict and not number
            )


@pytest.mark.parametrize("whole", [True, False])
def test_an_intermediate_comes_first_where_its_root_is_there_too(whole: bool, tmp_path: Path) -> None:
    below = certificate("below", ROOT, key=KEY, ca=None, extensions=(CRITICAL, SIGNS, OWN, ABOVE))
    issuer = authority("new")
    file = (below, issuer, ROOT) if whole else (below, issuer)
    (tmp_path / "ca").write_bytes(b"".join(each.pem for each in file))
    (tmp_path / "first").write_bytes(below.pem)
    command = ["openssl", "verify", "-x509_strict", "-check_ss_sig", "-attime", AT, "-CAfile", "ca", "first"]
    assert (subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode == 0) is whole
    talker = Member(permissions=permissions(grant("/talker", rule(criterion("publish", "rt/chatter")))), issuer=issuer)
    keystore = read_keystore(Store(members={"/talker": talker}, identity=file).write(tmp_path / "keystore"))
    usabilities = Usabilities(None, AccessViews(documents_of(keystore), NOW, None))
    for profile, loads in (("fastdds-3.6", whole), ("fastdds-2.9", True)):
        assert usabilities.of(keystore.enclaves[0], NOW, VARIANTS[profile]).usable.must is loads
