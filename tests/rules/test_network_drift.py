"""What files let enclaves do beyond what was granted (KA822), and less (KA836), by one change each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import api
from keystore_audit.profiles import facts
from keystore_audit.report import text
from tests.keystore.builder import PERMISSIONS, sros2
from tests.oracles.zenoh.deployment import NOW, Rule, access, allow, deny, session, tls, written

END = "tls/localhost:7461"
GRANTED = {"/talker": "publish", "/listener": "subscribe"}
POLICY = """<policy version="0.2.0"><enclaves>{}</enclaves></policy>"""
ENCLAVE = """<enclave path="{}"><profiles><profile ns="/" node="n"><topics {}="{}"><topic>chatter</topic></topics>
</profile></profiles></enclave>"""


def keystore(root: Path, topic: str = "rt/chatter", **changed: str) -> Path:
    """/talker is granted to publish a topic, /listener to subscribe to /chatter."""

    def document(path: str) -> str:
        done = GRANTED[path]
        given = topic if path == "/talker" else "rt/chatter"
        text = PERMISSIONS.format(name=path).replace("publish>", f"{done}>").replace("rt/chatter", given)
        for old, new in changed.items():
            text = text.replace(*new.split("|")) if path == f"/{old}" else text
        return text

    return sros2(root / "keys", ("/talker", "/listener"), document=document)


def files(root: Path, keys: Path, keys_of_rule: str = "0/chatter/*/*", who: str = "/talker") -> Path:
    """/talker connects to /listener, which takes these from `who`."""
    rules: Sequence[Rule] = [
        allow(keys_of_rule, "put", flows=["ingress"]),
        allow(keys_of_rule, "declare_subscriber", flows=["egress"]),
    ]
    sends = [
        allow("0/chatter/*/*", "put", flows=["egress"]),
        allow("0/chatter/*/*", "declare_subscriber", flows=["ingress"]),
    ]
    folder = root / "network"
    folder.mkdir()
    for name, each in {
        "listener": session("peer", listen=[END], **access(({"cert_common_names": [who]}, rules))),
        "talker": session("peer", connect=[END], **access(({"cert_common_names": ["/listener"]}, sends))),
    }.items():
        (folder / f"{name}.json5").write_text(written({**tls(keys, name), **each}), "utf-8")
    return folder


def told(keys: Path, network: Path, code: str = "KA822", **more: Any) -> list[str]:
    """The messages of the rule."""
    report = api.audit(keys, network=network, **more, engine="native", at=NOW)
    return [each.message for each in report.findings if each.code == code]


BY_FILES = ": the Zenoh files of others accept it, but its permissions do not grant it."
BEYOND = f"/talker can publish /chatter{BY_FILES}"


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("rt/chatter", []),
        ("rt/chat*", []),
        ("rt/other", [BEYOND]),
        ("rq/chatterRequest", [BEYOND]),
    ],
)
def test_what_permissions_do_not_grant(topic: str, expected: list[str], tmp_path: Path) -> None:
    keys = keystore(tmp_path, topic)
    assert told(keys, files(tmp_path, keys)) == expected


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("allow_rule>|allow_rule>", []),
        ("allow_rule>|deny_rule>", [BEYOND]),
        ("<id>0</id>|<id>1</id>", [BEYOND]),
        ("<id>0</id>|<id_range><min>0</min><max>1</max></id_range>", []),
        ("2034|2025", [BEYOND]),
        ("</topics></publish>|</topics><partitions><partition>p</partition></partitions></publish>", [BEYOND]),
    ],
)
def test_what_the_grant_says(change: str, expected: list[str], tmp_path: Path) -> None:
    keys = keystore(tmp_path, talker=change)
    assert told(keys, files(tmp_path, keys)) == expected


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ("0/chatter/*/*", []),
        ("0/other/*/*", [f"/talker can publish /other{BY_FILES}"]),
        ("5/chatter/*/*", [f"/talker can publish /chatter{BY_FILES}"]),
        ("1000/chatter/*/*", [f"/talker can publish /chatter{BY_FILES}"]),
        ("0/**", [f"/talker can publish /any{BY_FILES}"]),
        ("0/arm/$*_cmd/**", [f"/talker can publish /arm/any_cmd{BY_FILES}"]),
        ("0/**/chatter/*/*", [f"/talker can publish /any/chatter{BY_FILES}"]),
        (
            "0/chatter/*/* 0/rosout/*/*",
            [f"/talker can publish /rosout{BY_FILES}"],
        ),
    ],
)
def test_what_the_files_let_in(rule: str, expected: list[str], tmp_path: Path) -> None:
    """Names of rules count that no permissions name, and so does the domain."""
    keys = keystore(tmp_path)
    assert told(keys, files(tmp_path, keys, rule)) == expected


def test_a_name_of_permissions_that_a_pattern_of_a_rule_lets_in(tmp_path: Path) -> None:
    """Of a grant by a pattern that example is one."""
    keys = keystore(tmp_path, "rt/a*", listener="</topic>|</topic><topic>rt/cmd_vel</topic>")
    network = files(tmp_path, keys, "0/**")
    (found,) = told(keys, network)
    assert found.startswith("/talker can publish /chatter, publish /cmd_vel: the Zenoh files")


@pytest.mark.parametrize(
    ("talker", "expected"),
    [
        ("publish|ALLOW", []),
        (
            "publish|DENY",
            ["/talker can publish /chatter: the Zenoh files of others accept it, but the policy does not grant it."],
        ),
        (
            "subscribe|ALLOW",
            ["/talker can publish /chatter: the Zenoh files of others accept it, but the policy does not grant it."],
        ),
    ],
)
def test_beyond_the_policy(talker: str, expected: list[str], tmp_path: Path) -> None:
    """Where one is named permissions do not count."""
    keys, policy = keystore(tmp_path), tmp_path / "policy.xml"
    enclaves = [ENCLAVE.format("/talker", *talker.split("|")), ENCLAVE.format("/listener", "subscribe", "ALLOW")]
    policy.write_text(POLICY.format("".join(enclaves)), "utf-8")
    assert told(keys, files(tmp_path, keys), policy=policy) == expected


def test_permissions_that_are_not_there_are_not_compared(tmp_path: Path) -> None:
    keys = keystore(tmp_path, "rt/other")
    network = files(tmp_path, keys)
    assert told(keys, network) == [BEYOND]
    (keys / "enclaves" / "talker" / "permissions.p7s").unlink()
    assert told(keys, network) == []


@pytest.mark.parametrize(("release", "begins"), [("zenoh-1.4", "It is unknown whether "), ("zenoh-1.6", BEYOND)])
def test_an_open_answer_stays_open(release: str, begins: str, tmp_path: Path) -> None:
    """Before 1.6 one of several subjects is asked, and which is chance."""
    keys = keystore(tmp_path, "rt/other")
    network = files(tmp_path, keys)
    takes = [allow("0/chatter/*/*", "put", flows=["ingress"])]
    two = access(({"link_protocols": ["tls"]}, [deny("0/chatter/*/*", "put")]), ({}, takes))
    listener = {**tls(keys, "listener"), **session("peer", listen=[END], **two)}
    (network / "listener.json5").write_text(written(listener), "utf-8")
    (found,) = told(keys, network, profiles=[release])
    assert found.startswith(begins)


def kept_off(
    enclave: str = "/listener", does: str = "subscribe to /chatter", more: str = " (and 1 more of other enclaves)"
) -> str:
    """What KA836 says."""
    return f"{enclave} cannot {does}{more}: that is granted, but the Zenoh files stop it."


BOTH = [kept_off()]


@pytest.mark.parametrize(
    ("topic", "change", "expected"),
    [
        ("rt/chatter", "|", BOTH),
        ("rt/other", "|", []),
        ("rt/chat*", "|", [kept_off(more="")]),
        ("rt/chatter", "subscribe>|publish>", []),
        ("rt/chatter", "rt/chatter|rt/chat*", [kept_off("/talker", "publish /chatter", "")]),
        ("rt/chatter", "<id>0</id>|<id>1</id>", []),
    ],
)
def test_what_is_granted_to_both_sides_and_does_not_work(
    topic: str, change: str, expected: list[str], tmp_path: Path
) -> None:
    """The listener takes from somebody else. Who is granted a name by a pattern alone does not count as kept off."""
    keys = keystore(tmp_path, topic, listener=change)
    assert told(keys, files(tmp_path, keys, who="/random"), "KA836") == expected


@pytest.mark.parametrize(("domains", "expected"), [(232, BOTH), (233, None)])
def test_rules_of_too_many_domains_leave_it_open(domains: int, expected: list[str] | None, tmp_path: Path) -> None:
    keys = keystore(tmp_path)
    network = files(tmp_path, keys, " ".join(f"{domain}/chatter/*/*" for domain in range(domains)), who="/random")
    of_each = [told(keys, network, code) for code in ("KA822", "KA836")]
    if expected is None:
        reason = f"Not compared with what was granted: the rules in {network} are about more than 232 domains"
        assert of_each == [[reason], [reason]]
    else:
        assert of_each == [[], expected]


def test_what_works_is_not_kept_off(tmp_path: Path) -> None:
    keys = keystore(tmp_path)
    assert told(keys, files(tmp_path, keys), "KA836") == []


def test_a_service_that_nobody_can_call(tmp_path: Path) -> None:
    """Each half of it is granted as permissions write it."""
    keys = sros2(tmp_path / "keys", ("/talker", "/listener"), document=served)
    assert told(keys, files(tmp_path, keys), "KA836") == [kept_off("/listener", "serve /add")]


def served(path: str) -> str:
    """/talker calls the service, /listener answers."""
    request, reply = ("<publish>", "<subscribe>") if path == "/talker" else ("<subscribe>", "<publish>")
    halves = "".join(
        f"{half}<topics><topic>{topic}</topic></topics></{half[1:]}"
        for half, topic in sorted(((request, "rq/addRequest"), (reply, "rr/addReply")))
    )
    before, _publish, after = PERMISSIONS.format(name=path).partition("<publish>")
    return f"{before}{halves}{after.partition('</publish>')[2]}"


@pytest.mark.parametrize("topic", ["rosout", "parameter_events"])
def test_what_every_node_has_is_not_kept_off(topic: str, tmp_path: Path) -> None:
    keys = keystore(tmp_path, f"rt/{topic}", listener=f"rt/chatter|rt/{topic}")
    assert told(keys, files(tmp_path, keys), "KA836") == []


@pytest.mark.parametrize("content", [None, '{"mode": "pear"}'])
def test_an_enclave_that_does_not_start_is_not_kept_off(content: str | None, tmp_path: Path) -> None:
    """Nor is who would reach it: there is no file of it, or it is refused."""
    keys = keystore(tmp_path)
    network = files(tmp_path, keys, who="/random")
    assert told(keys, network, "KA836") == BOTH
    (network / "talker.json5").unlink()
    if content is not None:
        (network / "talker.json5").write_text(content, "utf-8")
    assert told(keys, network, "KA836") == []


@pytest.mark.parametrize(("rule", "expected"), [("ALLOW", BOTH), ("DENY", [])])
def test_what_the_policy_says_as_well(rule: str, expected: list[str], tmp_path: Path) -> None:
    keys, policy = keystore(tmp_path), tmp_path / "policy.xml"
    enclaves = [ENCLAVE.format("/talker", "publish", rule), ENCLAVE.format("/listener", "subscribe", "ALLOW")]
    policy.write_text(POLICY.format("".join(enclaves)), "utf-8")
    assert told(keys, files(tmp_path, keys, who="/random"), "KA836", policy=policy) == expected


@pytest.mark.parametrize(
    ("rule", "other", "number"),
    [
        ("0/chatter/**", "rt/chatter/raw", 1),
        ("0/chatter/*/*", "rt/chatter/raw", 0),
        ("0/**", "rt/chatter/raw", 0),
        ("0/folder/**", "rt/folder/raw", 0),
        ("0/chatter/**", "rt/chatter2", 0),
        ("0/chatter/**", "rq/chatter/rawRequest", 0),
        ("0/chatter/** 0/chatter/raw/**", "rt/chatter/raw", 0),
        ("0/chatter/** 5/chatter/raw/**", "rt/chatter/raw", 1),
        ("0/chatter/** 5/chatter/**", "rt/chatter/raw", 2),
    ],
)
def test_a_rule_for_a_name_reaches_longer_ones(rule: str, other: str, number: int, tmp_path: Path) -> None:
    """So many of its expressions."""
    keys = keystore(tmp_path, listener=f"</topic>|</topic><topic>{other}</topic>")
    report = api.audit(keys, network=files(tmp_path, keys, rule), engine="native", at=NOW)
    assert sum(len(each.locations) for each in report.findings if each.code == "KA812") == number


def test_a_longer_name_that_rules_alone_name(tmp_path: Path) -> None:
    """What denies is no such rule."""
    keys = keystore(tmp_path)
    network = files(tmp_path, keys, "0/chatter/**")
    assert told(keys, network, "KA812") == []
    more = [allow("0/chatter/raw/*/*", "put", flows=["egress"]), deny("0/chatter/**", "put")]
    talker = session("peer", connect=[END], **access(({"cert_common_names": ["/listener"]}, more)))
    (network / "talker.json5").write_text(written({**tls(keys, "talker"), **talker}), "utf-8")
    (message,) = told(keys, network, "KA812")
    assert message == "/listener has a rule for '0/chatter/**', which also covers /chatter/raw."


@pytest.mark.parametrize(
    ("rule", "number"),
    [
        ("0/chatter/*/*", 0),
        ("1/chatter/*/*", 2),
        ("0/chatter/*/* 1/chatter/*/*", 0),
        ("*/chatter/*/*", 0),
        ("@ros2_lv/1/**", 0),
    ],
)
def test_rules_of_a_domain_that_no_other_file_is_about(rule: str, number: int, tmp_path: Path) -> None:
    """So many files: the other one is of domain 0, and a third one that allows anything ends it."""
    keys = keystore(tmp_path)
    network = files(tmp_path, keys, rule)
    found = [
        each for each in api.audit(keys, network=network, engine="native", at=NOW).findings if each.code == "KA823"
    ]
    assert sum(len(each.locations) for each in found) == number
    (network / "third.json5").write_text(written(session("peer", listen=["tls/localhost:7462"])), "utf-8")
    assert told(keys, network, "KA823") == []


def test_one_file_of_another_domain_beside_two_of_one(tmp_path: Path) -> None:
    keys = keystore(tmp_path)
    network = files(tmp_path, keys)
    third = access(({"cert_common_names": ["/talker"]}, [allow("7/chatter/*/*", "put")]))
    (network / "third.json5").write_text(written({**session("client", connect=[END]), **third}), "utf-8")
    (message,) = told(keys, network, "KA823")
    assert message.endswith("third.json5, 7.")


SETTINGS = """[[property]]
name = "asserted"
severity = "medium"
{}
"""


def asserted(root: Path, keys: Path, network: Path, form: str) -> list[tuple[str, str, int]]:
    """What KA828 says, how bad it is, and how many places it names; else the text says that nothing is violated."""
    settings = root / "keystore-audit.toml"
    settings.write_text(SETTINGS.format(form), "utf-8")
    report = api.audit(keys, network=network, settings=settings, engine="native", at=NOW)
    found = [each for each in report.findings if each.code == "KA828"]
    said = " ".join(text.render(report).split())
    assert (facts.ROUTED_VIOLATE_NONE in said) is (not found)
    return [(each.message, each.severity.value, len(each.locations)) for each in found]


NO_FLOW = 'no_flow = {{ from = "/talker", to = "{}", attacker = "{}" }}'
VIOLATED = "So the files violate 'asserted': "


@pytest.mark.parametrize(
    ("rule", "who", "form", "begins"),
    [
        ("0/chatter/*/*", "/talker", NO_FLOW.format("/listener", "honest"), VIOLATED),
        ("0/chatter/*/*", "/random", NO_FLOW.format("/listener", "honest"), None),
        ("0/other/*/*", "/talker", NO_FLOW.format("/listener", "source"), VIOLATED),
        ("0/chatter/*/*", "/nobody", NO_FLOW.format("/listener", "source"), None),
        ("0/chatter/*/*", "/nobody", NO_FLOW.format("topic:/chatter", "source"), None),
        ("0/chatter/*/*", "/talker", NO_FLOW.format("topic:/chatter", "source"), VIOLATED),
        ("0/chatter/*/*", "/talker", NO_FLOW.format("dds:rt/chatte?", "source"), "'asserted' is not decided: "),
        ("0/chatter/*/*", "/talker", 'only_publish = { topic = "/chatter", enclaves = "/listener" }', VIOLATED),
        ("0/chatter/*/*", "/talker", 'only_publish = { topic = "/chatter", enclaves = "/talker" }', None),
        ("0/**", "/talker", 'only_publish = { topic = "/chatter", enclaves = "/listener" }', VIOLATED),
        ("0/other/*/*", "/talker", 'only_publish = { topic = "/chatter", enclaves = "/listener" }', None),
        ("0/chatter/*/*", "/talker", 'able = { from = "/listener", to = "/talker" }', None),
    ],
)
def test_what_settings_assert(rule: str, who: str, form: str, begins: str | None, tmp_path: Path) -> None:
    keys = keystore(tmp_path, "rt/*", listener="rt/chatter|rt/*")
    found = asserted(tmp_path, keys, files(tmp_path, keys, rule, who), form)
    assert len(found) == (begins is not None)
    for message, severity, places in found:
        assert (begins or "") in message
        assert (severity, places) == (("medium", 2) if begins == VIOLATED else ("high", 1))


def test_what_cannot_be_told_of_it_stays_open(tmp_path: Path) -> None:
    keys = keystore(tmp_path, "rt/*", listener="rt/chatter|rt/*")
    network = files(tmp_path, keys, who="/random")
    (network / "more.yaml").write_text("mode: peer", "utf-8")
    ((message, _severity, _places),) = asserted(tmp_path, keys, network, NO_FLOW.format("/listener", "honest"))
    assert message == f"It is unknown whether 'asserted' holds by the files in {network}."


@pytest.mark.parametrize(("who", "expected"), [("/talker", 0), ("/listener", 1)])
def test_whoever_passes_on_alone_is_not_asked_whether_it_publishes(who: str, expected: int, tmp_path: Path) -> None:
    """All clients of a router trust it."""
    keys, folder = sros2(tmp_path / "keys", ("/talker", "/listener", "/router")), tmp_path / "network"
    takes = [allow("0/chatter/*/*", "put", flows=["ingress"]), allow("0/chatter/*/*", "declare_subscriber")]
    gives = [allow("0/chatter/*/*", "put", flows=["egress"]), allow("0/chatter/*/*", "declare_subscriber")]
    rules = access(({"cert_common_names": ["/talker"]}, takes), ({"cert_common_names": ["/listener"]}, gives))
    own = access(({"cert_common_names": ["/router"]}, [allow("0/**", "put", "declare_subscriber")]))
    folder.mkdir()
    for name, each in {
        "router": session("router", listen=[END], **rules),
        **{name: session("client", connect=[END], **own) for name in ("talker", "listener")},
    }.items():
        (folder / f"{name}.json5").write_text(written({**tls(keys, name), **each}), "utf-8")
    found = asserted(tmp_path, keys, folder, f'only_publish = {{ topic = "/chatter", enclaves = "{who}" }}')
    assert len(found) == expected
