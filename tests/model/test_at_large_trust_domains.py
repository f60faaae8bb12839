"""Whoever has an identity at large need use no revocation list, and may use any governance that lies there."""

from __future__ import annotations

from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.errors import BudgetExceeded
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.model.participants import unmanaged
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.keystore.builder import certificate, crl
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import AT, Member, Store, authority
from tests.model.test_at_large import (
    ADMIN,
    LYING_ABOUT,
    MOTOR,
    NOBODYS,
    STORE,
    Files,
    understood,
    written,
)

HOLDS, VIOLATED, UNKNOWN = Status.HOLDS, Status.VIOLATED, Status.UNKNOWN
BY_LIST = ("spec", "fastdds-3.6")
"""They read crl.pem."""
WITHOUT_TALKER = replace(STORE, revoked=(STORE.members["/talker"].serial,))
ZERO, FIVE, BOTH = "<id>0</id>", "<id>5</id>", "<id>0</id><id>5</id>"


def ways(root: Path, target: str = "/motor", profiles: tuple[str, ...] = BY_LIST) -> set[Status]:
    """From /talker, whether it attacks or nobody does."""
    question = FlowQuestion(source="/talker", target=target, attackers=(Attacker.HONEST, Attacker.SOURCE))
    found = find_flow(root, question, Circumstances(profiles=resolve(profiles), at=AT))
    return {result.status for _attacker, result in found.results}


@pytest.mark.parametrize(
    ("files", "store", "expected"),
    [
        (LYING_ABOUT, STORE, VIOLATED),
        (LYING_ABOUT, WITHOUT_TALKER, VIOLATED),
        (NOBODYS, WITHOUT_TALKER, HOLDS),
        (LYING_ABOUT, replace(STORE, revoked=(ADMIN.certificate.serial_number,)), HOLDS),
    ],
)
def test_who_was_revoked_is_taken_by_whoever_has_no_list(
    files: Files, store: Store, expected: Status, tmp_path: Path
) -> None:
    """And nobody takes what one says that was revoked itself, whatever that one takes."""
    assert ways(written(tmp_path, files, store)) == {expected}


def test_who_has_no_list_need_not_take_all_that_lie_there(tmp_path: Path) -> None:
    """Beside what is taken, one of an authority that others trust: Cyclone DDS 11 reads the first of a file alone."""
    other, mapping = authority("other"), rule(criterion("publish", "rt/map"))
    trusting = {"identity_ca.cert.pem": other.pem, "crl.pem": crl(other, ()).public_bytes(Encoding.PEM)}
    store = replace(
        WITHOUT_TALKER,
        members={**STORE.members, "/away": Member(permissions=permissions(grant("/away", mapping)), issuer=other)},
        strays={**STORE.strays, "spare.p7s": permissions(grant("/spare", mapping))},
        files={f"enclaves/away/{name}": content for name, content in trusting.items()},
    )
    spare = certificate("/spare", other)
    beside = {"spare/cert.pem": spare.pem, "spare/key.pem": spare.key_pem}
    for number, files in enumerate((LYING_ABOUT, {**LYING_ABOUT, **beside})):
        assert ways(written(tmp_path / str(number), files, store), profiles=("cyclonedds-11",)) == {VIOLATED}


def apart(domains: str | None = None) -> Store:
    """/motor is in domain 5 alone, /talker in domain 0. `domains`: those of a governance that lies there."""
    reads = rule(criterion("subscribe", "rt/motor"), domains=FIVE)
    motor = Member(
        permissions=permissions(grant("/motor", reads)),
        governance=governance(domain_rule(domains=FIVE)),
        serial=MOTOR.serial,
    )
    there = rule(criterion("subscribe", "rt/chatter")), rule(criterion("publish", "rt/motor"), domains=FIVE)
    strays = {"old.p7s": permissions(grant("/admin", *there))}
    if domains is not None:
        strays["governance.p7s"] = governance(domain_rule(domains=domains))
    return replace(STORE, members={**STORE.members, "/motor": motor}, strays=strays)


@pytest.mark.parametrize(("domains", "expected"), [(None, HOLDS), (ZERO, HOLDS), (FIVE, HOLDS), (BOTH, VIOLATED)])
def test_who_starts_with_a_governance_that_lies_there_is_where_it_says(
    domains: str | None, expected: Status, tmp_path: Path
) -> None:
    assert ways(written(tmp_path / "a", LYING_ABOUT, apart(domains))) == {expected}
    assert ways(written(tmp_path / "b", NOBODYS, apart(domains))) == {HOLDS}


