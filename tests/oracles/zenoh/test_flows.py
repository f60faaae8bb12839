"""Flows: against whatever single keys do, hop by hop, in deployments by chance, and against real sessions."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest

from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.profiles import ROUTED
from keystore_audit.truth import Truth
from keystore_audit.zenoh.access_control import Key, Kind, Meant
from keystore_audit.zenoh.answers import EFFECTIVE, Passing, to_pass
from keystore_audit.zenoh.flow import found
from keystore_audit.zenoh.links import Tie, find_way
from keystore_audit.zenoh.network import read_network
from keystore_audit.zenoh.participants import End, NetworkFlows, Participant, Question
from tests.amount import tried
from tests.keystore.builder import sros2
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.asking import real_answers
from tests.oracles.zenoh.case import Case
from tests.oracles.zenoh.deployment import NOW, Rule, access, allow, session, tls, written
from tests.oracles.zenoh.test_random import deployed

KEYS = ("0/chatter/T/H", "0/chatter/T/G", "0/chatter/a/T/H", "0/other/T/H", "0/chr/T/H", "1/chatter/T/H", "7/x/y/z")
WIDER = ("0/**", "**", "0/*/T/H")
NEWEST = ROUTED["zenoh-1.7"]
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all


def flows(case: Case, keystore: Keystore, folder: Path) -> NetworkFlows:
    """Those of the files of a case."""
    folder.mkdir()
    for name, each in case.sessions.items():
        (folder / f"{name}.json5").write_text(written(each), "utf-8")
    return NetworkFlows(keystore, read_network(folder, keystore, NOW))


class Single:
    """Hops of one key each, found one by one: from whoever sends, and from whoever listens without a file."""

    def __init__(self, asked: NetworkFlows, attacking: set[Participant], listening: set[Participant]) -> None:
        self.asked, self.attacking, self.listening = asked, attacking, listening

    def reached(self, start: Participant, *, certain: bool) -> set[Participant]:
        """To whom something comes."""
        came, waiting = {start}, [start]
        for sender in waiting:
            for each in self.asked.participants:
                if each not in came and self._hop(sender, each, certain=certain):
                    came.add(each)
                    waiting.append(each)
        return came

    def _hop(self, sender: Participant, to: Participant, *, certain: bool) -> bool:
        own = [tie for each in sender.sessions for tie in self.asked.rights.links.of(each)]
        attacks = self.asked.rights.links.attacks(sender.who) if sender in self.attacking else ()
        hears = self.asked.rights.links.attacks(to.who) if to in self.listening else ()
        return any(
            self._passes(own, sent, key, key, to, certain)
            or any(self._passes(attacks, sent, key, wide, to, certain) for wide in (key, *WIDER))
            or any(self._passes(hears, heard, key, wide, sender, certain) for wide in (key, *WIDER))
            for (sent, heard), key in itertools.product(SENT_AND_HEARD, KEYS)
        )

    def _passes(
        self, begins: Sequence[Tie], passing: Passing, key: str, first: str, to: Participant, certain: bool
    ) -> bool:
        messages = to_pass(passing, Key(first, Meant.ONE), Key(key, Meant.ONE))
        ends = to.sessions.__contains__
        return find_way(self.asked.rights.links, begins, messages, ends, NEWEST, certain=certain) is not None


SENT_AND_HEARD = (
    (EFFECTIVE["publish"], EFFECTIVE["subscribe"]),
    (EFFECTIVE["request"], ((Kind.SERVE, True), (Kind.QUERY, False))),
    (EFFECTIVE["reply"], ((Kind.QUERY, True), (Kind.SERVE, False), (Kind.REPLY, False))),
)
"""What has to pass, to whoever sends something and to whoever is there to get it."""


@pytest.mark.slow
@pytest.mark.parametrize("attacker", [Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS])
def test_what_single_keys_do_is_a_flow(tmp_path: Path, attacker: Attacker) -> None:
    """Two who both attack are asked about by us alone, through somebody's file."""
    keystore = read_keystore(deployment.keystore(tmp_path / "keystore"))
    root, told, certain, proven = tmp_path / "keystore", dict.fromkeys(Truth, 0), 0, 0
    for seed in range(tried(50)):
        asked = flows(deployed(Random(seed), root, seed), keystore, tmp_path / f"{seed}")
        everybody = [each for each in asked.participants if not each.unseen]
        source, target = Random(seed).sample([each for each in everybody if each.sessions], 2)
        listening = everybody if attacker is Attacker.RELAYS else asked.participants[-1:]
        attacking = [source] if attacker is Attacker.SOURCE else everybody if attacker is Attacker.RELAYS else []
        single = Single(asked, {*attacking}, {*listening})
        question = Question(
            source=End(participants=(source,)),
            target=End(participants=(target,)),
            attacking=asked.participants if attacker is Attacker.RELAYS else tuple(attacking),
            through=tuple(each for each in asked.participants if each.unseen),
        )
        truth, _hops = found(asked, question, NEWEST)
        told[truth] += 1
        if target in single.reached(source, certain=True):
            assert truth.may, seed
            proven += truth.must
            certain += 1
        elif target in single.reached(source, certain=False):
            assert truth.may, seed
        elif attacker is not Attacker.RELAYS:
            assert not truth.must, seed
    assert proven >= certain - 1 - certain // 20  # what neither of two expressions includes is possible
    assert told[Truth.NO] or attacker is Attacker.RELAYS


