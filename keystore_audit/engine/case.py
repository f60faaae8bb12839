"""A witness with the atoms that it names, in the user's names, and the lines that it rests on.

This explains verdicts and makes none: an engine has decided, and the steps that decided are shown. Without any steps
the explanation is poorer, but the verdict is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, cached_property
from typing import Final, NamedTuple

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.attacker import TrustDomainView, trust_domain_views
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import (
    DocumentAtom,
    DomainRuleAtom,
    Participant,
    RuleAtom,
    System,
    TopicRuleAtom,
)
from keystore_audit.model.names import AMBIENT, topics_named
from keystore_audit.properties.result import Counterexample, Role, Step, Witness
from keystore_audit.text import some

MAX_UNREAD: Final = 3
"""Of what could not be read, how many are named; the rest are counted."""

Told = tuple[str, tuple[Step, ...]]
"""A text and its steps."""


class Right(NamedTuple):
    """A right that `document` gives; `location`: the rule that allows it, or the grant that allows it by default.

    `by_pattern`: it is a right to be in a partition that is a pattern and matches the channel's.
    """

    document: int
    location: Location
    by_pattern: bool


class Case:
    """A witness about a system, with the atoms that it names. `number`: of the channel."""

    def __init__(self, system: System, witness: Witness) -> None:
        self.system = system
        self.witness = witness
        named = witness.get(Role.TRUST_DOMAIN)
        self.trust_domain = self.enclave.trust_domain if named is None else named
        self.trust = system.trust_domains[self.trust_domain]
        self.number = witness.get(Role.CHANNEL, 0)

    def at(self, witness: Witness) -> Case:
        """The same with other atoms for some roles."""
        there = Case(self.system, {**self.witness, **witness})
        there.permissions, there.views = self.permissions, self.views
        return there

    @cached_property
    def permissions(self) -> Permissions:
        """What grants allow now."""
        return Permissions(self.system)

    @cached_property
    def views(self) -> list[TrustDomainView]:
        """How the peers of each trust domain see every enclave."""
        return trust_domain_views(self.system, self.permissions)

    @property
    def view(self) -> TrustDomainView:
        """How the peers of the witness's trust domain see every enclave."""
        return self.views[self.trust_domain]

    @property
    def enclave(self) -> Participant:
        """The enclave that the witness names."""
        return self.system.enclaves[self.witness[Role.ENCLAVE]]

    @cached_property
    def domain_rule(self) -> DomainRuleAtom | None:
        """The domain rule that decides about the domain: the first that covers it."""
        return None if self._domain_rule is None else self.system.domain_rules[self._domain_rule]

    @cached_property
    def _domain_rule(self) -> int | None:
        named = self.witness.get(Role.DOMAIN)
        domain = self.system.channels[self.number].domain if named is None else named
        rules, document = enumerate(self.system.domain_rules), self.trust.governance
        return next((n for n, r in rules if r.document == document and domain in r.domains), None)

    @cached_property
    def topic_rule(self) -> TopicRuleAtom | None:
        """The topic rule that decides about the channel: the first that matches, of the deciding domain rule."""
        rules = (rule for rule in self.system.topic_rules if rule.domain_rule == self._domain_rule)
        return next((rule for rule in rules if self.number in rule.channels), None)

    def rights(self, enclave: int, operation: Operation) -> list[Right]:
        """Every right of an enclave to do `operation` on the channel, whoever signed the document that gives it.

        Rights about the channel itself come first, those to be in a partition that is a pattern for it last.
        """
        return self.rights_by(self.system.enclaves[enclave].identity, operation)

    def rights_by(self, identity: int | None, operation: Operation) -> list[Right]:
        """As `rights`, of the holder of the certificate."""
        grants = self.system.grants
        chosen = self.permissions.chosen(identity, frozenset(self.view.documents))
        found = []
        for grant in sorted(chosen, key=lambda number: grants[number].document):
            allowed = self.permissions.allowed(grant, operation)
            channel = next((each for each in self._here_and_meeting if allowed >> each & 1), None)
            if channel is not None:
                rule = self.permissions.decider(grant, operation, channel)
                line = grants[grant].location if rule is None else self.system.place(rule, operation, channel)
                found.append(Right(grants[grant].document, line, channel != self.number))
        return sorted(found, key=lambda right: right.by_pattern)

    @cached_property
    def _here_and_meeting(self) -> list[int]:
        """The channel, and those whose endpoints are met in it."""
        return [self.number, *(n for n, others in enumerate(self.system.meets) if self.number in others)]

    def has_authority_key(self, certificate: int | None) -> bool:
        """Whether the key of a certificate is that of a permissions CA of the trust domain."""
        return certificate is not None and self.system.certificates[certificate].key in self.view.authority_keys

    @property
    def topic(self) -> str:
        """The channel for people: the ROS name (one of many, where it has infinitely many), domain and partition."""
        return f"{self._name} in {self._place('')}"

    @property
    def stop(self) -> str:
        """The same on a route: `/workshop (domain 1)`."""
        return f"{self._name.removesuffix(' (topic)')} ({self._place('')})"

    @property
    def _name(self) -> str:
        channel = self.system.channels[self.number]
        return topics_named(channel.topic, endless=channel.infinite)

    def _place(self, topic: str) -> str:
        channel = self.system.channels[self.number]
        partition = f', partition "{channel.partition}"' if channel.partition else ""
        return f"{self.system.domains[channel.domain].label}{topic}{partition}"

    def step(self, location: Location | None, enclave: str | None = None) -> Step:
        """A step about the channel."""
        topic = self.system.channels[self.number].topic
        return step_at(location, topic, channel=self._place(f", topic {topic}"), enclave=enclave)

    def identity_step(self, enclave: Participant) -> Step:
        """The step that shows who an enclave is."""
        who = enclave if enclave.identity is None else self.system.certificates[enclave.identity]
        return step_at(who.location, who.label, enclave=enclave.label)

    def governance_steps(self) -> tuple[Step, ...]:
        """The rules that protect the channel."""
        return tuple(self.step(rule.location) for rule in (self.topic_rule, self.domain_rule) if rule is not None)

    def right_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """The line that gives an enclave a right, where there is one."""
        label = self.system.enclaves[enclave].label
        return tuple(self.step(right.location, label) for right in self.rights(enclave, operation)[:1])

    def granted_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """The line that gives some enclave one of these rights."""
        return self._first(self.right_steps, operations)

    def user_steps(self, *operations: Operation) -> tuple[Step, ...]:
        """The line that makes an endpoint exist, though honest peers may refuse it: there is something to protect."""
        return self.granted_steps(*operations) or self._first(self._lone_member_steps, operations)

    def _first(
        self, steps: Callable[[int, Operation], tuple[Step, ...]], operations: Sequence[Operation]
    ) -> tuple[Step, ...]:
        every = range(len(self.system.enclaves))
        return next(filter(None, (steps(enclave, operation) for operation in operations for enclave in every)), ())

    def _lone_member_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        member = self.system.enclaves[enclave].trust_domain == self.trust_domain
        return self.lone_steps(enclave, operation) if member else ()

    def lone_steps(self, enclave: int, operation: Operation) -> tuple[Step, ...]:
        """The line by which its own implementation lets an enclave do what honest peers may refuse."""
        atom = self.system.enclaves[enclave]
        alone = {Operation.PUBLISH: atom.writes_alone, Operation.SUBSCRIBE: atom.reads_alone}.get(operation, ())
        if self.number not in alone:
            return ()
        document = atom.location if atom.document is None else self.system.documents[atom.document].location
        return (self.step(next(self._own_lines(atom, operation), document), atom.label),)

    def _own_lines(self, enclave: Participant, operation: Operation) -> Iterator[Location]:
        """The lines of its own document that allow the channel, whatever its domain and whatever stands before."""
        for channel in self._here_and_meeting:
            for rule in self.system.rules:
                mine = self.system.grants[rule.grant].document in enclave.permissions
                if mine and rule.allow and channel in rule.named(operation):
                    yield self.system.place(rule, operation, channel)

    def kinds(self) -> str:
        """The protection kinds that apply to the channel, in words."""
        if self.topic_rule is None or self.domain_rule is None:
            return "no governance rule covers it"
        return (
            f"rtps_protection_kind is {self.domain_rule.rtps_protection_kind.value}, "
            f"metadata_protection_kind {self.topic_rule.metadata_protection_kind.value}, "
            f"data_protection_kind {self.topic_rule.data_protection_kind.value}"
        )

    def named(self) -> list[str]:
        """The enclave and the topic that the witness names."""
        enclave = [self.enclave.label] if Role.ENCLAVE in self.witness else []
        return [*enclave, *([self.topic] if Role.CHANNEL in self.witness else [])]

    def open_door(self) -> str:
        """The end of a sentence if the domain's rule lets in unauthenticated participants; else nothing."""
        rule = self.domain_rule
        allowed = rule is not None and rule.allow_unauthenticated_participants
        return ", and messages of unauthenticated participants are allowed in the clear" if allowed else ""


