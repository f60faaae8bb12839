"""`flow --from-compromised ENCLAVE --zenoh DIR`: what a stolen key opens by others' files, by one change each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Network, Run
from tests.cli.test_routed import AT, CHATTER
from tests.cli.test_routed_flow import NOTHING, gives, peers, star, takes
from tests.keystore.builder import sros2
from tests.oracles.zenoh.deployment import Configuration, access, allow, tls, tool, written
from tests.schemas import schema

Opened = set[tuple[str, str, bool]]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return sros2(tmp_path / "keys", ("/talker", "/listener", "/random"))


def opened(run: Run, store: Path, folder: Path, who: str, *words: str) -> tuple[Opened, dict[str, Any]]:
    """What all releases say that it opens, and whether for certain; and the whole answer."""
    done = run("flow", store, "--from-compromised", who, "--zenoh", folder, "--at", AT, "-f", "json", *words)
    assert done.returncode in (0, 1, 4), done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    schema("compromise_routed").validate(document)
    assert done.returncode == (4 if document["beyond_itself"] is None else int(document["beyond_itself"]))
    (found,) = {
        frozenset((e["does"], e["name"], e["certain"]) for e in every) for every in document["profiles"].values()
    }
    return {*found}, document


@pytest.mark.parametrize("who", [(), ("/talker",)])
def test_it_writes_to_whoever_takes_from_anybody(
    who: tuple[str, ...], keystore_audit: Run, keys: Path, network: Network
) -> None:
    """With the lines that let it in; where /listener takes from /talker alone, /random's key opens nothing."""
    files = {"talker": access(*gives(CHATTER, "/listener")), "listener": access(*takes(CHATTER, *who))}
    folder = network(**peers(**files))
    found, document = opened(keystore_audit, keys, folder, "/random")
    assert found == (set() if who else {("publish", CHATTER, True), ("reach", "/listener", True)})
    assert document["beyond_itself"] is not bool(who)
    said = keystore_audit("flow", keys, "--from-compromised", "/random", "--zenoh", folder, "--at", AT).stdout.decode()
    assert ("can do nothing with it" in said) is bool(who)
    for each in document["profiles"]["zenoh-1.7"]:
        (place,) = each["places"]
        assert CHATTER in Path(place["path"]).read_text().splitlines()[place["line"] - 1]
        assert f"{place['path']}:{place['line']}" in said
        assert each["way"] in " ".join(said.split())


@pytest.mark.parametrize(("whom", "expected"), [("/listener", set()), ("/random", {("hear", "/talker", True)})])
def test_it_hears_what_others_let_out_to_it(
    whom: str, expected: Opened, keystore_audit: Run, keys: Path, network: Network
) -> None:
    """On whatever key: no permissions and no question name this one, where rules stand for any."""
    rules = gives("5/**", whom)
    found, _document = opened(
        keystore_audit, keys, network(**peers(talker=access(*rules), listener=NOTHING)), "/random"
    )
    assert {each for each in found if each[0] == "hear"} == expected
    assert {each[1] for each in found if each[0] == "subscribe"} == (
        {"5/any/*/*", "5/chatter/*/*"} if expected else set()
    )


@pytest.mark.parametrize("served", ["0/go/*/*", "0/stop/*/*"])
def test_it_calls_and_serves(served: str, keystore_audit: Run, keys: Path, network: Network) -> None:
    files = {"talker": tool(reply=served.split("/")[1]), "listener": tool(request="go")}
    found, _document = opened(keystore_audit, keys, network(**peers(**files)), "/random")
    assert {("request", served, True), ("reply", "0/go/*/*", True)} <= found
    assert (("request", "0/go/*/*", True) in found) is (served == "0/go/*/*")


