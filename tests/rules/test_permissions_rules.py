"""KA5: one change to a permissions document makes a rule speak, and no other."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.typed import Grant
from keystore_audit.model.matching.coverage import EVERYTHING, MAX_CANDIDATES, covers
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.question import Usability
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import VARIANTS, Matcher
from keystore_audit.truth import Truth
from tests.keystore.builder import sros2
from tests.rules.evidence import (
    AT,
    DAY,
    Change,
    allow,
    becomes,
    codes,
    defect,
    domain_rule,
    enclave,
    findings,
    governance,
    grant,
    healthy,
    judged,
    keystore,
    meaning,
    open_codes,
    permissions,
    signed,
    talker,
    text,
)

P7S = "enclaves/talker/permissions.p7s"


def granted(*grants: Grant, **more: Any) -> Change:
    return talker(permissions=permissions(P7S, *grants, **more))


def dated(start: str = "2020-01-01T00:00:00", end: str = "2100-01-01T00:00:00") -> Change:
    return granted(grant("/talker", not_before=text(start, 40), not_after=text(end, 41)))


def padded(octets: int) -> SignedDocument:
    message = signed(P7S)
    return replace(message, file=message.file.holding(b" " * octets))


OWN = grant("/talker")


FAST_DDS = {name for name in VARIANTS if name.startswith("fastdds")}
CYCLONE_DDS = {name for name in VARIANTS if name.startswith("cyclonedds")}


@pytest.mark.parametrize(
    ("named", "code", "finding_it"),
    [
        ("CN=/talker,O=x", "KA503", CYCLONE_DDS),  # another subject, of which Cyclone DDS sees the first part alone
        ("/CN=/talker", "KA520", CYCLONE_DDS),
        ("/CN=\\/talker", "KA503", set()),  # peers of Fast DDS take it, and its own participant does not start
        ("cn=/talker", "KA503", set()),
        ("CN = /talker", "KA520", {"fastdds-2.14", "fastdds-3.2", "fastdds-3.6", "cyclonedds-11", "opendds"}),
        ("CN=/talker ", "KA520", {*FAST_DDS, *CYCLONE_DDS, "opendds"}),
    ],
)
def test_a_subject_that_is_no_text_of_a_grant_has_one_finding_of_who_does_not_find_it(
    named: str, code: str, finding_it: set[str]
) -> None:
    """What a grant is taken to name is no fault of its own; of those that do not find it, one rule speaks."""
    store = granted(grant("/talker", subject_name=text(named, 39)))(healthy())
    (found,) = (finding for finding in judged(store).findings if finding.code in ("KA503", "KA520"))
    assert (found.code, found.severity) == (code, Severity.HIGH)
    assert set(found.profiles or VARIANTS) == set(VARIANTS) - finding_it
    assert code == "KA520" or f"got '{named}', expected 'CN=/talker'" in found.message
    if code == "KA520":
        assert found.fix.text.startswith("Write <subject_name> as the message writes the identity's subject.")
        meant = found.message.partition("the identity '")[2].partition("'")[0]
        assert becomes(granted(grant("/talker", subject_name=text(meant, 39)))) == []


def test_a_grant_that_the_chosen_implementation_takes_for_its_own_is_a_low_finding() -> None:
    store = granted(grant("/talker", subject_name=text("CN=/talker,O=x", 39)))(healthy())
    severity = {
        name: [f.severity for f in findings("KA503", judged(store, profiles=(VARIANTS[name],)))]
        for name in ("cyclonedds-11", "fastdds-3.6")
    }
    assert severity == {"cyclonedds-11": [Severity.LOW], "fastdds-3.6": [Severity.HIGH]}


@given(seconds=st.integers(min_value=-100 * 86400, max_value=100 * 86400))
def test_the_end_of_a_grant_to_the_second(seconds: int) -> None:
    end = AT + timedelta(seconds=seconds)
    found = becomes(dated(end=f"{end:%Y-%m-%dT%H:%M:%S}"))
    assert found == (["KA505"] if seconds < 0 else ["KA507"] if end <= AT + 30 * DAY else [])


@pytest.mark.parametrize("zone", ["Z", "+00:00"])
def test_a_grant_may_end_with_its_certificate_in_any_zone(zone: str) -> None:
    assert becomes(dated(end=f"2100-01-01T00:00:00{zone}")) == []
    assert becomes(dated(end="2100-01-01T02:00:00+02:00")) == ["KA613"], "which Fast DDS does not read"
    assert becomes(dated(end="2100-01-01T00:00:00-01:00")) == ["KA513", "KA613"]


def test_a_date_that_no_two_read_alike_leaves_it_open() -> None:
    store = dated(end="99999-01-01T00:00:00")(healthy())
    assert codes(store) == ["KA502"]
    assert open_codes(store) == {"KA502"}


def test_a_default_of_allow_is_for_those_who_read_it() -> None:
    found = findings("KA509", judged(granted(grant("/talker", default_allow=True))(healthy())))
    assert found[0].locations[0].line == 50
    assert "cyclonedds-0.10" in found[0].profiles
    assert not any(name.startswith("fastdds") for name in found[0].profiles)


# How far grants reach


@pytest.mark.parametrize(
    ("expression", "severity"),
    [
        ("*", Severity.HIGH),
        ("rt/*", Severity.HIGH),
        ("r*", Severity.HIGH),
        ("?t/*", Severity.HIGH),
        ("rt/?*", Severity.HIGH),
        ("rt/[a-m]* rt/[!a-m]*", Severity.HIGH),
        ("rt/[a-m]* rt/[n-z]*", Severity.MEDIUM),
        ("rt/?* rt/[!a]?*", Severity.HIGH),
        ("rt/[!a] rt/[!a]?* rt/a?*", Severity.MEDIUM),
        ("rt/[!a] rt/?* rt/a", Severity.HIGH),
        ("rt/camera/*", Severity.MEDIUM),
        ("rt/*/status", Severity.MEDIUM),
        ("rt/[ab]", Severity.MEDIUM),
        ("rq/*Request", Severity.MEDIUM),
        ("rt/chatter", None),
        (r"rt/\*", None),  # an escaped star is a star, for the specification
        ("rt/[a]", None),
    ],
)
def test_patterns_by_what_they_cover(expression: str, severity: Severity | None) -> None:
    found = findings("KA510", judged(granted(grant("/talker", allow(expression.split())))(healthy())))
    assert [finding.severity for finding in found] == ([] if severity is None else [severity])


@pytest.mark.parametrize(
    "topics",
    [["*"], ["r*"], ["rt*", "rq*", "rr*"], [*EVERYTHING], ["rr/*", "r[qt]/*"], ["rt/[a-m]*", "rt/[!a-m]*", "r[qr]/*"]],
)
def test_everything_is_known_by_its_meaning(topics: list[str]) -> None:
    assert becomes(granted(grant("/talker", allow(topics, topics)))) == ["KA511"]
    assert becomes(granted(grant("/talker", allow(topics)))) == ["KA510"]


@given(
    head=st.sampled_from(["", "r", "rt", "rt/", "rt/a", "*"]),
    middle=st.sampled_from(["*", "?", "?*", "[a-z]*", "[!x]*", "*a*", "**"]),
    tail=st.sampled_from(["", "t", "*", "[!a]"]),
    name=st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,3}(/[A-Za-z_][A-Za-z0-9_]{0,3}){0,2}", fullmatch=True),
)
def test_what_covers_every_topic_matches_each(head: str, middle: str, tail: str, name: str) -> None:
    expression = head + middle + tail
    if covers(expression, "rt/*"):
        assert parse(expression, Matcher.POSIX).matches(f"rt/{name}")


def test_patterns_made_to_cost_time_do_not() -> None:
    """Ten thousand expressions that no quick look can tell from one for everything: few are thought about."""
    covers.cache_clear()
    many = [f"*[!{chr(0x4E00 + n)}]*" for n in range(10_000)]
    found = findings("KA510", judged(granted(grant("/talker", allow(many)))(healthy())))
    assert len(found) == 1
    assert len(found[0].locations) <= 50
    assert len(found[0].message) < 2000
    assert covers.cache_info().misses <= 4 * MAX_CANDIDATES


# What nobody takes


def test_nothing_is_open_in_a_document_that_nobody_takes() -> None:
    for kind in (Kind.SCHEMA_INVALID, Kind.XML_MALFORMED, Kind.EMPTY_TOPIC, Kind.RULE_WITHOUT_DOMAINS):
        broken = signed(P7S, defects=(defect(Kind.NOT_SMIME, P7S),))
        store = granted(signed=broken, defects=(defect(kind, P7S),))(healthy())
        assert "KA304" in codes(store)
        assert open_codes(store) == set()


@pytest.mark.parametrize(("refusing", "severity"), [("fastdds-3.6", Severity.HIGH), ("opendds", Severity.MEDIUM)])
def test_a_grant_without_an_allow_rule_is_as_grave_as_what_it_stops(refusing: str, severity: Severity) -> None:
    """OpenDDS is not asked about here."""
    store = granted(grant("/talker", allow(["rt/x"], allows=False)))(healthy())
    usability = {("enclaves/talker", refusing): Usability(usable=Truth.NO, reasons=("some reason",))}
    seen = judged(store, meaning=meaning(usability=usability))
    assert [each.severity for each in findings("KA514", seen)] == [severity]
    assert findings("KA117", seen) == ()


@pytest.mark.parametrize(
    ("profile", "octets", "severity"),
    [
        ("fastdds-2.9", 63_001, Severity.HIGH),
        ("fastdds-2.14", 63_001, Severity.MEDIUM),
        ("fastdds-2.9", 62_000, None),
        ("cyclonedds-0.10", 63_001, None),
    ],
)
def test_how_bad_it_is_that_permissions_fit_in_no_handshake(
    profile: str, octets: int, severity: Severity | None
) -> None:
    store = granted(OWN, signed=padded(octets))(healthy())
    found = findings("KA522", judged(store, profiles=(VARIANTS[profile],)))
    assert [finding.severity for finding in found] == [severity] * (severity is not None)


def test_the_first_grant_decides_whether_it_may_take_part() -> None:
    outside, inside = allow(["rt/a"], domains=[(7, 7)]), allow(["rt/a"])
    assert becomes(granted(grant("/talker", outside), grant("/talker", inside))) == ["KA504", "KA508"]
    assert becomes(granted(grant("/talker", inside), grant("/talker", outside))) == ["KA504"]


def test_a_deny_rule_gives_no_domain() -> None:
    rules = (allow(["rt/a"], allows=False), allow(["rt/a"], domains=[(7, 9)]))
    assert becomes(granted(grant("/talker", *rules))) == ["KA508"]
    wide = governance(domain_rule(domains=[(9, 20)]))
    store = keystore(enclave("/talker", governance=wide, permissions=permissions(P7S, grant("/talker", *rules))))
    assert codes(store) == []


NODES = tuple(f"/robot{number}" for number in range(8))


def at_least_high(root: Path, *enclaves: str, profiles: tuple[str, ...] = ()) -> list[Finding]:
    """What is at least high in a keystore of two authorities with these enclaves."""
    store = sros2(root / f"{len(enclaves)}{len(profiles)}", enclaves, split=True)
    report = audit(store, Options(at=AT, engine="native", profiles=profiles))
    return [each for each in report.findings if each.severity.rank < 2]


def test_an_identity_that_every_grant_names_is_one_cause(tmp_path: Path) -> None:
    """Cyclone DDS finds all of `CN=/` in every subject; a real keystore had such an enclave."""
    cause, property_violated = at_least_high(tmp_path, "/", *NODES)
    assert (cause.code, cause.severity.value) == ("KA519", "critical")
    assert "(and 7 more like it) names 'CN=/' too" in cause.message
    assert {each.path for each in cause.locations} >= {f"enclaves{path}/permissions.p7s" for path in NODES}
    assert property_violated.explained_by == (cause.fingerprint,)
    assert at_least_high(tmp_path, *NODES) == []
    assert at_least_high(tmp_path, "/", *NODES, profiles=("fastdds-3.6",))[0].severity.value == "high"
