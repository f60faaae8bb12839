"""By fingerprint and meaning a finding is accepted: what is worse at the same place has others."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from keystore_audit.keystore.keystore import Keystore
from tests.rules.evidence import (
    Change,
    allow,
    both,
    certificates,
    domain_rule,
    file,
    findings,
    governance,
    grant,
    healthy,
    judged,
    pem,
    permissions,
    talker,
    topic_rule,
)
from tests.rules.test_provisioning_rules import Fleet, kept, report

OPEN = topic_rule("rt/open*", enable_write_access_control=False)
CLOSED = topic_rule("rt/openmotor")


def prints(code: str, change: Change) -> tuple[str, ...]:
    return tuple(f"{each.fingerprint} {each.meaning}" for each in findings(code, judged(change(healthy()))))


def test_a_topic_rule_decides_about_more_without_those_before_it() -> None:
    guarded = prints("KA406", both(governance=governance(domain_rule(CLOSED, OPEN, topic_rule("*")))))
    alone = prints("KA406", both(governance=governance(domain_rule(OPEN, topic_rule("*")))))
    later = prints("KA406", both(governance=governance(domain_rule(CLOSED, OPEN, CLOSED, topic_rule("*")))))
    assert len(guarded) == len(alone) == 1
    assert guarded != alone
    assert guarded != later, "it is about the document as a whole"
    assert guarded[0].split()[0] == later[0].split()[0]


def test_a_domain_rule_decides_about_more_without_those_before_it() -> None:
    loose = domain_rule(domains=((0, 10),), enable_join_access_control=False)
    strict = domain_rule(domains=((5, 5),))
    assert prints("KA404", both(governance=governance(strict, loose))) != prints(
        "KA404", both(governance=governance(loose))
    )


def test_another_key_in_the_same_file() -> None:
    def holding(sha256: str) -> Change:
        def change(store: Keystore) -> Keystore:
            found = file("public/identity_ca.cert.pem", None, holds_private_key=True, sha256=sha256)
            return replace(store, private_keys=(found,))

        return change

    assert prints("KA118", holding("a" * 64)) == prints("KA118", holding("a" * 64))
    assert prints("KA118", holding("a" * 64)) != prints("KA118", holding("b" * 64))


def test_another_certificate_behind_the_first() -> None:
    def beside(name: str) -> Change:
        path = "enclaves/talker/cert.pem"
        return talker(certificate=certificates(path, pem("/talker"), pem(name)))

    assert prints("KA202", beside("/one")) == prints("KA202", beside("/one"))
    assert prints("KA202", beside("/one")) != prints("KA202", beside("/other"))


def test_more_rights_for_somebody_else() -> None:
    def granting(topic: str) -> Change:
        ghost = grant("/ghost", allow(publish=[topic]))
        return talker(permissions=permissions("enclaves/talker/permissions.p7s", grant("/talker"), ghost))

    assert prints("KA512", granting("rt/z")) == prints("KA512", granting("rt/z"))
    assert prints("KA512", granting("rt/z")) != prints("KA512", granting("*"))


def test_another_document_outside_the_enclaves(tmp_path: Path) -> None:
    """Replaced by one that gives more, and joined by one."""
    fleet = Fleet()
    found = []
    for name, documents in (
        ("known", [("old", "rt/z")]),
        ("replaced", [("old", "*")]),
        ("joined", [("old", "rt/z"), ("zz/new", "*")]),
    ):
        root = fleet.robot(tmp_path / name, "/talker")
        for place, topic in documents:
            kept(f"{place}.p7s", "rt/chatter", topic)(fleet, root)
        found += [(each.fingerprint, each.meaning) for each in report(root).findings if each.code == "KA660"]
    assert len(set(found)) == len(found) == 3
