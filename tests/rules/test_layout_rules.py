"""KA1 and the private keys of KA2: one change each makes a rule speak, and no other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.foreign import DeclaredFiles, Foreign
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Usability
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.cli.keystores import AT, answer, rule
from tests.cli.keystores import keystore as built
from tests.rules.divergent import views
from tests.rules.evidence import AT as NOW
from tests.rules.evidence import (
    Change,
    absent,
    becomes,
    certificates,
    domain_rule,
    enclave,
    file,
    findings,
    first,
    governance,
    healthy,
    judged,
    keystore,
    laid_out,
    meaning,
    pem,
    private_key,
    talker,
)

PERMISSIONS = "enclaves/talker/permissions.p7s"
KEY = "enclaves/talker/key.pem"
XML = "enclaves/talker/permissions.xml"


def without_permissions(status: Status) -> Change:
    return talker(permissions=None, files={Role.PERMISSIONS: absent(PERMISSIONS, status, "some words")})


def key_with(**more: object) -> Change:
    return talker(key=private_key(KEY, "/talker", **more))


def test_ardents_one_authority_is_missing_once() -> None:
    gone = absent("talker/ca.cert.pem")
    change = talker(identity_ca=None, permissions_ca=None, files={Role.IDENTITY_CA: gone, Role.PERMISSIONS_CA: gone})
    assert len(findings("KA101", judged(change(healthy())))) == 1


def test_a_revocation_list_may_be_missing_but_not_a_dangling_link() -> None:
    loop = absent("enclaves/talker/crl.pem", Status.LOOP, "a circle")
    assert becomes(talker(files={Role.CRL: loop})) == ["KA102"]


def test_keys_are_judged_by_whom_the_tree_is_for() -> None:
    change = laid_out(authority_keys=(file("private/ca.key.pem", None, mode=0o644),))
    kept, shipped = judged(change(healthy())), judged(change(healthy()), deployed=True)
    assert [f.severity for code in ("KA109", "KA116") for f in findings(code, kept)] == [Severity.INFO, Severity.INFO]
    assert [f.severity for code in ("KA109", "KA116") for f in findings(code, shipped)] == [
        Severity.CRITICAL,
        Severity.HIGH,
    ]
    readable = key_with(file=file(KEY, None, mode=0o640))(healthy())
    assert findings("KA108", judged(readable))[0].severity is Severity.INFO
    assert findings("KA108", judged(readable, deployed=True))[0].severity is Severity.HIGH


@pytest.mark.parametrize(
    ("mode", "group", "said"),
    [(0o640, 998, False), (0o440, 998, False), (0o640, 999, True), (0o660, 998, True), (0o644, 998, True)],
)
def test_the_group_that_settings_name_may_read_keys(mode: int, group: int, said: bool) -> None:
    store = key_with(file=file(KEY, None, mode=mode, group=group))(healthy())
    assert findings("KA108", judged(store))
    declared = replace(store, declared=DeclaredFiles(key_group=998))
    assert bool(findings("KA108", judged(declared))) is said


FOREIGN = tuple(
    Foreign(file=file(path, b"x"), top=top)
    for path, top in (("maps/hall.yaml", "maps"), ("maps/old/a.pgm", "maps"), (".git/HEAD", ".git"), ("notes", "notes"))
)


def test_foreign_files_are_named_in_one_finding() -> None:
    store = replace(healthy(), foreign=FOREIGN)
    (finding,) = findings("KA121", judged(store))
    assert finding.severity is Severity.LOW
    assert finding.message.startswith("4 foreign files in the keystore: maps/, .git/, notes")
    assert "git history in .git may hold keys" in finding.message
    assert [place.path for place in finding.locations] == ["maps", ".git", "notes"]
    (finding,) = findings("KA121", judged(store, deployed=True))
    assert finding.severity is Severity.HIGH


@pytest.mark.parametrize(
    ("declared", "left"),
    [
        (DeclaredFiles(foreign=("maps/**",)), [".git", "notes"]),
        (DeclaredFiles(foreign=("maps/*", ".git/**")), ["maps", "notes"]),
        (DeclaredFiles(foreign=("**",)), []),
        (DeclaredFiles(foreign=("note?", "[m]aps/**")), ["maps", ".git"]),
        (DeclaredFiles(accepted=frozenset({file("notes", b"x").sha256 or ""})), ["maps", ".git"]),
        (DeclaredFiles(accepted=frozenset({"0" * 64})), ["maps", ".git", "notes"]),
    ],
)
def test_what_settings_name_is_in_no_finding(declared: DeclaredFiles, left: list[str]) -> None:
    store = replace(healthy(), foreign=FOREIGN, declared=declared)
    told = [place.path for finding in findings("KA121", judged(store)) for place in finding.locations]
    assert told == left


def test_an_authoritys_key_that_lies_outside_is_not_in_the_tree() -> None:
    """KA665: what robots are given here lasts for eighty years."""
    outside = absent("private/ca.key.pem", Status.OUTSIDE, "to a token")
    assert becomes(laid_out(authority_keys=(outside,)), deployed=True) == ["KA665"]
    unreadable = absent("private/ca.key.pem", Status.UNREADABLE, "no permission")
    assert becomes(laid_out(authority_keys=(unreadable,)), deployed=True) == ["KA109", "KA665"]


def test_an_enclave_that_holds_the_authoritys_key_is_always_critical() -> None:
    own = first(KEY, pem("permissionsCA", issuer="permissionsCA")).key
    found = findings("KA109", judged(key_with(key=own)(healthy())))
    assert [(finding.severity, finding.enclave) for finding in found] == [(Severity.CRITICAL, "/talker")]


@pytest.mark.parametrize(
    ("xml", "expected"),
    [(b"<dds/>\n", []), (b"<dds/>\r\n", []), (b"<dds/>", []), (b"<dds/>\n\n", []), (b"<dds />\n", ["KA110"])],
)
def test_line_ends_are_no_difference(xml: bytes, expected: list[str]) -> None:
    assert becomes(talker(unsigned={Role.PERMISSIONS: file(XML, xml)})) == [*expected, "KA122"]


@pytest.mark.parametrize(
    ("path", "well_formed"),
    [("/a/b_1", True), ("/_a", True), ("/1a", False), ("/a//b", False), ("/a%FF", False), ("/" + "a" * 255, False)],
)
def test_enclave_names(path: str, well_formed: bool) -> None:
    anybody = certificates("enclaves/x/cert.pem", pem("/talker"))  # a common name ends at 64 characters
    found = {finding.code for finding in judged(keystore(enclave(path, certificate=anybody))).findings}
    assert ("KA113" not in found) is well_formed


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (KEY, []),
        ("private/ca.key.pem", []),
        ("notes/old.pem", []),
        ("public/ca.pem", ["KA118"]),
        ("enclaves/talker/spare.pem", ["KA118"]),
        ("enclaves/talker/cert.pem", ["KA118"]),
        ("enclaves/governance.p7s", ["KA118"]),
    ],
)
def test_where_a_private_key_may_be(path: str, expected: list[str]) -> None:
    assert becomes(lambda store: replace(store, private_keys=(file(path, None, holds_private_key=True),))) == expected


REFUSED = Usability(usable=Truth.NO, reasons=("it accepts no identity with a key of kind RSA 1024",))


@pytest.mark.parametrize(
    ("reasons", "told"),
    [
        (("the governance does not cover domain 7",), "governance cover"),
        (("the grant allows nothing in domain 7",), "allow rule"),
        (("the governance does not cover domain 7", *REFUSED.reasons), "prime256v1"),
    ],
)
def test_where_it_is_the_domain_no_certificates_are_made_anew(reasons: tuple[str, ...], told: str) -> None:
    """Cyclone DDS and a ROS_DOMAIN_ID that sros2 was not told of: the usual reason of all."""
    uncovered = Usability(usable=Truth.NO, reasons=reasons)
    (found,) = findings("KA117", judged(meaning=meaning(usability={("enclaves/talker", "cyclonedds-11"): uncovered})))
    assert [each for each in ("prime256v1", "governance cover", "allow rule") if each in found.fix.text] == [told]


def test_a_finding_that_is_no_reason_does_not_speak_for_it() -> None:
    """Were it accepted, for what it is, nothing would say that the enclave does not start."""

    usability = {("enclaves/talker", "cyclonedds-11"): REFUSED}
    unruled = keystore(enclave("/talker", governance=governance(domain_rule(enable_join_access_control=False))))
    seen = judged(unruled, meaning=meaning(usability=usability))
    assert [each.severity for each in findings("KA404", seen)] == [Severity.HIGH]
    assert len(findings("KA117", seen)) == 1


@pytest.mark.parametrize(
    ("usability", "change"),
    [
        (Usability(usable=Truth.UNKNOWN, reasons=()), None),
        (Usability(usable=Truth.YES, reasons=()), None),
        (REFUSED, without_permissions(Status.MISSING)),  # said by KA101
    ],
)
def test_the_last_net_catches_nothing_else(usability: Usability, change: Change | None) -> None:
    store = change(healthy()) if change is not None else healthy()
    seen = judged(store, meaning=meaning(usability={("enclaves/talker", "spec"): usability}))
    assert findings("KA117", seen) == ()


@pytest.mark.parametrize(
    ("name", "broken"),
    [
        ("permissions_ca.cert.pem", "KA703"),
        ("identity_ca.cert.pem", "KA702"),
    ],
)
def test_a_file_that_is_not_there_is_why_a_property_is_violated(name: str, broken: str, tmp_path: Path) -> None:
    """What to fix first is the link, not the signature or the identity that nothing is left to judge by."""
    store = built(tmp_path / "k", {"/c": (rule(publish=("rt/a",)),)})
    place = store / "enclaves/c" / name
    place.unlink()
    place.symlink_to("nowhere")
    _code, out = answer("audit", "--engine", "native", "-f", "json", "--at", AT, store)
    found = {finding["code"]: finding for finding in json.loads(out)["findings"]}
    assert found["KA102"]["fingerprint"] in found[broken]["explained_by"]
    _code, out = answer("audit", "--engine", "native", "--at", AT, store)
    assert out.index("KA102") < out.index(broken)


def test_unsigned_documents_weigh_on_robots_alone() -> None:
    store = laid_out(unsigned_governance=file("enclaves/governance.xml", b"<dds/>\n"))(healthy())
    (here,), (there,) = (findings("KA122", judged(store, deployed=robot)) for robot in (False, True))
    assert (here.severity, there.severity) == (Severity.INFO, Severity.LOW)
    assert there.message == (
        "1 unsigned document in a tree that goes on a robot: enclaves/governance.xml. No run time reads .xml."
    )


@pytest.mark.parametrize("path", ["notes/old.txt", "private/old.pem"])
def test_no_other_private_key_goes_on_a_robot(path: str) -> None:
    def left(store: Keystore) -> Keystore:
        return replace(store, private_keys=(file(path, None, holds_private_key=True),))

    assert becomes(left, deployed=True) == ["KA118", "KA665"]


def test_the_key_of_an_authority_is_told_once() -> None:
    key = file("private/ca.key.pem", None, holds_private_key=True)

    def left(store: Keystore) -> Keystore:
        return replace(store, private_keys=(key,), layout=replace(store.layout, authority_keys=(key,)))

    assert becomes(left, deployed=True) == ["KA109", "KA665"]


@pytest.mark.parametrize(
    ("domain", "reasons"),
    [
        (0, ()),
        (7, ("the grant allows nothing in domain 7",)),  # it allows domain 0, which the governance covers
        (9, ("the governance does not cover domain 9",)),
    ],
)
def test_what_keeps_it_from_a_domain_is_said_of_that_domain(domain: int, reasons: tuple[str, ...]) -> None:
    store = keystore(enclave("/talker", governance=governance(domain_rule(domains=((0, 0), (7, 7))))))
    usabilities = Usabilities(domain, views(store))
    for name in ("spec", "cyclonedds-0.10", "cyclonedds-11"):
        assert usabilities.of(store.enclaves[0], NOW, VARIANTS[name]).reasons == reasons, name


def test_without_modes_nothing_is_said_of_them() -> None:
    assert becomes(key_with(file=file(KEY, None, mode=None))) == []
