"""What enclaves let themselves do on names known beforehand, in every domain in which they start.

One enclave at a time, over the expressions of its own documents: what others say does not decide what it does.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property

from keystore_audit.findings import Location
from keystore_audit.intent.intent import Action
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, Point, document_channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.domains import contains
from keystore_audit.model.names import dds_channels
from keystore_audit.model.observed_needs import Channel
from keystore_audit.model.permission import bits
from keystore_audit.model.profiles import Profile
from keystore_audit.model.question import Ruling
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.usability import Usabilities


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What one kind of implementation says to channels all of which are needed.

    `ruling`: ALLOW in every domain in which it starts, DENY in one of them, UNKNOWN; None where it starts in none.
    `domains`: where it denies, in words, "" for everywhere. `reason`: a sentence without its full stop; `location`:
    the line that decides.
    """

    ruling: Ruling | None
    domains: str = ""
    reason: str = ""
    location: Location | None = None


_NOWHERE = Verdict(ruling=None)
_ALLOWED = Verdict(ruling=Ruling.ALLOW)


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
        self.rows = tuple(dict.fromkeys(accesses.row(profile.access) for profile in profiles))
        kind_of = Usabilities(None, accesses).kind
        kinds: dict[object, list[Profile]] = {}
        for profile in profiles:
            kinds.setdefault((kind_of(profile), profile.access.matches_octets), []).append(profile)
        self.kinds: tuple[tuple[Profile, tuple[str, ...]], ...] = tuple(
            (alike[0], tuple(profile.name for profile in alike)) for alike in kinds.values()
        )
        """One profile of each kind, and the names of all."""
        self._usabilities: dict[int, Usabilities] = {}

    def usable(self, enclave: Enclave, domain: int, profile: Profile) -> bool | None:
        """Whether a participant of the enclave is created there, None where that cannot be told."""
        usabilities = self._usabilities.setdefault(domain, Usabilities(domain, self.accesses))
        return usabilities.of(enclave, self.at, profile).usable


