"""`flow --zenoh DIR`: where something can get by the files of sessions and routers, by one change each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric import ec

from keystore_audit.engine.alloy import routed as in_alloy
from keystore_audit.zenoh.flow import Walks
from tests.cli.conftest import Network, Run
from tests.cli.test_routed import AT, CHATTER, peer
from tests.keystore import builder
from tests.keystore.builder import sros2
from tests.oracles.zenoh.deployment import Configuration, Rule, access, allow, deny, session, tls, tool, written
from tests.schemas import schema

END = "tls/localhost:7461"
BY_ROUTER = {"cert_common_names": ["/router"]}
Found = dict[str, bool | None]
NOTHING = access(({"cert_common_names": ["/nobody"]}, [allow("0/none/*/*")]))


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return sros2(tmp_path / "keys", ("/talker", "/listener", "/random"))


def flow(run: Run, store: Path, folder: Path, *words: str) -> tuple[Found, dict[str, Any]]:
    """By attacker, what all releases answer; and the whole answer."""
    done = run("flow", store, *words, "--zenoh", folder, "--at", AT, "-f", "json")
    assert done.returncode in (0, 1, 4), done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    schema("flow").validate(document)
    found = {attacker: each["flow"] for attacker, each in document["attackers"].items()}
    assert done.returncode == (4 if document["flow"] is None else int(document["flow"]))
    return found, document


def gives(keys_of: str, *whom: str) -> list[tuple[dict[str, Any], list[Rule]]]:
    """What a file says that lets this out to these alone."""
    rules = [allow(keys_of, "put", flows=["egress"]), allow(keys_of, "declare_subscriber", flows=["ingress"])]
    return [({"cert_common_names": [*whom]} if whom else {}, rules)]


def takes(keys_of: str, *who: str) -> list[tuple[dict[str, Any], list[Rule]]]:
    """The same, of what it lets in."""
    rules = [allow(keys_of, "put", flows=["ingress"]), allow(keys_of, "declare_subscriber", flows=["egress"])]
    return [({"cert_common_names": [*who]} if who else {}, rules)]


def peers(**sections: Configuration) -> dict[str, Configuration]:
    """With these sections; of /random, where it has none, a file that lets nothing through."""
    return {name: peer(name, **section) for name, section in {"random": NOTHING, **sections}.items()}


def test_the_own_file_restrains_nobody_who_drops_it(keystore_audit: Run, keys: Path, network: Network) -> None:
    """Whoever may send is named in the second network: then /random cannot, file or no file."""
    files = {"talker": tool(publish="chatter"), "random": tool(publish="random")}
    folder = network(**peers(**files, listener=tool(subscribe="chatter")))
    found, document = flow(keystore_audit, keys, folder, "/random", "/listener")
    assert found == {"honest": False, "source": True, "relays": True}
    path = document["attackers"]["source"]["profiles"]["zenoh-1.7"]["path"]
    assert path["text"] == f"/random -> {CHATTER} -> /listener (without the file of /random)."
    (step,) = path["steps"]
    assert CHATTER in Path(step["path"]).read_text().splitlines()[step["line"] - 1]
    named = peer("listener", **access(*takes(CHATTER, "/talker")))
    (folder / "listener.json5").write_text(written({**tls(keys, "listener"), **named}))
    assert flow(keystore_audit, keys, folder, "/random", "/listener")[0]["source"] is False
    assert flow(keystore_audit, keys, folder, "/talker", "/listener")[0]["honest"] is True


@pytest.mark.parametrize(("relay", "expected"), [("talker", True), ("random", False)])
def test_somebody_between_passes_it_on(
    relay: str, expected: bool, keystore_audit: Run, keys: Path, network: Network
) -> None:
    """/random writes /a, which /talker reads, who writes /b; /listener takes that from /talker, or from /random."""
    between = access(*takes("0/a/*/*", "/random"), *gives("0/b/*/*", "/listener"))
    files = {"random": access(*gives("0/a/*/*")), "listener": access(*takes("0/b/*/*", f"/{relay}"))}
    folder = network(**peers(talker=between, **files))
    found, document = flow(keystore_audit, keys, folder, "/random", "/listener", "--attacker", "honest")
    assert found == {"honest": expected}
    if expected:
        path = document["attackers"]["honest"]["profiles"]["zenoh-1.7"]["path"]
        assert path["text"].startswith("/random -> 0/a/*/* -> /talker -> 0/b/*/* -> /listener")
        through = flow(keystore_audit, keys, folder, "/random", "/listener", "--through", "/talker")[0]
        assert through == {"honest": False, "source": False, "relays": True}  # /random lets anybody have /a


@pytest.fixture
def routed(tmp_path: Path) -> Path:
    return sros2(tmp_path / "keys", ("/talker", "/listener", "/router"))


def star(mode: str, rules: Configuration, **more: Any) -> dict[str, Configuration]:
    """/talker and /listener at one router with these rules; their own files let all data through, from it and to it."""
    own = access((BY_ROUTER, [allow("0/**", "put", "declare_subscriber")]))
    made = {name: session(mode, connect=[END], **own, **more) for name in ("talker", "listener")}
    return {**made, "router": session("router", listen=[END], **rules)}


@pytest.mark.parametrize(
    ("mode", "whom", "honest", "source"),
    [("client", "/listener", True, True), ("client", "/talker", False, False), ("peer", "/listener", False, True)],
)
def test_a_router_passes_on_what_its_rules_let_but_not_between_peers(
    mode: str, whom: str, honest: bool, source: bool, keystore_audit: Run, routed: Path, tmp_path: Path
) -> None:
    """A peer that attacks makes itself a client, for which it does. All trust the router itself."""
    folder = tmp_path / "network"
    folder.mkdir()
    rules = access(*takes(CHATTER, "/talker"), *gives(CHATTER, whom))
    for name, each in star(mode, rules).items():
        (folder / f"{name}.json5").write_text(written({**tls(routed, name), **each}))
    found = flow(keystore_audit, routed, folder, "/talker", "/listener", "--through", "/router")[0]
    assert found == {"honest": honest, "source": source, "relays": source}
    trusted = flow(keystore_audit, routed, folder, "/talker", "/listener")[0]
    assert trusted == {"honest": honest, "source": source, "relays": True}


@pytest.mark.parametrize(("whom", "further"), [("/listener", True), ("/nobody", False)])
def test_what_is_let_out_and_stays_at_the_router_is_said(
    whom: str, further: bool, keystore_audit: Run, routed: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "network"
    folder.mkdir()
    for name, each in star("client", access(*takes(CHATTER, "/talker"), *gives(CHATTER, whom))).items():
        (folder / f"{name}.json5").write_text(written({**tls(routed, name), **each}))
    done = keystore_audit("can", routed, "/talker", "publish", "/chatter", "--zenoh", folder, "--at", AT)
    said = " ".join(done.stdout.decode().split())
    assert (done.returncode == 0) is further
    assert ("allows put, but it gets no further than " in said) is not further


@pytest.mark.parametrize(
    ("topic", "honest", "relays"),
    [("topic:/chatter", True, True), ("topic:/secret", False, True), ("topic:/secret*", True, True)],
)
def test_a_topic_that_is_denied_by_default_allow(
    topic: str,
    honest: bool,
    relays: bool,
    keystore_audit: Run,
    keys: Path,
    network: Network,
) -> None:
    """In whatever domain; whoever attacks goes round the rule by a wider message (measured). Others begin so, too."""
    section = access(({}, [deny("*/secret/*/*", "put", "delete")]), default="allow")
    folder = network(**peers(talker=section, listener=section))
    found, _document = flow(keystore_audit, keys, folder, "/talker", topic)
    assert (found["honest"], found["relays"]) == (honest, relays)


def test_a_narrower_deny_leaves_other_domains(keystore_audit: Run, keys: Path, network: Network) -> None:
    section = access(({}, [deny("0/secret/*/*", "put")]), default="allow")
    folder = network(**peers(talker=section, listener=section))
    found, _document = flow(keystore_audit, keys, folder, "/talker", "topic:/secret", "--attacker", "honest")
    assert found == {"honest": True}


@pytest.mark.parametrize(
    ("given", "taken", "expected"),
    [
        ("0/a/*/*", "0/a/*/*", True),
        ("0/a/*/*", "0/b/*/*", False),
        ("0/a/*/*", "0/**", True),
        ("0/*/T/H", "0/a/*/*", True),  # 0/a/T/H is of both, and neither includes the other
        ("0/a/**", "0/*/b/*/*", True),
        ("0/rosout/*/*", "0/rosout/*/*", False),
        ("0/rosout/*/*", "0/**", False),
        ("0/a/*/*/@adv/**", "**", False),
    ],
)
def test_expressions_of_both_ends_meet(
    given: str,
    taken: str,
    expected: bool,
    keystore_audit: Run,
    keys: Path,
    network: Network,
) -> None:
    """What neither includes is possible, so that it is never said to be kept out."""
    folder = network(**peers(talker=access(*gives(given)), listener=access(*takes(taken))))
    found, _document = flow(keystore_audit, keys, folder, "/talker", "/listener", "--attacker", "honest")
    overlap = (given, taken) in (("0/*/T/H", "0/a/*/*"), ("0/a/**", "0/*/b/*/*"))
    assert found == {"honest": None if overlap else expected}
    if "rosout" in given:
        words = ("/talker", "/listener", "--attacker", "honest", "--include-ambient")
        assert flow(keystore_audit, keys, folder, *words)[0] == {"honest": True}


@pytest.mark.parametrize("service", ["request", "reply"])
def test_services_carry_data_both_ways(
    service: str,
    keystore_audit: Run,
    keys: Path,
    network: Network,
) -> None:
    """A request goes to who serves, and a reply comes back."""
    other = "reply" if service == "request" else "request"
    folder = network(**peers(talker=tool(**{service: "go"}), listener=tool(**{other: "go"})))
    assert flow(keystore_audit, keys, folder, "/talker", "/listener", "--attacker", "honest")[0] == {"honest": True}
    (folder / "listener.json5").write_text(
        written({**tls(keys, "listener"), **peer("listener", **tool(**{other: "stop"}))})
    )
    assert flow(keystore_audit, keys, folder, "/talker", "/listener", "--attacker", "honest")[0] == {"honest": False}


@pytest.mark.parametrize("replies", [True, False])
def test_a_reply_may_have_a_key_of_its_own(replies: bool, keystore_audit: Run, keys: Path, network: Network) -> None:
    """Measured: what replies may be about is no matter of the query's key. Without a rule about replies none passes."""
    more = [allow("0/b/*/*", "reply")] if replies else []
    answers = [allow("0/a/*/*", "query", flows=["ingress"]), allow("0/a/*/*", "declare_queryable"), *more]
    asks = access(({}, [allow("0/a/*/*", "query", "declare_queryable"), *more]))
    folder = network(**peers(talker=access(({}, answers)), listener=asks))
    found, _document = flow(keystore_audit, keys, folder, "/talker", "/listener", "--attacker", "honest")
    assert found == {"honest": None if replies else False}


