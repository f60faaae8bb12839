"""What the own implementation of whoever has an identity at large creates, as that of an enclave does."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.errors import BudgetExceeded
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.model.inventory import documents_of, unmanaged_identities
from keystore_audit.model.participants import unmanaged
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import AT, Member, Store
from tests.model.test_at_large import ADMIN, LYING_ABOUT, STORE, added, identity, understood, written

FAR = "<id>7</id>"


def admin(domains: str) -> str:
    """It reads /chatter in these domains, and writes /motor in domain 0."""
    reads = rule(criterion("subscribe", "rt/chatter"), domains=domains)
    return permissions(grant("/admin", reads, rule(criterion("publish", "rt/motor"))))


def at_large(domains: str) -> Store:
    return replace(STORE, strays={"old.p7s": admin(domains)})


def way(root: Path, profile: str) -> Status:
    """From /talker, which attacks, to /motor."""
    question = FlowQuestion(source="/talker", target="/motor", attackers=(Attacker.SOURCE,))
    return find_flow(root, question, Circumstances(profiles=resolve((profile,)), at=AT)).status


@pytest.mark.parametrize("profile", ["fastdds-3.6", "cyclonedds-11"])
def test_it_reads_what_an_enclave_of_its_document_would(profile: str, tmp_path: Path) -> None:
    """Fast DDS applies rules of other domains to its own endpoints."""
    enclave = Member(permissions=admin(FAR), serial=104)
    as_enclave = replace(STORE, members={**STORE.members, "/admin": enclave}, strays={})
    expected = Status.VIOLATED if profile == "fastdds-3.6" else Status.HOLDS
    assert way(written(tmp_path / "a", {}, as_enclave), profile) is expected
    assert way(written(tmp_path / "b", LYING_ABOUT, at_large(FAR)), profile) is expected
    assert way(written(tmp_path / "c", {"backup/cert.pem": ADMIN.pem}, at_large(FAR)), profile) is Status.HOLDS
    assert way(written(tmp_path / "d", LYING_ABOUT, at_large("<id>0</id>")), profile) is Status.VIOLATED


def test_by_every_document_that_names_it(tmp_path: Path) -> None:
    """One of them gives it nothing more than peers concede, another does."""
    store = replace(at_large("<id>0</id>"), strays={"a.p7s": permissions(grant("/admin")), "b.p7s": admin(FAR)})
    for system in understood(written(tmp_path, LYING_ABOUT, store)):
        (atom,) = added(system)
        heard = {system.channels[number].topic for number in atom.reads_alone}
        assert ("rt/chatter" in heard) is ("fastdds-3.6" in system.profiles)


def test_without_a_document_that_names_it_it_reads_nothing_alone(tmp_path: Path) -> None:
    store = replace(STORE, strays={"old.p7s": permissions(grant("/other", rule(criterion("subscribe", "rt/chatter"))))})
    for system in understood(written(tmp_path, LYING_ABOUT, store)):
        (atom,) = added(system)
        assert (*atom.reads_alone, *atom.writes_alone) == ()


@pytest.mark.parametrize("profile", ["fastdds-3.6", "cyclonedds-11"])
def test_a_renewed_certificate_reads_by_a_document_that_its_enclave_has_not(profile: str, tmp_path: Path) -> None:
    """To peers it is like the enclave's own; it adds what its own implementation creates with that document."""
    writes = permissions(grant("/admin", rule(criterion("publish", "rt/motor"))))
    store = at_large(FAR)
    store = replace(store, members={**store.members, "/admin": Member(permissions=writes, serial=104)})
    again = {"backup/cert.pem": identity("/admin", "/admin", serial=105).pem}
    assert way(written(tmp_path / "a", {}, store), profile) is Status.HOLDS
    expected = Status.VIOLATED if profile == "fastdds-3.6" else Status.HOLDS
    assert way(written(tmp_path / "b", again, store), profile) is expected
    alike = replace(store, strays={"old.p7s": writes})
    assert not any(map(added, understood(written(tmp_path / "c", again, alike)))), "it adds nothing"


def test_each_way_to_start_is_a_folder_of_its_own(tmp_path: Path) -> None:
    """Who starts is asked by folder: with another governance, or without a list, it may be another answer."""
    store = replace(at_large(FAR), revoked=(STORE.members["/talker"].serial,))
    store = replace(store, strays={**store.strays, "governance.p7s": governance(domain_rule(domains=FAR))})
    keystore = read_keystore(written(tmp_path, LYING_ABOUT, store))
    (large,) = unmanaged_identities(keystore, AT)
    numbers = {large.certificate.sha256: 0}
    who = unmanaged.Unmanaged(keystore, numbers, documents_of(keystore), resolve(("spec",)), AT)
    folders = {folder.files.directory for _number, _files, folder in who.holders}
    assert len(folders) == len(who.holders) == len(who.hosts) == len(store.members) + 2


def test_too_many_ways_to_start_are_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = written(tmp_path, LYING_ABOUT, at_large(FAR))
    monkeypatch.setattr(unmanaged, "MAX_HOLDERS", 0)
    with pytest.raises(BudgetExceeded, match="more than 0 ways"):
        understood(root)
