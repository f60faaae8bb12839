"""KA6 against every name, one by one: a divergence is found where some name is decided differently, else none."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple, replace

from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Operation, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.formal.rights import EffectiveRights
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import DEFAULT, Profile
from keystore_audit.truth import Truth
from tests.rules.divergent import Domains, Listed, chosen, compared, ruled, views
from tests.rules.evidence import (
    AT,
    domain_rule,
    enclave,
    governance,
    grant,
    keystore,
    permissions,
    text,
    topic_rule,
)

NAMES = tuple("".join(name) for length in (1, 2, 3) for name in product("ab_]", repeat=length))
PARTITIONS = ("", "p", "q", "pq", "x")
DOMAINS = (0, 1, 2, 3)
_DOMAIN_SETS: st.SearchStrategy[Domains] = st.sampled_from(
    (((0, 0),), ((0, 0),), ((0, 3),), ((1, 1),), ((0, 0), (2, 2)), ((1, None),))
)
_TOPICS = st.lists(st.sampled_from(("a", "b", "ab", "*", "a*", "?b", "[ab]", "[^a]", "[!a]")), min_size=1, max_size=2)
_PARTITIONS = st.one_of(
    st.none(), st.lists(st.sampled_from(("p", "q", "p*", "*", "")), min_size=1, max_size=2, unique=True)
)
_CRITERIA = st.lists(st.tuples(_TOPICS, _PARTITIONS), max_size=2)
_RULES = st.tuples(st.booleans(), _DOMAIN_SETS, _CRITERIA, _CRITERIA, st.one_of(st.just([]), st.just([]), _CRITERIA))
_DATES = st.sampled_from(
    ("2030-01-01T00:00:00", "2030-01-01T00:00:00", "2026-11-21T18:00:00+09:00", "2020-01-01T00:00:00")
)
_GRANTS = st.tuples(st.lists(_RULES, min_size=1, max_size=3), _DATES, st.sampled_from((False, False, False, True)))
_TWO = st.sampled_from((1, 1, 1, 2)).flatmap(lambda count: st.lists(_GRANTS, min_size=count, max_size=count))
_GOVERNANCES = st.tuples(
    st.sampled_from((((0, 0),), ((0, 0),), ((0, 2),))),
    *(st.sampled_from((True, True, True, False)) for _ in range(3)),
)
_KEYSTORES = st.tuples(_GOVERNANCES, _TWO, _TWO, st.lists(_RULES, max_size=1))
"""Of two enclaves: their governance, their grants, and what the talker's document grants to the listener."""


def _rule(drawn: tuple[bool, Domains, Listed, Listed, Listed]) -> Rule:
    allows, domains, publish, subscribe, relay = drawn
    return ruled(allows=allows, domains=domains, publish=publish, subscribe=subscribe, relay=relay)


def built(drawn: tuple[Any, ...]) -> Keystore:
    """The keystore of one draw."""
    (domains, read, write, join), talker, listener, foreign = drawn
    loose = topic_rule("a*", enable_read_access_control=read, enable_write_access_control=write)
    governed = governance(domain_rule(loose, topic_rule(), domains=domains, enable_join_access_control=join))
    enclaves = []
    for path, own in (("/talker", talker), ("/listener", listener)):
        grants = [
            grant(path, *map(_rule, rules), not_after=text(end, 41), default_allow=default)
            for rules, end, default in own
        ]
        if path == "/talker" and foreign:
            grants.append(grant("/listener", *map(_rule, foreign)))
        document = permissions(f"enclaves{path}/permissions.p7s", *grants)
        enclaves.append(enclave(path, governance=governed, permissions=document))
    return keystore(*enclaves)


def differ(values: Sequence[tuple[int, int]]) -> bool:
    """Whether something is in one of the sets for certain, and for certain not in another."""
    return any(must & ~may for must, _ in values for _, may in values)