@pytest.mark.parametrize(("kind", "expected"), [("delete", True), ("declare_queryable", False)])
def test_whoever_attacks_deletes(kind: str, expected: bool, keystore_audit: Run, keys: Path, network: Network) -> None:
    rules = [allow(CHATTER, kind, flows=["ingress"]), allow(CHATTER, "declare_subscriber", flows=["egress"])]
    folder = network(**peers(talker=access(*gives(CHATTER)), listener=access(({}, rules))))
    found, _document = flow(keystore_audit, keys, folder, "/random", "/listener")
    assert (found["honest"], found["source"]) == (False, expected)


@pytest.mark.parametrize(("also", "expected"), [("0/none/*/*", False), (CHATTER, True)])
def test_what_an_enclave_tells_itself_is_no_flow(
    also: str, expected: bool, keystore_audit: Run, keys: Path, network: Network
) -> None:
    """/random's own file takes the topic from anybody; without that file it sends there."""
    folder = network(**peers(random=access(*takes(CHATTER)), talker=NOTHING, listener=access(*takes(also, "/random"))))
    found, _document = flow(keystore_audit, keys, folder, "/random", "topic:/chatter", "--attacker", "source")
    assert found == {"source": expected}


def test_one_of_two_subjects_is_asked_by_chance(keystore_audit: Run, keys: Path, network: Network) -> None:
    """Before 1.6."""
    two = access(({"link_protocols": ["tls"]}, [deny(CHATTER, "put")]), ({}, takes(CHATTER)[0][1]))
    folder = network(**peers(talker=access(*gives(CHATTER)), listener=two))
    asked = ("/random", "/listener", "--attacker", "source")
    assert flow(keystore_audit, keys, folder, *asked, "--profile", "zenoh-1.6")[0] == {"source": True}
    assert flow(keystore_audit, keys, folder, *asked, "--profile", "zenoh-1.4")[0] == {"source": None}


