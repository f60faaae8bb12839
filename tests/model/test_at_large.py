"""Identities that are no enclave's own are participants: what flows, claims and blast radii say of them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.findings import Location
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.keystore import unmanaged
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.named import NamedPlace
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.formal.system import Participant, System
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants import unmanaged as participants
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.keystore.builder import Signed, certificate, key
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import AT, Member, Store, authority

IDENTITY = authority("identityCA")
TALKER = Member(permissions=permissions(grant("/talker", rule(criterion("publish", "rt/chatter")))), serial=101)
LISTENER = Member(permissions=permissions(grant("/listener", rule(criterion("subscribe", "rt/chatter")))), serial=102)
MOTOR = Member(permissions=permissions(grant("/motor", rule(criterion("subscribe", "rt/motor")))), serial=103)
ADMIN_RULE = rule(criterion("publish", "rt/motor"), criterion("subscribe", "rt/chatter"))
STORE = Store(
    members={"/listener": LISTENER, "/motor": MOTOR, "/talker": TALKER},
    strays={"old.p7s": permissions(grant("/admin", ADMIN_RULE))},
)
Files = Mapping[str, bytes]


def identity(subject: str | x509.Name, of: str, issuer: Signed = IDENTITY, **more: object) -> Signed:
    """Another certificate of the key of that name: an enclave's is called like it."""
    return certificate(subject, issuer, key=key(of), **more)  # type: ignore[arg-type]


AGAIN = identity("/listener", "/talker")
ADMIN = identity("/admin", "admin")
HELD: Files = {"public/x_ca.cert.pem": AGAIN.pem}
LYING_ABOUT: Files = {"backup/cert.pem": ADMIN.pem, "backup/key.pem": ADMIN.key_pem}
NOBODYS: Files = {"backup/cert.pem": ADMIN.pem}
"""Without the private key."""


def written(root: Path, files: Files, store: Store = STORE) -> Path:
    store.write(root)
    for path, content in files.items():
        (root / path).parent.mkdir(exist_ok=True)
        (root / path).write_bytes(content)
    return root


def understood(root: Path, claims: tuple[Claim, ...] = (), places: tuple[NamedPlace, ...] = ()) -> tuple[System, ...]:
    keystore = read_keystore(root)
    accesses = AccessViews(documents_of(keystore), AT, None)
    found = interpret(keystore, resolve(()), AT, accesses, Usabilities(None, accesses), claims=claims, places=places)
    if found.over_budget is not None:
        raise BudgetExceeded(found.over_budget)
    return found.systems


def added(system: System) -> list[Participant]:
    return [enclave for enclave in system.enclaves if enclave.unmanaged]


def flows(root: Path, source: str, target: str) -> dict[Attacker, Status]:
    found = find_flow(root, FlowQuestion(source=source, target=target), Circumstances(profiles=resolve(()), at=AT))
    return {attacker: result.status for attacker, result in found.results}


def statuses(**changed: Status) -> dict[Attacker, Status]:
    return {
        each: changed.get(each.name.lower(), Status.HOLDS)
        for each in (Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS)
    }


@pytest.mark.parametrize(
    ("files", "count"),
    [
        ({}, 0),
        (HELD, 1),
        (LYING_ABOUT, 1),
        (NOBODYS, 0),
        ({"public/x_ca.cert.pem": identity("/listener", "/talker", authority("other")).pem}, 0),
        ({"public/x_ca.cert.pem": identity("/listener", "/talker", end=AT - timedelta(days=1)).pem}, 0),
        ({"public/x_ca.cert.pem": identity("/listener", "/talker", start=AT + timedelta(days=1)).pem}, 1),
        ({"public/x_ca.cert.pem": identity("/talker", "/talker", serial=9).pem}, 0),
        ({"public/x_ca.cert.pem": AGAIN.pem + identity("/listener", "/talker", serial=9).pem}, 1),
        ({"public/x_ca.cert.pem": AGAIN.pem + identity("/admin", "/talker").pem}, 2),
    ],
)
def test_whom_peers_would_let_in_by_other_rights_than_an_enclaves(files: Files, count: int, tmp_path: Path) -> None:
    """One that expired, one of a stranger, and one that was renewed add nothing."""
    for system in understood(written(tmp_path, files)):
        assert len(added(system)) == count
        assert len(system.enclaves) == 3 + count


def test_one_that_is_revoked_is_let_in_by_nobody(tmp_path: Path) -> None:
    files = {"public/x_ca.cert.pem": identity("/listener", "/talker", serial=77).pem}
    for number, serials in enumerate(((78,), (77,))):
        systems = understood(written(tmp_path / str(number), files, replace(STORE, revoked=serials)))
        assert {len(added(system)) for system in systems if "spec" in system.profiles} == {1 - number}


def test_a_second_certificate_of_a_key_is_a_way(tmp_path: Path) -> None:
    """Whoever has /talker can read as /listener; the flow needs an attack."""
    without, with_it = written(tmp_path / "a", {}), written(tmp_path / "b", HELD)
    assert flows(without, "topic:/chatter", "/talker") == statuses()
    assert flows(with_it, "topic:/chatter", "/talker") == statuses(relays=Status.VIOLATED)


def test_an_identity_whose_key_lies_about_is_a_way(tmp_path: Path) -> None:
    without, with_it = written(tmp_path / "a", NOBODYS), written(tmp_path / "b", LYING_ABOUT)
    assert flows(without, "/talker", "/motor") == statuses()
    every = Status.VIOLATED
    assert flows(with_it, "/talker", "/motor") == statuses(honest=every, source=every, relays=every)


