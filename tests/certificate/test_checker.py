"""The checker by itself: a certificate written by hand, and stores of which one change flips the verdict."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.certificate.checking import AMBIENT, Checker, Encrypted, Given, NoFlow, OnlyPublish, Property
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.certificate.powers import OUTSIDER
from keystore_audit.model.names import AMBIENT as LEFT_OUT
from keystore_audit.profiles import DEFAULT, VARIANTS
from keystore_audit.properties.result import Status
from keystore_audit.prove import answered
from tests.certificate.asking import AT, reading, verdict
from tests.keystore.builder import Signed, authority, certificate, enclave, signed_document, write
from tests.keystore.documents import allow, deny, domain_rule, governance, grant, permissions, pub, sub, topic_rule

IDENTITY, RIGHTS, OTHER = (authority(name) for name in ("identity", "rights", "other"))
OWN = {path: certificate(path, IDENTITY) for path in ("/a", "/b", "/c")}
QUIET = governance(domain_rule(rtps="ENCRYPT"))
A_WRITES = grant("/a", allow(pub("rt/x")))
B_READS = grant("/b", allow(sub("rt/y")))
C_READS = grant("/c", allow(sub("rt/x")))
NO_FLOW = NoFlow("/a", "/b")
SPEC = Given(("spec",), AT)


def store(
    root: Path,
    rules: str = QUIET,
    *,
    a: str = A_WRITES,
    b: str = B_READS,
    c: str = C_READS,
    ca: Signed = RIGHTS,
    signers: dict[str, Signed] | None = None,
    identities: dict[str, tuple[Signed, Signed]] | None = None,
    more: dict[str, bytes | str] | None = None,
) -> Path:
    """Three enclaves, of which /a writes, and /c reads it, and /b does not."""
    for path, own in (("/a", a), ("/b", b), ("/c", c)):
        document = signed_document(permissions(own).encode(), (signers or {}).get(path, ca))
        signed = signed_document(rules.encode(), ca)
        identity, issuer = (identities or {}).get(path, (OWN[path], IDENTITY))
        write(root / "enclaves" / path[1:], enclave(identity, issuer.pem, ca.pem, signed, document))
    return write(root, more or {})


def accepted(root: Path, inside: set[str], asked: Property = NO_FLOW, given: Given = SPEC) -> bool:
    """Whether there is a certificate with these participants. Raises CannotTell."""
    checker = Checker(root, asked, given)
    (profile,) = given.profiles
    try:
        made = checker.implementation(profile).compartment(inside)
        checker.implementation(profile).check(made)
    except Refused:
        return False
    return True


def test_the_checker_shares_no_code_with_what_decides() -> None:
    program = "import sys, keystore_audit.certificate.checking; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    own = {name for name in done.stdout.split() if name.startswith("keystore_audit.")}
    assert {name for name in own if not name.startswith("keystore_audit.certificate")} == set()
    assert "cryptography" not in done.stdout.split()


def test_the_lists_that_it_has_for_itself_are_those_of_the_house() -> None:
    assert sorted(AMBIENT) == sorted(LEFT_OUT)
    checked = [name for name in VARIANTS if _known(name)]
    assert [name for name in VARIANTS if name not in checked] == ["opendds"]
    assert {*DEFAULT} <= {*checked}


def _known(name: str) -> bool:
    from keystore_audit.certificate.kinds import row

    try:
        row(name)
    except CannotTell:
        return False
    return True


def by_hand(root: Path) -> dict[str, Any]:
    """Only the source is inside, and nothing else: the outsider gets nothing, /c reads rt/x and is inside too."""
    digests = Checker(root, NO_FLOW, SPEC).store.digests
    law, mine, its = (f"enclaves/{path}.p7s" for path in ("a/governance", "a/permissions", "c/permissions"))
    beside = "enclaves/b/permissions.p7s"

    def line(document: str, tag: str) -> int:
        lines = (root / document).read_bytes().splitlines()
        return next(number for number, text in enumerate(lines, 1) if tag.encode() in text)

    def because(rule: str, document: str, tag: str) -> dict[str, Any]:
        return {"rule": rule, "document": document, "line": line(document, tag)}

    protection = [because("protection", law, tag) for tag in ("<domain_rule", "<topic_rule")]
    nothing = because("ungoverned", law, "domain_rule")
    by_default = {path: because("default", path, "<grant") for path in (mine, its, beside)}
    refused = []
    names = [{"way": way, "peers": "/a", "domain": 0, "topic": "rt/x"} for way in ("taken", "overheard")]
    for topic in ("/", "rt/x", "rt/y"):
        place = {"peers": "/a", "domain": 0, "topic": topic}
        if topic == "rt/x":
            refused.append({"participant": "/b", **place, "because": [*protection, by_default[beside]]})
            refused.append({"participant": "outsider", **place, "because": protection})
        else:
            refused += [
                {"participant": who, **place, "because": [*protection, by_default[document]]}
                for who, document in (("/a", mine), ("/c", its))
            ]
    refused.append({"participant": "*", "peers": "/a", "domain": 1, "topic": "*", "because": [{**nothing, "line": 1}]})
    compartment = {"profiles": ["spec"], "participants": ["/a", "/c"], "names": names, "refused": refused}
    asked = {"from": "/a", "to": "/b", "attacker": "relays", "through": [], "include_ambient": False}
    return {
        "property": {"kind": "no-flow", **asked},
        "documents": {path: digests[path] for path in sorted((law, mine, its, beside))},
        "compartments": [compartment],
        "schema_version": 1,
    }


def test_a_certificate_written_by_hand_is_accepted(tmp_path: Path) -> None:
    root = store(tmp_path)
    checker = Checker(root, NO_FLOW, SPEC)
    content = json.dumps(by_hand(root), indent=1).encode() + b"\n"
    checker.check(content)
    assert verdict(content.replace(b'"line": 1\n', b'"line": 2\n'), checker) == "refused"
    assert verdict(content, Checker(root, NoFlow("/c", "/b"), SPEC)) == "refused"
    assert verdict(content, Checker(root, NO_FLOW, Given(("spec", "cyclonedds-11"), AT))) == "refused"
    with pytest.raises(Refused):
        Checker(root, NO_FLOW, Given(("spec",), AT, identity_cas=frozenset({OTHER.der.hex()})))


FLIPS: list[tuple[str, dict[str, Any], str, bool]] = [
    ("it reads what is written", {"b": grant("/b", allow(sub("rt/*")))}, "spec", False),
    ("a deny rule stands first", {"b": grant("/b", deny(sub("rt/x")), allow(sub("rt/*")))}, "spec", True),
    ("a deny rule stands behind", {"b": grant("/b", allow(sub("rt/*")), deny(sub("rt/x")))}, "spec", False),
    ("the default allows", {"b": grant("/b", default="ALLOW")}, "spec", False),
    ("nobody looks at the default", {"b": grant("/b", default="ALLOW")}, "fastdds-3.6", True),
    (
        "a denial is void in a partition that is a pattern",
        {"b": grant("/b", deny(sub("*")), default="ALLOW")},
        "cyclonedds-11",
        False,
    ),
    ("a denial without partitions is for all", {"b": grant("/b", deny(sub("*")), default="ALLOW")}, "spec", True),
    ("rules of another domain", {"b": grant("/b", allow(sub("rt/x"), domains="<id>5</id>"))}, "spec", True),
    (
        "own endpoints by rules of another domain",
        {"b": grant("/b", allow(sub("rt/x"), domains="<id>5</id>"))},
        "fastdds-3.6",
        False,
    ),
    ("the grant is over", {"b": grant("/b", allow(sub("rt/x")), end="2026-01-01T00:00:00")}, "spec", True),
    (
        "the first is over, and is skipped",
        {"b": grant("/b", end="2026-01-01T00:00:00") + grant("/b", allow(sub("rt/x")))},
        "spec",
        False,
    ),
    (
        "the first is over, and decides",
        {"b": grant("/b", end="2026-01-01T00:00:00") + grant("/b", allow(sub("rt/x")))},
        "cyclonedds-11",
        True,
    ),
    ("a grant in another's document", {"c": C_READS + grant("/b", allow(sub("rt/x")))}, "spec", False),
    ("a longer name", {"c": C_READS + grant("/b/d", allow(sub("rt/x")))}, "spec", True),
    (
        "a longer name to those that look for pieces",
        {"c": C_READS + grant("/b/d", allow(sub("rt/x")))},
        "cyclonedds-11",
        False,
    ),
    ("signed by somebody else", {"b": grant("/b", allow(sub("rt/x"))), "signers": {"/b": IDENTITY}}, "spec", True),
    ("one CA for both", {"ca": IDENTITY}, "spec", True),
    ("one CA for both, and any signer below it", {"ca": IDENTITY}, "cyclonedds-0.10", False),
    ("everybody may read", {"rules": governance(domain_rule(topic_rule(read=False), join=False))}, "spec", False),
    (
        "nothing is encrypted",
        {"rules": governance(domain_rule(topic_rule(metadata="SIGN", data="SIGN")))},
        "spec",
        False,
    ),
]


@pytest.mark.parametrize(("changed", "profile", "holds"), [each[1:] for each in FLIPS], ids=[each[0] for each in FLIPS])
def test_one_change_flips_it(tmp_path: Path, changed: dict[str, Any], profile: str, holds: bool) -> None:
    inside = {"/a", "/c", OUTSIDER} if changed.get("rules") else {"/a", "/c"}
    assert accepted(store(tmp_path, **changed), inside, given=Given((profile,), AT)) is holds


def test_what_is_in_clear_gets_to_the_outsider(tmp_path: Path) -> None:
    clear = store(tmp_path / "clear", governance(domain_rule(topic_rule(metadata="SIGN", data="SIGN"))))
    to_outsider = NoFlow("/a", "outsider")
    assert not accepted(clear, {"/a", "/c"}, to_outsider)
    assert accepted(store(tmp_path / "hidden"), {"/a", "/c"}, to_outsider)


def test_whoever_reads_forges_unless_the_origin_is_authenticated(tmp_path: Path) -> None:
    asked = NoFlow("/c", "topic:/x", "relays")
    assert not accepted(store(tmp_path / "forged"), {"/c"}, asked)
    origin = governance(domain_rule(topic_rule(metadata="ENCRYPT_WITH_ORIGIN_AUTHENTICATION"), rtps="ENCRYPT"))
    assert accepted(store(tmp_path / "origin", origin), {"/c"}, asked)
    assert accepted(store(tmp_path / "honest"), {"/c"}, NoFlow("/c", "topic:/x", "honest"))


def test_who_relays_by_its_default_reads_and_makes_what_is_not_protected_by_itself(tmp_path: Path) -> None:
    asked = NoFlow("/b", "topic:/x")
    for number, (rules, holds) in enumerate(((QUIET, True), (UNSEALED, False))):
        root = store(tmp_path / str(number), rules, b=RELAYING)
        assert accepted(root, {"/a", "/c"}) is holds
        assert accepted(root, {"/b"}, asked) is holds


def test_endpoints_that_are_not_announced_truthfully(tmp_path: Path) -> None:
    root = store(tmp_path)
    for profile, without, holds in (("cyclonedds-11", (), True), ("cyclonedds-11", ("truthful-announcements",), False)):
        assert accepted(root, {"/a", "/c"}, given=Given((profile,), AT, without)) is holds
    assert accepted(root, {"/a", "/c"}, given=Given(("fastdds-3.6",), AT, ("truthful-announcements",)))


A_ALONE, ENCLAVES = OnlyPublish("/x", ("/a",)), OnlyPublish("/x", ("/*",))
STRANGER = grant("/stranger", allow(pub("rt/x")))
CLEAR = topic_rule(metadata="NONE", data="NONE")
INSIDERS, OUTSIDERS = Encrypted("/x", "insider"), Encrypted("/x", "outsider")
RELAYING = grant("/b", deny(pub("*"), sub("*")), default="ALLOW")
UNSEALED = governance(domain_rule(topic_rule(data="NONE"), rtps="ENCRYPT"))
C_OF_RIGHTS = certificate("/c", RIGHTS)
SIGNED_BY_C = {
    "b": grant("/b", allow(sub("rt/x"))),
    "identities": {"/c": (C_OF_RIGHTS, RIGHTS)},
    "signers": {"/b": C_OF_RIGHTS},
}
UNREAD = topic_rule(metadata="SIGN", data="SIGN")

RIGHTS_OF: list[tuple[str, Property, dict[str, Any], str, str]] = [
    ("another may not", A_ALONE, {}, "spec", ""),
    ("another may", A_ALONE, {"b": grant("/b", allow(pub("rt/*")))}, "spec", "/b"),
    ("a deny rule stands first", A_ALONE, {"b": grant("/b", deny(pub("rt/x")), allow(pub("rt/*")))}, "spec", ""),
    (
        "another may in its domain",
        A_ALONE,
        {"b": grant("/b", allow(pub("rt/x"), domains="<id_range><min>0</min><max>9</max></id_range>"))},
        "spec",
        "/b",
    ),
    ("who reads forges, and may not publish", A_ALONE, {"b": grant("/b", allow(sub("rt/x")))}, "spec", ""),
    ("somebody who is not here", ENCLAVES, {"c": C_READS + STRANGER}, "spec", "CN=/stranger"),
    ("somebody who is not here may not", ENCLAVES, {"c": C_READS + grant("/stranger", allow(pub("rt/y")))}, "spec", ""),
    ("whose certificate peers refuse", A_ALONE, {"identities": {"/a": (certificate("/a", OTHER), OTHER)}}, "spec", ""),
    (
        "of another too",
        A_ALONE,
        {"identities": {"/b": (certificate("/b", OTHER), OTHER)}, "b": grant("/b", allow(pub("rt/x")))},
        "spec",
        "CN=/b",
    ),
    ("anybody certified joins", ENCLAVES, {"rules": governance(domain_rule(join=False))}, "spec", ""),
    (
        "anybody certified joins and writes",
        ENCLAVES,
        {"rules": governance(domain_rule(topic_rule(write=False), join=False))},
        "spec",
        "anybody certified",
    ),
    (
        "anybody certified, whatever grants it has",
        ENCLAVES,
        {"rules": governance(domain_rule(topic_rule(write=False), join=False))},
        "fastdds-3.6",
        "anybody certified",
    ),
    ("members alone write", ENCLAVES, {"rules": governance(domain_rule(topic_rule(write=False)))}, "spec", ""),
    ("one CA for both", ENCLAVES, {"ca": IDENTITY}, "spec", ""),
    ("one CA for both, any signer below", ENCLAVES, {"ca": IDENTITY}, "cyclonedds-0.10", "anybody certified"),
    (
        "the unauthenticated",
        ENCLAVES,
        {"rules": governance(domain_rule(CLEAR, unauthenticated=True, rtps="NONE"))},
        "spec",
        "outsider",
    ),
    (
        "who forges without joining does not publish",
        ENCLAVES,
        {"rules": governance(domain_rule(CLEAR, rtps="NONE"))},
        "spec",
        "",
    ),
    ("nobody without a grant reads", INSIDERS, {}, "spec", ""),
    ("who relays does not read the payload", INSIDERS, {"b": RELAYING}, "spec", ""),
    ("who relays reads it in clear", INSIDERS, {"b": RELAYING, "rules": UNSEALED}, "spec", "/b"),
    ("nobody relays by the default", INSIDERS, {"b": RELAYING, "rules": UNSEALED}, "fastdds-3.6", ""),
    ("who has one may", INSIDERS, {"b": grant("/b", allow(sub("rt/x")))}, "spec", ""),
    ("who has one may in the others too", INSIDERS, {"b": grant("/b", default="ALLOW")}, "spec", ""),
    (
        "nobody asks in partitions of which no grant is",
        Encrypted("/x", "insider"),
        {
            "rules": governance(domain_rule(topic_rule(read=False))),
            **{each: grant(f"/{each}", allow(pub("rt/x"), sub("rt/x"))) for each in "abc"},
        },
        "spec",
        "/a",
    ),
    ("a right that another enclave signed", INSIDERS, SIGNED_BY_C, "cyclonedds-0.10", "/b"),
    ("a right that another enclave signed in vain", INSIDERS, SIGNED_BY_C, "spec", ""),
    ("a right that is taken away again", INSIDERS, {"b": RELAYING, "rules": UNSEALED}, "cyclonedds-11", "/b"),
    ("nobody asks for grants", INSIDERS, {"rules": governance(domain_rule(topic_rule(read=False)))}, "spec", "/a"),
    (
        "whole messages alone are encrypted",
        INSIDERS,
        {"rules": governance(domain_rule(UNREAD, rtps="ENCRYPT"))},
        "spec",
        "/a",
    ),
    (
        "those outside do not read them",
        OUTSIDERS,
        {"rules": governance(domain_rule(UNREAD, rtps="ENCRYPT"))},
        "spec",
        "",
    ),
    ("nothing is encrypted", OUTSIDERS, {"rules": governance(domain_rule(UNREAD, rtps="SIGN"))}, "spec", "outsider"),
]
"""Who else can, nobody where it holds."""


@pytest.mark.parametrize(
    ("asked", "changed", "profile", "who"), [each[1:] for each in RIGHTS_OF], ids=[each[0] for each in RIGHTS_OF]
)
def test_one_change_of_rights_flips_it(
    tmp_path: Path, asked: Property, changed: dict[str, Any], profile: str, who: str
) -> None:
    root, given = store(tmp_path, **changed), Given((profile,), AT)
    implementation = Checker(root, asked, given).implementation(profile)
    if who:
        with pytest.raises(Refused, match=f"^nothing refuses that {who} "):
            implementation.compartment(implementation.source)
    else:
        assert accepted(root, {*implementation.source}, asked, given)
    assert not accepted(root, {*implementation.source, OUTSIDER}, asked, given)
    assert (answered(root, asked, reading((profile,))).status is Status.HOLDS) is not bool(who)


def test_nobody_publishes_where_announcements_are_not_truthful(tmp_path: Path) -> None:
    root, given = store(tmp_path), Given(("cyclonedds-11",), AT)
    for asked, inside in ((A_ALONE, {"/a"}), (INSIDERS, set[str]())):
        assert accepted(root, inside, asked, given)
        assert not accepted(root, inside, asked, replace(given, not_assumed=("truthful-announcements",)))


def test_each_of_them_has_its_lines(tmp_path: Path) -> None:
    root = store(tmp_path, c=C_READS + STRANGER, b=grant("/b", deny(pub("rt/x"))))
    asked = OnlyPublish("/x", ("/a", "/c"))
    with pytest.raises(Refused, match="CN=/stranger"):
        Checker(root, asked, SPEC).implementation("spec").compartment({"/a", "/c"})
    root = store(tmp_path / "other", c=C_READS + grant("/stranger", deny(pub("rt/x"))))
    [compartment] = [Checker(root, asked, SPEC).implementation("spec").compartment({"/a", "/c"})]
    assert not compartment.names
    lines = {
        each.participant: [(because.rule, because.document) for because in each.because][2:]
        for each in compartment.refused
        if each.domain == 0
    }
    assert lines == {
        "/b": [("default", "enclaves/b/permissions.p7s")],
        "outsider": [],
        "anybody certified": [("no grant", "enclaves/a/governance.p7s")],
        "CN=/stranger": [("rule", "enclaves/c/permissions.p7s")],
    }


BEYOND: list[tuple[str, Callable[[Path], Path]]] = [
    ("a file that nobody knows", lambda root: store(root, more={"notes.txt": b"x"})),
    ("a revocation list", lambda root: store(root, more={"enclaves/a/crl.pem": b"x"})),
    ("PKCS#11", lambda root: store(root, more={"enclaves/a/key.p11": b"pkcs11:x"})),
    ("a link out of it", lambda root: store(root, more={"public/ca.cert.pem": "/etc/passwd"})),
    ("an authority that nobody trusts", lambda root: store(root, more={"public/ca.cert.pem": OTHER.pem})),
    ("two certificates in a file", lambda root: store(root, more={"public/ca.cert.pem": RIGHTS.pem + OTHER.pem})),
    ("a key of nobody", lambda root: store(root, more={"private/ca.key.pem": OTHER.key_pem})),
    ("a document inside the XML", lambda root: store(root, more={"enclaves/governance.xml": b"<a>-----BEGIN</a>"})),
    ("a signer that is not here", lambda root: store(root, signers={"/c": OTHER})),
    ("an authority called like an enclave", lambda root: store(root, ca=authority("/a"))),
    ("brackets", lambda root: store(root, c=grant("/c", allow(sub("rt/[x]"))))),
    ("partitions", lambda root: store(root, c=grant("/c", allow(sub("rt/x", partitions=["p"]))))),
    ("a comment", lambda root: store(root, c=grant("/c", allow(sub("rt/x")) + "<!-- -->"))),
    ("a zone", lambda root: store(root, c=grant("/c", allow(sub("rt/x")), end="2034-01-01T00:00:00+02:00"))),
    ("an end within a day", lambda root: store(root, c=grant("/c", allow(sub("rt/x")), end="2026-11-21T20:00:00"))),
    ("another subject", lambda root: store(root, c=grant("/c", allow(sub("rt/x")), subject="CN=/c,O=o"))),
    (
        "an open range",
        lambda root: store(root, c=grant("/c", allow(sub("rt/x"), domains="<id_range><min>1</min></id_range>"))),
    ),
    ("a flag as a number", lambda root: store(root, governance(domain_rule(topic_rule(read="1"))))),
]


@pytest.mark.parametrize("build", [each[1] for each in BEYOND], ids=[each[0] for each in BEYOND])
def test_what_it_does_not_understand_it_cannot_tell(tmp_path: Path, build: Callable[[Path], Path]) -> None:
    with pytest.raises(CannotTell):
        accepted(build(tmp_path), {"/a", "/c"})


@pytest.mark.parametrize("profile", ["spec", "fastdds-3.6"])
def test_a_question_mark_is_a_character_or_an_octet(tmp_path: Path, profile: str) -> None:
    root = store(tmp_path, c=grant("/c", allow(sub("rt/x?"))))
    if profile == "spec":
        assert accepted(root, {"/a", "/c"})
    else:
        with pytest.raises(CannotTell):
            accepted(root, {"/a", "/c"}, given=Given((profile,), AT))


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        (NoFlow("/nobody", "/a"), SPEC),
        (NoFlow("/*", "/b"), SPEC),
        (NoFlow("topic:/x", "topic:/*"), SPEC),
        (NoFlow("/a", "topic:x"), SPEC),
        (NoFlow("/a", "/c", "insider"), SPEC),
        (OnlyPublish("x", ("/a",)), SPEC),
        (OnlyPublish("/x", ("/nobody",)), SPEC),
        (OnlyPublish("/x", ("outsider",)), SPEC),
        (NO_FLOW, Given(("opendds",), AT)),
        (NO_FLOW, Given(("spec",), AT, ("robots-enforce",))),
    ],
)
def test_questions_that_it_does_not_understand(tmp_path: Path, asked: Property, given: Given) -> None:
    with pytest.raises(CannotTell):
        accepted(store(tmp_path), {"/a", "/c"}, asked, given)
