"""What the documents of a keystore say to each implementation: one view for each access row of `model.profiles`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import TYPE_CHECKING, Final

from msgspec import Struct
from msgspec.structs import astuple, replace

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.findings import Location
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.governance import Governance, GovernanceFile, ProtectionKind
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation, Permissions, PermissionsFile
from keystore_audit.model.domains import Interval
from keystore_audit.model.inventory import Document, Typed
from keystore_audit.model.matching.expression import has_wildcard, parse
from keystore_audit.model.semantics import (
    ReadDomainRule,
    ReadGrant,
    has_one_reading,
    read_domain_rules,
    read_grant,
)
from keystore_audit.model.subjects.comparison import names
from keystore_audit.model.validity import SECOND, Dated, counts_at, read_date
from keystore_audit.profiles import SPEC, Access, DateReading, Matcher, OpenRange, Profile

if TYPE_CHECKING:  # most audits are told no zone
    from zoneinfo import ZoneInfo

_COUNTING: Final = frozenset("?[")
"""What takes one character, or one octet."""


class ReadDocument(Struct, frozen=True, kw_only=True):
    """A document as an implementation reads it.

    `refusal`: why it takes the document for none. `doubt`: why it is unknown what the document says, and the line. With
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

ZONE_DECIDES: Final = "is read in the robot's zone (--time-zone), which decides whether the grant counts now"
"""How a doubt ends that the robots' zone would settle."""


