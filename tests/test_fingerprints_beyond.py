"""A finding rests on more than what stands at its places: what it goes beyond, whom it concerns, who takes it."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from tests.rules.evidence import AT
from tests.test_fingerprints import beside, enclave, prints, renewed
from tools.samples.base import IDENTITY_CA, LISTENER, PERMISSIONS_CA, QUIET, TALKER, TWO
from tools.samples.certificates import Certificate
from tools.samples.documents import DISCOVERY, Governance, Grant, Permissions, Rule
from tools.samples.identity_stories import revocation_list
from tools.samples.keys import Key
from tools.samples.smime import signed_by
from tools.samples.store import Enclave, Link, Store, write


def grant(path: str, *topics: str) -> Grant:
    return Grant(path=path, rules=(Rule(publish=topics), DISCOVERY))


def lent(*own: str) -> Store:
    """The talker's document lets the listener publish three topics; by its own it may publish these."""
    talkers = (*TALKER.permissions.grants, grant("/listener", "rt/a", "rt/b", "rt/c"))
    talker = replace(TALKER, permissions=Permissions(grants=talkers))
    return replace(
        TWO, enclaves=(talker, replace(LISTENER, permissions=Permissions(grants=(grant("/listener", *own),))))
    )


ADMIN = replace(TALKER.certificate, subject="/admin")


def again(*more: Grant, authority: bytes | None = None) -> Store:
    """The talker's key certified for /admin, too. `more`: grants beside the listener's. `authority`: whom it trusts."""
    two = {"cert.pem": TALKER.certificate.pem() + ADMIN.pem()}
    listeners = Permissions(grants=(*LISTENER.permissions.grants, *more))
    trusting = {} if authority is None else {"identity_ca.cert.pem": authority}
    listener = replace(LISTENER, permissions=listeners, changes=trusting)
    return replace(TWO, enclaves=(replace(TALKER, changes=two), listener))


OTHER_CA = Certificate(key=Key(label="fingerprints another identity CA"), subject="anotherCA", ca=True)
BOTH_CAS = OTHER_CA.pem() + IDENTITY_CA.pem()


def trusting(authorities: bytes) -> Store:
    """An identity lies beside the enclaves; the listener trusts these authorities."""
    own = replace(LISTENER.certificate, issuer=OTHER_CA)
    listener = replace(LISTENER, certificate=own, changes={"identity_ca.cert.pem": authorities})
    return replace(TWO, enclaves=(TALKER, listener), changes=beside("backup", "/admin"))


def linked(*paths: str, weaker: str = "/c") -> Store:
    """/c has a governance of its own, and /d one that says what the shared one does; these link to `weaker`'s."""
    rules = {"/c": replace(QUIET, rtps="SIGN"), "/d": QUIET}
    enclaves: list[Enclave] = []
    for made in (TALKER, LISTENER, *(enclave(path, Rule(publish=("rt/a",))) for path in ("/c", "/d", "/e", "/f"))):
        own = rules.get(made.path)
        signed = own and signed_by(PERMISSIONS_CA).smime(Governance(rules=(own,)).xml().encode())
        changes = {"governance.p7s": signed} if signed else {}
        if made.path in paths:
            changes = {"governance.p7s": Link(target=f"..{weaker}/governance.p7s")}  # type: ignore[dict-item]
        enclaves.append(replace(made, changes=changes))
    return replace(TWO, enclaves=tuple(enclaves))


def three(**changes: dict[str, bytes | Link]) -> Store:
    """With /third, and files that replace those of enclaves."""
    enclaves = (
        TALKER,
        LISTENER,
        enclave("/third", Rule(publish=("rt/a",))),
        enclave("/fourth", Rule(publish=("rt/a",))),
    )
    return replace(TWO, enclaves=tuple(replace(each, changes=changes.get(each.path[1:], {})) for each in enclaves))


def revoking(**links: str) -> Store:
    """The talker has a list that revokes nobody, and the others link to these."""
    one, other = revocation_list(), revocation_list(LISTENER.certificate)
    linked_to = {"third": "listener", "fourth": "listener", **links}
    others = {name: {"crl.pem": Link(target=f"../{target}/crl.pem")} for name, target in linked_to.items()}
    return three(talker={"crl.pem": one}, listener={"crl.pem": other}, **others)


STRAY_CA = replace(OTHER_CA, digest="sha1")


def carrying(name: str, content: bytes, *paths: str) -> Store:
    """These enclaves link to one file in public/."""
    changes = {path: {name: Link(target=f"../../public/shared.{name}")} for path in paths}
    return replace(three(**changes), changes={f"public/shared.{name}": content})  # type: ignore[arg-type]


def revoked(*paths: str) -> Store:
    return carrying("crl.pem", revocation_list(LISTENER.certificate), *paths)


def weak(*paths: str) -> Store:
    return carrying("identity_ca.cert.pem", IDENTITY_CA.pem() + STRAY_CA.pem(), *paths)


SPARE = Key(label="fingerprints spare key")


def lying_about(place: str, whose: Store = TWO) -> Store:
    return replace(whose, changes={place: SPARE.pem()})


def authority_of(role: str) -> Store:
    """The talker trusts the holder of the spare key as well."""
    more = {f"{role}_ca.cert.pem": TWO.permissions_ca.pem() + replace(PERMISSIONS_CA, key=SPARE).pem()}
    return replace(TWO, enclaves=(replace(TALKER, changes=more), LISTENER))


