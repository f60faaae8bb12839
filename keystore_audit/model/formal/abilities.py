"""What somebody can do to the channels of a realm."""

from __future__ import annotations

from msgspec import Struct

from keystore_audit.keystore.permissions import Operation


class Abilities(Struct, frozen=True, kw_only=True):
    """What an enclave can do, as sets of governed channels of the domains that it can join.

    `may_write`: peers take its samples as those of a permitted writer. `may_read`: peers give it their samples and
    keys. `may_relay`: peers give it the keys of their submessages. `overhears`: it reads the payload with the keys of
    any participant, or of a relay. `forges`: it holds every key that a writer's samples are authenticated with
    (DDS-Security 1.1, 9.5.3.3: the keys are symmetric, so whoever checks can make, unless the metadata kind
    authenticates the origin; that of messages does not, see docs/model.md).
    `unannounced`: peers ask it for no permissions there as long as it does not announce its endpoints as they are; it
    is in `overhears` and `forges`. `writes_at_all`, `reads_at_all`: with those of its endpoints, if it is of the realm,
    that honest peers refuse: they are there all the same.
    """

    may_write: int
    may_read: int
    may_relay: int
    overhears: int
    forges: int
    writes_at_all: int
    reads_at_all: int
    unannounced: int = 0

    def by_right(self, operation: Operation) -> int:
        """Channels on which peers let it do this."""
        if operation is Operation.PUBLISH:
            return self.may_write
        return self.may_read if operation is Operation.SUBSCRIBE else self.may_relay

    @property
    def knows(self) -> int:
        """Channels whose samples it learns, as a reader or from packets."""
        return self.may_read | self.overhears
