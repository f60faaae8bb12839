"""A witness with the atoms that it names, in the user's names, and the lines that it rests on.

This explains verdicts and makes none: an engine has decided, and here we look for what to show. Where nothing is found
the explanation is poorer, the verdict the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import RealmView
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import (
    CertificateAtom,
    ChannelAtom,
    DocumentAtom,
    DomainRuleAtom,
    GrantAtom,
    Participant,
    RealmAtom,
    System,
    TopicRuleAtom,
)
from keystore_audit.model.names import AMBIENT, ros_name
from keystore_audit.properties.result import Role, Step, Witness


class Right(Struct, frozen=True, kw_only=True):
    """A right that `document` gives; `location`: the rule that allows it, or the grant that does by default.

    `by_pattern`: it is one to be in a partition that is a pattern, which the channel's matches.
    """

    document: int
    location: Location
    by_pattern: bool = False


class Case:
    """A witness about a system, with the atoms that it names."""

    def __init__(self, system: System, witness: Witness) -> None:
        self.system = system
        self.witness = witness
        named = witness.get(Role.REALM)
        self.realm = self.enclave.realm if named is None else named

    def at(self, witness: Witness) -> Case:
        """The same with other atoms for some roles."""
        return Case(self.system, {**self.witness, **witness})

    @cached_property
    def _permissions(self) -> Permissions:
        return Permissions(self.system)

    @cached_property
    def view(self) -> RealmView:
        """How the peers of the realm see every enclave."""
        return RealmView(self.system, self.realm, self._permissions)

    @property
    def trust(self) -> RealmAtom:
        """Whom the peers of the realm trust."""
        return self.system.realms[self.realm]

    @property
    def enclave(self) -> Participant:
        """The enclave that the witness names."""
        return self.system.enclaves[self.witness[Role.ENCLAVE]]

    @property
    def channel(self) -> ChannelAtom:
        """The channel that the witness names."""
        return self.system.channels[self.witness[Role.CHANNEL]]

    @property
    def governance(self) -> DocumentAtom | None:
        """The governance document of the realm."""
        index = self.trust.governance
        return None if index is None else self.system.documents[index]

    @property
    def is_open(self) -> bool:
        """Whether that document could not be read, so that it may allow everything."""
        return self.governance is not None and self.governance.opaque

    @cached_property
    def domain_rule(self) -> DomainRuleAtom | None:
        """The domain rule that decides about the domain: the first that covers it."""
        index = self._domain_rule
        return None if index is None else self.system.domain_rules[index]

    @cached_property
    def _domain_rule(self) -> int | None:
        named = self.witness.get(Role.DOMAIN)
        domain = self.channel.domain if named is None else named
        rules, document = self.system.domain_rules, self.trust.governance
        return next((n for n, r in enumerate(rules) if r.document == document and domain in r.domains), None)

    @cached_property
    def topic_rule(self) -> TopicRuleAtom | None:
        """The topic rule that decides about the channel: the first that matches, of the deciding domain rule."""
        parent, channel = self._domain_rule, self.witness[Role.CHANNEL]
        rules = (rule for rule in self.system.topic_rules if rule.domain_rule == parent and channel in rule.channels)
        return None if parent is None else next(rules, None)

    def rights(self, enclave: int, operation: Operation) -> list[Right]:
        """Every right of an enclave to do `operation` on the channel, whoever signed the document that gives it.

        Rights about the channel itself come first, those to be in a partition that is a pattern for it last.
        """
        return self.rights_by(self.system.enclaves[enclave].identity, operation)

    def rights_by(self, identity: int | None, operation: Operation) -> list[Right]:
        """As `rights`, of whoever has the certificate."""
        grants = self._permissions.chosen(identity, frozenset(range(len(self.system.documents))))
        found = []
        for grant in sorted(grants, key=lambda number: self.system.grants[number].document):
            channels = ((each, self._allowing(grant, operation, each)) for each in self._here_and_meeting)
            for channel, location in channels:
                if location is not None:
                    by_pattern = channel != self.witness[Role.CHANNEL]
                    document = self.system.grants[grant].document
                    found.append(Right(document=document, location=location, by_pattern=by_pattern))
                    break
        return sorted(found, key=lambda right: right.by_pattern)

    @cached_property
    def _here_and_meeting(self) -> list[int]:
        """The channel, and those whose endpoints are met in it."""
        channel = self.witness[Role.CHANNEL]
        return [channel, *(number for number, others in enumerate(self.system.meets) if channel in others)]

    def _allowing(self, grant: int, operation: Operation, channel: int) -> Location | None:
        domain = self.system.channels[channel].domain
        for rule in self.system.rules:
            if rule.grant == grant and domain in rule.domains and channel in rule.named(operation):
                return self.system.place(rule, operation, channel) if rule.allow else None
        return self.system.grants[grant].location if self.system.grants[grant].default_allow else None

    def signed_by_ca(self, document: DocumentAtom) -> bool:
        """Whether the permissions CA of the realm, and nobody else, signed a document."""
        signers = document.signers
        return document.intact and not document.opaque and bool(signers) and signers <= self.trust.permissions_ca

    def opaque_document(self) -> DocumentAtom | None:
        """A document that could not be read, which may grant anything: one that governs nothing, if there is one."""
        governing = {realm.governance for realm in self.system.realms}
        opaque = [(n in governing, n) for n, document in enumerate(self.system.documents) if document.opaque]
        return self.system.documents[min(opaque)[1]] if opaque else None

    def is_unread(self, authorities: frozenset[int]) -> bool:
        """Whether these authorities stand for whatever is in a CA file that could not be read."""
        return any(self.system.certificates[number].opaque for number in authorities)

    def has_authority_key(self, certificate: int | None) -> bool:
        """Whether the key of a certificate is that of a permissions CA of the realm."""
        certificates = self.system.certificates
        keys = {certificates[each].key for each in self.trust.permissions_ca}
        return certificate is not None and certificates[certificate].key in keys

    def in_force(self, dated: CertificateAtom | GrantAtom) -> bool:
        """Whether the audit instant lies within the validity of a certificate or grant."""
        return dated.not_before <= self.system.now <= dated.not_after

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
        """A step about the channel."""
        channel = f"{self._domain}, topic {self.channel.topic}{self._partition}"
        return step_at(location, self.channel.topic, channel=channel, enclave=enclave)

    def identity_step(self, enclave: Participant) -> Step:
        """The step that shows who an enclave is."""
        if enclave.identity is None:
            return step_at(enclave.location, enclave.label, enclave=enclave.label)
        identity = self.system.certificates[enclave.identity]
        return step_at(identity.location, identity.label, enclave=enclave.label)

    def governance_steps(self) -> tuple[Step, ...]:
        """The rules that protect the channel, or the governance document where it could not be read."""
        if self.is_open and self.governance is not None:
            return (self.step(self.governance.location),)
        return tuple(self.step(rule.location) for rule in (self.topic_rule, self.domain_rule) if rule is not None)

    def right_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """The line that gives an enclave a right, where there is one."""
        label = self.system.enclaves[enclave].label
        return tuple(self.step(right.location, label) for right in self.rights(enclave, operation)[:1])

    def granted_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """The line that gives some enclave one of these rights."""
        every = range(len(self.system.enclaves))
        found = (self.right_steps(enclave, operation) for operation in operations for enclave in every)
        return next(filter(None, found), ())

    def user_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """The line by which there is an endpoint, though honest peers may refuse it: something to protect."""
        members = [number for number, atom in enumerate(self.system.enclaves) if atom.realm == self.realm]
        lone = (self.lone_steps(enclave, operation) for operation in operations for enclave in members)
        return self.granted_steps(*operations) or next(filter(None, lone), ())

    def lone_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """The line by which its own implementation lets an enclave do what honest peers may refuse."""
        atom = self.system.enclaves[enclave]
        alone = {Operation.PUBLISH: atom.writes_alone, Operation.SUBSCRIBE: atom.reads_alone}.get(operation, ())
        if self.witness[Role.CHANNEL] not in alone:
            return ()
        document = atom.location if atom.permissions is None else self.system.documents[atom.permissions].location
        return (self.step(next(self._own_lines(atom, operation), document), atom.label),)

    def _own_lines(self, enclave: Participant, operation: Operation) -> Iterator[Location]:
        """The lines of its own document that allow the channel, whatever its domain and whatever stands before."""
        for channel in self._here_and_meeting:
            for rule in self.system.rules:
                mine = self.system.grants[rule.grant].document == enclave.permissions
                if mine and rule.allow and channel in rule.named(operation):
                    yield self.system.place(rule, operation, channel)

    def kinds(self) -> str:
        """The protection kinds that apply to the channel, in words."""
        if self.is_open or self.topic_rule is None or self.domain_rule is None:
            return "the governance document could not be read, so it may protect nothing"
        return (
            f"rtps_protection_kind is {self.domain_rule.rtps_protection_kind.value}, "
            f"metadata_protection_kind {self.topic_rule.metadata_protection_kind.value}, "
            f"data_protection_kind {self.topic_rule.data_protection_kind.value}"
        )

    def open_door(self) -> str:
        """That the domain's rule lets in whom nobody authenticates, where it does, as the end of a sentence."""
        rule = self.domain_rule
        allowed = rule is not None and rule.allow_unauthenticated_participants
        return ", and messages of unauthenticated participants are allowed in the clear" if allowed else ""


