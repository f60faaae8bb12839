"""What every rule has to have."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from keystore_audit.findings import FixKind, Severity, decision
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.result import PropertyResult
from keystore_audit.rules import BY_CODE, RULES
from keystore_audit.rules.registry import Context, Rule, Violation, rule

CATALOGUE = {
    "KA1": range(101, 123),
    "KA2": range(201, 232),
    "KA3": range(301, 318),
    "KA4": range(401, 424),
    "KA5": range(501, 523),
    "KA6": (*range(601, 628), *range(630, 639), *range(640, 647), *range(650, 656), *range(660, 664), *range(665, 678)),
    "KA7": (*range(701, 708), *range(711, 716), *range(721, 726), 731, 740, 741, 742),
    "KA8": (*range(801, 819), *range(820, 829), 835, 836),
    "KA9": range(901, 911),
}


def test_every_code_of_the_catalogue_is_there_in_order() -> None:
    expected = [f"KA{number}" for family in CATALOGUE.values() for number in family]
    assert [r.code for r in RULES] == expected
    assert list(BY_CODE) == expected
    assert len({r.name for r in RULES}) == len(RULES)


@pytest.mark.parametrize("one", RULES, ids=lambda one: one.code)
def test_every_rule_says_what_why_and_what_to_do(one: Rule[Any]) -> None:
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", one.name)
    assert one.description.partition("\n")[0].endswith((".", ":"))
    assert len(one.description) > 60
    assert one.clause.strip()
    assert not one.clause.endswith(".")
    assert all(step.text.endswith(".") for step in one.remedy.steps)
    assert one.remedy.text.count("`") % 2 == 0
    assert (one.remedy.kind is FixKind.MECHANICAL) <= any(step.act for step in one.remedy.steps)


def test_formal_rules_are_the_properties() -> None:
    formal = [r for r in RULES if r.family == "KA7" and r.on is PropertyResult]
    assert [r.name for r in formal] == [prop.id for prop in PROPERTIES]
    assert [r.clause for r in formal] == [prop.clause for prop in PROPERTIES]


def test_causes_explain_properties_that_exist() -> None:
    known = {prop.id for prop in PROPERTIES}
    assert {name for r in RULES for name in r.explains} <= known
    assert {r.family for r in RULES if r.explains} <= {"KA1", "KA2", "KA3", "KA4", "KA5"}


def test_no_command_is_left_out_of_a_remedy_by_mistake() -> None:
    """Commands stand between backticks, so that a report can set them apart."""
    for r in RULES:
        outside = "".join(r.remedy.text.split("`")[::2])
        assert "openssl " not in outside, r.code
        assert "ros2 security" not in outside, r.code


def required_file_missing(_keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Something."""
    yield from ()


def a_new_name(_keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Something."""
    yield from ()


@pytest.mark.parametrize(("code", "check"), [("KA101", a_new_name), ("KA999", required_file_missing)])
def test_a_code_or_name_that_is_taken_is_refused(
    code: str, check: Callable[[Keystore, Context], Iterator[Violation]]
) -> None:
    with pytest.raises(ValueError, match="registered twice"):
        rule(code, Severity.LOW, clause="x", remedy=decision("x."))(check)


def test_a_rule_without_a_docstring_is_refused() -> None:
    def silent(_keystore: Keystore, _context: Context) -> Iterator[Violation]:
        yield from ()

    with pytest.raises(ValueError, match="no docstring"):
        rule("KA998", Severity.LOW, clause="x", remedy=decision("x."))(silent)
