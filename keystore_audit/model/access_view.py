"""What the documents of a keystore say to each implementation: one view for each access row of `model.profiles`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.document import DomainRange, Readings
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Governance, GovernanceFile, Permissions, PermissionsFile, ProtectionKind
from keystore_audit.model.domains import Interval
from keystore_audit.model.inventory import Document, Typed
from keystore_audit.model.matching.expression import has_wildcard, parse
from keystore_audit.model.occasions import OCCASIONS, Occasions, expressions
from keystore_audit.model.semantics import (
    ReadDomainRule,
    ReadGrant,
    ReadRule,
    read_domain_rules,
    read_grant,
    read_rules,
)
from keystore_audit.model.subjects.comparison import names
from keystore_audit.model.validity import Dated, counts_at, read_date
from keystore_audit.profiles import (
    QUIRKS,
    SPEC,
    Access,
    Alike,
    DateReading,
    OpenRange,
    PartitionReading,
    Profile,
    at_work,
)
from keystore_audit.truth import Truth

if TYPE_CHECKING:  # most audits are told no zone
    from zoneinfo import ZoneInfo

T = TypeVar("T")

_COUNTING: Final = frozenset("?[")
"""What takes one character, or one octet."""


class ReadDocument(Struct, frozen=True, kw_only=True):
    """A document as an implementation reads it.

    `refusal`: why it rejects the document. `doubt`: why it is unknown what the document says, and the line. With
    neither, one of `domain_rules` and `grants` is there, unless the document could not be parsed at all.
    """

    refusal: str | None = None
    doubt: tuple[str, int | None] | None = None
    domain_rules: tuple[ReadDomainRule, ...] | None = None
    grants: tuple[ReadGrant, ...] | None = None

    @property
    def is_readable(self) -> bool:
        """Whether it says something."""
        return self.domain_rules is not None or self.grants is not None

    @property
    def is_silent(self) -> bool:
        """Whether it is not refused, and what it says is unknown all the same."""
        return not self.is_readable and self.refusal is None


_UNPARSED: Final = ReadDocument()

_LATER: Final = tuple(name for name, quirk in QUIRKS.items() if quirk.matters in OCCASIONS)
"""Peculiarities that count when rights are decided."""

_DONE_WITH: Final = frozenset(QUIRKS) - {*_LATER}
"""Those that no longer matter once a document is read. All else in a row counts later."""

ZONE_DECIDES: Final = "is read in the robot's zone (--time-zone), which decides whether the grant counts now"
"""The end of a doubt that the robots' zone would settle."""


class _Readings(NamedTuple):
    """What rows make of one document, and of the rules of each grant, whatever its dates."""

    document: Alike[ReadDocument]
    rules: Alike[tuple[tuple[ReadRule, ...], ...]]


