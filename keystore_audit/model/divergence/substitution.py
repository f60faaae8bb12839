"""From what one implementation does to what the specification says, one difference at a time.

Where two implementations decide differently, the cause is the difference whose removal gives the specification's
decision. So an implementation is compared with itself, without one peculiarity after another. Whom they trust is
left aside: it is that of the specification throughout.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from typing import Final

from msgspec import Struct
from msgspec.structs import astuple, replace

from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.domains import Interval
from keystore_audit.model.inventory import Typed
from keystore_audit.profiles import QUIRKS, SPEC, Access, JoinCheck, Profile, check_reader
from keystore_audit.profiles.table import GROUP, value_of

NO_DECISION: Final = "no decision"
"""The column `cause` of quirks.toml where no decision about documents depends on a peculiarity."""


class Cause(str, Enum):
    """Why implementations decide differently about one document (`profiles.access`).

    OTHER: a difference without a name of its own. UNDECIDED: there are too many classes of names to compare.
    """

    FORM = "form of the document"
    HIGHEST_DOMAIN = "domain too high"
    UNAUTHENTICATED_WITH_RTPS = "unauthenticated participants beside protected RTPS"
    RANGE = "range of domains with one bound"
    DATE = "date"
    GRANT_CHOICE = "first grant out of date"
    UNGOVERNED = "domain that no rule of the governance covers"
    JOIN = "join"
    RULE_DOMAINS = "rule of another domain"
    EXPRESSION = "expression"
    DEFAULT = "default"
    DENY_IN_PARTITION = "deny rule with partitions"
    DENY_WITHOUT_PARTITION = "deny rule without partitions"
    CROSSED_PARTITIONS = "partitions of several criteria"
    FINAL_RULE = "first rule that lists the topic"
    RELAY = "relay"
    TOPIC_DENIED = "topic denied as a whole"
    GRANT_REQUIRED = "no grant"
    ANY_GOVERNANCE_RULE = "any matching rule of the governance"
    OTHER = "other"
    UNDECIDED = "undecided"


check_reader("model.divergence", "cause", {*(cause.value for cause in Cause), NO_DECISION})

_CURED: Final = tuple((name, Cause(quirk.cause)) for name, quirk in QUIRKS.items() if quirk.cause in {*Cause})
"""Peculiarities in the order in which they are removed: first those by which a document counts at all, then those of
single rules."""

_HARMLESS: Final = frozenset({"binds_domains", "starts_ungoverned", "joins"})
"""Demands of implementations on their own participants that every plain pair meets; `joins` except for Table 63."""

PARTITION_CAUSES: Final = frozenset(
    {Cause.DENY_IN_PARTITION, Cause.DENY_WITHOUT_PARTITION, Cause.CROSSED_PARTITIONS, Cause.FINAL_RULE}
)


class Stage(Struct, frozen=True, kw_only=True):
    """An implementation with some peculiarities left; `cured` is the one that the stage before has in addition.

    None: it is the implementation itself. `profile`: its rows, and the trust row of the specification.
    """

    cured: Cause | None
    profile: Profile


class Reader(Struct, frozen=True, kw_only=True):
    """Profiles (their canonical names) that do the same with a keystore's documents, and the way to `spec`."""

    names: tuple[str, ...]
    stages: tuple[Stage, ...]

    @property
    def itself(self) -> Profile:
        """The rows of its profiles."""
        return self.stages[0].profile


class Stages:
    """The stages of one keystore's readers: those that read and start alike are one profile.

    The names that topics can have, and all else that decides nothing about documents, are the specification's.
    """

    def __init__(self, accesses: AccessViews) -> None:
        self._accesses = accesses
        self._profiles: dict[object, Profile] = {}

    def readers(self, profiles: Iterable[Profile]) -> tuple[Reader, ...]:
        """The profiles, those that read and start alike together."""
        found: dict[int, tuple[Profile, list[str]]] = {}
        for profile in profiles:
            values = {name: value_of(profile, name) for name, _cause in _CURED}
            reading = self._with(profile.access, values)
            found.setdefault(id(reading), (reading, []))[1].append(profile.name)
        return tuple(Reader(names=tuple(names), stages=tuple(self._stages(each))) for each, names in found.values())

    def _with(self, access: Access, values: Mapping[str, object]) -> Profile:
        """The specification with this access row and these values; rows that are read alike are one."""
        local = replace(SPEC.local, **{name: value for name, value in values.items() if GROUP[name] == "local"})
        access = replace(access, **{name: value for name, value in values.items() if GROUP[name] == "access"})
        row = self._accesses.row(access)
        key = row, astuple(local)
        if key not in self._profiles:
            access = row if row is SPEC.access else access
            self._profiles[key] = replace(SPEC, name=f"stage {len(self._profiles)}", access=access, local=local)
        return self._profiles[key]

    def _stages(self, profile: Profile) -> Iterator[Stage]:
        """From the profile itself to the specification."""
        goal = self._with(SPEC.access, {})
        yield Stage(cured=None, profile=profile)
        values = {name: value_of(profile, name) for name, _cause in _CURED}
        access = profile.access
        for name, cause in _CURED:
            specified = value_of(SPEC, name)
            if values[name] != specified:
                values[name] = specified
                cured = self._with(access, values)
                if cured is not profile:
                    yield Stage(cured=cause, profile=cured)
                profile = cured
        if profile is not goal:
            yield Stage(cured=Cause.OTHER, profile=goal)


def odd_documents(files: Iterable[Typed], profiles: Sequence[Profile], accesses: AccessViews) -> frozenset[Typed]:
    """The documents that not all of the profiles read alike."""
    rows = accesses.rows(profiles)
    if len(rows) < 2:
        return frozenset()
    return frozenset(file for file in files if len(set(map(accesses.of_document(file).row, rows))) > 1)


class PlainPairs:
    """Governance and permissions under which every implementation lets its participants start and do alike.

    Every rule holds in every domain that is governed, and every grant allows something: what `ros2 security` writes.
    """

    def __init__(self, profiles: Sequence[Profile], accesses: AccessViews, domain: int | None) -> None:
        self._accesses = accesses
        self._domain = domain
        self._access = profiles[0].access
        self._may_differ = any(_is_picky(profile) for profile in profiles)
        self._known = cache(self._is_plain)

    def has(self, enclave: Enclave) -> bool:
        """Whether the enclave's pair is one of these."""
        return not self._may_differ and self._known(enclave.governance, enclave.permissions)

    def _is_plain(self, governance: GovernanceFile | None, permissions: PermissionsFile | None) -> bool:
        rules = self._accesses.read(governance, self._access).domain_rules if governance else None
        grants = self._accesses.read(permissions, self._access).grants if permissions else None
        if rules is None or grants is None:
            return True
        governed = [interval for rule in rules for interval in rule.domains]
        if not governed or (self._domain is not None and not _holds(governed, (self._domain, self._domain))):
            return False
        return all(
            any(rule.allow for rule in grant.rules)
            and all(_holds(rule.domains, interval) for rule in grant.rules for interval in governed)
            for grant in grants
        )


def _is_picky(profile: Profile) -> bool:
    """Whether its own participants may do less under a plain pair; true unless it is known that they may do all."""
    others = (name for name, _cause in _CURED if GROUP[name] == "local" and name not in _HARMLESS)
    return profile.local.joins is JoinCheck.TABLE_63 or any(
        value_of(profile, name) != value_of(SPEC, name) for name in others
    )


def _holds(cover: Iterable[Interval], interval: Interval) -> bool:
    return any(low <= interval[0] and interval[1] <= high for low, high in cover)
