"""Keystores of one enclave, /talker, that say only how they differ from a plain one, and what is asked of them.

The plain one is what `ros2 security` makes, with one allow rule (publish and subscribe rt/chatter in domain 0) in the
stock governance. Dates are fresh, since vendors read the real clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from pathlib import Path
from xml.sax.saxutils import escape

from msgspec import Struct, field

from tests.keystore.builder import Signed, authority, certificate
from tests.keystore.messages import PYCA_OPTIONS, by_pyca
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe

NOW = datetime.now(timezone.utc).replace(microsecond=0)
"""When these keystores were built; every date in them that counts is at least ten minutes away."""

_FORM = "%Y-%m-%dT%H:%M:%S"
LAST_YEAR, NEXT_YEAR = ((NOW + timedelta(days=days)).strftime(_FORM) for days in (-365, 365))

CHATTER = (publish("rt/chatter"), subscribe("rt/chatter"))


def date(*, hours: float) -> str:
    """So far from now, as sros2 writes dates: UTC, and not said so."""
    return (NOW + timedelta(hours=hours)).strftime(_FORM)


def _element(name: str, *content: str) -> str:
    return f"<{name}>{''.join(content)}</{name}>"


def _flag(name: str, value: bool | str) -> str:
    return _element(name, value if isinstance(value, str) else str(value).lower())


DomainEntry = int | tuple[int | None, int | None]
"""An id, or a range by its bounds."""


def domains(*ids: DomainEntry) -> str:
    """A set of domains: ids, and ranges with the bounds that are not None."""
    entries = []
    for entry in ids:
        if isinstance(entry, int):
            entries.append(_element("id", str(entry)))
        else:
            bounds = zip(("min", "max"), entry, strict=True)
            entries.append(_element("id_range", *(_element(n, str(b)) for n, b in bounds if b is not None)))
    return _element("domains", *entries)


DOMAIN_0 = domains(0)


def topic_rule(
    expression: str = "*",
    *,
    read: bool | str = True,
    write: bool | str = True,
    discovery: bool | str = True,
    liveliness: bool | str = True,
    metadata: str = "ENCRYPT",
    data: str = "ENCRYPT",
) -> str:
    """Of a governance; `expression` is XML."""
    return _element(
        "topic_rule",
        _element("topic_expression", expression),
        _flag("enable_discovery_protection", discovery),
        _flag("enable_liveliness_protection", liveliness),
        _flag("enable_read_access_control", read),
        _flag("enable_write_access_control", write),
        _element("metadata_protection_kind", metadata),
        _element("data_protection_kind", data),
    )


def domain_rule(
    *topic_rules: str,
    where: str = DOMAIN_0,
    unauthenticated: bool | str = False,
    join: bool | str = True,
    discovery: str = "ENCRYPT",
    liveliness: str = "ENCRYPT",
    rtps: str = "SIGN",
) -> str:
    """Of a governance; without topic rules, those of the stock one."""
    return _element(
        "domain_rule",
        where,
        _flag("allow_unauthenticated_participants", unauthenticated),
        _flag("enable_join_access_control", join),
        _element("discovery_protection_kind", discovery),
        _element("liveliness_protection_kind", liveliness),
        _element("rtps_protection_kind", rtps),
        _element("topic_access_rules", *(topic_rules or (topic_rule(),))),
    )


_DDS = '<?xml version="1.0" encoding="UTF-8"?>\n<dds>{}</dds>\n'


def governance(*domain_rules: str) -> str:
    """A whole document; without domain rules, the stock one."""
    return _DDS.format(_element("domain_access_rules", *(domain_rules or (domain_rule(),))))


def of_topics(*topic_rules: str, where: str = DOMAIN_0) -> str:
    """The stock governance with other topic rules."""
    return governance(domain_rule(*topic_rules, where=where))


def criterion(kind: str, *topics: str, partitions: tuple[str, ...] | None = None) -> str:
    """A `publish`, `subscribe` or `relay`; `partitions` None leaves the element out. Names are texts, not XML."""
    listed = _element("topics", *(_element("topic", escape(topic)) for topic in topics))
    if partitions is not None:
        listed += _element("partitions", *(_element("partition", escape(partition)) for partition in partitions))
    return _element(kind, listed)


def pub(*topics: str, partitions: tuple[str, ...] | None = None) -> str:
    """Criteria of writers."""
    return criterion("publish", *topics, partitions=partitions)


def sub(*topics: str, partitions: tuple[str, ...] | None = None) -> str:
    """Criteria of readers."""
    return criterion("subscribe", *topics, partitions=partitions)


def pubsub(*topics: str, partitions: tuple[str, ...] | None = None) -> str:
    """Criteria of both."""
    return pub(*topics, partitions=partitions) + sub(*topics, partitions=partitions)


def allow(*criteria: str, where: str = DOMAIN_0) -> str:
    """A rule that allows."""
    return _element("allow_rule", where, *criteria)


def deny(*criteria: str, where: str = DOMAIN_0) -> str:
    """A rule that denies."""
    return _element("deny_rule", where, *criteria)


def grant(
    *rules: str,
    subject: str = "CN=/talker",
    start: str = LAST_YEAR,
    end: str = NEXT_YEAR,
    default: str | None = "DENY",
    name: str | None = "/talker",
) -> str:
    """Of permissions; `default` and `name` None leave them out, `subject` is XML."""
    head = "<grant>" if name is None else f'<grant name="{name}">'
    validity = _element("validity", _element("not_before", start), _element("not_after", end))
    last = "" if default is None else _element("default", default)
    return head + _element("subject_name", subject) + validity + "".join(rules) + last + "</grant>"


def permissions(*grants: str) -> str:
    """A whole document."""
    return _DDS.format(_element("permissions", *grants))


def of_rules(*rules: str, default: str | None = "DENY") -> str:
    """Permissions of one grant that holds."""
    return permissions(grant(*rules, default=default))


@lru_cache
def common_authority() -> Signed:
    """The CA for both roles, as sros2 has it."""
    return authority()


@lru_cache
def talker() -> Signed:
    """The enclave's identity."""
    return certificate("/talker", common_authority())


