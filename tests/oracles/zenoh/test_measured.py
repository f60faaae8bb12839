"""Real sessions and routers, asked again: each measured case, on loopback, and what we say of its files."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.intent.environment import CONFIGURATION
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.profiles import ROUTED
from keystore_audit.truth import Truth
from keystore_audit.zenoh.flow import found
from keystore_audit.zenoh.network import read_network
from keystore_audit.zenoh.participants import OUTSIDER, End, NetworkFlows, Question
from tests.amount import SHARE
from tests.cli.keystores import answer
from tests.keystore.builder import sros2
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.asking import NEWEST, OLDER, ours, real, real_answers
from tests.oracles.zenoh.case import Case, K
from tests.oracles.zenoh.cases import cases
from tests.oracles.zenoh.deployment import access, allow, deny, session, tls
from tests.oracles.zenoh.test_files import FILES

FIRST_PORT = 21000
OTHERWISE = {
    **{(name, "1.4.0"): "error" for name in ("B21", "B22")},
    **{(name, old): "no" for name in ("E02", "E22") for old in ("1.4.0", "1.6.2")},
    **{("B06", old): "no" for old in OLDER},
}
"""What an older release does that the newest does not."""
BY_CHANCE = {"1.4.0": {"B16", "C09", "C10", "C20"}}
"""Cases of which a release does one thing or the other, from run to run."""
RECORDED = {"A24": "no", "A27": "yes", "A28": "no", "A37": "yes", "D14": "yes", "G34": "yes"}
"""Cases that tests of their own ask, below; those of `test_files.py` and all others are asked alike."""
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    odd = deployment.ODD | deployment.MISNAMED | deployment.ROOTS
    root = deployment.keystore(tmp_path_factory.mktemp("keystore"), odd)
    (root / "users").write_text("alice:1\nbob:2\nreader:3\n", "utf-8")
    return root


@pytest.fixture(scope="module")
def keystore(store: Path) -> Keystore:
    return read_keystore(store)


@pytest.fixture(scope="module")
def every(store: Path) -> Sequence[Case]:
    return [*cases(store, FIRST_PORT)]


def test_real_sessions_do_what_was_measured(every: Sequence[Case]) -> None:
    measured = {case.name: case.measured for case in every}
    assert real_answers(every, measured) == measured
    assert len(every) >= 60


def test_we_say_what_was_measured(every: Sequence[Case], keystore: Keystore, tmp_path: Path) -> None:
    said = {case.name: ours(case, keystore, tmp_path / case.name) for case in every}
    wrong = {case.name: said[case.name] for case in every if said[case.name] != (case.ours or case.measured)}
    assert wrong == {}


def test_a_link_outlives_a_certificate_unless_it_is_ended(tmp_path: Path) -> None:
    """A23 and A24. A busy machine may need longer than a certificate lasts: then another one lasts longer."""
    for seconds in (5, 15, 45):
        root = tmp_path / f"{seconds}"
        end = datetime.now(timezone.utc).replace(microsecond=0) + timedelta(seconds=seconds)
        deployment.keystore(root, {"short": {"end": end}})
        after = end + timedelta(seconds=1)
        both = [_ending(root, f"A{number}", after) for number in (23, 24)]
        with ThreadPoolExecutor() as pool:
            answers = dict(zip(("A23", "A24"), pool.map(real, both), strict=True))
        if answers["A23"] == "yes":
            break
    assert answers == {"A23": "yes", "A24": "no"}
    keystore = read_keystore(root)
    assert [ours(case, keystore, tmp_path / case.name, at=after) for case in both] == ["unknown", "no"]
    assert [ours(case, keystore, tmp_path / case.name, at=deployment.NOW) for case in both] == ["yes", "yes"]


def _ending(root: Path, name: str, after: datetime) -> Case:
    end = f"tls/127.0.0.1:{FIRST_PORT - int(name[1:])}"
    theirs = session("peer", listen=[end], **tls(root, "listener", close_link_on_expiration=name == "A24"))
    mine = session(connect=[end], **tls(root, "short", close_link_on_expiration=False))
    return Case(name, "", {"whom": theirs, "who": mine}, ("whom",), "who", "whom", as_if="short", after=after)


@pytest.mark.parametrize(("name", "protocol"), [("A27", "tcp"), ("A28", "tls")])
def test_what_is_on_the_wire_can_be_read_without_tls(name: str, protocol: str, tmp_path: Path) -> None:
    """Nothing goes out to an outsider but by the wire, and who is there we do not know."""
    root = sros2(tmp_path / "keystore", ["/talker", "/listener"])
    ports = FIRST_PORT - 31, FIRST_PORT - 30
    ends = [f"{protocol}/127.0.0.1:{port}" for port in ports]
    own = {each: tls(root, each) if protocol == "tls" else {} for each in ("listener", "talker")}
    takes = access(({}, [allow(K, "put", flows=["ingress"]), allow(K, "declare_subscriber", flows=["egress"])]))
    theirs = session("peer", listen=[ends[1]], **takes, **own["listener"])
    mine = session(connect=[ends[0]], **own["talker"])
    case = Case(name, RECORDED[name], {"whom": theirs, "who": mine}, (), "who", "whom", wire=ports)
    assert real(case, patience=4) == RECORDED[name]
    told = {"tcp": Truth.UNKNOWN, "tls": Truth.NO}
    network = tmp_path / "network"
    network.mkdir()
    for each, made in (("listener", theirs), ("talker", session(connect=[ends[1]], **own["talker"]))):
        (network / f"{each}.json5").write_text(deployment.written(made | tls(root, each)), "utf-8")
    keystore = read_keystore(root)
    flows = NetworkFlows(keystore, read_network(network, keystore, deployment.NOW))
    asked = Question(source=End(participants=flows.named(["/talker"])), target=End(participants=(OUTSIDER,)))
    assert found(flows, asked, NEWEST)[0] is told[protocol]


def test_certificates_of_sros2_make_links(repository: Path, tmp_path: Path) -> None:
    """A37: a keystore whose bytes are those that sros2 makes."""
    root = repository / "sample_keystores/stock/turtlesim"
    roots = {"root_ca_certificate": f"{root / 'public/identity_ca.cert.pem'}"}
    end = f"tls/127.0.0.1:{FIRST_PORT - 1}"
    theirs = session("peer", listen=[end], **tls(root, "turtlesim", **roots))
    mine = session(connect=[end], **tls(root, "random", **roots))
    case = Case("A37", RECORDED["A37"], {"whom": theirs, "who": mine}, ("who", "whom"), "who", "whom")
    assert real_answers([case], RECORDED) == {"A37": "yes"}
    assert ours(case, read_keystore(root), tmp_path / "A37") == "yes"


def test_no_rule_is_about_what_a_process_sends_to_itself(store: Path, tmp_path: Path) -> None:
    """D14: all nodes of an enclave are one to us, so that nobody can ask what one of them sends to another."""
    own = session("peer", **tls(store, "talker"), **access(({}, [deny("0/**")])))
    case = Case("D14", RECORDED["D14"], {"who": own}, ("who",), "who", "who")
    assert real_answers([case], RECORDED) == {"D14": "yes"}
    (tmp_path / "who.json5").write_text(deployment.written(own), "utf-8")
    assert answer("flow", store, "/talker", "/talker", "--zenoh", tmp_path)[0] == 2


def test_an_override_switches_access_control_off(store: Path, tmp_path: Path) -> None:
    """G34: what the environment makes of files is unknown to us."""
    end, environment = f"tcp/127.0.0.1:{FIRST_PORT - 2}", tmp_path / "robot.env"
    theirs = session("peer", listen=[end], **access(({}, [deny("0/**")])))
    case = Case("G34", RECORDED["G34"], {"whom": theirs, "who": session(connect=[end])}, ("whom",), "who", "whom")
    assert real(case) == "no"
    overridden = replace(case, override={"access_control/enabled": "false"})
    assert real_answers([overridden], RECORDED) == {"G34": "yes"}
    assert ours(case, read_keystore(store), tmp_path / "G34") == "no"
    environment.write_text(f"{CONFIGURATION}=access_control/enabled=false\n", "utf-8")
    audited = ("audit", store, "--zenoh", tmp_path / "G34", "--env", environment, "--engine", "native")
    assert answer(*audited, "--select", "KA827")[0] == 4


def test_every_case_that_was_measured_is_asked(every: Sequence[Case], shared: Path) -> None:
    measured = json.loads((shared / "facts/zenoh/verdicts.json").read_text("utf-8"))["cases"]
    asked = {name: "yes" if starts else "error" for name, (_text, starts) in FILES.items()}
    asked |= RECORDED | {case.name: case.measured for case in every}
    assert {each["id"]: asked.get(each["id"]) for each in measured} == {e["id"]: e["measured"] for e in measured}


@pytest.mark.skipif(SHARE < 1, reason="make test-long asks older releases")
@pytest.mark.parametrize("version", OLDER)
def test_older_releases_do_what_their_profile_says(
    version: str, every: Sequence[Case], keystore: Keystore, oracle: Callable[[str], str], tmp_path: Path
) -> None:
    said = {case.name: ours(case, keystore, tmp_path / case.name, ROUTED[OLDER[version]]) for case in every}
    unsure = {case.name for case in every if said[case.name] == "unknown" and case.ours is None}
    assert {name for name in unsure if (name, version) not in OTHERWISE} == BY_CHANCE.get(version, set())
    asked = [case for case in every if case.name not in BY_CHANCE.get(version, ())]
    expected = {case.name: OTHERWISE.get((case.name, version), case.measured) for case in asked}
    assert real_answers(asked, expected, oracle(f"{sys.prefix}/zenoh-{version}/bin/python")) == expected
    right = {case.name: (expected[case.name], "unknown", case.ours) for case in asked}
    assert {name: said[name] for name in expected if said[name] not in right[name]} == {}
