"""The channels of one domain as the places of names in a table."""

from __future__ import annotations

from keystore_audit.model.channels import Channels
from keystore_audit.model.domains import contains
from keystore_audit.model.safeguard import Safeguard, safeguards
from keystore_audit.model.system import System


class Window:
    """The channels of one domain (0..232), name by name. `channels` were made for `names` points."""

    def __init__(self, channels: Channels, domain: int, names: int) -> None:
        self._start = channels.of_point(domain, 0)
        self.governed = channels.of_point(domain, names - 1) - self._start == names - 1
        self._domain = next(n for n, atom in enumerate(channels.domains) if contains(atom.intervals, domain))
        self._names = names
        self.all = (1 << names) - 1

    def of(self, channels: int) -> int:
        """The names among the channels; an ungoverned domain has one channel for all names."""
        if self.governed:
            return channels >> self._start & self.all
        return self.all if channels >> self._start & 1 else 0

    def safeguards(self, system: System) -> tuple[tuple[Safeguard, ...], ...]:
        """What protects each name."""
        if self.governed:
            return safeguards(system, range(self._start, self._start + self._names), self._domain)
        return safeguards(system, range(self._start, self._start + 1), self._domain) * self._names
