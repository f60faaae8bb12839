"""What one thing that could not be read makes unknown: what rests on it, and nothing else.

Each keystore has two enclaves, and the talker's own files were read.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509

from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.properties.result import Status
from tests.cli.keystores import AT as SAID
from tests.cli.keystores import answer, keystore
from tests.keystore import documents
from tests.keystore.builder import (
    GOVERNANCE,
    PERMISSIONS,
    Extension,
    authority,
    certificate,
    name,
    sros2,
    write_enclave,
)
from tests.oracles.vendors.recipes_expressions import MANY_LONG
from tests.rules.evidence import AT

ENCLAVES = ("/talker", "/listener")
CHAIN = "identities-chain-to-the-identity-ca"
OF_TRUST = {CHAIN, "one-ca-for-one-role", "no-enclave-grants-itself-rights"}
OF_WHO_TAKES_PART = {
    "no-identity-serves-two-enclaves",
    "no-enclave-grants-itself-rights",
    "no-subject-serves-two-enclaves",
    "nobody-writes-without-a-grant",
    "nobody-reads-without-a-grant",
    "readers-cannot-forge",
}


def unknown(store: Path) -> set[str]:
    """The properties that are; no other is violated, since nothing else is wrong."""
    report = audit(store, Options(at=AT, engine="native"))
    found = {result.prop.id: {each.status for each in result.profiles.values()} for result in report.properties}
    assert len(found) == 18
    assert report.exit_code == (4 if any(each.undecided for each in report.findings) else 0)
    assert not any(Status.VIOLATED in statuses for statuses in found.values())
    return {prop for prop, statuses in found.items() if Status.UNKNOWN in statuses}


def can(store: Path, enclave: str, topic: str) -> int:
    """The exit code of what it may publish: 0 allowed, 1 denied, 4 unknown; the same with its peers."""
    asked = ("can", store, enclave, "publish", topic, "--at", SAID)
    code, effective = (answer(*asked, *more)[0] for more in ((), ("--effective",)))
    return code if code == effective else 4


def away(path: str) -> Callable[[Path], Path]:
    """A keystore of which one file is a link that leaves it."""

    def built(root: Path) -> Path:
        store = sros2(root / "k", ENCLAVES, split=True)
        (store / path).unlink(missing_ok=True)
        os.symlink("/etc/hosts", store / path)
        return store

    return built


def test_with_nothing_unread_nothing_is_unknown(tmp_path: Path) -> None:
    store = sros2(tmp_path / "k", ENCLAVES, split=True)
    assert unknown(store) == set()
    assert [can(store, each, topic) for each in ENCLAVES for topic in ("/chatter", "/map")] == [0, 1, 0, 1]


def test_a_private_key_makes_unknown_who_starts(tmp_path: Path) -> None:
    store = away("enclaves/listener/key.pem")(tmp_path)
    assert unknown(store) == set()
    assert [can(store, each, "/chatter") for each in ENCLAVES] == [0, 4]


def test_a_governance_makes_unknown_what_its_enclave_accepts_and_not_whom_it_believes(tmp_path: Path) -> None:
    """Its CA files were read: no governance document says whose certificates and signatures count (9.3, 9.4)."""
    left = unknown(away("enclaves/listener/governance.p7s")(tmp_path))
    assert left.isdisjoint(OF_TRUST)
    assert {"outsiders-cannot-read", "grants-are-enforced", "nobody-writes-without-a-grant"} <= left
    wider = unknown(away("enclaves/listener/permissions_ca.cert.pem")(tmp_path / "wider"))
    assert wider >= left | OF_TRUST


def test_a_file_of_no_enclave_may_hold_an_identity_and_is_no_enclaves_own(tmp_path: Path) -> None:
    """Whoever has the key in it takes part. What enclaves have for identities was read, and stays decided."""
    store = away("notes.txt")(tmp_path)
    assert unknown(store) == OF_WHO_TAKES_PART
    assert [can(store, each, topic) for each in ENCLAVES for topic in ("/chatter", "/map")] == [0, 1, 0, 1]
    assert unknown(away("enclaves/listener/cert.pem")(tmp_path / "own")) == OF_WHO_TAKES_PART | {CHAIN}


def constrained(place: str, extension: x509.ExtensionType) -> Callable[[Path], Path]:
    """A keystore with the extension in one of its authorities, or in the listener's identity."""
    extensions: dict[str, list[Extension]] = {"identity": [], "permissions": [], "leaf": []}
    extensions[place].append((extension, True))

    def built(root: Path) -> Path:
        identity = authority("identityCA", extensions=extensions["identity"])
        permissions = authority("permissionsCA", extensions=extensions["permissions"])
        for each in ENCLAVES:
            own = certificate(each, identity, extensions=extensions["leaf"] if each == "/listener" else ())
            document = PERMISSIONS.format(name=each).encode()
            write_enclave(root / "k/enclaves" / each[1:], own, document, identity, permissions, GOVERNANCE)
        return root / "k"

    return built


