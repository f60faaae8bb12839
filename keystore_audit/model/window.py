"""The channels of one domain as the places of names in a table."""

from __future__ import annotations

from keystore_audit.model.channels import Channels
from keystore_audit.model.formal.rights import Safeguard, safeguards
from keystore_audit.model.formal.system import System


class Window:
    """The channels of one domain (0..232), name by name. `channels` were made for `names` points."""

    def __init__(self, channels: Channels, domain: int, names: int) -> None:
        self._domain = channels.domain_class(domain)
        self._here = channels.in_domain[self._domain]
        self.governed = len(self._here) == names
        self._names = names
        self.all = (1 << names) - 1

    def of(self, channels: int) -> int:
        """The names among the channels; an ungoverned domain has one channel for all names."""
        if self.governed:
            return channels >> self._here.start & self.all
        return self.all if channels >> self._here.start & 1 else 0

    def safeguards(self, system: System) -> tuple[tuple[Safeguard, ...], ...]:
        """What protects each name."""
        found = safeguards(system, self._here, self._domain)
        return found if self.governed else found * self._names
