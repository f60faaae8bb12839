"""What permissions mean to ROS 2 nodes: services and actions that are whole or half, and who is within whose reach."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.permissions import PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.system import Reading, System
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.ros.action_topics import ActionPattern, action_patterns
from keystore_audit.model.ros.halves import Halves, halves
from keystore_audit.model.ros.holders import Holder, Holders
from keystore_audit.model.ros.services import Reach, Rivals, Services
from keystore_audit.model.ros.usual_topics import Undescribed, Unusual, since_iron, undescribed, unusual
from keystore_audit.profiles import VARIANTS, Matcher, Profile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from keystore_audit.model.question import Usability


_BEFORE_FOXY: Final = frozenset((LayoutKind.FLAT, LayoutKind.ARDENT))


class RosPatterns(Struct, frozen=True, kw_only=True):
    """`reaches`, `rivals`: each with the chosen profiles that it holds for, empty for all.

    `unknown`: why services could not be compared. `actions`: patterns for topics that take in actions. `unusual`:
    enclaves that lack some of what every node uses; `undescribed`: those that lack what nodes use since Iron, where
    a distribution since then is asked about.
    """

    halves: Halves
    reaches: tuple[tuple[Reach, tuple[str, ...]], ...] = ()
    rivals: tuple[tuple[Rivals, tuple[str, ...]], ...] = ()
    unknown: str | None = None
    actions: tuple[ActionPattern, ...] = ()
    unusual: tuple[Unusual, ...] = ()
    undescribed: tuple[Undescribed, ...] = ()


def ros_patterns(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    systems: Sequence[System],
    usability: Mapping[tuple[str, str], Usability],
) -> RosPatterns:
    """Everything at `at` (aware UTC); `systems` are those of the profiles, `usability` by (directory, profile)."""
    files = {
        document.place: document.file
        for document in documents_of(keystore)
        if isinstance(document.file, PermissionsFile)
    }
    reaches: dict[Reach, list[str]] = {}
    rivals: dict[Rivals, list[str]] = {}
    unknown = None
    holders = Holders(files, accesses)
    known: dict[tuple[tuple[Holder, ...], Matcher, tuple[int, ...]], tuple[tuple[Reach, ...], tuple[Rivals, ...]]] = {}
    names = {profile.name for profile in profiles}
    for system in systems:
        if system.reading is not Reading.MAY:
            continue
        row = accesses.row(VARIANTS[system.profiles[0]].access)
        applied = {system.realms[each.realm].governance for each in system.enclaves if not each.at_large}
        governed = frozenset().union(*(each.domains for each in system.domain_rules if each.document in applied))
        domains = [system.domains[number].intervals[0][0] for number in sorted(governed)]
        key = holders.of(system, row), row.matcher, tuple(domains)
        try:
            if key not in known:
                services = Services(*key)
                known[key] = tuple(services.reaches()), tuple(services.rivals())
        except BudgetExceeded as exceeded:
            unknown = exceeded.message
            continue
        for reach in known[key][0]:
            reaches.setdefault(reach, []).extend(system.profiles)
        for group in known[key][1]:
            rivals.setdefault(group, []).extend(system.profiles)
    discovers = keystore.layout.kind not in _BEFORE_FOXY
    return RosPatterns(
        halves=halves(keystore, profiles, at, accesses, usability),
        reaches=tuple((reach, () if names <= {*held} else tuple(held)) for reach, held in reaches.items()),
        rivals=tuple((group, () if names <= {*held} else tuple(held)) for group, held in rivals.items()),
        unknown=unknown,
        actions=action_patterns(keystore.enclaves),
        unusual=tuple(unusual(keystore.enclaves, profiles, accesses, at, discovers=discovers)),
        undescribed=tuple(undescribed(keystore.enclaves)) if discovers and since_iron(profiles) else (),
    )
