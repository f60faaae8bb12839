"""The rights by which two rule lists differ: those of a policy, and those of a grant as implementations read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice, pairwise
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.intent.intent import IntendedRight
from keystore_audit.intent.policy import Profiles
from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange, Text
from keystore_audit.keystore.typed import Criterion, GovernanceFile, Grant, Operation, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, ReadRegion, build_channels
from keystore_audit.model.domains import Interval, contains, domain_classes
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.formal.steps import Difference, Step, compare
from keystore_audit.model.matching.expression import has_wildcard, naming, parse
from keystore_audit.model.names import AMBIENT_TOPICS, DISCOVERY_TOPIC, dds_expressions
from keystore_audit.model.rights import RuleLists
from keystore_audit.model.semantics import (
    DEFAULT_PARTITION,
    DIRECTIONS,
    Area,
    ReadGrant,
    ReadRule,
    Region,
    read_grant,
    read_rules,
)
from keystore_audit.model.validity import BEGINNING
from keystore_audit.profiles import Access, Matcher, Profile

# What sros2 grants for a policy: the rules that its permissions.xsl writes for one enclave.
#
# First a deny rule with everything denied, then an allow rule with everything allowed, in the default partition. Each
# is for publishing and for subscribing. Last comes `ros_discovery_info` both ways, which every DDS implementation of
# ROS 2 needs. The default is DENY. The domain is that of whoever signs (ROS_DOMAIN_ID), so here it is every one.


_NO_DATE: Final = Text(text="", line=None)
_DISCOVERED: Final = Text(text=DISCOVERY_TOPIC, line=None)


class PolicyGrant(Struct, frozen=True, kw_only=True):
    """The grant of one `<profiles>`. `rights`: by (allow, operation, expression), the first right that has it.

    Lines are those of the policy, or of the file that it includes; dates are left out: sros2 takes those of the
    certificate.
    """

    grant: Grant
    rights: Mapping[tuple[bool, Operation, str], IntendedRight]


def policy_grant(profiles: Profiles) -> PolicyGrant:
    """What sros2 grants for these profiles."""
    rights: dict[tuple[bool, Operation, str], IntendedRight] = {}
    for right in profiles.rights:
        for operation, expression in dds_expressions(right.action.value, right.name):
            rights.setdefault((right.allow, operation, expression), right)
    texts = (
        ((allow, operation), Text(text=expression, line=right.location.line))
        for (allow, operation, expression), right in rights.items()
    )
    grant = written_grant(
        profiles.enclave,
        Text(text=f"CN={profiles.enclave}", line=profiles.location.line),
        (_NO_DATE, _NO_DATE),
        (DomainRange(low=0, high=MAX_DOMAIN, line=None),),
        ((*key, listed) for key, listed in gathered(texts).items()),
    )
    return PolicyGrant(grant=grant, rights=rights)


def written_grant(
    name: str,
    subject: Text,
    dates: tuple[Text, Text],
    domains: tuple[DomainRange, ...],
    criteria: Iterable[tuple[bool, Operation, Iterable[Text]]],
) -> Grant:
    """The grant as sros2 would write it. `criteria`: whether to allow, what, and the expressions."""
    written = [
        (allow, Criterion(operation=operation, topics=tuple(texts), partitions=None, data_tags=False, line=None))
        for allow, operation, texts in (*criteria, *((None, each, [_DISCOVERED]) for each in DIRECTIONS))
    ]
    rules = []
    for allow in (False, True, None):
        listed = [each for among, each in written if among is allow]
        listed.sort(key=lambda each: each.operation is not Operation.PUBLISH)  # as the schema wants them
        if listed:
            rules.append(Rule(allow=allow is not False, domains=domains, criteria=tuple(listed), line=None))
    return Grant(
        name=name,
        subject_name=subject,
        not_before=dates[0],
        not_after=dates[1],
        rules=tuple(rules),
        default_allow=False,
        default_line=None,
        line=subject.line,
    )


MAX_RIGHTS: Final = 200
"""Rights of one enclave and direction that are computed one by one; beyond, only their number is reported."""

_EVERYWHERE: Final = (0, MAX_DOMAIN)
_DISCOVERY: Final[Region] = (Area((DISCOVERY_TOPIC,), None),)


class Taken(Struct, frozen=True, kw_only=True):
    """The grant that decides under a profile; `read` None: no grant of the document names the enclave."""

    profile: Profile
    read: ReadGrant | None


class DriftedRight(Struct, frozen=True, kw_only=True):
    """A right that one of the two gives and the other does not.

    `topic`, `partition`, `domain`: a witness. `endless`: it stands for infinitely many names, which an expression
    matches. `right`: of the policy, the one that gives it or that denies it (None: it says nothing of it). `keystore`:
    the line that gives it or that denies it. `profiles`: canonical names.
    """

    operation: Operation
    topic: str
    partition: str
    domain: int
    ros: bool
    endless: bool
    right: IntendedRight | None
    keystore: Location
    profiles: tuple[str, ...]


class DriftedRights(Struct, frozen=True, kw_only=True):
    """Rights, those that people know first; `more`: how many others there are."""

    rights: tuple[DriftedRight, ...] = ()
    more: int = 0


class _Kind(Struct, frozen=True, eq=False):
    """A way to read both sides: the grant that decides, by a row and a matcher; each is made once."""

    read: ReadGrant | None
    access: Access
    matcher: Matcher


_Step = Step[ReadRule | None]
"""A step of the policy's or the document's rules; `by` None: the default, or no grant at all."""


class Comparison:
    """A policy's grant for one enclave, compared with what a document at `place` grants it.

    `undefined`: after `compare`, expressions of the policy that
    have no meaning under a profile, with a sentence each.
    """

    def __init__(self, meant: PolicyGrant, place: str, accesses: AccessViews, domain: int | None) -> None:
        self._meant = meant
        self._place = place
        self._accesses = accesses
        self._domain = domain
        self._patterns = sorted({key[2] for key in meant.rights if has_wildcard(key[2])})
        self.undefined: list[tuple[Location, str]] = []

    def compare(
        self, taken: Sequence[Taken], governance: GovernanceFile | None, *, both: bool
    ) -> tuple[DriftedRights, DriftedRights]:
        """What the document lacks (nothing unless `both`), and what it has beyond the policy.

        Raises errors.BudgetExceeded where the classes of names are too many.
        """
        kinds = self._kinds(taken)
        domains = {kind: self._domains(kind, governance) for kind in kinds}
        differing = {kind: names for kind, names in kinds.items() if not self._plainly_same(kind, domains[kind])}
        if not differing:
            return DriftedRights(), DriftedRights()
        sides = _Sides(self._meant, list(differing), [domains[kind] for kind in differing])
        lacking, exceeding = _Found(self._place), _Found(self._place)
        for kind, names in differing.items():
            for operation in Operation:
                found = list(sides.compare(kind, operation, domains[kind]))
                if both:
                    lacking.add(sides, kind, operation, [each for each in found if each.left.allow], names)
                exceeding.add(sides, kind, operation, [each for each in found if each.right.allow], names)
        return lacking.rights(), exceeding.rights()

    def _kinds(self, taken: Sequence[Taken]) -> dict[_Kind, list[str]]:
        """The names of the profiles that read both sides alike."""
        kinds: dict[_Kind, list[str]] = {}
        by_grant: dict[tuple[int, Access, Matcher], _Kind] = {}
        for each in taken:
            row = self._accesses.row(each.profile.access)
            matcher = self._matcher(row, each.profile.access.matcher)
            if matcher is None:
                continue
            kind = by_grant.setdefault((id(each.read), row, matcher), _Kind(each.read, row, matcher))
            kinds.setdefault(kind, []).append(each.profile.name)
        return kinds

    def _matcher(self, row: Access, itself: Matcher) -> Matcher | None:
        """How the expressions of both sides are read: as the specification has it where that is the same.

        None, and noted: some expression of the policy has no meaning there.
        """
        for text in self._patterns:
            pattern = parse(text, itself)
            if pattern.undefined:
                reason = f"the policy's expression {text!r} {pattern.malformed}"
                where = next(right.location for key, right in self._meant.rights.items() if key[2] == text)
                if (where, reason) not in self.undefined:
                    self.undefined.append((where, reason))
                return None
        plain = all(parse(text, itself).agrees(parse(text, row.matcher)) for text in self._patterns)
        return row.matcher if plain else itself

    def _domains(self, kind: _Kind, governance: GovernanceFile | None) -> tuple[Interval, ...]:
        """Where it is compared: the domain that was asked for, or where the grant has rules and there is a governance.

        Another rule reports that the two have none in common, or that one has none. Then it is where the grant has
        rules, or else where there is a governance.
        """
        if self._domain is not None:
            return ((self._domain, self._domain),)
        read = self._accesses.read(governance, kind.access) if governance is not None else None
        rules = (read.domain_rules or ()) if read is not None else ()
        governed = tuple(interval for rule in rules for interval in rule.domains)
        granted = tuple(interval for rule in kind.read.rules for interval in rule.domains) if kind.read else ()
        if kind.read is not None and kind.read.default_allow:
            granted = (_EVERYWHERE,)
        common = tuple(
            (max(low, lower), min(high, upper))
            for low, high in governed
            for lower, upper in granted
            if max(low, lower) <= min(high, upper)
        )
        return common or granted or governed or (_EVERYWHERE,)

    def _plainly_same(self, kind: _Kind, domains: tuple[Interval, ...]) -> bool:
        """Whether the grant lists what the policy's grant lists, so that nothing has to be computed: the usual case."""
        if kind.read is None or kind.read.default_allow:
            return False
        rules = [rule for rule in kind.read.rules if rule.region(Operation.RELAY) or rule.of_peers or _names(rule)]
        if not all(_is_plain(rule, domains) for rule in rules):
            return False
        if any(one.allow and not two.allow for one, two in pairwise(rules)):
            return False
        return all(
            {text for rule in rules if rule.allow is allow for text in rule.texts(operation)} - {DISCOVERY_TOPIC}
            == {key[2] for key in self._meant.rights if key[:2] == (allow, operation)} - {DISCOVERY_TOPIC}
            for allow in (False, True)
            for operation in DIRECTIONS
        )