class AccessViews:
    """The views of one keystore's documents at `at` (aware UTC); `zone`: where the robot is, None if not said.

    `assumed`: what else is taken for granted of robots and authorities. `beyond`: documents that count as unread, why.
    """

    def __init__(
        self,
        documents: Iterable[Document],
        at: datetime,
        zone: ZoneInfo | None,
        assumed: frozenset[Assumption] = EVERY,
        beyond: Mapping[Typed, str] = MappingProxyType({}),
    ) -> None:
        self._beyond = beyond
        self._documents = tuple(documents)
        self._held = Occasions([each.file for each in self._documents if each.file is not None], at, zone)
        self.at = at
        self._zone = zone
        self.assumed = assumed
        self._rows: dict[Access, Access] = {}
        self._kept: dict[object, Access] = {}
        self._read: dict[Access, dict[Typed, ReadDocument]] = {}
        self._readings: dict[tuple[int, str | None], _Readings] = {}
        self._deciding: dict[tuple[Access, GovernanceFile], tuple[ReadDomainRule, ...]] = {}

    def row(self, access: Access) -> Access:
        """One row for all that read this keystore's documents alike; if possible the specification's."""
        row = self._rows.get(access)
        if row is None:
            if not self._kept:
                self._kept[self._answers(SPEC.access)] = SPEC.access
            reduced = self._reduced(access)
            row = self._kept.setdefault(self._answers(reduced), reduced)
            self._rows[access] = self._rows[row] = row
        return row

    def read(self, file: Typed, access: Access) -> ReadDocument:
        """What the document says."""
        read = self._read.setdefault(access, {})
        found = read.get(file)
        if found is None:
            found = read[file] = self._readings_of(file).document.of(access)
        return found

    def _readings_of(self, file: Typed) -> _Readings:
        """The readings of the document, and of its copies."""
        key = id(file.readings), self._beyond.get(file)
        known = self._readings.get(key)
        if known is None:
            known = self._readings[key] = _Readings(
                document=Alike(partial(self._document, file)), rules=Alike(partial(_rules_of, file))
            )
        return known

    def rows(self, profiles: Iterable[Profile]) -> tuple[Access, ...]:
        """The rows of the profiles, and of what else runs in their fleets."""
        return tuple(dict.fromkeys(self.row(profile.access) for profile in at_work(profiles)))

    def by_row(self, profiles: Iterable[Profile], files: Iterable[Typed | None]) -> dict[Access, list[ReadDocument]]:
        """What these documents say to each row; missing ones say nothing."""
        found = tuple(file for file in files if file is not None)
        return {row: [self.read(file, row) for file in found] for row in self.rows(profiles)}

    def own_grants(self, enclave: Enclave, profile: Profile) -> tuple[ReadGrant, ...] | None:
        """The grants of the enclave's own document that name its certificate; None where the document says nothing."""
        certificate = enclave.identity
        read = self.read(enclave.permissions, profile.access).grants if enclave.permissions is not None else None
        if read is None or certificate is None:
            return None
        comparison = profile.trust.subjects
        return tuple([each for each in read if names(each.grant.subject_name.text, certificate, comparison)])

    def deciding(self, file: GovernanceFile, access: Access) -> Sequence[ReadDomainRule]:
        """The domain rules of the document that may decide: of those about the same domains the first, or any."""
        if access.any_governance_rule:
            return self.read(file, access).domain_rules or ()
        found = self._deciding.get((access, file))
        if found is None:
            first: dict[tuple[Interval, ...], ReadDomainRule] = {}
            for rule in self.read(file, access).domain_rules or ():
                first.setdefault(rule.domains, rule)
            found = self._deciding[access, file] = tuple(first.values())
        return found

    def of_document(self, file: Typed) -> AccessViews:
        """The views of this document alone: of its own occasions."""
        alone = AccessViews((Document(file.signed.file.place, file),), self.at, self._zone, self.assumed, self._beyond)
        alone._readings = self._readings
        return alone

    def within_budget(self, build: Callable[[AccessViews], T]) -> tuple[T, AccessViews]:
        """What is built with the views, and these.

        Where there are too many classes of names, the fewest documents with the most wildcards count as unread. They
        may say anything; what does not rest on them stays decided. Raises errors.BudgetExceeded where not even that is
        enough: what users name tells apart too much by itself.
        """
        found: tuple[T, AccessViews] | None = None
        why = ""

        def fits(count: int) -> bool:
            nonlocal found, why
            views = self._without(count, why) if count else self
            try:
                found = build(views), views
            except BudgetExceeded as exceeded:  # not kept: its traceback holds all that was built
                why = why or exceeded.message
                return False
            return True

        if not fits(0):
            bisect_left(range(1, len(self._held.files) + 1), True, key=fits)  # the last that fits is of the fewest
        if found is None:
            raise BudgetExceeded(why)
        return found

    def _without(self, count: int, why: str) -> AccessViews:
        """The views with so many documents counted as unread."""

        def wildcards(file: Typed) -> int:
            texts = (text.text for typed in file.readings.distinct for text in expressions(typed))
            return len({text for text in texts if has_wildcard(text)})

        heaviest = sorted(self._held.files, key=wildcards, reverse=True)[:count]
        return AccessViews(self._documents, self.at, self._zone, self.assumed, dict.fromkeys(heaviest, why))

    def unclear_name(self, topic: str, partitions: Sequence[str], profile: Profile) -> str | None:
        """Why it is unknown which expressions an implementation takes to match these names of an endpoint; None: it
        is known.
        """
        if profile.others:
            reasons = (self.unclear_name(topic, partitions, each) for each in at_work((profile,)))
            return next(filter(None, reasons), None)
        counting = any(not _COUNTING.isdisjoint(text) for text in self._held.unusual_expressions)
        if profile.access.matches_octets and counting and not "".join((topic, *partitions)).isascii():
            return "in names beyond ASCII, ? and brackets take octets or characters, as the process's locale has it"
        if profile.local.splits_partitions and any(";" in partition for partition in partitions):
            return f"{profile.title} splits the partition at its semicolons"
        named = profile.access.partitions is PartitionReading.CRITERION_NAMED
        if named and len(partitions) > 1 and "" in partitions:
            return f"how {profile.title} reads a partition without a name beside others was not measured"
        return None

    def dates_in_local_time(self, profiles: Iterable[Profile]) -> frozenset[datetime]:
        """Dates of grants that a profile reads in the robot's zone, which is not given, as if they were UTC."""
        readings = {profile.access.dates for profile in at_work(profiles)}
        dated = [read_date(text, reading, self._zone) for text in self._held.dates for reading in readings]
        return frozenset(each.instant for each in dated if each is not None and each.local)

    def dated(self, profiles: Iterable[Profile], instants: Collection[datetime]) -> Iterator[tuple[Location, str]]:
        """The dates of grants that a profile takes for one of the `instants` in the robot's zone: where, and what."""
        readings = {profile.access.dates for profile in at_work(profiles)}
        for file in self._held.files:
            for grant in file.grants if isinstance(file, PermissionsFile) else ():
                for verb, date in (("begins", grant.not_before), ("ends", grant.not_after)):
                    taken = [read_date(date.text, reading, self._zone) for reading in readings]
                    if any(each is not None and each.local and each.instant in instants for each in taken):
                        yield Location(path=file.signed.file.place, line=date.line), f"{verb} {date.text}"

    def exclusive_bounds(self, profiles: Iterable[Profile]) -> tuple[frozenset[datetime], frozenset[datetime]]:
        """Where grants begin and where they end, if a profile does not count them at that very instant."""
        if all(profile.access.dates is not DateReading.UNREADABLE_IS_PAST for profile in at_work(profiles)):
            return frozenset(), frozenset()
        bounds = []
        for texts in (
            {grant.not_before.text for grant in self._held.grants},
            {grant.not_after.text for grant in self._held.grants},
        ):
            dated = (read_date(text, DateReading.UNREADABLE_IS_PAST, self._zone) for text in texts)
            bounds.append(frozenset(each.instant for each in dated if each is not None))
        return bounds[0], bounds[1]

    def _answers(self, access: Access) -> object:
        """What the documents say, and what of the row counts later, when rights are decided."""
        later = [getattr(access, name) for name in access.__struct_fields__ if name not in _DONE_WITH]
        return tuple([id(self.read(file, access)) for file in self._held.files]), *later

    def _reduced(self, access: Access) -> Access:
        """The row with the specification's values wherever no document gives an occasion for others."""
        specified = {name: getattr(SPEC.access, name) for name in _LATER}
        differing = [name for name, value in specified.items() if getattr(access, name) != value]
        idle = [name for name in differing if not self._held.has(QUIRKS[name].matters, access)]
        return replace(access, **{name: specified[name] for name in idle}) if idle else access

    def _document(self, file: Typed, access: Access) -> ReadDocument:
        typed = typed_by(file, access)
        if typed is None:
            return _UNPARSED
        if file in self._beyond:
            return ReadDocument(doubt=(self._beyond[file], None))
        if isinstance(typed, str):
            return ReadDocument(refusal=typed)
        if isinstance(typed, Defect):
            return ReadDocument(doubt=(typed.detail, typed.line))
        undefined = _undefined_expression(typed, access)
        if undefined is not None:
            return ReadDocument(doubt=undefined)
        ranges, highest = [*_ranges(typed)], access.highest_domain
        if highest is not None and any(max(each.low or 0, each.high or 0) > highest for each in ranges):
            return ReadDocument(refusal=f"it names a domain above {highest}")
        unbounded = next((each for each in ranges if each.low is None), None)
        unbounded = unbounded if access.open_ranges is OpenRange.LONE_MAX_REFUSED else None
        if isinstance(typed, Permissions):
            if unbounded is None:
                return self._permissions_document(file, typed, access)
            # In permissions it is not refused: coming to it ends the process (measured).
            doubt = "an <id_range> without <min> ends the process that reads it", unbounded.line
            return ReadDocument(doubt=doubt)
        if unbounded is not None:
            return ReadDocument(refusal="it has an <id_range> without <min>")
        inverted = any(each.high is not None and (each.low or 0) > each.high for each in ranges)
        if inverted and access.open_ranges is OpenRange.LONE_MAX_REFUSED:
            return ReadDocument(refusal="it has an <id_range> that ends before it begins")
        if _opens_protected_rtps(typed) and access.refuses_unauthenticated_with_rtps:
            return ReadDocument(refusal="it allows unauthenticated participants beside a protected RTPS")
        return ReadDocument(domain_rules=read_domain_rules(typed, access))

    def _permissions_document(self, file: Typed, permissions: Permissions, access: Access) -> ReadDocument:
        grants = []
        for grant, rules in zip(permissions.grants, self._readings_of(file).rules.of(access), strict=True):
            dates = [read_date(date.text, access.dates, self._zone) for date in (grant.not_before, grant.not_after)]
            not_before, not_after = dates
            if not_before is None or not_after is None:
                date = grant.not_before if not_before is None else grant.not_after
                if access.dates is DateReading.XSD:  # the specification says nothing of such a date
                    return ReadDocument(doubt=(f"{date.text!r} is no date of the years 1 to 9999", date.line))
                return ReadDocument(refusal=f"{date.text!r} is no date")
            in_force = counts_at(not_before, not_after, self.at, access.dates)
            if in_force is Truth.UNKNOWN:
                date = grant.not_before if not_before.local and not_before.latest > self.at else grant.not_after
                return ReadDocument(doubt=(f"{date.text!r} {ZONE_DECIDES}", date.line))
            grants.append(
                read_grant(grant, rules, *self._bounds(not_before, not_after, in_force=in_force.must), access)
            )
        return ReadDocument(grants=tuple(grants))

    def _bounds(self, not_before: Dated, not_after: Dated, *, in_force: bool) -> tuple[datetime, datetime]:
        """The validity, both ends included; implementations differ in the second at which it ends."""
        start, end = not_before.instant, not_after.instant
        if in_force:
            return min(start, self.at), max(end, self.at)
        if start <= self.at <= end:
            return (self.at + datetime.resolution, end) if start == self.at else (start, self.at - datetime.resolution)
        return start, end