@pytest.mark.parametrize(("source", "flow"), [("/*", True), ("/**", True), ("/?*", False), ("/listener", False)])
def test_it_is_meant_where_everybody_is(source: str, flow: bool, tmp_path: Path) -> None:
    root = written(tmp_path, LYING_ABOUT, replace(STORE, members={"/listener": LISTENER, "/motor": MOTOR}))
    assert flows(root, source, "/motor")[Attacker.HONEST] is (Status.VIOLATED if flow else Status.HOLDS)
    with pytest.raises(UsageError, match="names no enclave"):
        flows(root, "/*admin*", "/motor")


def claim(kind: ClaimKind, source: Globs, target: Globs, **more: object) -> Claim:
    return Claim(
        id="x",
        statement="X.",
        kind=kind,
        attacker=Attacker.RELAYS,
        source=source,
        target=target,
        location=Location(path="c.toml"),
        place="c.toml:1:1",
        **more,  # type: ignore[arg-type]
    )


def decided(root: Path, asked: Claim) -> set[Status]:
    return {answers["x"].status for answers in NativeEngine(understood(root, (asked,))).answers}


def decided_by_the_letter(root: Path, asked: Claim) -> Status:
    """Under the specification alone."""
    systems = understood(root, (asked,))
    answers = zip(systems, NativeEngine(systems).answers, strict=True)
    return next(each["x"].status for system, each in answers if "spec" in system.profiles)


def test_nothing_that_must_be_possible_rests_on_it(tmp_path: Path) -> None:
    """Data gets from /talker to /motor by /admin; by an enclave of the same rights it does what it must."""
    asked = claim(ClaimKind.ABLE, Globs(enclaves=("/talker",)), Globs(enclaves=("/motor",)))
    admin = Member(permissions=permissions(grant("/admin", ADMIN_RULE)), serial=104)
    assert decided(written(tmp_path / "a", LYING_ABOUT), asked) == {Status.VIOLATED}
    everybody = claim(ClaimKind.ABLE, Globs(enclaves=("/*",)), Globs(enclaves=("/motor",)))
    assert decided(written(tmp_path / "b", LYING_ABOUT), everybody) == {Status.VIOLATED}
    with_admin = replace(STORE, members={**STORE.members, "/admin": admin}, strays={})
    assert decided(written(tmp_path / "c", {}, with_admin), asked) == {Status.HOLDS}


def test_an_enclave_is_where_any_of_its_certificates_is(tmp_path: Path) -> None:
    there = rule(criterion("subscribe", "rt/far"), domains="<id>7</id>")
    rules = domain_rule(domains="<id>0</id><id>7</id>")
    members = {**STORE.members, "/far": Member(permissions=permissions(grant("/far", there)), serial=105)}
    store = replace(STORE, members=members, governance=governance(rules))
    asked = claim(ClaimKind.SEPARATE_DOMAINS, Globs(enclaves=("/talker",)), Globs(enclaves=("/far",)))
    far = {"public/x_ca.cert.pem": identity("/far", "/talker").pem}
    assert decided_by_the_letter(written(tmp_path / "a", {}, store), asked) is Status.HOLDS
    assert decided_by_the_letter(written(tmp_path / "b", far, store), asked) is Status.VIOLATED


def test_a_name_for_everybody_is_one_for_it_too(tmp_path: Path) -> None:
    root = written(tmp_path, LYING_ABOUT)
    for glob, more in (("/*", 1), ("/[a-z]*", 0)):
        named = NamedPlace(name="them", globs=Globs(enclaves=(glob,)), place="c.toml:1:1")
        for system in understood(root, places=(named,)):
            (atom,) = system.places
            assert atom.enclaves is not None
            assert (len(atom.enclaves), atom.unread) == (3 + more, False)


def test_one_whose_subject_cannot_be_told_may_be_anybody(tmp_path: Path) -> None:
    subject = x509.Name([x509.NameAttribute(NameOID.INN, "1")])
    root = written(tmp_path, {"public/x_ca.cert.pem": identity(subject, "/talker").pem})
    systems = understood(root)
    found = {system.may: [(each.opaque, each.identity) for each in added(system)] for system in systems}
    assert found == {True: [(True, None)], False: []}
    answer = find_flow(
        root, FlowQuestion(source="topic:/chatter", target="/motor"), Circumstances(profiles=resolve(()), at=AT)
    )
    assert answer.status is Status.UNKNOWN
    assert Location(path="public/x_ca.cert.pem", line=1) in answer.doubts


def test_what_was_not_read_may_be_anybody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unmanaged, "MAX_BYTES", 10)
    root = written(tmp_path, {"backup/cert.pem": identity("/admin", "admin", authority("other")).pem})
    found = {system.may: [(each.label, each.opaque) for each in added(system)] for system in understood(root)}
    assert found == {True: [("whoever is in backup/cert.pem", True)], False: []}
    answer = find_flow(
        root, FlowQuestion(source="/talker", target="/motor"), Circumstances(profiles=resolve(()), at=AT)
    )
    assert answer.status is Status.UNKNOWN
    assert answer.doubts == (Location(path="backup/cert.pem"),)


def test_too_many_are_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = written(tmp_path, {**HELD, **LYING_ABOUT})
    monkeypatch.setattr(participants, "MAX_PARTICIPANTS", 2)
    assert understood(root)
    monkeypatch.setattr(participants, "MAX_PARTICIPANTS", 1)
    with pytest.raises(BudgetExceeded, match="More than 1 identities"):
        understood(root)
