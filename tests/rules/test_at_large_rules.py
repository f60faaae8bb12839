"""What the audit says of identities at large: each once, with what follows from it below."""

from __future__ import annotations

import json
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


def test_a_grant_that_names_one_by_a_vendors_comparison_says_so(tmp_path: Path) -> None:
    """/admin/arm is an enclave; on Cyclone DDS its grant names /admin too, whose key lies there."""
    arm = Member(permissions=permissions(grant("/admin/arm", rule(criterion("publish", "rt/else")))), serial=104)
    store = replace(STORE, members={**STORE.members, "/admin/arm": arm}, strays={})
    other = {"backup/cert.pem": identity("/other", "other").pem, "backup/key.pem": identity("/other", "other").key_pem}
    for name, files, expected in (("a", LYING_ABOUT, True), ("b", NOBODYS, False), ("c", other, False)):
        told = [each for each in report(written(tmp_path / name, files, store)).findings if each.code == "KA519"]
        assert bool(told) is expected
        if told:
            assert "'CN=/admin' too" in told[0].message
            assert told[0].message.endswith("whoever has the identity in backup/cert.pem has its rights.")
            assert {place.path for place in told[0].locations} == {"enclaves/admin/arm/permissions.p7s", *NOBODYS}


def test_a_subject_without_end_is_cut(tmp_path: Path) -> None:
    units = (x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, f"{number:064}") for number in range(200))
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "/admin"), *units])
    root = written(tmp_path, {"public/x_ca.cert.pem": identity(name, "/talker").pem})
    for words in (("audit", root, "--engine", "native"), ("flow", root, "--from-compromised", "/talker")):
        _code, output = answer(*words, "--at", "2026-11-21T12:00:00Z")
        assert "no enclave)" in " ".join(output.split())
        assert "0100" not in output, "what stands in its middle"


def test_a_flow_names_the_certificate_with_its_line(tmp_path: Path) -> None:
    for name, files, question in (
        ("a", HELD, ["topic:/chatter", "/talker"]),
        ("b", LYING_ABOUT, ["/talker", "/motor"]),
    ):
        root = written(tmp_path / name, files)
        code, output = answer("flow", root, *question, "-f", "json", "--at", "2026-11-21T12:00:00Z")
        assert code == 1
        (certificate,) = (path for path in files if path.endswith("cert.pem"))
        steps = [step for each in _examples(json.loads(output)) for step in each["steps"]]
        assert {step["line"] for step in steps if step["path"] == certificate} == {1}


def _examples(found: object) -> list[dict[str, list[dict[str, object]]]]:
    """All counterexamples of a document, wherever they stand."""
    if isinstance(found, dict):
        own = [found] if found.get("steps") else []
        return [*own, *(each for value in found.values() for each in _examples(value))]
    return [each for value in found for each in _examples(value)] if isinstance(found, list) else []


def test_whom_a_key_passes_for_beside_the_enclaves(tmp_path: Path) -> None:
    words = []
    for name, files in (("a", {}), ("b", HELD)):
        _code, output = answer("flow", written(tmp_path / name, files), "--from-compromised", "/talker")
        words.append(" ".join(output.split()))
    assert ["no enclave)" in each for each in words] == [False, True]
    assert "passes for no other enclave" in words[0]
    assert "passes for CN=/listener (public/x_ca.cert.pem, no enclave) reaches" in words[1]
    assert "reaches 1 of 3 enclaves while the others stay honest: /listener" in words[1]


def test_services_are_compared_where_enclaves_may_be(tmp_path: Path) -> None:
    """A governance that whoever is at large may start with brings no enclave into its domains."""

    def told(place: str, governed: str, strays: dict[str, str]) -> set[str]:
        answers = rule(
            criterion("publish", "rr/planReply"), criterion("subscribe", "rq/planRequest"), domains="<id>7</id>"
        )
        members = {
            path: Member(permissions=permissions(grant(path, answers)), serial=serial)
            for path, serial in (("/a", 301), ("/b", 302))
        }
        store = replace(
            STORE,
            members=members,
            strays={**STORE.strays, **strays},
            governance=governance(domain_rule(domains=governed)),
        )
        return {each.code for each in report(written(tmp_path / place, LYING_ABOUT, store)).findings}

    far = governance(domain_rule(domains="<id>7</id>"))
    assert "KA634" in told("theirs", "<id>0</id><id>7</id>", {})
    apart = told("apart", "<id>0</id>", {"governance.p7s": far})
    assert {"KA661", "KA668"} <= apart
    assert "KA634" not in apart