@pytest.mark.parametrize(
    ("section", "to", "expected"),
    [
        ({}, "/listener", True),
        (access(({}, [deny("**")]), default="allow"), "/listener", None),  # `**` is about no key with a chunk `@adv`
        (access(({}, [allow("0/**")])), "topic:/chatter", True),
        (access(({}, [allow("0/**")])), "topic:/arm/*", True),
        (access(({}, [allow("0/chatter/*/*")])), "topic:/arm/*", False),
    ],
)
def test_keys_that_no_rule_writes(
    section: Configuration, to: str, expected: bool | None, keystore_audit: Run, keys: Path, network: Network
) -> None:
    folder = network(**peers(**dict.fromkeys(("talker", "listener", "random"), section)))
    found, _document = flow(keystore_audit, keys, folder, "/talker", to, "--attacker", "honest")
    assert found == {"honest": expected}


def test_an_enclave_without_a_file_is_unknown_on_the_way(keystore_audit: Run, keys: Path, network: Network) -> None:
    """/random may start with anything: it is kept out only where others do not let it in."""
    files = peers(talker=access(*gives(CHATTER)), listener=access(*takes(CHATTER, "/random")))
    folder = network(**{name: files[name] for name in ("talker", "listener")})
    asked = ("/talker", "/listener", "--attacker", "honest")
    assert flow(keystore_audit, keys, folder, *asked)[0] == {"honest": None}
    named = peer("talker", **access(*gives(CHATTER, "/listener")))
    (folder / "talker.json5").write_text(written({**tls(keys, "talker"), **named}))
    assert flow(keystore_audit, keys, folder, *asked)[0] == {"honest": False}
    assert flow(keystore_audit, keys, folder, "/talker", "/random", "--attacker", "source")[0] == {"source": None}