def _rules_of(file: Typed, access: Access) -> tuple[tuple[ReadRule, ...], ...]:
    typed = typed_by(file, access)
    return tuple(read_rules(grant, access) for grant in typed.grants) if isinstance(typed, Permissions) else ()


def typed_by(file: Typed, access: Access) -> Governance | Permissions | str | Defect | None:
    """What an implementation finds in the XML, why it refuses it (a str), or why that is unknown (a defect, None)."""
    readings: Readings[Governance] | Readings[Permissions] = file.readings
    return readings.common or readings.by_syntax.get(access.syntax)


def _undefined_expression(typed: Governance | Permissions, access: Access) -> tuple[str, int | None] | None:
    """An expression whose meaning depends on what an implementation has in its memory, and its line."""
    for expression in expressions(typed):
        if "[" in expression.text:
            pattern = parse(expression.text, access.matcher)
            if pattern.undefined:
                return f"the expression {expression.text!r} {pattern.malformed}", expression.line
    return None


def _opens_protected_rtps(governance: Governance) -> bool:
    return any(
        rule.allow_unauthenticated_participants and rule.rtps_protection_kind is not ProtectionKind.NONE
        for rule in governance.domain_rules
    )


def _ranges(document: Governance | Permissions) -> Iterator[DomainRange]:
    if isinstance(document, Governance):
        yield from (each for rule in document.domain_rules for each in rule.domains)
    else:
        yield from (each for grant in document.grants for rule in grant.rules for each in rule.domains)