class _Sides:
    """Both rule lists of every kind, over classes that they have in common."""

    def __init__(self, meant: PolicyGrant, kinds: Sequence[_Kind], domains: Sequence[tuple[Interval, ...]]) -> None:
        self._rights = meant.rights
        self._meant = {
            kind: read_grant(meant.grant, read_rules(meant.grant, kind.access), BEGINNING, BEGINNING, kind.access)
            for kind in kinds
        }
        regions: dict[ReadRegion, None] = {}
        listing = [
            (kind.matcher, rule.region(operation))
            for kind in kinds
            for rule in (*self._meant[kind].rules, *(kind.read.rules if kind.read else ()))
            for operation in Operation
        ]
        areas = [area for _matcher, region in listing for area in region]
        # Names that a rule lists together are told apart, in other partitions only where some rule lists one.
        plain = all(area.partitions in (None, DEFAULT_PARTITION) for area in areas)
        partitions = DEFAULT_PARTITION if plain else None
        for matcher, region in listing:
            regions[matcher, _DISCOVERY] = None
            regions[matcher, region] = None
            regions.update(((matcher, (Area((text,), partitions),)), None) for area in region for text in area.topics)
        covers = [*domains, *(rule.domains for kind in kinds if kind.read for rule in kind.read.rules)]
        classes = domain_classes(covers)
        asked = [any(contains(cover, each.intervals[0][0]) for cover in domains) for each in classes]
        self.channels: Channels = build_channels(classes, asked, regions)
        self._lists = RuleLists(self.channels)
        self._compared = ~union(self._lists.region(kind.matcher, _DISCOVERY) for kind in kinds)

    def compare(
        self, kind: _Kind, operation: Operation, domains: tuple[Interval, ...]
    ) -> Iterator[Difference[ReadRule | None]]:
        """Where in these domains policy (left) and document differ; `ros_discovery_info` is left out."""
        meant = self._lists.of(self._meant[kind], operation, kind.matcher)
        granted: Iterable[_Step] = [Step(-1, False, None)]
        if kind.read is not None:
            granted = self._lists.of(kind.read, operation, kind.matcher)
        return compare(meant, list(granted), self.channels.within(domains) & self._compared)

    def right(self, kind: _Kind, operation: Operation, topic: str, step: _Step) -> IntendedRight | None:
        """The policy's right by which the step decides about the topic; None: the default."""
        text = naming(step.by.rule, operation, topic, kind.matcher) if step.by is not None else None
        return None if text is None else self._rights.get((step.allow, operation, text.text))

    def text(self, kind: _Kind, operation: Operation, topic: str, step: _Step) -> tuple[Text | None, int | None]:
        """The expression of the document by which the step decides about the topic, and the line that does."""
        if kind.read is None:
            return None, None
        grant: Grant = kind.read.grant
        if step.by is None:
            return None, grant.default_line if grant.default_line is not None else grant.line
        text = naming(step.by.rule, operation, topic, kind.matcher)
        return text, step.by.line if text is None or text.line is None else text.line


