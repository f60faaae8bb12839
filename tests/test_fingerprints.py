"""By fingerprint and meaning a finding is accepted: what is told otherwise has others, whichever rule tells it."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Finding
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from tests.rules.evidence import AT
from tests.test_samples import SAMPLES, as_built, given_options, options_of
from tools.samples.base import IDENTITY_CA, LISTENER, PERMISSIONS_CA, QUIET, TALKER, TWO
from tools.samples.certificates import Certificate
from tools.samples.documents import (
    DISCOVERY,
    Criterion,
    DomainRule,
    Governance,
    Grant,
    Permissions,
    Rule,
    TopicRule,
)
from tools.samples.identity_stories import revocation_list
from tools.samples.keys import Key
from tools.samples.smime import signed_by
from tools.samples.store import Enclave, Store, write

RULES = sorted(path for path in (SAMPLES / "rules").glob("*/*.toml") if "--alloy-property" not in path.read_text())


SLICE = [path for path in RULES if int(path.parent.name[2:5]) % 4 == 0]
"""The pairs of every fourth code; golden digests of all samples hold their fingerprints still."""


def anonymous(finding: Finding, root: Path) -> str:
    """What is told but for lines and instants: reformatting moves the ones, and signing again the others."""
    text = finding.message.replace(str(root), "")
    text = re.sub(r"\d{4}-\d\d-\d\dT[0-9:]+Z", "then", text)
    return f"{finding.severity.value}: {re.sub(r'line [0-9]+', 'line', text)}"


def test_over_many_samples_one_fingerprint_of_one_meaning_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their paths and names are the same, so that what tells findings apart is what they are about.

    Left out are properties of the model (KA7), of which one example is told; a baseline notes their causes.
    """
    monkeypatch.chdir(SAMPLES)
    told: dict[tuple[str, str], set[str]] = defaultdict(set)
    for number, path in enumerate(SLICE):
        keystore, _expected = as_built(path, tmp_path / str(number))
        for finding in audit(str(keystore), given_options(path, keystore)).findings:
            if not finding.code.startswith(("KA7", "KA9")):
                worded = anonymous(finding, tmp_path / str(number))
                told[finding.code, f"{finding.fingerprint} {finding.meaning} {finding.severity}"].add(worded)
    assert len({code for code, _ in told}) > 45
    assert {key: messages for key, messages in told.items() if len(messages) > 1} == {}


def rights(*topics: str, talker: tuple[Rule, ...] = (), listener: tuple[Rule, ...] = (), **grant: object) -> Store:
    """/talker may publish these topics, and what the rules say; so may /listener."""
    publishing = (Rule(publish=topics),) if topics else ()
    enclaves = (
        enclave("/talker", *talker, *publishing, **grant),
        enclave("/listener", *(listener or (Rule(subscribe=("rt/chatter",)),))),
    )
    return replace(TWO, enclaves=enclaves)


def enclave(path: str, *rules: Rule, **grant: object) -> Enclave:
    """As TALKER and LISTENER, under other names with keys of their own."""
    made = {"/talker": TALKER, "/listener": LISTENER}.get(path)
    given = Permissions(grants=(Grant(path=path, rules=(*rules, DISCOVERY), **grant),))  # type: ignore[arg-type]
    if made is not None:
        return replace(made, permissions=given)
    own = Certificate(key=Key(label=f"fingerprints {path}"), subject=path, issuer=IDENTITY_CA)
    return Enclave(path=path, certificate=own, permissions=given)


def lent(*own: str) -> Store:
    """The talker's document lets the others publish /a as well; /third may publish these topics by its own."""
    talker = enclave("/talker", Rule(publish=("rt/chatter",)))
    others = (Grant(path=path, rules=(Rule(publish=("rt/a",)), DISCOVERY)) for path in ("/listener", "/third"))
    granted = replace(talker, permissions=Permissions(grants=(*talker.permissions.grants, *others)))
    listener = enclave("/listener", Rule(subscribe=("rt/chatter",)))
    return replace(TWO, enclaves=(granted, listener, enclave("/third", Rule(publish=own))))


