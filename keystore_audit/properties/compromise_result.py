"""What stolen keys open, per profile: the answer of `flow --from-compromised`."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from enum import Enum

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.model.blast_radius import BlastRadius, Ground
from keystore_audit.properties.property import Status


class Stolen(str, Enum):
    """Whose private key it is."""

    ENCLAVE = "enclave"
    IDENTITY_CA = "identity-ca"
    PERMISSIONS_CA = "permissions-ca"


class ProfileRadius(Struct, frozen=True, kw_only=True):
    """The blast radius under one profile. `certain`: nothing of it depends on what could not be read."""

    radius: BlastRadius
    certain: bool


class KeyAnswer(Struct, frozen=True, kw_only=True):
    """Of one key. `name`: the enclave's path, or the subject of the authority; `location`: of its certificate.

    `with_an_enclave`: (permissions CA) of who holds the key of an enclave as well, whichever it is; else None.
    """

    stolen: Stolen
    name: str
    location: Location | None
    alone: Mapping[str, ProfileRadius]
    with_an_enclave: Mapping[str, ProfileRadius] | None


class CompromiseAnswer(Struct, frozen=True, kw_only=True):
    """What each key opens that `who` means: none where no such authority could be read.

    `enclaves`: how many there are. `doubts`: places of what could not be read, which an uncertain answer depends on.
    """

    who: str
    at: datetime
    include_ambient: bool
    ground: Ground
    enclaves: int
    keys: tuple[KeyAnswer, ...]
    doubts: tuple[Location, ...]

    @property
    def status(self) -> Status:
        """UNKNOWN where anything of it is uncertain; VIOLATED where a key opens anything of somebody else's."""
        found = [each for key in self.keys for part in (key.alone, key.with_an_enclave or {}) for each in part.values()]
        if not found or not all(each.certain for each in found):
            return Status.UNKNOWN
        return Status.VIOLATED if any(each.radius.beyond_itself for each in found) else Status.HOLDS
