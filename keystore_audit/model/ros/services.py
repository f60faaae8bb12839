"""Who may answer a service that another enclave answers, and who may set parameters and states of another's nodes.

An enclave *answers* a service where a grant lets it publish the replies, and *calls* it where one lets it publish the
requests. Rights are effective: those of every document that peers take from the enclave. A node is another enclave's if
that enclave's own document lets it answer the node's services. The caller's documents must not list these by name. Left
out is what other rules report as a whole: grants that allow everything (KA511) or by default (KA509). So is access
control that is off (KA406), and so are documents that are unread or that an enclave can sign itself (KA7, KA9).
ROS 2 endpoints are in the default partition, which an endpoint in the partition `*` meets.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.intent.intent import is_ros_name
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.domains import Interval, contains
from keystore_audit.model.matching.alphabet import Budget
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.model.names import LIFECYCLE_SERVICES, PARAMETER_SERVICES, SETTING_SERVICES
from keystore_audit.model.ros.classes import REPLY, REQUEST, Affix, classify_ros_names
from keystore_audit.model.ros.holders import Holder, Placed, allows
from keystore_audit.profiles import Matcher

MAX_MATCHES: Final = 1_000_000
"""Pairs of an expression and a name, or of two expressions, that are looked at: a second."""

_UNITS_OF_A_SEARCH: Final = 1_000
"""What deciding about two expressions over all names takes, in pairs that are only matched: about 2 ms."""

FAMILIES: Final[Mapping[str, tuple[str, ...]]] = {
    "parameters": (*SETTING_SERVICES, *(each for each in PARAMETER_SERVICES if each not in SETTING_SERVICES)),
    "states": ("change_state", *(each for each in LIFECYCLE_SERVICES if each != "change_state")),
}
"""Services below a node's name; those that change something come first."""

CHANGING: Final = frozenset((*SETTING_SERVICES, "change_state"))

_FAMILY: Final = {service: family for family, services in FAMILIES.items() for service in services}


class Reach(Struct, frozen=True, kw_only=True):
    """An enclave may call services of a family at nodes of others.

    `caller`, `owner`: paths. `service`: of the `node`; one that changes something where there is one. `nodes`,
    `owners`: how many, and who. `calls`: each owner with a service of its. `rights`: what allows the call, and what the
    answer.
    """

    caller: str
    family: str
    service: str
    node: str
    owner: str
    nodes: int
    owners: tuple[str, ...]
    calls: tuple[str, ...]
    rights: tuple[Location, Location]

    @property
    def changes(self) -> bool:
        """Whether it may change something, not only read it."""
        return self.service in CHANGING


class Rivals(Struct, frozen=True, kw_only=True):
    """Enclaves (paths) that may answer the same services.

    `intruder`: the one whose pattern matches what the others list by name; None where all list it. `rights`: what
    allows each to answer the first of the `services`, in the order of `enclaves`.
    """

    enclaves: tuple[str, ...]
    intruder: str | None
    services: tuple[str, ...]
    rights: tuple[Location, ...]


