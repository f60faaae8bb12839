"""From evidence to meaning: the one entry to `keystore_audit.model`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.anomalies.find import anomalies
from keystore_audit.model.channels import ReadRegion
from keystore_audit.model.claims.claims import lasting, with_claims
from keystore_audit.model.claims.forwarding import with_determinism
from keystore_audit.model.claims.named import Declared, NamedPlace, place_regions, with_places
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.divergence.find import divergences
from keystore_audit.model.formal.attacker import enclaves_views
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions, protection
from keystore_audit.model.formal.system import ChannelAtom, System
from keystore_audit.model.meaning import Meaning, UngovernedTopics
from keystore_audit.model.names import DISCOVERY_TOPIC
from keystore_audit.model.participants.doubt import keystore_doubts
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Doubt, Usability
from keystore_audit.model.ros.patterns import ros_patterns
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import SPEC, Profile, at_work

if TYPE_CHECKING:  # an audit without a property in Alloy needs none of it
    from keystore_audit.model.intended.observed_rights import WiredNode


def interpret(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    usabilities: Usabilities,
    claims: Sequence[Claim] = (),
    places: Sequence[NamedPlace] = (),
    declared: Declared | None = None,
    nodes: Sequence[WiredNode] = (),
) -> Meaning:
    """The meaning of a keystore under the profiles at `at` (aware UTC).

    `usabilities`: of the domain in which enclaves are to start. `claims`: users' claims, `places`: users' names,
    `declared`: what nodes forward. Raises errors.UsageError for something that is not there. `nodes`: those that
    will use it.
    Documents with which topic classes are over budget count as unread. Where that is not enough (names of users alone),
    `systems` is empty and says why: nothing is decided then.
    """
    working = at_work(profiles)
    mixed = any(profile.others for profile in profiles)
    if mixed and declared is not None and declared.claims:
        raise UsageError(f"{declared.claims[0].place}: what is deterministic is not decided for a mixed fleet yet.")
    domain = usabilities.domain
    over_budget: str | None = None
    systems: tuple[System, ...] = ()
    apart: tuple[System, ...] = ()
    usability = usability_by_profile(keystore.enclaves, profiles, at, usabilities)
    declared = declared or Declared()
    named = (*place_regions(places), *declared.regions(), *_wires(nodes))
    try:
        systems, builder, accesses = claimed_systems(
            keystore, profiles, at, accesses, usabilities, usability, claims, named
        )
        systems = with_places(systems, places, builder.channels, keystore)
        if nodes:
            from keystore_audit.model.intended.observed_rights import with_nodes

            systems = with_nodes(systems, nodes, builder.channels, keystore)
        systems = with_determinism(systems, declared, builder.channels, keystore, usability, domain)
        # What is advised about services goes by implementations one by one.
        apart = SystemBuilder(keystore, working, at, accesses).systems() if mixed else systems
    except BudgetExceeded as exceeded:
        over_budget = exceeded.message
    return Meaning(
        systems=systems,
        usability=usability,
        doubts=_doubts(keystore, working, accesses),
        ungoverned=_ungoverned(systems),
        over_budget=over_budget,
        idle=_idle(systems),
        divergences=divergences(keystore, _beside_spec(working), at, accesses, domain) if systems else (),
        anomalies=anomalies(keystore, working, accesses) if systems else {},
        ros=ros_patterns(keystore, working, at, accesses, apart, usability) if systems else None,
    )


def claimed_systems(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    usabilities: Usabilities,
    usability: Mapping[tuple[str, str], Usability],
    claims: Sequence[Claim],
    named: Sequence[ReadRegion] = (),
    *,
    checked: bool = True,
) -> tuple[tuple[System, ...], SystemBuilder, AccessViews]:
    """The systems with the claims, who built them, and what documents say, as far as there is a budget for it.

    The rest as in `interpret`; `usability`: as `usability_by_profile` has it, `named` as `SystemBuilder`, `checked` as
    `with_claims`. Raises errors.BudgetExceeded, and errors.UsageError for a claim of what is not there.
    """
    if claims:
        _begins, excluded = accesses.exclusive_bounds(profiles)
        claims = lasting(claims, accesses.dates_in_local_time(profiles), excluded)
    builder, accesses = accesses.within_budget(
        lambda views: SystemBuilder(keystore, profiles, at, views, claims=claims, named=named)
    )
    systems = builder.systems()
    about = builder.channels, keystore, usability, usabilities, profiles
    systems = with_claims(systems, claims, *about, checked=checked)
    return systems, builder, accesses


def stated_systems(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    domain: int | None,
    claims: Sequence[Claim],
    *,
    checked: bool = True,
) -> tuple[System, ...]:
    """The systems with the claims, of a keystore that is only asked about these. As `claimed_systems`."""
    usabilities = Usabilities(domain, accesses)
    usability = usability_by_profile(keystore.enclaves, profiles, at, usabilities)
    about = keystore, profiles, at, accesses, usabilities, usability, claims
    return claimed_systems(*about, checked=checked)[0]


def _wires(nodes: Sequence[WiredNode]) -> tuple[ReadRegion, ...]:
    """The topics that nodes use."""
    if not nodes:
        return ()
    from keystore_audit.model.intended.observed_rights import wiring_regions

    return wiring_regions(nodes)


def _beside_spec(profiles: Sequence[Profile]) -> tuple[Profile, ...]:
    """The profiles, and the specification: what an implementation gives beyond a document has to be said too."""
    return tuple(profiles) if SPEC in profiles else (SPEC, *profiles)


def usability_by_profile(
    enclaves: Iterable[Enclave], profiles: Sequence[Profile], at: datetime, usabilities: Usabilities
) -> dict[tuple[str, str], Usability]:
    """Usability by (enclave directory, profile name): of what the enclave runs in the fleet on that profile."""
    found: dict[tuple[str, str], Usability] = {}
    rows = {usabilities.kind(profile): profile for profile in profiles}
    kinds = [(profile.name, usabilities.kind(profile)) for profile in profiles]
    for enclave in enclaves:
        by_row = {kind: usabilities.of(enclave, at, profile) for kind, profile in rows.items()}
        for name, kind in kinds:
            found[enclave.files.directory, name] = by_row[kind]
    return found


def _doubts(keystore: Keystore, profiles: Sequence[Profile], accesses: AccessViews) -> tuple[Doubt, ...]:
    """What any kind of implementation may act on although we could not read it."""
    kinds = grouped(profiles, lambda profile: (profile.trust, accesses.row(profile.access)))
    found: dict[tuple[str | None, Location], tuple[Doubt, list[Profile]]] = {}
    for kind in kinds.values():
        for doubt in keystore_doubts(keystore, kind[0], accesses):
            found.setdefault((doubt.enclave, doubt.location), (doubt, []))[1].extend(kind)
    doubts = (replace(doubt, profiles=_names(profiles, under)) for doubt, under in found.values())
    return tuple(sorted(doubts, key=lambda d: (d.location.path, d.location.line or 0, d.enclave or "")))


def _names(profiles: Sequence[Profile], under: Sequence[Profile]) -> tuple[str, ...]:
    """The names of the profiles under which something is so, in the order of all."""
    return tuple(profile.name for profile in profiles if profile in under)


def _idle(systems: tuple[System, ...]) -> tuple[str, ...]:
    """Under which profiles no governance is in force, so that there is nothing to protect; a sentence, if any."""
    idle = [
        name
        for system in systems
        if system.may and not any(view.protection.governed for view in enclaves_views(system))
        for name in system.profiles
    ]
    told = (
        f"Under {', '.join(idle)} no enclave carries a governance that its peers accept. Nothing starts, so "
        "encryption and access control hold only because there is nothing to protect."
    )
    return (told,) if idle else ()


def _unneeded(channel: ChannelAtom) -> tuple[bool, bool]:
    """An order: what every node of ROS 2 needs comes first, then what ROS 2 has."""
    return channel.topic != DISCOVERY_TOPIC, not channel.ros


def _ungoverned(systems: tuple[System, ...]) -> tuple[UngovernedTopics, ...]:
    """Topics of governed domains that no topic rule matches, one of each document and domain class. There are more
    where implementations read expressions or ranges so differently that none is the same for all.
    """
    known: dict[tuple[int, int], tuple[UngovernedTopics, ...]] = {}
    found: dict[UngovernedTopics, list[str]] = {}
    for system in systems:
        if system.may:
            rules = id(system.domain_rules), id(system.topic_rules)  # one object where they are read alike
            if rules not in known:
                known[rules] = tuple(_unmatched(system))
            for each in known[rules]:
                found.setdefault(each, []).extend(system.profiles)
    return tuple(replace(each, profiles=tuple(names)) for each, names in found.items())


def _unmatched(system: System) -> Iterator[UngovernedTopics]:
    permissions = Permissions(system)
    for number in sorted({rule.document for rule in system.domain_rules}):
        said = protection(number, permissions)
        for domain in members(said.ruled):
            missing = list(members(permissions.channels_in[domain] & ~said.governed))
            if missing:
                witness = min(missing, key=lambda n: _unneeded(system.channels[n]))
                rules = (r for r in system.domain_rules if r.document == number and domain in r.domains)
                yield UngovernedTopics(
                    location=next(rules).location,
                    domains=system.domains[domain].label,
                    witness=system.channels[witness].topic,
                )
