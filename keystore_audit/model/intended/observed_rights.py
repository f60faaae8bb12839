"""What enclaves let themselves do on names known beforehand, in every domain in which they start.

One enclave at a time, over the expressions of its own documents: what others say does not decide what it does.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache, cached_property, reduce
from operator import and_
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.intent.intent import Action, Intent, Origin
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, Point, ReadRegion, document_channels
from keystore_audit.model.claims.globs import region_of
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.domains import contains
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.steps import decided
from keystore_audit.model.formal.system import NodeAtom, System
from keystore_audit.model.intended.observed_needs import DISCOVERY, Usual, in_layout, missing_usual
from keystore_audit.model.matching.expression import UNESCAPED_WILDCARDS
from keystore_audit.model.names import Use, dds_channels, dds_expressions
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.rights import Window
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.profiles import Profile
from keystore_audit.truth import Truth


class JointRuling(Struct, frozen=True, kw_only=True):
    """What one kind of implementation says to channels all of which are needed.

    `ruling`: YES in every domain in which it starts, NO in one of them. UNKNOWN where it is unknown whether it starts;
    None where it starts in none.
    `domains`: where it denies, in words, "" for everywhere; `location`: the line that decides. `explain`: why, a
    sentence without its full stop, which goes through all that the grant lists.
    """

    ruling: Truth | None
    domains: str = ""
    location: Location | None = None
    explain: Callable[[], str] = str


class Beyond(NamedTuple):
    """A name in a partition, and the line that allows it; `endless`: one of infinitely many."""

    point: Point
    location: Location
    endless: bool


_NOWHERE = JointRuling(ruling=None)
_ALLOWED = JointRuling(ruling=Truth.YES)


class Deciders:
    """The profiles by what they decide alike, and who starts where: shared by all enclaves of a keystore.

    `domain`: the one that the robots use; None: every domain that an enclave's governance covers.
    """

    def __init__(
        self, profiles: Sequence[Profile], at: datetime, accesses: AccessViews, domain: int | None = None
    ) -> None:
        self.at = at
        self.accesses = accesses
        self.domain = domain
        self.profiles = profiles
        self._usabilities = Usabilities(None, accesses)
        kinds = grouped(profiles, self._usabilities.kind)
        self.kinds: tuple[tuple[Profile, tuple[str, ...]], ...] = tuple(
            (alike[0], tuple(profile.name for profile in alike)) for alike in kinds.values()
        )
        """One profile of each kind, and the names of all."""

    def usable(self, enclave: Enclave, domain: int, profile: Profile) -> Truth:
        """Whether a participant of the enclave is created there."""
        return self._usabilities.in_domain(domain).of(enclave, self.at, profile).usable


class PointRights:
    """The rights of one enclave on `points`, topics with their partitions.

    What is needed are names of ROS 2, which are ASCII: no implementation doubts which expressions match them.
    """

    def __init__(self, enclave: Enclave, points: Iterable[Point], deciders: Deciders) -> None:
        self._enclave = enclave
        self._deciders = deciders
        self._points = {point: number for number, point in enumerate(dict.fromkeys(points))}
        self._channels = self._of_own_documents(tuple(self._points))
        self._local = LocalRights(deciders.accesses, self._channels, deciders.at)
        self._started = cache(self._where_it_starts)
        self._held = cache(self._allowed)
        self._everywhere = cache(self._always)
        self._somewhere = cache(self._ever)

    def verdict(self, profile: Profile, needed: Sequence[Use]) -> JointRuling:
        """Whether all of it may be done in the default partition."""
        started = self._started(profile)
        if not started:
            return _NOWHERE
        if any(usable is Truth.UNKNOWN for _domain, usable in started):
            return JointRuling(ruling=Truth.UNKNOWN)
        if all(self._everywhere(profile, operation) >> self._points[topic, ""] & 1 for operation, topic in needed):
            return _ALLOWED
        return self._denial(profile, needed)

    def allows(self, profile: Profile, operation: Operation, point: Point) -> bool:
        """Whether it is certainly allowed in some domain in which the enclave starts."""
        return bool(self._somewhere(profile, operation) >> self._points[point] & 1)

    def grant(self, profile: Profile) -> ReadGrant | None:
        """The grant that decides."""
        return self._local.grant(self._enclave, profile)

    def beyond(self, profile: Profile, operation: Operation, known: Container[Point]) -> Beyond | None:
        """A name, in a partition, that is none of the `known` ones, and that the grant allows by an expression or by
        default. It does so in some domain in which the enclave starts. If possible, the name is one of infinitely many.

        Raises errors.BudgetExceeded where the classes of its expressions are too many.
        """
        channels, local = self._classes
        here = bits(
            number
            for number, channel in enumerate(channels.channels)
            if any(
                usable.must and contains(channels.domains[channel.domain].intervals, domain)
                for domain, usable in self._started(profile)
            )
        )
        place = self._enclave.permissions.signed.file.place if self._enclave.permissions else None
        found: Beyond | None = None
        for step, part in decided(local.steps(self._enclave, profile, operation)):
            hit = part & here
            location = step.by.location if hit and step.allow else None
            if location is None or location.path != place:
                continue
            numbers = sorted(members(hit), key=lambda number: not channels.channels[number].ros)
            for cell in (each for number in numbers for each in channels.cells(number)):
                if cell.infinite:
                    return Beyond((cell.topic, cell.partition), location, endless=True)
                if found is None and (cell.topic, cell.partition) not in known:
                    found = Beyond((cell.topic, cell.partition), location, endless=False)
        return found

    @cached_property
    def _classes(self) -> tuple[Channels, LocalRights]:
        """All names, in classes; the points are told apart."""
        claimed = {topic for topic, _partition in self._points if UNESCAPED_WILDCARDS.isdisjoint(topic)}
        channels = self._of_own_documents(None, [region_of((topic,)) for topic in sorted(claimed)])
        return channels, LocalRights(self._deciders.accesses, channels, self._deciders.at)

    def _of_own_documents(self, points: Sequence[Point] | None, claimed: Sequence[ReadRegion] = ()) -> Channels:
        documents = self._enclave.governance, self._enclave.permissions
        return document_channels(self._deciders.accesses.by_row(self._deciders.profiles, documents), points, claimed)

    def _governed(self, profile: Profile) -> Iterator[int]:
        """The lowest domain of each class that the governance covers; 0 where it says nothing."""
        governance = self._enclave.governance
        rules = (
            self._deciders.accesses.read(governance, profile.access).domain_rules if governance is not None else None
        )
        lowest = (atom.intervals[0][0] for atom in self._channels.domains) if rules is not None else (0,)
        return (each for each in lowest if rules is None or any(contains(rule.domains, each) for rule in rules))

    def _where_it_starts(self, profile: Profile) -> Sequence[tuple[int, Truth]]:
        """The domains, one of each class, in which the enclave starts, or may start for all we know."""
        deciders = self._deciders
        domains = self._governed(profile) if deciders.domain is None else (deciders.domain,)
        asked = ((domain, deciders.usable(self._enclave, domain, profile)) for domain in domains)
        return [(domain, usable) for domain, usable in asked if usable.may]

    def _denial(self, profile: Profile, needed: Sequence[Use]) -> JointRuling:
        """Where not all of it is allowed, and why."""
        started = self._started(profile)
        denied = [
            (domain, operation, topic)
            for domain, _usable in started
            for operation, topic in needed
            if not self._held(profile, operation)[domain] >> self._points[topic, ""] & 1
        ]
        domain, operation, topic = denied[0]
        channel = self._channels.of_point(domain, self._points[topic, ""])
        which = f"{operation.value} {topic}: " if len(needed) > 1 else ""
        where = dict.fromkeys(domain for domain, _operation, _topic in denied)
        return JointRuling(
            ruling=Truth.NO,
            domains="" if len(where) == len(started) else ", ".join(self._label(domain) for domain in where),
            location=self._local.step(self._enclave, profile, operation, channel).by.location,
            explain=lambda: which + self._local.decide(self._enclave, profile, operation, channel, (topic, "")).reason,
        )

    def _always(self, profile: Profile, operation: Operation) -> int:
        """The points on which it is allowed in every domain in which the enclave starts."""
        return reduce(and_, self._held(profile, operation).values(), (1 << len(self._points)) - 1)

    def _ever(self, profile: Profile, operation: Operation) -> int:
        """The points on which it is allowed in some domain in which the enclave certainly starts."""
        held = self._held(profile, operation)
        return union(held[domain] for domain, usable in self._started(profile) if usable.must)

    def _allowed(self, profile: Profile, operation: Operation) -> Mapping[int, int]:
        """By domain: the points on which the operation is allowed, as a bit set."""
        channels = self._local.allowed(self._enclave, profile, operation)
        domains = (domain for domain, _usable in self._started(profile))
        return {domain: Window(self._channels, domain, len(self._points)).of(channels) for domain in domains}

    def _label(self, domain: int) -> str:
        return self._channels.domains[self._channels.domain_class(domain)].label


def listed_usages(enclave: Enclave, names: Iterable[str], deciders: Deciders) -> Mapping[str, tuple[Action, ...]]:
    """What an enclave is granted to do with ROS names by those names, under every profile under which it starts.

    Expressions with wildcards do not count: they say nothing of what a node does.
    """
    listed = listed_uses(enclave)
    wanted = {(name, action): dds_channels(action.value, name) for name in names for action in Action}
    rights = PointRights(enclave, ((topic, "") for channels in wanted.values() for _, topic in channels), deciders)
    found: dict[str, tuple[Action, ...]] = {}
    for (name, action), channels in wanted.items():
        granted = found.setdefault(name, ())
        if listed.issuperset(channels):
            rulings = {rights.verdict(profile, channels).ruling for profile, _names in deciders.kinds}
            found[name] = (*granted, action) if rulings - {None} == {Truth.YES} else granted
    return found


def listed_uses(enclave: Enclave) -> frozenset[Use]:
    """What the allow rules of an enclave's grants list, names and expressions, in any domain and partition."""
    return frozenset(
        (criterion.operation, topic.text)
        for grant in enclave.grants
        for criterion in grant.allowed
        for topic in criterion.topics
    )


