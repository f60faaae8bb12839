"""What the judge makes of what rules say: order, identity, causes, crashes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.findings import Location, Result, Severity, decision
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.pipeline import audit
from keystore_audit.profiles import VARIANTS, resolve
from keystore_audit.properties import Status
from keystore_audit.properties.result import Counterexample
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import MAX_MESSAGE, judge
from keystore_audit.rules.registry import Context, Rule, Violation
from tests.rules.evidence import (
    allow,
    certificates,
    context,
    domain_rule,
    enclave,
    findings,
    governance,
    grant,
    healthy,
    judged,
    keystore,
    pem,
    permissions,
    talker,
    topic_rule,
)
from tests.rules.test_certificate_rules import one_authority
from tests.rules.test_formal_and_audit_rules import EXAMPLE, answer, result
from tests.test_samples import EXPECTATIONS, SAMPLES, as_built, given_options

SECRET = "-----BEGIN PRIVATE KEY-----MIGHAgEAMBMG"


def made(
    code: str, *violations: Violation, error: Exception | None = None, explains: tuple[str, ...] = ()
) -> Rule[Keystore]:
    """A rule about the keystore that says this, or raises."""

    def check(_keystore: Keystore, _context: Context) -> Iterator[Violation]:
        yield from violations
        if error is not None:
            raise error

    return Rule(
        code=code,
        name=f"rule-{code.lower()}",
        severity=Severity.MEDIUM,
        on=Keystore,
        clause="a clause",
        remedy=decision("Do it."),
        docstring="Why.",
        explains=frozenset(explains),
        check=check,
        applies=lambda _keystore, _context: True,
    )


def says(message: str = "something", path: str | None = "a", line: int | None = 1, **more: Any) -> Violation:
    return Violation(message=message, locations=() if path is None else (Location(path=path, line=line),), **more)


AUDIT = tuple(rule for rule in RULES if rule.family == "KA9")


def test_a_crash_is_a_finding_and_leaves_the_rule_open() -> None:
    judgement = judge(context(), [made("KA101", error=RuntimeError(SECRET)), made("KA102", says()), *AUDIT])
    assert sorted(finding.code for finding in judgement.findings) == ["KA102", "KA905"]
    crash = next(finding for finding in judgement.findings if finding.code == "KA905")
    assert "KA101" in crash.message
    assert "RuntimeError" in crash.message
    assert SECRET not in repr(judgement)
    outcomes = {(o.rule, o.subject): o.outcome for o in judgement.outcomes}
    assert outcomes["KA101", "keystore"] is Result.OPEN
    assert outcomes["KA905", "keystore"] is Result.OPEN
    assert outcomes["KA102", "keystore"] is Result.FAIL


def test_what_a_rule_said_before_it_crashed_does_not_count() -> None:
    judgement = judge(context(), [made("KA101", says(), error=ValueError()), *AUDIT])
    assert [finding.code for finding in judgement.findings] == ["KA905"]


def test_a_crash_while_asking_whether_a_rule_applies_is_a_crash() -> None:
    def raises(_keystore: Keystore, _context: Context) -> bool:
        raise KeyError

    judgement = judge(context(), [replace(made("KA101"), applies=raises), *AUDIT])
    assert [finding.code for finding in judgement.findings] == ["KA905"]


def test_each_crash_is_told_apart() -> None:
    judgement = judge(context(), [made("KA101", error=ValueError()), made("KA102", error=ValueError()), *AUDIT])
    assert len({finding.fingerprint for finding in judgement.findings}) == 2


@pytest.mark.parametrize(
    ("select", "ignore", "kept"),
    [
        ((), (), {"KA101", "KA102", "KA201"}),
        (("KA1",), (), {"KA101", "KA102"}),
        (("KA101", "KA2"), (), {"KA101", "KA201"}),
        ((), ("KA1",), {"KA201"}),
        (("KA1",), ("KA102",), {"KA101"}),
        (("KA",), (), set()),  # no family
        ((), ("KA9", "KA905"), {"KA101", "KA102", "KA201"}),
    ],
)
def test_select_and_ignore_never_leave_out_the_audit_itself(
    select: tuple[str, ...], ignore: tuple[str, ...], kept: set[str]
) -> None:
    rules = [made("KA101"), made("KA102"), made("KA201"), *AUDIT]
    judgement = judge(
        context(results=(result("outsiders-cannot-read", spec=answer(Status.UNKNOWN)),)),
        rules,
        select=select,
        ignore=ignore,
    )
    assert {o.rule for o in judgement.outcomes if not o.rule.startswith("KA9")} == kept
    assert [finding.code for finding in judgement.findings] == ["KA906"]


@given(shift=st.integers(min_value=1, max_value=10_000))
def test_fingerprints_hold_still_when_lines_move(shift: int) -> None:
    """Comments before an element change its line and nothing else."""

    def store(by: int) -> Keystore:
        rule = domain_rule(
            topic_rule("rt/a", enable_write_access_control=False, lines={}, line=30 + by), topic_rule(line=90 + by)
        )
        wild = grant("/talker", allow(["rt/*"]), line=38 + by, default_allow=True, default_line=50 + by)
        return keystore(
            enclave(
                "/talker",
                governance=governance(rule),
                permissions=permissions("enclaves/talker/permissions.p7s", wild),
                certificate=certificates("enclaves/talker/cert.pem", b"\n" * by + pem("/talker", critical="1.2.3")),
            )
        )

    before, after = judged(store(0)).findings, judged(store(shift)).findings
    assert {finding.code for finding in before} == {"KA221", "KA406", "KA509", "KA510"}
    assert [finding.fingerprint for finding in before] == [finding.fingerprint for finding in after]
    assert [finding.locations[0].line for finding in before] != [finding.locations[0].line for finding in after]


def test_a_violated_property_is_one_finding_whatever_example_an_engine_gives() -> None:
    other = Counterexample(text="Another example.", steps=EXAMPLE.steps[2:])
    first, second = (
        judged(results=(result("outsiders-cannot-read", spec=answer(Status.VIOLATED, example=example)),)).findings[0]
        for example in (EXAMPLE, other)
    )
    assert first.locations != second.locations
    assert first.fingerprint == second.fingerprint


def test_a_cause_under_other_profiles_is_none() -> None:
    pinned = result(
        "no-enclave-grants-itself-rights", spec=answer(Status.VIOLATED, example=EXAMPLE), x=answer(Status.HOLDS)
    )
    found = {finding.code: finding for finding in judged(one_authority(healthy()), results=(pinned,)).findings}
    assert found["KA705"].explained_by == ()


@pytest.mark.parametrize("under", [(), ("cyclonedds-11", "spec"), ("spec",)])
def test_a_property_is_one_finding_about_the_whole_keystore_whatever_explains_it(under: tuple[str, ...]) -> None:
    violated = answer(Status.VIOLATED, example=EXAMPLE)
    asked = result("outsiders-cannot-read", spec=violated, cyclonedds_11=violated)
    formal = next(r for r in RULES if r.name == "outsiders-cannot-read")
    cause = made("KA412", says(explains=frozenset({"outsiders-cannot-read"}), profiles=under))
    wider = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(["rt/chatter", "rt/map"])))
    chosen = (VARIANTS["spec"], VARIANTS["cyclonedds-11"])
    judgements = (
        judge(context(store, results=(asked,), profiles=chosen), [cause, formal])
        for store in (healthy(), talker(permissions=wider)(healthy()))
    )
    before, after = (findings("KA711", each)[0] for each in judgements)
    assert before.fingerprint == after.fingerprint
    assert before.meaning != after.meaning


@pytest.mark.parametrize(
    ("rule", "violation", "explained"),
    [
        (("outsiders-cannot-read",), None, True),
        ((), None, False),
        (("outsiders-cannot-read",), frozenset[str](), False),
        ((), frozenset({"outsiders-cannot-read"}), True),
    ],
)
def test_a_violation_may_say_itself_what_it_explains(
    rule: tuple[str, ...], violation: frozenset[str] | None, explained: bool
) -> None:
    violated = result("outsiders-cannot-read", spec=answer(Status.VIOLATED, example=EXAMPLE))
    formal = next(r for r in RULES if r.name == "outsiders-cannot-read")
    cause = made("KA412", says(explains=violation), explains=rule)
    found = judge(context(results=(violated,)), [cause, formal]).findings
    assert bool(next(f for f in found if f.code == "KA711").explained_by) is explained


def test_messages_are_bounded_however_long_the_names_are() -> None:
    flood = "x" * 1_000_000
    assert len(judge(context(), [made("KA101", says(flood))]).findings[0].message) == MAX_MESSAGE
    long = grant(f"/{flood}", default_allow=True)
    store = talker(permissions=permissions("enclaves/talker/permissions.p7s", long, grant("/talker")))(healthy())
    assert all(len(finding.message) <= MAX_MESSAGE for finding in judged(store).findings)


def test_of_equal_violations_no_rest_takes_the_place_of_the_one_that_was_mended() -> None:
    """Whoever accepted one of two would otherwise have accepted whichever is left."""
    one, two = says("at line 1", line=1), says("at line 9", line=9)
    both = {finding.fingerprint for finding in judge(context(), [made("KA999", one, two)]).findings}
    assert len(both) == 2
    for left in (one, two):
        (finding,) = judge(context(), [made("KA999", left)]).findings
        assert finding.fingerprint not in both
    again = {finding.fingerprint for finding in judge(context(), [made("KA999", two, one)]).findings}
    assert again == both, "the order in which a rule says them is none of a finding's"
    other = says("at line 9", line=9, key="of its own")
    apart = {finding.fingerprint for finding in judge(context(), [made("KA999", one, other)]).findings}
    (alone,) = judge(context(), [made("KA999", one)]).findings
    assert alone.fingerprint in apart, "what a key tells apart keeps its fingerprint"


SAID_OF_SOME = ("rules/KA519", "rules/KA606", "rules/KA614", "rules/KA226", "flows/chatter_partition_pattern")
OF_THE_SCOPE = {"KA636", "KA731"}
"""What is asked of distributions, and of domains that documents of the scope tell apart: other questions."""


@pytest.mark.parametrize("sample", SAID_OF_SOME)
def test_a_finding_is_said_of_those_under_whom_it_is_found_alone(
    sample: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same keystore, judged for all implementations and for each by itself."""
    monkeypatch.chdir(SAMPLES)
    (expectation,) = (each for each in EXPECTATIONS if sample in str(each) and not str(each).endswith("good.toml"))
    store, _expected = as_built(expectation, tmp_path / "k")
    options = replace(given_options(expectation, store), engine="native")
    scope = [profile.name for profile in resolve(options.profiles)]
    alone: dict[str, set[str]] = {}
    for name in scope:
        for each in audit(store, replace(options, profiles=(name,))).findings:
            if not each.profiles or name in each.profiles:
                alone.setdefault(each.fingerprint, set()).add(name)
    together = [each for each in audit(store, options).findings if each.code not in OF_THE_SCOPE]
    told = {each.fingerprint: {*scope}.intersection(each.profiles or scope) for each in together if each.code < "KA9"}
    assert any(profiles != {*scope} for profiles in told.values())
    assert {mark: alone[mark] for mark in told} == told
