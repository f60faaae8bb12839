"""Classes, expressions, governance and counterparts of `model.anomalies.find` against every name one by one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.document import Readings
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Operation, ProtectionKind
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Effort, name_classes
from keystore_audit.model.anomalies.find import anomalies
from keystore_audit.model.anomalies.grants import are_ros_names, foreign
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.rules.divergent import chosen, views
from tests.rules.evidence import (
    allow,
    domain_rule,
    enclave,
    governance,
    grant,
    keystore,
    permissions,
    topic_rule,
)

EXAMPLES = settings(max_examples=tried(150), deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
NAMES = tuple("".join(name) for length in (1, 2, 3) for name in product("abc", repeat=length))
DOMAINS = (0, 1, 2)


@cache
def matches(expression: str, name: str) -> bool:
    """Our own reading of `*`, `?` and brackets."""
    pattern = expression.replace("[!", "[^").replace("*", ".*").replace("?", ".")
    return re.fullmatch(pattern, name) is not None


def of(store: Keystore, *names: str) -> dict[str, tuple[Anomaly, ...]]:
    return anomalies(store, chosen(*names), views(store))


# Classes


_ENDS = st.text("ab", max_size=2)
_TEXTS = st.one_of(
    st.builds("{}*{}".format, _ENDS, _ENDS), st.text("ab", min_size=1, max_size=3), st.sampled_from(("?b", "a*b*"))
)


@EXAMPLES
@given(st.lists(_TEXTS, min_size=1, max_size=8, unique=True))
def test_the_quick_way_gives_the_classes_of_the_automaton(texts: list[str]) -> None:
    quick = name_classes(texts, Matcher.POSIX, Effort.of(1))
    patterns = [parse(text, Matcher.POSIX) for text in texts]
    assert {each.members for each in quick} == {each.members for each in classify(patterns) if each.members}
    wild = [each.members for each in quick]
    for each in quick:
        assert each.members == {number for number, text in enumerate(texts) if matches(text, each.witness)}
    literal_only = [members for members in wild if all(patterns[number].literal for number in members)]
    assert len(literal_only) == len(set(literal_only))


# Expressions


ROS_NAMES = tuple(
    f"{start}{''.join(rest)}{end}"
    for start, end in (("rt", ""), ("rq", "Request"), ("rr", "Reply"), ("rs", ""))
    for length in (2, 3, 4)
    for rest in product("/a1", repeat=length)
    if is_ros_dds_name(f"{start}{''.join(rest)}{end}")
)
_ROS_LIKE = st.lists(
    st.sampled_from(("rt", "rq", "/", "a", "1", "*", "?", "[a1]", "[!/]", "Request", "-", "//")), min_size=1, max_size=5
).map("".join)


@EXAMPLES
@given(st.lists(_ROS_LIKE, min_size=1, max_size=3))
def test_expressions_without_a_name_of_ros_are_found(texts: list[str]) -> None:
    found = foreign(texts, (Matcher.POSIX,), Effort.of(1))
    for text in texts:
        if text in found:
            assert not any(matches(text, name) for name in (*ROS_NAMES, "ros_discovery_info"))
        else:
            classes = classify((parse(text, Matcher.POSIX),))
            assert any(each.ros and each.members and is_ros_dds_name(each.witness) for each in classes)
    if are_ros_names(texts):
        assert all(is_ros_dds_name(text) for text in texts)


# Governance


_KINDS = st.sampled_from((ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT))
_TOPIC_RULES = st.lists(
    st.tuples(st.sampled_from(("a", "b", "ab", "a*", "*b", "?b", "*", "[ab]")), _KINDS, st.booleans()),
    min_size=1,
    max_size=4,
)
_DOMAIN_RULES = st.lists(
    st.tuples(st.sampled_from((((0, 0),), ((0, 1),), ((1, 2),), ((0, 2),))), _KINDS, _TOPIC_RULES),
    min_size=1,
    max_size=3,
)


def _order(kind: ProtectionKind) -> int:
    return [ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT].index(kind)


def _shadowed(drawn: Sequence[tuple[Any, ProtectionKind, Any]]) -> list[tuple[AnomalyKind, int, bool]]:
    """(kind, line of the rule as below, whether a protection is lost), by definition."""
    found = []
    first = {d: next((n for n, r in enumerate(drawn) if any(lo <= d <= hi for lo, hi in r[0])), None) for d in DOMAINS}
    for number, (domains, rtps, topics) in enumerate(drawn):
        own = [d for d in DOMAINS if any(lo <= d <= hi for lo, hi in domains)]
        if all(first[d] != number for d in own):
            lost = False
            for other in {first[d] for d in own}:
                assert other is not None
                lost |= _order(rtps) > _order(drawn[other][1])
                for name in NAMES:
                    mine = next((t for t in topics if matches(t[0], name)), None)
                    theirs = next((t for t in drawn[other][2] if matches(t[0], name)), None)
                    if theirs is not None:
                        lost |= mine is None or _order(mine[1]) > _order(theirs[1]) or (mine[2] and not theirs[2])
            found.append((AnomalyKind.DOMAIN_RULE_SHADOWED, number, lost))
            continue
        for at, (text, kind, control) in enumerate(topics):
            deciders = [next(t for t in topics if matches(t[0], name)) for name in NAMES if matches(text, name)]
            numbers = [
                next(n for n, t in enumerate(topics) if matches(t[0], name)) for name in NAMES if matches(text, name)
            ]
            if numbers and at not in numbers:
                lost = any(_order(kind) > _order(t[1]) or (control and not t[2]) for t in deciders)
                found.append((AnomalyKind.TOPIC_RULE_SHADOWED, 100 + 10 * number + at, lost))
    return found


@EXAMPLES
@given(_DOMAIN_RULES)
def test_shadowed_rules_of_a_governance_are_found_exactly(drawn: list[Any]) -> None:
    rules = [
        domain_rule(
            *(
                topic_rule(text, data_protection_kind=kind, enable_read_access_control=control, line=100 + 10 * n + at)
                for at, (text, kind, control) in enumerate(topics)
            ),
            domains=domains,
            rtps_protection_kind=rtps,
            line=n,
        )
        for n, (domains, rtps, topics) in enumerate(drawn)
    ]
    document = governance(*rules)
    found = of(keystore(enclave("/talker", governance=document)), "spec").get(document.signed.file.place, ())
    assert sorted((each.kind, each.line, each.serious) for each in found) == sorted(_shadowed(drawn))  # type: ignore[type-var]


# Counterparts


_LISTED = st.lists(st.sampled_from(("rt/a", "rt/b", "rt/ab", "rt/a*", "rt/?b")), max_size=3)
_GRANT = st.lists(
    st.tuples(st.booleans(), st.sampled_from((((0, 0),), ((0, 0),), ((1, 1),), ((0, 2),))), _LISTED, _LISTED),
    min_size=1,
    max_size=3,
)


@EXAMPLES
@given(st.lists(_GRANT, min_size=2, max_size=3))
def test_names_that_nobody_is_at_the_other_end_of_are_found_exactly(drawn: list[Any]) -> None:
    every = governance(domain_rule(domains=[(0, 2)]))
    enclaves = []
    for number, rules in enumerate(drawn):
        path = f"/e{number}"
        made = [allow(p, s, domains=domains, allows=allows) for allows, domains, p, s in rules]
        own = permissions(f"enclaves{path}/permissions.p7s", grant(path, *made))
        enclaves.append(enclave(path, governance=every, permissions=own))
    found = of(keystore(*enclaves), "spec")

    def allowed(rules: Any, which: int, name: str, domain: int) -> bool:
        for rule in rules:
            if any(lo <= domain <= hi for lo, hi in rule[1]) and any(matches(text, name) for text in rule[which]):
                return bool(rule[0])
        return False

    for number, rules in enumerate(drawn):
        expected = set()
        for which, other, operation in ((2, 3, Operation.PUBLISH), (3, 2, Operation.SUBSCRIBE)):
            listed = {t for r in rules if r[0] for t in r[which] if "*" not in t and "?" not in t}
            for name in listed:
                mine = [d for d in DOMAINS if allowed(rules, which, name, d)]
                if mine and not any(allowed(each, other, name, d) for each in drawn for d in mine):
                    expected.add(f"{operation.value} {name}")
        own = found.get(f"enclaves/e{number}/permissions.p7s", ())
        assert {each.key for each in own if each.kind is AnomalyKind.NO_COUNTERPART} == expected


def test_an_enclave_that_cannot_be_read_may_be_at_the_other_end() -> None:
    talker = enclave("/talker", permissions=permissions("t.p7s", grant("/talker", allow(["rt/a"]))))
    listener = enclave("/listener", permissions=permissions("l.p7s", grant("/listener", allow([], ["rt/b"]))))
    opaque = enclave("/opaque", permissions=permissions("o.p7s", readings=Readings(by_syntax={})))
    assert set(of(keystore(talker, listener))) == {"t.p7s", "l.p7s"}
    assert of(keystore(talker, listener, opaque)) == {}


# Hostile documents


def test_alternating_rules_are_worked_out_or_said_not_to_be() -> None:
    rules = [allow([f"rt/n{n // 2}"], allows=n % 2 == 0) for n in range(4000)]
    own = permissions("h.p7s", grant("/talker", *rules))
    found = of(keystore(enclave("/talker", permissions=own)), "spec")["h.p7s"]
    assert sum(each.kind is AnomalyKind.UNREACHABLE for each in found) == 2000


def test_thousands_of_expressions_with_many_wildcards_come_to_an_end() -> None:
    texts = ["rt/" + "*".join(f"{n + k}x" for k in range(50)) for n in range(2500)]
    rules = [allow(texts[:1250], allows=False), allow(texts[1250:]), allow(["rt/*", "a*b*c"])]
    own = permissions("h.p7s", grant("/talker", *rules))
    found = of(keystore(enclave("/talker", permissions=own)), "spec")["h.p7s"]
    assert AnomalyKind.NOT_WORKED_OUT in {each.kind for each in found}
