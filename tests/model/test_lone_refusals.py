"""What an enclave's own implementation refuses it and peers would take is in its system, and no way of `able`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.rights import OwnRights
from keystore_audit.profiles import Profile
from tests.amount import tried
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import Store
from tests.model.test_ability import AFTER, BEFORE, LISTENER, TALKER, holds
from tests.model.test_lone_endpoints import EVERY, random_case
from tests.oracles.vendors import recipe

FAST, CYCLONE = ("fastdds-2.14",), ("cyclonedds-11",)
STOCK = Store(members={"/e": TALKER, "/f": LISTENER}, governance=governance())


def rules(operation: str, first: str) -> str:
    """A document of /e or /f: a rule, and then the right itself."""
    owner = "/e" if operation == "publish" else "/f"
    return permissions(grant(owner, first, rule(criterion(operation, "rt/a"))))


@pytest.mark.parametrize("operation", ["publish", "subscribe"])
def test_fast_dds_applies_a_denial_of_another_domain(operation: str, tmp_path: Path) -> None:
    def store(domain: int) -> Store:
        denied = rule(criterion(operation, "rt/a"), domains=f"<id>{domain}</id>", allow=False)
        return STOCK.member("/e" if operation == "publish" else "/f", permissions=rules(operation, denied))

    assert not holds(store(9), tmp_path / "fast", profiles=FAST)
    assert holds(store(9), tmp_path / "cyclone", profiles=CYCLONE)
    assert not holds(store(0), tmp_path / "zero", profiles=CYCLONE)


def test_a_denial_of_a_grant_that_begins_later(tmp_path: Path) -> None:
    """What is refused is, from then on: no claim of ability until a later date is kept by it."""
    denied = rule(criterion("publish", "rt/a"), domains="<id>9</id>", allow=False)
    own = rule(criterion("publish", "rt/a"))
    now = grant("/e", own).replace("2034-01-01", "2027-06-01")
    for name, first, kept in (("denied", denied, False), ("same", own, True)):
        later = grant("/e", first, own).replace("2014-01-01", "2027-06-01")
        store = STOCK.member("/e", permissions=permissions(now, later))
        assert holds(store, tmp_path / name, until=AFTER, profiles=FAST) is kept
        assert holds(store, tmp_path / f"{name} before", until=BEFORE, profiles=FAST)


def test_a_topic_that_is_not_created_by_the_governance_of_its_own(tmp_path: Path) -> None:
    """Cyclone DDS 0.10 has no topic whose first rule denies, where its own governance controls both accesses."""
    denied = rule(criterion("publish", "rt/a", partitions=("p",)), allow=False)
    store = STOCK.member("/e", permissions=rules("publish", denied))
    loose = governance(domain_rule(topic_rule("rt/a", read="false") + topic_rule()))
    assert not holds(store.member("/f", governance=loose), tmp_path / "k", profiles=("cyclonedds-0.10",))
    assert holds(STOCK.member("/f", governance=loose), tmp_path / "without", profiles=("cyclonedds-0.10",))


def is_name(topic: str, profile: Profile) -> bool:
    """Whether the implementation can have such a topic."""
    return profile.local.topic_names is None or re.fullmatch(profile.local.topic_names, topic) is not None


@pytest.mark.parametrize("start", range(0, tried(120, 80), 40))
def test_nothing_that_is_refused_is_missing(start: int, tmp_path: Path) -> None:
    """Of random documents whose rules compete: by the decision about each channel."""
    refused = 0
    for seed in range(start, start + 40):
        enclave, accesses, channels, systems = random_case(seed, tmp_path)
        rights = LocalRights(accesses, channels, recipe.NOW)
        for profile in (each for each in EVERY if each.name != "opendds"):
            system = systems[profile.name]
            # Without a grant of its own it does not start, and nothing is claimed of it (`ability.stopped`).
            if system.has_doubt or not accesses.own_grants(enclave, profile):
                continue
            possible = (n for n, each in enumerate(system.channels) if each.infinite or is_name(each.topic, profile))
            named = bits(possible)  # topics of other names are left out of every claim of ability
            able = OwnRights(system, TrustDomainView(system, 0, Permissions(system))).abilities(0)
            for counted, operation in ((able.may_write, Operation.PUBLISH), (able.may_read, Operation.SUBSCRIBE)):
                assert named & counted & ~rights.allowed(enclave, profile, operation) == 0, (seed, profile.name)
            refused += bool(system.enclaves[0].refused_writes or system.enclaves[0].refused_reads)
    assert refused >= 5
