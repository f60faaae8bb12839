"""KA6: implementations differ exactly where these rules say so, and a keystore of one meaning has no finding."""

from __future__ import annotations

from typing import Any

import pytest

from keystore_audit.findings import Location, Result, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.interpret import interpret
from keystore_audit.model.meaning import Divergence
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import DEFAULT
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from tests.rules.divergent import OWN, P7S, Domains, Listed, chosen, codes, compared, ruled, spoken, talking, views
from tests.rules.evidence import (
    AT,
    allow,
    context,
    domain_rule,
    governance,
    healthy,
    meaning,
    text,
    topic_rule,
)

COMMAND: Listed = ((("rt/cmd_vel",), None),)
LAB: Listed = ((("rt/cmd_vel",), ("lab",)),)
BOTH: Domains = ((0, 0), (5, 5))
TWO_DOMAINS = governance(domain_rule(domains=BOTH))
LOOSE = governance(domain_rule(topic_rule("rt/clock", enable_write_access_control=False), topic_rule(), domains=BOTH))
JOINED = governance(domain_rule(enable_join_access_control=False))
SHADOWED = governance(
    domain_rule(topic_rule("rt/clock"), topic_rule("rt/c*", enable_write_access_control=False), topic_rule())
)
TONGA = text("2027-01-01T00:00:00+13:00", 40)

CASES: dict[str, tuple[Keystore, dict[str, Any], list[str]]] = {
    "KA601": (talking(allow(["rt/a"]), governed=TWO_DOMAINS), {}, ["KA601"]),
    "KA602": (talking(allow(["rt/a"]), governed=LOOSE), {}, ["KA601", "KA602"]),
    "KA603": (healthy(), {"domain": 7}, ["KA603"]),
    "KA604": (talking(ruled(allows=False, publish=LAB), ruled(line=43, publish=COMMAND)), {}, ["KA604", "KA608"]),
    "KA605": (talking(ruled(allows=False, publish=COMMAND), ruled(line=43, publish=LAB)), {}, ["KA605"]),
    "KA606": (talking(ruled(publish=[(["rt/a"], ["p"]), (["rt/b"], ["q"])])), {}, ["KA606"]),
    "KA607": (talking(ruled(publish=[(["rt/a"], ["p"])]), ruled(publish=[(["rt/a"], ["q"])])), {}, ["KA607"]),
    "KA608": (talking(ruled(allows=False, publish=COMMAND), ruled(subscribe=COMMAND)), {}, ["KA608"]),
    "KA609": (talking(allow(["rt/a"]), ruled(relay=COMMAND)), {}, ["KA609"]),
    "KA610": (talking(allow(["rt/arm_[^s]"])), {}, ["KA610"]),
    "KA611": (talking(allow(["rt/arm_[ab"], allows=False), allow(["rt/a"])), {}, ["KA611"]),
    "KA612": (talking(not_before=TONGA), {}, ["KA612"]),
    "KA613": (talking(not_after=text("2099-01-01T00:00:00+02:00", 41)), {}, ["KA613"]),
    "KA614": (
        talking(
            allow(["rt/a"], domains=[(0, None)], allows=False), allow(["rt/a"], domains=BOTH), governed=TWO_DOMAINS
        ),
        {},
        ["KA614"],
    ),
    "KA615": (talking(governed=SHADOWED), {"names": ("spec", "opendds")}, ["KA615"]),
    "KA616": (healthy(), {}, []),
}
"""A keystore in which the rule speaks; of KA616, which speaks of what has no rule, see below."""


@pytest.mark.parametrize("code", CASES)
def test_one_cause_makes_one_rule_speak(code: str) -> None:
    store, options, expected = CASES[code]
    assert codes(store, *options.pop("names", ()), **options) == expected


def test_a_stock_keystore_has_one_meaning() -> None:
    for names in (DEFAULT, ("fastdds-3.6", "cyclonedds-0.10"), ("spec",)):
        assert compared(healthy(), *names) == ()
    wide = talking(allow(["rt/*", "rq/*Request"], ["rr/*/_action/?"]))
    assert compared(wide) == ()
    assert codes(wide) == []


