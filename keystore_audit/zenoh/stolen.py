"""What the holder of an enclave's private key can do in a network, without its file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.profiles import Release
from keystore_audit.zenoh.answers import plain
from keystore_audit.zenoh.flow import found, told
from keystore_audit.zenoh.participants import End, NetworkFlows, Question

HEARS: Final = "hear"
"""What somebody else has comes to the holder."""
REACHES: Final = "reach"
"""What the holder has comes to somebody else, while all others keep to their files."""


class Opened(Struct, frozen=True, kw_only=True):
    """One thing that it can do, or perhaps can (`certain`), by the `way` told. It is an operation on the keys of an
    expression, or HEARS or REACHES somebody. `places`: what lets it in, hop by hop.
    """

    does: str
    name: str
    certain: bool
    way: str
    places: tuple[Location, ...]


class StolenAnswer(Struct, frozen=True, kw_only=True):
    """What the key of enclave `who` opens, by release. `doubts`: why nothing is kept out for certain."""

    who: str
    at: datetime
    folder: str
    include_ambient: bool
    opened: Mapping[str, tuple[Opened, ...]]
    doubts: tuple[tuple[Location, str], ...]

    @property
    def beyond_itself(self) -> bool | None:
        """Whether it opens anything of somebody else's; None: unknown, as where more may be open than is known."""
        every = [each.certain for opened in self.opened.values() for each in opened]
        return None if self.doubts or not all(every) else bool(every)


def opened(
    flows: NetworkFlows, enclave: Enclave, rights: Iterable[tuple[str, str]], release: Release, *, ambient: bool
) -> Iterator[Opened]:
    """What its key opens under a release; `rights`: operations on keys that are asked about.

    Raises BudgetExceeded as `flow.found`.
    """
    for operation, key in rights:
        could = flows.rights.could(enclave, operation, key, release)
        if could.truth.may:
            places = tuple(filter(None, [could.location]))
            yield Opened(does=operation, name=plain(key), certain=could.truth.must, way="", places=places)
    own = End(participants=tuple(each for each in flows.participants if each.who is enclave))
    for other in (each for each in flows.participants if each.who not in (enclave, None)):
        their = End(participants=(other,))
        for does, source, target in ((HEARS, their, own), (REACHES, own, their)):
            asked = Question(source=source, target=target, attacking=own.participants, ambient=ambient)
            truth, hops = found(flows, asked, release)
            if truth.may:
                way, places = told(hops) if hops else "", tuple(filter(None, (hop.location for hop in hops)))
                yield Opened(does=does, name=other.label, certain=truth.must, way=way, places=places)
