"""`access`: the table says what `can` says, for a slice of the samples, in every format."""

from __future__ import annotations

import csv
import json
import shutil
from datetime import datetime, timezone
from functools import lru_cache
from io import StringIO
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit import toml
from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.question import Question
from keystore_audit.profiles import DEFAULT, VARIANTS, resolve
from tests.cli.keystores import AT, answer, keystore, rule
from tests.schemas import schema
from tests.test_samples import EXPECTATIONS, SAMPLES, name

NOON = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)


def instant(expectation: Path) -> str:
    at: str = toml.loads(expectation.read_text("utf-8"))["at"]
    return at


def listed(document: dict[str, Any]) -> dict[tuple[str, str, str, str, str], tuple[str, str]]:
    """Every answer of the table: (profile, enclave, operation, topic, partition) to (decision, effective)."""
    found = {}
    for group in document["groups"]:
        for profile, enclave in product(group["profiles"], group["enclaves"]):
            for (operation, pair), named in product(enclave["otherwise"].items(), document["names"]):
                key = (profile, enclave["path"], operation, named["topic"], named["partition"])
                found[key] = (pair["decision"], pair["effective"])
        for profile, right in product(group["profiles"], group["rights"]):
            key = (profile, right["enclave"], right["operation"], right["topic"], right["partition"])
            assert found[key] != (right["decision"], right["effective"]), "listed though nothing else holds"
            found[key] = (right["decision"], right["effective"])
    return found


@pytest.mark.parametrize("expectation", EXPECTATIONS[::9], ids=name)
def test_the_table_of_a_sample_is_what_single_answers_are(expectation: Path) -> None:
    """Other code on the way: bit sets over all names there, one decision about one name here."""
    store, at = expectation.with_suffix(""), instant(expectation)
    code, out = answer("access", store, "-f", "json", "--at", at)
    assert out.isascii()
    document = json.loads(out)
    schema("access").validate(document)
    assert all(len(group["protection"]) == len(document["names"]) for group in document["groups"])
    found = listed(document)
    assert code == (EXIT_INCOMPLETE if any("unknown" in pair for pair in found.values()) else 0)
    assert document["complete"] is (code == 0)
    asked = {
        (enclave["path"], operation, named["topic"], named["partition"]): Question(
            enclave=enclave["path"],
            operation=operation,
            topic=named["topic"],
            partitions=(named["partition"],),
            domain=document["domain"],
        )
        for enclave, operation, named in product(document["groups"][0]["enclaves"], Operation, document["names"])
        if named["one"] or named["ros"]  # of the other classes some names cannot be created on Cyclone DDS
    }
    instant_ = datetime.fromisoformat(at.replace("Z", "+00:00"))
    access = Access(store, list(asked.values()), Circumstances(profiles=resolve([]), at=instant_))
    for (path, operation, topic, partition), question in asked.items():
        for profile, single in access.answers(question).items():
            in_table = found[profile, path, operation.value, topic, partition]
            assert in_table == (single.decided, single.accepted), (profile, question)
    _assert_text_and_csv_say_it(store, at, code, document["groups"])


def _assert_text_and_csv_say_it(store: Path, at: str, json_code: int, groups: list[dict[str, Any]]) -> None:
    code, text = answer("access", store, "--at", at)
    assert text.startswith("Who may do what in ")
    assert max(map(len, text.splitlines())) <= 80
    assert all(character.isprintable() or character == "\n" for character in text)
    assert "\n\n\n" not in text
    csv_code, rows = answer("access", store, "--at", at, "-f", "csv")
    assert f", at {at} Assumed: " in " ".join(text.split())
    assert code == csv_code == json_code
    header, *table = csv.reader(StringIO(rows, newline=""))
    assert header == [
        "profiles", "enclave", "usable", "operation", "name", "topic", "partition", "decision", "effective",
    ]  # fmt: skip
    assert len([row for row in table if row[4] != "any other name" or row[5]]) == sum(len(g["rights"]) for g in groups)
    for profiles in (group["profiles"] for group in groups):
        assert profiles == [each for each in VARIANTS if each in profiles] != []


def matrix(*args: str | Path) -> dict[str, list[str]]:
    """The rows of the text: label to cells, of the first matrix."""
    _code, out = answer("access", *args, "--at", AT)
    lines = out.splitlines()
    start = next(number for number, line in enumerate(lines) if line.strip().startswith("[1]") and line[0] == " ")
    columns = [place for place, character in enumerate(lines[start]) if character == "["]
    rows = {}
    for line in lines[start + 1 :]:
        if not line.startswith("  ") or not line.strip():
            break
        ends = [*columns[1:], None]
        rows[line[: columns[0]].strip()] = [line[a:b].strip() for a, b in zip(columns, ends, strict=True)]
    return rows


CALL = (rule(("rq/addRequest",), ("rr/addReply",)),)


