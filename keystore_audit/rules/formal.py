"""KA7: what the engines decide, the tool's own properties and those that users assert (docs/model.md).

Of the tool's own there is one rule for each; its name is the property's id.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from msgspec.structs import replace

from keystore_audit.findings import Location, Remedy, Severity, decision
from keystore_audit.profiles import facts
from keystore_audit.properties import stated
from keystore_audit.properties.result import (
    AlloyResult,
    AssertedResult,
    Counterexample,
    LabelResult,
    Property,
    PropertyResult,
    Status,
    Step,
    UserResult,
)
from keystore_audit.rules.registry import MAX_QUOTED, Context, Rule, Violation, quoted, register, rule
from keystore_audit.rules.remedies import SEPARATE, in_governance, issue_again, sign_again
from keystore_audit.text import shorten


def violated(result: PropertyResult) -> tuple[tuple[str, ...], Counterexample | None] | None:
    """The profiles under which it is violated for certain, with an example; None: it is not."""
    answers = {name: answer for name, answer in result.profiles.items() if answer.status is Status.VIOLATED}
    if not answers:
        return None
    example = next((a.counterexample for a in answers.values() if a.counterexample is not None), None)
    return tuple(answers), example


def _violated(result: PropertyResult, _context: Context) -> Iterator[Violation]:
    found = violated(result)
    if found is None:
        return
    profiles, example = found
    enclaves = {step.enclave for step in example.steps if step.enclave is not None} if example else set()
    yield Violation(
        example.text if example else f"This is violated, and no example was given: {result.prop.statement}",
        steps(example) if example else (),
        enclave=enclaves.pop() if len(enclaves) == 1 else None,
        profiles=profiles,
        key=result.prop.id,
    )


def steps(example: Counterexample) -> list[Location]:
    """The lines that make the counterexample possible, each with what it is about."""
    return [
        Location(step.path, step.line, message=shorten(_words(step), 2 * MAX_QUOTED))
        for step in example.steps
        if step.path is not None
    ]


def _words(step: Step) -> str:
    """Whom and what a step is about; the witness is told where the channel does not name it."""
    told = [step.enclave, step.channel] if step.channel is not None else [step.enclave]
    if step.channel is None or step.witness not in step.channel:
        told.append(step.witness)
    return ": ".join(word for word in told if word is not None)


def _decided(code: str, prop: Property, severity: Severity, docstring: str, remedy: Remedy) -> None:
    """Registers the rule of a property: it has the property's id and clause."""
    register(
        Rule(
            code=code,
            name=prop.id,
            severity=severity,
            on=PropertyResult,
            clause=prop.clause,
            remedy=remedy,
            docstring=docstring,
            check=_violated,
        )
    )


