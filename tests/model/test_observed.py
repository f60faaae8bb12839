"""What is missing and what is in excess, compared with an evaluator that goes through all names one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.findings import Location
from keystore_audit.intent.intent import Action, IntendedRight, Intent
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.typed import Operation, Rule
from keystore_audit.model.intended.observed_needs import EnclavePolicy, least_policy, usual_channels
from keystore_audit.model.names import dds_channels, dds_expressions
from tests.amount import tried
from tests.rules.evidence import allow, domain_rule, enclave, governance, grant, keystore, permissions
from tests.rules.observed import does, graph, log, observed

NAMES = ("/a", "/b", "/a/c", "/b/c")
DOMAINS = ((0, 0), (5, 5))
GOVERNED = governance(domain_rule(domains=DOMAINS))
TOPICS = [f"rt{name}" for name in NAMES]
EXPRESSIONS = [*TOPICS, "rt/*", "rt/a*", "rt/?", *(f"r{half}{name}" for name in NAMES for half in ("q*Request", "r*"))]
OPERATIONS = (Operation.PUBLISH, Operation.SUBSCRIBE)

rules = st.builds(
    allow,
    st.lists(st.sampled_from(EXPRESSIONS), max_size=3),
    st.lists(st.sampled_from(EXPRESSIONS), max_size=3),
    domains=st.sampled_from([((0, 0),), ((5, 5),), DOMAINS]),
    allows=st.booleans(),
)
acts = st.tuples(st.sampled_from(Action), st.sampled_from(NAMES))


def store(own: Sequence[Rule]) -> Keystore:
    """/talker with these rules; its log and discovery work in both domains."""
    usual = allow(["rt/rosout", "ros_discovery_info"], ["ros_discovery_info"], domains=DOMAINS)
    file = permissions("enclaves/talker/permissions.p7s", grant("/talker", usual, *own))
    return keystore(enclave("/talker", permissions=file, governance=GOVERNED))


def allows(own: Sequence[Rule], operation: Operation, topic: str, domain: int) -> bool:
    """First match, else denied; `fnmatchcase` reads `*` and `?` as POSIX does."""
    for rule in own:
        if not any((each.low or 0) <= domain <= (each.high or 0) for each in rule.domains):
            continue
        for criterion in rule.criteria:
            if criterion.operation is operation and any(fnmatchcase(topic, each.text) for each in criterion.topics):
                return rule.allow
    return False


def seen(actions: Sequence[tuple[Action, str]]) -> Intent:
    return graph(log("/talker"), *(does("/talker", action.value, name) for action, name in actions))


@settings(derandomize=True, deadline=None, max_examples=tried(120))
@given(own=st.lists(rules, max_size=4), actions=st.lists(acts, max_size=4, unique=True))
def test_missing_is_what_one_by_one_is_denied(own: list[Rule], actions: list[tuple[Action, str]]) -> None:
    found = observed(store(own), seen(actions), names=("spec",))
    denied = {
        (action, name): [
            domain
            for domain in (0, 5)
            if not all(allows(own, operation, topic, domain) for operation, topic in dds_channels(action.value, name))
        ]
        for action, name in actions
    }
    expected = {key: domains for key, domains in denied.items() if domains}
    missing = {(each.need.action, each.need.name): each for each in found.missing}
    assert missing.keys() == expected.keys()
    for key, each in missing.items():
        assert each.domains == ("" if expected[key] == [0, 5] else f"domain {expected[key][0]}")
        assert each.profiles == ("spec",)


@settings(derandomize=True, deadline=None, max_examples=tried(120))
@given(own=st.lists(rules, max_size=4), actions=st.lists(acts, max_size=4, unique=True))
def test_excess_is_what_one_by_one_is_granted_and_not_used(own: list[Rule], actions: list[tuple[Action, str]]) -> None:
    found = observed(store(own), seen(actions), names=("spec",))
    used = {channel for action, name in actions for channel in dds_channels(action.value, name)}
    listed = {
        (criterion.operation, text.text)
        for rule in own
        if rule.allow
        for criterion in rule.criteria
        for text in criterion.topics
        if not {"*", "?"} & {*text.text}
    }
    granted = {(o, topic) for o, topic in listed if any(allows(own, o, topic, domain) for domain in (0, 5))}
    names = {(each.operation, each.topic) for excess in found.excess for each in excess.names}
    assert names == granted - used
    # Names that nobody has thought of: behind them is whatever an expression allows without an end.
    far = [f"rt/{letter}{'x' * 9}/y" for letter in ("a", "q")] + ["rt/a/c/c/c"]
    halves = [f"r{half}{name}/z{end}" for name in NAMES for half, end in (("q/y", "Request"), ("r/y", ""), ("q", "x"))]
    endless = any(allows(own, o, topic, d) for o in OPERATIONS for topic in (*far, *halves) for d in (0, 5))
    unbounded = any(excess.endless for excess in found.excess)
    assert not (endless and not unbounded)
    usual = set(usual_channels(("/talker",)))
    others = {(o, topic) for o in OPERATIONS for topic in TOPICS} - used - granted - usual
    if any(allows(own, o, topic, domain) for o, topic in others for domain in (0, 5)):
        assert any(excess.wide is not None for excess in found.excess)
    for excess in found.excess:
        assert (excess.used, excess.allowed) == (len(granted & used), len(granted))
        if excess.wide is not None:
            name = excess.wide
            assert excess.endless or (name.operation, name.topic) not in used | granted
            assert any(allows(own, name.operation, name.topic, domain) for domain in (0, 5))


names_or_wildcards = st.sampled_from([*NAMES, "/a*", "/*"])
said = st.tuples(st.sampled_from(Action), names_or_wildcards, st.booleans())


@settings(derandomize=True, deadline=None, max_examples=tried(150))
@given(entries=st.lists(said, max_size=6, unique=True))
def test_the_least_policy_means_what_the_policy_means(entries: list[tuple[Action, str, bool]]) -> None:
    """sros2 denies first, then allows: name by name, over all that the names make and some more."""
    from keystore_audit.intent.intent import IntendedNode, Origin

    place = Location(path="p.xml", line=1)
    intent = Intent(
        origin=Origin.POLICY,
        path="p.xml",
        files=(),
        enclaves=(("/talker", place),),
        nodes=(IntendedNode(enclave="/talker", name="/talker", location=place),),
        rights=tuple(
            IntendedRight(enclave="/talker", node="/talker", action=action, name=name, allow=allow_, location=place)
            for action, name, allow_ in entries
        ),
    )
    (policy,) = least_policy((intent,), LayoutKind.SROS2, lambda _enclave, _name: ()).enclaves
    suggested = [(right.action, right.name, right.allow) for right in policy.rights]
    for operation, topic in universe():
        assert sros2_allows(suggested, operation, topic) == sros2_allows(entries, operation, topic), (operation, topic)
    assert_least(policy, entries)


def assert_least(policy: EnclavePolicy, entries: Sequence[tuple[Action, str, bool]]) -> None:
    """Without wildcards nothing is denied that default would not, and every right gives something."""
    if any("*" in name for _action, name, allowed in entries if allowed):
        return
    for right in policy.rights:
        channels = dds_expressions(right.action.value, right.name)
        assert not right.allow or any(sros2_allows(entries, operation, topic) for operation, topic in channels)


def universe() -> Iterator[tuple[Operation, str]]:
    for name in (*NAMES, "/ab", "/z"):
        for action in Action:
            yield from dds_channels(action.value, name)


def sros2_allows(entries: Sequence[tuple[Action, str, bool]], operation: Operation, topic: str) -> bool:
    matching = {
        allowed
        for action, name, allowed in entries
        for each, expression in dds_expressions(action.value, name)
        if each is operation and fnmatchcase(topic, expression)
    }
    return matching == {True}
