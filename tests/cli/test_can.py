"""`can`: the interface contract, answer by answer (docs/reference.md)."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.cli.program import run
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.names import dds_channels
from tests.cli.keystores import AT, answer, document_of, grant_of, keystore, rule, signed_keystore
from tests.keystore import documents
from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import allow, criterion, deny, domain_rule, governance, pubsub
from tests.oracles.vendors.recipes_expressions import LONG, MANY_LONG
from tests.schemas import schema

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
TURTLESIM = SAMPLES / "healthy/turtlesim"
UNREADABLE = SAMPLES / "unknown/unreadable_enclave"

ALLOW, DENY, PARTLY, UNKNOWN = "allow", "deny", "partly", "unknown"
ANSWER_KEYS = ["enclave", "operation", "name", "dds_names", "domain", "partition", "decisions", "at", "assumptions"]
DECISION_KEYS = ["usable", "decision", "effective", "reason", "path", "line"]


def decisions(*args: str | Path) -> tuple[int, dict[str, Any]]:
    code, out = answer("can", "--at", AT, "-f", "json", *args)
    assert out.isascii()
    assert out.count("\n") == 1
    document = json.loads(out)
    assert list(document) == ANSWER_KEYS
    assert document["at"] == AT
    schema("can").validate(document)
    names = document["dds_names"]
    for each in document["decisions"].values():
        assert list(each) == (DECISION_KEYS if len(names) == 1 else [*DECISION_KEYS, "halves"])
        assert [half["dds_name"] for half in each.get("halves", [])] == (names if len(names) > 1 else [])
    return code, document


ASKS = (rule(publish=("rq/addRequest",)),)
ASKS_AND_HEARS = (rule(publish=("rq/addRequest",), subscribe=("rr/addReply",)),)
HEARS = (rule(subscribe=("rr/addReply", "rq/addRequest")),)
ANSWERS = (rule(publish=("rr/addReply",)),)
CALLS = (rule(publish=("rq/go/_action/cancel_goalRequest",)),)
TELLS = (rule(publish=("rt/go/_action/feedback",)),)
NOTHING = (rule(publish=("rt/other",)),)


@pytest.mark.parametrize(
    ("rules", "words", "ruling"),
    [
        (ASKS, "request /add", PARTLY),
        (ASKS_AND_HEARS, "request /add", ALLOW),
        (HEARS, "request /add", PARTLY),
        (HEARS, "reply /add", PARTLY),
        (ANSWERS, "request /add", DENY),
        (ANSWERS, "reply /add", PARTLY),
        (ASKS, "reply /add", DENY),
        (CALLS, "call /go", PARTLY),
        (CALLS, "execute /go", DENY),
        (TELLS, "call /go", DENY),
        (TELLS, "execute /go", PARTLY),
        (NOTHING, "request /add", DENY),
        (NOTHING, "execute /go", DENY),
    ],
)
def test_half_of_a_service_is_neither_allowed_nor_denied(
    rules: tuple[str, ...], words: str, ruling: str, tmp_path: Path
) -> None:
    """Without the right to read the reply the server carries out the request all the same, and clients take a reply."""
    store = keystore(tmp_path / "k", {"/c": rules, "/s": (rule(publish=("*",), subscribe=("*",)),)})
    for effective in ((), ("--effective",)):
        for expected in (ALLOW, DENY):
            code, document = decisions(store, "/c", *words.split(), "--expect", expected, *effective)
            assert code == (0 if ruling == expected else 1)
            assert {each["decision"] for each in document["decisions"].values()} == {ruling}
            assert {each["effective"] for each in document["decisions"].values()} == {ruling}
        assert decisions(store, "/c", *words.split(), *effective)[0] == (0 if ruling == ALLOW else 1)


@pytest.mark.parametrize("partitions", [False, True])
def test_one_name_needs_no_classes_of_names(partitions: bool, tmp_path: Path) -> None:
    """Both vendors answer such a keystore at once (tests/oracles/vendors): only a list of all names is beyond us."""
    topics, lists = (("rt/a",), MANY_LONG) if partitions else (MANY_LONG, ())
    listing = documents.rule(documents.pub(*topics, partitions=lists))
    store = keystore(tmp_path / "k", {"/e": (listing,)})
    for text, ruling in ((f"a{LONG[7]}b", ALLOW), (LONG[7][1:], DENY)):
        name, where = ("rt/a", text) if partitions else (text, "")
        asked = (store, "/e", "publish", name, "--kind", "dds", "--partition", where)
        code, document = decisions(*asked, "--expect", ruling)
        assert code == 0
        for each in document["decisions"].values():
            assert (each["decision"], each["effective"]) == (ruling, ruling)
    assert answer("access", store, "--at", AT)[0] == 4


def test_the_halves_are_named(tmp_path: Path) -> None:
    store = keystore(tmp_path / "k", {"/c": ASKS})
    _code, document = decisions(store, "/c", "request", "/add", "--profile", "spec")
    assert document["decisions"]["spec"]["halves"] == [
        {"dds_name": "rq/addRequest", "operation": "publish", "decision": ALLOW, "effective": ALLOW},
        {"dds_name": "rr/addReply", "operation": "subscribe", "decision": DENY, "effective": DENY},
    ]
    _code, out = answer("can", store, "/c", "request", "/add", "--at", AT, "--profile", "spec")
    assert "\nPARTLY   " in out
    flat = " ".join(out.split())
    assert "Its own implementation allows publish rq/addRequest; denies subscribe rr/addReply." in flat
    assert "some peer accepts publish rq/addRequest; no peer accepts subscribe rr/addReply." in flat
    _code, out = answer("can", store, "/c", "reply", "/add", "--at", AT, "--profile", "spec")
    flat = " ".join(out.split())
    assert "\nDENY     " in out
    assert "Its own implementation" not in flat
    assert "no peer accepts publish rr/addReply, subscribe rq/addRequest." in flat


def test_peers_may_accept_a_half_more(tmp_path: Path) -> None:
    """A document of another enclave that names this one, too, is one that it may present."""
    replies = rule(publish=("rr/addReply",), subscribe=("rr/addReply",))
    documents = {"/c": document_of(grant_of("/c", *ASKS)), "/s": document_of(grant_of("/s"), grant_of("/c", replies))}
    store = signed_keystore(tmp_path / "k", documents)
    for rules, decision, effective in (("request", PARTLY, ALLOW), ("reply", DENY, PARTLY)):
        code, document = decisions(store, "/c", rules, "/add", "--profile", "spec", "--effective")
        assert code == (effective != ALLOW)
        assert document["decisions"]["spec"]["decision"] == decision
        assert document["decisions"]["spec"]["effective"] == effective
    _code, out = answer("can", store, "/c", "request", "/add", "--at", AT, "--profile", "spec")
    flat = " ".join(out.split())
    assert "some peer accepts what is asked from whoever holds the enclave's keys and skips its own checks." in flat


@pytest.mark.parametrize(
    ("profile", "topic", "told"),
    [
        ("cyclonedds-11", "/x", True),
        ("cyclonedds-11", "/chatter", False),
        ("fastdds-3.6", "/x", False),
    ],
)
def test_what_peers_refuse_is_said_to_rest_on_what_attackers_announce(
    profile: str, topic: str, told: bool, tmp_path: Path
) -> None:
    """Cyclone DDS asks for no permissions of an endpoint that is not announced as under access control."""
    store = keystore(tmp_path / "k", {"/c": (rule(publish=("rt/chatter",)),)})
    _code, out = answer("can", store, "/c", "publish", topic, "--at", AT, "--profile", profile)
    said = " ".join(out.split())
    assert ("HOLDS IF peers announce endpoints truthfully (Cyclone DDS does not check)" in said) == told
    assert ("authorities issued no other certificates" in said) == (topic == "/x")


@pytest.mark.parametrize(
    ("governed", "code", "says"),
    [
        ("<id>42</id>", 2, "Its governance covers domain 42; this is about 0"),
        ("<id>42</id><id>7</id>", 2, "Its governance covers domain 7, 42; this is about 0"),
        (
            "<id_range><min>0</min><max>9</max></id_range><id>10</id>",
            0,
            "Its governance covers domain 0-10; this is about 0",
        ),
        ("<id>0</id>", 0, ""),
    ],
)
def test_without_a_domain_it_is_about_domain_0_and_says_where_others_are_governed(
    governed: str, code: int, says: str, tmp_path: Path
) -> None:
    """A denial that only says that nobody is in a domain is none to rely on."""
    governance = GOVERNANCE.replace(b"<id>0</id>", governed.encode())
    store = keystore(
        tmp_path / "k", {"/c": (rule(publish=("rt/x",)).replace("<id>0</id>", "<id>42</id>"),)}, governance=governance
    )
    words = (store, "/c", "publish", "/x", "--at", AT)
    assert answer("can", *words, "--effective", "--expect", "deny")[0] == code
    assert answer("can", *words, "--effective", "--expect", "deny", "--domain", "0")[0] == 0
    assert decisions(store, "/c", "publish", "/x")[1]["domain"] == 0
    (tmp_path / "queries").write_bytes(b"/c\tpublish\trt/x\n")
    assert json.loads(answer("can", store, "--batch", tmp_path / "queries", "--at", AT)[1])["domain"] == 0
    _code, out = answer("can", *words)
    assert out.startswith(f"May /c publish /x? (domain 0, at {AT})\n")
    assert says in " ".join(out.split())
    assert ("ts governance covers" in out) is bool(says)
    assert "ts governance covers" not in answer("can", *words, "--domain", "0")[1]


def test_the_domains_are_those_of_the_enclave_s_own_governance(tmp_path: Path) -> None:
    """What is governed for others does not make a denial in domain 0 one to rely on."""
    store = keystore(tmp_path / "k", {"/c": (rule(publish=("rt/x",)),), "/other": (rule(publish=("rt/x",)),)})
    alien = keystore(tmp_path / "a", {"/c": ()}, governance=GOVERNANCE.replace(b"<id>0</id>", b"<id>42</id>"))
    (store / "enclaves/c/governance.p7s").write_bytes((alien / "enclaves/c/governance.p7s").read_bytes())
    assert answer("can", store, "/c", "publish", "/x", "--at", AT, "--expect", "deny")[0] == 2
    assert answer("can", store, "/other", "publish", "/x", "--at", AT, "--expect", "deny")[0] == 1


def test_a_line_that_allows_it_comes_not_later_than_the_governance(tmp_path: Path) -> None:
    """Where the governance decides, no rule of the grant is asked, first or later."""
    governance = GOVERNANCE.replace(b"<topic_expression>*<", b"<topic_expression>rt/b<")
    store = keystore(tmp_path / "k", {"/c": (rule(publish=("rt/a",)),)}, governance=governance)
    _code, document = decisions(store, "/c", "publish", "/a", "--profile", "spec")
    (only,) = document["decisions"].values()
    assert only["reason"].startswith("no topic rule of the governance covers the topic")
    assert "later" not in only["reason"]


@pytest.mark.parametrize(
    ("listed", "domain", "says"),
    [
        ("rt/a", 0, "Line 16 (rt/a) allows it in another partition"),
        ("rt/*", 0, "Line 16 (rt/*) allows it in another partition"),
        ("rt/a", 5, "Line 16 (rt/a) allows it in another partition of domain 5"),
        ("rt/ab", 5, "The nearest that may be published is 'rt/ab' (line 16)"),
    ],
)
def test_a_line_that_allows_it_in_another_partition(listed: str, domain: int, says: str, tmp_path: Path) -> None:
    lab = rule(publish=(listed,), partition="lab").replace("<id>0<", f"<id>{domain}<")
    store = keystore(tmp_path / "k", {"/c": (rule(publish=("rt/other",)), lab)})
    _code, document = decisions(store, "/c", "publish", "/a", "--profile", "spec")
    (only,) = document["decisions"].values()
    assert only["reason"].partition(". ")[2] == says


CRITERIA = {name: pubsub("rt/a", partitions=name.split()) for name in ("p", "q", "p q", "*")}


@pytest.mark.parametrize(
    ("rules", "alone", "together"),
    [
        ((allow(CRITERIA["p q"]),), "", ""),
        ((allow(CRITERIA["*"]),), "", ""),
        ((allow(CRITERIA["p"], CRITERIA["q"]),), "", "spec cyclonedds-0.10 cyclonedds-11 opendds"),
        ((allow(CRITERIA["p"]), allow(CRITERIA["q"])), "", "all"),
        ((allow(CRITERIA["p"]),), "", "all"),
        ((deny(CRITERIA["q"]), allow(CRITERIA["*"])), "fastdds-2.9 cyclonedds-0.10 cyclonedds-11", "all"),
        ((allow(CRITERIA["p q"]), deny(CRITERIA["q"])), "", ""),
    ],
)
def test_an_endpoint_in_several_partitions_at_once(
    rules: tuple[str, ...], alone: str, together: str, tmp_path: Path
) -> None:
    """One criterion has to allow all of them, on Fast DDS one rule; a denial of any is enough. Who denies is named."""
    store = keystore(tmp_path / "k", {"/c": rules})
    profiles = ("spec", "fastdds-2.9", "cyclonedds-0.10", "cyclonedds-11", "opendds")
    asked = ("/c", "publish", "/a", *(word for each in profiles for word in ("--profile", each)), "--partition", "p")
    for partitions, denied in (((), alone), (("--partition", "q"), together)):
        _code, document = decisions(store, *asked, *partitions)
        usable = {name: each for name, each in document["decisions"].items() if each["usable"]}
        denying = usable if denied == "all" else denied.split()
        assert [name for name, each in usable.items() if each["decision"] == DENY] == [
            name for name in usable if name in denying
        ]
        assert document["partition"] == (["p", "q"] if partitions else "p")


def test_what_was_not_measured_of_several_partitions_is_not_told(tmp_path: Path) -> None:
    """Of OpenDDS an endpoint in the default partition and in another."""
    documents = {"/c": document_of(grant_of("/c", allow(CRITERIA["*"])))}
    store = signed_keystore(tmp_path / "k", documents, governance=governance(domain_rule(join=False)).encode())
    for partitions, decided in ((("", "p"), UNKNOWN), (("p", "q"), ALLOW)):
        words = [word for each in partitions for word in ("--partition", each)]
        _code, document = decisions(store, "/c", "publish", "/a", "--profile", "opendds", *words)
        assert document["decisions"]["opendds"]["decision"] == decided


@pytest.mark.parametrize(
    ("denied", "decided"),
    [(pubsub("rt/a", partitions=("p",)), DENY), (criterion("publish", "rt/a", partitions=("p",)), ALLOW)],
)
def test_a_topic_that_is_denied_in_one_partition_is_none_on_cyclone_dds_11(
    denied: str, decided: str, tmp_path: Path
) -> None:
    """Measured on 11.0.1. With a right to subscribe left there is a topic, and the denial is of the partition."""
    store = keystore(tmp_path / "k", {"/c": (deny(denied), allow(CRITERIA["*"]))})
    for partition, expected in (("q", decided), ("p", DENY)):
        _code, document = decisions(
            store, "/c", "publish", "/a", "--profile", "cyclonedds-11", "--profile", "spec", "--partition", partition
        )
        found = {name: each["decision"] for name, each in document["decisions"].items()}
        assert found == {"cyclonedds-11": expected, "spec": ALLOW if partition == "q" else DENY}


def test_the_enclaves_of_a_fleet_do_not_hide_the_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "k"
    shutil.copytree(TURTLESIM, store, symlinks=True)
    for number in range(100):
        (store / f"enclaves/robot{number:03}").mkdir()
        (store / f"enclaves/robot{number:03}/cert.pem").write_bytes(b"")
    assert run(["can", str(store), "/robot1", "publish", "/x"]) == 2
    err = capsys.readouterr().err
    assert "and 74 more." in err
    assert len(err) < 600


def test_hostile_names_steer_no_terminal(tmp_path: Path) -> None:
    store = tmp_path / "k"
    shutil.copytree(TURTLESIM, store, symlinks=True)
    (store / "enclaves/random").rename(store / "enclaves/ran\x1b[31mdom")
    words = ("/ran%1B[31mdom", "publish", "rt/\udcff\u202e\x07", "--kind", "dds", "--partition", "\x1b")
    code, out = answer("can", store, *words, "--at", AT)
    assert code == 1
    assert all(character.isprintable() or character == "\n" for character in out)
    assert r"rt/\udcff\u202e\x07" in out
    _code, document = decisions(store, *words)
    assert document["name"] == "rt/\\udcff\u202e\x07"
    json.dumps(document, ensure_ascii=False).encode()  # no lone surrogate is left


BATCH = (
    b"/random\tpublish\trt/low_priority\n"
    b"\n"
    b"/nobody\tpublish\trt/x\r\n"
    b"/random\tsubscribe\trt/low_priority\t0\tp\tq\n"
    b"/random\tpublish\n"
    b"/random\trequest\t/x\n"
    b"/random\tpublish\trt/\xff\n"
    b"/random\tpublish\trt/x\t233\n"
    b"/random\tpublish\trt/x\t-1\n"
    b"/random\tpublish\t\n"
    b"/random\tpublish\trt/x\t7"
)


def test_batch_answers_every_line_in_order(tmp_path: Path) -> None:
    (tmp_path / "queries").write_bytes(BATCH)
    code, out = answer("can", TURTLESIM, "--batch", tmp_path / "queries", "--at", AT)
    lines = [json.loads(line) for line in out.splitlines()]
    assert code == 4
    assert len(lines) == BATCH.count(b"\n") + 1
    errors = {line["line"]: line["error"] for line in lines if "error" in line}
    assert list(errors) == [2, 3, 5, 6, 7, 8, 9, 10]
    assert all(lines[number - 1] == {"line": number, "error": errors[number]} for number in errors)
    assert "/nobody" in errors[3]
    answered = [line for line in lines if "error" not in line]
    assert [list(line) for line in answered] == [ANSWER_KEYS] * 3
    assert [(line["domain"], line["partition"]) for line in answered] == [(0, ""), (0, ["p", "q"]), (7, "")]


def test_batch_from_standard_input(process: Callable[..., Any]) -> None:
    done = process("can", TURTLESIM, "--batch", "-", "--domain", "7", input=b"/random\tpublish\trt/x\n")
    assert (done.returncode, json.loads(done.stdout)["domain"]) == (0, 7)


ENCLAVES = ("/keyboard", "/multiplexer", "/random", "/turtlesim")
QUERY = st.tuples(
    st.sampled_from(ENCLAVES),
    st.sampled_from(list(Operation)),
    st.sampled_from(["rt/high_priority", "rt/low_priority", "rt/move_turtle", "rt/rosout", "ros_discovery_info", "x"])
    | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\t\n\r"), min_size=1, max_size=6),
    st.sampled_from([0, 7]),
    st.sampled_from(["", "p"]),
)


@settings(max_examples=6)
@given(queries=st.lists(QUERY, min_size=1, max_size=3))
def test_batch_answers_are_those_of_single_questions(
    queries: list[tuple[str, Operation, str, int, str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("batch") / "queries"
    rows = [f"{e}\t{o.value}\t{n}\t{d}\t{p}\n" for e, o, n, d, p in queries]
    file.write_bytes("".join(rows).encode())
    _code, out = answer("can", TURTLESIM, "--batch", file, "--at", AT)
    each = [json.loads(line) for line in out.splitlines()]
    for (enclave, operation, name, domain, partition), line in zip(queries, each, strict=True):
        words = [enclave, operation.value, "--kind", "dds", "--domain", str(domain), f"--partition={partition}"]
        assert decisions(TURTLESIM, *words, "--", name)[1] == line


def together(rulings: set[str]) -> str:
    """What `can` answers of a service or an action whose DDS topics are answered so (design section 5)."""
    if ALLOW in rulings and DENY in rulings:
        return PARTLY
    if UNKNOWN in rulings:
        return UNKNOWN
    return ALLOW if rulings == {ALLOW} else DENY


ROLES = [("request", "/add"), ("reply", "/add"), ("call", "/go"), ("execute", "/go")]
NAMES = st.lists(
    st.sampled_from(["rq/*", "rr/*Reply", "rq/addRequest", "rr/go/_action/*", "rt/go/_action/status", "*"]),
    max_size=2,
).map(tuple)


@settings(max_examples=8)
@given(rules=st.lists(st.tuples(NAMES, NAMES, st.booleans()), min_size=1, max_size=3), role=st.sampled_from(ROLES))
def test_halves_are_what_each_dds_name_is_by_itself(
    rules: list[tuple[tuple[str, ...], tuple[str, ...], bool]],
    role: tuple[str, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    own = tuple(rule(publish, subscribe, allow=allow) for publish, subscribe, allow in rules if publish or subscribe)
    everything = (rule(publish=("*",), subscribe=("*",)),)
    store = keystore(tmp_path_factory.mktemp("can") / "k", {"/c": own, "/s": everything})
    for place in (store, UNREADABLE):
        enclave = "/c" if place == store else "/listener"
        _code, document = decisions(place, enclave, *role)
        singles = [
            decisions(place, enclave, operation.value, "--kind", "dds", "--", name)[1]["decisions"]
            for operation, name in dds_channels(*role)
        ]
        for profile, whole in document["decisions"].items():
            alone = [single[profile] for single in singles]
            for of in ("decision", "effective"):
                assert [half[of] for half in whole["halves"]] == [each[of] for each in alone]
                assert whole[of] == together({each[of] for each in alone})


def test_a_permissions_ca_in_a_form_that_we_do_not_read(tmp_path: Path) -> None:
    """Fast DDS starts with OpenSSL's own form of the certificate (`openssl x509 -trustout`)."""
    store = Path(shutil.copytree(TURTLESIM, tmp_path / "k", symlinks=True))
    words = (store, "/random", "publish", "/low_priority", "--expect", "deny")
    assert answer("can", "--at", AT, *words)[0] == 1
    authority = store / "public/permissions_ca.cert.pem"
    plain = authority.read_bytes()
    for form in (plain.replace(b"CERTIFICATE-----", b"TRUSTED CERTIFICATE-----"), b"\xef\xbb\xbf" + plain):
        authority.write_bytes(form)
        assert answer("can", "--at", AT, *words)[0] == 4
    shutil.copy(store / "public/identity_ca.cert.pem", authority)
    assert answer("can", "--at", AT, *words)[0] == 0


