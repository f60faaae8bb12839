"""Where implementations decide differently about one keystore, and which line of which document is why.

Compared are decisions (`model.decision`, with whether a participant starts there), what peers accept
(`model.formal.rights`) and whether an enclave starts at all. They are compared over every class of names, partitions
and domains. Whom an implementation trusts is left aside (`divergence.substitution`): that has rules of its own. So is
what is unknown to one of the two: it leaves the audit incomplete.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import datetime
from functools import partial
from itertools import islice
from typing import Final

from msgspec import Struct, field

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import GovernanceFile, Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.divergence.lines import DecidingLines, LocalValues, Part, PeerValues, attributed, differing
from keystore_audit.model.divergence.substitution import (
    PARTITION_CAUSES,
    Cause,
    PlainPairs,
    Reader,
    Stages,
    odd_documents,
)
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.inventory import Typed, documents_of
from keystore_audit.model.meaning import Divergence, Example
from keystore_audit.model.names import AMBIENT_TOPICS
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import Profile
from keystore_audit.truth import Bounds

MAX_WITNESSES: Final = 64
"""Classes of one difference among which a witness that people can read is looked for."""


class _Found(Struct):
    """What is known so far about one line."""

    other: Location | None
    enclaves: dict[str, None] = field(default_factory=dict)
    escalates: bool = False
    restricts: bool = False
    ros: bool = False
    example: Example | None = None
    rank: tuple[object, ...] = ()
    starting: tuple[str, ...] = ()
    refusing: tuple[str, ...] = ()
    deviating: set[str] = field(default_factory=set)


def divergences(
    keystore: Keystore, profiles: Sequence[Profile], at: datetime, accesses: AccessViews, domain: int | None
) -> tuple[Divergence, ...]:
    """Every line about which two of the profiles decide differently at `at` (aware UTC), by place and cause.

    `domain`: the one in which enclaves are to start; None: some domain of 0..232. Classes over budget give one
    divergence of cause UNDECIDED.
    """
    readers = Stages(accesses).readers(profiles)
    if len(readers) < 2:
        return ()
    files = [document.file for document in documents_of(keystore) if document.file is not None]
    odd = odd_documents(files, profiles, accesses)
    plain = PlainPairs(profiles, accesses, domain)
    suspects = [
        enclave
        for enclave in keystore.enclaves
        if not odd.isdisjoint((enclave.governance, enclave.permissions)) or not plain.has(enclave)
    ]
    if not suspects and not odd:
        return ()
    stages = {stage.profile.name: stage.profile for reader in readers for stage in reader.stages}
    try:
        builder = SystemBuilder(keystore, tuple(stages.values()), at, accesses, literal=True)
    except BudgetExceeded:
        return (_undecided(odd, keystore),)
    local = LocalValues(accesses, builder.channels, at, domain)
    comparison = _Comparison(readers, builder.channels, DecidingLines(keystore, accesses, at, local))
    for enclave in suspects:
        comparison.starts(enclave, local)
        for operation in Operation:
            comparison.decisions(enclave, operation, local)
    if odd:
        peers = PeerValues(builder, stages.values(), accesses)
        for enclave in _presenting(keystore, odd):
            for operation in Operation:
                comparison.rights(enclave, operation, peers)
    return comparison.found()


def _presenting(keystore: Keystore, odd: Collection[Typed]) -> Iterator[Enclave]:
    """The enclaves whose rights with peers depend on one of the documents."""
    subjects = {subject for file in odd if isinstance(file, PermissionsFile) for subject in file.subjects}
    everybody = any(isinstance(file, GovernanceFile) for file in odd)
    for enclave in keystore.enclaves:
        certificate = enclave.identity
        if everybody or (certificate is not None and certificate.subject in subjects):
            yield enclave


def _undecided(odd: Collection[Typed], keystore: Keystore) -> Divergence:
    places = sorted(file.signed.file.place for file in odd)
    return Divergence(
        cause=Cause.UNDECIDED,
        location=Location(path=places[0] if places else keystore.enclaves[0].files.directory),
        other=None,
        enclaves=(),
        escalates=False,
        restricts=False,
        ros=True,
        example=None,
    )


class _Comparison:
    """The readers of one keystore, compared right by right; each line with its effects."""

    def __init__(self, readers: Sequence[Reader], channels: Channels, lines: DecidingLines) -> None:
        self._readers = readers
        self._channels = channels
        self._ros = bits(number for number, channel in enumerate(channels.channels) if channel.ros)
        self._lines = lines
        self._found: dict[tuple[str, int, Cause], _Found] = {}
        self._explained: dict[tuple[str, Operation, bool, tuple[str, ...]], int] = {}

    def starts(self, enclave: Enclave, local: LocalValues) -> None:
        """Compares whether the enclave starts."""
        values = [local.starts(enclave, reader.itself) for reader in self._readers]
        wanted = differing(values)
        for reader in self._readers if wanted else ():
            stages = [local.starts(enclave, stage.profile) for stage in reader.stages]
            for number, more, _one in attributed(stages, wanted):
                cured, before, after = _switched(reader, number)
                found = self._note(enclave, cured, self._lines.start(enclave, before, after), None, reader)
                found.escalates |= more
                found.restricts |= not more
                found.ros = True
                found.starting = self._names(value.must & 1 for value in values)
                found.refusing = self._names(~value.may & 1 for value in values)

    def decisions(self, enclave: Enclave, operation: Operation, local: LocalValues) -> None:
        """Compares the decisions about an operation of the enclave's own participants."""
        value, parts = partial(local.decided, enclave, operation), partial(self._lines.decided, enclave, operation)
        self._compare(enclave, operation, value, parts, decided=True)

    def rights(self, enclave: Enclave, operation: Operation, peers: PeerValues) -> None:
        """Compares what peers accept of an operation, except where a reader's own decisions already differ so."""
        value = partial(peers.accepted, enclave.path, operation)
        parts = partial(self._lines.accepted, peers, enclave.path, operation)
        self._compare(enclave, operation, value, parts, decided=False)

    def found(self) -> tuple[Divergence, ...]:
        """Every line with its cause."""
        return tuple(
            Divergence(
                cause=cause,
                location=Location(path=path, line=line or None),
                other=found.other,
                enclaves=tuple(found.enclaves),
                escalates=found.escalates,
                restricts=found.restricts,
                ros=found.ros,
                example=found.example,
                starting=found.starting,
                refusing=found.refusing,
                deviating=frozenset(found.deviating),
            )
            for (path, line, cause), found in sorted(self._found.items())
        )

    def _compare(
        self,
        enclave: Enclave,
        operation: Operation,
        value: Callable[[Profile], Bounds],
        parts: Callable[[Profile, Profile, int], Iterator[Part]],
        *,
        decided: bool,
    ) -> None:
        """Notes every line that a difference between the readers is due to."""
        values = [value(reader.itself) for reader in self._readers]
        wanted = left = differing(values)
        for reader, itself in zip(self._readers, values, strict=True) if wanted else ():
            if not differing((itself, value(reader.stages[-1].profile))) & wanted:
                continue
            for number, more, channels in attributed([value(stage.profile) for stage in reader.stages], wanted):
                cured, before, after = _switched(reader, number)
                left &= ~channels
                key = enclave.files.directory, operation, more, reader.names
                explained = self._explained.get(key, 0)
                rest = channels if decided else channels & ~explained
                if decided:
                    self._explained[key] = explained | channels
                for part in parts(before, after, rest) if rest else ():
                    rest &= ~part.channels
                    cause = part.cause if cured in PARTITION_CAUSES and part.cause is not None else cured
                    found = self._note(enclave, cause, part.location, part.other, reader)
                    self._add(found, enclave, operation, values, part.channels, more=more, decided=decided)
                if rest:
                    found = self._note(enclave, cured, self._lines.start(enclave, before, after), None, reader)
                    self._add(found, enclave, operation, values, rest, more=more, decided=decided)
        if left:  # what is unknown to the specification
            first, last = self._readers[0], self._readers[-1]
            where = self._lines.start(enclave, first.itself, last.itself)
            found = self._note(enclave, Cause.OTHER, where, None, last)
            self._add(found, enclave, operation, values, left, more=True, decided=decided)

    def _note(
        self, enclave: Enclave, cause: Cause, location: Location, other: Location | None, reader: Reader
    ) -> _Found:
        found = self._found.setdefault((location.path, location.line or 0, cause), _Found(other=other))
        found.enclaves[enclave.path] = None
        found.deviating.update(reader.names)
        return found

    def _add(
        self,
        found: _Found,
        enclave: Enclave,
        operation: Operation,
        values: Sequence[Bounds],
        channels: int,
        *,
        more: bool,
        decided: bool,
    ) -> None:
        """Adds channels with the best example among them: one that is worse, then one that people know."""
        found.escalates |= more
        found.restricts |= not more
        found.ros |= bool(channels & self._ros)
        for number in islice(members(channels & self._ros or channels), MAX_WITNESSES):
            channel = self._channels.channels[number]
            known = channel.ros and channel.topic not in AMBIENT_TOPICS
            rank = (not more, not decided, operation is Operation.RELAY, not known, channel.partition, channel.topic)
            if found.example is None or rank < found.rank:
                found.rank = rank
                found.example = Example(
                    enclave=enclave.path,
                    operation=operation,
                    topic=channel.topic,
                    partition=channel.partition,
                    domain=self._channels.domains[channel.domain].intervals[0][0],
                    decided=decided,
                    allowing=self._names(value.must >> number & 1 for value in values),
                    denying=self._names(~value.may >> number & 1 for value in values),
                )

    def _names(self, chosen: Iterable[int]) -> tuple[str, ...]:
        """The profiles of the readers that are chosen."""
        return tuple(name for reader, one in zip(self._readers, chosen, strict=True) if one for name in reader.names)


def _switched(reader: Reader, number: int) -> tuple[Cause, Profile, Profile]:
    """What the stage is cured of, and the profile before and after that."""
    stage = reader.stages[number]
    return stage.cured or Cause.OTHER, reader.stages[number - 1].profile, stage.profile