def passing_on() -> Store:
    """/admin may pass on what /talker says, and is in domain 5 alone."""
    passes_on = permissions(
        grant("/admin", rule(criterion("subscribe", "rt/chatter"), criterion("publish", "rt/motor")))
    )
    admin = Member(permissions=passes_on, governance=governance(domain_rule(domains=FIVE)), serial=104)
    return replace(STORE, members={**STORE.members, "/admin": admin}, strays={})


@pytest.mark.parametrize(
    ("place", "expected"),
    [("backup/key.pem", VIOLATED), ("backup/README", VIOLATED), ("enclaves/motor/notes", VIOLATED), (None, HOLDS)],
)
def test_whoever_has_a_copy_of_an_enclaves_key_is_in_no_trust_domain_of_it_alone(
    place: str | None, expected: Status, tmp_path: Path
) -> None:
    """/admin, in a domain of its own, would pass on what /talker says if it were started with /talker's governance."""
    root = written(tmp_path, {}, passing_on())
    if place is not None:
        copy = root / place
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes(b"A copy:\n" + (root / "enclaves/admin/key.pem").read_bytes())
    assert ways(root, profiles=("spec",)) == {expected}
    findings = audit(root, Options(at=AT, engine="native")).findings
    assert not {"KA668", "KA704", "KA707"} & {each.code for each in findings}


SECOND, THIRD = authority("second"), authority("third")


def test_more_authorities_than_can_be_trusted_together_are_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = replace(STORE, members={**STORE.members, "/motor": replace(MOTOR, issuer=SECOND)})
    trusted = {"enclaves/motor/identity_ca.cert.pem": SECOND.pem}
    monkeypatch.setattr(unmanaged, "MAX_AUTHORITIES", 1)
    assert understood(written(tmp_path / "b", {**trusted, **NOBODYS}, store))
    with pytest.raises(BudgetExceeded, match="may trust all 2 authorities"):
        understood(written(tmp_path / "a", {**trusted, **LYING_ABOUT}, store))


@pytest.mark.parametrize("unread", ["cut", "link"])
def test_what_could_not_be_read_may_be_a_governance_to_start_with(unread: str, tmp_path: Path) -> None:
    for name, files, expected in (("a", LYING_ABOUT, UNKNOWN), ("b", NOBODYS, UNKNOWN if unread == "link" else HOLDS)):
        root = written(tmp_path / name, files, apart(BOTH))
        content = (root / "governance.p7s").read_bytes()
        (root / "governance.p7s").unlink()
        if unread == "cut":
            (root / "governance.p7s").write_bytes(content[: content.index(b"<domain_rule>")])
        else:
            (root / "governance.p7s").symlink_to("/elsewhere/governance.p7s")
        question = FlowQuestion(source="/talker", target="/motor", attackers=(Attacker.HONEST,))
        assert find_flow(root, question, Circumstances(profiles=resolve(("spec",)), at=AT)).status is expected


WEAK = governance(
    domain_rule(
        topic_rule(
            read="false",
            write="false",
            metadata="NONE",
            data="NONE",
        ),
        unauthenticated="true",
        join="false",
        rtps="NONE",
    )
)


NARROW = governance(domain_rule(topic_rule("rt/mo*"), domains=BOTH))
"""It governs few topics, and a domain that no other does."""


@pytest.mark.parametrize("text", [WEAK, NARROW])
def test_what_it_says_is_no_fault_of_the_enclaves(text: str, tmp_path: Path) -> None:
    """Properties of the keystore are about what these apply."""
    told = []
    for name, strays in (("a", {}), ("b", {"governance.p7s": text})):
        root = written(tmp_path / name, LYING_ABOUT, replace(STORE, strays={**STORE.strays, **strays}))
        told.append({each.code for each in audit(root, Options(at=AT, engine="native")).findings})
    assert told[1] - told[0] == {"KA661"}


def test_one_without_a_single_meaning_may_say_anything(tmp_path: Path) -> None:
    odd = governance(domain_rule(topic_rule("rt/[a-") + topic_rule(), domains=ZERO))
    store = replace(STORE, strays={"governance.p7s": odd})
    for name, files, expected in (("a", {}, HOLDS), ("b", LYING_ABOUT, UNKNOWN)):
        root = written(tmp_path / name, files, store)
        assert ways(root) == {expected}
        unread = [each for each in audit(root, Options(at=AT, engine="native")).findings if each.code == "KA663"]
        assert bool(unread) is (expected is UNKNOWN)