class AccessViews:
    """The views of one keystore's documents at `at` (aware UTC); `zone`: where the robot is, None if not said.

    `assumed`: what else is taken for granted of robots and authorities.
    """

    def __init__(
        self,
        documents: Iterable[Document],
        at: datetime,
        zone: ZoneInfo | None,
        assumed: frozenset[Assumption] = EVERY,
    ) -> None:
        self._files = [document.file for document in documents if document.file is not None]
        self.at = at
        self._zone = zone
        self.assumed = assumed
        self._rows: dict[Access, Access] = {}
        self._kept: dict[tuple[object, ...], Access] = {}
        self._read: dict[tuple[Access, Typed], ReadDocument] = {}
        self._deciding: dict[tuple[Access, GovernanceFile], tuple[ReadDomainRule, ...]] = {}

    def row(self, access: Access) -> Access:
        """One row for all that read this keystore's documents alike."""
        row = self._rows.get(access)
        if row is None:
            reduced = self._reduced(access)
            row = self._kept.setdefault(astuple(reduced), reduced)
            self._rows[access] = self._rows[row] = row
        return row

    def read(self, file: Typed, access: Access) -> ReadDocument:
        """What the document says."""
        found = self._read.get((access, file))
        if found is None:
            row = self.row(access)
            found = self._read[access, file] = self._document(file, row) if row is access else self.read(file, row)
        return found

    def rows(self, profiles: Iterable[Profile]) -> tuple[Access, ...]:
        """Those of the profiles."""
        return tuple(dict.fromkeys(self.row(profile.access) for profile in profiles))

    def by_row(self, profiles: Iterable[Profile], files: Iterable[Typed | None]) -> dict[Access, list[ReadDocument]]:
        """What these documents say to each; what is not there says nothing."""
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
        """The views of this document alone: of what it gives an occasion for."""
        return AccessViews((Document(file.signed.file.place, file),), self.at, self._zone, self.assumed)

    def unclear_name(self, topic: str, partition: str, profile: Profile) -> str | None:
        """Why it cannot be told which expressions an implementation takes to match these names; None: it can."""
        counting = any(not _COUNTING.isdisjoint(text) for text in self._unusual_expressions)
        if profile.access.matches_octets and counting and not (topic + partition).isascii():
            return "in names beyond ASCII, ? and brackets take octets or characters, as the process's locale has it"
        if profile.local.splits_partitions and ";" in partition:
            return f"{profile.title} takes the partition apart at its semicolons"
        return None

    def dates_in_local_time(self, profiles: Iterable[Profile]) -> frozenset[datetime]:
        """Dates of grants that a profile reads in the robot's zone, which we were not told, as if it were UTC."""
        readings = {profile.access.dates for profile in profiles}
        dated = [read_date(text, reading, self._zone) for text in self._dates for reading in readings]
        return frozenset(each.instant for each in dated if each is not None and each.local)

    def dated(self, profiles: Iterable[Profile], instants: Collection[datetime]) -> Iterator[tuple[Location, str]]:
        """The dates of grants that a profile takes for one of the `instants` in the robot's zone: where, and what."""
        readings = {profile.access.dates for profile in profiles}
        for file in self._files:
            for grant in file.grants if isinstance(file, PermissionsFile) else ():
                for verb, date in (("begins", grant.not_before), ("ends", grant.not_after)):
                    taken = [read_date(date.text, reading, self._zone) for reading in readings]
                    if any(each is not None and each.local and each.instant in instants for each in taken):
                        yield Location(path=file.signed.file.place, line=date.line), f"{verb} {date.text}"

    def exclusive_bounds(self, profiles: Iterable[Profile]) -> tuple[frozenset[datetime], frozenset[datetime]]:
        """Where grants begin, and where they end, that a profile counts not yet, or no more, at that very instant."""
        if all(profile.access.dates is not DateReading.UNREADABLE_IS_PAST for profile in profiles):
            return frozenset(), frozenset()
        bounds = []
        for texts in (
            {grant.not_before.text for grant in self._grants},
            {grant.not_after.text for grant in self._grants},
        ):
            dated = (read_date(text, DateReading.UNREADABLE_IS_PAST, self._zone) for text in texts)
            bounds.append(frozenset(each.instant for each in dated if each is not None))
        return bounds[0], bounds[1]

    def _reduced(self, access: Access) -> Access:
        """The row with everything that no document gives an occasion for as the specification has it.

        What `_occasions` does not know stays as it is: rows are then apart that could be one, and no answer is wrong.
        Where it says the same, no document is looked at.
        """
        occasions = self._occasions(access)
        specified = {name: getattr(SPEC.access, name) for name in occasions}
        differing = {name: value for name, value in specified.items() if value != getattr(access, name)}
        return replace(access, **{name: value for name, value in differing.items() if not occasions[name]()})

    def _occasions(self, access: Access) -> Mapping[str, Callable[[], bool]]:
        """By field of the row, whether some document gives an occasion for it."""
        occasions: dict[str, Callable[[], bool]] = {
            "matcher": lambda: any(
                not parse(text, access.matcher).agrees(parse(text, Matcher.POSIX)) for text in self._unusual_expressions
            ),
            "matches_octets": lambda: False,  # of names, not documents: `unclear_name`
            "open_ranges": lambda: any(
                entry.low is None or not entry.high for entry in self._ranges if entry.low != entry.high
            ),
            "highest_domain": lambda: _range_refusal(self._ranges, access) is not None,
            "reads_1_0": lambda: any(_is_1_0(file) for file in self._files),
            "refuses_unauthenticated_with_rtps": lambda: any(map(_opens_protected_rtps, self._governances)),
            "dates": lambda: not all(self._same_date(text, access.dates) for text in self._dates),
            "skips_grants_out_of_date": lambda: (
                any(len(permissions.grants) > 1 for permissions in self._permissions)
                or (access.joins_out_of_date and occasions["joins_out_of_date"]())  # by the one grant that there is
            ),
            "joins_out_of_date": lambda: any(self._may_be_out_of_date(grant, access.dates) for grant in self._grants),
            "honours_default": lambda: any(grant.default_allow for grant in self._grants),
            "partitions": lambda: not all(map(has_one_reading, self._permissions)),
            "relay": lambda: any(
                criterion.operation is Operation.RELAY
                for grant in self._grants
                for rule in grant.rules
                for criterion in rule.criteria
            ),
            "first_rule_decides_topic": lambda: any(not rule.allow for grant in self._grants for rule in grant.rules),
            "requires_grant": lambda: any(
                not rule.enable_join_access_control
                for governance in self._governances
                for rule in governance.domain_rules
            ),
            "any_governance_rule": lambda: any(
                len(governance.domain_rules) > 1 or any(len(rule.topic_rules) > 1 for rule in governance.domain_rules)
                for governance in self._governances
            ),
            "authenticates_origin": lambda: any(map(_authenticates_origin, self._governances)),
        }
        return occasions

    @cached_property
    def _governances(self) -> list[Governance]:
        files = [file for file in self._files if isinstance(file, GovernanceFile)]
        return [file.governance for file in files if file.governance is not None]

    @cached_property
    def _permissions(self) -> list[Permissions]:
        files = [file for file in self._files if isinstance(file, PermissionsFile)]
        return [file.permissions for file in files if file.permissions is not None]

    @cached_property
    def _grants(self) -> list[Grant]:
        return [grant for permissions in self._permissions for grant in permissions.grants]

    @cached_property
    def _ranges(self) -> list[DomainRange]:
        return list(
            dict.fromkeys(
                [entry for governance in self._governances for entry in _governance_ranges(governance)]
                + [entry for permissions in self._permissions for entry in _permissions_ranges(permissions)]
            )
        )

    @cached_property
    def _dates(self) -> set[str]:
        return {date.text for grant in self._grants for date in (grant.not_before, grant.not_after)}

    @cached_property
    def _unusual_expressions(self) -> list[str]:
        """Expressions that a matcher may read in its own way."""
        found = {expression.text for file in self._files for expression in _expressions(file)}
        return list(filter(has_wildcard, found))

    def _same_date(self, text: str, reading: DateReading) -> bool:
        """Whether the date is what the specification has, and it does not matter now how exactly."""
        dated, standard = read_date(text, reading, self._zone), read_date(text, DateReading.XSD, None)
        if dated is None or standard is None or dated.instant != standard.instant:
            return False
        return not (dated.earliest <= self.at + SECOND and self.at - SECOND <= dated.latest)

    def _may_be_out_of_date(self, grant: Grant, reading: DateReading) -> bool:
        dates = [read_date(date.text, reading, self._zone) for date in (grant.not_before, grant.not_after)]
        start, end = dates
        return start is None or end is None or counts_at(start, end, self.at, reading) is not True

    def _document(self, file: Typed, access: Access) -> ReadDocument:
        governance = file.governance if isinstance(file, GovernanceFile) else None
        permissions = file.permissions if isinstance(file, PermissionsFile) else None
        if governance is None and permissions is None:
            return _UNPARSED
        if not access.reads_1_0 and _is_1_0(file):
            return ReadDocument(refusal="it has the form of DDS-Security 1.0")
        undefined = self._undefined_expression(file, access.matcher)
        if undefined is not None:
            return ReadDocument(doubt=undefined)
        if governance is not None:
            ranges = list(_governance_ranges(governance))
            refusal = _range_refusal(ranges, access)
            if refusal is None and _unbounded_below(ranges, access) is not None:
                refusal = "it has an <id_range> without <min>"
            if refusal is None and access.refuses_unauthenticated_with_rtps and _opens_protected_rtps(governance):
                refusal = "it allows unauthenticated participants beside a protected RTPS"
            return ReadDocument(
                refusal=refusal, domain_rules=None if refusal else read_domain_rules(governance, access)
            )
        return self._permissions_document(permissions, access) if permissions is not None else _UNPARSED

    def _undefined_expression(self, file: Typed, matcher: Matcher) -> tuple[str, int | None] | None:
        """An expression whose meaning hangs on what an implementation has in its memory, and its line."""
        undefined = {text for text in self._unusual_expressions if parse(text, matcher).undefined}
        if undefined:
            for expression in _expressions(file):
                if expression.text in undefined:
                    reason = f"the expression {expression.text!r} {parse(expression.text, matcher).malformed}"
                    return reason, expression.line
        return None

    def _permissions_document(self, permissions: Permissions, access: Access) -> ReadDocument:
        refusal = _range_refusal(_permissions_ranges(permissions), access)
        if refusal is not None:
            return ReadDocument(refusal=refusal)
        unbounded = _unbounded_below(_permissions_ranges(permissions), access)
        if unbounded is not None:  # in permissions it is not refused: coming to it ends the process (measured)
            return ReadDocument(doubt=("an <id_range> without <min> ends the process that comes to it", unbounded.line))
        grants = []
        for grant in permissions.grants:
            dates = [read_date(date.text, access.dates, self._zone) for date in (grant.not_before, grant.not_after)]
            not_before, not_after = dates
            if not_before is None or not_after is None:
                date = grant.not_before if not_before is None else grant.not_after
                if access.dates is DateReading.XSD:  # the specification says nothing of such a date
                    return ReadDocument(doubt=(f"{date.text!r} is no date of the years 1 to 9999", date.line))
                return ReadDocument(refusal=f"{date.text!r} is no date")
            in_force = counts_at(not_before, not_after, self.at, access.dates)
            if in_force is None:
                date = grant.not_before if not_before.local and not_before.latest > self.at else grant.not_after
                return ReadDocument(doubt=(f"{date.text!r} {ZONE_DECIDES}", date.line))
            grants.append(read_grant(grant, *self._bounds(not_before, not_after, in_force=in_force), access))
        return ReadDocument(grants=tuple(grants))

    def _bounds(self, not_before: Dated, not_after: Dated, *, in_force: bool) -> tuple[datetime, datetime]:
        """The validity, both ends included; implementations differ in the second at which it ends."""
        start, end = not_before.instant, not_after.instant
        if in_force:
            return min(start, self.at), max(end, self.at)
        if start <= self.at <= end:
            return (self.at + datetime.resolution, end) if start == self.at else (start, self.at - datetime.resolution)
        return start, end


