"""What each vendor accepts from a remote enclave, in small: the statements that the measurements led to.

About documents of `remote`: well-formed, rightly signed, subjects that equal or differ plainly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import Matcher
from tests.oracles.vendors.enclave import Endpoint
from tests.oracles.vendors.pairs_material import LONG
from tests.oracles.vendors.remote import SUBJECT, Criterion, Grant, Remote, Rule, TopicRule


def accepted_by_cyclone(remote: Remote) -> tuple[bool, ...]:
    """The first grant for the subject counts, in date or not; the default is honoured, relay is not looked at."""
    grant = next((grant for grant in remote.grants if grant.subject == SUBJECT), None)
    if grant is None or grant.validity != LONG:
        return (False,) * len(remote.endpoints)
    rules = [rule for rule in grant.rules if rule.holds(remote.domain)]
    if remote.join_control and not (grant.allows_by_default or any(rule.allow for rule in rules)):
        return (False,) * len(remote.endpoints)
    return tuple(_cyclone(grant, rules, _governing(remote, endpoint), endpoint) for endpoint in remote.endpoints)


def _cyclone(grant: Grant, rules: list[Rule], governing: TopicRule, endpoint: Endpoint) -> bool:
    if not _controlled(governing, endpoint):
        return True
    if governing.read_control and governing.write_control:
        listing = (rule.allow for rule in rules if any(_lists(each, endpoint) for each in _not_relay(rule)))
        if not next(listing, grant.allows_by_default):
            return False
    for rule in rules:
        for criterion in rule.criteria:
            if criterion.operation == endpoint.operation.value and _lists(criterion, endpoint):
                enough: Callable[[Iterator[bool]], bool] = all if rule.allow else any
                if enough(_in_one(name, [criterion]) for name in endpoint.partitions or ("",)):
                    return rule.allow
    return grant.allows_by_default


def accepted_by_fastdds(remote: Remote) -> tuple[bool, ...]:
    """The first grant for the subject that is in date counts; the default does not; relay admits a reader."""
    grant = next((grant for grant in remote.grants if grant.subject == SUBJECT and grant.validity == LONG), None)
    rules = [rule for rule in grant.rules if rule.holds(remote.domain)] if grant is not None else []
    if grant is None or (remote.join_control and not any(rule.allow for rule in rules)):
        return (False,) * len(remote.endpoints)
    return tuple(_fastdds(rules, _governing(remote, endpoint), endpoint) for endpoint in remote.endpoints)


def _fastdds(rules: list[Rule], governing: TopicRule, endpoint: Endpoint) -> bool:
    if not _controlled(governing, endpoint):
        return True
    kinds = ("publish",) if endpoint.operation.value == "publish" else ("subscribe", "relay")
    for rule in rules:
        for kind in kinds:
            criteria = [criterion for criterion in rule.criteria if criterion.operation == kind]
            if any(_lists(criterion, endpoint) for criterion in criteria):
                return rule.allow and all(_in_one(name, criteria) for name in endpoint.partitions or ("",))
    return False


def _governing(remote: Remote, endpoint: Endpoint) -> TopicRule:
    return next(rule for rule in remote.topic_rules if _matches(rule.expression, endpoint.topic))


def _controlled(governing: TopicRule, endpoint: Endpoint) -> bool:
    return governing.write_control if endpoint.operation.value == "publish" else governing.read_control


def _not_relay(rule: Rule) -> Iterator[Criterion]:
    return (criterion for criterion in rule.criteria if criterion.operation != "relay")


def _lists(criterion: Criterion, endpoint: Endpoint) -> bool:
    return any(_matches(expression, endpoint.topic) for expression in criterion.topics)


def _in_one(name: str, criteria: list[Criterion]) -> bool:
    """Whether a criterion lists the partition; without the element it lists the one with the empty name."""
    listed = (("",) if criterion.partitions is None else criterion.partitions for criterion in criteria)
    return any(
        name == expression if not expression else _matches(expression, name) for one in listed for expression in one
    )


def _matches(expression: str, name: str) -> bool:
    return parse(expression, Matcher.POSIX).matches(name)
