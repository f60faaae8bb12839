"""Declaring whom one trusts: in settings, by options, for one keystore or several, and from Python."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from keystore_audit import api
from tests.cli.conftest import Run

SAMPLES = Path(__file__).parents[2] / "sample_keystores"
GOOD = SAMPLES / "rules/KA223-unexpected-authority/good"
BAD = SAMPLES / "rules/KA223-unexpected-authority/bad"
AT = "2026-11-21T12:00:00Z"
KEYS = {
    role: subprocess.run(
        f"openssl x509 -noout -pubkey -in {GOOD}/public/{role}_ca.cert.pem | openssl pkey -pubin -outform DER |"
        " openssl sha256 -r",
        shell=True,
        check=True,
        capture_output=True,
        text=True,
    ).stdout[:64]
    for role in ("identity", "permissions")
}
"""By the commands that docs/settings.md gives."""
DECLARED = "[authorities]\n" + "".join(f'{role} = "sha256:{key}"\n' for role, key in KEYS.items())
EXPECTED = [word for role, key in KEYS.items() for word in (f"--expect-{role}-ca", f"sha256:{key}")]


def audited(run: Run, *args: str | Path, at: str = AT) -> tuple[int, dict[str, object]]:
    done = run("audit", "--engine", "native", "--at", at, "-f", "json", *args)
    return done.returncode, json.loads(done.stdout) if done.returncode in (0, 1) else {"said": done.stderr.decode()}


def codes(report: dict[str, object]) -> list[str]:
    found = report["findings"]
    assert isinstance(found, list)
    return [each["code"] for each in found if each["code"] in ("KA202", "KA223")]


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    file = tmp_path / "keystore-audit.toml"
    file.write_text(DECLARED)
    return file


def test_settings_and_options_declare_the_same(keystore_audit: Run, settings: Path) -> None:
    for given in (["--settings", settings], EXPECTED):
        for sample, expected in ((GOOD, 0), (BAD, 1)):
            code, report = audited(keystore_audit, sample, *given)
            assert (code, codes(report)) == (expected, ["KA223", "KA223"] if expected else [])
            told = json.dumps(report["authorities"]) + json.dumps(report["assumptions"])
            assert "nobody declared them" not in told
            assert f'"declared": ["sha256:{KEYS["identity"]}"]' in told


def test_one_role_that_is_not_declared_is_a_warning(keystore_audit: Run) -> None:
    """A half-declared gate lets a stranger be the other authority, and says so first, quiet or not."""
    said = "WARNING  The permissions CA is not declared, but the other one is."
    for given, warned in ((EXPECTED[:2], True), (EXPECTED, False), ([], False)):
        done = keystore_audit("audit", "--engine", "native", "--at", AT, "-q", GOOD, *given)
        assert (said in done.stdout.decode()) is warned, given


def test_an_option_goes_before_what_settings_say_of_its_role(keystore_audit: Run, settings: Path) -> None:
    other = f"sha256:{KEYS['permissions']}"
    code, report = audited(keystore_audit, GOOD, "--settings", settings, "--expect-identity-ca", other)
    assert (code, codes(report)) == (1, ["KA223"])


@pytest.mark.parametrize("form", ["PEM", "DER"])
def test_a_file_is_that_certificate(form: str, keystore_audit: Run, tmp_path: Path) -> None:
    files = {}
    for role in KEYS:
        files[role] = tmp_path / f"{role}.{form}"
        source = str(GOOD / f"public/{role}_ca.cert.pem")
        subprocess.run(["openssl", "x509", "-in", source, "-outform", form, "-out", files[role]], check=True)
    given = [word for role, file in files.items() for word in (f"--expect-{role}-ca", str(file))]
    assert audited(keystore_audit, GOOD, *given)[0] == 0
    swapped = ["--expect-identity-ca", str(files["permissions"]), "--expect-permissions-ca", str(files["identity"])]
    assert codes(audited(keystore_audit, GOOD, *swapped)[1]) == ["KA223", "KA223"]


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("sha256:12", "is no fingerprint"),
        ("nowhere.pem", "cannot be read"),
        (str(GOOD / "public/identity_ca.cert.pem"), "lies in the keystore"),
        (str(GOOD / "enclaves/governance.p7s"), "lies in the keystore"),
        (__file__, "is no file of certificates"),
    ],
)
def test_what_declares_nothing_is_refused(value: str, said: str, keystore_audit: Run) -> None:
    """A keystore's own file would absolve it."""
    code, report = audited(keystore_audit, GOOD, "--expect-identity-ca", value)
    assert code == 2
    assert said in " ".join(str(report["said"]).split())


