"""Says what a witness of an engine means, in the user's names and with the lines that cause it.

Both engines' witnesses are told by this module. Names in the texts are raw: whoever shows them escapes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from keystore_audit.engine import causes
from keystore_audit.engine.causes import Operation
from keystore_audit.findings import Location
from keystore_audit.model.names import ros_name
from keystore_audit.model.system import (
    ChannelAtom,
    DocumentAtom,
    DomainRuleAtom,
    EnclaveAtom,
    System,
    TopicRuleAtom,
)
from keystore_audit.properties import access_control, authentication, encryption
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Property, Role, Witness


def describe(system: System, prop: Property, witness: Witness) -> Counterexample:
    """Return the counterexample that `witness`, an assignment of `prop.roles` to atoms of `system`, stands for."""
    return _TELLERS[prop.id](_Case(system=system, witness=witness))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """A witness, with the atoms that it names."""

    system: System
    witness: Witness

    @property
    def realm(self) -> int:
        """The realm that the witness names, else that of its enclave."""
        named = self.witness.get(Role.REALM)
        return self.enclave.realm if named is None else named

    @property
    def enclave(self) -> EnclaveAtom:
        return self.system.enclaves[self.witness[Role.ENCLAVE]]

    @property
    def channel(self) -> ChannelAtom:
        return self.system.channels[self.witness[Role.CHANNEL]]

    @property
    def governance(self) -> DocumentAtom | None:
        return causes.governance(self.system, self.realm)

    @property
    def is_open(self) -> bool:
        return causes.is_open(self.system, self.realm)

    @property
    def topic_rule(self) -> TopicRuleAtom | None:
        return causes.topic_rule(self.system, self.realm, self.witness[Role.CHANNEL])

    @property
    def domain_rule(self) -> DomainRuleAtom | None:
        return causes.domain_rule(self.system, self.realm, self.channel.domain)

    @property
    def topic(self) -> str:
        """The channel for people: the ROS name (one of many, where it has infinitely many), domain and partition."""
        name = ros_name(self.channel.topic)
        several = f"topics such as {name}" if self.channel.infinite else name
        return f"{several} in {self._domain}{self._partition}"

    @property
    def _partition(self) -> str:
        return f', partition "{self.channel.partition}"' if self.channel.partition else ""

    @property
    def _domain(self) -> str:
        return self.system.domains[self.channel.domain].label

    def step(self, location: Location | None, enclave: str | None = None) -> Step:
        """Return a step about the channel."""
        channel = f"{self._domain}, topic {self.channel.topic}{self._partition}"
        return _step(location, channel=channel, witness=self.channel.topic, enclave=enclave)

    def governance_steps(self) -> tuple[Step, ...]:
        """Return the rules that protect the channel, or the governance document where it could not be read."""
        if self.is_open and self.governance is not None:
            return (self.step(self.governance.location),)
        return tuple(self.step(rule.location) for rule in (self.topic_rule, self.domain_rule) if rule is not None)

    def right_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """Return the line that gives an enclave a right, where there is one."""
        found = causes.rights(self.system, enclave, operation, self.witness[Role.CHANNEL])
        label = self.system.enclaves[enclave].label
        return tuple(self.step(right.location, label) for right in found[:1])

    def user_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """Return the line that gives some enclave one of these rights: why there is anything to protect."""
        for operation in operations:
            for enclave in range(len(self.system.enclaves)):
                if steps := self.right_steps(enclave, operation):
                    return steps
        return ()

    def kinds(self) -> str:
        """Return the protection kinds that apply to the channel, in words."""
        if self.is_open or self.topic_rule is None or self.domain_rule is None:
            return "the governance document could not be read, so it may protect nothing"
        return (
            f"rtps_protection_kind is {self.domain_rule.rtps_protection_kind.value}, "
            f"metadata_protection_kind {self.topic_rule.metadata_protection_kind.value}, "
            f"data_protection_kind {self.topic_rule.data_protection_kind.value}"
        )


def _step(location: Location | None, *, channel: str | None, witness: str, enclave: str | None) -> Step:
    return Step(
        enclave=enclave,
        channel=channel,
        witness=witness,
        path=None if location is None else location.path,
        line=None if location is None else location.line,
    )


def _anybody_joins(case: _Case) -> Counterexample:
    domain = case.system.domains[case.witness[Role.DOMAIN]].label
    rule = causes.domain_rule(case.system, case.realm, case.witness[Role.DOMAIN])
    if case.is_open or rule is None:
        location = None if case.governance is None else case.governance.location
        why = "the governance document could not be read, so it may allow that"
    else:
        location, why = rule.location, "allow_unauthenticated_participants is true there"
    step = _step(location, channel=domain, witness="allow_unauthenticated_participants", enclave=None)
    return Counterexample(text=f"A participant without any identity may join {domain}: {why}.", steps=(step,))


def _identity(case: _Case) -> Counterexample:
    enclave = case.enclave
    if enclave.opaque or enclave.identity is None:
        step = _step(enclave.location, channel=None, witness=enclave.label, enclave=enclave.label)
        return Counterexample(
            text=f"The identity of {enclave.label} could not be read: it may be anybody.", steps=(step,)
        )
    identity = case.system.certificates[enclave.identity]
    step = _step(identity.location, channel=None, witness=identity.label, enclave=enclave.label)
    return Counterexample(
        text=f"The identity of {enclave.label} ({identity.label}) is not one that its peers may trust: "
        f"{_distrust(case.system, enclave.realm, enclave.identity)}.",
        steps=(step,),
    )


def _distrust(system: System, realm_index: int, identity_index: int) -> str:
    """Say why an identity is not vouched for, in force and unrevoked."""
    realm = system.realms[realm_index]
    identity = system.certificates[identity_index]
    issuers = [system.certificates[number] for number in identity.issuers & realm.identity_ca]
    if not issuers:
        return "no certificate of its identity CA has issued it"
    if identity_index in realm.revoked:
        return "its identity CA has revoked it"
    if not causes.in_force(system, identity):
        return "it is not in force"
    if not any(issuer.authority for issuer in issuers):
        return "its issuer may not issue certificates"
    return "its issuer is not in force"


def _document(case: _Case) -> Counterexample:
    document = case.system.documents[case.witness[Role.DOCUMENT]]
    signers = [case.system.certificates[number] for number in sorted(document.signers)]
    enclave = case.enclave
    if document.opaque:
        why = "could not be read, so nobody knows who signed it"
    elif not document.intact or not signers:
        why = "bears no signature that verifies"
    elif not causes.signed_by_ca(case.system, enclave.realm, document):
        why = f"is signed by {signers[0].label}, not by the permissions CA alone"
    else:
        why = f"is signed by {signers[0].label}, which is not in force"
    step = _step(document.location, channel=None, witness=document.label, enclave=enclave.label)
    return Counterexample(text=f"{document.label}, which {enclave.label} uses, {why}.", steps=(step,))


def _shared_key(case: _Case) -> Counterexample:
    one, other = case.enclave, case.system.enclaves[case.witness[Role.OTHER]]
    if one.opaque:
        text = f"The identity of {one.label} could not be read: it may be that of another enclave."
        concerned = [one]
    else:
        text = f"{one.label} and {other.label} have the same identity key, so each can pass for the other."
        concerned = [one, other]
    return Counterexample(text=text, steps=tuple(_identity_step(case.system, enclave) for enclave in concerned))


def _identity_step(system: System, enclave: EnclaveAtom) -> Step:
    if enclave.identity is None:
        return _step(enclave.location, channel=None, witness=enclave.label, enclave=enclave.label)
    identity = system.certificates[enclave.identity]
    return _step(identity.location, channel=None, witness=identity.label, enclave=enclave.label)


def _grants_itself(case: _Case) -> Counterexample:
    enclave = case.enclave
    step = _identity_step(case.system, enclave)
    if enclave.opaque:
        text = f"The identity of {enclave.label} could not be read: it may be one that signs permissions."
    elif identity := causes.signs_for_itself(case.system, case.realm, enclave):
        text = (
            f"{enclave.label} can sign itself permissions: the permissions CA also issued its identity "
            f"({identity.label}), and these implementations accept any signer that the CA issued."
        )
    else:
        document = None if enclave.permissions is None else case.system.documents[enclave.permissions]
        name = enclave.label if document is None else document.label
        text = f"{enclave.label} has permissions that the permissions CA did not sign and peers accept: {name}."
        if document is not None:
            step = _step(document.location, channel=None, witness=document.label, enclave=enclave.label)
    return Counterexample(text=text, steps=(step,))


def _outsider_reads(case: _Case) -> Counterexample:
    return Counterexample(
        text=f"Anybody on the network can read {case.topic}: {case.kinds()}.",
        steps=case.governance_steps() + case.user_steps("publish"),
    )


def _outsider_learns(case: _Case) -> Counterexample:
    rule = case.topic_rule
    if case.is_open or rule is None or case.domain_rule is None:
        why = case.kinds()
    elif not rule.enable_discovery_protection:
        why = "enable_discovery_protection is false for it, and whole messages are not encrypted"
    else:
        kind = case.domain_rule.discovery_protection_kind.value
        why = f"discovery_protection_kind is {kind}, and whole messages are not encrypted"
    return Counterexample(
        text=f"Anybody on the network learns of {case.topic}: {why}.",
        steps=case.governance_steps() + case.user_steps("publish", "subscribe"),
    )


def _outsider_injects(case: _Case) -> Counterexample:
    domain_rule = case.domain_rule
    unauthenticated = domain_rule is not None and domain_rule.allow_unauthenticated_participants
    why = ", and messages of unauthenticated participants are allowed in the clear" if unauthenticated else ""
    return Counterexample(
        text=f"Anybody on the network can send samples on {case.topic}: {case.kinds()}{why}.",
        steps=case.governance_steps() + case.user_steps("subscribe"),
    )


def _unenforced(case: _Case) -> Counterexample:
    flag, step = _switched_off(case)
    return Counterexample(
        text=f"The grants on {case.topic} are not asked for: {flag}.",
        steps=(*step, *case.user_steps("publish", "subscribe")),
    )


def _switched_off(case: _Case) -> tuple[str, tuple[Step, ...]]:
    """Say which access control is off although there is a grant for it to ask for."""
    topic_rule, domain_rule = case.topic_rule, case.domain_rule
    if case.is_open or topic_rule is None or domain_rule is None:
        return case.kinds(), case.governance_steps()
    if not topic_rule.enable_write_access_control and case.user_steps("publish"):
        return "enable_write_access_control is false", (case.step(topic_rule.location),)
    if not topic_rule.enable_read_access_control and case.user_steps("subscribe"):
        return "enable_read_access_control is false", (case.step(topic_rule.location),)
    return "enable_join_access_control is false", (case.step(domain_rule.location),)


def _insider_writes(case: _Case) -> Counterexample:
    rule = case.topic_rule
    if rule is not None and not case.is_open and not rule.enable_write_access_control:
        why, steps = "enable_write_access_control is false", _steps(case, rule.location)
    else:
        why, steps = _conceded(case, "publish") or _by_keys(case)
    return Counterexample(
        text=f"{case.enclave.label} can get its samples taken on {case.topic} without a grant of the permissions CA: "
        f"{why}.",
        steps=steps,
    )


def _insider_reads(case: _Case) -> Counterexample:
    rule = case.topic_rule
    if rule is not None and not case.is_open and not rule.enable_read_access_control:
        why, steps = "enable_read_access_control is false", _steps(case, rule.location)
    else:
        why, steps = _conceded(case, "subscribe") or _by_keys(case)
    return Counterexample(
        text=f"{case.enclave.label} can read {case.topic} without a grant of the permissions CA: {why}.", steps=steps
    )


def _conceded(case: _Case, operation: Operation) -> tuple[str, tuple[Step, ...]] | None:
    """Say why peers concede a right that the permissions CA did not give, if they do."""
    system, enclave = case.system, case.enclave
    if case.is_open:
        return case.kinds(), case.governance_steps()
    if enclave.opaque:
        return "its identity could not be read, so it may be anybody", (_identity_step(system, enclave),)
    if causes.signs_for_itself(system, case.realm, enclave):
        return "it can sign itself permissions that its peers accept", (_identity_step(system, enclave),)
    for right in causes.rights(system, case.witness[Role.ENCLAVE], operation, case.witness[Role.CHANNEL]):
        if not right.document.opaque and not causes.signed_by_ca(system, case.realm, right.document):
            why = f"{right.document.label} grants it, which the permissions CA did not sign and peers accept"
            return why, _steps(case, right.location)
    if document := causes.opaque_document(system):
        return f"{document.label} could not be read, so it may grant anything", _steps(case, document.location)
    return None


def _steps(case: _Case, location: Location) -> tuple[Step, ...]:
    """Return the one step that an enclave takes on a channel because of a line."""
    return (case.step(location, case.enclave.label),)


def _by_keys(case: _Case) -> tuple[str, tuple[Step, ...]]:
    """Say that an enclave uses keys that it holds as a participant, reader or relay."""
    return f"with the keys that it holds, since {case.kinds()}", case.governance_steps()


def _reader_forges(case: _Case) -> Counterexample:
    return Counterexample(
        text=f"{case.enclave.label}, which may only subscribe to {case.topic}, can pass for a publisher of it: readers "
        f"hold the keys of the writer, and no kind tells them apart ({case.kinds()}).",
        steps=case.right_steps(case.witness[Role.ENCLAVE], "subscribe") + case.governance_steps(),
    )


_TELLERS: Final[Mapping[str, Callable[[_Case], Counterexample]]] = {
    authentication.ONLY_AUTHENTICATED_JOIN.id: _anybody_joins,
    authentication.IDENTITIES_CHAIN.id: _identity,
    authentication.DOCUMENTS_SIGNED.id: _document,
    authentication.NO_SHARED_IDENTITY.id: _shared_key,
    authentication.NO_SELF_GRANTED_RIGHTS.id: _grants_itself,
    encryption.OUTSIDERS_CANNOT_READ.id: _outsider_reads,
    encryption.OUTSIDERS_CANNOT_LEARN_NAMES.id: _outsider_learns,
    encryption.OUTSIDERS_CANNOT_INJECT.id: _outsider_injects,
    access_control.GRANTS_ARE_ENFORCED.id: _unenforced,
    access_control.NOBODY_WRITES_WITHOUT_A_GRANT.id: _insider_writes,
    access_control.NOBODY_READS_WITHOUT_A_GRANT.id: _insider_reads,
    access_control.READERS_CANNOT_FORGE.id: _reader_forges,
}