def test_only_chosen_profiles_are_compared() -> None:
    """Both Fast DDS differ from the specification, and not from each other."""
    store = CASES["KA606"][0]
    assert compared(store, "fastdds-2.14", "fastdds-3.6") == ()
    found = compared(store, "fastdds-2.14", "cyclonedds-0.10")
    assert [(each.cause, each.escalates) for each in found] == [(Cause.CROSSED_PARTITIONS, True)]


@pytest.mark.parametrize(
    ("code", "severity"),
    [
        ("KA601", Severity.MEDIUM),  # their own endpoints alone: peers refuse
        ("KA604", Severity.MEDIUM),
        ("KA605", Severity.HIGH),
        ("KA606", Severity.HIGH),
        ("KA607", Severity.MEDIUM),
        ("KA608", Severity.MEDIUM),
        ("KA609", Severity.HIGH),
        ("KA610", Severity.HIGH),
        ("KA612", Severity.HIGH),
        ("KA613", Severity.LOW),
        ("KA614", Severity.HIGH),
    ],
)
def test_whoever_may_do_more_than_the_specification_says_is_worse(code: str, severity: Severity) -> None:
    store, options, _ = CASES[code]
    assert {finding.severity for finding in spoken(store, **options) if finding.code == code} == {severity}


def test_opendds_starts_nobody_with_the_governance_of_sros2() -> None:
    """One finding for all: no grant can mend it."""
    (finding,) = spoken(healthy(), "spec", "opendds")
    assert (finding.code, finding.severity, finding.profiles) == ("KA602", Severity.HIGH, ("opendds",))
    assert finding.locations[0].path == "enclaves/governance.p7s"
    assert "/listener, /talker: start under DDS-Security 1.1, and not under OpenDDS" in finding.message
    assert "weakens" in finding.fix.text


def test_a_finding_says_who_does_what_where() -> None:
    (finding,) = spoken(CASES["KA605"][0])
    assert finding.message == (
        "Cyclone DDS applies a deny rule without partitions to the default one alone: /talker may publish /cmd_vel "
        "(topic) in domain 0, partition 'lab' under Cyclone DDS 11 (lyrical, rolling), and not under DDS-Security 1.1, "
        "Fast DDS 2.6, 2.14, 3.2, 3.6 (humble, jazzy, kilted, lyrical, rolling) and Cyclone DDS 0.10 (humble, jazzy, "
        "kilted)."
    )
    assert finding.profiles == ("cyclonedds-11",)
    assert finding.enclave == "/talker"


def test_the_line_that_is_read_differently_comes_first() -> None:
    deny, permit = ruled(allows=False, line=61, publish=COMMAND), ruled(line=62, subscribe=COMMAND)
    (finding,) = spoken(talking(allow(["rt/a"]), deny, permit))
    assert [(place.path, place.line) for place in finding.locations] == [(P7S, 61), (P7S, 62)]


def test_many_lines_of_one_cause_are_one_finding() -> None:
    rules = [ruled(line=60 + n, publish=[([f"rt/t{n}"], None)]) for n in range(9)]
    (finding,) = spoken(talking(*rules, governed=TWO_DOMAINS))
    assert (finding.code, len(finding.locations)) == ("KA601", 10)
    assert "(9 lines)" in finding.message


def test_another_line_is_another_finding() -> None:
    few, more = (
        spoken(
            talking(*(ruled(line=60 + n, publish=[([f"rt/t{n}"], None)]) for n in range(count)), governed=TWO_DOMAINS)
        )
        for count in (2, 3)
    )
    assert few[0].fingerprint != more[0].fingerprint


def test_relaying_lets_a_reader_read_on_fast_dds() -> None:
    (found,) = compared(CASES["KA609"][0], "spec", "fastdds-3.6")
    assert found.example is not None
    assert (found.example.operation, found.example.decided) == (Operation.SUBSCRIBE, False)
    assert (found.example.allowing, found.example.denying) == (("fastdds-3.6",), ("spec",))