def spare_enclave() -> Store:
    made = enclave("/third", Rule(publish=("rt/a",)))
    return replace(TWO, enclaves=(*TWO.enclaves, replace(made, certificate=replace(made.certificate, key=SPARE))))


def sharing(*topics: str, key: bool) -> Store:
    """/third has the talker's key, or its subject; the talker may publish these topics."""
    first = enclave("/talker", Rule(publish=topics))
    mine = first.certificate if key else replace(first.certificate, key=SPARE)
    return replace(TWO, enclaves=(first, LISTENER, replace(TALKER, path="/third", certificate=mine)))


def served(*actions: str) -> Store:
    """The talker may publish whatever lies below rt/arm, where the listener serves these actions."""
    topics = tuple(f"rt/arm/{action}/_action/{topic}" for action in actions for topic in ("feedback", "status"))
    return replace(
        TWO, enclaves=(enclave("/talker", Rule(publish=("rt/arm/*",))), enclave("/listener", Rule(publish=topics)))
    )


WORSE = {
    "KA109 whose": (lying_about("private/x.key.pem"), lying_about("private/x.key.pem", authority_of("permissions"))),
    "KA118 authority": (lying_about("public/x.pem"), lying_about("public/x.pem", authority_of("permissions"))),
    "KA118 enclave": (lying_about("public/x.pem"), lying_about("public/x.pem", spare_enclave())),
    "KA212 carried by fewer": (revoked("listener", "third", "fourth"), revoked("listener", "third")),
    "KA212 no more by all": (revoked("talker", "listener", "third", "fourth"), revoked("listener", "third")),
    "KA212 carried by others": (revoked("third"), revoked("fourth")),
    "KA218 linked": (weak("talker", "listener"), weak("talker", "listener", "third")),
    "KA215 linked": (revoking(), revoking(third="talker")),
    "KA219 rights": (sharing("rt/a", key=True), sharing("rt/a", "rt/b", key=True)),
    "KA225 rights": (sharing("rt/a", key=False), sharing("rt/a", "rt/b", key=False)),
    "KA635 served": (served("move"), served("move", "stop")),
    "KA228 named": (again(), again(grant("/admin", "rt/cmd_vel"))),
    "KA228 named for more": (again(grant("/admin", "rt/a")), again(grant("/admin", "rt/a", "rt/cmd_vel"))),
    "KA228 taken": (again(authority=OTHER_CA.pem()), again(authority=BOTH_CAS)),
    "KA416 linked": (linked("/e", weaker="/d"), linked("/e", weaker="/c")),
    "KA512 own": (lent("rt/a", "rt/b"), lent("rt/a")),
    "KA668 taken": (trusting(OTHER_CA.pem()), trusting(BOTH_CAS)),
    "KA668 taken by Cyclone DDS": (trusting(BOTH_CAS), trusting(IDENTITY_CA.pem() + OTHER_CA.pem())),
}  # fmt: skip


@pytest.mark.parametrize("case", WORSE)
def test_what_is_worse_though_its_places_say_the_same_is_another_finding(case: str, tmp_path: Path) -> None:
    before, after = WORSE[case]
    code = case.split(maxsplit=1)[0]
    assert {*prints(before, tmp_path / "before", code)}.isdisjoint(prints(after, tmp_path / "after", code))


def test_one_more_enclave_that_starts_in_a_domain_of_nobody_is_another_finding(tmp_path: Path) -> None:
    found = []
    for name, more in (("before", ()), ("after", (enclave("/third", Rule(publish=("rt/a",))),)), ("again", ())):
        write(replace(TWO, enclaves=(*TWO.enclaves, *more)).tree(), tmp_path / name)
        report = audit(str(tmp_path / name), Options(at=AT, engine="native", domain=7))
        found.append({(each.fingerprint, each.meaning) for each in report.findings if each.code == "KA603"})
    assert found[0] == found[2] != set()
    assert found[0].isdisjoint(found[1])


def authority(*more: Enclave) -> Store:
    """A weak authority whom all trust."""
    both = {"public/identity_ca.cert.pem": IDENTITY_CA.pem() + STRAY_CA.pem()}
    return replace(TWO, enclaves=(*TWO.enclaves, *more), changes=both)


ALIKE = {
    "KA218": (authority(), authority(enclave("/third", Rule(publish=("rt/a",))))),
    "KA219": (sharing("rt/a", "rt/b", key=True), renewed(sharing("rt/b", "rt/a", key=True))),
    "KA225": (sharing("rt/a", "rt/b", key=False), renewed(sharing("rt/b", "rt/a", key=False))),
    "KA228": (again(grant("/admin", "rt/b", "rt/a")), renewed(again(grant("/admin", "rt/a", "rt/b")))),
    "KA512": (lent("rt/a", "rt/b"), renewed(lent("rt/b", "rt/a"))),
}


@pytest.mark.parametrize("code", ALIKE)
def test_what_it_rests_on_signed_again_is_the_same_finding(code: str, tmp_path: Path) -> None:
    before, after = ALIKE[code]
    assert {*prints(before, tmp_path / "before", code)} == {*prints(after, tmp_path / "after", code)}
