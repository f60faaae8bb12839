"""The grants that peers take from each enclave, and the services that their texts are about."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Grant, Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.domains import Interval, contains
from keystore_audit.model.formal.attacker import TrustDomainView, enclaves_views
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.steps import Step, decided
from keystore_audit.model.formal.system import Participant, System
from keystore_audit.model.matching.automaton import PatternIndex
from keystore_audit.model.matching.coverage import allows_everything
from keystore_audit.model.matching.expression import any_matches, has_wildcard, parse
from keystore_audit.model.names import ACTION_PART, ACTION_SERVICES, ACTION_TOPICS
from keystore_audit.model.ros.classes import REPLY, REQUEST
from keystore_audit.model.semantics import Area, ReadGrant, ReadRule
from keystore_audit.profiles import Access, Matcher

# Quick answers from the texts of a grant, where they are certain, and the lines of a document that people look for.


_ENDS: Final = tuple(ACTION_PART + service for service in ACTION_SERVICES)


class Lines:
    """The lines of a grant that list topics in allow rules. Thousands may be asked for, of as many expressions."""

    def __init__(self, grant: Grant) -> None:
        self._grant = grant

    @cached_property
    def _listed(self) -> dict[Operation, tuple[dict[str, Text], PatternIndex, list[Text]]]:
        """By operation: for each text its first occurrence, all of these as patterns by their numbers, and in order."""
        listed: dict[Operation, tuple[dict[str, Text], PatternIndex, list[Text]]] = {}
        for operation in Operation:
            first: dict[str, Text] = {}
            for text in self._grant.listed(operation):
                first.setdefault(text.text, text)
            patterns = ((number, parse(text, Matcher.POSIX)) for number, text in enumerate(first))
            listed[operation] = first, PatternIndex(patterns), list(first.values())
        return listed

    def of(self, operation: Operation, topic: str) -> int | None:
        """The line of the expression that matches the topic; one without wildcards comes first."""
        first, patterns, texts = self._listed[operation]
        if topic in first:
            return first[topic].line
        matching = [number for number, pattern in patterns.candidates(topic) if pattern.matches(topic)]
        return texts[min(matching)].line if matching else None


class DocumentLines:
    """The same for an enclave's permissions."""

    def __init__(self, enclave: Enclave) -> None:
        file = enclave.permissions
        self._path = enclave.files.directory if file is None else file.signed.file.place
        self._grants = [Lines(grant) for grant in enclave.grants]

    def of(self, operation: Operation, topic: str) -> Location:
        """The first line that lists the topic; else the document."""
        for lines in self._grants:
            line = lines.of(operation, topic)
            if line is not None:
                return Location(path=self._path, line=line)
        return Location(path=self._path)


def is_surely_whole(grant: Grant, *, rewinds: bool) -> bool:
    """Whether it allows every service and action, that it allows a part of, as a whole: by the texts alone.

    False where a closer look is needed. True only for allow rules without partitions, for the same domains, with no
    wildcards but `*`. Then each expression is allowed as a whole, and the two halves of a service differ only in prefix
    and suffix. `rewinds`: whether all implementations search behind a `*` (`expression`).
    """
    if grant.default_allow or len({tuple((d.low, d.high) for d in rule.domains) for rule in grant.rules}) > 1:
        return False
    listed: dict[Operation, set[str]] = {operation: set() for operation in Operation}
    for rule in grant.rules:
        for criterion in rule.criteria:
            if not rule.allow or criterion.partitions is not None:
                return False
            listed[criterion.operation].update(text.text for text in criterion.topics)
    published, subscribed = listed[Operation.PUBLISH], listed[Operation.SUBSCRIBE]
    everything = "\n".join(published | subscribed)
    if any(wildcard in everything for wildcard in "?[\\"):
        return False
    if "*" in everything and not (rewinds and all(map(_is_of_one_kind, published | subscribed))):
        return False
    client, server = REQUEST.between(published), REPLY.between(published)
    if client != REPLY.between(subscribed) or server != REQUEST.between(subscribed):
        return False
    if ACTION_PART not in everything and "*" not in everything:
        return True
    return (
        _whole_actions(client, subscribed) and _whole_actions(server, published) and _are_served(published, by=server)
    )