def self_signed(*topics: str) -> Store:
    """One authority for both, and permissions that the talker signed itself."""
    store = rights(*topics)
    first = replace(store.enclaves[0], seal=signed_by(TALKER.certificate).smime)
    return replace(store, permissions_ca=IDENTITY_CA, enclaves=(first, *store.enclaves[1:]))


def beside(where: str, name: str) -> dict[str, bytes]:
    """An identity in a folder outside enclaves."""
    own = Certificate(key=Key(label=f"fingerprints {name}"), subject=name, issuer=IDENTITY_CA)
    given = Permissions(grants=(Grant(path=name, rules=(Rule(publish=("rt/chatter",)), DISCOVERY)),))
    signed = signed_by(PERMISSIONS_CA).smime(given.xml().encode())
    return {f"{where}/cert.pem": own.pem(), f"{where}/key.pem": own.key.pem(), f"{where}/permissions.p7s": signed}


def again(*subjects: str) -> Store:
    """The talker's key certified for others."""
    return replace(
        TWO,
        changes={
            f"public/x{number}_ca.cert.pem": replace(TALKER.certificate, subject=subject).pem()
            for number, subject in enumerate(subjects)
        },
    )


def sharing(*paths: str, key: bool) -> Store:
    """Enclaves with the talker's certificate, or with its subject alone."""
    mine = TALKER.certificate
    others = tuple(
        Enclave(
            path=path,
            certificate=mine if key else replace(mine, key=Key(label=f"fingerprints {path}")),
            permissions=TALKER.permissions,
        )
        for path in paths
    )
    return replace(TWO, enclaves=(*TWO.enclaves, *others))


def client(*services: str) -> Rule:
    return Rule(publish=tuple(f"rq{s}Request" for s in services), subscribe=tuple(f"rr{s}Reply" for s in services))


def server(*services: str) -> Rule:
    return Rule(publish=tuple(f"rr{s}Reply" for s in services), subscribe=tuple(f"rq{s}Request" for s in services))


def called(family: str, *nodes: str) -> Store:
    served = server(*(f"{node}/{family}" for node in ("/camera", "/brake")))
    return rights(talker=(client(*(f"{node}/{family}" for node in nodes)),), listener=(served,))


def answering(count: int) -> Store:
    """Both answer so many services."""
    mine = server(*(f"/s{number}" for number in range(count)))
    return rights(talker=(mine,), listener=(server(*(f"/s{number}" for number in range(9))),))


def holding(content: bytes) -> Store:
    return replace(TWO, changes={"private/ca.key.pem": content})


def governed(*expressions: str) -> Store:
    """A governance with rules for these topics alone."""
    topics = tuple(TopicRule(expression=expression) for expression in expressions)
    return replace(TWO, governance=Governance(rules=(replace(QUIET, topics=topics),)))


def at_large(rule: DomainRule) -> Store:
    signed = signed_by(PERMISSIONS_CA).smime(Governance(rules=(rule,)).xml().encode())
    return replace(TWO, changes={"old/governance.p7s": signed})


def differing(rule: DomainRule) -> Store:
    """The listener has a governance of its own."""
    signed = signed_by(PERMISSIONS_CA).smime(Governance(rules=(rule,)).xml().encode())
    return replace(TWO, enclaves=(TALKER, replace(LISTENER, changes={"governance.p7s": signed})))


def presented(*own: str) -> Store:
    """The talker's own document lets it publish these topics; an older one of it lies about."""
    old = Permissions(grants=(Grant(path="/talker", rules=(Rule(publish=("rt/chatter", "rt/cmd_vel", "rt/diag")),)),))
    return replace(rights(*own), changes={"old/p": signed_by(PERMISSIONS_CA).smime(old.xml().encode())})


def with_one_authority(*more: str) -> Store:
    others = (enclave(path, Rule(publish=("rt/chatter",))) for path in more)
    return replace(TWO, permissions_ca=IDENTITY_CA, enclaves=(*TWO.enclaves, *others))


