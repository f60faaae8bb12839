"""What to do, for people: commands with the names of what the finding is about, and long ones once."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.report import markdown
from keystore_audit.report.content import Report
from keystore_audit.report.remedy import Remedies, exact
from keystore_audit.report.text import View, render
from keystore_audit.rules import BY_CODE
from keystore_audit.rules.commands import DEEPER, LINK_CA, LINK_GOVERNANCE
from tests.cli.keystores import answer
from tools.samples.store import copy_with_modes

MakeReport = Callable[..., Report]


VERBOSE = View(verbose=True)


def about(code: str, path: str, enclave: str | None) -> Finding:
    """A finding of the rule, with its usual remedy."""
    rule = BY_CODE[code]
    return Finding(
        code=code,
        name=rule.name,
        severity=rule.severity,
        message=f"Something about {enclave}.",
        remedy=rule.remedy,
        clause=rule.clause,
        enclave=enclave,
        locations=(Location(path=path, line=1, message=""),),
        profiles=(),
        explained_by=(),
        fingerprint="0" * 64,
    )


def commands(remedy: str) -> list[str]:
    """Those of openssl."""
    return [each for each in remedy.split("`")[1::2] if "openssl " in each]


@pytest.mark.parametrize(
    ("code", "path", "written"),
    [
        ("KA301", "enclaves/talker/permissions.p7s", "permissions.p7s"),
        ("KA508", "enclaves/talker/permissions.p7s", "permissions.p7s"),
        ("KA209", "enclaves/talker/key.pem", "cert.pem"),
    ],
)
def test_the_command_can_be_typed_as_it_stands(
    code: str, path: str, written: str, repository: Path, tmp_path: Path
) -> None:
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores/stock/talker_listener", root, 0o600)
    there = root / "enclaves/talker" / written
    before = there.read_bytes()
    remedy = exact(about(code, path, "/talker"))
    for command in commands(remedy):
        subprocess.run(["sh", "-ec", command], cwd=root, capture_output=True, check=True, timeout=60)
    assert there.read_bytes() != before
    assert not any(word in remedy for word in ("ENCLAVE", "DOCUMENT", " being "))
    assert "create_permission KEYSTORE /talker policy.xml" in remedy


@pytest.mark.parametrize(
    ("path", "name"), [("enclaves/a-b/cert.pem", "enclaves/a-b/cert.pem"), ("x;y/cert.pem", "FILE"), ("-x", "FILE")]
)
def test_the_file_is_named_where_a_shell_reads_its_name_as_it_is(path: str, name: str) -> None:
    assert f"`openssl x509 -in {name} -out new.pem`" in exact(about("KA202", path, None))
    remedies = Remedies()
    remedies.give(about("KA202", "public/ca.cert.pem", None))
    assert remedies.give(about("KA202", path, None)).endswith("" if name == "FILE" else f", for {name}")
    of_others = replace(about("KA741", path, None), remedy="`keystore-audit model --alloy-property FILE`")
    assert exact(of_others) == of_others.remedy


def test_the_authority_is_named_where_its_file_tells_which_it_is() -> None:
    first, other, both = (
        about("KA208", f"public/{name}ca.cert.pem", None) for name in ("identity_", "permissions_", "")
    )
    (renew,) = commands(exact(first))
    assert "-key private/identity_ca.key.pem " in renew
    assert renew.endswith("-out public/identity_ca.cert.pem")
    assert "ROLE" not in exact(first)
    remedies = Remedies()
    remedies.give(first)
    assert remedies.give(other) == "as for KA208 above, for public/permissions_ca.cert.pem"
    assert exact(both) == both.remedy
    of_both = about("KA115", "public/identity_ca.cert.pem", None)
    assert exact(of_both) == of_both.remedy


@pytest.mark.parametrize("enclave", ["/listener", "/arm/driver", "/a/b/c"])
def test_a_link_leads_to_its_file_from_any_depth(enclave: str, tmp_path: Path) -> None:
    for name, target in (("governance.p7s", "enclaves"), ("identity_ca.cert.pem", "public")):
        folder = tmp_path / f"enclaves{enclave}"
        folder.mkdir(parents=True, exist_ok=True)
        (tmp_path / target).mkdir(exist_ok=True)
        (tmp_path / target / name).write_text("here")
        command = LINK_GOVERNANCE if target == "enclaves" else LINK_CA.replace("ROLE", "identity")
        missing = replace(about("KA101", f"enclaves{enclave}/{name}", enclave), remedy=f"Make it: {command}, {DEEPER}.")
        remedy = exact(missing)
        subprocess.run(["sh", "-ec", remedy.split("`")[1]], cwd=tmp_path, check=True, timeout=60)
        assert (folder / name).read_text() == "here"
        assert remedy.endswith("`.")
        remedies = Remedies()
        remedies.give(replace(missing, enclave="/other/depth/of/it"))
        assert remedies.give(missing) == remedy


def test_a_document_of_all_enclaves_is_named_too() -> None:
    remedy = exact(about("KA301", "enclaves/governance.p7s", None))
    assert "-in enclaves/governance.xml -out signed.new" in remedy
    assert "mv signed.new enclaves/governance.p7s" in remedy
    assert "create_permission KEYSTORE ENCLAVE policy.xml" in remedy


@pytest.mark.parametrize("enclave", [None, "/", "/a b", "/$(reboot)", "/a`b", "/a;b", "/a\n", "/ü"])
def test_no_other_name_gets_into_a_command(enclave: str | None) -> None:
    """A shell would read it otherwise, or the command is for every enclave."""
    for code in ("KA301", "KA209", "KA508"):
        finding = about(code, f"enclaves{enclave}/permissions.p7s", enclave)
        assert exact(finding) == finding.remedy
    every = about("KA222", "public/ca.cert.pem", "/talker")
    assert exact(every) == every.remedy


def test_what_several_remedies_end_with_is_given_once() -> None:
    remedies = Remedies()
    first = remedies.give(about("KA219", "enclaves/a/cert.pem", None))
    assert "openssl req" in first
    again = about("KA209", "enclaves/a/key.pem", "/a")
    assert not remedies.told(again)
    assert (
        remedies.give(again)
        == 'as for KA219 above ("Move the enclave\'s cert.pem and key.pem away and run …"), for /a.'
    )
    assert remedies.told(again)
    assert remedies.give(replace(again, enclave="/b")) == "as for KA209 above, for /b"
    other = replace(again, code="KA503", remedy=f"Let both say CN=/b. {again.remedy}", enclave="/b")
    assert remedies.give(other).startswith('Let both say CN=/b. Go on as for KA219 above ("Move')
    assert remedies.give(replace(other, remedy="Something else: " + again.remedy)).startswith("Something else: as for")
    opened = replace(other, remedy=f"{other.remedy.rstrip('.')}, and more.")
    assert remedies.give(opened) == exact(opened), "it goes on otherwise"


def test_a_command_of_a_longer_remedy_is_found_there() -> None:
    remedies = Remedies()
    remedies.give(about("KA222", "public/ca.cert.pem", None))
    said = remedies.give(about("KA408", "enclaves/governance.p7s", None))
    assert said.endswith(
        'as for KA222 above ("rm -f signed.new && openssl smime -sign -text -in enclaves/governance.xml …").'
    )
    short = replace(about("KA408", "enclaves/governance.p7s", None), remedy="Run `chmod 600`.")
    assert [Remedies().give(short), remedies.give(short)] == ["Run `chmod 600`."] * 2


def test_the_words_that_it_begins_with_stand_above() -> None:
    """With the other's names; and so many that one command is known from the next."""
    remedies = Remedies()
    above = remedies.give(about("KA508", "enclaves/talker/permissions.p7s", "/talker"))
    signing = f"`{commands(BY_CODE['KA508'].remedy)[0]}`"
    signed = replace(about("KA510", "enclaves/listener/permissions.p7s", "/listener"), remedy=f"Sign it: {signing}.")
    said = remedies.give(signed)
    assert said.endswith(
        '("rm -f signed.new && openssl smime -sign -text -in enclaves/talker/permissions.xml …"), for /listener.'
    )
    assert said.split('"')[1].removesuffix(" …") in above


