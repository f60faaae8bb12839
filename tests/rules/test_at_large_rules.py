"""What the audit says of identities at large: each once, with what follows from it below."""

from __future__ import annotations

from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from tests.cli.keystores import answer
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import AT, Member, Store, authority
from tests.model.test_at_large import HELD, LYING_ABOUT, NOBODYS, STORE, Files, identity, written


def report(root: Path) -> Report:
    return audit(root, Options(at=AT, engine="native"))


def causes(report: Report) -> dict[str, set[str]]:
    """By code of a violated property about identities, the codes of the findings that explain it."""
    by_mark: dict[str, Finding] = {finding.fingerprint: finding for finding in report.findings}
    told = [finding for finding in report.findings if finding.code in ("KA702", "KA704", "KA707")]
    return {finding.code: {by_mark[mark].code for mark in finding.explained_by} for finding in told}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, {}),
        (HELD, {"KA704": {"KA228"}, "KA707": {"KA228"}}),
        ({"public/x_ca.cert.pem": identity("/admin", "/talker").pem}, {"KA704": {"KA228"}}),
        ({"public/x_ca.cert.pem": identity("/listener", "/talker", authority("other")).pem}, {}),
        ({"public/x_ca.cert.pem": identity("/talker", "/talker", serial=9).pem}, {}),
        (LYING_ABOUT, {}),
        (NOBODYS, {}),
        ({"backup/cert.pem": identity("/admin", "/talker").pem}, {"KA704": set()}),
    ],
)
def test_what_follows_is_told_below_what_it_follows_from(
    files: Files, expected: dict[str, set[str]], tmp_path: Path
) -> None:
    assert causes(report(written(tmp_path, files))) == expected


OTHER = (authority("otherCA"), authority("otherPermissionsCA"))
"""For identities and for permissions."""
ADMIN = Member(permissions=permissions(grant("/admin", rule(criterion("publish", "rt/else")))), serial=104)


def beside(root: Path, *profiles: str) -> list[Severity]:
    found = audit(root, Options(at=AT, engine="native", profiles=profiles)).findings
    return [finding.severity for finding in found if finding.code == "KA668"]


def test_an_enclave_of_its_subject_counts_where_whoever_takes_it_takes_that_enclave(tmp_path: Path) -> None:
    """Peers of another trust domain refuse the enclave: it has none of the rights there that this one has."""
    trusting = replace(STORE, members={**STORE.members, "/admin": ADMIN})
    assert beside(written(tmp_path / "a", LYING_ABOUT)) == [Severity.HIGH]
    assert beside(written(tmp_path / "b", LYING_ABOUT, trusting)) == [Severity.MEDIUM]
    root = written(tmp_path / "c", LYING_ABOUT)
    Store(members={"/admin": ADMIN}, identity=OTHER[:1], permissions=OTHER[1:]).write(root)
    assert beside(root) == [Severity.HIGH]
    revoked = replace(trusting, revoked=(ADMIN.serial,))
    assert beside(written(tmp_path / "d", LYING_ABOUT, revoked), "spec") == [Severity.HIGH]


OPEN = governance(domain_rule(join="false"))


@pytest.mark.parametrize(("profile", "found"), [("cyclonedds-11", [Severity.HIGH]), ("fastdds-3.6", [])])
def test_a_governance_that_wants_no_grant_is_one_of_a_peer_that_takes_it(
    profile: str, found: list[Severity], tmp_path: Path
) -> None:
    """And of an implementation that lets anybody in by it: Fast DDS asks everybody for some grant."""
    made = identity("/nobody", "nobody")
    files = {"backup/cert.pem": made.pem, "backup/key.pem": made.key_pem}
    assert beside(written(tmp_path / "a", files, replace(STORE, governance=OPEN)), profile) == found
    root = written(tmp_path / "b", files)
    Store(members={"/admin": ADMIN}, identity=OTHER[:1], permissions=OTHER[1:], governance=OPEN).write(root)
    assert beside(root, profile) == []


@pytest.mark.parametrize(("profile", "found"), [("cyclonedds-0.10", [Severity.HIGH]), ("cyclonedds-11", [])])
def test_who_signs_itself_its_permissions_needs_no_grant(profile: str, found: list[Severity], tmp_path: Path) -> None:
    """Of one CA for both roles each identity does, where the signer is not pinned."""
    one_ca = replace(STORE, permissions=(authority("identityCA"),))
    made = identity("/nobody", "nobody")
    files = {"backup/cert.pem": made.pem, "backup/key.pem": made.key_pem}
    assert beside(written(tmp_path / "a", files, one_ca), profile) == found
    assert beside(written(tmp_path / "b", files), profile) == []
    unfit = identity(
        "/nobody", "nobody", extensions=[(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), False)]
    )
    assert beside(written(tmp_path / "c", {**files, "backup/cert.pem": unfit.pem}, one_ca), profile) == []


def test_whoever_has_the_key_of_the_permissions_ca_needs_none_under_any_profile(tmp_path: Path) -> None:
    made = identity("/nobody", "permissionsCA")
    files = {"backup/cert.pem": made.pem, "backup/key.pem": made.key_pem}
    for profile in ("spec", "cyclonedds-0.10", "fastdds-3.6"):
        assert beside(written(tmp_path / profile, files), profile) == [Severity.HIGH]


def test_a_subject_without_end_is_cut(tmp_path: Path) -> None:
    units = (x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, f"{number:064}") for number in range(200))
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "/admin"), *units])
    root = written(tmp_path, {"public/x_ca.cert.pem": identity(name, "/talker").pem})
    for words in (("audit", root, "--engine", "native"), ("flow", root, "--from-compromised", "/talker")):
        _code, output = answer(*words, "--at", "2026-11-21T12:00:00Z")
        assert "no enclave)" in " ".join(output.split())
        assert "0100" not in output, "what stands in its middle"
