"""The small healthy keystores that the pairs of samples start from, as quiet as a keystore can be.

Rights are two topics long. The governance encrypts every message, so that a sample shows what it is for and little
else; where somebody reads, that readers can forge (KA724, as under sros2's own governance).
"""

from __future__ import annotations

from msgspec.structs import replace

from .certificates import Certificate
from .documents import DISCOVERY, DomainRule, Governance, Grant, Permissions, Rule, TopicRule
from .keys import Key
from .store import Enclave, Store

IDENTITY_CA = Certificate(key=Key(label="rules identity CA"), subject="identityCA", ca=True, path_length=1)
PERMISSIONS_CA = Certificate(key=Key(label="rules permissions CA"), subject="permissionsCA", ca=True, path_length=1)

TALKER_CERTIFICATE = Certificate(key=Key(label="rules /talker"), subject="/talker", issuer=IDENTITY_CA)
LISTENER_CERTIFICATE = Certificate(key=Key(label="rules /listener"), subject="/listener", issuer=IDENTITY_CA)

TALKING = Rule(publish=("rt/chatter",))
LISTENING = Rule(subscribe=("rt/chatter",))

TALKER_GRANT = Grant(path="/talker", rules=(TALKING, DISCOVERY))
LISTENER_GRANT = Grant(path="/listener", rules=(LISTENING, DISCOVERY))

TALKER = Enclave(path="/talker", certificate=TALKER_CERTIFICATE, permissions=Permissions(grants=(TALKER_GRANT,)))
LISTENER = Enclave(
    path="/listener", certificate=LISTENER_CERTIFICATE, permissions=Permissions(grants=(LISTENER_GRANT,))
)

QUIET = DomainRule(rtps="ENCRYPT_WITH_ORIGIN_AUTHENTICATION")

PROVEN = DomainRule(topics=(TopicRule(metadata="ENCRYPT_WITH_ORIGIN_AUTHENTICATION"),))
"""Readers cannot pass for writers."""

ONE = Store(
    identity_ca=IDENTITY_CA,
    permissions_ca=PERMISSIONS_CA,
    enclaves=(TALKER,),
    governance=Governance(rules=(QUIET,)),
)
"""One enclave, /talker, that publishes /chatter."""

TWO = replace(ONE, enclaves=(TALKER, LISTENER))
"""/talker, and /listener that subscribes to it."""


def talker(**fields: object) -> Enclave:
    """The talker's enclave with `fields` replaced."""
    return replace(TALKER, **fields)


def listener(**fields: object) -> Enclave:
    """The listener's enclave with `fields` replaced."""
    return replace(LISTENER, **fields)


def with_talker(**fields: object) -> Store:
    """ONE with `fields` of its enclave replaced."""
    return replace(ONE, enclaves=(talker(**fields),))


def with_listener(**fields: object) -> Store:
    """TWO with `fields` of the listener's enclave replaced."""
    return replace(TWO, enclaves=(TALKER, listener(**fields)))


def with_grant(**fields: object) -> Store:
    """ONE with `fields` of the talker's grant replaced."""
    grant = replace(TALKER_GRANT, **fields)
    return with_talker(permissions=Permissions(grants=(grant,)))


def with_rules(*rules: Rule) -> Store:
    """ONE with these rules of the talker's grant, and discovery."""
    return with_grant(rules=(*rules, DISCOVERY))


def governed(store: Store, *rules: DomainRule) -> Store:
    """`store` under the governance of `rules`."""
    return replace(store, governance=Governance(rules=rules))


def domain(*topics: TopicRule, **fields: object) -> DomainRule:
    """The stock domain rule with `fields` replaced, and `topics` before its rule for every topic."""
    return replace(DomainRule(), topics=(*topics, TopicRule()), **fields)