def apart(*paths: str) -> Store:
    """Three enclaves, of which these trust another permissions CA."""
    other = Certificate(key=Key(label="fingerprints other CA"), subject="otherCA", ca=True)
    three = (*TWO.enclaves, enclave("/third", Rule(publish=("rt/chatter",))))
    trusting = {"permissions_ca.cert.pem": other.pem()}
    return replace(TWO, enclaves=tuple(replace(e, changes=trusting) if e.path in paths else e for e in three))


EVERYTHING = Rule(publish=("*",), subscribe=("*",))


def granted(*grants: Grant, domains: tuple[int, ...] = (0,)) -> Store:
    """The talker has these grants, and the governance covers these domains."""
    given = replace(TALKER, permissions=Permissions(grants=grants))
    rules = tuple(replace(QUIET, domains=(domain,)) for domain in domains)
    return replace(TWO, enclaves=(given, LISTENER), governance=Governance(rules=rules))


def in_domain_5(*domains: int) -> Store:
    """The talker may do everything in domain 5; the governance covers these."""
    rules = (Rule(publish=("rt/chatter",)), DISCOVERY, replace(EVERYTHING, domains=(5,)))
    return granted(Grant(path="/talker", rules=rules), domains=domains)


DATED = Grant(path="/talker", rules=(EVERYTHING,), not_before="2020-01-01T00:00:00", not_after="2100-01-01T00:00:00")
LATER = replace(DATED, not_before="2099-01-01T00:00:00")
OVER = replace(DATED, not_after="2021-01-01T00:00:00")
FIRST = replace(DATED, rules=(Rule(publish=("rt/chatter",)), DISCOVERY))


def held_by(certificate: Certificate, **changes: bytes) -> Store:
    """The talker may do everything, and this is its certificate."""
    store = granted(DATED)
    mine = tuple(replace(each, changes=changes) for each in store.enclaves)
    return replace(store, enclaves=(replace(mine[0], certificate=certificate), mine[1]))


LET_IN = TALKER.certificate
STRANGER = replace(IDENTITY_CA, key=Key(label="fingerprints stranger"))
EFFECTS = {
    "is of somebody else": (held_by(replace(LET_IN, subject="/somebody")), held_by(LET_IN)),
    "is of somebody who is over": (held_by(replace(LET_IN, not_after=AT - timedelta(days=1))), held_by(LET_IN)),
    "is of a stranger": (held_by(replace(LET_IN, issuer=STRANGER)), held_by(LET_IN)),
    "is of somebody revoked": (held_by(LET_IN, **{"crl.pem": revocation_list(LET_IN)}), held_by(LET_IN)),
    "begins": (granted(LATER), granted(DATED)),
    "begins again": (granted(OVER), granted(DATED)),
    "stands first": (granted(FIRST, DATED), granted(DATED)),
    "is skipped to": (granted(FIRST, DATED), granted(replace(FIRST, not_after="2021-01-01T00:00:00"), DATED)),
    "is governed": (in_domain_5(0), in_domain_5(0, 5)),
}
DENIED = Rule(publish=("rt/cmd_vel",), allow=False)
WORSE = {
    "KA109": (holding(Key(label="fingerprints unknown").pem()), holding(PERMISSIONS_CA.key.pem())),
    "KA219": (sharing("/one", key=True), sharing("/one", "/two", key=True)),
    "KA225": (sharing("/one", key=False), sharing("/one", "/two", key=False)),
    "KA222": (with_one_authority(), with_one_authority("/third")),
    "KA223": (apart("/third"), apart("/third", "/listener")),
    "KA228": (again("/spare"), again("/spare", "/listener")),
    "KA302": (self_signed("rt/chatter"), self_signed("rt/chatter", "rt/cmd_vel")),
    "KA416": (
        differing(replace(QUIET, topics=(TopicRule(expression="rt/diag", metadata="SIGN"), TopicRule()))),
        differing(replace(QUIET, topics=(TopicRule(metadata="SIGN"),))),
    ),
    "KA418": (governed("rt/chatter", "ros_discovery_info", "rt/stop"), governed("rt/chatter", "ros_discovery_info")),
    "KA509": (rights("rt/a", talker=(DENIED,), default="ALLOW"), rights("rt/a", default="ALLOW")),
    "KA510": (rights("rt/*", talker=(DENIED,)), rights("rt/*")),
    "KA511": (
        rights(talker=(DENIED, Rule(publish=("*",), subscribe=("*",)))),
        rights(talker=(Rule(publish=("*",), subscribe=("*",)),)),
    ),
    "KA512": (lent("rt/a"), lent("rt/b")),
    "KA519": (
        replace(TWO, enclaves=(enclave("/robot"), enclave("/robot/arm", Rule(publish=("rt/a",))))),
        replace(TWO, enclaves=(enclave("/robot"), enclave("/robot/arm", Rule(publish=("rt/a", "rt/cmd_vel"))))),
    ),
    "KA632": (called("set_parameters", "/camera"), called("set_parameters", "/camera", "/brake")),
    "KA633": (called("change_state", "/camera"), called("change_state", "/camera", "/brake")),
    "KA634": (answering(6), answering(7)),
    "KA637": (
        rights(talker=(Rule(publish=(Criterion(topics=("rt/a",), partitions=("?",)),)),)),
        rights(talker=(Rule(publish=(Criterion(topics=("rt/a", "rt/cmd_vel"), partitions=("?",)),)),)),
    ),
    "KA660": (presented("rt/chatter", "rt/cmd_vel"), presented("rt/chatter")),
    "KA661": (at_large(replace(QUIET, domains=(7,))), at_large(replace(QUIET, rtps="NONE"))),
    "KA668": (replace(TWO, changes=beside("backup", "/spare")), replace(TWO, changes=beside("backup", "/admin"))),
}  # fmt: skip


