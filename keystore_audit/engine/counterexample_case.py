"""A witness with the atoms that it names, in the user's names: what every counterexample is told from."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from keystore_audit.engine import causes
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import RealmView
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import (
    ChannelAtom,
    DocumentAtom,
    DomainRuleAtom,
    EnclaveAtom,
    System,
    TopicRuleAtom,
)
from keystore_audit.model.names import AMBIENT, ros_name
from keystore_audit.properties.counterexample import Step
from keystore_audit.properties.property import Role, Witness


class Case(Struct, frozen=True, kw_only=True):
    """A witness, with the atoms that it names."""

    system: System
    witness: Witness

    @property
    def realm(self) -> int:
        """The realm that the witness names, else that of its enclave."""
        named = self.witness.get(Role.REALM)
        return self.enclave.realm if named is None else named

    @property
    def view(self) -> RealmView:
        """How the peers of the realm see every enclave."""
        return RealmView(self.system, self.realm, Permissions(self.system))

    @property
    def enclave(self) -> EnclaveAtom:
        """The enclave that the witness names."""
        return self.system.enclaves[self.witness[Role.ENCLAVE]]

    @property
    def channel(self) -> ChannelAtom:
        """The channel that the witness names."""
        return self.system.channels[self.witness[Role.CHANNEL]]

    @property
    def governance(self) -> DocumentAtom | None:
        """The governance document of the realm."""
        return causes.governance(self.system, self.realm)

    @property
    def is_open(self) -> bool:
        """Whether that document could not be read."""
        return causes.is_open(self.system, self.realm)

    @property
    def topic_rule(self) -> TopicRuleAtom | None:
        """The topic rule that decides about the channel."""
        return causes.topic_rule(self.system, self.realm, self.witness[Role.CHANNEL])

    @property
    def domain_rule(self) -> DomainRuleAtom | None:
        """The domain rule that decides about the channel's domain."""
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
        return step_at(location, self.channel.topic, channel=channel, enclave=enclave)

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

    def granted_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """Return the line that gives some enclave one of these rights."""
        every = range(len(self.system.enclaves))
        found = (self.right_steps(enclave, operation) for operation in operations for enclave in every)
        return next(filter(None, found), ())

    def user_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """Return the line by which there is an endpoint, though honest peers may refuse it: something to protect."""
        members = [number for number, atom in enumerate(self.system.enclaves) if atom.realm == self.realm]
        lone = (self.lone_steps(enclave, operation) for operation in operations for enclave in members)
        return self.granted_steps(*operations) or next(filter(None, lone), ())

    def lone_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """Return the line by which its own implementation lets an enclave do what honest peers may refuse."""
        found = causes.lone_right(self.system, enclave, operation, self.witness[Role.CHANNEL])
        return () if found is None else (self.step(found, self.system.enclaves[enclave].label),)

    def kinds(self) -> str:
        """Return the protection kinds that apply to the channel, in words."""
        if self.is_open or self.topic_rule is None or self.domain_rule is None:
            return "the governance document could not be read, so it may protect nothing"
        return (
            f"rtps_protection_kind is {self.domain_rule.rtps_protection_kind.value}, "
            f"metadata_protection_kind {self.topic_rule.metadata_protection_kind.value}, "
            f"data_protection_kind {self.topic_rule.data_protection_kind.value}"
        )

    def open_door(self) -> str:
        """Return that the domain's rule lets in whom nobody authenticates, where it does, as the end of a sentence."""
        rule = self.domain_rule
        if rule is None or not rule.allow_unauthenticated_participants:
            return ""
        return ", and messages of unauthenticated participants are allowed in the clear"


def step_at(location: Location | None, witness: str, *, channel: str | None = None, enclave: str | None = None) -> Step:
    """A step whose line is there, if there is one."""
    return Step(
        enclave=enclave,
        channel=channel,
        witness=witness,
        path=None if location is None else location.path,
        line=None if location is None else location.line,
        expression="" if location is None else location.message,
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
        at_large = enclave is not None and system.enclaves[enclave].at_large
        if channel is None:
            return (at_large,)
        atom = system.channels[channel]
        right = enclave is not None and has_right(enclave, channel)
        of_users = atom.topic.startswith("rt/") and atom.topic not in AMBIENT
        return at_large, atom.partition != "", not of_users, atom.infinite, right, len(atom.topic)

    return min(witnesses, key=rank)