@pytest.mark.parametrize("trusting", [True, False])
def test_the_key_of_a_router_sees_and_forges_what_passes_it(
    trusting: bool, keystore_audit: Run, tmp_path: Path
) -> None:
    """As far as the files of its clients let it: one that lets nothing through is neither heard nor reached."""
    store, folder = sros2(tmp_path / "keys", ("/talker", "/listener", "/router")), tmp_path / "network"
    folder.mkdir()
    files: dict[str, Configuration] = star("client", access(*takes(CHATTER, "/talker"), *gives(CHATTER, "/listener")))
    for name, each in files.items():
        section = NOTHING if name == "listener" and not trusting else {}
        (folder / f"{name}.json5").write_text(written({**tls(store, name), **each, **section}))
    found, _document = opened(keystore_audit, store, folder, "/router")
    assert {("hear", "/talker", True), ("reach", "/talker", True), ("publish", CHATTER, True)} <= found
    assert (("reach", "/listener", True) in found) is trusting
    assert (("hear", "/listener", True) in found) is trusting
    found, _document = opened(keystore_audit, store, folder, "/talker")
    assert (("reach", "/listener", True) in found) is trusting


def test_what_cannot_be_told_may_be_open(keystore_audit: Run, keys: Path, network: Network) -> None:
    """/random without a file may be linked to anybody; one file that is not read, and nothing is kept out."""
    files = peers(talker=NOTHING, listener=NOTHING)
    folder = network(**files)
    assert opened(keystore_audit, keys, folder, "/talker")[0] == set()
    (folder / "random.json5").unlink()
    found, document = opened(keystore_audit, keys, folder, "/talker")
    assert found == {("hear", "/random", False), ("reach", "/random", False)}
    assert document["beyond_itself"] is None
    (folder / "more.yaml").write_text("mode: peer")
    found, document = opened(keystore_audit, keys, folder, "/talker")
    assert {name for does, name, certain in found if does == "reach" and not certain} == {"/listener", "/random"}
    assert [Path(each["path"]).name for each in document["unknown"]] == ["more.yaml"]
    done = keystore_audit("flow", keys, "--from-compromised", "/talker", "--zenoh", folder, "--at", AT)
    assert b"PERHAPS reaches others: /listener" in done.stdout


@pytest.mark.parametrize("sample", ["turtlesim_generated", "turtlesim_clients", "vehicle_router"])
def test_it_is_what_flow_and_access_say(sample: str, keystore_audit: Run) -> None:
    store, folder = SAMPLES / "zenoh" / sample, SAMPLES / "networks" / sample
    table = json.loads(keystore_audit("access", store, "--zenoh", folder, "--at", AT, "-f", "json").stdout)["rights"]
    enclaves = {each["enclave"] for each in table}
    for who in enclaves:
        found, _document = opened(keystore_audit, store, folder, who)
        for other in enclaves - {who}:
            words = (who, other, "--attacker", "source", "--zenoh", folder, "--at", AT)
            reached = keystore_audit("flow", store, *words).returncode
            assert (("reach", other, True) in found) is (reached == 1)
        for right in (each for each in table if each["enclave"] == who):
            (effective,) = {each["effective"] for each in right["decisions"].values()}
            named = right["operation"], f"0{right['name']}/*/*", True
            assert (named in found) is (effective == "allow")


@pytest.mark.parametrize("names", [20, 1100])
def test_too_many_names_are_not_asked(names: int, keystore_audit: Run, keys: Path, network: Network) -> None:
    many = [f"0/topic{number}/*/*" for number in range(names)]
    rules = [allow(each, "put") for each in many]
    folder = network(**peers(talker=access(({"cert_common_names": ["/nobody"]}, rules)), listener=NOTHING))
    done = keystore_audit("flow", keys, "--from-compromised", "/random", "--zenoh", folder, "--at", AT)
    assert done.returncode == (4 if names > 1000 else 0)
    assert (b"More than 2000 rights" in done.stderr) is (names > 1000)


@pytest.mark.parametrize(
    ("who", "said"),
    [
        ("identity-ca", "Ask about an enclave"),
        ("permissions-ca", "permissions do not count"),
        ("/nobody", "There is no enclave"),
    ],
)
def test_usage(who: str, said: str, keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(**peers(talker=NOTHING))
    done = keystore_audit("flow", keys, "--from-compromised", who, "--zenoh", folder, "--at", AT)
    assert done.returncode == 2
    assert said in done.stderr.decode().replace("\n", " ")
