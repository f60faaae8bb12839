"""Topics that somebody may write and nobody may read, or the reverse, in no domain and partition that they share."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final

from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.anomalies_classes import Effort
from keystore_audit.model.anomalies_rules import domain_bits
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.names import AMBIENT_TOPICS, PARAMETER_SERVICES
from keystore_audit.model.semantics import ReadGrant, ReadRule

USUAL_TOPICS: Final = (*AMBIENT_TOPICS, "rt/clock")
"""Topics that nodes have whether or not anybody is at the other end."""

_USUAL_SERVICE: Final = re.compile(rf"/(?:{'|'.join(PARAMETER_SERVICES)}|get_type_description)(?:Request|Reply)\Z")
"""Services that every node offers, whether or not anybody calls them."""

_WILDCARDS: Final = frozenset("*?[\\")
_COUNTERPART: Final = {Operation.PUBLISH: Operation.SUBSCRIBE, Operation.SUBSCRIBE: Operation.PUBLISH}


class Counterparts:
    """Who may read and write what, by the grants of all documents of a keystore, as one implementation reads them.

    Grants count for everybody whom they name, also for those who are not in the keystore.
    """

    def __init__(
        self, documents: Iterable[ReadDocument], governances: Iterable[GovernanceFile], matcher: Matcher, effort: Effort
    ) -> None:
        self._matcher = matcher
        self._effort = effort
        self._grants = [grant for document in documents for grant in document.grants or ()]
        rules = [rule for grant in self._grants for rule in grant.rules]
        self._simple = _is_simple(rules)
        self._listed = {operation: _listed(rules, operation) for operation in _COUNTERPART}
        self._wild = {
            operation: tuple(text for text in texts if not _WILDCARDS.isdisjoint(text))
            for operation, texts in self._listed.items()
        }
        self._default = any(grant.default_allow for grant in self._grants)
        self._open = {operation: _open(governances, operation) for operation in _COUNTERPART}
        self._by_topic: Mapping[str, Sequence[ReadGrant]] | None = None

    def missing(self, grant: ReadGrant) -> Iterator[tuple[Operation, str]]:
        """The topics that the grant allows by name and nobody may be at the other end of."""
        if self._default:
            return
        for operation, other in _COUNTERPART.items():
            own = _listed(grant.rules, operation)
            alone = own - self._listed[other] if self._simple else own
            for topic in sorted(alone):
                if not _is_usual(topic) and not self._met(grant, operation, topic, other):
                    yield operation, topic

    def _met(self, grant: ReadGrant, operation: Operation, topic: str, other: Operation) -> bool:
        """Whether somebody may be at the other end; also where the topic is no single name, or not allowed at all."""
        self._effort.compare(1)
        if parse(topic, self._matcher).literal != topic:
            return True
        if any(parse(text, self._matcher).matches(topic) for text in self._open[other]):
            return True
        mine = self._places(grant, operation, topic)
        if not mine:
            return True
        if self._simple:
            self._effort.compare(len(self._wild[other]) // 64)
            return any(parse(text, self._matcher).matches(topic) for text in self._wild[other])
        return any(mine & self._places(each, other, topic) for each in self._candidates(topic))

    def _candidates(self, topic: str) -> Iterator[ReadGrant]:
        """The grants that name the topic or have wildcards."""
        if self._by_topic is None:
            found: dict[str, list[ReadGrant]] = {"*": []}
            for grant in self._grants:
                texts = _listed(grant.rules, Operation.PUBLISH) | _listed(grant.rules, Operation.SUBSCRIBE)
                if any(not _WILDCARDS.isdisjoint(text) for text in texts):
                    found["*"].append(grant)
                for text in texts - {"*"}:
                    found.setdefault(text, []).append(grant)
            self._by_topic = found
        for grant in (*self._by_topic.get(topic, ()), *self._by_topic["*"]):
            self._effort.compare(1)
            yield grant

    def _places(self, grant: ReadGrant, operation: Operation, topic: str) -> int:
        """The domains in which the grant allows it, in whatever partition."""
        allowed, denied = 0, 0
        for rule in grant.rules:
            for area in rule.region(operation):
                if topic in area.topics or any(_matches(text, self._matcher, topic) for text in area.topics):
                    domains = domain_bits(rule.domains)
                    if rule.allow:
                        allowed |= domains & ~denied
                    elif area.partitions is None:
                        denied |= domains
        return allowed


def _matches(text: str, matcher: Matcher, topic: str) -> bool:
    return not _WILDCARDS.isdisjoint(text) and parse(text, matcher).matches(topic)


def _listed(rules: Iterable[ReadRule], operation: Operation) -> set[str]:
    """What the allow rules list."""
    found: set[str] = set()
    for rule in rules:
        if rule.allow:
            for area in rule.region(operation):
                found.update(area.topics)
    return found


def _is_simple(rules: Sequence[ReadRule]) -> bool:
    """Whether all rules allow, in the same domains: then whatever two of them list meets."""
    return all(rule.allow and rule.domains == rules[0].domains for rule in rules)


def _open(governances: Iterable[GovernanceFile], operation: Operation) -> tuple[str, ...]:
    """Expressions of topics for which no grant is asked, in some domain of some governance."""
    return tuple(
        dict.fromkeys(
            topic.expression.text
            for file in governances
            for domain_rule in (file.governance.domain_rules if file.governance else ())
            for topic in domain_rule.topic_rules
            if not (
                topic.enable_write_access_control
                if operation is Operation.PUBLISH
                else topic.enable_read_access_control
            )
        )
    )


@lru_cache(maxsize=4096)
def _is_usual(topic: str) -> bool:
    return topic in USUAL_TOPICS or _USUAL_SERVICE.search(topic) is not None