NAMES = x509.NameConstraints([x509.DirectoryName(name("/talker"))], None)
PROXY = x509.UnrecognizedExtension(
    x509.ObjectIdentifier("1.3.6.1.5.5.7.1.14"), bytes.fromhex("300c300a06082b06010505071501")
)
"""proxyCertInfo: whoever honours it lets an identity issue others, and so takes more."""


@pytest.mark.parametrize(
    ("place", "left", "listener"),
    [("permissions", set(), 4), ("identity", {CHAIN}, 4), ("leaf", {CHAIN}, 4)],
)
def test_what_narrows_makes_unknown_who_is_let_in(place: str, left: set[str], listener: int, tmp_path: Path) -> None:
    """Without the constraint the same peers, at most, are let in, and with the same rights: that is denied stays so."""
    store = constrained(place, NAMES)(tmp_path)
    assert unknown(store) == left
    assert can(store, "/listener", "/chatter") == listener
    assert answer("can", store, "/listener", "publish", "/map", "--at", SAID, "--effective")[0] == 1
    assert can(store, "/talker", "/chatter") == (0 if place == "leaf" else 4)


def test_what_may_widen_makes_unknown_who_takes_part(tmp_path: Path) -> None:
    assert unknown(constrained("leaf", PROXY)(tmp_path)) == OF_WHO_TAKES_PART | {CHAIN}


def test_what_narrows_is_violated_for_certain_where_it_cannot_matter(tmp_path: Path) -> None:
    """Two enclaves of one key have it whoever vouches for them, and nobody joins who is not vouched for."""
    store = constrained("leaf", NAMES)(tmp_path)
    for file in ("cert.pem", "key.pem"):
        (store / "enclaves/talker" / file).write_bytes((store / "enclaves/listener" / file).read_bytes())
    report = audit(store, Options(at=AT, engine="native", profiles=("spec",)))
    statuses = {each.prop.id: each.status for each in report.properties}
    assert statuses["no-identity-serves-two-enclaves"] is Status.VIOLATED
    assert statuses[CHAIN] is Status.UNKNOWN


SAYS_CHATTER = documents.rule(documents.pub("rt/chatter"))


@pytest.mark.parametrize("which", ["topics", "partitions"])
def test_permissions_beyond_the_classes_of_names_count_as_unread(which: str, tmp_path: Path) -> None:
    """The talker's alone, in whose rights 24 texts stand between stars; all that rests on others is decided."""
    topics, partitions = (MANY_LONG, ()) if which == "topics" else (("rt/a",), MANY_LONG)
    rules = {"/talker": documents.rule(documents.pub(*topics, partitions=partitions)), "/listener": SAYS_CHATTER}
    store = keystore(tmp_path / "k", {path: (rule,) for path, rule in rules.items()})
    report = audit(store, Options(at=AT, engine="native"))
    found = [each for each in report.findings if each.undecided and each.enclave is not None]
    assert [(each.code, each.enclave, each.locations[0].path) for each in found] == [
        ("KA901", "/talker", "enclaves/talker/permissions.p7s")
    ]
    assert {
        prop.prop.id for prop in report.properties if Status.UNKNOWN in {a.status for a in prop.profiles.values()}
    } == (OF_WHO_TAKES_PART - {"no-identity-serves-two-enclaves"} | {"documents-signed-by-the-permissions-ca"})
    flows = [answer("flow", store, *each, "--at", SAID, "--engine", "native")[0] for each in (ENCLAVES, ENCLAVES[::-1])]
    assert flows == [4, 4]


def test_a_governance_beyond_the_classes_counts_as_unread(tmp_path: Path) -> None:
    """Of whatever enclave, what protects a topic rests on it; whose certificates and signatures count does not."""
    rules = documents.domain_rule(*map(documents.topic_rule, (*MANY_LONG, "*")))
    governance = documents.governance(rules).encode()
    store = keystore(tmp_path / "k", {"/talker": (SAYS_CHATTER,), "/listener": ()}, governance=governance)
    left = unknown(store)
    assert left.isdisjoint(OF_TRUST | {"no-identity-serves-two-enclaves"})
    assert {"outsiders-cannot-read", "grants-are-enforced", "nobody-writes-without-a-grant"} <= left
    assert answer("can", store, "/talker", "publish", "/chatter", "--at", SAID)[0] == 0


@pytest.mark.parametrize("subject", ["/talker", "/listener", "/talker/arm"])
def test_openssl_takes_no_more_paths_for_a_constraint(
    subject: str, tmp_path: Path, oracle: Callable[[str], str]
) -> None:
    """Both vendors verify identities with OpenSSL: what it takes with the extension it takes without it."""
    taken = []
    for number, extensions in enumerate(([(NAMES, True)], [])):
        issuer = authority("identityCA", extensions=extensions)
        for file, signed in (("ca", issuer), ("leaf", certificate(subject, issuer))):
            (tmp_path / f"{file}{number}.pem").write_bytes(signed.pem)
        files = ("-CAfile", f"ca{number}.pem", f"leaf{number}.pem")
        done = subprocess.run(
            [oracle("openssl"), "verify", "-no_check_time", *files], cwd=tmp_path, capture_output=True
        )
        taken.append(done.returncode == 0)
    assert taken == [subject == "/talker", True]