def _is_1_0(file: Typed) -> bool:
    """Permissions of that form only mix their criteria, which every implementation reads (measured)."""
    return isinstance(file, GovernanceFile) and any(defect.kind is Kind.DDS_SECURITY_1_0 for defect in file.defects)


def _range_refusal(ranges: Iterable[DomainRange], access: Access) -> str | None:
    highest = access.highest_domain
    if highest is None or all(max(entry.low or 0, entry.high or 0) <= highest for entry in ranges):
        return None
    return f"it names a domain above {highest}"


def _unbounded_below(ranges: Iterable[DomainRange], access: Access) -> DomainRange | None:
    """A range without a lower bound, where the implementation wants one."""
    if access.open_ranges is not OpenRange.LONE_MAX_REFUSED:
        return None
    return next((entry for entry in ranges if entry.low is None), None)


def _opens_protected_rtps(governance: Governance) -> bool:
    return any(
        rule.allow_unauthenticated_participants and rule.rtps_protection_kind is not ProtectionKind.NONE
        for rule in governance.domain_rules
    )


def _authenticates_origin(governance: Governance) -> bool:
    return any(
        rule.discovery_protection_kind.authenticates_origin
        or rule.liveliness_protection_kind.authenticates_origin
        or rule.rtps_protection_kind.authenticates_origin
        or any(topic.metadata_protection_kind.authenticates_origin for topic in rule.topic_rules)
        for rule in governance.domain_rules
    )


def _expressions(file: Typed) -> Iterator[Text]:
    """Every topic and partition expression of the document."""
    if isinstance(file, GovernanceFile):
        for domain_rule in file.governance.domain_rules if file.governance else ():
            yield from (topic.expression for topic in domain_rule.topic_rules)
        return
    for grant in file.grants:
        for rule in grant.rules:
            for criterion in rule.criteria:
                yield from criterion.topics
                yield from criterion.partitions or ()


def _governance_ranges(governance: Governance) -> Iterator[DomainRange]:
    for rule in governance.domain_rules:
        yield from rule.domains


def _permissions_ranges(permissions: Permissions) -> Iterator[DomainRange]:
    for grant in permissions.grants:
        for rule in grant.rules:
            yield from rule.domains
