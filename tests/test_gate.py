"""The gate: what was not decided makes an audit incomplete, which outranks all else; and until when a pass holds."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.engine.horizon import Horizon
from keystore_audit.findings import Location, Severity, Suppressed
from keystore_audit.gate import complete, verdict, while_accepted
from keystore_audit.model.question import Doubt
from keystore_audit.properties import Status
from keystore_audit.properties.result import EngineStatus
from keystore_audit.report.content import Verdict
from keystore_audit.rules.judge import judge
from tests.rules.evidence import AT, DAY, context, meaning
from tests.rules.test_accepted_rules import finding
from tests.rules.test_formal_and_audit_rules import answer, engine, result
from tests.rules.test_judge import made

VIOLATED = result("outsiders-cannot-read", spec=answer(Status.VIOLATED))
DECIDED: dict[str, Any] = {
    "results": (VIOLATED,),
    "engines": (engine(EngineStatus.OK), engine(EngineStatus.MISSING, required=False)),
    "meaning": meaning(),
}
UNDECIDED: dict[str, dict[str, Any]] = {
    "nothing was asked": {"results": ()},
    "an answer is unknown": {
        "results": (VIOLATED, result("readers-cannot-forge", spec=answer(Status.UNKNOWN))),
    },
    "an engine is missing": {"engines": (engine(EngineStatus.OK), engine(EngineStatus.MISSING))},
    "a file was not read": {
        "meaning": meaning(doubts=(Doubt(enclave=None, location=Location(path="a"), reason="b"),)),
    },
    "there is too much": {"meaning": meaning(over_budget="There are too many names.")},
}


def test_what_was_decided_is_complete() -> None:
    decided = context(**DECIDED)
    assert complete(decided, judge(decided, [made("KA101")]))


@pytest.mark.parametrize("way", UNDECIDED)
def test_each_way_to_leave_something_open_counts_though_no_rule_speaks_of_it(way: str) -> None:
    """With real keystores some rule does, so that no sample shows it."""
    undecided = context(**DECIDED | UNDECIDED[way])
    assert not complete(undecided, judge(undecided, []))


def test_a_rule_that_leaves_something_open_counts_though_all_else_is_decided() -> None:
    decided = context(**DECIDED)
    assert not complete(decided, judge(decided, [made("KA101", error=ValueError())]))


@pytest.mark.parametrize(
    ("severity", "fail_on", "is_complete", "expected"),
    [
        (Severity.HIGH, Severity.HIGH, True, (Verdict.FAIL, 1)),
        (Severity.MEDIUM, Severity.HIGH, True, (Verdict.PASS, 0)),
        (Severity.CRITICAL, None, True, (Verdict.PASS, 0)),
        (Severity.HIGH, Severity.HIGH, False, (Verdict.INCOMPLETE, 4)),
        (Severity.MEDIUM, Severity.HIGH, False, (Verdict.INCOMPLETE, 4)),
        (Severity.CRITICAL, None, False, (Verdict.INCOMPLETE, 4)),
    ],
)
def test_incomplete_outranks_fail_and_pass(
    severity: Severity, fail_on: Severity | None, is_complete: bool, expected: tuple[Verdict, int]
) -> None:
    assert verdict([finding(severity=severity)], fail_on, complete=is_complete) == expected


ACCEPTED = Suppressed(reason="so", until=f"{AT:%Y-%m-%d}", owner="Ada", source="a.toml:1:1")
ENDS = AT.replace(hour=0) + DAY


@pytest.mark.parametrize(
    ("severity", "fail_on", "safe", "expected"),
    [
        (Severity.HIGH, Severity.HIGH, None, ENDS),
        (Severity.HIGH, Severity.HIGH, ENDS + timedelta(seconds=1), ENDS),
        (Severity.HIGH, Severity.HIGH, ENDS - timedelta(seconds=1), ENDS - timedelta(seconds=1)),
        (Severity.MEDIUM, Severity.HIGH, None, None),
        (Severity.HIGH, None, None, None),
    ],
)
def test_a_pass_ends_with_what_is_accepted_where_that_would_fail_it(
    severity: Severity, fail_on: Severity | None, safe: datetime | None, expected: datetime | None
) -> None:
    judgement = replace(judge(context(), []), findings=(finding(severity=severity, suppressed=ACCEPTED),))
    found = while_accepted(Horizon(instant=safe, why="a list ends"), judgement, fail_on)
    assert found.instant == expected
    assert found.why == ("a list ends" if expected == safe else "a finding that is accepted until then counts again")
