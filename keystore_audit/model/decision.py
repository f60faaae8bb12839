"""What an enclave's own implementation lets it do: topics and endpoints, with the line that decides.

What its peers accept from it is another question (`model.formal.rights`): a compromised enclave skips its
own checks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from functools import cache, cached_property, partial
from itertools import chain
from os.path import commonprefix
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Operation, TopicRule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, Point, illegal_names, wildcard_names
from keystore_audit.model.domains import describe
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.steps import Step, allowed, deciding
from keystore_audit.model.matching.expression import any_matches, naming, parse
from keystore_audit.model.rights import RuleLists, TopicDecision
from keystore_audit.model.semantics import (
    ReadDomainRule,
    ReadGrant,
    ReadRule,
    ReadTopicRule,
    deciding_grant,
    is_controlled,
    without_grant,
)
from keystore_audit.profiles import Access, Local, Matcher, Profile, TopicCheck
from keystore_audit.text import MAX_EXPRESSION, shorten

DONE: Final = {
    Operation.PUBLISH: ("publish", "publishing"),
    Operation.SUBSCRIBE: ("subscribe", "subscribing"),
    Operation.RELAY: ("relay", "relaying"),
}


class Decision(Struct, frozen=True, kw_only=True):
    """Whether a topic and an endpoint can be created, why (a sentence), and the line that says so."""

    allow: bool
    reason: str
    location: Location | None


Told = tuple[str, int | None]
"""A sentence, and the line that says so."""


class Why(NamedTuple):
    """What a step says. `explain`: why, about a name if one is asked; `place`: in which document, "" for none.

    `by_permissions`: the grant decides; before it, names and the governance do. `rule`: of the grant, if one decides.
    """

    explain: Callable[[Point | None], Told]
    place: str = ""
    by_permissions: bool = True
    rule: ReadRule | None = None

    @property
    def location(self) -> Location | None:
        """The line that decides."""
        return self.at(None)[1]

    def at(self, name: Point | None) -> tuple[str, Location | None]:
        """Why, and the line that decides."""
        reason, line = self.explain(name)
        return reason, Location(path=self.place, line=line) if self.place else None


_Step = Step[Why]


class _Asked(NamedTuple):
    """What is asked of one grant. `channel`: what stands for the name in the domain."""

    operation: Operation
    name: Point
    channel: int


class LocalRights:
    """The decisions of one keystore's implementations about channels, at `at` (aware UTC).

    They hold for participants that are created; `model.participants.usability` says which are.
    """

    def __init__(self, accesses: AccessViews, channels: Channels, at: datetime) -> None:
        self._accesses = accesses
        self._channels = channels
        self._at = at
        self._lists = RuleLists(channels)
        self._illegal = cache(lambda legal: bits(illegal_names(channels, legal)))
        self._allowed: dict[object, int] = {}
        self._governed: dict[object, list[TopicDecision]] = {}
        self._all = self._lists.all

    def allowed(self, enclave: Enclave, profile: Profile, operation: Operation) -> int:
        """The channels on which the operation is allowed, as a bit set: the same for profiles that decide alike."""
        profile = profile.run_by(enclave.path)
        access = self._accesses.row(profile.access)
        key = enclave.files.directory, access, profile.local, profile.trust.subjects, operation
        known = self._allowed.get(key)
        if known is None:
            known = self._allowed[key] = allowed(self.steps(enclave, profile, operation))
        return known

    def peer_authorised(self, enclave: Enclave, profile: Profile, operation: Operation) -> int:
        """The channels on which peers would allow the operation by the enclave's grant; governance is not asked."""
        profile = profile.run_by(enclave.path)
        grant = self.grant(enclave, profile)
        if grant is None:
            return 0
        matcher = self._accesses.row(profile.access).matcher
        return allowed(self._lists.of(grant, operation, matcher, of_peers=True))

    def decide(self, enclave: Enclave, profile: Profile, operation: Operation, channel: int, name: Point) -> Decision:
        """The decision about one channel.

        `name`: what is asked about; the channel stands for every name where no governance covers the domain.
        """
        profile = profile.run_by(enclave.path)
        step = self.step(enclave, profile, operation, channel)
        grant = self.grant(enclave, profile)
        reason, location = step.by.at(name)
        if not step.allow and grant is not None:
            asked = _Asked(operation, name, channel)
            reason += self._near(grant, profile, asked, by_permissions=step.by.by_permissions)
        return Decision(allow=step.allow, reason=reason, location=location)

    def step(self, enclave: Enclave, profile: Profile, operation: Operation, channel: int) -> _Step:
        """What decides about one channel, without a search for near misses."""
        return deciding(self.steps(enclave, profile, operation), channel)

    def steps(self, enclave: Enclave, profile: Profile, operation: Operation) -> Iterator[_Step]:
        """What decides, in order; the last step decides about everything."""
        profile = profile.run_by(enclave.path)
        access = self._accesses.row(profile.access)
        if operation is not Operation.RELAY:
            yield from self._names(profile)
            yield from self._governance(enclave, access, operation, profile.local)
        grant = self.grant(enclave, profile)
        if grant is None:
            why = without_grant(self._accesses.own_grants(enclave, profile) or (), self._at)
            yield Step(self._all, False, Why(partial(_said, why.format("the enclave"))))
            return
        place = enclave.permissions.signed.file.place if enclave.permissions else ""
        if access.topic_check is not TopicCheck.NONE and operation is not Operation.RELAY:
            controlled = self._lists.controlled(self._topics(enclave, access, profile.local))
            for rule, channels in self._lists.topics_denied(grant, access, controlled):
                yield Step(channels, False, Why(partial(_no_topic, rule, access.matcher), place))
        everywhere = not profile.local.binds_domains
        for step in self._lists.of(grant, operation, access.matcher, in_every_domain=everywhere):
            explain = (
                partial(_by_default, grant, operation)
                if step.by is None
                else partial(_by_rule, step.by, operation, access.matcher)
            )
            yield Step(step.channels, step.allow, Why(explain, place, rule=step.by))

    def _names(self, profile: Profile) -> Iterator[_Step]:
        """Names that no topic can have."""
        legal = profile.local.topic_names
        if legal is None:
            return
        if refused := self._illegal(legal):
            reason = "the implementation creates no topic of this name"
            yield Step(refused, False, Why(partial(_said, reason), by_permissions=False))

    def _governance(self, enclave: Enclave, access: Access, operation: Operation, local: Local) -> Iterator[_Step]:
        """Topics that no rule of the governance covers, and those without access control for the operation."""
        place = enclave.governance.signed.file.place if enclave.governance else ""
        topics = self._topics(enclave, access, local)
        governed = union(channels for _rule, _topic, channels in topics)
        loose = self._lists.loose(self._domain_rules(enclave, access), access, operation)
        for domain_rule, topic, channels in chain(loose, topics):
            if not is_controlled(topic, operation):
                explain = partial(_uncontrolled, domain_rule, topic, operation)
                yield Step(channels, True, Why(explain, place, by_permissions=False))
        if governed != self._all:
            reason = "no topic rule of the governance covers the topic in this domain, so it cannot be created"
            yield Step(self._all & ~governed, False, Why(partial(_said, reason), place, by_permissions=False))

    def _domain_rules(self, enclave: Enclave, access: Access) -> Sequence[ReadDomainRule]:
        return self._accesses.deciding(enclave.governance, access) if enclave.governance else ()

    def _topics(self, enclave: Enclave, access: Access, local: Local) -> list[TopicDecision]:
        """What the topic rules of the enclave's governance decide about: the same for all who carry it."""
        key = enclave.governance, access, local.reads_names_as_expressions
        if key not in self._governed:
            named = partial(self._naming, access) if local.reads_names_as_expressions else None
            self._governed[key] = [*self._lists.topics(self._domain_rules(enclave, access), access, named)]
        return self._governed[key]

    @cached_property
    def _wildcard_names(self) -> list[int]:
        return wildcard_names(self._channels)

    def _naming(self, access: Access, topic: ReadTopicRule) -> int:
        """The channels whose name, read as an expression, matches the rule's text (of names known one by one)."""
        channels, text = self._channels.channels, topic.rule.expression.text
        return bits(n for n in self._wildcard_names if parse(channels[n].topic, access.matcher).matches(text))

    def grant(self, enclave: Enclave, profile: Profile) -> ReadGrant | None:
        """The grant of the enclave's own document that decides."""
        return deciding_grant(
            self._accesses.own_grants(enclave, profile) or (), self._at, self._accesses.row(profile.access)
        )

    def _near(self, grant: ReadGrant, profile: Profile, asked: _Asked, *, by_permissions: bool) -> str:
        """The rule that comes nearest to allowing it, as a further sentence.

        Where names or the governance decide (not `by_permissions`), only a rule that allows it in other domains.
        """
        operation, (topic, *_partitions), channel = asked
        allowing = _allowing(grant)
        bound = profile.local.binds_domains or not by_permissions
        elsewhere = [bound and not self._lists.domains(rule.domains) >> channel & 1 for rule in allowing]
        for rule, is_elsewhere in zip(allowing, elsewhere, strict=True):
            if (is_elsewhere or by_permissions) and self._listed(rule, profile, asked, operation):
                what = f"allows it in {_domain_of(rule)}" if is_elsewhere else "would allow it, but comes later"
                return f". {self._line(rule, profile, asked)} {what}"
        if not by_permissions:
            return ""
        for other in Operation:
            for rule in allowing:
                if other is not operation and self._listed(rule, profile, asked, other):
                    return f". {self._line(rule, profile, asked, other)} allows {DONE[other][1]} instead"
        for rule, is_elsewhere in zip(allowing, elsewhere, strict=True):
            if self._listed(rule, profile, asked, operation, in_any_partition=True):
                domain = f" of {_domain_of(rule)}" if is_elsewhere else ""
                return f". {self._line(rule, profile, asked)} allows it in another partition{domain}"
        listed = {text: rule for rule in reversed(allowing) for text in rule.texts(operation)}
        if not listed:
            return f". It may {DONE[operation][0]} nothing"
        text = max(listed, key=lambda text: _likeness(text, topic))
        own = (each for criterion in listed[text].rule.criteria for each in criterion.topics if each.text == text)
        line = next((each.line for each in own), listed[text].line)
        return f". The nearest that may be {_PAST[operation]} is {text!r} (line {line})"

    def _line(self, rule: ReadRule, profile: Profile, asked: _Asked, operation: Operation | None = None) -> str:
        matcher = self._accesses.row(profile.access).matcher
        at, _line = _at(rule, operation or asked.operation, asked.name, matcher)
        return f"{at[0].upper()}{at[1:]}"

    def _listed(
        self, rule: ReadRule, profile: Profile, asked: _Asked, operation: Operation, *, in_any_partition: bool = False
    ) -> bool:
        """Whether the rule lists the name for the operation, whatever its domains."""
        matcher = self._accesses.row(profile.access).matcher
        topic, *partitions = asked.name

        def is_listed(expressions: Sequence[str]) -> bool:
            return all(any_matches(expressions, partition, matcher) for partition in partitions)

        return any(
            (in_any_partition or area.partitions is None or is_listed(area.partitions))
            and any_matches(area.topics, topic, matcher)
            for area in rule.region(operation)
        )


