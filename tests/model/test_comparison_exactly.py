"""Changes of grants and governance against all short names in all partitions and domains, decided one by one.

By the letters of DDS-Security 1.1 (9.4.1.2, 9.4.1.3), from the XML, without the code under test.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.comparison.change import Change, Comparison, Direction
from tests.amount import tried
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import Member, Store, compared

NAMES = tuple("".join(letters) for length in (1, 2, 3, 4) for letters in product("abc", repeat=length))
DOMAINS = (0, 1, 2)
PARTITIONS = ("", "p", "q")
OPERATIONS = ("publish", "subscribe")

expressions = st.text("ab*", min_size=1, max_size=3)
domains = st.sampled_from(["<id>0</id>", "<id>1</id>", "<id_range><min>0</min><max>1</max></id_range>"])
criteria = st.builds(
    lambda operation, topics, partitions: criterion(operation, *topics, partitions=partitions),
    st.sampled_from(OPERATIONS),
    st.lists(expressions, min_size=1, max_size=2),
    st.sampled_from([(), (), ("p",), ("*",), ("p", "q")]),
)
rules = st.builds(
    lambda several, allow, where: rule(*sorted(several, key=lambda text: text[:5]), allow=allow, domains=where),
    st.lists(criteria, min_size=1, max_size=2),
    st.booleans(),
    domains,
)
documents = st.builds(
    lambda several, default: permissions(grant("/a", *several, default=default)),
    st.lists(rules, max_size=3),
    st.sampled_from(["DENY", "DENY", "ALLOW"]),
)
kinds = st.sampled_from([kind.value for kind in ProtectionKind])
topic_rules = st.builds(
    lambda expression, reads, data: topic_rule(expression, read=reads, data=data),
    expressions,
    st.sampled_from(["true", "false"]),
    st.sampled_from(["NONE", "SIGN", "ENCRYPT"]),
)
governances = st.builds(
    lambda several: governance(*several),
    st.lists(
        st.builds(
            lambda where, topics, rtps: domain_rule(*topics, domains=where, rtps=rtps),
            domains,
            st.lists(topic_rules, min_size=1, max_size=3),
            kinds,
        ),
        min_size=1,
        max_size=2,
    ),
)
BASE = Store(members={"/a": Member(permissions=permissions(grant("/a")))})


def compare_stores(old: Store, new: Store) -> Comparison:
    with tempfile.TemporaryDirectory() as root:
        return compared(old, new, Path(root), ("spec",))


@cache
def matches(expression: str, name: str) -> bool:
    return re.fullmatch("".join(".*" if letter == "*" else letter for letter in expression), name) is not None


def covered(element: ET.Element | None) -> frozenset[int]:
    """The domain ids that are looked at, of those that the element lists."""
    assert element is not None
    found: set[int] = set()
    for each in element:
        bounds = [each.text] * 2 if each.tag == "id" else [each.findtext("min"), each.findtext("max")]
        low, high = (int(bound or "") for bound in bounds)
        found.update(domain for domain in DOMAINS if low <= domain <= high)
    return frozenset(found)


class Part(NamedTuple):
    """Topics and partitions that a rule is about, for one operation in some domains."""

    allow: bool
    operation: str
    domains: frozenset[int]
    topics: list[str]
    partitions: list[str]

    def decides(self, operation: str, name: str, partition: str, domain: int) -> bool:
        """Without a list of partitions allow rules are about the unnamed one alone, deny rules about all."""
        if operation != self.operation or domain not in self.domains:
            return False
        if not self.partitions and self.allow and partition:
            return False
        inside = not self.partitions or any(matches(each, partition) for each in self.partitions)
        return inside and any(matches(each, name) for each in self.topics)


class Permissions:
    """The only grant of a document."""

    def __init__(self, document: str) -> None:
        (grant_element,) = ET.fromstring(document).iter("grant")
        self._parts = [
            Part(
                rule_element.tag == "allow_rule",
                listed.tag,
                covered(rule_element.find("domains")),
                [topic.text or "" for topic in listed.findall("topics/topic")],
                [partition.text or "" for partition in listed.findall("partitions/partition")],
            )
            for rule_element in grant_element
            for listed in rule_element
            if listed.tag in OPERATIONS
        ]
        self._default = grant_element.findtext("default") == "ALLOW"

    def allows(self, operation: str, name: str, partition: str, domain: int) -> bool:
        """First match, then the default."""
        deciding = (part.allow for part in self._parts if part.decides(operation, name, partition, domain))
        return next(deciding, self._default)


class Governance:
    """Domain rules with their topic rules, as flags and kinds by name."""

    def __init__(self, document: str) -> None:
        self._rules = [
            (
                covered(each.find("domains")),
                {part.tag: part.text or "" for part in each if len(part) == 0},
                [
                    (
                        topic.findtext("topic_expression") or "",
                        {part.tag: part.text or "" for part in topic if part.tag != "topic_expression"},
                    )
                    for topic in each.iter("topic_rule")
                ],
            )
            for each in ET.fromstring(document).iter("domain_rule")
        ]

    def protected(self, name: str, domain: int) -> dict[str, str] | None:
        """Every flag and kind that applies; None: no rule for the domain."""
        for ids, flags, topics in self._rules:
            if domain in ids:
                return flags | next((row for expression, row in topics if matches(expression, name)), {})
        return None


def witnesses(change: Change) -> Iterator[tuple[str, str, int]]:
    assert change.names is not None
    for name in change.names.shown:
        for low, _high in name.domains:
            yield name.topic, name.partition, low


@given(old=documents, new=documents)
@settings(max_examples=tried(80), deadline=None, derandomize=True)
def test_rights_change_where_single_decisions_do(old: str, new: str) -> None:
    found = compare_stores(*(BASE.member("/a", permissions=document) for document in (old, new)))
    before, after = Permissions(old), Permissions(new)
    expected = {
        (operation, after_allows)
        for operation, name, partition, domain in product(OPERATIONS, NAMES, PARTITIONS, DOMAINS)
        for after_allows in (after.allows(operation, name, partition, domain),)
        if after_allows != before.allows(operation, name, partition, domain)
    }
    changes = [change for change in found.changes if change.operation in OPERATIONS]
    told = {(change.operation, change.direction is Direction.GAINED) for change in changes}
    assert len(told) == len(changes)
    assert expected <= told
    for change in changes:
        for name, partition, domain in witnesses(change):
            decisions = [each.allows(str(change.operation), name, partition, domain) for each in (before, after)]
            assert decisions == [change.direction is Direction.LOST, change.direction is Direction.GAINED]


@given(old=governances, new=governances)
@settings(max_examples=tried(80), deadline=None, derandomize=True)
def test_protection_changes_where_single_rows_do(old: str, new: str) -> None:
    found = compare_stores(*(replace(BASE, governance=document) for document in (old, new)))
    before, after = Governance(old), Governance(new)
    changes = [change for change in found.changes if change.kind == "protection"]
    told = {aspect.what for change in changes for aspect in change.aspects}
    expected: set[str] = set()
    for name, domain in product(NAMES, DOMAINS):
        expected |= differing(before.protected(name, domain), after.protected(name, domain))
    assert expected <= told
    for change in changes:
        for name, _partition, domain in witnesses(change):
            rows = before.protected(name, domain), after.protected(name, domain)
            assert {aspect.what for aspect in change.aspects} <= differing(*rows)


def differing(one: dict[str, str] | None, other: dict[str, str] | None) -> set[str]:
    """The names of what differs; where one has no rule, that alone."""
    if one is None or other is None:
        return set() if one is other else {"domain_rule"}
    found = {tag for tag in one if tag in other and one[tag] != other[tag]}
    return found if len(one) == len(other) else {*found, "topic_rule"}
