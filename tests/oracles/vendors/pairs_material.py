"""The documents and enclaves of two sides that meet: each function takes only what differs from the plain case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from tests.keystore.builder import PrivateKey, Signed, authority, certificate, signed_document

EVERY_DOMAIN = "<id_range><min>0</min><max>230</max></id_range>"
ZERO = "<id>0</id>"
CONTROL_TOPICS = ("control", "control_secure")
LONG = ("2024-01-01T00:00:00", "2034-01-01T00:00:00")
PAST = ("2024-01-01T00:00:00", "2025-01-01T00:00:00")
FUTURE = ("2033-01-01T00:00:00", "2034-01-01T00:00:00")
YES_NO = {True: "true", False: "false"}


def topic_rule(
    expression: str = "*",
    *,
    discovery: bool = True,
    liveliness: bool = True,
    read: bool = True,
    write: bool = True,
    metadata: str = "ENCRYPT",
    data: str = "ENCRYPT",
) -> str:
    """One rule of a governance; the plain one is sros2's."""
    return f"""<topic_rule><topic_expression>{expression}</topic_expression>
<enable_discovery_protection>{YES_NO[discovery]}</enable_discovery_protection>
<enable_liveliness_protection>{YES_NO[liveliness]}</enable_liveliness_protection>
<enable_read_access_control>{YES_NO[read]}</enable_read_access_control>
<enable_write_access_control>{YES_NO[write]}</enable_write_access_control>
<metadata_protection_kind>{metadata}</metadata_protection_kind>
<data_protection_kind>{data}</data_protection_kind></topic_rule>
"""


CONTROL_RULES = (
    topic_rule("control", discovery=False, liveliness=False, metadata="NONE", data="NONE"),
    topic_rule("control_secure"),
)


def governance(
    *topic_rules: str,
    join: bool = True,
    unauthenticated: bool = False,
    discovery: str = "ENCRYPT",
    liveliness: str = "ENCRYPT",
    rtps: str = "SIGN",
    domains: str = EVERY_DOMAIN,
    controls: bool = True,
) -> bytes:
    """One domain rule; without topic rules, sros2's. `controls`: rules for the controls come first."""
    rules = (*(CONTROL_RULES if controls else ()), *(topic_rules or (topic_rule(),)))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds><domain_access_rules><domain_rule><domains>{domains}</domains>
<allow_unauthenticated_participants>{YES_NO[unauthenticated]}</allow_unauthenticated_participants>
<enable_join_access_control>{YES_NO[join]}</enable_join_access_control>
<discovery_protection_kind>{discovery}</discovery_protection_kind>
<liveliness_protection_kind>{liveliness}</liveliness_protection_kind>
<rtps_protection_kind>{rtps}</rtps_protection_kind>
<topic_access_rules>{"".join(rules)}</topic_access_rules></domain_rule></domain_access_rules></dds>
""".encode()


def criterion(operation: str, topics: Sequence[str], partitions: Sequence[str] | None = None) -> str:
    """A publish, subscribe or relay element."""
    listed = "".join(f"<topic>{topic}</topic>" for topic in topics)
    named = "".join(f"<partition>{partition}</partition>" for partition in partitions or ())
    where = f"<partitions>{named}</partitions>" if partitions is not None else ""
    return f"<{operation}><topics>{listed}</topics>{where}</{operation}>"


def both(topics: Sequence[str], partitions: Sequence[str] | None = None) -> str:
    """Publish and subscribe alike."""
    return criterion("publish", topics, partitions) + criterion("subscribe", topics, partitions)


def allow(*criteria: str, domains: str = ZERO) -> str:
    """An allow rule."""
    return f"<allow_rule><domains>{domains}</domains>{''.join(criteria)}</allow_rule>\n"


def deny(*criteria: str, domains: str = ZERO) -> str:
    """A deny rule."""
    return f"<deny_rule><domains>{domains}</domains>{''.join(criteria)}</deny_rule>\n"


EVERYTHING = allow(both(["*"], ["*"]), domains=EVERY_DOMAIN)
CONTROLS_ALLOWED = allow(both(CONTROL_TOPICS), domains=EVERY_DOMAIN)


def grant(
    subject: str, *rules: str, default: str = "DENY", validity: tuple[str, str] = LONG, controls: bool = True
) -> str:
    """A grant; `controls`: its first rule allows the controls."""
    return f"""<grant name="of {subject}"><subject_name>{subject}</subject_name>
<validity><not_before>{validity[0]}</not_before><not_after>{validity[1]}</not_after></validity>
{CONTROLS_ALLOWED if controls else ""}{"".join(rules)}<default>{default}</default></grant>
"""


def permissions(*grants: str) -> bytes:
    """A document."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds><permissions>{"".join(grants)}</permissions></dds>
""".encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class Authorities:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Enclave:
    """The files of one enclave; the documents signed already. The CAs are those that it trusts itself; `permissions_ca`
    replaces the file of one.
    """

    authorities: Authorities
    identity: Signed
    governance: bytes
    permissions: bytes
    key: PrivateKey | None = None
    crl: x509.CertificateRevocationList | None = None
    permissions_ca: bytes | None = None

    def contents(self) -> dict[str, bytes]:
        """By file name."""
        key = self.identity if self.key is None else Signed(self.key, self.identity.certificate)
        revocations = {} if self.crl is None else {"crl.pem": self.crl.public_bytes(Encoding.PEM)}
        return {
            "identity_ca.cert.pem": self.authorities.identity.pem,
            "permissions_ca.cert.pem": self.permissions_ca or self.authorities.permissions.pem,
            "cert.pem": self.identity.pem,
            "key.pem": key.key_pem,
            "governance.p7s": self.governance,
            "permissions.p7s": self.permissions,
            **revocations,
        }

    def write(self, directory: Path) -> Path:
        """Write the files into a new directory."""
        directory.mkdir(parents=True)
        for file, content in self.contents().items():
            (directory / file).write_bytes(content)
        return directory