def test_dates_in_the_zone_of_the_robot() -> None:
    """Until noon it is in force, and it is noon in London: in Berlin it is one, in New York seven."""
    store = talking(not_after=text("2026-11-21T12:30:00", 41))
    assert codes(store, zone="Europe/London") == []
    assert codes(store, zone="America/New_York") == []
    (finding,) = spoken(store, zone="Europe/Berlin")
    assert (finding.code, finding.severity, finding.locations[0].line) == ("KA612", Severity.HIGH, 41)
    assert [each.cause for each in compared(store)] == [], "unknown without the zone, which others say"


def test_midnight_at_24_is_no_date_to_fast_dds() -> None:
    (finding,) = spoken(talking(not_after=text("2090-01-01T24:00:00", 41)), "spec", "fastdds-3.6")
    assert (finding.code, finding.severity) == ("KA612", Severity.HIGH)
    assert "starts under DDS-Security 1.1, and not under Fast DDS 3.6" in finding.message


def test_what_other_rules_say_is_not_said_again() -> None:
    spoken_for = {
        "KA509": (talking(allow(["rt/a"]), default_allow=True), Cause.DEFAULT),
        "KA508": (talking(allow(["rt/a"], domains=[(7, 7)])), Cause.RULE_DOMAINS),
        "KA514": (talking(allow(["rt/a"], allows=False), governed=JOINED), Cause.JOIN),
        "KA515": (talking(allow(["rt/a"], domains=[(0, None)]), governed=TWO_DOMAINS), Cause.RANGE),
        "KA420": (talking(governed=governance(domain_rule(domains=[(0, 0), (231, 231)]))), Cause.HIGHEST_DOMAIN),
    }
    for code, (store, cause) in spoken_for.items():
        found = compared(store)
        assert cause in {each.cause for each in found}, code
        about = context(store, meaning=meaning(divergences=found))
        said = {finding.code for finding in judge(about, RULES).findings}
        assert code in said
        assert {each for each in said if each.startswith("KA6")} <= {"KA601"} - (
            {"KA601"} if code == "KA508" else set()
        )


def net(*causes: Cause) -> tuple[Divergence, ...]:
    return tuple(
        Divergence(
            cause=cause,
            location=Location(path=P7S, line=42),
            other=None,
            enclaves=("/talker",),
            escalates=False,
            restricts=True,
            ros=True,
            example=None,
        )
        for cause in causes
    )


def test_what_has_no_rule_of_its_own_is_caught() -> None:
    about = context(meaning=meaning(divergences=net(Cause.OTHER)))
    judged = judge(about, OWN)
    assert [(f.code, f.severity) for f in judged.findings] == [("KA616", Severity.MEDIUM)]
    about = context(meaning=meaning(divergences=net(Cause.UNDECIDED)))
    judged = judge(about, OWN)
    assert [f.code for f in judged.findings] == ["KA616"]
    assert [o.outcome for o in judged.outcomes if o.rule == "KA616"] == [Result.OPEN]


def test_every_cause_is_spoken_of_by_some_rule() -> None:
    """Or it is one of those that rules about single documents speak of."""
    elsewhere = {
        Cause.FORM,
        Cause.HIGHEST_DOMAIN,
        Cause.UNAUTHENTICATED_WITH_RTPS,
        Cause.GRANT_CHOICE,
        Cause.DEFAULT,
        Cause.GRANT_REQUIRED,
        Cause.RANGE,
    }
    for cause in Cause:
        about = context(meaning=meaning(divergences=net(cause)))
        assert bool(judge(about, OWN).findings) is (cause not in elsewhere), cause


# Random keystores, against every name one by one


def test_one_implementation_alone_is_compared_with_the_specification() -> None:
    """What it gives beyond the document must not go unsaid because nobody else was asked about."""
    store = talking(ruled(publish=[(["rt/a"], ["p"]), (["rt/b"], None)]))
    accesses = views(store)
    said = interpret(store, chosen("fastdds-3.6"), AT, accesses, Usabilities(None, accesses))
    assert [each.escalates for each in said.divergences] == [True]
    plain = talking(ruled(publish=[(["rt/a"], ["p"])]))
    accesses = views(plain)
    assert interpret(plain, chosen("fastdds-3.6"), AT, accesses, Usabilities(None, accesses)).divergences == ()