def _is_of_one_kind(text: str) -> bool:
    """Whether the expression, if it has wildcards, matches topics, requests or replies alone."""
    return "*" not in text or text.startswith("rt/") or (text[:3] in _PREFIXES and text.endswith(("Request", "Reply")))


_PREFIXES: Final = frozenset(("rq/", "rr/"))


def _whole_actions(services: set[str], listed: set[str]) -> bool:
    """Whether no action has a part of these services, or lacks a topic among those that are listed."""
    actions = [{name[: -len(end)] for name in services if name.endswith(end)} for end in _ENDS]
    if any(each != actions[0] for each in actions):
        return False
    if any(f"rt{name}{ACTION_PART}{topic}" not in listed for name in actions[0] for topic in ACTION_TOPICS):
        return False
    return all(ACTION_PART not in name or name.endswith(_ENDS) for name in services)


def _are_served(published: set[str], *, by: set[str]) -> bool:
    """Whether the topics of actions that are listed by name belong to actions that are served by these services."""
    actions = {name[: -len(_ENDS[0])] for name in by if name.endswith(_ENDS[0])}
    named = {text for text in published if text.startswith("rt/") and ACTION_PART in text and "*" not in text}
    return named <= {f"rt{name}{ACTION_PART}{topic}" for name in actions for topic in ACTION_TOPICS}


_PARTITIONS: Final = ("", "*")
"""Partitions in which an endpoint meets those of ROS 2: the default one, and the name that is a pattern for it."""


class Placed:
    """A grant with the document it stands in, and what its publish criteria list, by the kind of name."""

    def __init__(self, place: str, grant: ReadGrant) -> None:
        self.place = place
        self.grant = grant
        self.lines = Lines(grant.grant)
        texts = [text for rule in grant.rules if rule.allow for text in rule.texts(Operation.PUBLISH)]
        self.requests = REQUEST.between(texts)
        self.replies = REPLY.between(texts)
        self.certain = _certain(grant)
        self.wild: tuple[str, ...] = ()
        self.everything = grant.default_allow
        self.allows_only = all(rule.allow for rule in grant.rules)
        if has_wildcard("\n".join(texts)):
            self.wild = tuple(dict.fromkeys(t for t in texts if has_wildcard(t) and not t.startswith("rt/")))
            self.requests = {name for name in self.requests if not has_wildcard(name)}
            self.replies = {name for name in self.replies if not has_wildcard(name)}
            self.everything = self.everything or allows_everything(grant.grant)

    @property
    def expressions(self) -> Iterator[str]:
        """All that its publish criteria list, of rules that allow and that deny."""
        return (text for rule in self.grant.rules for text in rule.texts(Operation.PUBLISH))


def _certain(grant: ReadGrant) -> tuple[Interval, ...] | None:
    """The domains in which everything that an allow rule lists is allowed, in the default partition; None: unclear."""
    domains = grant.rules[0].domains if grant.rules else ()
    for rule in grant.rules:
        if (
            not rule.allow
            or rule.domains != domains
            or any("" not in (area.partitions or ("",)) for area in rule.publish)
        ):
            return None
    return domains


class Holder:
    """An enclave (its path) with the grants that peers take from it, `own` those of its own document.

    `requests`, `replies`: services that they list by name; `wild_requests`, `wild_replies`: patterns.
    `everything`: some grant allows everything, by its rules or by default.
    """

    def __init__(self, path: str, grants: tuple[Placed, ...], own: tuple[Placed, ...]) -> None:
        self.path = path
        self.grants = grants
        self.own = own
        self.everything = any(grant.everything for grant in grants)
        self.allows_only = all(grant.allows_only for grant in grants)
        self.certain = {domains for grant in grants if (domains := grant.certain)} if len(grants) == 1 else set()
        self.requests: set[str] = set().union(*(grant.requests for grant in grants))
        self.replies: set[str] = set().union(*(grant.replies for grant in grants))
        wild = tuple(dict.fromkeys(text for grant in grants for text in grant.wild))
        self.wild_requests = tuple(text for text in wild if not text.startswith("rr/"))
        self.wild_replies = tuple(text for text in wild if not text.startswith("rq/"))

    @property
    def expressions(self) -> Iterator[str]:
        """Everything that its publish criteria list."""
        return (text for grant in self.grants for text in grant.expressions)

    def right(self, operation: Operation, topic: str) -> Location | None:
        """The line that lists the topic for the operation."""
        for placed in self.grants:
            line = placed.lines.of(operation, topic)
            if line is not None:
                return Location(path=placed.place, line=line)
        return None


