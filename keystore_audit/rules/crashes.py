"""KA5: signed documents that end the process of whoever reads them, in some implementation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.defect import Kind
from keystore_audit.model.claims.ability import sent
from keystore_audit.remedy import Act, decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.governance import in_document
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import DocumentUse, PermissionsUse

_CRASHES: Final = "whoever reads it, the enclave or a peer, crashes, and one signed file stops a robot."

_MEASURED: Final = "fastdds-2.9"


@rule(
    "KA517",
    Severity.CRITICAL,
    clause="Measured on Cyclone DDS 0.10.2 and Fast DDS 2.9.1; the XSD of DDS-Security 1.1 lets it pass",
    remedy=decision("Find out who signed it, and take the empty element out of the .xml.", Act.EDIT),
    stops=True,
)
def empty_topic_expression(use: DocumentUse, _context: Context) -> Iterator[Violation]:
    """A <topic> or <topic_expression> is empty: implementations dereference nothing and die (measured).

    Permissions come from peers too, so that one document which the authority signed takes others down. What an
    implementation without the fault makes of it is unknown.
    """
    yield from in_document(use, _CRASHES, Kind.EMPTY_TOPIC)


@rule(
    "KA518",
    Severity.CRITICAL,
    clause="Measured on Cyclone DDS 0.10.2, read in 11.0.1 (access_control_parser.c); schema-invalid",
    remedy=in_permissions("Find out who signed it, and give the rule its <domains>"),
    stops=True,
)
def rule_without_domains(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """A rule has no <domains>: Cyclone DDS dereferences nothing and dies (measured), Fast DDS refuses the document.

    Permissions come from peers too, so that one document which the authority signed takes others down.
    """
    yield from in_document(use, _CRASHES, Kind.RULE_WITHOUT_DOMAINS)


@rule(
    "KA521",
    Severity.CRITICAL,
    clause="Measured: Fast DDS 2.9.1 and 2.14.6 crash; schema-invalid",
    remedy=in_permissions("Find out who signed it, and write the document anew"),
    stops=True,
)
def empty_element(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The document, or the date of a grant, is empty: Fast DDS 2.9 and 2.14 dereference nothing and die (measured).

    Others refuse the document. Permissions come from peers too, so that one document which the authority signed takes
    others down.
    """
    yield from in_document(use, _CRASHES, Kind.EMPTY_ELEMENT)


@rule(
    "KA522",
    Severity.MEDIUM,
    clause="Measured on Fast DDS 2.9.1; ros2/sros2#228",
    remedy=decision(
        "Say several names by one expression, take out rules that the nodes do not use, or give the nodes "
        "several enclaves. Then sign the documents again with the permissions CA."
    ),
)
def permissions_too_large(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """Certificate and permissions do not fit in a message of the handshake: on Fast DDS the enclave talks to nobody.

    High under Fast DDS 2.9, where its process ends as soon as it answers a peer's handshake (measured); where it asks
    first, there is an error in its log alone. Other versions of Fast DDS were not asked. Cyclone DDS sends them in
    parts (measured). How much fits depends on the kind of key: 63,000 octets with all, 63,700 with none.
    """
    for enclave in use.enclaves:
        octets = sent(enclave)
        limits = {p.name: p.local.most_sent for p in context.profiles if p.local.most_sent is not None}
        unfit = tuple(name for name, limit in limits.items() if octets > limit)
        if unfit:
            yield Violation(
                message=f"{enclave.path} shows its peers {octets:,} octets of certificate and permissions; in a "
                f"handshake of Fast DDS 2.9.1 {min(limits.values()):,} fit, else it talks to nobody and dies of it.",
                severity=Severity.HIGH if _MEASURED in unfit else None,
                locations=(Location(path=use.signed.file.place),),
                enclave=enclave.path,
                profiles=unfit,
                key="",
            )
