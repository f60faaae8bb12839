"""KA637: partitions that are patterns; one change makes the rule speak."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from keystore_audit.findings import Finding
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import system_documents
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import resolve
from keystore_audit.rules import BY_CODE
from keystore_audit.rules.judge import judge
from tests.keystore.documents import allow, deny, domain_rule, governance, grant, permissions, pub, sub, topic_rule
from tests.model.comparing import Member, Store
from tests.model.test_trust_domains_alike import told
from tests.rules.divergent import Listed, ruled, talking
from tests.rules.evidence import AT, context, meaning, rules_of

MAP = ("rt/map",)


def at(*partitions: str) -> Listed:
    return [(MAP, partitions)]


def spoken(store: Keystore) -> tuple[Finding, ...]:
    profiles, accesses = resolve(()), AccessViews(system_documents(store), AT, None)
    known = meaning(systems=SystemBuilder(store, profiles, AT, accesses).systems())
    return judge(context(store, meaning=known), [BY_CODE["KA637"]]).findings


EVERYWHERE = ruled(allows=False, subscribe=[(MAP, None)])


def denied(*partitions: str) -> Rule:
    return ruled(allows=False, subscribe=at(*partitions))


@pytest.mark.parametrize(
    ("store", "way"),
    [
        (talking(denied("secret"), ruled(subscribe=at("s*"), line=43)), "allowed in line 43 in a partition pattern"),
        (talking(denied("secret"), ruled(subscribe=at("?"))), "in a partition pattern"),
        (talking(denied("secret"), default_allow=True), "allowed by default in a partition pattern"),
        (
            talking(EVERYWHERE, ruled(publish=[(MAP, None)], subscribe=at("*"))),
            "Denied here is subscribe in the default partition.",
        ),
        (
            talking(denied("secret"), ruled(subscribe=[(["rt/*"], ["*"])])),
            "Denied here is subscribe in partition 'secret'.",
        ),
        (talking(ruled(publish=at("lab?"))), "'lab*'"),
        (talking(ruled(publish=at("[!a]"))), "'*'"),
    ],
)
def test_ways_around_partitions(store: Keystore, way: str) -> None:
    assert any(way in finding.message for finding in spoken(store))


@pytest.mark.parametrize(
    "store",
    [
        talking(ruled(subscribe=at("*"))),
        talking(ruled(subscribe=at("lab*", "public"))),
        talking(ruled(subscribe=at("lab[12]"))),
        talking(denied("*"), ruled(subscribe=at("*"))),
        talking(denied("s*"), ruled(subscribe=at("s*"))),
        talking(ruled(subscribe=at("*")), denied("secret")),
        talking(denied("secret"), ruled(subscribe=at("public"))),
        talking(denied("secret"), ruled(publish=at("*"))),
        talking(denied("secret"), ruled(subscribe=[(["rt/other"], ["*"])])),
        talking(EVERYWHERE, ruled(subscribe=[(MAP, None)])),
        talking(EVERYWHERE, ruled(subscribe=at("*"))),  # Cyclone DDS 11 makes no such topic (measured)
    ],
)
def test_what_gets_around_nothing(store: Keystore) -> None:
    assert spoken(store) == ()


SECRET, EVERY = (sub("rt/map", partitions=[place]) for place in ("secret", "*"))
SPEC, OLD, NEW = "spec", "cyclonedds-0.10", "cyclonedds-11"


@pytest.mark.parametrize(
    ("rules", "governed", "expected"),
    [
        ((deny(SECRET), allow(EVERY)), {}, {SPEC}),
        ((allow(pub("rt/map")), deny(SECRET), allow(EVERY)), {}, {SPEC, OLD, NEW}),
        ((deny(SECRET), allow(pub("rt/map")), allow(EVERY)), {}, {SPEC, NEW}),
        ((deny(SECRET), allow(EVERY)), {"write": False}, {SPEC, OLD, NEW}),
    ],
)
def test_a_denial_that_takes_the_whole_topic_away_is_not_got_around(
    rules: Sequence[str], governed: Mapping[str, bool], expected: set[str], tmp_path: Path
) -> None:
    """Where the first rule that lists a topic denies it (Cyclone DDS 0.10; 11: of each operation), if that is asked."""
    listener = Member(permissions=permissions(grant("/listener", *rules)))
    store = Store(members={"/listener": listener}, governance=governance(domain_rule(topic_rule(**governed))))
    root = store.write(tmp_path)
    for profile in (SPEC, OLD, NEW):
        report = told(root, None, (profile,))
        codes = {each["code"] for each in report["findings"]}
        assert ("KA637" in codes) is (profile in expected), profile
        assert not {"KA608", "KA637"} <= codes


ALONE = ruled(publish=[(["rt/map", "rt/rosout"], ["robot1"])])


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        ((ALONE,), ["/map (topic) (and 1 more like it) only in partition 'robot1'"]),
        ((ALONE, ruled(publish=[(["rt/map"], None)])), ["/rosout (topic) only in partition 'robot1'"]),
        ((ALONE, ruled(publish=[(["rt/map", "rt/rosout"], ["", "robot1"])])), []),
        ((ruled(publish=at("*")),), []),
        ((ruled(publish=[(["Square"], ["robot1"])]), ruled(subscribe=[(["rt/map"], None)])), []),
        ((ruled(allows=False, publish=at("robot1")),), []),
        (
            (ruled(subscribe=[(["ros_discovery_info"], ["robot1"])]),),
            ["ros_discovery_info (discovery) only in partition"],
        ),
    ],
)
def test_a_name_of_ros_that_is_allowed_in_partitions_alone_is_nobody_s(rules: Sequence[Rule], said: list[str]) -> None:
    """ROS 2 nodes are in the default partition: such a grant looks complete and gives them nothing."""
    found = [
        each
        for each in judge(context(talking(*rules)), rules_of("anomaly_names")).findings
        if "use no partitions" in each.message
    ]
    assert [each.code for each in found] == ["KA625"] * len(said)
    for finding, words in zip(found, said, strict=True):
        assert words in finding.message
        assert "Remove the partitions from the rules" in finding.fix.text
