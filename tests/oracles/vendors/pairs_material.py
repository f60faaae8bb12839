"""The documents and enclaves of two sides that meet: each function takes only what differs from the plain case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec import Struct

from tests.keystore import documents
from tests.keystore.builder import PrivateKey, Signed, authority, certificate, enclave, signed_document, write
from tests.keystore.documents import allow, domain_rule, ids, pubsub, topic_rule
from tests.oracles.vendors import recipe

EVERY_DOMAIN = ids((0, 230))
CONTROL_TOPICS = ("control", "control_secure")
LONG = ("2024-01-01T00:00:00", "2034-01-01T00:00:00")
PAST = ("2024-01-01T00:00:00", "2025-01-01T00:00:00")
FUTURE = ("2033-01-01T00:00:00", "2034-01-01T00:00:00")
CONTROL_RULES = (
    topic_rule("control", discovery=False, liveliness=False, metadata="NONE", data="NONE"),
    topic_rule("control_secure"),
)


def governance(*topic_rules: str, domains: str = EVERY_DOMAIN, controls: bool = True, **flags: Any) -> bytes:
    """One domain rule; without topic rules, sros2's. `controls`: rules for the controls come first."""
    rules = (*(CONTROL_RULES if controls else ()), *(topic_rules or (topic_rule(),)))
    return documents.governance(domain_rule(*rules, domains=domains, **flags)).encode()


EVERYTHING = allow(pubsub("*", partitions=("*",)), domains=EVERY_DOMAIN)
CONTROLS_ALLOWED = allow(pubsub(*CONTROL_TOPICS), domains=EVERY_DOMAIN)


def grant(
    subject: str, *rules: str, default: str = "DENY", validity: tuple[str, str] = LONG, controls: bool = True
) -> str:
    """A grant; `controls`: its first rule allows the controls."""
    every = (CONTROLS_ALLOWED, *rules) if controls else rules
    start, end = validity
    return recipe.grant(*every, subject=subject, start=start, end=end, default=default, name=f"of {subject}")


def permissions(*grants: str) -> bytes:
    """A document."""
    return documents.permissions(*grants).encode()


class Authorities(Struct, frozen=True, kw_only=True):
    """The two CAs of a keystore: one and the same, unless split."""

    identity: Signed
    permissions: Signed

    @classmethod
    def shared(cls) -> Authorities:
        """As sros2 makes them."""
        one = authority()
        return cls(identity=one, permissions=one)

    @classmethod
    def split(cls) -> Authorities:
        """Two of their own names."""
        return cls(identity=authority("identity CA"), permissions=authority("permissions CA"))

    def issue(self, subject: str | x509.Name) -> Signed:
        """An identity."""
        return certificate(subject, self.identity)

    def sign(self, document: bytes) -> bytes:
        """A signed document."""
        return signed_document(document, self.permissions)


class Enclave(Struct, frozen=True, kw_only=True):
    """The files of one enclave; the documents signed already. The CAs are those that it trusts itself; their files are
    replaced by `identity_ca` and `permissions_ca`.
    """

    authorities: Authorities
    identity: Signed
    governance: bytes
    permissions: bytes
    key: PrivateKey | None = None
    crl: x509.CertificateRevocationList | None = None
    identity_ca: bytes | None = None
    permissions_ca: bytes | None = None

    def contents(self) -> dict[str, bytes]:
        """By file name."""
        own = self.identity if self.key is None else Signed(self.key, self.identity.certificate)
        revocations = {} if self.crl is None else {"crl.pem": self.crl.public_bytes(Encoding.PEM)}
        trusted = self.authorities
        identity_ca, permissions_ca = (
            self.identity_ca or trusted.identity.pem,
            self.permissions_ca or trusted.permissions.pem,
        )
        return {**enclave(own, identity_ca, permissions_ca, self.governance, self.permissions), **revocations}

    def write(self, directory: Path) -> Path:
        """Write the files into a new directory."""
        directory.mkdir(parents=True)
        return write(directory, self.contents())