def test_a_service_is_one_row_only_where_all_of_it_is_allowed(tmp_path: Path) -> None:
    store = keystore(
        tmp_path / "k",
        {
            "/client": CALL,
            "/server": (rule(("rr/addReply",), ("rq/addRequest",)),),
            "/half": (rule(("rq/addRequest",)),),
            "/more": (rule(("rq/addRequest", "rr/addReply"), ("rr/addReply",)),),
        },
    )
    assert matrix(store) == {
        "/add (service)": ["req", "", "req", "rep"],
        "/add (service request)": ["", "pub", "", ""],
        "/add (service reply)": ["", "", "pub", ""],
    }


def test_exceptions_to_an_expression_have_rows_though_nobody_has_the_right(tmp_path: Path) -> None:
    rules = (rule(("rt/secret", "rt/s/*"), allow=False), rule(("rt/*",)))
    rows = matrix(keystore(tmp_path / "k", {"/talker": rules}), "--profile", "spec")
    assert rows["/secret"] == [""]
    assert rows["/*, e.g. /a"] == ["pub"]
    assert [cells for label, cells in rows.items() if label.startswith("/s/*")] == [[""]]


def test_every_service_by_expression_is_one_row(tmp_path: Path) -> None:
    rules = (rule(("rq/*Request",), ("rr/*Reply",)), rule(("rq/stop*Request",)))
    rows = matrix(keystore(tmp_path / "k", {"/client": rules}), "--profile", "spec")
    assert rows["/* (any service)"] == ["req"]


def test_names_that_ros_has_not_are_marked(tmp_path: Path) -> None:
    rows = matrix(keystore(tmp_path / "k", {"/talker": (rule(("plain", "rt/chatter")),)}))
    assert rows == {'"plain" (not in ROS 2)': ["pub"], "/chatter": ["pub"]}


def test_an_expression_for_a_few_names_is_no_name(tmp_path: Path) -> None:
    store = keystore(tmp_path / "k", {"/talker": (rule(("rt/camera[12]",)),)})
    rows = matrix(store, "--profile", "spec")
    assert rows == {"/camera[12], e.g. /camera1": ["pub"]}


def test_partitions_are_told(tmp_path: Path) -> None:
    rows = matrix(keystore(tmp_path / "k", {"/talker": (rule(("rt/chatter",), partition="left"),)}))
    assert rows == {"/chatter in partition 'left'": ["pub"]}


def test_implementations_differ_in_what_only_one_allows(tmp_path: Path) -> None:
    """Fast DDS stops at the first rule about a topic. What all allow is not told, in however many rows it stands."""
    rules = (rule((), ("rt/parameter_events",)), rule((), ("*",), partition="p"))
    _code, out = answer("access", keystore(tmp_path / "k", {"/talker": rules}), "--at", AT)
    told = out.split("Different under")[1].split("Under all")[0]
    assert "/talker: may also subscribe /parameter_events in partition 'p'." in " ".join(told.split())


def test_names_that_are_the_same_when_cut_stand_in_full(tmp_path: Path) -> None:
    long = [f"rt/robot/sensors/front/{side}/camera/image_raw/compressed" for side in ("left", "right", "upper")]
    code, out = answer("access", keystore(tmp_path / "k", {"/eyes": (rule(tuple(long)),)}), "--at", AT)
    lines = out.splitlines()
    assert code == 0
    for each in long:
        assert lines[lines.index(f"  {each[2:]}") + 1].split() == ["pub"]
    _code, out = answer("access", keystore(tmp_path / "one", {"/eyes": (rule(tuple(long[:1])),)}), "--at", AT)
    assert "…" in out


def test_enclaves_that_may_do_the_same_are_one_column(tmp_path: Path) -> None:
    robots = [f"/robot{number}/arm" for number in range(14)]
    store = keystore(tmp_path / "k", {path: (rule((f"rt{path}/state", "rt/rosout")),) for path in robots})
    code, out = answer("access", store, "--at", AT)
    assert code == 0
    assert matrix(store) == {"~/state": ["pub"], "/rosout": ["pub"]}
    assert all(path in out for path in robots)
    assert len(out.splitlines()) < 30


def test_who_does_not_start_is_said(tmp_path: Path) -> None:
    store = keystore(tmp_path / "k", {"/a": (rule(("rt/x",)),), "/b": (rule(("rt/x",)),)})
    (store / "enclaves/b/key.pem").unlink()
    code, out = answer("access", store, "--at", AT)
    assert code == 0
    assert "] /b: DOES NOT START (key: " in out
    assert matrix(store)["/x"] == ["pub", "-"]


