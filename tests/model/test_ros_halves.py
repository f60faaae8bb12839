"""Half services and half actions against every short name, asked of the rules one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Operation, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.names import dds_channels
from keystore_audit.model.ros.halves import Half, halves
from keystore_audit.model.ros.holders import is_surely_whole
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import VARIANTS, Matcher
from tests.amount import tried
from tests.rules.divergent import ruled
from tests.rules.evidence import AT, domain_rule, enclave, governance, grant, keystore, permissions, topic_rule

NAMES = tuple(f"/{name}" for name in ("a", "b", "ab", "R", "_action/send_goal"))
ROLES = ("request", "reply", "call", "execute")
WAYS = (Operation.PUBLISH, Operation.SUBSCRIBE)
ALL = ("spec", "fastdds-3.6", "cyclonedds-0.10", "cyclonedds-11")


def found(store: Keystore, *profiles: str) -> tuple[Half, ...]:
    """The halves under these profiles."""
    accesses = AccessViews(documents_of(store), AT, None)
    chosen = [VARIANTS[name] for name in profiles or ALL]
    result = halves(store, chosen, AT, accesses, {})
    assert result.unknown == ()
    return result.halves


def own(*rules: Rule, governed: Any = None, **more: Any) -> Keystore:
    """One enclave with these rules."""
    document = permissions("enclaves/talker/permissions.p7s", grant("/talker", *rules, **more))
    return keystore(enclave("/talker", permissions=document, governance=governed or governance()))


def asked(
    store: Keystore, role: str, name: str, profile: str, listed: Mapping[Operation, Sequence[str]]
) -> tuple[list[tuple[Operation, str]], list[tuple[Operation, str]]]:
    """What the grant allows of the channels of a role, and what is refused, asked of the table of single names."""
    channels = dds_channels(role, name)
    points = [(topic, "") for _operation, topic in channels]
    accesses = AccessViews(documents_of(store), AT, None)
    builder = SystemBuilder(store, [VARIANTS[profile]], AT, accesses, points)
    local = LocalRights(accesses, builder.channels, AT)
    (one,) = store.enclaves
    open_store = _without_governance_openings(one)
    has, lacks = [], []
    for at, (operation, topic) in enumerate(channels):
        number = builder.channels.of_point(0, at)
        if not local.decide(one, VARIANTS[profile], operation, number, (topic, "")).allow:
            lacks.append((operation, topic))
        if _by_rule(open_store, profile, operation, topic):
            has += [(operation, topic)] * _tells(role, operation, topic, listed[operation])
    return has, lacks


def _tells(role: str, operation: Operation, topic: str, listed: Sequence[str]) -> bool:
    if role in ("request", "reply"):
        return any(topic[:3] in text and parse(text, Matcher.POSIX).matches(topic) for text in listed)
    if topic.startswith("rt/"):
        return operation is Operation.PUBLISH and topic in listed
    return any("/_action/" in text and parse(text, Matcher.POSIX).matches(topic) for text in listed)


def _without_governance_openings(one: Enclave) -> Keystore:
    return keystore(
        enclave("/talker", permissions=one.permissions, governance=governance(domain_rule(domains=((0, 0),))))
    )


def _by_rule(store: Keystore, profile: str, operation: Operation, topic: str) -> bool:
    accesses = AccessViews(documents_of(store), AT, None)
    builder = SystemBuilder(store, [VARIANTS[profile]], AT, accesses, [(topic, "")])
    local = LocalRights(accesses, builder.channels, AT)
    channel = builder.channels.of_point(0, 0)
    decision = local.decide(store.enclaves[0], VARIANTS[profile], operation, channel, (topic, ""))
    return decision.allow and "first rule" in decision.reason


_TEXTS = st.one_of(
    st.sampled_from(("*", "r*", "rq/*Request", "rr/*Reply", "rt/*", "rq/a*Request", "rr/a*Reply", "rr/?Reply")),
    st.sampled_from(NAMES).flatmap(
        lambda name: st.sampled_from([topic for role in ROLES for _each, topic in dds_channels(role, name)])
    ),
    st.sampled_from(("rq/*/_action/send_goalRequest", "rr/[!a]*Reply", "r?/b*", "rt/*/_action/*", "rt/a/_action/*")),
)
_RULES = st.lists(
    st.tuples(st.sampled_from((True, True, True, False)), st.lists(_TEXTS, max_size=4), st.lists(_TEXTS, max_size=4)),
    min_size=1,
    max_size=3,
)


@settings(max_examples=tried(25, 5), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    rules=_RULES,
    default=st.sampled_from((False, False, True)),
    loose=st.sampled_from((False, False, True)),
    profile=st.sampled_from(ALL),
)
def test_a_half_is_found_iff_some_name_is_half(rules: Any, default: bool, loose: bool, profile: str) -> None:
    loose = loose and profile != "cyclonedds-0.10"  # there, what a governance opens decides about topics too
    open_rule = topic_rule("rq/*", enable_write_access_control=not loose, enable_read_access_control=not loose)
    governed = governance(domain_rule(open_rule, topic_rule()))
    made = [
        ruled(allows=allows, publish=[(pub, None)] if pub else (), subscribe=[(sub, None)] if sub else ())
        for allows, pub, sub in rules
    ]
    store = own(*made, governed=governed, default_allow=default)
    listed = {way: [text for drawn in rules for text in drawn[1 + at] if drawn[0]] for at, way in enumerate(WAYS)}
    result = found(store, profile)
    for half in result:
        has, lacks = asked(store, half.role, half.name, profile, listed)
        assert has, half
        assert {*half.lacks} == {*lacks}
    for role, name in product(ROLES, NAMES):
        if role in ("request", "reply") and "_action" in name and name != "/_action/send_goal":
            continue
        has, lacks = asked(store, role, name, profile, listed)
        if has and lacks:
            assert any(half.role == role for half in result), (role, name, has, lacks)
    if any(is_surely_whole(each, rewinds=True) for each in store.enclaves[0].permissions.permissions.grants):  # type: ignore[union-attr]
        assert result == ()
