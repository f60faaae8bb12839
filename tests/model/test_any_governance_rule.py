"""What OpenDDS alone does: access control is off where any matching rule of the governance has it off, and more."""

from __future__ import annotations

from pathlib import Path

import pytest

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import Permissions, protection
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import VARIANTS
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import AT, Member, Store

OFF = {"write": "false"}
ELSEWHERE = permissions(grant("/e", rule(criterion("publish", "rt/other"), domains="<id>5</id>")))


class Asked:
    """What one implementation makes of a governance, of an enclave without any right in domain 0."""

    def __init__(self, by: str, root: Path, profile: str, own: str = ELSEWHERE) -> None:
        keystore = read_keystore(Store(members={"/e": Member(permissions=own)}, governance=by).write(root))
        self.profile = VARIANTS[profile]
        accesses = AccessViews(documents_of(keystore), AT, None)
        builder = SystemBuilder(keystore, (self.profile,), AT, accesses, [("rt/a", "")])
        [self.system] = builder.systems()
        [self.enclave] = keystore.enclaves
        inside = {n for n, each in enumerate(self.system.domains) if each.intervals[0][0] == 0}
        self.zero = bits(n for n, each in enumerate(self.system.channels) if each.domain in inside)
        self.rights = LocalRights(accesses, builder.channels, AT)
        self.starts = Usabilities(0, accesses).of(self.enclave, AT, self.profile).usable.must

    @property
    def allowed(self) -> bool:
        return bool(self.rights.allowed(self.enclave, self.profile, Operation.PUBLISH) & self.zero)

    @property
    def peer_authorised(self) -> bool:
        return bool(TrustDomainView(self.system, 0, Permissions(self.system)).abilities(0).may_write & self.zero)


@pytest.mark.parametrize(("profile", "expected"), [("opendds", True), ("spec", False), ("cyclonedds-11", False)])
def test_a_later_topic_rule_switches_access_control_off(profile: str, expected: bool, tmp_path: Path) -> None:
    loose = domain_rule(topic_rule("rt/*") + topic_rule("rt/a", **OFF))
    assert Asked(governance(loose), tmp_path / "one", profile).allowed is expected
    apart = governance(domain_rule(), domain_rule(topic_rule("rt/a", **OFF)))
    assert Asked(apart, tmp_path / "two", profile).allowed is expected
    assert not Asked(governance(domain_rule()), tmp_path / "none", profile).allowed


@pytest.mark.parametrize(("profile", "expected"), [("opendds", True), ("spec", False), ("fastdds-3.6", False)])
def test_a_later_domain_rule_switches_join_access_control_off(profile: str, expected: bool, tmp_path: Path) -> None:
    first = domain_rule(topic_rule(**OFF))
    for name, domains in (("same", "<id>0</id>"), ("more", "<id>0</id><id>5</id>")):
        second = domain_rule(domains=domains, join="false")
        assert Asked(governance(first, second), tmp_path / name, profile).peer_authorised is expected
    assert not Asked(governance(first, domain_rule(domains="<id>5</id>")), tmp_path / "none", profile).peer_authorised


@pytest.mark.parametrize(("joining", "expected"), [("false", True), ("true", False)])
def test_opendds_starts_by_a_later_domain_rule(joining: str, expected: bool, tmp_path: Path) -> None:
    later = governance(domain_rule(), domain_rule(join=joining))
    assert Asked(later, tmp_path / "k", "opendds").starts is expected


@pytest.mark.parametrize(("profile", "expected"), [("opendds", True), ("spec", False), ("cyclonedds-11", False)])
def test_no_partition_is_in_any_list_of_an_allow_rule_and_in_none_of_a_deny_rule(
    profile: str, expected: bool, tmp_path: Path
) -> None:
    """Permissions.cpp of OpenDDS, Action::partitions_match: of an endpoint without names none is looked up."""
    by, everywhere = governance(domain_rule()), criterion("publish", "rt/a")
    elsewhere = rule(criterion("publish", "rt/a", partitions=("secret",)))
    own = permissions(grant("/e", elsewhere))
    asked = Asked(by, tmp_path / "allow", profile, own)
    assert (asked.allowed, asked.peer_authorised) == (expected, expected)
    for name, partitions, allowed in (
        ("all", ("*",), expected),
        ("stars", ("**", ""), expected),
        ("none", (), False),
    ):
        denial = rule(criterion("publish", "rt/a", partitions=partitions), allow=False)
        own = permissions(grant("/e", denial, rule(everywhere)))
        asked = Asked(by, tmp_path / name, profile, own)
        assert (asked.allowed, asked.peer_authorised) == (allowed, allowed)


@pytest.mark.parametrize(("profile", "expected"), [("opendds", True), ("spec", False), ("cyclonedds-11", False)])
def test_a_later_domain_rule_adds_topics(profile: str, expected: bool, tmp_path: Path) -> None:
    """AccessControlBuiltInImpl.cpp of OpenDDS: it goes on through the domain rules until a topic rule matches."""
    own = permissions(grant("/e", rule(criterion("publish", "rt/a"))))
    first, second = domain_rule(topic_rule("rt/b")), domain_rule(domains="<id>0</id><id>5</id>")
    asked = Asked(governance(first, second), tmp_path / "both", profile, own)
    assert (asked.allowed, asked.peer_authorised) == (expected, expected)
    governed = protection(0, Permissions(asked.system)).governed & asked.zero
    assert (governed == asked.zero) is expected
    without = Asked(governance(first, domain_rule(domains="<id>5</id>")), tmp_path / "apart", profile, own)
    assert not without.allowed
    assert not without.peer_authorised
