"""Single changes of the model of networks, each of which one small network finds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from keystore_audit.engine.alloy import routed
from keystore_audit.engine.alloy.facts import module_texts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.runner import analyzer_of
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.profiles import ROUTED
from keystore_audit.zenoh.flow import walks
from keystore_audit.zenoh.participants import OUTSIDER, End, NetworkFlows, Question
from tests.cli.test_routed_flow import NOTHING, gives, takes
from tests.keystore.builder import sros2
from tests.oracles.zenoh.case import Case
from tests.oracles.zenoh.deployment import Configuration, access, allow, deny, session, tls
from tests.oracles.zenoh.test_flows import flows

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]
CHATTER, ENDS = "0/chatter/*/*", [f"tls/localhost:{7470 + number}" for number in range(3)]
OPEN = access(({}, [allow("0/**")]))
TALKING, LISTENING = access(*gives(CHATTER)), access(*takes(CHATTER))


def pair(talker: Configuration, listener: Configuration) -> dict[str, Configuration]:
    """Two peers with these rules."""
    return {
        "talker": session("peer", listen=ENDS[:1], **talker),
        "listener": session("peer", connect=ENDS[:1], **listener),
        "random": session("client", **NOTHING),
    }


def routed_by(talker: str, listener: str, own: Configuration, **router: Any) -> dict[str, Configuration]:
    """Both at /random, a router that lets everything through."""
    return {
        "random": session("router", listen=ENDS[:1], **OPEN, **router),
        "talker": session(talker, connect=ENDS[:1], **own),
        "listener": session(listener, connect=ENDS[:1], **OPEN),
    }


REPLIES = allow("0/b/*/*", "reply")
ANSWERS = access(({}, [allow("0/a/*/*", "query", flows=["ingress"]), allow("0/a/*/*", "declare_queryable"), REPLIES]))
ASKS = access(({}, [allow("0/a/*/*", "query", "declare_queryable"), REPLIES]))
BY_INTERFACE = access(({"interfaces": ["lo"]}, [deny(CHATTER)]), default="allow")
BY_NAME = access(({"cert_common_names": ["/talker"]}, [deny(CHATTER)]), default="allow")
BROKERING = {"routing": {"router": {"peers_failover_brokering": True}}}
SILENT = access(({}, [allow(CHATTER, "put", flows=["egress"])]))
BY_PEER = {
    "random": session("peer", listen=ENDS[:1], **OPEN),
    "talker": session("peer", connect=ENDS[:1], **OPEN),
    "listener": session("client", connect=ENDS[:1], **OPEN),
}
TWO_ROUTERS = {
    **routed_by("peer", "peer", OPEN),
    "second": session("router", listen=ENDS[1:2], connect=ENDS[:1], **OPEN),
}
CACHED = allow("**/@adv/**", "put", "declare_subscriber")
PLAIN = {
    "listener": session("peer", listen=["tcp/localhost:7479"], **access(({}, [CACHED, deny("**", "put")]))),
    "talker": session("client", **NOTHING),
    "random": session("client", **NOTHING),
}
WITHOUT_RANDOM = {"talker": session("client", **NOTHING), "listener": session("client", **NOTHING)}
MUTANTS: dict[str, tuple[str, str, dict[str, Configuration], tuple[str, str], str, str, bool]] = {
    "interfaces": (" - unproven", "", pair(TALKING, BY_INTERFACE), ("/talker", "/listener"), "", "honest", True),
    "replies": (
        "		implies some expressions\n",
        "		implies sending.class in expressions.includes\n",
        pair(ANSWERS, ASKS), ("/talker", "/listener"), "", "honest", True,
    ),
    "defaults": (
        " and no surely_is[process, view]", "", pair(TALKING, BY_NAME), ("/talker", "/listener"), "", "honest", False
    ),
    "a peer sends to a router": (
        " or (sender = PEER and receiver = ROUTER)", "",
        routed_by("peer", "client", SILENT), ("/talker", "/listener"), "/random", "honest", True,
    ),
    "brokering": (
        " or process in brokering", "",
        routed_by("peer", "peer", OPEN, **BROKERING), ("/talker", "/listener"), "/random", "honest", True,
    ),
    "a peer passes on": (
        "CLIENT in from_mode +", "CLIENT = from_mode &",
        BY_PEER, ("/talker", "/listener"), "/random", "honest", True,
    ),
    "not straight back": (
        " and l.far not in came.near", "", TWO_ROUTERS, ("/talker", "/listener"), "/random", "honest", False
    ),
    "who begins": (
        "(Participant - through).(first.tells)", "Participant.(first.tells)",
        pair(TALKING, LISTENING), ("topic", "/listener"), "/talker", "honest", False,
    ),
    "who ends": (
        ":> (Participant - through)\n}", ":> Participant\n}",
        pair(TALKING, LISTENING), ("/talker", "topic"), "/listener", "honest", False,
    ),
    "no file": (
        "some (from + receiver) & unseen", "receiver in unseen",
        WITHOUT_RANDOM, ("/random", "outsider"), "", "honest", True,
    ),
    "verbatim": (" and sending.class not in verbatim", "", PLAIN, ("outsider", "/listener"), "", "source", True),
}  # fmt: skip
"""By what it is about: old and new text, files, from where to where, over whom not, who attacks, what may be."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_one_network_finds_each_mutant(
    name: str, tmp_path: Path, analyzer: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new, files, (source, target), through, attacker, expected = MUTANTS[name]
    root = sros2(tmp_path / "keys", ("/talker", "/listener", "/random"))
    there = {each: {**tls(root, "random" if each == "second" else each), **file} for each, file in files.items()}
    found = flows(Case("", "", there, (), "", ""), read_keystore(root), tmp_path / "network")
    begin = end(found, source)
    question = Question(
        source=begin,
        target=end(found, target),
        attacking=begin.participants if attacker == "source" else (),
        through=found.named([through] if through else []),
    )
    release = ROUTED["zenoh-1.7"]
    assert (walks(found, question, release, certain=False).shortest(question) is not None) is expected
    with analyzer_of(analyzer, 120) as solver:
        assert routed.may_get_through(found, question, release, solver) is expected
        text = module_texts(routed.MODULES)["routed.als"]
        assert text.count(old) == 1
        changed = {**module_texts(routed.MODULES), "routed.als": text.replace(old, new)}
        monkeypatch.setattr(routed, "module_texts", lambda _names: changed)
        assert routed.may_get_through(found, question, release, solver) is not expected


def end(found: NetworkFlows, word: str) -> End:
    if word == "topic":
        return End(topics=(CHATTER,))
    return End(participants=(OUTSIDER,) if word == "outsider" else found.named([word]))
