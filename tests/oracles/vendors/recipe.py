"""Keystores of one enclave, /talker, that say only how they differ from a plain one, and what is asked of them.

The plain one is what `ros2 security` makes, with one allow rule (publish and subscribe rt/chatter in domain 0) in the
stock governance. Dates are fresh, since vendors read the real clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from tests.keystore import documents
from tests.keystore.builder import Signed, authority, certificate, enclave, signed_document, write
from tests.keystore.documents import allow, domain_rule, governance, permissions, pubsub
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe

NOW = datetime.now(timezone.utc).replace(microsecond=0)
"""When these keystores were built; every date in them that counts is at least ten minutes away."""

_FORM = "%Y-%m-%dT%H:%M:%S"
LAST_YEAR, NEXT_YEAR = ((NOW + timedelta(days=days)).strftime(_FORM) for days in (-365, 365))

CHATTER = (publish("rt/chatter"), subscribe("rt/chatter"))


def date(*, hours: float) -> str:
    """So far from now, as sros2 writes dates: UTC, and not said so."""
    return (NOW + timedelta(hours=hours)).strftime(_FORM)


def of_topics(*topic_rules: str) -> str:
    """The stock governance with other topic rules."""
    return governance(domain_rule(*topic_rules))


def grant(*rules: str, start: str = LAST_YEAR, end: str = NEXT_YEAR, name: str | None = "/talker", **more: Any) -> str:
    """Of /talker's permissions, unless `more` says otherwise; in force."""
    return documents.grant("/talker", *rules, start=start, end=end, name=name, **more)


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


@lru_cache
def sign(document: bytes, signer: Signed | None = None) -> bytes:
    """The signed message, as sros2 makes it, and once of what most recipes have."""
    return signed_document(document, signer or common_authority())


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
        ca = common_authority().pem
        governance = self.sign_governance(self.governance.encode())
        permissions = self.sign_permissions(self.permissions.encode())
        directory.mkdir(parents=True)
        write(directory, {**enclave(self.identity or talker(), ca, ca, governance, permissions), **self.files})
        return directory