def not_excluded(system: System, *about: str) -> Counterexample | None:
    """The answer where something is unread and may say whatever a witness needs; None: all was read."""
    every: list[DocumentAtom | Participant] = [*system.documents, *system.enclaves]
    unread = [each for each in every if each.opaque]
    names = [each.location.path for each in unread]
    names += ["a CA file" for each in system.certificates if each.opaque]
    if not names:
        return None
    files = some(dict.fromkeys(names), MAX_UNREAD)
    text = f"It cannot be ruled out for {' on '.join(about) or 'anybody'}: {files} could not be read."
    shown = ((each, each.label != each.location.path) for each in unread[:MAX_UNREAD])
    steps = (step_at(each.location, each.label if named else "could not be read") for each, named in shown)
    return Counterexample(text=text, steps=tuple(steps))


def step_at(location: Location | None, witness: str, *, channel: str | None = None, enclave: str | None = None) -> Step:
    """A step with its line, if there is one."""
    path, line, expression = (location.path, location.line, location.message) if location else (None, None, "")
    return Step(enclave=enclave, channel=channel, witness=witness, path=path, line=line, expression=expression)


def plainest(system: System, witnesses: Sequence[Witness]) -> Witness:
    """The witness that is easiest to understand; of equal ones the first. Preferred is an enclave of the keystore,
    then the default partition, a user's topic that documents name, no grant on it, and a short name.
    """

    @cache
    def allowing() -> tuple[dict[int, list[int]], dict[int, list[RuleAtom]]]:
        """The grants that name each certificate, and what each allows."""
        named = gathered((name, number) for number, grant in enumerate(system.grants) for name in grant.names)
        return named, gathered((rule.grant, rule) for rule in system.rules if rule.allow)

    @cache
    def granted(enclave: int) -> set[int]:
        named, rules = allowing()
        identity = system.enclaves[enclave].identity
        own = [] if identity is None else named.get(identity, [])
        return {n for each in own for rule in rules.get(each, ()) for n in (*rule.publish, *rule.subscribe)}

    def rank(witness: Witness) -> tuple[object, ...]:
        enclave, channel = witness.get(Role.ENCLAVE), witness.get(Role.CHANNEL)
        unmanaged = enclave is not None and system.enclaves[enclave].unmanaged
        if channel is None:
            return (unmanaged,)
        atom = system.channels[channel]
        right = enclave is not None and channel in granted(enclave)
        of_users = atom.topic.startswith("rt/") and atom.topic not in AMBIENT
        return unmanaged, atom.partition != "", not of_users, atom.infinite, right, len(atom.topic)

    return min(witnesses, key=rank)


