"""What an implementation allows, as values that can be compared: for certain, and perhaps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime

from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import Bounds
from keystore_audit.model.formal.effective import EffectiveRights
from keystore_audit.model.formal.system import Reading, System
from keystore_audit.model.participants.doubt import enclave_doubts
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.participants.views import Kind
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import Profile


def differing(values: Sequence[Bounds]) -> int:
    """What is for certain in one of the sets and for certain not in another."""
    somewhere, everywhere = 0, -1
    for value in values:
        somewhere |= value.must
        everywhere &= value.may
    return somewhere & ~everywhere


def attributed(stages: Sequence[Bounds], wanted: int) -> Iterator[tuple[int, bool, int]]:
    """To which stage each member of `wanted` is due that the first and the last stage decide differently.

    (stage, whether the first one allows, members): the earliest stage that decides as the last one does.
    """
    allowed = stages[0].must & ~stages[-1].may & wanted
    denied = stages[-1].must & ~stages[0].may & wanted
    for number, stage in enumerate(stages):
        if now := allowed & ~stage.may:
            allowed &= ~now
            yield number, True, now
        if now := denied & stage.must:
            denied &= ~now
            yield number, False, now


class LocalValues:
    """What implementations decide about their own participants, endpoints and topics.

    `domain`: the one in which enclaves are to start; None: some domain of 0..232.
    """

    def __init__(self, accesses: AccessViews, channels: Channels, at: datetime, domain: int | None) -> None:
        self._accesses = accesses
        self._channels = channels
        self._at = at
        self._anywhere = Usabilities(domain, accesses)
        self._members = [channels.bits_in(domain) for domain in range(len(channels.domains))]
        self._decided: dict[tuple[str, str, Operation], Bounds] = {}
        self.rights = LocalRights(accesses, channels, at)

    def starts(self, enclave: Enclave, profile: Profile) -> Bounds:
        """Whether a participant is created, as a set of one member."""
        usable = self._anywhere.of(enclave, self._at, profile).usable
        return Bounds(int(usable is True), int(usable is not False))

    def decided(self, enclave: Enclave, profile: Profile, operation: Operation) -> Bounds:
        """The channels on which the operation is allowed to participants that are created there."""
        key = enclave.files.directory, profile.name, operation
        if key not in self._decided:
            row = self._accesses.row(profile.access)
            if enclave_doubts(enclave, profile.trust, row, self._accesses):
                self._decided[key] = Bounds(0, sum(self._members))
            else:
                allowed = self.rights.allowed(enclave, profile, operation)
                self._decided[key] = Bounds.exact(allowed & self._where_it_starts(enclave, profile, allowed))
        return self._decided[key]

    def starts_in(self, enclave: Enclave, profile: Profile, channels: int) -> int:
        """Those of the channels in whose domain a participant is created."""
        return channels & self._where_it_starts(enclave, profile, channels)

    def _where_it_starts(self, enclave: Enclave, profile: Profile, wanted: int) -> int:
        """The channels of domains in which a participant is created; only domains with `wanted` channels are asked."""
        found = 0
        for number, members in enumerate(self._members):
            if members & wanted:
                domain = self._channels.domains[number].intervals[0][0]
                if self._anywhere.in_domain(domain).of(enclave, self._at, profile).usable is not False:
                    found |= members
        return found


class PeerValues:
    """What peers accept from enclaves, each profile by its access row; `systems`: by the profile's name."""

    def __init__(self, builder: SystemBuilder, profiles: Iterable[Profile], accesses: AccessViews) -> None:
        self.systems: dict[str, System] = {}
        self._row: dict[str, str] = {}
        systems: list[System] = []
        by_row: dict[object, str] = {}
        for profile in profiles:
            row = accesses.row(profile.access)
            self._row[profile.name] = by_row.setdefault(row, profile.name)
            if by_row[row] != profile.name:
                continue
            kind = Kind(profile.trust, row)
            may = builder.build(kind, profiles=(profile.name,), reading=Reading.MAY)
            self.systems[profile.name] = may
            systems.append(may)
            if may.has_doubt:
                systems.append(builder.build(kind, profiles=(profile.name,), reading=Reading.MUST))
        self._effective = EffectiveRights(systems)

    def accepted(self, path: str, profile: Profile, operation: Operation) -> Bounds:
        """The channels on which some peer accepts the operation from the enclave."""
        return self._effective.accepted(path, self._row[profile.name], operation)

    def system(self, profile: Profile) -> System:
        """The facts behind it, what could not be read counting as anything."""
        return self.systems[self._row[profile.name]]