class _Found:
    """Rights found so far in one direction, each with the profiles that it was found under."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._rights: dict[tuple[Operation, str, str], tuple[DriftedRight, list[str]]] = {}
        self._more = 0

    def add(
        self,
        sides: _Sides,
        kind: _Kind,
        operation: Operation,
        found: Sequence[Difference[ReadRule | None]],
        names: Sequence[str],
    ) -> None:
        """Note what differs, found under the profiles `names`."""
        wanted = {number: each for each in found for number in members(each.channels)}
        ordered = sorted(wanted, key=lambda number: _familiarity(sides.channels, number))
        for number in islice(ordered, MAX_RIGHTS):
            meant, granted = wanted[number].left, wanted[number].right
            channel = sides.channels.channels[number]
            key = (operation, channel.topic, channel.partition)
            if key in self._rights:
                self._rights[key][1].extend(name for name in names if name not in self._rights[key][1])
                continue
            text, line = sides.text(kind, operation, channel.topic, granted)
            literal = text is not None and parse(text.text, kind.matcher).literal is not None
            right = DriftedRight(
                operation=operation,
                topic=channel.topic,
                partition=channel.partition,
                domain=sides.channels.domains[channel.domain].intervals[0][0],
                ros=channel.ros,
                endless=channel.infinite and not literal,
                right=sides.right(kind, operation, channel.topic, meant),
                keystore=Location(path=self._place, line=line),
                profiles=(),
            )
            self._rights[key] = (right, list(names))
        self._more = max(self._more, len(ordered) - MAX_RIGHTS)

    def rights(self) -> DriftedRights:
        """What was found."""
        found = tuple(replace(right, profiles=tuple(names)) for right, names in self._rights.values())
        return DriftedRights(rights=found, more=self._more)


def _familiarity(channels: Channels, number: int) -> tuple[object, ...]:
    """An order: names that people know come first."""
    channel = channels.channels[number]
    return channel.partition != "", not channel.ros, channel.topic in AMBIENT_TOPICS, channel.topic, number


def _names(rule: ReadRule) -> bool:
    """Whether it lists anything but `ros_discovery_info`."""
    return any(text != DISCOVERY_TOPIC for text in rule.texts(*DIRECTIONS))


def _is_plain(rule: ReadRule, domains: Iterable[Interval]) -> bool:
    """Whether the rule is as those of sros2: for all of the domains, in the default partition, relaying nothing."""
    if rule.relay or rule.of_peers or len(rule.domains) != 1:
        return False
    ((lowest, highest),) = rule.domains
    if any(low < lowest or highest < high for low, high in domains):
        return False
    partitions = {area.partitions for operation in DIRECTIONS for area in rule.region(operation)}
    return partitions <= {DEFAULT_PARTITION} | (set() if rule.allow else {None})