_PAST: Final = {Operation.PUBLISH: "published", Operation.SUBSCRIBE: "subscribed to", Operation.RELAY: "relayed"}


def _allowing(grant: ReadGrant) -> list[ReadRule]:
    return [rule for rule in grant.rules if rule.allow and not rule.of_peers]


def _domain_of(rule: ReadRule) -> str:
    return f"domain {describe(rule.domains)}"


def _likeness(text: str, topic: str) -> int:
    """How many characters both begin and end with: a difference in the middle is a typing error, or a neighbour."""
    return sum(len(commonprefix(both)) for both in ((text, topic), (text[::-1], topic[::-1])))  # noqa: RUF071 - letters, not folders


def _uncontrolled(domain_rule: ReadDomainRule, topic: TopicRule, operation: Operation, _name: Point | None) -> Told:
    control = "write" if operation is Operation.PUBLISH else "read"
    where = f"the topic in domain {describe(domain_rule.domains)}"
    return f"the governance has {control} access control off for {where}, so permissions do not count", topic.line


def _said(reason: str, _name: Point | None) -> Told:
    """A refusal that is written in no line."""
    return reason, None


def _at(rule: ReadRule, operation: Operation, name: Point | None, matcher: Matcher) -> Told:
    """`line 36 (rt/*_priority)` and its number: the expression that matches the name, else the rule."""
    text = naming(rule.rule, operation, name[0], matcher) if name is not None else None
    if text is None or text.line is None:
        return f"line {rule.line}", rule.line
    return f"line {text.line} ({shorten(text.text, MAX_EXPRESSION)})", text.line


