"""`suggest --as zenoh`: what sessions and a router start with grants what is granted, and never more."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import AT, answer, keystore, rule, run_at

SERVICE = ("rq/addRequest", "rr/addReply")
AS = ("--as", "zenoh")
ROUTER: tuple[str, ...] = (*AS, "--router", "/zenohd")


def suggested(keys: Path, folder: Path, *more: str | Path) -> tuple[int, str]:
    """The exit code, and what stderr says."""
    words = ("suggest", keys, "--at", AT, *ROUTER, "-o", folder, *more)
    done = run_at(folder.parent, *(str(each) for each in words))
    assert done.stdout == ""
    return done.returncode, " ".join(done.stderr.split())


def keys_with(directory: Path, *rules: str, **more: Any) -> Path:
    """/talker with these rules, somebody for whatever it does, and a router."""
    others = rule((*SERVICE, "rt/chatter"), (*SERVICE, "rt/chatter"))
    enclaves = {"/talker": rules, "/other": (others,), "/zenohd": (rule(("rt/zenohd",)),)}
    return keystore(directory / "keys", enclaves, **{"host": "localhost", **more})


def granted(folder: Path, name: str = "/talker") -> set[str]:
    """What the router lets somebody do: operations with topics."""
    rules = json.loads((folder / "zenohd/process.json5").read_text())["access_control"]["rules"]
    return {
        f"{operation} {key}"
        for operation, who, flow in (each["id"].split() for each in rules if each["id"] != "graph")
        for each in rules
        if each["id"] == f"{operation} {who} {flow}" and (who, flow) == (name, "ingress")
        for key in each["key_exprs"]
    }


PEERS = (
    *("--listen", "/multiplexer=10.0.0.5:7447", "--listen", "/turtlesim=10.0.0.6:7447"),
    *("--listen", "/keyboard=10.0.0.6:7448"),
)
STOCK = "healthy/turtlesim"
"""Its certificates are those of sros2, for no host."""


@pytest.mark.parametrize(
    ("sample", "form"),
    [
        ("zenoh/turtlesim_clients", ROUTER[2:]),
        (STOCK, ("--router", "/random", "--listen", "/random=10.0.0.5:7447")),
        (STOCK, PEERS),
    ],
)
def test_a_sample_is_written_so_that_it_audits_clean_and_grants_what_permissions_grant(
    sample: str, form: tuple[str, ...], repository: Path, tmp_path: Path
) -> None:
    keys, folder = repository / "sample_keystores" / sample, tmp_path / "network"
    assert answer("suggest", keys, "--at", AT, *AS, *form, "-o", folder) == (0, "")
    code, report = answer("audit", keys, "--zenoh", folder, "--at", AT, "--engine", "native", "--select", "KA8")
    assert code == 0, report
    answers = set()
    enclaves, topics = ("keyboard", "random", "multiplexer", "turtlesim"), ("high_priority", "low_priority")
    for enclave, operation, topic in product(enclaves, ("publish", "subscribe"), topics):
        if f"/{enclave}" in form:  # the router
            continue
        question = ("can", keys, f"/{enclave}", operation, f"/{topic}", "--at", AT, "-f", "json")
        signed, routed = (json.loads(answer(*question, *more)[1]) for more in ((), ("--zenoh", folder)))
        (by_permissions,) = {each["effective"] for each in signed["decisions"].values()}
        (both,) = {(each["decision"], each["effective"]) for each in routed["decisions"].values()}
        alone = topic == "low_priority" and form[1] == "/random"  # whose other side is the router's enclave
        assert both == (by_permissions, by_permissions) or alone, question
        answers.add(by_permissions)
    assert answers == {"allow", "deny"}


@pytest.mark.parametrize(
    ("left", "said"),
    [
        ((), ()),
        (("/keyboard",), ("/keyboard and /random have no link",)),
        (("/turtlesim", "/multiplexer"), ("/random and /turtlesim", "/multiplexer and /turtlesim")),
    ],
)
def test_two_peers_of_whom_neither_listens_are_told(
    left: tuple[str, ...], said: tuple[str, ...], repository: Path, tmp_path: Path
) -> None:
    words = [each for each in PEERS if each.partition("=")[0] not in left and each != "--listen"]
    given = [each for word in words for each in ("--listen", word)]
    done = run_at(
        tmp_path,
        "suggest",
        f"{repository / 'sample_keystores' / STOCK}",
        "--at",
        AT,
        "--as",
        "zenoh",
        *given,
        "-o",
        "new",
    )
    assert done.returncode == (4 if said else 0)
    assert all(each in " ".join(done.stderr.split()) for each in said), done.stderr


@pytest.mark.parametrize(("host", "ending"), [("arm", ""), ("leg", "#verify_name_on_connect=false"), (None, "#")])
def test_a_host_is_checked_where_the_certificate_is_for_it(host: str | None, ending: str, tmp_path: Path) -> None:
    """Of two peers that both listen one connects."""
    keys = keys_with(tmp_path, rule(("rt/chatter",)), host=host)
    folder = tmp_path / "network"
    given = ("--listen", "/talker=arm:7447", "--listen", "/other=arm:7448")
    assert answer("suggest", keys, "--at", AT, *AS, *given, "-o", folder)[0] == 0
    ends = {each.parent.name: json.loads(each.read_text())["connect"]["endpoints"] for each in folder.rglob("*.json5")}
    assert ends["talker"] == ends["zenohd"] == []
    (found,) = ends["other"]
    assert found.startswith(f"tls/arm:7447{ending}")
    assert bool(ending) is ("#" in found)


def test_the_committed_network_is_what_is_suggested_of_the_policy(repository: Path, tmp_path: Path) -> None:
    samples, folder = repository / "sample_keystores", tmp_path / "network"
    keys, policy = samples / "zenoh/turtlesim_clients", samples / "policies/turtlesim.policy.xml"
    assert suggested(keys, folder, "--policy", policy, "--no-usual") == (0, "")
    own = {each.parent.name: each.read_text() for each in folder.rglob("*.json5")}
    committed = {each.stem: each.read_text() for each in (samples / "networks/turtlesim_clients").iterdir()}
    assert {name: text.replace(f"{keys}", "/etc/keystore") for name, text in own.items()} == committed


CHATTER = {"publish 0/chatter/*/*"}


@pytest.mark.parametrize(
    ("rules", "expected", "said"),
    [
        ((rule(("rt/chatter",)),), CHATTER, ""),
        ((rule(("rt/chatter", "ros_discovery_info"), ("ros_discovery_info",)),), CHATTER, ""),
        ((rule(("rt/chatter", "rt/*")),), CHATTER, "publish rt/*"),
        ((rule(("rt/chatter", "rt/cha[rt]")),), CHATTER, "publish rt/cha[rt]"),
        ((rule(("rt/chatter", "rt/fo?")),), CHATTER, "publish rt/fo?"),
        ((rule(("rt/chatter", "chatter")),), CHATTER, "publish chatter"),
        ((rule(("rt/secret",), allow=False), rule(("rt/chatter", "rt/secret"))), CHATTER, "publish rt/secret"),
        ((rule(("rt/*t",), allow=False), rule(("rt/chatter", "rt/secret"))), CHATTER, "publish rt/secret"),
        ((rule(("rt/chatter",)), rule(("rt/secret",), partition="p")), CHATTER, "publish rt/secret"),
        ((rule(SERVICE[:1], SERVICE[1:]),), {"request 0/add/*/*"}, ""),
        ((rule(SERVICE[1:], SERVICE[:1]),), {"reply 0/add/*/*"}, ""),
        ((rule(SERVICE[:1]),), set(), "publish rq/addRequest"),
        (
            (rule(("rt/a/_action/feedback",), ("rt/a/_action/status",)),),
            {"publish 0/a/_action/feedback/*/*", "subscribe 0/a/_action/status/*/*"},
            "",
        ),
    ],
)
def test_what_no_key_expression_says_exactly_is_left_out_and_told(
    rules: tuple[str, ...], expected: set[str], said: str, tmp_path: Path
) -> None:
    code, told = suggested(keys_with(tmp_path, *rules), tmp_path / "network")
    assert granted(tmp_path / "network") == expected
    assert (code, f"/talker is not granted {said}: " in told) == ((4, True) if said else (0, False)), told


def test_what_is_allowed_by_default_is_left_out_and_told(tmp_path: Path) -> None:
    code, told = suggested(keys_with(tmp_path, rule(("rt/chatter",)), default="ALLOW"), tmp_path / "network")
    assert code == 4
    assert "/talker is not granted anything by default" in told
    assert granted(tmp_path / "network") == CHATTER


def test_keys_are_of_the_domain_of_the_robots(tmp_path: Path) -> None:
    """Permissions and governance are of domain 0 alone."""
    keys = keys_with(tmp_path, rule(("rt/chatter",)))
    assert suggested(keys, tmp_path / "here", "--domain", "0") == (0, "")
    code, told = suggested(keys, tmp_path / "there", "--domain", "5")
    assert (code, "publish rt/chatter" in told) == (4, True)
    assert (granted(tmp_path / "here"), granted(tmp_path / "there")) == (CHATTER, set())


POLICY = """<policy version="0.2.0"><enclaves><enclave path="{path}"><profiles><profile ns="/" node="talker">
{lists}
</profile></profiles></enclave></enclaves></policy>
"""
LISTED = '<topics publish="ALLOW"><topic>chatter</topic></topics>'
ACTION = '<actions execute="ALLOW"><action>dock</action></actions>'


@pytest.mark.parametrize(
    ("lists", "path", "number", "said"),
    [
        (LISTED, "/talker", 1, ""),
        (LISTED, "/nobody", 0, "The keystore has no enclave /nobody"),
        (LISTED.replace("chatter", "cha*"), "/talker", 0, "/talker is not granted publish /cha*"),
        (ACTION, "/talker", 5, ""),
        (
            f'{ACTION}<topics publish="DENY"><topic>dock/_action/status</topic></topics>',
            "/talker",
            0,
            "/talker is not granted execute /dock",
        ),
    ],
)
def test_a_policy_is_granted_where_it_says_names(lists: str, path: str, number: int, said: str, tmp_path: Path) -> None:
    policy = tmp_path / "own.policy.xml"
    policy.write_text(POLICY.format(path=path, lists=lists))
    keys = keys_with(tmp_path, rule(("rt/elsewhere",)))
    code, told = suggested(keys, tmp_path / "network", "--policy", policy)
    assert len(granted(tmp_path / "network")) == number
    assert (code, said in told) == (4 if said else 0, True), told
    assert "is kept" not in told


def test_two_enclaves_of_one_name_get_no_files(tmp_path: Path) -> None:
    """The router could not tell them apart; with names of their own they get files."""
    from tests.keystore.builder import authority, certificate

    keys = keys_with(tmp_path, rule(("rt/chatter",)))
    assert suggested(keys, tmp_path / "apart")[0] == 0
    (keys / "enclaves/talker/cert.pem").write_bytes(certificate("/other", authority("identityCA")).pem)
    code, told = suggested(keys, tmp_path / "alike")
    assert (code, told.count("gets no file")) == (4, 2)
    assert [each.parent.name for each in (tmp_path / "alike").rglob("*.json5")] == ["zenohd"]
    (keys / "enclaves/talker/cert.pem").write_bytes(certificate("/zenohd", authority("identityCA")).pem)
    assert suggested(keys, tmp_path / "as_router")[0] == 2


def test_usage(tmp_path: Path) -> None:
    keys, there = keys_with(tmp_path, rule(("rt/chatter",))), tmp_path / "there"
    there.mkdir()
    nameless = keystore(tmp_path / "nameless", {"/talker": (), "/zenohd": ()})
    out = ("-o", tmp_path / "network")
    for words, said in (
        ((keys, *ROUTER), "belong together"),
        ((keys, *out, *AS), "belong together"),
        ((keys, *out, "--router", "/zenohd", "--policy", "x"), "belong together"),
        ((keys, *out, *ROUTER, "--enclave", "/talker"), "of all enclaves"),
        ((keys, *out, *ROUTER, "--no-usual"), "do not say what is usual"),
        ((keys, *out, *AS, "--router", "/none"), "There is no enclave"),
        ((nameless, *out, *ROUTER), "names no host: say where it listens"),
        ((keys, *out, *ROUTER, "--listen", "/talker=arm:7447"), "listen nowhere"),
        ((keys, *out, *AS, "--listen", "/none=arm:7447"), "There is no enclave"),
        ((keys, *out, *AS, "--listen", "/talker=arm"), "is not ENCLAVE=HOST:PORT"),
        ((keys, "-o", there, *ROUTER), "is there already"),
        ((keys, "-o", keys / "network", *ROUTER), "lies in the keystore"),
        ((keys,), "Name what the nodes do"),
    ):
        done = run_at(tmp_path, "suggest", *(str(each) for each in words))
        assert (done.returncode, said in " ".join(done.stderr.split())) == (2, True), done.stderr
    assert not (tmp_path / "network").exists()
    assert not [*there.iterdir()]
