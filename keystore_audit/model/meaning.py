"""What a keystore means: the systems both engines decide, who can start, and what stays unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from msgspec import Struct, field

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.question import Doubt, Usability

if TYPE_CHECKING:  # `can` has no part in either
    from keystore_audit.model.anomalies.anomaly import Anomaly
    from keystore_audit.model.divergence.substitution import Cause
    from keystore_audit.model.formal.system import System
    from keystore_audit.model.ros.patterns import RosPatterns


class UngovernedTopics(Struct, frozen=True, kw_only=True):
    """Topics of a governed domain that no topic rule matches; `witness` is one, `domains` for people.

    `profiles`: those that read it so.
    """

    location: Location
    domains: str
    witness: str
    profiles: tuple[str, ...] = ()


class Example(Struct, frozen=True, kw_only=True):
    """One right that some of the chosen profiles give and others do not.

    `decided`: they decide about their own endpoints; False: they decide about what they accept from a peer.
    `allowing`, `denying`: canonical names; a profile for which it is unknown is in neither.
    """

    enclave: str
    operation: Operation
    topic: str
    partition: str
    domain: int
    decided: bool
    allowing: tuple[str, ...]
    denying: tuple[str, ...]


class Divergence(Struct, frozen=True, kw_only=True):
    """Chosen profiles do different things with one line of a document.

    `location`: the line that decides differently, `other`: the one that decides where it does not. `escalates`:
    somewhere a chosen profile allows what the specification denies; `restricts`: somewhere one denies what it allows.
    `ros`: whether that concerns names that ROS 2 can produce, or the start. `example`: None where only the start
    differs. `starting`, `refusing`: chosen profiles that create a participant of some of the `enclaves` (paths), and
    that do not; empty where that does not differ. `deviating`: profiles that do otherwise than the specification.
    """

    cause: Cause
    location: Location
    other: Location | None
    enclaves: tuple[str, ...]
    escalates: bool
    restricts: bool
    ros: bool
    example: Example | None
    starting: tuple[str, ...] = ()
    refusing: tuple[str, ...] = ()
    deviating: frozenset[str] = frozenset()


class Meaning(Struct, frozen=True, kw_only=True):
    """The normalised model of a keystore at one instant.

    `systems`: one for each kind of implementation among the chosen profiles and each reading. Only MAY where there is
    no doubt, since MUST is then equal. `usability`: by (enclave directory, canonical profile name).
    `over_budget`: why topic classes could not be computed; there are no systems then. `idle`: sentences that say
    which properties hold because there is nothing to protect. `divergences`: what the profiles decide differently;
    empty where there are no systems. `anomalies`: what is odd about rules, by the place of the document; likewise.
    `ros`: what permissions mean to ROS 2 nodes; None where there are no systems.
    """

    systems: tuple[System, ...]
    usability: Mapping[tuple[str, str], Usability]
    doubts: tuple[Doubt, ...]
    ungoverned: tuple[UngovernedTopics, ...]
    over_budget: str | None
    idle: tuple[str, ...] = ()
    divergences: tuple[Divergence, ...] = ()
    anomalies: Mapping[str, tuple[Anomaly, ...]] = field(default_factory=dict)
    ros: RosPatterns | None = None