class OwnRights:
    """The rights of one enclave on `points`, topics with their partitions."""

    def __init__(self, enclave: Enclave, points: Iterable[Point], deciders: Deciders) -> None:
        self._enclave = enclave
        self._deciders = deciders
        self._points = {point: number for number, point in enumerate(dict.fromkeys(points))}
        self._channels = self._of_own_documents(tuple(self._points))
        self._local = LocalRights(deciders.accesses, self._channels, deciders.at)
        self._allowed: dict[tuple[str, Operation], int] = {}
        self._started: dict[str, list[tuple[int, bool | None]]] = {}

    def verdict(self, profile: Profile, needed: Sequence[Channel]) -> Verdict:
        """Whether all of it may be done in the default partition."""
        started = self.started(profile)
        if not started:
            return _NOWHERE
        unclear = self._unclear(profile, needed, started)
        if unclear is not None:
            return Verdict(ruling=Ruling.UNKNOWN, reason=unclear)
        denied = [(domain, self._denied(profile, needed, domain)) for domain, _usable in started]
        where = [(domain, channels) for domain, channels in denied if channels]
        if not where:
            return _ALLOWED
        domain, channels = where[0]
        operation, topic = channels[0]
        decision = self._local.decide(self._enclave, profile, operation, self._channel(domain, (topic, "")))
        which = f"{operation.value} {topic}: " if len(needed) > 1 else ""
        labels = [self._label(number) for number, _channels in where]
        return Verdict(
            ruling=Ruling.DENY,
            domains="" if len(where) == len(started) else ", ".join(dict.fromkeys(labels)),
            reason=which + decision.reason,
            location=decision.location,
        )

    def allows(self, profile: Profile, operation: Operation, point: Point) -> bool:
        """Whether it is certainly allowed in some domain in which the enclave starts."""
        return any(
            usable and self._bits(profile, operation) >> self._channel(domain, point) & 1
            for domain, usable in self.started(profile)
        )

    def started(self, profile: Profile) -> Sequence[tuple[int, bool | None]]:
        """The domains, one of each class, in which the enclave starts, or (None) may start for all we know."""
        if profile.name not in self._started:
            deciders = self._deciders
            domains = self._governed(profile) if deciders.domain is None else [deciders.domain]
            asked = ((domain, deciders.usable(self._enclave, domain, profile)) for domain in domains)
            self._started[profile.name] = [(domain, usable) for domain, usable in asked if usable is not False]
        return self._started[profile.name]

    def grant(self, profile: Profile) -> ReadGrant | None:
        """The grant that decides."""
        return self._local.grant(self._enclave, profile)

    def endless(self, profile: Profile, operation: Operation) -> tuple[str, Location] | None:
        """A name among infinitely many that the grant allows in some domain in which the enclave starts; and the line.

        Raises errors.BudgetExceeded where the classes of its expressions are too many.
        """
        channels, local = self._classes
        here = bits(
            number
            for number, channel in enumerate(channels.channels)
            if channel.infinite
            and any(
                usable and contains(channels.domains[channel.domain].intervals, domain)
                for domain, usable in self.started(profile)
            )
        )
        place = self._enclave.permissions.signed.file.place if self._enclave.permissions else None
        for step in local.steps(self._enclave, profile, operation):
            found = step.channels & here
            here &= ~step.channels
            location = step.decision.location
            if found and step.decision.allow and location is not None and location.path == place:
                ros = [n for n, channel in enumerate(channels.channels) if found >> n & 1 and channel.ros]
                number = ros[0] if ros else found.bit_length() - 1
                return channels.channels[number].topic, location
        return None

    @cached_property
    def _classes(self) -> tuple[Channels, LocalRights]:
        """All names, in classes."""
        channels = self._of_own_documents(None)
        return channels, LocalRights(self._deciders.accesses, channels, self._deciders.at)

    def _of_own_documents(self, points: Sequence[Point] | None) -> Channels:
        deciders = self._deciders
        files = [file for file in (self._enclave.governance, self._enclave.permissions) if file is not None]
        read = {row: [deciders.accesses.read(file, row) for file in files] for row in deciders.rows}
        return document_channels(read, points)

    def _governed(self, profile: Profile) -> Iterator[int]:
        """The lowest domain of each class that the governance covers; 0 where it says nothing."""
        accesses, governance = self._deciders.accesses, self._enclave.governance
        read = accesses.read(governance, accesses.row(profile.access)) if governance is not None else None
        if read is None or read.domain_rules is None:
            yield 0
            return
        for atom in self._channels.domains:
            lowest = atom.intervals[0][0]
            if any(contains(rule.domains, lowest) for rule in read.domain_rules):
                yield lowest

    def _unclear(
        self, profile: Profile, needed: Sequence[Channel], started: Sequence[tuple[int, bool | None]]
    ) -> str | None:
        """Why it cannot be told."""
        if any(usable is None for _domain, usable in started):
            return "whether a participant starts cannot be told"
        said = (self._deciders.accesses.unclear_name(topic, "", profile) for _operation, topic in needed)
        return next((reason for reason in said if reason is not None), None)

    def _denied(self, profile: Profile, needed: Sequence[Channel], domain: int) -> list[Channel]:
        return [
            (operation, topic)
            for operation, topic in needed
            if not self._bits(profile, operation) >> self._channel(domain, (topic, "")) & 1
        ]

    def _bits(self, profile: Profile, operation: Operation) -> int:
        key = (profile.name, operation)
        if key not in self._allowed:
            self._allowed[key] = self._local.allowed(self._enclave, profile, operation)
        return self._allowed[key]

    def _channel(self, domain: int, point: Point) -> int:
        return self._channels.of_point(domain, self._points[point])

    def _label(self, domain: int) -> str:
        return next(atom.label for atom in self._channels.domains if contains(atom.intervals, domain))


def listed_usages(enclave: Enclave, name: str, deciders: Deciders) -> tuple[Action, ...]:
    """What an enclave is granted to do with a ROS name by that name, under every profile under which it starts.

    Expressions with wildcards do not count: they say nothing of what a node does.
    """
    permissions = enclave.permissions.permissions if enclave.permissions else None
    listed = {
        (criterion.operation, topic.text)
        for grant in (permissions.grants if permissions else ())
        for rule in grant.rules
        if rule.allow
        for criterion in rule.criteria
        for topic in criterion.topics
    }
    wanted = {action: dds_channels(action.value, name) for action in Action}
    rights = OwnRights(enclave, ((topic, "") for channels in wanted.values() for _, topic in channels), deciders)
    found = []
    for action, channels in wanted.items():
        rulings = {rights.verdict(profile, channels).ruling for profile, _names in deciders.kinds}
        if listed.issuperset(channels) and rulings - {None} == {Ruling.ALLOW}:
            found.append(action)
    return tuple(found)