_decided(
    "KA701",
    stated.ONLY_AUTHENTICATED_JOIN,
    Severity.HIGH,
    """Only participants that the identity CA vouches for join a domain.

    Violated if the governance admits participants that have no certificate: authentication is then voluntary. It is
    assumed that implementations demand the handshake of all others.
    """,
    in_governance("Set <allow_unauthenticated_participants> to false"),
)
_decided(
    "KA702",
    stated.IDENTITIES_CHAIN,
    Severity.HIGH,
    """Every enclave's identity is vouched for by its identity CA, in force at the audit instant and not revoked.

    Peers refuse the handshake of an enclave without such an identity. Each certificate of the CA file is a trust
    anchor.
    """,
    issue_again("Use the identity CA that the enclaves carry."),
)
_decided(
    "KA703",
    stated.DOCUMENTS_SIGNED,
    Severity.CRITICAL,
    """Every governance and permissions document is signed by the permissions CA itself, in force at the audit instant.

    Whoever else signed a document decides what it says, wherever it is accepted.
    """,
    sign_again("Find out who signed it."),
)
_decided(
    "KA704",
    stated.NO_SHARED_IDENTITY,
    Severity.HIGH,
    """No identity key serves two enclaves.

    Enclaves with one key share their rights, and revoking one revokes both. Copies of a key outside this keystore are
    not seen.
    """,
    issue_again("Give each enclave its own key and certificate."),
)
_decided(
    "KA705",
    stated.NO_SELF_GRANTED_RIGHTS,
    Severity.HIGH,
    """No enclave can sign a permissions document that its peers accept.

    Such an enclave can do anything. The profiles say for which implementations pinning was measured, and for which only
    read.
    """,
    decision("Use separate authorities for identities and permissions, and implementations that pin the signer."),
)
_decided(
    "KA706",
    stated.ONE_CA_FOR_ONE_ROLE,
    Severity.MEDIUM,
    """No key serves as identity CA and as permissions CA.

    Otherwise only an implementation that pins the signer keeps identity and rights apart. Medium, as in sros2's
    keystores; where it is worse, see no-enclave-grants-itself-rights.
    """,
    SEPARATE,
)
_decided(
    "KA707",
    stated.NO_SHARED_SUBJECT,
    Severity.HIGH,
    """No grant names the identities of two enclaves.

    Peers accept any validly signed document that an enclave presents, so each has the rights of both, whatever its own
    document says. Subjects are compared as each implementation does.
    """,
    decision("Give each enclave its own subject, and let each subject_name name one enclave."),
)
_decided(
    "KA711",
    stated.OUTSIDERS_CANNOT_READ,
    Severity.HIGH,
    """No payload is readable without a key of this keystore.

    Topics that nobody may publish are not counted. Lengths, times and addresses stay readable despite encryption.
    """,
    in_governance("Set data_protection_kind or metadata_protection_kind to ENCRYPT for the topic"),
)
_decided(
    "KA712",
    stated.OUTSIDERS_CANNOT_LEARN_NAMES,
    Severity.MEDIUM,
    """No topic name is readable in discovery without a key of this keystore.

    Names tell an attacker what to aim at. The handshake shows every permissions document in clear anyway, so this only
    slows a patient listener.
    """,
    in_governance("Set enable_discovery_protection to true and discovery_protection_kind to ENCRYPT"),
)
_decided(
    "KA713",
    stated.OUTSIDERS_CANNOT_INJECT,
    Severity.CRITICAL,
    """No reader takes a sample that was made without a key of this keystore.

    Otherwise whoever reaches the network commands the robot. Replay and loss of messages are not part of this property.
    """,
    in_governance("Set metadata_protection_kind or data_protection_kind to SIGN or ENCRYPT for the topic"),
)
_decided(
    "KA714",
    stated.OUTSIDERS_CANNOT_REPLAY,
    Severity.HIGH,
    """No reader takes a recorded sample for a new one.

    If neither submessage nor message is authenticated, anybody can change the sequence number, even of a protected
    payload: an old command is accepted again. Outsiders can also forge HEARTBEAT, GAP and ACKNACK, which stops readers.
    Derived from what each kind covers; not attacked on the wire here.
    """,
    in_governance("Set rtps_protection_kind or metadata_protection_kind to SIGN or ENCRYPT"),
)
_decided(
    "KA715",
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS,
    Severity.MEDIUM,
    """Nobody without a key of this keystore can assert that a writer is alive.

    Otherwise a robot that stops when liveliness is lost never learns that a controller has died.
    """,
    in_governance("Set rtps_protection_kind to SIGN, or protect liveliness"),
)
_decided(
    "KA721",
    stated.GRANTS_ARE_ENFORCED,
    Severity.HIGH,
    """Wherever a permissions document grants something, the governance makes peers ask for the grant.

    A grant that nobody asks for protects nothing, though it reads as if it did.
    """,
    in_governance("Set enable_join_, enable_read_ and enable_write_access_control to true wherever grants name topics"),
)
_decided(
    "KA722",
    stated.NOBODY_WRITES_WITHOUT_A_GRANT,
    Severity.HIGH,
    """No enclave can publish a topic, so that peers accept it, for which the permissions CA gave it no right.

    Counted is whatever peers accept, by any document that the enclave presents, and forging with its keys. For forging
    by a granted reader, see readers-cannot-forge. Every enclave may be in an attacker's hands, whatever its nodes do.
    """,
    in_governance("Set enable_write_ and enable_read_access_control to true and protect the topic's metadata"),
)
_decided(
    "KA723",
    stated.NOBODY_READS_WITHOUT_A_GRANT,
    Severity.HIGH,
    """No enclave reads a topic for which the permissions CA gave it no subscribe grant.

    Every participant holds the keys of whole messages, so rtps protection alone hides nothing from insiders.
    """,
    in_governance("Set enable_read_access_control to true and metadata_ or data_protection_kind to ENCRYPT"),
)
_decided(
    "KA724",
    stated.READERS_CANNOT_FORGE,
    Severity.LOW,
    f"""No enclave that may only subscribe to a topic can pass for a publisher of it.

    Whoever can check a sample can make one. Low, since sros2's own governance allows it. An
    rtps_protection_kind WITH_ORIGIN_AUTHENTICATION does not help: the sealed message names the writer, and no receiver
    compares that with who sealed it ({facts.FORGED_SOURCE}). {facts.NO_ORIGIN}: there the kinds in the fix do not help
    either, and the enclave that forges must not read the topic.
    """,
    in_governance(
        "Set the topic's metadata_protection_kind to ENCRYPT_WITH_ORIGIN_AUTHENTICATION, or to the same with SIGN, if "
        "readers must not pass for the writer"
    ),
)
_decided(
    "KA725",
    stated.RELAYS_CANNOT_READ,
    Severity.MEDIUM,
    f"""No enclave that may only relay a topic can read its payload.

    A relay gets the keys of submessages, to pass them on, but no payload keys. It can read a payload that is not
    encrypted on its own. {facts.RELAY_READS}: see nobody-reads-without-a-grant.
    """,
    in_governance("Set data_protection_kind to ENCRYPT for the topic"),
)
_decided(
    "KA731",
    stated.NO_BRIDGES,
    Severity.MEDIUM,
    """No enclave can read in one domain and write in another.

    Domains separate only what nobody carries over. Enclaves with one key count as one. So do domains that no document
    tells apart; for a rule that covers all of them, see rule-domain-range-open.
    """,
    decision("Let each enclave's rules cover one domain, and make a separate enclave for an intended bridge."),
)


