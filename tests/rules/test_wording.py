"""How findings say it: number and colon are right, and nothing is said twice."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

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
