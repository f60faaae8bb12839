"""Whether a grant lets its holder join a domain, as implementations ask before they create a participant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final

from keystore_audit.model.domains import Interval, contains, elementary
from keystore_audit.model.semantics import ReadDomainRule, ReadGrant
from keystore_audit.profiles import Access, JoinCheck

Governed = tuple[tuple[Interval, ReadDomainRule], ...]
"""Domains in question, each with the rules of the governance that decide there."""

UNGRANTED: Final = "the grant allows no"
"""How reasons begin that only permissions mend."""

_BY_DOMAIN: Final = (JoinCheck.ALLOWED_DOMAIN, JoinCheck.LOOSE_TOPIC)
_NOT_JOINING: Final = {
    **dict.fromkeys(_BY_DOMAIN, f"{UNGRANTED} domain that the governance covers"),
    JoinCheck.ANY_ALLOW_RULE: "the grant has no allow rule, and without one no participant is created",
    JoinCheck.TABLE_63: "join access control is on and no topic is without access control, "
    "so no participant is created",
}


def governed(rules: Sequence[ReadDomainRule], domain: int | None, access: Access) -> Governed:
    """The first rule for the domain, or (None) for each that they tell apart; all rules where any counts."""
    asked = elementary(rule.domains for rule in rules) if domain is None else ((domain, domain),)
    most = None if access.any_governance_rule else 1
    return tuple(
        (interval, rule)
        for interval in asked
        for rule in islice((rule for rule in rules if contains(rule.domains, interval[0])), most)
    )


def join_refusals(covered: Governed, grant: ReadGrant, check: JoinCheck) -> Iterator[str]:
    """Why none of the domains can be joined, where that is so."""
    if not _joins(covered, grant, check):
        asked = {interval for interval, _rule in covered}
        low, high = min(asked, default=(0, 232))
        one = check in _BY_DOMAIN and len(asked) == 1 and low == high
        yield f"{UNGRANTED}thing in domain {low}" if one else _NOT_JOINING[check]


def _joins(covered: Governed, grant: ReadGrant, check: JoinCheck) -> bool:
    """Whether the grant lets its holder join one of the domains."""
    if check is JoinCheck.ANY_ALLOW_RULE:
        return any(rule.allow for rule in grant.rules)
    if not covered:
        return True  # that the governance covers no domain is a reason of its own, where it is one
    if check is JoinCheck.TABLE_63:
        return any(not read.rule.enable_join_access_control or _is_loose(read) for _domains, read in covered)
    return any(
        not read.rule.enable_join_access_control
        or (check is JoinCheck.LOOSE_TOPIC and _is_loose(read))
        or grant.default_allow
        or any(low <= upper and lower <= high for each in grant.rules if each.allow for lower, upper in each.domains)
        for (low, high), read in covered
    )


def _is_loose(read: ReadDomainRule) -> bool:
    """Whether some topic of the domain rule has no access control in one direction."""
    topics = read.rule.topic_rules
    return any(not (topic.enable_read_access_control and topic.enable_write_access_control) for topic in topics)
