"""How findings say it: number and colon are right, and nothing is said twice."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import toml
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.rules.registry import defective
from keystore_audit.text import counted
from tests.cli.keystores import answer

SAMPLES = Path(__file__).parents[2] / "sample_keystores"


@cache
def found(code: str) -> dict[str, Any]:
    """The finding of the rule in its own sample."""
    (root,) = SAMPLES.glob(f"rules/{code}-*/bad")
    expected = toml.loads(root.with_suffix(".toml").read_text("utf-8"))
    options = [str(SAMPLES / word) if (SAMPLES / word).is_file() else word for word in expected["options"]]
    _exit_code, report = answer(
        "audit", root, "--engine", "native", "--format", "json", "--at", expected["at"], *options
    )
    first, *_ = (finding for finding in json.loads(report)["findings"] if finding["code"] == code)
    return dict(first)


def defects(*details: str) -> tuple[Defect, ...]:
    return tuple(Defect(kind=Kind.UNSIGNED_TEXT, path="p", line=n, detail=each) for n, each in enumerate(details, 1))


def test_what_one_defect_is_stands_in_the_message_and_not_at_its_place_too() -> None:
    (one,) = defective(defects("text at 1"), "nobody reads it.")
    assert (one.message, [place.message for place in one.locations]) == ("Text at 1: nobody reads it.", [""])
    (several,) = defective(defects("text at 1", "text at 2"), "nobody reads it.")
    assert [place.message for place in several.locations] == ["text at 1", "text at 2"]
    (twice,) = defective(defects("the same", "the same"), "nobody reads it.")
    assert [(place.line, place.message) for place in twice.locations] == [(1, ""), (2, "")]


def test_a_colon_in_what_is_wrong_is_the_only_one() -> None:
    (one,) = defective(defects("one value: two readings"), "who reads it decides.")
    assert one.message == "One value: two readings; who reads it decides."


def test_things_are_counted_in_their_number() -> None:
    found = [counted(number, "entry", "entries") for number in (0, 1, 1200)]
    assert found == ["0 entries", "1 entry", "1,200 entries"]


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("KA217", "has a key that the specification does not name and Cyclone DDS refuses: got EC secp384r1"),
        ("KA228", "is certified once more: 'CN=/admin', issued by 'CN=identityCA'."),
        ("KA306", "run times accept it: it is not interpreted here, since parsers may read it differently."),
        ("KA308", "no DDS implementation reads: who reviews the file may take it for signed."),
        ("KA312", "readers take either; which of the two counts depends on who reads."),
        ("KA609", "Cyclone DDS and OpenDDS: nothing): peers let /talker subscribe to /camera (topic)"),
        ("KA612", "; there alone /talker may publish /chatter (topic) in domain 0."),
        ("KA632", "/talker may set parameters of the node /listener in the enclave /listener (set_parameters)."),
        ("KA636", "nodes fail unless they are told to do without."),
        ("KA645", "cannot be told (a comment inside the value of <topic>: Fast DDS"),
        ("KA650", "The node /talker publishes /chatter, and its enclave /talker may not: "),
        ("KA654", "a package is installed. Nodes may need more than"),
        ("KA655", "'false': there is no security unless the value is exactly 'true'."),
    ],
)
def test_a_finding_reads_as_a_sentence(code: str, says: str) -> None:
    assert says in found(code)["message"]


def test_what_is_wrong_with_an_expression_is_said_once() -> None:
    message = found("KA611")["message"]
    assert message.count("has a [ that nothing closes") == 1
    assert "(Lyrical, Rolling)) and which Cyclone DDS never matches (Cyclone DDS 0.10" in message


def test_clauses_say_what_they_rest_on() -> None:
    assert "rmw_zenoh" in found("KA676")["clause"]
    assert found("KA602")["clause"].endswith("others as docs/profiles.md tells")
    assert found("KA506")["fix"]["steps"][0]["text"] == "Wait until then, or let the grant begin earlier."