# Which nodes there are and how they are wired, as graphs, launch files and policies say it, in one system.


class WiredNode(Struct, frozen=True, kw_only=True):
    """A node of the enclave (its path), and what it is there to do; `denied`: what a policy takes away from that."""

    enclave: str
    name: str
    location: Location
    uses: frozenset[Use]
    denied: frozenset[Use]


def wiring(intents: Sequence[Intent], kind: LayoutKind) -> tuple[WiredNode, ...]:
    """The nodes of the files, in their order, one for each name and enclave.

    What every node does is among it, where a graph or a launch file does not say so. Names of which a launch file does
    not say how they are used are left out.
    """
    places: dict[tuple[str, str], Location] = {}
    uses: dict[tuple[str, str], set[Use]] = {}
    denied: dict[tuple[str, str], set[Use]] = {}
    for intent in in_layout(intents, kind):
        for node in intent.nodes:
            key = (node.enclave, node.name)
            places.setdefault(key, node.location)
            uses.setdefault(key, set()).update(DISCOVERY)
        for right in intent.rights:
            key = (right.enclave, right.node)
            places.setdefault(key, right.location)
            points = dds_expressions(right.action.value, right.name)
            (uses if right.allow else denied).setdefault(key, set()).update(points)
        for node, action, name in missing_usual(intent, frozenset({Usual.ALWAYS})):
            if intent.origin is not Origin.POLICY:
                uses[node.enclave, node.name].update(dds_channels(action.value, name))
    return tuple(
        WiredNode(
            enclave=enclave,
            name=name,
            location=place,
            uses=frozenset(uses.get((enclave, name), ())),
            denied=frozenset(denied.get((enclave, name), ())),
        )
        for (enclave, name), place in places.items()
    )