def naming_alike(profiles: Sequence[Profile]) -> list[Profile]:
    """The profiles without their limits on what topics can be called, which is not a matter of documents."""
    return [
        replace(profile, local=replace(profile.local, topic_names=None, reads_names_as_expressions=False))
        for profile in profiles
    ]


def enclaves_that_differ(store: Keystore, profiles: Sequence[Profile], accesses: AccessViews) -> set[str]:
    """Asked name by name, in each partition and domain, and whether they start."""
    points = [(topic, partition) for topic in NAMES for partition in PARTITIONS]
    profiles = naming_alike(profiles)
    builder = SystemBuilder(store, profiles, AT, accesses, points)
    local, peers = LocalRights(accesses, builder.channels, AT), EffectiveRights(builder.systems())
    found = set()
    for domain in (*DOMAINS, None):
        usabilities = Usabilities(domain, accesses)
        here = 0
        if domain is not None:
            for number in range(len(points)):
                here |= 1 << builder.channels.of_point(domain, number)
        for each in store.enclaves:
            usable = {profile.name: usabilities.of(each, AT, profile).usable for profile in profiles}
            if domain is None and len({*usable.values()} - {Truth.UNKNOWN}) > 1:
                found.add(each.path)
            for operation in Operation:
                decided, accepted = [], []
                for profile in profiles:
                    allowed = local.allowed(each, profile, operation) if usable[profile.name].must else 0
                    decided.append((allowed & here, -1 if usable[profile.name] is Truth.UNKNOWN else allowed & here))
                    must, may = astuple(peers.accepted(each.path, profile.name, operation))
                    accepted.append((must & here, may))
                if differ(decided) or differ(accepted):
                    found.add(each.path)
    return found


@example(
    drawn=(
        (((0, 0),), True, True, False),
        [([(True, ((0, 0),), [], [], [])], "2030-01-01T00:00:00", False)],
        [([(False, ((0, 0),), [], [], [])], "2020-01-01T00:00:00", False)],
        [],
    ),
    names=("spec", "opendds"),
    zone=None,
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    drawn=_KEYSTORES,
    names=st.sampled_from(
        (DEFAULT, ("spec", "cyclonedds-11"), ("fastdds-2.14", "cyclonedds-0.10"), ("spec", "opendds"))
    ),
    zone=st.sampled_from((None, "Asia/Tokyo")),
)
def test_a_divergence_is_found_iff_some_name_is_decided_differently(
    drawn: tuple[Any, ...], names: tuple[str, ...], zone: str | None
) -> None:
    store = built(drawn)
    found = compared(store, *names, zone=zone)
    differing = enclaves_that_differ(store, chosen(*names), views(store, zone))
    assert {path for each in found for path in each.enclaves} == differing
    assert "opendds" in names or Cause.OTHER not in {each.cause for each in found}, "its partitions have no name"


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(drawn=_KEYSTORES, zone=st.sampled_from((None, "Asia/Tokyo")))
def test_examples_hold(drawn: tuple[Any, ...], zone: str | None) -> None:
    """What a finding says of a name is what each profile answers when it is asked for that name alone."""
    store, profiles = built(drawn), naming_alike(chosen())
    accesses = views(store, zone)
    for divergence in compared(store, zone=zone):
        example = divergence.example
        if example is None:
            continue
        builder = SystemBuilder(store, profiles, AT, accesses, [(example.topic, example.partition)])
        local, peers = LocalRights(accesses, builder.channels, AT), EffectiveRights(builder.systems())
        channel = builder.channels.of_point(example.domain, 0)
        usabilities = Usabilities(example.domain, accesses)
        each: Enclave = next(one for one in store.enclaves if one.path == example.enclave)
        for profile in profiles:
            if example.decided:
                usable = usabilities.of(each, AT, profile).usable
                allowed = local.allowed(each, profile, example.operation) if usable.must else 0
            else:
                allowed = peers.accepted(each.path, profile.name, example.operation).must
            assert (profile.name in example.allowing) is bool(allowed >> channel & 1)
        assert example.allowing
        assert example.denying
