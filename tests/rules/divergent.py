"""Keystores that implementations may read differently, and what the rules of KA6 say of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from zoneinfo import ZoneInfo

from keystore_audit.findings import Finding
from keystore_audit.keystore.document import DomainRange
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Criterion, Operation, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.divergence.find import divergences
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.meaning import Divergence
from keystore_audit.profiles import DEFAULT, VARIANTS, Profile
from keystore_audit.rules.judge import judge
from tests.rules.evidence import (
    AT,
    allow,
    context,
    enclave,
    grant,
    keystore,
    meaning,
    permissions,
    rules_of,
    text,
)

P7S = "enclaves/talker/permissions.p7s"
OWN = rules_of("divergence", "portability")
Domains = tuple[tuple[int | None, int | None], ...]
Listed = Sequence[tuple[Sequence[str], Sequence[str] | None]]
"""Criteria: topics, and partitions if any are listed."""


def ruled(
    *,
    allows: bool = True,
    domains: Domains = ((0, 0),),
    line: int = 42,
    **criteria: Listed,
) -> Rule:
    """A rule with the criteria of `publish`, `subscribe` and `relay`."""
    return Rule(
        allow=allows,
        domains=tuple(DomainRange(low=low, high=high, line=line) for low, high in domains),
        criteria=tuple(
            Criterion(
                operation=Operation(operation),
                topics=tuple(text(topic, line) for topic in topics),
                partitions=None if partitions is None else tuple(text(each, line) for each in partitions),
                data_tags=False,
                line=line,
            )
            for operation, listed in criteria.items()
            for topics, partitions in listed
        ),
        line=line,
    )


def talking(*rules: Rule, governed: Any = None, **more: Any) -> Keystore:
    """The healthy keystore with these rules in the talker's grant, and a governance for both."""
    own = permissions(P7S, grant("/talker", *rules, **more))
    if governed is None:
        return keystore(enclave("/talker", permissions=own), enclave("/listener"))
    everywhere = grant("/listener", allow(["rt/chatter"], domains=[(0, 5)]))
    other = permissions("enclaves/listener/permissions.p7s", everywhere)
    return keystore(
        enclave("/talker", permissions=own, governance=governed),
        enclave("/listener", permissions=other, governance=governed),
    )


def chosen(*names: str) -> tuple[Profile, ...]:
    return tuple(VARIANTS[name] for name in names or DEFAULT)


def views(store: Keystore, zone: str | None = None) -> AccessViews:
    return AccessViews(documents_of(store), AT, ZoneInfo(zone) if zone else None)


def compared(
    store: Keystore, *names: str, domain: int | None = None, zone: str | None = None
) -> tuple[Divergence, ...]:
    return divergences(store, chosen(*names), AT, views(store, zone), domain)


def spoken(store: Keystore, *names: str, domain: int | None = None, zone: str | None = None) -> tuple[Finding, ...]:
    """What the rules of KA6 find."""
    found = compared(store, *names, domain=domain, zone=zone)
    about = context(store, profiles=chosen(*names), meaning=meaning(divergences=found))
    return judge(about, OWN).findings


def codes(store: Keystore, *names: str, **more: Any) -> list[str]:
    return sorted({finding.code for finding in spoken(store, *names, **more)})
