"""What a participant may do in domain 0, by the letter of the specification and as Fast DDS decides: small references.

They are about one enclave with a document that has one meaning, beside a plain document of the other kind.
"""

from __future__ import annotations

from keystore_audit.keystore.document import DomainRange
from keystore_audit.keystore.typed import Governance, Grant, Operation, Permissions
from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import Matcher


def holds(ranges: tuple[DomainRange, ...], domain: int) -> bool:
    return any((r.low or 0) <= domain <= (r.high if r.high is not None else domain) for r in ranges)


def joins(grant: Grant) -> bool:
    """Whether the grant lets its holder join domain 0, where the governance controls it."""
    return grant.default_allow or any(rule.allow and holds(rule.domains, 0) for rule in grant.rules)


def _matches(expression: str, topic: str) -> bool:
    return parse(expression, Matcher.POSIX).matches(topic)


def _may(grant: Grant, operation: Operation, topic: str) -> bool:
    for rule in grant.rules:
        if not holds(rule.domains, 0):
            continue
        for criterion in rule.criteria:
            in_default_partition = criterion.partitions is None or any(
                _matches(partition.text, "") for partition in criterion.partitions
            )
            matching = any(_matches(expression.text, topic) for expression in criterion.topics)
            if criterion.operation is operation and matching and in_default_partition:
                return rule.allow
    return grant.default_allow


def _governed(governance: Governance, topic: str) -> str:
    domain_rule = next((rule for rule in governance.domain_rules if holds(rule.domains, 0)), None)
    for rule in domain_rule.topic_rules if domain_rule is not None else ():
        if _matches(rule.expression.text, topic):
            access = (rule.enable_read_access_control, rule.enable_write_access_control)
            flags = (*access, rule.enable_discovery_protection, rule.enable_liveliness_protection)
            return _flags(writes=topic == "rt/chatter" or not access[1], reads=not access[0], flags=flags)
    return "x"


def _flags(*, writes: bool, reads: bool, flags: tuple[bool, ...] = (True, True, True, True)) -> str:
    return f"{'w' if writes else '-'}{'r' if reads else '-'}" + "".join(str(int(flag)) for flag in flags)


def by_the_letter(typed: Governance | Permissions, topic: str) -> str:
    """The flags of a topic in domain 0, by the specification, beside a plain document of the other kind."""
    if isinstance(typed, Governance):
        return _governed(typed, topic)
    may = {operation: _may(typed.grants[0], operation, topic) for operation in Operation}
    return _flags(writes=may[Operation.PUBLISH], reads=may[Operation.SUBSCRIBE])


def _may_on_fastdds(grant: Grant, operation: Operation, topic: str) -> bool:
    for rule in grant.rules:
        criteria = [criterion for criterion in rule.criteria if criterion.operation is operation]
        if any(_matches(text.text, topic) for criterion in criteria for text in criterion.topics):
            listed = [criterion.partitions for criterion in criteria]
            default = any(each is None or any(_matches(text.text, "") for text in each) for each in listed)
            return rule.allow and default
    return False


def by_fastdds(typed: Governance | Permissions, topic: str) -> str:
    """The flags as Fast DDS 2.9 gives them to its own enclave (facts, dds-semantics 1.6).

    Rules of every domain apply, the first whose topics match decides, partitions of all its criteria count for all its
    topics, and the default is not looked at.
    """
    if isinstance(typed, Governance):
        return _governed(typed, topic)
    may = {operation: _may_on_fastdds(typed.grants[0], operation, topic) for operation in Operation}
    return _flags(writes=may[Operation.PUBLISH], reads=may[Operation.SUBSCRIBE])