def test_a_document_in_which_another_one_stands(tmp_path: Path) -> None:
    """The other one, which nobody reads, is not in place of the enclave's own."""
    store = Path(shutil.copytree(TURTLESIM, tmp_path / "k", symlinks=True))
    governance = store / "enclaves/governance.p7s"
    message = governance.read_bytes()
    header = next(line for line in message.splitlines(keepends=True) if line.startswith(b"Content-Type"))
    head, preamble, rest = message.partition(b"This is an S/MIME signed message\n\n")
    governance.write_bytes(head + preamble + header + rest)
    code, document = decisions(store, "/random", "publish", "/low_priority", "--profile", "fastdds-2.9")
    [decision] = document["decisions"].values()
    assert (code, decision["decision"], decision["effective"]) == (0, ALLOW, UNKNOWN)


@pytest.mark.parametrize(
    ("profile", "ended", "reason"),
    [
        ("cyclonedds-0.10", 1, "of the grants that name CN=/talker the first alone counts, and it is not in force"),
        ("opendds", 1, "of the grants that name the enclave the first alone counts, and it is not in force"),
        ("cyclonedds-0.10", 2, "no grant in force names CN=/talker"),
        ("fastdds-2.6", 2, "no grant in force names CN=/talker"),
        ("fastdds-2.6", 1, None),
    ],
)
def test_who_goes_by_the_first_grant_says_that_it_is_over(
    profile: str, ended: int, reason: str | None, tmp_path: Path
) -> None:
    """And not that there is none in force; OpenDDS starts by it all the same."""
    ends = ("2025-01-01T00:00:00",) * ended + ("2034-01-01T00:00:00",) * (2 - ended)
    grants = (documents.grant("/talker", allow(pubsub("rt/chatter")), end=end) for end in ends)
    text, loose = documents.permissions(*grants).encode(), governance(domain_rule(join=False)).encode()
    root = signed_keystore(tmp_path, {"/talker": text}, governance=loose)
    code, found = decisions(root, "/talker", "publish", "/chatter", "--profile", profile)
    assert code == int(reason is not None)
    assert (reason or "") in found["decisions"][profile]["reason"]
