"""What a pair is made of, stated as its difference from two enclaves that may do everything."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.typed import Operation
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe
from tests.oracles.vendors.pairs import Meeting, Seen, Side
from tests.oracles.vendors.pairs_material import EVERYTHING, Authorities, Enclave, governance, grant, permissions

CAS = Authorities.split()
"""Those of every plain pair. Under a shared CA, vendors that do not pin the signer accept whatever an enclave signs."""

FIRST = CAS.issue("/first")
SECOND = CAS.issue("/second")

KEYSTORE = "keystore"
ENDPOINTS = (publish("a"), subscribe("a"))
MAY_ALL = {name: CAS.sign(permissions(grant(f"CN=/{name}", EVERYTHING))) for name in ("first", "second")}
GOVERNANCE = CAS.sign(governance())


def plain(name: str) -> Enclave:
    """The enclave /first or /second, with sros2's governance and a grant for everything."""
    identity = FIRST if name == "first" else SECOND
    return Enclave(authorities=CAS, identity=identity, governance=GOVERNANCE, permissions=MAY_ALL[name])


PLAIN_FIRST = plain("first")
PLAIN_SECOND = plain("second")


class Case(Struct, frozen=True, kw_only=True):
    """Two sides. `second` None is a peer without security; `presented`: a signed document, which a compromised second
    side presents instead of its own. `endpoints` are the second side's; the first has the other end of each.
    """

    title: str
    first: Enclave = PLAIN_FIRST
    second: Enclave | None = PLAIN_SECOND
    presented: bytes | None = None
    endpoints: tuple[Endpoint, ...] = ENDPOINTS
    domains: tuple[int, int] = (0, 0)

    @property
    def peers_agree(self) -> bool:
        """Whether the sides differ in identity and permissions alone.

        Then what the first side accepts is what any peer does. Else an attacker may declare what the first side has,
        and the second one is a peer as well, of another mind.
        """
        second = self.second
        if second is None or self.domains[0] != self.domains[1]:
            return False
        same = second.governance == self.first.governance and second.authorities == self.first.authorities == CAS
        alike = second.permissions_ca == self.first.permissions_ca
        return same and alike and second.key is None and self.first.crl is None and second.crl is None

    def sides(self, directory: Path) -> tuple[Side, Side]:
        """The two, with a keystore of them in `directory`, where the second enclave has what it presents."""
        first = Side(
            enclave=self.first.write(directory / KEYSTORE / "enclaves/first"),
            endpoints=tuple(map(other_end, self.endpoints)),
            domain=self.domains[0],
        )
        if self.second is None:
            return first, Side(enclave=None, endpoints=self.endpoints, domain=self.domains[1])
        place = directory / KEYSTORE / "enclaves/second"
        if self.presented is None:
            return first, Side(enclave=self.second.write(place), endpoints=self.endpoints, domain=self.domains[1])
        replace(self.second, permissions=self.presented).write(place)
        return first, Side(
            enclave=self.second.write(directory / "started"),
            endpoints=self.endpoints,
            domain=self.domains[1],
            compromised=True,
            presented=place / "permissions.p7s",
        )


def other_end(endpoint: Endpoint) -> Endpoint:
    """A reader for a writer and the other way round; in partition p where the one names a pattern, which p matches."""
    partitions = tuple("p" if set(name) & set("*?[") else name for name in endpoint.partitions)
    other = Operation.SUBSCRIBE if endpoint.operation is Operation.PUBLISH else Operation.PUBLISH
    return Endpoint(operation=other, topic=endpoint.topic, partitions=partitions)


def outcome(meeting: Meeting, case: Case) -> str:
    """What became of it, in a few letters.

    "first" or "second": that participant was not created. Else for each endpoint of the second side: `+` samples
    arrived; `~` the first side matched it, and none arrived; `-` it was not created; `=` its other end was not created;
    `.` none of that.
    """
    first, second = meeting.sides
    if first is None or second is None:
        return "first" if first is None else "second"
    pairs = zip(case.endpoints, first, second, strict=False)  # the controls come after them
    return "".join(_letter(endpoint, mine, its) for endpoint, mine, its in pairs)


def _letter(endpoint: Endpoint, mine: Seen, its: Seen) -> str:
    if not its.created:
        return "-"
    if not mine.created:
        return "="
    if (mine if endpoint.operation is Operation.PUBLISH else its).heard:
        return "+"
    return "~" if mine.matched else "."