def prints(store: Store, root: Path, code: str, *profiles: str) -> Iterator[str]:
    write(store.tree(), root)
    report = audit(str(root), Options(at=AT, engine="native", profiles=profiles))
    found = [each for each in report.findings if each.code == code]
    assert found
    yield from (f"{each.fingerprint} {each.meaning}" for each in found)


@pytest.mark.parametrize("code", WORSE)
def test_what_is_worse_at_the_same_place_is_another_finding(code: str, tmp_path: Path) -> None:
    before, after = WORSE[code]
    assert not {*prints(before, tmp_path / "before", code)} >= {*prints(after, tmp_path / "after", code)}
    assert {*prints(before, tmp_path / "again", code)} == {*prints(before, tmp_path / "once more", code)}


def relaying(*topics: str) -> Store:
    """The listener may relay these topics, none of which is encrypted for itself."""
    relay = enclave("/listener", Rule(relay=topics))
    protection = (*(TopicRule(expression=topic, data="NONE") for topic in topics), TopicRule())
    return replace(TWO, enclaves=(TALKER, relay), governance=Governance(rules=(replace(QUIET, topics=protection),)))


def test_a_property_that_nothing_explains_is_told_by_all_that_the_keystore_says(tmp_path: Path) -> None:
    one, two = relaying("rt/chatter"), relaying("rt/chatter", "rt/cmd_vel")
    found = [{*prints(store, tmp_path / str(n), "KA723", "spec")} for n, store in enumerate((one, two, renewed(one)))]
    assert found[0].isdisjoint(found[1])
    assert found[0] == found[2]


def test_a_property_that_findings_explain_is_about_the_whole_keystore_too(tmp_path: Path) -> None:
    """It is the same finding with a further right, and asks again."""
    open_to_all = Governance(rules=(replace(QUIET, rtps="NONE", topics=(TopicRule(metadata="NONE", data="NONE"),)),))
    stores = (replace(rights(*topics), governance=open_to_all) for topics in (("rt/a",), ("rt/a", "rt/b")))
    (before,), (after,) = (prints(store, tmp_path / str(n), "KA713") for n, store in enumerate(stores))
    assert before.split()[0] == after.split()[0]
    assert before != after


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_grant_that_gets_an_effect_is_another_finding(effect: str, tmp_path: Path) -> None:
    """It was accepted while nobody asked it."""
    before, after = ({*prints(store, tmp_path / str(n), "KA511")} for n, store in enumerate(EFFECTS[effect]))
    assert before.isdisjoint(after)