@rule(
    "KA740",
    Severity.HIGH,
    "keystore-audit, docs/settings.md: what is asserted in keystore-audit.toml",
    decision(
        "Remove what one of the named lines allows, or agree with the owner that the assertion is wrong.",
        "Documents are edited in the .xml, which is signed again. If `able` is asserted, grant what is missing.",
    ),
)
def asserted_property_violated(result: AssertedResult) -> Iterator[Violation]:
    """A property that the settings assert is violated, with the shortest way found.

    The severity is the one set there, else high. Flows are explicit flows over topics, whatever nodes do; timing,
    acknowledgements and matching are left out.
    """
    yield from _asserted(result, partial(_told, result))


@rule(
    "KA741",
    Severity.HIGH,
    "keystore-audit, docs/alloy-properties.md: what is asserted with --alloy-property",
    decision(
        "Check the places named. `keystore-audit model KEYSTORE -o DIR --alloy-property FILE` writes the model "
        "for the Alloy Analyzer."
    ),
)
def asserted_alloy_property_violated(result: AlloyResult) -> Iterator[Violation]:
    """A property that a user asserts in Alloy is violated: a check has a counterexample, or a run no instance.

    Alloy alone decides it: no second engine checks the answer, and the file is taken at its word. The severity is the
    one set there, else high.
    """
    yield from _asserted(result, partial(_told, result))


def _told(result: UserResult, example: str) -> str:
    said = f"{quoted(result.prop.id)} is violated{f': {example}' if example else '.'}"
    return " ".join(filter(None, (said, f"The settings demand: {result.prop.statement}", result.beside)))


@rule(
    "KA742",
    Severity.HIGH,
    "keystore-audit, docs/settings.md: the lattice and the labels in keystore-audit.toml",
    decision("Change one of the lines named, which let it through, or declare who is trusted to pass it on."),
)
def label_flow_violated(result: LabelResult) -> Iterator[Violation]:
    """What has one label can reach what has another, though the lattice of the settings forbids it.

    One finding for each pair of labels, with the shortest way. The severity is the lattice's, else high (Denning, A
    lattice model of secure information flow).
    """
    flow = f"What is labelled {quoted(result.source)} can reach what is labelled {quoted(result.target)}"
    yield from _asserted(result, lambda example: f"{flow}: {example}" if example else f"{flow}.", "the lattice")


def _asserted(result: UserResult, says: Callable[[str], str], where: str = "asserted here") -> Iterator[Violation]:
    """A violation where it does not hold under some profile, with an example."""
    found = violated(result)
    if found is None:
        return
    profiles, example = found
    yield Violation(
        says(example.text if example else ""),
        (replace(result.location, message=where), *(steps(example) if example else ())),
        severity=result.severity,
        profiles=profiles,
        key=result.prop.id,
        properties=(result.prop.id,),
    )