# Why an enclave can publish on a channel, and peers accept it, or can read it: by which right, flag, or keys.
#
# Each in words that follow a colon (empty: by a grant of the permissions CA), with the lines.


_BY_PATTERN: Final = "its partition may be a pattern that matches this partition"
"""How a right for other partitions is used here (KA637)."""

_BY_ITSELF: Final[dict[Operation, str]] = {
    Operation.SUBSCRIBE: "its own implementation lets it read there; honest peers would refuse it, but an attacker "
    "gives its keys to anybody",
    Operation.PUBLISH: "its own implementation lets it write there; honest peers would refuse it, but an attacker "
    "takes samples from anybody",
}
"""How an endpoint is used that honest peers refuse."""


def way(case: Case, enclave: int, operation: Operation, *, alone: bool) -> Told:
    """How an enclave gets to the channel of `case`: by right, else as another whose key it has, else by its keys.

    `alone`: what its own implementation lets it do is enough.
    """
    own = _as_itself(case, enclave, operation)
    if own is None and alone and (steps := case.lone_steps(enclave, operation)):
        own = _BY_ITSELF[operation], steps
    if own is not None:
        return _shown(case, enclave, own)
    key = case.system.key_of(enclave)
    sharing = () if key is None else case.system.holders().get(key, ())
    for number in (each for each in sharing if each != enclave):
        if (other := _as_itself(case, number, operation)) is not None:
            why = f"it has the key of {case.system.enclaves[number].label}" + (f": {other[0]}" if other[0] else "")
            return _shown(case, number, (why, other[1]))
    return as_anybody(case, operation, enclave) or _by_keys(case, enclave)


