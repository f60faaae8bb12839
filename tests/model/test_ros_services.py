"""Who may call and answer whose services, against every short name of a node, asked of the rules one by one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.interpret import interpret
from keystore_audit.model.matching.coverage import allows_everything
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.ros.patterns import RosPatterns
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.rules.divergent import chosen, views
from tests.rules.evidence import AT, allow, enclave, grant, keystore, permissions

NODES = ("/a", "/b", "/ab", "/a/b", "/b/a", "/c")
SERVICES = ("set_parameters", "get_parameters", "change_state")
FAMILY = {"set_parameters": "parameters", "get_parameters": "parameters", "change_state": "states"}
Drawn = list[tuple[bool, list[str]]]

_NAMES = st.tuples(st.sampled_from(("rq", "rr")), st.sampled_from(NODES), st.sampled_from(SERVICES)).map(
    lambda drawn: f"{drawn[0]}{drawn[1]}/{drawn[2]}{'Request' if drawn[0] == 'rq' else 'Reply'}"
)
_PATTERNS = st.tuples(
    st.sampled_from(("rq", "rr", "r?")),
    st.sampled_from(("/*", "/a*", "/?/*", "/[!a]*", "/a/*", "/*b*")),
    st.sampled_from(("Request", "Reply", "", "/set_parametersReply", "/set_*", "/change_state*")),
).map("".join)
_RULES = st.lists(
    st.tuples(
        st.sampled_from((True, True, True, False)), st.lists(st.one_of(_NAMES, _PATTERNS), min_size=1, max_size=3)
    ),
    min_size=1,
    max_size=3,
)


def built(drawn: Iterable[Drawn]) -> Keystore:
    """An enclave for each."""
    enclaves = []
    for path, rules in zip(("/talker", "/listener", "/third"), drawn, strict=False):
        made = [allow(texts, allows=allows) for allows, texts in rules]
        enclaves.append(enclave(path, permissions=permissions(f"enclaves{path}/permissions.p7s", grant(path, *made))))
    return keystore(*enclaves)


def patterns(store: Keystore) -> RosPatterns:
    """What the model says of it under the specification."""
    profiles, accesses = chosen("spec"), views(store)
    ros = interpret(store, profiles, AT, accesses, Usabilities(None, accesses)).ros
    assert ros is not None
    assert ros.unknown is None
    return ros


def allowed(rules: Drawn, topic: str) -> bool:
    """The first rule that matches decides."""
    for allows, texts in rules:
        if any(parse(text, Matcher.POSIX).matches(topic) for text in texts):
            return allows
    return False


def listed(rules: Drawn, topic: str) -> bool:
    """Whether an allow rule lists the topic by name."""
    return any(allows and topic in texts for allows, texts in rules)


@settings(max_examples=tried(15, 5), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(drawn=st.lists(_RULES, min_size=2, max_size=3))
@example(  # the first node that comes to mind is the caller's own, /b; there is /b/a beside it
    drawn=[
        [(True, ["rr/b/get_parametersReply"])],
        [(True, ["rr/b/change_stateReply", "r?/[!a]*/change_state*"])],
        [(True, ["rr/?/*Reply", "rr/[!a]*Reply"])],
    ]
)
def test_reach_and_rivals_are_those_of_the_rules(drawn: list[Drawn]) -> None:
    store = built(drawn)
    assert not any(
        allows_everything(each)
        for one in store.enclaves
        for each in one.permissions.permissions.grants  # type: ignore[union-attr]
    )
    ros = patterns(store)
    by_path: dict[str, Any] = {one.path: rules for one, rules in zip(store.enclaves, drawn, strict=True)}

    def within_reach(caller: str, owner: str, node: str, service: str) -> bool:
        request, reply = f"rq{node}/{service}Request", f"rr{node}/{service}Reply"
        return (
            allowed(by_path[caller], request) and allowed(by_path[owner], reply) and not listed(by_path[caller], reply)
        )

    found = {(reach.caller, reach.family): reach for reach, _profiles in ros.reaches}
    for reach in found.values():
        assert within_reach(reach.caller, reach.owner, reach.node, reach.service), reach
        assert reach.rights[0].line is not None
        assert reach.rights[1].line is not None
    for caller in by_path:
        for owner in by_path:
            for node in NODES:
                for service in SERVICES if caller != owner else ():
                    if within_reach(caller, owner, node, service):
                        reach = found[caller, FAMILY[service]]
                        assert reach.changes or service == "get_parameters"
    for node in NODES:
        for service in SERVICES:
            reply = f"rr{node}/{service}Reply"
            able = {path for path, rules in by_path.items() if allowed(rules, reply)}
            naming = {path for path, rules in by_path.items() if listed(rules, reply)}
            if len(able) > 1 and naming & able:
                assert any(f"{node}/{service}" in group.services for group, _profiles in ros.rivals)
    for group, _profiles in ros.rivals:
        able = {path for path, rules in by_path.items() if allowed(rules, f"rr{group.services[0]}Reply")}
        assert len(able) > 1 or group.intruder in able
