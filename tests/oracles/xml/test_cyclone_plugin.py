"""Where we say that a document has one meaning, Cyclone DDS 0.10's own plugin gives it that meaning, or a named reason.

The reference below is the letter of DDS-Security 1.1, 9.4.1.2 and 9.4.1.3: first domain rule, first topic rule, first
matching criterion, default.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore import xsd
from keystore_audit.keystore.governance import DomainRange, Governance
from keystore_audit.keystore.permissions import Grant, Operation, Permissions
from keystore_audit.model.expression import Matcher, parse
from tests.oracles.xml import ours, policy
from tests.oracles.xml.corpus import DOCUMENTS, kind_of
from tests.oracles.xml.cyclone_plugin import Plugin, plugin
from tests.oracles.xml.measure import DECIDED, TOPICS, decided
from tests.oracles.xml.mutation import documents
from tests.oracles.xml.test_one_meaning import known_fault

pytestmark = pytest.mark.xdist_group("xml-oracle")

LARGEST_DOMAIN = 230
"""Of Cyclone DDS 0.10: a larger one and the file is refused."""


@pytest.fixture(scope="module")
def cyclone(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plugin]:
    with plugin(oracle, tmp_path_factory.mktemp("plugin")) as asked:
        yield asked


def test_the_plugin_answers_as_measured(cyclone: Plugin) -> None:
    expected: dict[str, str] = json.loads(DECIDED.read_text())
    assert {title: decided(cyclone, document) for title, document in DOCUMENTS.items()} == expected


def _holds(ranges: tuple[DomainRange, ...], domain: int) -> bool:
    return any((r.low or 0) <= domain <= (r.high if r.high is not None else domain) for r in ranges)


def _matches(expression: str, topic: str) -> bool:
    return parse(expression, Matcher.POSIX).matches(topic)


def _may(grant: Grant, operation: Operation, topic: str) -> bool:
    for rule in grant.rules:
        if not _holds(rule.domains, 0):
            continue
        for criterion in rule.criteria:
            in_default_partition = criterion.partitions is None or any(
                _matches(partition.text, "") for partition in criterion.partitions
            )
            matching = any(_matches(expression.text, topic) for expression in criterion.topics)
            if criterion.operation is operation and matching and in_default_partition:
                return rule.allow
    return grant.default_allow


def by_the_letter(typed: Governance | Permissions, topic: str) -> str:
    """The flags of a topic in domain 0, by the specification, beside a plain document of the other kind."""
    if isinstance(typed, Permissions):
        grant = typed.grants[0]
        writes, reads = _may(grant, Operation.PUBLISH, topic), _may(grant, Operation.SUBSCRIBE, topic)
        return f"{'w' if writes else '-'}{'r' if reads else '-'}1111"
    domain_rule = next(rule for rule in typed.domain_rules if _holds(rule.domains, 0))
    for rule in domain_rule.topic_rules:
        if _matches(rule.expression.text, topic):
            access = (rule.enable_read_access_control, rule.enable_write_access_control)
            flags = (*access, rule.enable_discovery_protection, rule.enable_liveliness_protection)
            writes, reads = topic == "rt/chatter" or not access[1], not access[0]
            return f"{'w' if writes else '-'}{'r' if reads else '-'}" + "".join(str(int(flag)) for flag in flags)
    return "x"


def set_aside(typed: Governance | Permissions) -> bool:
    """What Cyclone DDS 0.10 is known to refuse or read in its own way (facts, dds-semantics 1.3 to 1.6)."""
    if isinstance(typed, Permissions):
        grant = typed.grants[0]
        domains = [entry for rule in grant.rules for entry in rule.domains]
        expressions = [text.text for rule in grant.rules for criterion in rule.criteria for text in criterion.topics]
        dates = (grant.not_before.text[:4], grant.not_after.text[:4])
        named = len(typed.grants) == 1 and grant.subject_name.text == "CN=/talker"
        usual = named and "2000" <= dates[0] <= "2026" and "2027" <= dates[1] <= "2261"
        zone = any(len(text) > len("2024-01-01T00:00:00") for text in (grant.not_before.text, grant.not_after.text))
        if not usual or zone or "T24" in grant.not_before.text + grant.not_after.text:
            return True
    else:
        domains = [entry for rule in typed.domain_rules for entry in rule.domains]
        expressions = [rule.expression.text for each in typed.domain_rules for rule in each.topic_rules]
        if not any(_holds(rule.domains, 0) for rule in typed.domain_rules):
            return True
    beyond = any(max(entry.low or 0, entry.high or 0) > LARGEST_DOMAIN for entry in domains)
    half_open = any(entry.low is None or entry.high is None for entry in domains)
    own_matching = any(sign in text for text in expressions for sign in "[\\") or not all(map(str.isascii, expressions))
    return beyond or half_open or own_matching


def assert_decided_by_the_letter(cyclone: Plugin, document: bytes) -> bool:
    """Whether it was asked: only of documents with one meaning, and none of the reasons to set one aside."""
    reading = ours.read(document, kind_of(document))
    if reading is None or reading.typed is None or reading.kinds or known_fault(document) or set_aside(reading.typed):
        return False
    answer = cyclone.ask(cyclone.sign(document), kind_of(document), *TOPICS)
    assert answer.refused is None
    assert answer.topics == {topic: by_the_letter(reading.typed, topic) for topic in TOPICS}
    return True


@settings(max_examples=1_000)
@given(document=st.one_of(policy.permissions(), policy.governance()))
def test_competing_rules_are_decided_by_the_letter(cyclone: Plugin, document: bytes) -> None:
    if not assert_decided_by_the_letter(cyclone, document):
        assert b"<domain_rule>" in document, "only a governance without domain 0 is set aside"


def test_no_change_makes_the_plugin_decide_otherwise(cyclone: Plugin) -> None:
    asked: list[bool] = []

    @settings(max_examples=1_200)
    @given(document=documents())
    def search(document: bytes) -> None:
        asked.append(assert_decided_by_the_letter(cyclone, document))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xsd, "MAX_EXPLAINED_BYTES", 0)  # whether a document is valid, not why
        search()
    assert sum(asked) >= 50