def _no_topic(rule: ReadRule, matcher: Matcher, name: Point | None) -> Told:
    where, line = _at(rule, Operation.PUBLISH, name, matcher)
    reason = (
        f"{where} is the first rule that lists the topic, and it denies. The topic itself cannot be created, "
        "whatever operation and partition the rule names"
    )
    return reason, line


def _by_rule(rule: ReadRule, operation: Operation, matcher: Matcher, name: Point | None) -> Told:
    at, line = _at(rule, operation, name, matcher)
    if rule.rule.allow and not rule.allow:  # it stands for the partitions that the allow rule leaves out (`semantics`)
        where = "but not in this partition; later rules do not count"
        return f"{at} is the first rule that lists the topic, {where}", line
    verb = "allows" if rule.allow else "denies"
    return f"{at} is the first rule that matches, and it {verb} {DONE[operation][1]}", line


def _by_default(grant: ReadGrant, operation: Operation, _name: Point | None) -> Told:
    typed = grant.grant
    said = "ALLOW" if typed.default_allow else "DENY"
    reason = f"no rule matches {DONE[operation][1]}, and the default is {said}"
    if typed.default_allow and not grant.default_allow:
        reason += ", which the implementation ignores"
    return reason, typed.default_line if typed.default_line is not None else typed.line