def as_anybody(case: Case, operation: Operation, enclave: int | None) -> Told | None:
    """How anybody gets to the channel without a key, or the enclave by a right in another trust domain. None: nowhere.
    Others than the trust domain of `case` count where the enclave (None: nobody) has no keys in that one.
    """
    writes = operation == Operation.PUBLISH
    for number in sorted(range(len(case.views)), key=lambda each: each != case.trust_domain):
        view = case.views[number]
        if (view.injectable if writes else view.readable) >> case.number & 1:
            there = case.at({Role.TRUST_DOMAIN: number})
            verb, besides = ("send", there.open_door()) if writes else ("read", "")
            return f"anybody on the network can {verb} it: {there.kinds()}{besides}", there.governance_steps()
        if number == case.trust_domain and enclave is not None:
            able = view.abilities(enclave)
            if (able.forges if writes else able.overhears) >> case.number & 1:
                return None
        elif enclave is not None and view.abilities(enclave).by_right(operation) >> case.number & 1:
            return _as_itself(case.at({Role.TRUST_DOMAIN: number}), enclave, operation)
    return None


def beyond_grants(case: Case, operation: Operation) -> Told:
    """How the enclave of `case` does what the permissions CA did not grant it: by a flag, its peers, or its keys."""
    enclave = case.witness[Role.ENCLAVE]
    found = _uncontrolled(case, enclave, operation) or _peer_authorised(case, enclave, operation)
    return _shown(case, enclave, found) if found is not None else _by_keys(case, enclave)


def _shown(case: Case, enclave: int, found: Told) -> Told:
    """With the certificate that makes it a participant, where it is no enclave."""
    atom = case.system.enclaves[enclave]
    why, steps = found
    step = case.identity_step(atom)
    return (why, (*steps, step)) if atom.unmanaged and step not in steps else found


def _by_keys(case: Case, enclave: int) -> Told:
    """By the keys that an enclave holds as a participant, reader or relay; or by what it says of its endpoints."""
    why = f"with the keys that it holds, since {case.kinds()}"
    if case.view.abilities(enclave).unannounced >> case.number & 1:
        why = "it can announce its endpoint as free of access control; peers believe it, and no file here prevents it"
    return _shown(case, enclave, (why, case.governance_steps()))


def _as_itself(case: Case, enclave: int, operation: Operation) -> Told | None:
    for right in case.rights(enclave, operation):
        if right.document in case.view.genuine:
            return _along(case, enclave, right.location, _BY_PATTERN if right.by_pattern else "")
    return _uncontrolled(case, enclave, operation) or _peer_authorised(case, enclave, operation)


def _uncontrolled(case: Case, enclave: int, operation: Operation) -> Told | None:
    """By a topic rule that asks for no right."""
    kind = {Operation.PUBLISH: "write", Operation.SUBSCRIBE: "read"}.get(operation)
    rule, flag = case.topic_rule, f"enable_{kind}_access_control"
    if kind is None or rule is None or getattr(rule, flag):
        return None
    return _along(case, enclave, rule.location, f"{flag} is false")


def _peer_authorised(case: Case, number: int, operation: Operation) -> Told | None:
    """By a right that peers accept although the permissions CA did not grant it."""
    enclave = case.system.enclaves[number]
    as_whom = (
        (case.has_authority_key(enclave.identity), "its key is the permissions CA's key"),
        (case.view.self_granting(number), "it can sign its own permissions, and its peers accept them"),
        (
            case.view.issuing(number),
            "its key is an identity CA's key, so it can issue itself any identity that a grant names",
        ),
    )
    for so, why in as_whom:
        if so:
            return why, (case.identity_step(enclave),)
    for right in case.rights(number, operation):
        if right.document not in case.view.genuine:
            label = case.system.documents[right.document].label
            why = f"{label} grants it; the permissions CA did not sign this document, but peers accept it"
            return _along(case, number, right.location, why)
    return None


def _along(case: Case, enclave: int, location: Location, why: str) -> Told:
    """The one step that an enclave takes on a channel because of a line."""
    return why, (case.step(location, case.system.enclaves[enclave].label),)