def test_what_peers_accept_elsewhere_is_said_in_place_of_what_stands_below(tmp_path: Path) -> None:
    """Whoever holds an identity of the one CA signs itself anything under Cyclone DDS 0.10, and nothing elsewhere."""
    store = tmp_path / "k"
    shutil.copytree(SAMPLES / "stock/talker_listener", store, symlinks=True)
    shutil.copy(store / "enclaves/talker/key.pem", store / "enclaves/listener/key.pem")
    _code, out = answer("access", store, "--at", AT, "--profile", "spec", "--profile", "cyclonedds-0.10")
    flat = " ".join(out.split())
    assert (
        "The notes under the table about peers do not apply here; these do: If compromised, /listener can do this too"
        in flat
    )
    assert (
        flat.count("every enclave can do this too, and peers do not stop it: publish, subscribe, relay every topic.")
        == 1
    )


def test_hostile_names(tmp_path: Path) -> None:
    topics = ("=1+1", "@cmd", "rt/\u00e9", 'a","x', "<b>a</b>")
    store = keystore(tmp_path / "k", {"/talker": (rule(topics),)})
    args = ("access", store, "--at", AT, "--profile", "spec")
    _code, text = answer(*args)
    assert all(character.isprintable() or character == "\n" for character in text)
    assert '"<b>a</b>" (not in ROS 2)' in text
    _code, cells = answer(*args, "-f", "csv")
    table = list(csv.reader(StringIO(cells, newline="")))
    assert not [cell for row in table for cell in row if cell[:1] in {"=", "+", "-", "@"}]
    assert {"'=1+1", "'@cmd", 'a","x'} <= {row[5] for row in table}
    _code, document = answer(*args, "-f", "json")
    assert {*topics} <= {named["topic"] for named in json.loads(document)["names"]}


def test_names_that_a_process_reads_in_its_locale_are_unknown(tmp_path: Path) -> None:
    """Whether `?` takes a character or an octet, Fast DDS and Cyclone DDS leave to others."""
    store = keystore(tmp_path / "k", {"/talker": (rule(("rt/?", "rt/\u00e9")),)})
    flat = " ".join(answer("access", store, "--at", AT)[1].split())
    assert 'whether peers accept this from /talker: publish "rt/é"; subscribe "rt/é"; relay "rt/é".' in flat
    found = listed(json.loads(answer("access", store, "--at", AT, "-f", "json")[1]))
    rulings = {profile: found[profile, "/talker", "publish", "rt/\u00e9", ""] for profile in DEFAULT}
    assert {profile for profile, pair in rulings.items() if pair == ("unknown", "unknown")} == {*DEFAULT} - {"spec"}
    assert rulings["spec"] == ("allow", "allow")
    code, document = answer("can", store, "/talker", "publish", "rt/\u00e9", "--kind", "dds", "-f", "json", "--at", AT)
    decisions = json.loads(document)["decisions"]
    assert code == 4
    assert {profile: (each["decision"], each["effective"]) for profile, each in decisions.items()} == rulings


TOPIC = st.sampled_from(["rt/a", "rt/b", "rt/*", "rt/a*", "rt/[!a]", "x", "*", "rq/sRequest", "rr/sReply"])
RULE = st.builds(
    rule,
    st.lists(TOPIC, max_size=2).map(tuple),
    st.lists(TOPIC, min_size=1, max_size=2).map(tuple),
    allow=st.booleans(),
    partition=st.sampled_from(["", "p", "p*"]),
)


@lru_cache(maxsize=1)
def _names() -> tuple[str, ...]:
    return ("rt/a", "rt/b", "rt/ab", "rt/c", "x", "y", "rq/sRequest", "rr/sReply", "rt/long_name")


@settings(max_examples=20)
@given(rules=st.lists(RULE, max_size=3), other=st.lists(RULE, max_size=2), default=st.sampled_from(["DENY", "ALLOW"]))
def test_text_hides_no_right(
    rules: list[str], other: list[str], default: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Every name and partition asked one by one: where something is allowed, some row of the table says so."""
    root = tmp_path_factory.mktemp("random")
    store = keystore(root / "k", {"/e": tuple(rules), "/f": tuple(other)}, default=default)
    asked = [
        Question(enclave=enclave, operation=operation, topic=topic, partitions=(partition,))
        for enclave, operation, topic, partition in product(("/e", "/f"), Operation, _names(), ("", "p", "q"))
    ]
    profile = resolve(["spec"])
    access = Access(store, asked, Circumstances(profiles=profile, at=NOON))
    code, out = answer("access", store, "--at", AT, "-f", "json", "--profile", "spec")
    document = json.loads(out)
    found = listed(document)
    by_name = {(named["topic"], named["partition"]): named for named in document["names"]}
    allowed: set[tuple[str, str]] = set()
    for question in asked:
        single = access.answers(question)["spec"]
        if single.decided == "allow":
            allowed.add((question.enclave, question.operation.value))
        if question.point in by_name:
            key = ("spec", question.enclave, question.operation.value, *question.point)
            assert found[key] == (single.decided, single.accepted)
    assert code == 0
    in_table = {(path, operation) for (_p, path, operation, _t, _q), pair in found.items() if pair[0] == "allow"}
    assert allowed <= in_table