def test_what_v_prints_declares_what_was_found(keystore_audit: Run, tmp_path: Path) -> None:
    text = keystore_audit("audit", GOOD, "--engine", "native", "--at", AT, "-v").stdout.decode()
    assert "nobody declared them" in " ".join(text.split())
    lines = [line.strip() for line in text.splitlines()]
    start = lines.index("[authorities]")
    file = tmp_path / "keystore-audit.toml"
    file.write_text("\n".join(lines[start : lines.index("", start)]))
    assert "--settings keystore-audit.toml" in text
    code, report = audited(keystore_audit, GOOD, "--settings", file)
    assert (code, codes(report)) == (0, [])
    assert "nobody declared them" not in json.dumps(report["assumptions"])
    again = keystore_audit("audit", GOOD, "--engine", "native", "--at", AT, "-v", "--settings", file).stdout.decode()
    assert "Authorities, declared" in again
    assert "[authorities]" not in again
    page = keystore_audit("audit", GOOD, "--engine", "native", "--at", AT, "-f", "html").stdout.decode()
    assert all(key in page for key in KEYS.values())
    assert "--settings keystore-audit.toml" in page


@pytest.mark.parametrize("content", [None, b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"])
def test_whom_a_file_that_cannot_be_read_trusts_is_unknown(
    content: bytes | None, keystore_audit: Run, settings: Path, tmp_path: Path
) -> None:
    """None: a PKCS#11 reference beside the file, which Fast DDS reads in its place."""
    root = tmp_path / "keys"
    shutil.copytree(GOOD, root, symlinks=True)
    file = root / "enclaves/talker/identity_ca.cert.pem"
    file.unlink()
    file.write_bytes(content or (GOOD / "public/identity_ca.cert.pem").read_bytes())
    if content is None:
        assert audited(keystore_audit, root, "--settings", settings)[0] == 0
        file.with_suffix(".p11").write_bytes(b"pkcs11:object=ca")
    assert audited(keystore_audit, root, "--settings", settings)[0] == 4


def test_what_is_declared_is_not_assumed(keystore_audit: Run, settings: Path) -> None:
    for given, expected in ([], 4), (["--settings", settings], 0):
        code, _report = audited(keystore_audit, GOOD, "--no-assume", "authorities-as-found", *given)
        assert code == expected


def test_python_declares_it_too(settings: Path) -> None:
    files = {f"expect_{role}_ca": [f"sha256:{key}"] for role, key in KEYS.items()}
    for given in ({"settings": settings}, files):
        report = api.audit(GOOD, engine="native", **given)
        assert report.authorities_declared
        assert not api.audit(GOOD, engine="native").authorities_declared
        found = {each.code for each in api.audit(BAD, engine="native", **given).findings}
        assert found - {"KA108"} == {"KA223", "KA230", "KA636"}  # KA108: by the modes of a checkout
    with pytest.raises(api.UsageError, match="is no fingerprint"):
        api.audit(GOOD, expect_identity_ca=["sha256:"])
    with pytest.raises(api.UsageError, match="Expected `array`, got `str`"):
        api.audit(GOOD, expect_identity_ca="sha256:")
