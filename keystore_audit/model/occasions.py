"""For which peculiarities a keystore's documents give an occasion; without one, implementations decide alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import TYPE_CHECKING, Final

from keystore_audit.keystore.document import Text
from keystore_audit.keystore.typed import Governance, Grant, Permissions
from keystore_audit.model.inventory import Typed
from keystore_audit.model.matching.expression import has_wildcard, parse
from keystore_audit.model.semantics import names_partitions
from keystore_audit.model.validity import counts_at, read_date
from keystore_audit.profiles import SPEC, Access, TopicCheck, check_reader

if TYPE_CHECKING:  # most audits are told no zone
    from zoneinfo import ZoneInfo


class Occasions:
    """What the `files` hold, at `at` (aware UTC); `zone`: where the robot is, None if not said."""

    def __init__(self, files: Sequence[Typed], at: datetime, zone: ZoneInfo | None) -> None:
        self.files = files
        self._at = at
        self._zone = zone

    def has(self, occasion: str, access: Access) -> bool:
        """Whether there is one of that name for what the row does."""
        return OCCASIONS[occasion](self, access)

    @cached_property
    def _typed(self) -> list[Governance | Permissions]:
        return [each for file in self.files for each in file.readings.distinct]

    @cached_property
    def governances(self) -> list[Governance]:
        """The governances that could be parsed, in each reading."""
        return [each for each in self._typed if isinstance(each, Governance)]

    @cached_property
    def permissions(self) -> list[Permissions]:
        """The permissions that could be parsed, in each reading."""
        return [each for each in self._typed if isinstance(each, Permissions)]

    @cached_property
    def grants(self) -> list[Grant]:
        """All grants."""
        return [grant for permissions in self.permissions for grant in permissions.grants]

    @cached_property
    def dates(self) -> set[str]:
        """The texts of the grants' dates."""
        return {date.text for grant in self.grants for date in (grant.not_before, grant.not_after)}

    @cached_property
    def unusual_expressions(self) -> list[str]:
        """Expressions that a matcher may read in its own way."""
        found = {expression.text for typed in self._typed for expression in expressions(typed)}
        return list(filter(has_wildcard, found))

    def may_be_out_of_date(self, grant: Grant, access: Access) -> bool:
        """Whether it is uncertain that the grant counts."""
        dates = [read_date(date.text, access.dates, self._zone) for date in (grant.not_before, grant.not_after)]
        start, end = dates
        return start is None or end is None or not counts_at(start, end, self._at, access.dates).must


def expressions(typed: Governance | Permissions) -> Iterator[Text]:
    """Every topic and partition expression of the document."""
    if isinstance(typed, Governance):
        for domain_rule in typed.domain_rules:
            yield from (topic.expression for topic in domain_rule.topic_rules)
        return
    for grant in typed.grants:
        for rule in grant.rules:
            for criterion in rule.criteria:
                yield from criterion.topics
                yield from criterion.partitions or ()


def _another_reading(held: Occasions, access: Access) -> bool:
    usual = SPEC.access.matcher
    return any(not parse(text, access.matcher).agrees(parse(text, usual)) for text in held.unusual_expressions)


def _out_of_date(held: Occasions, access: Access) -> bool:
    return any(held.may_be_out_of_date(grant, access) for grant in held.grants)


def _several_or_out_of_date(held: Occasions, access: Access) -> bool:
    several = any(len(permissions.grants) > 1 for permissions in held.permissions)
    return several or (access.joins_out_of_date and _out_of_date(held, access))  # by the one grant that there is


def _denial(held: Occasions, access: Access) -> bool:
    """Of each operation by itself, what the first rule denies in one partition alone matters: or it is denied there."""
    each = access.topic_check is TopicCheck.EACH
    grants = (grant for grant in held.grants if not each or names_partitions(grant))
    return any(not rule.allow for grant in grants for rule in grant.rules)


def _open_join(held: Occasions, _access: Access) -> bool:
    rules = (rule for governance in held.governances for rule in governance.domain_rules)
    return any(not rule.enable_join_access_control for rule in rules)


def _several_rules(held: Occasions, _access: Access) -> bool:
    return any(
        len(governance.domain_rules) > 1 or any(len(rule.topic_rules) > 1 for rule in governance.domain_rules)
        for governance in held.governances
    )


def _origin(held: Occasions, _access: Access) -> bool:
    return any(
        kind.authenticates_origin
        for governance in held.governances
        for rule in governance.domain_rules
        for kind in (
            rule.discovery_protection_kind,
            rule.liveliness_protection_kind,
            rule.rtps_protection_kind,
            *(topic.metadata_protection_kind for topic in rule.topic_rules),
        )
    )


OCCASIONS: Final[Mapping[str, Callable[[Occasions, Access], bool]]] = {
    "an expression that matchers read differently": _another_reading,
    "several grants, or one that may be out of date": _several_or_out_of_date,
    "a grant that may be out of date": _out_of_date,
    "a deny rule": _denial,
    "join access control is off": _open_join,
    "several rules of the governance": _several_rules,
    "a kind WITH_ORIGIN_AUTHENTICATION": _origin,
    "always": lambda _held, _access: True,
}
"""By the column `matters` of quirks.toml: whether some document gives an occasion for a peculiarity."""

check_reader("model.occasions", "matters", {*OCCASIONS, "as read", "never"})
