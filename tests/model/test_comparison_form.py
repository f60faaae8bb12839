"""Documents and certificates that say the same in another form: weaker digests, algorithms and usages are changes."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.hazmat.primitives.serialization.pkcs7 import PKCS7Options, PKCS7SignatureBuilder
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Comparison, FailOn
from tests.keystore.builder import certificate, signed_document
from tests.model.comparing import authority, compared, domain_rule, governance, key
from tests.model.single_changes import BASE, TALKER, talker

SIGNER = authority("permissionsCA")
IDENTITY = authority("identityCA")
PLAIN = (PKCS7Options.Text, PKCS7Options.DetachedSignature)
Write = Callable[[Path], bytes]


def by_openssl(*options: str) -> Write:
    """The talker's permissions, signed with the command line tool."""

    def write(directory: Path) -> bytes:
        for name, content in (("x", talker(TALKER).encode()), ("c", SIGNER.pem), ("k", SIGNER.key_pem)):
            (directory / name).write_bytes(content)
        sign = ("openssl", "smime", "-sign", "-text", "-in", "x", "-out", "y", "-signer", "c", "-inkey", "k")
        subprocess.run([*sign, *options], cwd=directory, check=True, capture_output=True)
        return (directory / "y").read_bytes()

    return write


def without_attributes(_directory: Path) -> bytes:
    builder = PKCS7SignatureBuilder().set_data(talker(TALKER).encode())
    signer = builder.add_signer(SIGNER.certificate, SIGNER.key, hashes.SHA256())  # type: ignore[arg-type]
    return signer.sign(Encoding.SMIME, [*PLAIN, PKCS7Options.NoAttributes])


def issued(*options: str) -> Write:
    """The talker's identity with its key, issued with the command line tool."""

    def write(directory: Path) -> bytes:
        own = certificate("/talker", IDENTITY, key=key("/talker"))
        for name, content in (("ca", IDENTITY.pem), ("ca.key", IDENTITY.key_pem), ("key", own.key_pem)):
            (directory / name).write_bytes(content)
        (directory / "usage").write_text("keyUsage=digitalSignature\n")
        for arguments in (
            ("req", "-new", "-key", "key", "-subj", "/CN=\\/talker", "-out", "request"),
            ("x509", "-req", "-in", "request", "-CA", "ca", "-CAkey", "ca.key", "-out", "leaf", *options),
        ):
            subprocess.run(["openssl", *arguments], cwd=directory, check=True, capture_output=True)
        return (directory / "leaf").read_bytes()

    return write


SHA256, SHA1 = by_openssl("-md", "sha256"), by_openssl("-md", "sha1")
DATES = ("-not_before", "20240101000000Z", "-not_after", "20340101000000Z")


def told(file: str, old: Write, new: Write, root: Path) -> Comparison:
    stores = []
    for name, write in (("old", old), ("new", new)):
        scratch = root / f"{name}.made"
        scratch.mkdir()
        stores.append(replace(BASE, files={f"enclaves/talker/{file}": write(scratch)}))
    return compared(*stores, root)


@pytest.mark.parametrize(
    ("old", "new", "direction", "aspect"),
    [
        (SHA256, SHA1, "gained", ("digest", "sha256", "sha1")),
        (SHA1, SHA256, "lost", ("digest", "sha1", "sha256")),
        (SHA256, by_openssl("-md", "sha512"), "changed", ("digest", "sha256", "sha512")),
        (SHA256, without_attributes, "changed", ("out of order", None, "no-signed-attributes")),
        (SHA256, by_openssl("-md", "sha256", "-nodetach"), "changed", ("out of order", None, "opaque-message")),
    ],
)
def test_a_document_signed_again_in_another_form(
    old: Write, new: Write, direction: str, aspect: tuple[str, str | None, str | None], tmp_path: Path
) -> None:
    found = told("permissions.p7s", old, new, tmp_path)
    (change,) = found.changes
    assert (change.kind, change.direction.value, change.enclaves) == ("document-form", direction, ("/talker",))
    assert [(each.what, each.old, each.new) for each in change.aspects] == [aspect]
    assert bool(found.failing(FailOn.GAINED)) is (direction != "lost")


def test_signed_again_in_the_same_form_is_no_change(tmp_path: Path) -> None:
    found = told("permissions.p7s", SHA256, SHA256, tmp_path)
    assert [(change.kind, change.direction.value) for change in found.changes] in ([], [("signed-again", "info")])


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (("-sha256",), ("-sha1",), ("certificate-form", "gained")),
        (("-sha1",), ("-sha256",), ("certificate-form", "lost")),
        (("-sha256",), ("-sha512",), ("certificate-form", "changed")),
        (("-sha256",), ("-sha256", "-extfile", "usage"), ("certificate-form", "changed")),
        (("-sha256",), ("-sha256",), ("reissued", "info")),
    ],
)
def test_an_identity_issued_again(
    old: tuple[str, ...], new: tuple[str, ...], expected: tuple[str, str], tmp_path: Path
) -> None:
    """With the same key, subject and dates."""
    probe = subprocess.run(["openssl", "x509", "-help"], capture_output=True, text=True, check=False)
    dates = DATES if "-not_before" in probe.stderr + probe.stdout else ("-days", "900")
    found = told("cert.pem", issued(*old, *dates), issued(*new, *dates), tmp_path)
    shown = [(change.kind, change.direction.value) for change in found.changes if "validity" not in change.kind]
    kinds = {kind for kind, _direction in shown}
    if dates is not DATES and expected[0] == "reissued":
        assert kinds <= {"reissued"}
    else:
        assert expected in shown
        assert "reissued" not in kinds - {expected[0]}


def test_a_key_of_another_kind_is_told_with_it(tmp_path: Path) -> None:
    """Short keys are less protection, of whatever kind the certificate."""
    from cryptography.hazmat.primitives.asymmetric import rsa

    short = certificate("/talker", IDENTITY, key=rsa.generate_private_key(65537, 1024), serial=101)
    plain = certificate("/talker", IDENTITY, key=key("/talker"), serial=101)
    assert isinstance(plain.certificate, x509.Certificate)
    found = told("cert.pem", lambda _: plain.pem, lambda _: short.pem, tmp_path)
    (form,) = (change for change in found.changes if change.kind == "certificate-form")
    assert form.direction.value == "gained"
    assert [(each.what, each.old, each.new) for each in form.aspects] == [("key", "EC secp256r1", "RSA 1024")]


def test_governance_that_no_enclave_carries(tmp_path: Path) -> None:
    """Signed by the authority of the enclaves, it may take the place of theirs (KA661); by another, it may not."""
    open_domain = governance(domain_rule(rtps_protection_kind="NONE")).encode()
    theirs, strangers = (
        replace(BASE, files={"old.p7s": signed_document(open_domain, signer)})
        for signer in (SIGNER, authority("nobody"))
    )
    found = compared(strangers, theirs, tmp_path / "two")
    assert [(each.kind, each.direction.value) for each in found.changes] == [("governance-at-large", "gained")]
    assert not compared(theirs, theirs, tmp_path / "one").changes