def step_at(location: Location | None, witness: str, *, channel: str | None = None, enclave: str | None = None) -> Step:
    """A step whose line is there, if there is one."""
    if location is None:
        return Step(enclave=enclave, channel=channel, witness=witness, path=None, line=None)
    return Step(
        enclave=enclave,
        channel=channel,
        witness=witness,
        path=location.path,
        line=location.line,
        expression=location.message,
    )


def plainest(system: System, witnesses: Sequence[Witness]) -> Witness:
    """The witness that is understood without a second look: an enclave of the keystore, the default partition, a
    topic of users that documents name, an enclave that nothing grants anything on it, a short name; else the first.
    """
    granted: dict[int, set[int]] = {}

    def has_right(enclave: int, channel: int) -> bool:
        if enclave not in granted:
            identity = system.enclaves[enclave].identity
            own = {number for number, grant in enumerate(system.grants) if identity in grant.names}
            rules = [rule for rule in system.rules if rule.allow and rule.grant in own]
            granted[enclave] = {each for rule in rules for each in (*rule.publish, *rule.subscribe)}
        return channel in granted[enclave]

    def rank(witness: Witness) -> tuple[object, ...]:
        enclave, channel = witness.get(Role.ENCLAVE), witness.get(Role.CHANNEL)
        unmanaged = enclave is not None and system.enclaves[enclave].unmanaged
        if channel is None:
            return (unmanaged,)
        atom = system.channels[channel]
        right = enclave is not None and has_right(enclave, channel)
        of_users = atom.topic.startswith("rt/") and atom.topic not in AMBIENT
        return unmanaged, atom.partition != "", not of_users, atom.infinite, right, len(atom.topic)

    return min(witnesses, key=rank)