def sign(document: bytes, signer: Signed | None = None) -> bytes:
    """The signed message, as sros2 makes it."""
    return by_pyca(PYCA_OPTIONS["pyca as sros2"], signer or common_authority(), document)


Signing = Callable[[bytes], bytes]

_PLAIN_GOVERNANCE = governance()
_PLAIN_PERMISSIONS = of_rules(allow(pubsub("rt/chatter")))


class Recipe(Struct, frozen=True, kw_only=True):
    """A keystore by its differences from the plain one, and the question.

    `files` replaces whole files (None: leaves one out); `sign_governance` and `sign_permissions` make the messages.
    """

    title: str
    endpoints: tuple[Endpoint, ...] = CHATTER
    governance: str = _PLAIN_GOVERNANCE
    permissions: str = _PLAIN_PERMISSIONS
    identity: Signed | None = None
    sign_governance: Signing = sign
    sign_permissions: Signing = sign
    files: Mapping[str, bytes | None] = field(default_factory=dict)
    domain: int = 0
    time_zone: str = "UTC"

    def build(self, directory: Path) -> Path:
        """Write the enclave into this new directory."""
        directory.mkdir(parents=True)
        identity = self.identity or talker()
        files: dict[str, bytes | None] = {
            "identity_ca.cert.pem": common_authority().pem,
            "permissions_ca.cert.pem": common_authority().pem,
            "cert.pem": identity.pem,
            "key.pem": identity.key_pem,
            "governance.p7s": self.sign_governance(self.governance.encode()),
            "permissions.p7s": self.sign_permissions(self.permissions.encode()),
        }
        for name, content in {**files, **self.files}.items():
            if content is not None:
                (directory / name).write_bytes(content)
        return directory