class Services:
    """The services of one keystore as one kind of implementation reads it. `domains`: one of each class.

    Every method raises BudgetExceeded where there is too much to look at.
    """

    def __init__(self, holders: Sequence[Holder], matcher: Matcher, domains: Sequence[int]) -> None:
        self._holders = [holder for holder in holders if not holder.everything]
        self._matcher = matcher
        self._domains = domains
        self._budget = Budget(MAX_MATCHES, "too many patterns match too many services to tell who may use them")
        self._answering = gathered((service, holder) for holder in self._holders for service in holder.replies)
        self._sorted = (
            sorted(self._answering) if any(each.wild_requests or each.wild_replies for each in holders) else []
        )
        self._matched: dict[tuple[str, Affix], list[str]] = {}
        self._answers = _Answers(self._holders, matcher)

    def rivals(self) -> Iterator[Rivals]:
        """Enclaves that may answer one service, by who they are."""
        groups: dict[tuple[Holder, ...], list[str]] = {}
        for service, holders in self._answering.items():
            if len(holders) > 1:
                able = tuple(each for each in holders if self._may(each, REPLY.topic(service)))
                if len(able) > 1:
                    groups.setdefault(able, []).append(service)
        for able, services in groups.items():
            yield self._rivals(able, None, services)
        for holder in self._holders:
            found: dict[str, list[Holder]] = {}
            for text in holder.wild_replies:
                for service in self._matching(text, REPLY):
                    others = [each for each in self._answering[service] if each is not holder]
                    if others and service not in holder.replies:
                        found.setdefault(service, others)
            names = [each for each in sorted(found) if self._may(holder, REPLY.topic(each))]
            if names:
                owners = dict.fromkeys(each for name in names for each in found[name])
                first = found[names[0]]
                yield self._rivals((holder, *first, *(each for each in owners if each not in first)), holder, names)

    def _rivals(self, holders: Sequence[Holder], intruder: Holder | None, services: Sequence[str]) -> Rivals:
        named = sorted(services)
        rights = (each.right(Operation.PUBLISH, REPLY.topic(named[0])) for each in holders)
        return Rivals(
            enclaves=tuple(each.path for each in holders),
            intruder=intruder.path if intruder else None,
            services=tuple(named),
            rights=tuple(right for right in rights if right is not None),
        )

    def reaches(self) -> Iterator[Reach]:
        """What every enclave may call at nodes of others."""
        for caller in self._holders:
            found: dict[str, dict[tuple[str, str, Holder], None]] = {family: {} for family in FAMILIES}
            for service, owner in self._callable(caller):
                node, _, name = service.rpartition("/")
                found[_FAMILY[name]].setdefault((node, name, owner))
            for family, calls in found.items():
                verified = [call for call in calls if self._together(caller, *call)]
                if verified:
                    yield self._reach(caller, family, verified)

    def _reach(self, caller: Holder, family: str, calls: Sequence[tuple[str, str, Holder]]) -> Reach:
        node, service, owner = min(calls, key=lambda call: (FAMILIES[family].index(call[1]), call[0], call[2].path))
        told = [call for call in calls if (call[1] in CHANGING) == (service in CHANGING)]
        name = f"{node}/{service}"
        rights = (
            caller.right(Operation.PUBLISH, REQUEST.topic(name)),
            owner.right(Operation.PUBLISH, REPLY.topic(name)),
        )
        nowhere = Location(path="")
        return Reach(
            caller=caller.path,
            family=family,
            service=service,
            node=node,
            owner=owner.path,
            nodes=len({call[0] for call in told}),
            owners=tuple(sorted({call[2].path for call in told})),
            calls=tuple(sorted({f"{who.path} {where}/{what}" for where, what, who in told})),
            rights=(rights[0] or nowhere, rights[1] or nowhere),
        )

    def _callable(self, caller: Holder) -> Iterator[tuple[str, Holder]]:
        """Services of families that expressions of the caller match, with those who may answer them."""
        for service in caller.requests:
            if service in self._answering:
                yield from self._of_others(service, caller)
        for text in caller.wild_requests:
            for service in self._matching(text, REQUEST):
                yield from self._of_others(service, caller)
        yield from self._meetings(caller)

    def _of_others(self, service: str, caller: Holder) -> Iterator[tuple[str, Holder]]:
        name = service.rpartition("/")[2]
        if name in _FAMILY and service.count("/") > 1 and service not in caller.replies:
            for owner in self._answering[service]:
                yield service, owner

    def _meetings(self, caller: Holder) -> Iterator[tuple[str, Holder]]:
        """Services that an expression of the caller and a pattern of somebody else have in common."""
        if all(each is caller for owners in self._answers.owners.values() for each in owners):
            return
        listed = (name for name in caller.requests if name.rpartition("/")[2] in _FAMILY)
        compared: set[Holder] = set()
        for call in (*map(REQUEST.topic, listed), *caller.wild_requests):
            for answer in self._answers.compatible(parse(call, self._matcher).prefix[2:]):
                self._budget.spend(1)
                owners = [each for each in self._answers.owners[answer] if each is not caller]
                plain = [each for each in owners if each.allows_only and caller.allows_only]
                for service in _common(call, answer, self._matcher, self._budget) if plain else ():
                    other = self._beside(call, answer, service, caller) if service in caller.replies else service
                    if other is not None:
                        yield from ((other, owner) for owner in plain)
                for owner in owners:
                    if owner not in plain and owner not in compared:
                        compared.add(owner)
                        yield from self._classes(caller, owner)

    def _beside(self, call: str, answer: str, service: str, caller: Holder) -> str | None:
        """The same service of a node for which the caller does not answer itself."""
        name = service.rpartition("/")[2]
        own = [REPLY.topic(each) for each in caller.replies if each.endswith(f"/{name}")]
        self._budget.spend(_UNITS_OF_A_SEARCH * (1 + len(own) // 8))
        patterns = [parse(text, self._matcher) for text in (call, answer, *own)]
        for each in classify_ros_names(patterns, _affixes(name)):
            found = f"{each.name}/{name}"
            if 0 in each.members[0] and 1 in each.members[1] and found not in caller.replies:
                return found
        return None

    def _classes(self, caller: Holder, owner: Holder) -> Iterator[tuple[str, Holder]]:
        """The same where rules that deny come in between: by all classes of names."""
        texts = dict.fromkeys((*caller.expressions, *owner.expressions))
        patterns = [parse(text, self._matcher) for text in texts]
        for services in FAMILIES.values():
            found = (name for service in services for name in self._in_common(caller, owner, service, patterns))
            first = next(found, None)  # the worst comes first, and one tells
            if first is not None:
                yield first, owner

    def _in_common(self, caller: Holder, owner: Holder, service: str, patterns: Sequence[Pattern]) -> Iterator[str]:
        self._budget.spend(_UNITS_OF_A_SEARCH * (1 + len(patterns) // 8))
        for each in classify_ros_names(patterns, _affixes(service)):
            name = f"{each.name}/{service}"
            if name not in caller.replies and self._together(caller, each.name, service, owner):
                yield name

    def _together(self, caller: Holder, node: str, service: str, owner: Holder) -> bool:
        """Whether the one may call in a domain where the other may answer.

        Both list it (or a pattern for it) in an allow rule, which is enough where nothing else can decide.
        """
        if len(caller.certain) == 1 and len(owner.own) == 1 and owner.own[0].certain is not None:
            return self._share(next(iter(caller.certain)), owner.own[0].certain)
        name = f"{node}/{service}"
        return any(
            self._may_in(caller.grants, REQUEST.topic(name), domain)
            and self._may_in(owner.own, REPLY.topic(name), domain)
            for domain in self._domains
        )

    def _share(self, one: Sequence[Interval], other: Sequence[Interval]) -> bool:
        return any(contains(one, domain) and contains(other, domain) for domain in self._domains)

    def _may(self, holder: Holder, topic: str) -> bool:
        return any(self._may_in(holder.grants, topic, domain) for domain in self._domains)

    def _may_in(self, grants: Iterable[Placed], topic: str, domain: int) -> bool:
        return any(allows(grant, self._matcher, Operation.PUBLISH, topic, domain) for grant in grants)

    def _matching(self, text: str, affix: Affix) -> Sequence[str]:
        """The services that somebody lists answers of by name, and whose topic with the affix the pattern matches."""
        pattern = parse(text, self._matcher)
        prefix = pattern.prefix[len(affix.prefix) :]
        known = self._matched.get((text, affix))
        if known is None:
            known = self._matched[text, affix] = list(self._searched(pattern, prefix, affix))
        return known

    def _searched(self, pattern: Pattern, prefix: str, affix: Affix) -> Iterator[str]:
        for at in range(bisect_left(self._sorted, prefix), len(self._sorted)):
            service = self._sorted[at]
            if not service.startswith(prefix):
                break
            self._budget.spend(1)
            if pattern.matches(affix.topic(service)):
                yield service


class _Answers:
    """The patterns of answers, with their `owners`, found by how they begin."""

    def __init__(self, holders: Iterable[Holder], matcher: Matcher) -> None:
        self.owners = gathered((text, holder) for holder in holders for text in holder.wild_replies)
        self._by_prefix = grouped(self.owners, lambda text: parse(text, matcher).prefix[2:])
        self._prefixes = sorted(self._by_prefix)
        self._lengths = sorted({len(prefix) for prefix in self._prefixes})

    def compatible(self, begin: str) -> Iterator[str]:
        """Those that may match a name that begins so, or with which such a pattern may have a name in common."""
        for length in self._lengths:
            if length < len(begin):
                yield from self._by_prefix.get(begin[:length], ())
        for at in range(bisect_left(self._prefixes, begin), len(self._prefixes)):
            if not self._prefixes[at].startswith(begin):
                break
            yield from self._by_prefix[self._prefixes[at]]


def _affixes(service: str) -> tuple[Affix, Affix]:
    """Of the requests and replies of a service below the name of its node."""
    return Affix(REQUEST.prefix, f"/{service}{REQUEST.suffix}"), Affix(REPLY.prefix, f"/{service}{REPLY.suffix}")


class _Pair(NamedTuple):
    node: str | None
    exact: bool


def _common(call: str, answer: str, matcher: Matcher, budget: Budget) -> Iterator[str]:
    """Of each family, a service of some node that is called by the one expression and answered by the other."""
    for service in _FAMILY:
        found = _guessed(call, answer, service, matcher)
        if not found.exact:
            budget.spend(_UNITS_OF_A_SEARCH)
            found = _searched(call, answer, service, matcher)
        if found.node is not None:
            yield f"{found.node}/{service}"


@lru_cache(maxsize=65_536)
def _guessed(call: str, answer: str, service: str, matcher: Matcher) -> _Pair:
    """The name that is likely, if it is one."""
    asked, answered = parse(call, matcher), parse(answer, matcher)
    if asked.literal is not None:
        name = REQUEST.name(asked.literal)
        ends = name is not None and name.endswith(f"/{service}") and answered.matches(REPLY.topic(name))
        node = name[: -len(service) - 1] if ends and name is not None else ""
        return _Pair(node if is_ros_name(node) else None, exact=True)
    begin = max(asked.prefix[2:], answered.prefix[2:], key=len).partition(f"/{service}")[0]
    for node in (begin, begin + "a", "/a"):
        name = f"{node}/{service}"
        if is_ros_name(node) and asked.matches(REQUEST.topic(name)) and answered.matches(REPLY.topic(name)):
            return _Pair(node, exact=True)
    return _Pair(None, exact=False)


@lru_cache(maxsize=4_096)
def _searched(call: str, answer: str, service: str, matcher: Matcher) -> _Pair:
    """Over all names of nodes."""
    classes = classify_ros_names([parse(call, matcher), parse(answer, matcher)], _affixes(service))
    return _Pair(next((each.name for each in classes if 0 in each.members[0] and 1 in each.members[1]), None), True)