@pytest.mark.parametrize(("protocol", "expected"), [("tls", False), ("tcp", None)])
def test_somebody_on_the_wire_may_read_what_is_not_encrypted(
    protocol: str,
    expected: bool | None,
    keystore_audit: Run,
    keys: Path,
    tmp_path: Path,
) -> None:
    """Rules of who may connect do not keep it: here nobody that has no certificate may read."""
    folder, end = tmp_path / "network", f"{protocol}/localhost:7462"
    folder.mkdir()
    for name, each in {
        "talker": session("client", connect=[end], **access(*gives(CHATTER))),
        "listener": session("peer", listen=[end], **access(*takes(CHATTER))),
        "random": session("client", **access(*takes("0/random/*/*"))),
    }.items():
        section = access(*gives(CHATTER)) if name == "talker" else {}
        (folder / f"{name}.json5").write_text(written({**tls(keys, name), **each, **section}))
    found, _document = flow(keystore_audit, keys, folder, "/talker", "outsider", "--attacker", "honest")
    assert found == {"honest": expected}


def test_doubts_keep_nothing_out(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(**peers(talker=access(*gives("0/a/*/*")), listener=access(*takes("0/b/*/*"))))
    asked = ("/talker", "/listener", "--attacker", "honest")
    assert flow(keystore_audit, keys, folder, *asked)[0] == {"honest": False}
    (folder / "more.yaml").write_text("mode: peer")
    found, document = flow(keystore_audit, keys, folder, *asked)
    assert found == {"honest": None}
    assert [Path(each["path"]).name for each in document["unknown"]] == ["more.yaml"]
    done = keystore_audit("flow", keys, *asked, "--zenoh", folder, "--at", AT)
    assert b"more.yaml" in done.stdout


@pytest.mark.parametrize("shared", [False, True])
def test_whoever_has_a_key_is_all_that_have_it(shared: bool, keystore_audit: Run, tmp_path: Path) -> None:
    """/random shows /talker's certificate, which everybody has, where it is of the same key."""
    identity, store, folder = builder.authority(), tmp_path / "keys", tmp_path / "network"
    key = ec.generate_private_key(ec.SECP256R1())
    for name in ("talker", "listener", "random"):
        own = builder.certificate(f"/{name}", identity, key=key if shared and name != "listener" else None)
        document = builder.PERMISSIONS.format(name=f"/{name}").encode()
        builder.write_enclave(store / "enclaves" / name, own, document, identity, identity, builder.GOVERNANCE)
    folder.mkdir()
    files = peers(talker=access(*gives(CHATTER)), listener=access(*takes(CHATTER, "/talker")))
    for name, each in files.items():
        (folder / f"{name}.json5").write_text(written({**tls(store, name), **each}))
    asked = ("/random", "/listener", "--attacker", "source")
    assert flow(keystore_audit, store, folder, *asked)[0] == {"source": shared}
    words = ("/random", "publish", "/chatter", "--effective", "--zenoh", folder, "--at", AT)
    assert keystore_audit("can", store, *words).returncode == (0 if shared else 1)


def test_usage(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(**peers(talker=tool("chatter")))
    for words, said in (
        (("/nobody", "/talker"), "names no enclave"),
        (("/talker", "/talker"), "both sides"),
        (("/talker", "topic:/a?"), "expected topic:/NAME"),
        (("/talker", "dds:rq/goRequest"), "expected topic:/NAME"),
        (("outsider", "/talker", "--attacker", "honest"), "any sample it sends is an attack"),
        (("/talker", "/listener", "--compromised", "1"), "--compromised"),
        (("/talker", "/listener", "--time-zone", "Europe/Berlin"), "--time-zone"),
        (("--from-compromised", "/talker", "--time-zone", "Europe/Berlin"), "--time-zone"),
    ):
        done = keystore_audit("flow", keys, *words, "--zenoh", folder, "--at", AT)
        assert done.returncode == 2, (words, done.stderr)
        assert said in done.stderr.decode(), words


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_both_engines_decide(keystore_audit: Run, keys: Path, network: Network) -> None:
    """Alloy says that nothing may get through, or no more; then it agrees with a flow, and decides alone nothing."""
    folder = network(**peers(talker=access(*gives(CHATTER)), listener=access(*takes(CHATTER, "/talker"))))
    for words, both, alone in (
        (("/talker", "/listener"), True, None),
        (("/random", "/listener"), False, False),
    ):
        asked = (*words, "--attacker", "source", "--rmw", "zenoh", "--distro", "jazzy")
        found, document = flow(keystore_audit, keys, folder, *asked, "--engine", "both")
        assert found == {"source": both}
        (answer,) = document["attackers"]["source"]["profiles"].values()
        assert answer["engines"] == {"native": both, "alloy": both}
        assert flow(keystore_audit, keys, folder, *asked, "--engine", "alloy")[0] == {"source": alone}


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_engines_that_disagree_decide_nothing(
    keystore_audit: Run, keys: Path, network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alloy finds a way that the native search is made to overlook."""
    folder = network(**peers(talker=access(*gives(CHATTER)), listener=access(*takes(CHATTER, "/talker"))))
    asked = ("/talker", "/listener", "--attacker", "source", "--rmw", "zenoh", "--distro", "jazzy", "--engine", "both")
    monkeypatch.setattr(Walks, "shortest", lambda _walks, _asked: None)
    found, document = flow(keystore_audit, keys, folder, *asked)
    assert found == {"source": None}
    (answer,) = document["attackers"]["source"]["profiles"].values()
    assert answer["engines"] == {"native": False, "alloy": None}
    done = keystore_audit("flow", keys, *asked, "--zenoh", folder, "--at", AT)
    assert b"The engines disagree" in done.stdout


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_a_network_that_is_too_large_for_alloy_is_unknown(
    keystore_audit: Run, keys: Path, network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = network(**peers(talker=access(*gives(CHATTER)), listener=access(*takes("0/b/*/*"))))
    asked = ("/talker", "/listener", "--attacker", "honest", "--engine", "both")
    monkeypatch.setattr(in_alloy, "MOST_CROSSINGS", 10)
    found, document = flow(keystore_audit, keys, folder, *asked)
    assert document["engines"]["alloy"]["status"] == "out_of_scale"
    assert document["flow"] is None
    assert found == {"honest": False}
