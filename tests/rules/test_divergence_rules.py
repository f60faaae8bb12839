"""KA6: implementations differ exactly where these rules say so, and a keystore of one meaning has no finding."""

from __future__ import annotations

from keystore_audit.findings import Location, Result, Severity
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.interpret import interpret
from keystore_audit.model.meaning import Divergence
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from tests.rules.divergent import OWN, P7S, Domains, chosen, codes, compared, ruled, spoken, talking, views
from tests.rules.evidence import (
    AT,
    allow,
    context,
    domain_rule,
    governance,
    healthy,
    meaning,
    text,
)

BOTH: Domains = ((0, 0), (5, 5))
TWO_DOMAINS = governance(domain_rule(domains=BOTH))
JOINED = governance(domain_rule(enable_join_access_control=False))


def test_midnight_at_24_is_no_date_to_fast_dds() -> None:
    (finding,) = spoken(talking(not_after=text("2090-01-01T24:00:00", 41)), "spec", "fastdds-3.6")
    assert (finding.code, finding.severity) == ("KA612", Severity.HIGH)
    assert "starts under the text of DDS-Security 1.1, and not under Fast DDS 3.6" in finding.message


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


def test_opendds_starts_nobody_with_the_governance_of_sros2() -> None:
    """One finding for all: no grant can mend it."""
    (finding,) = spoken(healthy(), "spec", "opendds")
    assert (finding.code, finding.severity, finding.profiles) == ("KA602", Severity.HIGH, ("opendds",))
    assert finding.locations[0].path == "enclaves/governance.p7s"
    assert "/listener, /talker: start under the text of DDS-Security 1.1, and not under OpenDDS" in finding.message
    assert "weakens" in finding.fix.text


def test_dates_in_the_zone_of_the_robot() -> None:
    """Until noon it is in force, and it is noon in London: in Berlin it is one, in New York seven."""
    store = talking(not_after=text("2026-11-21T12:30:00", 41))
    assert codes(store, zone="Europe/London") == []
    assert codes(store, zone="America/New_York") == []
    (finding,) = spoken(store, zone="Europe/Berlin")
    assert (finding.code, finding.severity, finding.locations[0].line) == ("KA612", Severity.HIGH, 41)
    assert [each.cause for each in compared(store)] == [], "unknown without the zone, which others say"
