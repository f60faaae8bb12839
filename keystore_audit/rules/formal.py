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

    Violated where the governance lets participants in that have no certificate at all: authentication is then a matter
    of good will. That the implementation demands the handshake of the others is taken for granted.
    """,
    in_governance("Set <allow_unauthenticated_participants> to false"),
)
_decided(
    "KA702",
    stated.IDENTITIES_CHAIN,
    Severity.HIGH,
    """Every enclave's identity is vouched for by its identity CA, in force at the audit instant and not revoked.

    An enclave without such an identity never takes part, since its peers refuse the handshake; or it is there to see
    who does not. One step from a certificate of the CA file is enough, as each of them is a trust anchor.
    """,
    issue_again("Issue the identity again under the identity CA that the enclaves carry."),
)
_decided(
    "KA703",
    stated.DOCUMENTS_SIGNED,
    Severity.CRITICAL,
    """Every governance and permissions document is signed by the permissions CA itself, in force at the audit instant.

    What somebody else signed says what that somebody wants, wherever it is taken. Who had the authority's key in hand
    when it signed cannot be known.
    """,
    sign_again("Find out who signed it."),
)
_decided(
    "KA704",
    stated.NO_SHARED_IDENTITY,
    Severity.HIGH,
    """No identity key serves two enclaves.

    Enclaves with one key have one set of rights, and revoking one revokes both. Copies of a key outside this keystore
    are not seen.
    """,
    issue_again("Give each enclave a key and certificate of its own."),
)
_decided(
    "KA705",
    stated.NO_SELF_GRANTED_RIGHTS,
    Severity.HIGH,
    """No enclave can sign a permissions document that its peers take.

    Such an enclave can do anything. Whether an implementation pins the signer was measured with documents signed by a
    leaf; the profiles say for which it was only read.
    """,
    decision("Use separate authorities for identities and permissions, and implementations that pin the signer."),
)
_decided(
    "KA706",
    stated.ONE_CA_FOR_ONE_ROLE,
    Severity.MEDIUM,
    """No key serves as identity CA and as permissions CA.

    Else the line between who somebody is and what it may do is one flag of an implementation, whether it pins the
    signer. sros2 makes keystores so, which is why this is medium; where it is more, no-enclave-grants-itself-rights
    says so.
    """,
    SEPARATE,
)
_decided(
    "KA707",
    stated.NO_SHARED_SUBJECT,
    Severity.HIGH,
    """No grant names the identities of two enclaves.

    Peers take whatever validly signed document an enclave presents, so that each has the rights of both, whatever its
    own document says. Subjects are compared as each implementation does.
    """,
    decision("Give each enclave a subject of its own, and each grant a subject_name that names one enclave."),
)
_decided(
    "KA711",
    stated.OUTSIDERS_CANNOT_READ,
    Severity.HIGH,
    """No payload is readable without a key of this keystore.

    Topics that nobody may publish are not counted. Lengths, times and addresses stay readable whatever is encrypted.
    """,
    in_governance("Set data_protection_kind or metadata_protection_kind to ENCRYPT for the topic"),
)
_decided(
    "KA712",
    stated.OUTSIDERS_CANNOT_LEARN_NAMES,
    Severity.MEDIUM,
    """No topic name is readable in discovery without a key of this keystore.

    Names tell an attacker what to aim at. The handshake shows every permissions document in clear in any case, so that
    this slows a patient listener only.
    """,
    in_governance("Set enable_discovery_protection to true and discovery_protection_kind to ENCRYPT"),
)
_decided(
    "KA713",
    stated.OUTSIDERS_CANNOT_INJECT,
    Severity.CRITICAL,
    """No reader takes a sample that was made without a key of this keystore.

    Else whoever reaches the network commands the robot. Replay of recorded messages and loss of messages are not among
    what is decided.
    """,
    in_governance("Set metadata_protection_kind or data_protection_kind to SIGN or ENCRYPT for the topic"),
)
_decided(
    "KA714",
    stated.OUTSIDERS_CANNOT_REPLAY,
    Severity.HIGH,
    """No reader takes a recorded sample for a new one.

    A payload that is protected for itself sits in a submessage whose sequence number anybody can write where neither
    submessage nor message is authenticated: an old command is taken again. The same lets an outsider forge HEARTBEAT,
    GAP and ACKNACK, which stops readers. Derived from what each kind covers; not attacked on the wire here.
    """,
    in_governance("Set rtps_protection_kind or metadata_protection_kind to SIGN or ENCRYPT"),
)
_decided(
    "KA715",
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS,
    Severity.MEDIUM,
    """Nobody without a key of this keystore can assert that a writer is alive.

    Whoever relies on liveliness to stop a robot then never learns that a controller has died.
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

    Counted is what peers take for good, documents presented by others included, and forging with the keys in an
    enclave's hands; a granted reader's forging is readers-cannot-forge. What nodes would do is not asked: every enclave
    may be in an attacker's hands.
    """,
    in_governance("Set enable_write_ and enable_read_access_control to true and protect the topic's metadata"),
)
_decided(
    "KA723",
    stated.NOBODY_READS_WITHOUT_A_GRANT,
    Severity.HIGH,
    """No enclave reads a topic for which the permissions CA gave it no subscribe grant.

    The keys of whole messages are in every participant's hands, so that rtps protection alone hides nothing from those
    inside.
    """,
    in_governance("Set enable_read_access_control to true and metadata_ or data_protection_kind to ENCRYPT"),
)
_decided(
    "KA724",
    stated.READERS_CANNOT_FORGE,
    Severity.LOW,
    f"""No enclave that may only subscribe to a topic can pass for a publisher of it.

    The keys are symmetric: whoever can check a sample can make one. sros2's own governance has it so, which is why this
    is low. An rtps_protection_kind WITH_ORIGIN_AUTHENTICATION does not help: whose a sample is stands inside of what is
    sealed, and no receiver compares it with who sealed it ({facts.FORGED_SOURCE}).
    {facts.NO_ORIGIN}: there the kinds below help nothing, and the enclave that forges
    must not read the topic.
    """,
    in_governance(
        "Where a reader must not pass for the writer, use SIGN_ or ENCRYPT_WITH_ORIGIN_AUTHENTICATION as "
        "metadata_protection_kind of the topic"
    ),
)
_decided(
    "KA725",
    stated.RELAYS_CANNOT_READ,
    Severity.MEDIUM,
    f"""No enclave that may only relay a topic can read its payload.

    A relay gets the keys of submessages, to pass them on, and no key of payloads: what is not encrypted for itself is
    in clear to it. {facts.RELAY_READS}, and that is told by nobody-reads-without-a-grant.
    """,
    in_governance("Set data_protection_kind to ENCRYPT for the topic"),
)
_decided(
    "KA731",
    stated.NO_BRIDGES,
    Severity.MEDIUM,
    """No enclave can read in one domain and write in another.

    Domains keep apart only what nobody carries over. Enclaves with one key are one: each acts as the others. Domains
    that no document tells apart count as one here: a rule for all of them is rule-domain-range-open.
    """,
    decision("Let each enclave's rules cover one domain, and make an enclave of its own for a bridge that is meant."),
)


@rule(
    "KA740",
    Severity.HIGH,
    "keystore-audit, docs/settings.md: what is asserted in keystore-audit.toml",
    decision(
        "Change what lets it through at one of the lines named (or give what `able` lacks), or change what is asserted."
    ),
)
def asserted_property_violated(result: AssertedResult) -> Iterator[Violation]:
    """A property that the settings assert is violated, with the shortest way found.

    The severity is the one given there, high where none is. A flow is the absence or presence of explicit flows over
    topics, whatever the nodes do; timing, acknowledgements and matching are not in it.
    """
    yield from _asserted(result, partial(_told, result))


@rule(
    "KA741",
    Severity.HIGH,
    "keystore-audit, docs/alloy-properties.md: what is asserted with --alloy-property",
    decision(
        "Look at the places named; `keystore-audit model KEYSTORE -o DIR --alloy-property FILE` writes all "
        "of it for the Analyzer's window."
    ),
)
def asserted_alloy_property_violated(result: AlloyResult) -> Iterator[Violation]:
    """A property that a user asserts in Alloy is violated: a check has a counterexample, or a run no instance.

    Alloy alone decides it: no second engine has checked the answer, and what the file says is taken at its word. The
    severity is the one given there, high where none is.
    """
    yield from _asserted(result, partial(_told, result))


def _told(result: UserResult, example: str) -> str:
    said = f"{quoted(result.prop.id)} is violated{f': {example}' if example else '.'}"
    return " ".join(filter(None, (said, f"Asserted: {result.prop.statement}", result.beside)))


@rule(
    "KA742",
    Severity.HIGH,
    "keystore-audit, docs/settings.md: the lattice and the labels in keystore-audit.toml",
    decision("Change what lets it through at one of the lines named, or declare who is trusted to pass it on."),
)
def label_flow_violated(result: LabelResult) -> Iterator[Violation]:
    """What has one label can reach what has another, though the lattice of the settings lets nothing through there.

    One finding for each two labels, with the shortest way; others between the same labels may remain. The severity is
    the one that the lattice gives, high where it gives none (Denning, A lattice model of secure information flow).
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
