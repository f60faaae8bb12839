"""What sros2 grants for a policy: the rules that its permissions.xsl writes for one enclave.

First a deny rule with everything denied, then an allow rule with everything allowed, each for publishing and for
subscribing, in the default partition; at last `ros_discovery_info` both ways, which every DDS implementation of ROS 2
needs; the default is DENY. The domain is that of whoever signs (ROS_DOMAIN_ID), so that here it is every one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from msgspec import Struct

from keystore_audit.intent.intent import IntendedRight
from keystore_audit.intent.policy import Profiles
from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange, Text
from keystore_audit.keystore.permissions import Criterion, Grant, Operation, Rule
from keystore_audit.model.names import DISCOVERY_TOPIC, dds_expressions
from keystore_audit.model.semantics import DIRECTIONS

_NO_DATE: Final = Text(text="", line=None)


class PolicyGrant(Struct, frozen=True, kw_only=True):
    """The grant of one `<profiles>`. `rights`: by (allow, operation, expression), the first right that has it.

    Lines are those of the policy, or of the file that it includes; dates are left out: sros2 takes those of the
    certificate.
    """

    grant: Grant
    rights: Mapping[tuple[bool, Operation, str], IntendedRight]


def policy_grant(profiles: Profiles) -> PolicyGrant:
    """What sros2 grants for it."""
    rights: dict[tuple[bool, Operation, str], IntendedRight] = {}
    for right in profiles.rights:
        for operation, expression in dds_expressions(right.action.value, right.name):
            rights.setdefault((right.allow, operation, expression), right)
    rules = [_rule(rights, allow=allow) for allow in (False, True) if any(key[0] is allow for key in rights)]
    grant = Grant(
        name=profiles.enclave,
        subject_name=Text(text=f"CN={profiles.enclave}", line=profiles.location.line),
        not_before=_NO_DATE,
        not_after=_NO_DATE,
        rules=(*rules, _discovery()),
        default_allow=False,
        default_line=None,
        line=profiles.location.line,
    )
    return PolicyGrant(grant=grant, rights=rights)


def _rule(rights: Mapping[tuple[bool, Operation, str], IntendedRight], *, allow: bool) -> Rule:
    listed: dict[Operation, list[Text]] = {operation: [] for operation in DIRECTIONS}
    for (allowed, operation, expression), right in rights.items():
        if allowed is allow:
            listed[operation].append(Text(text=expression, line=right.location.line))
    return _every_domain(allow, (_criterion(operation, texts) for operation, texts in listed.items() if texts))


def _discovery() -> Rule:
    return _every_domain(True, (_criterion(o, [Text(text=DISCOVERY_TOPIC, line=None)]) for o in DIRECTIONS))


def _criterion(operation: Operation, texts: Iterable[Text]) -> Criterion:
    return Criterion(operation=operation, topics=tuple(texts), partitions=None, data_tags=False, line=None)


def _every_domain(allow: bool, criteria: Iterator[Criterion]) -> Rule:
    everywhere = DomainRange(low=0, high=MAX_DOMAIN, line=None)
    return Rule(allow=allow, domains=(everywhere,), criteria=tuple(criteria), line=None)