def test_a_grant_that_keeps_its_effect_is_the_same_finding(tmp_path: Path) -> None:
    """With dates that leave it in force."""
    stores = granted(DATED), granted(replace(DATED, not_before="2025-01-01T00:00:00"))
    before, after = ({*prints(store, tmp_path / str(n), "KA511")} for n, store in enumerate(stores))
    assert before == after


def test_a_certificate_renewed_with_its_key_makes_no_other_finding_and_a_new_key_does(tmp_path: Path) -> None:
    renewed_with_its_key = replace(LET_IN, not_after=AT + timedelta(days=9000))
    anew = replace(renewed_with_its_key, key=Key(label="fingerprints renewed"))
    stores = map(held_by, (LET_IN, renewed_with_its_key, anew))
    found = [{*prints(store, tmp_path / str(n), "KA511")} for n, store in enumerate(stores)]
    assert found[0] == found[1]
    assert found[0].isdisjoint(found[2])


def renewed(store: Store) -> Store:
    """Signed again, until another day."""

    def later(grants: tuple[Grant, ...]) -> Permissions:
        return Permissions(grants=tuple(replace(grant, not_after="2030-01-01T00:00:00") for grant in grants))

    return replace(store, enclaves=tuple(replace(e, permissions=later(e.permissions.grants)) for e in store.enclaves))


ALIKE = {
    "KA510": (rights("rt/b*", "rt/a*"), renewed(rights("rt/a*", "rt/b*"))),
    "KA511": (WORSE["KA511"][1], renewed(WORSE["KA511"][1])),
    "KA512": (lent("rt/a"), renewed(lent("rt/a"))),
    "KA632": (WORSE["KA632"][1], renewed(WORSE["KA632"][1])),
    "KA660": (presented("rt/b", "rt/a"), renewed(presented("rt/a", "rt/b"))),
}


@pytest.mark.parametrize("code", ALIKE)
def test_dates_of_grants_and_the_order_within_a_rule_make_no_other_finding(code: str, tmp_path: Path) -> None:
    """As where a document is signed again in time."""
    before, after = ALIKE[code]
    assert {*prints(before, tmp_path / "before", code)} == {*prints(after, tmp_path / "after", code)}


def test_another_certificate_inside_a_message_is_another_finding(tmp_path: Path) -> None:
    """What stands at its place is a document, which says the same."""

    def certified(subject: str) -> Store:
        seal = signed_by(PERMISSIONS_CA, replace(TALKER.certificate, subject=subject)).smime
        return replace(TWO, enclaves=(replace(TALKER, seal=seal), LISTENER))

    spare, admin = ({*prints(certified(name), tmp_path / name, "KA228")} for name in ("spare", "admin"))
    assert spare.isdisjoint(admin)


@pytest.mark.parametrize("code", ["KA203", "KA205", "KA505", "KA507"])
def test_a_day_that_passes_makes_no_other_finding(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SAMPLES)
    (path,) = (SAMPLES / "rules").glob(f"{code}-*/bad.toml")
    keystore, _expected = as_built(path, tmp_path / "keystore")
    options = given_options(path, keystore)
    today, tomorrow = (
        {
            (each.fingerprint, each.meaning)
            for each in audit(str(keystore), replace(options, at=at)).findings
            if each.code == code
        }
        for at in (options.at, options.at + timedelta(days=1))
    )
    assert today == tomorrow != set()


def test_another_value_in_the_environment_is_another_finding(tmp_path: Path) -> None:
    write(TWO.tree(), tmp_path / "keystore")
    found = []
    for name in ("/nobody", "/../../tmp/evil"):
        path = tmp_path / "robot.env"
        path.write_text(f"ROS_SECURITY_ENCLAVE_OVERRIDE={name}\n", "utf-8")
        options = options_of(tmp_path / "keystore", "--engine", "native", "--env", str(path))
        report = audit(str(tmp_path / "keystore"), replace(options, at=AT))
        found += [each.fingerprint for each in report.findings if each.code == "KA672"]
    assert len(set(found)) == len(found) == 2