class Holders:
    """Makes the holders of one keystore's systems; shared parts are made once.

    `files`: permissions documents by place.
    """

    def __init__(self, files: Mapping[str, PermissionsFile], accesses: AccessViews) -> None:
        self._files = files
        self._accesses = accesses
        self._placed: dict[tuple[str, int, Access], Placed] = {}
        self._known: dict[tuple[str, tuple[Placed, ...], tuple[Placed, ...]], Holder] = {}

    def of(self, system: System, row: Access) -> tuple[Holder, ...]:
        """The enclaves of the system, whose documents implementations of the row read; equal ones are one object.

        Nodes are in enclaves: unmanaged identities are no holders.
        """
        permissions = Permissions(system)
        trust_domains = enclaves_views(system, permissions)
        placed = list(self._grants(system, row))
        return tuple(
            self._holder(number, enclave, trust_domains, permissions, placed)
            for number, enclave in enumerate(system.enclaves)
            if not enclave.unmanaged
        )

    def _holder(
        self,
        number: int,
        enclave: Participant,
        trust_domains: Sequence[TrustDomainView],
        permissions: Permissions,
        placed: Sequence[Placed | None],
    ) -> Holder:
        taken: dict[int, None] = {}
        for trust_domain in trust_domains:
            if trust_domain.authenticated(number):
                taken.update(dict.fromkeys(permissions.chosen(enclave.identity, trust_domain.accepted)))
        own = permissions.chosen(enclave.identity, enclave.permissions)
        grants = tuple(each for each in (placed[grant] for grant in taken) if each is not None)
        mine = tuple(each for each in (placed[grant] for grant in own if grant in taken) if each is not None)
        key = (enclave.label, grants, mine)
        if key not in self._known:
            self._known[key] = Holder(*key)
        return self._known[key]

    def _grants(self, system: System, row: Access) -> Iterator[Placed | None]:
        """The grants of the system in order: those of each document as it lists them."""
        counted: dict[int, int] = {}
        for atom in system.grants:
            ordinal = counted.get(atom.document, 0)
            counted[atom.document] = ordinal + 1
            place = system.documents[atom.document].location.path
            key = (place, ordinal, row)
            if key not in self._placed:
                file = self._files.get(place)
                grants = (self._accesses.read(file, row).grants or ()) if file is not None else ()
                if ordinal >= len(grants):
                    yield None
                    continue
                self._placed[key] = Placed(place, grants[ordinal])
            yield self._placed[key]


def allows(placed: Placed, matcher: Matcher, operation: Operation, topic: str, domain: int) -> bool:
    """Whether the first rule of the grant that matches allows it, in a partition that meets the default one."""
    return any(part and step.allow for step, part in decided(_steps(placed.grant, matcher, operation, topic, domain)))


def _steps(
    grant: ReadGrant, matcher: Matcher, operation: Operation, topic: str, domain: int
) -> Iterator[Step[ReadRule | None]]:
    """What decides about the topic, over partitions."""
    for rule in grant.rules:
        if contains(rule.domains, domain):
            areas = (_matching(area, matcher, topic) for area in rule.region(operation))
            yield Step(union(areas), rule.allow, rule)
    yield Step(-1, grant.default_allow, None)


def _matching(area: Area, matcher: Matcher, topic: str) -> int:
    """The partitions, of the two, in which the area holds the topic."""
    if topic not in area.topics and not any_matches(filter(has_wildcard, area.topics), topic, matcher):
        return 0
    listed = area.partitions
    return bits(n for n, each in enumerate(_PARTITIONS) if listed is None or any_matches(listed, each, matcher))
