"""KA7: the properties that both engines decide. One rule for each; its name is the property's id."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from keystore_audit.findings import Location, Severity
from keystore_audit.properties import access_control, authentication, encryption
from keystore_audit.properties.counterexample import Counterexample
from keystore_audit.properties.property import Property, Status
from keystore_audit.properties.result import PropertyResult
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Rule, Violation, rule


def _property_rule(code: str, severity: Severity, prop: Property, remedy: str, why: str) -> Rule[PropertyResult]:
    """The rule that a violated property is a finding. `why`: why it matters and what it cannot know."""

    def check(result: PropertyResult, context: Context) -> Iterator[Violation]:
        violated = {name: r for name, r in result.profiles.items() if r.status is Status.VIOLATED}
        if violated:
            first = next(iter(violated.values()))
            everywhere = len(violated) == len(context.profiles)
            yield Violation(
                message=_message(prop, first.counterexample),
                locations=_locations(first.counterexample),
                enclave=_enclave(first.counterexample),
                profiles=() if everywhere else tuple(violated),
                key=prop.id,
            )

    check.__doc__ = f"{prop.statement} {why}"
    register: Callable[[Callable[[PropertyResult, Context], Iterator[Violation]]], Rule[PropertyResult]] = rule(
        code,
        prop.id,
        severity,
        on=PropertyResult,
        clause=prop.clause,
        remedy=remedy,
        applies=lambda result, _context: result.prop is prop,
    )
    return register(check)


def _message(prop: Property, counterexample: Counterexample | None) -> str:
    return f"Violated: {prop.statement} {counterexample.text if counterexample else ''}".strip()


def _locations(counterexample: Counterexample | None) -> tuple[Location, ...]:
    places: dict[tuple[str, int | None], Location] = {}
    for step in counterexample.steps if counterexample else ():
        if step.path is not None:
            location = Location(path=step.path, line=step.line, message=step.witness)
            places.setdefault((step.path, step.line), location)
    return tuple(places.values())


def _enclave(counterexample: Counterexample | None) -> str | None:
    enclaves = {step.enclave for step in counterexample.steps if step.enclave} if counterexample else set()
    return enclaves.pop() if len(enclaves) == 1 else None


FORMAL: tuple[Rule[PropertyResult], ...] = (
    _property_rule(
        "KA701",
        Severity.HIGH,
        authentication.ONLY_AUTHENTICATED_JOIN,
        "Set <allow_unauthenticated_participants> to false and sign the governance again.",
        "Whoever reaches the network could otherwise be matched without any certificate.",
    ),
    _property_rule(
        "KA702",
        Severity.HIGH,
        authentication.IDENTITIES_CHAIN,
        "Issue the identity again under the identity CA that the enclaves carry: ros2 security create_enclave.",
        "An enclave without such an identity never takes part; its peers refuse the handshake.",
    ),
    _property_rule(
        "KA703",
        Severity.CRITICAL,
        authentication.DOCUMENTS_SIGNED,
        "Sign the document again with the permissions CA's own key.",
        "A document that somebody else signed says what that somebody wants, wherever it is accepted.",
    ),
    _property_rule(
        "KA704",
        Severity.HIGH,
        authentication.NO_SHARED_IDENTITY,
        "Give each enclave a key and certificate of its own: ros2 security create_enclave.",
        "Enclaves with one key have one set of rights, and revoking one revokes both.",
    ),
    _property_rule(
        "KA705",
        Severity.HIGH,
        authentication.NO_SELF_GRANTED_RIGHTS,
        "Use separate identity and permissions CAs, and implementations that pin the signer.",
        "Such an enclave can do anything on the bus. Whether an implementation pins the signer was measured"
        " (docs/model.md).",
    ),
    _property_rule(
        "KA711",
        Severity.HIGH,
        encryption.OUTSIDERS_CANNOT_READ,
        "Set data_protection_kind or metadata_protection_kind to ENCRYPT for the topic.",
        "Whoever reaches the network reads what is sent. Topics that nobody may publish are not counted.",
    ),
    _property_rule(
        "KA712",
        Severity.MEDIUM,
        encryption.OUTSIDERS_CANNOT_LEARN_NAMES,
        "Set enable_discovery_protection to true and discovery_protection_kind to ENCRYPT.",
        "Topic names tell an attacker what to aim at. The handshake shows each permissions document in any case.",
    ),
    _property_rule(
        "KA713",
        Severity.CRITICAL,
        encryption.OUTSIDERS_CANNOT_INJECT,
        "Set metadata_protection_kind or data_protection_kind to SIGN or ENCRYPT for the topic.",
        "Whoever reaches the network can command the robot.",
    ),
    _property_rule(
        "KA721",
        Severity.HIGH,
        access_control.GRANTS_ARE_ENFORCED,
        "Set enable_join_, enable_read_ and enable_write_access_control to true wherever grants name topics.",
        "A grant that nobody asks for protects nothing, though it reads as if it did.",
    ),
    _property_rule(
        "KA722",
        Severity.HIGH,
        access_control.NOBODY_WRITES_WITHOUT_A_GRANT,
        "Set enable_write_access_control and enable_read_access_control to true and protect the topic's metadata.",
        "Counted are rights that peers take for good and forging with the keys in an enclave's hands; a granted "
        "reader's forging is readers-cannot-forge.",
    ),
    _property_rule(
        "KA723",
        Severity.HIGH,
        access_control.NOBODY_READS_WITHOUT_A_GRANT,
        "Set enable_read_access_control to true and metadata_ or data_protection_kind to ENCRYPT.",
        "The keys of whole messages are in every participant's hands, so rtps protection alone hides nothing inside.",
    ),
    _property_rule(
        "KA724",
        Severity.LOW,
        access_control.READERS_CANNOT_FORGE,
        "Use SIGN_WITH_ORIGIN_AUTHENTICATION or ENCRYPT_WITH_ORIGIN_AUTHENTICATION as metadata_protection_kind or "
        "rtps_protection_kind where a reader must not pass for the writer.",
        "The keys are symmetric: who can check a sample can make one. The governance that sros2 ships has it so. "
        "Derived from who holds which key; not attacked on the wire here.",
    ),
)