def wiring_regions(nodes: Iterable[WiredNode]) -> tuple[ReadRegion, ...]:
    """The topics that nodes use: they take part in the classes, so that wires are exact."""
    points = {topic: None for node in nodes for _operation, topic in sorted({*node.uses, *node.denied})}
    return tuple(region_of((topic,)) for topic in points)


def with_nodes(
    systems: Sequence[System], nodes: Sequence[WiredNode], channels: Channels, keystore: Keystore
) -> tuple[System, ...]:
    """The systems with the nodes as facts. Nodes use the default partition, and every domain that is governed."""
    if not nodes:
        return tuple(systems)
    known = {enclave.path for enclave in keystore.enclaves}
    by_topic = {topic: _in_default_partition(channels, topic) for topic in _topics(nodes)}
    return tuple(replace(system, nodes=tuple(_atoms(system, nodes, by_topic, known))) for system in systems)


def _topics(nodes: Iterable[WiredNode]) -> set[str]:
    return {topic for node in nodes for _operation, topic in (*node.uses, *node.denied)}


def _in_default_partition(channels: Channels, topic: str) -> frozenset[int]:
    """The channels of the topic whose class of partitions has the default one: it is the witness of such a class."""
    return frozenset(n for n in channels.regions[region_of((topic,))] if channels.channels[n].partition == "")


def _atoms(
    system: System, nodes: Iterable[WiredNode], by_topic: Mapping[str, frozenset[int]], known: set[str]
) -> Iterator[NodeAtom]:
    places = {enclave.label: n for n, enclave in enumerate(system.enclaves) if enclave.label in known}

    def channels(node: WiredNode, operation: Operation) -> frozenset[int]:
        used = frozenset[int]().union(*(by_topic[topic] for each, topic in node.uses if each is operation))
        return used.difference(*(by_topic[topic] for each, topic in node.denied if each is operation))

    for node in nodes:
        yield NodeAtom(
            label=node.name or node.enclave,
            location=node.location,
            enclave=places.get(node.enclave),
            publishes=channels(node, Operation.PUBLISH),
            subscribes=channels(node, Operation.SUBSCRIBE),
        )