def test_one_place_is_led_to_and_not_another_that_leads_on() -> None:
    remedies = Remedies()
    given = [remedies.give(about(code, "enclaves/governance.p7s", None)) for code in ("KA222", "KA722", "KA723")]
    assert [each.count("for KA222 above") for each in given] == [0, 1, 1]


def test_what_robots_share_is_made_for_each_of_them() -> None:
    shared = about("KA666", "enclaves/talker/cert.pem", "/talker")
    assert exact(shared) == shared.remedy


def test_markdown_gives_it_once_too(make_report: MakeReport) -> None:
    keys = tuple(about("KA209", f"enclaves{name}/key.pem", name) for name in ("/a", "/b"))
    text = markdown.render([replace(make_report(), findings=keys)], Severity.INFO)
    assert text.count("openssl req") == 1
    assert "*Also:* /b (enclaves/b/key.pem:1)" in text.replace("\\", "")


def test_lesser_findings_that_differ_by_the_enclave_alone_are_counted(make_report: MakeReport) -> None:
    """sros2 leaves every key readable: one example, and who else."""
    report = make_report()
    keys = tuple(
        replace(about("KA108", f"enclaves{name}/key.pem", name), severity=Severity.MEDIUM, fingerprint=f"{number:064}")
        for number, name in enumerate(("/a", "/b", "/c"))
    )
    text = render(replace(report, findings=keys), VERBOSE)
    assert text.count("Something about") == 1
    assert "also    /b  (enclaves/b/key.pem:1)\n          /c  (enclaves/c/key.pem:1)\n" in text
    apart = (keys[0], replace(keys[1], message="Something else about /b."), keys[2])
    assert "  also    /c  (enclaves/c/key.pem:1)\n  clause" in render(replace(report, findings=apart), VERBOSE)
    under = (keys[0], replace(keys[1], profiles=("fastdds-2.6",)), keys[2])
    assert "  also    /c  (enclaves/c/key.pem:1)\n  clause" in render(replace(report, findings=under), VERBOSE), (
        "it holds for others"
    )


@pytest.mark.parametrize("enclave", [None, "/", "/arm/driver", "/$(reboot)"])
def test_every_remedy_can_be_given_after_every_other(enclave: str | None) -> None:
    remedies = Remedies()
    for code in [*BY_CODE, *reversed(BY_CODE)]:
        finding = about(code, f"enclaves{enclave}/permissions.p7s", enclave)
        assert remedies.give(finding)
        assert remedies.told(finding)
    assert remedies.give(replace(about("KA209", "x", enclave), remedy="", code="KA999")) == ""


def test_identities_that_outlive_an_authority_by_seconds_are_told_once(repository: Path) -> None:
    """As sros2 makes them, each at another second."""
    _exit_code, text = answer("audit", repository / "sample_keystores/stock/turtlesim", "--engine", "native", "-v")
    assert text.count("outlives its authority") == 1
    assert all(f"  {name}  (enclaves{name}/cert.pem:1)\n" in text for name in ("/multiplexer", "/random", "/turtlesim"))