@pytest.mark.parametrize(("relay", "second"), [("talker", "yes"), ("random", "no")])
def test_two_hops_on_real_sessions(relay: str, second: str, tmp_path: Path) -> None:
    """/random writes /a, which /talker reads, who writes /b, which /listener takes from `relay` alone."""
    root, end = sros2(tmp_path / "keys", ("/talker", "/listener", "/random")), "tls/127.0.0.1:20740"
    by = {name: {"cert_common_names": [f"/{name}"]} for name in ("talker", "random", "listener")}

    def takes(key: str) -> list[Rule]:
        return [allow(key, "put", flows=["ingress"]), allow(key, "declare_subscriber", flows=["egress"])]

    def gives(key: str) -> list[Rule]:
        return [allow(key, "put", flows=["egress"]), allow(key, "declare_subscriber", flows=["ingress"])]

    there = {
        "talker": session(
            "peer", listen=[end], **access((by["random"], takes("0/a/*/*")), (by["listener"], gives("0/b/*/*")))
        ),
        "random": session("client", connect=[end], **access((by["talker"], gives("0/a/*/*")))),
        "listener": session("client", connect=[end], **access((by[relay], takes("0/b/*/*")))),
    }
    there = {name: {**tls(root, name), **each} for name, each in there.items()}
    cases = [
        Case("first", "", there, tuple(there), "random", "talker", key="0/a/T/H", at="0/a/T/H"),
        Case("second", "", there, tuple(there), "talker", "listener", key="0/b/T/H", at="0/b/T/H"),
        Case("beside", "", there, tuple(there), "random", "listener", key="0/a/T/H", at="0/a/T/H"),
    ]
    expected = {"first": "yes", "second": second, "beside": "no"}
    assert {each.name: real_answers([each], expected)[each.name] for each in cases} == expected
    asked = flows(cases[0], read_keystore(root), tmp_path / "network")
    claim = Question(
        source=End(participants=asked.named(["/random"])),
        target=End(participants=asked.named(["/listener"])),
    )
    truth, hops = found(asked, claim, NEWEST)
    assert truth is (Truth.YES if second == "yes" else Truth.NO)
    assert [hop.receiver.label for hop in hops] == (["/talker", "/listener"] if second == "yes" else [])


def test_a_wider_message_with_a_verbatim_chunk_evades_every_rule() -> None:
    """Even that about `**`, which has no such chunk (measured: the admin space is read beside it)."""
    for key, expected in (("0/chatter/*/*", True), ("0/chatter/*/*/@adv/**", False)):
        assert Key(key, Meant.ANY).has("**", allow=False).must is expected
