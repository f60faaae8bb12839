"""KA7 and KA9: what the engines said, and what became of the audit itself."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit import audit
from keystore_audit.findings import Location, Result, Severity
from keystore_audit.keystore.files import Status as FileStatus
from keystore_audit.model.question import Doubt
from keystore_audit.properties import BY_ID, PROPERTIES, Status
from keystore_audit.properties.result import (
    AssertedResult,
    Counterexample,
    EngineRun,
    EngineStatus,
    ProfileResult,
    PropertyResult,
    Step,
)
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from tests.rules.evidence import absent, context, findings, healthy, judged, laid_out, meaning

EXAMPLE = Counterexample(
    text="/talker may write rt/chatter, which nobody granted it.",
    steps=(
        Step(enclave="/talker", channel="domain 0", witness="rt/chatter", path="enclaves/governance.p7s", line=28),
        Step(enclave=None, channel=None, witness="no place", path=None, line=None),
        Step(enclave="/talker", channel=None, witness="CN=/talker", path="enclaves/talker/cert.pem", line=1),
    ),
)


def answer(
    status: Status, engines: Mapping[str, Status] | None = None, example: Counterexample | None = None
) -> ProfileResult:
    return ProfileResult(
        status=status, engines={"native": status} if engines is None else engines, counterexample=example
    )


def result(prop: str, **profiles: ProfileResult) -> PropertyResult:
    """A property's answers; `_` in a profile's name stands for what no identifier may hold."""
    return PropertyResult(prop=BY_ID[prop], profiles={name.replace("_", "-"): a for name, a in profiles.items()})


def engine(status: EngineStatus, *, required: bool = True) -> EngineRun:
    return EngineRun(name="alloy", version=None, status=status, reason="no jar", required=required)


HOLDS, VIOLATED, UNKNOWN = Status.HOLDS, Status.VIOLATED, Status.UNKNOWN
DOUBT = Doubt(enclave="/talker", location=Location(path="enclaves/talker/cert.pem", line=3), reason="it is odd")

CASES: dict[str, dict[str, Any]] = {
    **{
        rule.code: {"results": (result(rule.name, spec=answer(VIOLATED, example=EXAMPLE)),)}
        for rule in RULES
        if rule.family == "KA7" and rule.name in BY_ID
    },
    "KA740": {
        "results": (
            AssertedResult(
                prop=replace(BY_ID["outsiders-cannot-read"], id="never"),
                profiles={"spec": answer(VIOLATED, example=EXAMPLE)},
                severity=Severity.LOW,
                location=Location(path="keystore-audit.toml", line=3, beside=True),
                forgers=("/a", "/b"),
            ),
        )
    },
    "KA901": {"doubts": (DOUBT,)},
    "KA902": {"engines": (engine(EngineStatus.MISSING, required=False),)},
    "KA903": {"engines": (engine(EngineStatus.FAILED),)},
    "KA904": {
        "results": (result("outsiders-cannot-read", spec=answer(UNKNOWN, {"native": HOLDS, "alloy": VIOLATED})),)
    },
    "KA905": {"at": "no instant"},
    "KA906": {"results": (result("outsiders-cannot-read", spec=answer(UNKNOWN)),)},
    "KA907": {"engines": (engine(EngineStatus.OUT_OF_SCALE, required=False),)},
    "KA908": {"meaning": meaning(over_budget="too many classes")},
}

OPEN = {"KA901", "KA903", "KA904", "KA905", "KA906", "KA908"}


@pytest.mark.parametrize("code", CASES)
def test_one_change_makes_a_rule_speak(code: str) -> None:
    judgement = judged(**CASES[code])
    assert {finding.code for finding in judgement.findings} == {code}
    opened = {o.rule for o in judgement.outcomes if o.outcome is Result.OPEN}
    assert (code in opened) is (code in OPEN)


def test_violated_here_and_undecided_there_are_two_findings() -> None:
    mixed = result("outsiders-cannot-read", spec=answer(UNKNOWN), cyclonedds_11=answer(VIOLATED, example=EXAMPLE))
    judgement = judged(results=(mixed,))
    assert {(f.code, f.profiles) for f in judgement.findings} == {("KA711", ("cyclonedds-11",)), ("KA906", ("spec",))}
    outcomes = {o.rule: o.outcome for o in judgement.outcomes if o.subject == "outsiders-cannot-read"}
    assert outcomes["KA906"] is Result.OPEN


def test_many_properties_that_are_undecided_are_counted_and_not_listed() -> None:
    """Each stands as UNKNOWN among the properties, and what makes the finding is all of them."""
    many = tuple(result(prop.id, spec=answer(UNKNOWN)) for prop in PROPERTIES[:7])
    (one,), (fewer,) = (findings("KA906", judged(results=each)) for each in (many, many[:6]))
    named = ", ".join(each.prop.id for each in many[:5])
    assert one.message == f"7 properties are undecided, since no engine gave an answer: {named} and 2 more."
    assert one.fingerprint != fewer.fingerprint


@pytest.mark.parametrize("required", [True, False])
@pytest.mark.parametrize("status", list(EngineStatus))
def test_what_becomes_of_an_engine(status: EngineStatus, required: bool) -> None:
    judgement = judged(engines=(engine(status, required=required),))
    found = {finding.code for finding in judgement.findings}
    opened = any(outcome.outcome is Result.OPEN for outcome in judgement.outcomes)
    failed = status in (EngineStatus.FAILED, EngineStatus.TIMEOUT)
    absent_ = status in (EngineStatus.MISSING, EngineStatus.NOT_RUN) and required
    assert ("KA903" in found) is (failed or absent_)
    assert ("KA902" in found) is (status is EngineStatus.MISSING and not required)
    assert ("KA907" in found) is (status is EngineStatus.OUT_OF_SCALE)
    assert opened is (failed or absent_ or (status is EngineStatus.OUT_OF_SCALE and required))
    assert len(found) <= 1


def test_nothing_to_run_is_told_once() -> None:
    judgement = judged(
        meaning=meaning(over_budget="too many classes"), engines=(engine(EngineStatus.NOT_RUN, required=True),)
    )
    assert {finding.code for finding in judgement.findings} == {"KA908"}


# Doubts


def test_a_doubt_is_told_where_no_other_finding_leaves_its_place_open() -> None:
    link = absent("enclaves/more", FileStatus.DIRECTORY, "to /opt")
    doubt = Doubt(enclave=None, location=Location(path="enclaves/more"), reason="to /opt")
    store = laid_out(directory_links=(link,))(healthy())
    assert {finding.code for finding in judged(store, doubts=(doubt, DOUBT)).findings} == {"KA104", "KA901"}
    assert len(findings("KA901", judged(store, doubts=(doubt, DOUBT)))) == 1


def test_a_doubt_speaks_when_its_finding_is_ignored() -> None:
    link = absent("enclaves/more", FileStatus.DIRECTORY, "to /opt")
    doubt = Doubt(enclave=None, location=Location(path="enclaves/more"), reason="to /opt")
    case = context(laid_out(directory_links=(link,))(healthy()), doubts=(doubt,))
    judgement = judge(case, RULES, ignore=["KA104", "KA901"])
    assert [finding.code for finding in judgement.findings] == ["KA901"]
    assert any(outcome.outcome is Result.OPEN for outcome in judgement.outcomes)


@pytest.mark.parametrize(("zone", "told"), [(None, [("fastdds-2.6",)] * 2), ("Europe/Berlin", [])])
def test_a_grant_that_begins_today_is_open_under_fastdds_until_the_zone_is_said(
    zone: str | None, told: list[tuple[str, ...]], repository: Path
) -> None:
    """Its holder need not be told to change a form that is right; whom it does not concern is not named."""
    store = repository / "sample_keystores/healthy/talker_listener"
    at = datetime(2020, 1, 1, 3, tzinfo=timezone.utc)
    report = audit(store, at=at, profiles=["humble"], engine="native", time_zone=zone)
    open_now = [finding for finding in report.findings if finding.code == "KA901"]
    assert [finding.profiles for finding in open_now] == told
    assert all("`--time-zone" in finding.fix.text for finding in open_now)


def test_a_property_that_nobody_answered_is_undecided() -> None:
    empty = PropertyResult(prop=PROPERTIES[0], profiles={})
    unanswered = result(PROPERTIES[0].id, spec=answer(UNKNOWN, {}))
    for one in (empty, unanswered):
        found = judged(results=(one,)).findings
        assert [finding.code for finding in found] == ["KA906"]
        assert "no engine gave an answer" in found[0].message


@pytest.mark.parametrize("status", [HOLDS, UNKNOWN])
def test_an_asserted_property_that_is_not_violated_is_no_finding_of_its_own(status: Status) -> None:
    (asserted,) = CASES["KA740"]["results"]
    judgement = judged(results=(replace(asserted, profiles={"spec": answer(status)}),))
    assert {finding.code for finding in judgement.findings} == ({"KA906"} if status is UNKNOWN else set())
