"""Classes of ROS 2 names by which expressions match the DDS topics that are made of them.

A service or an action is several DDS topics, each a prefix, the ROS name and a suffix (`names.dds_channels`). It can be
used only if all of them can. So the automaton of the expressions is walked here with several names in step. There is
one for every prefix, over the same ROS name, and each has its suffix at the end. What decides about every
one of the topics is then constant on a class, and one evaluation per class is exact for all ROS names.
"""

from __future__ import annotations

import string
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import AuditError, BudgetExceeded
from keystore_audit.intent.intent import is_ros_name
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import Channels, ReadRegion, domain_covers
from keystore_audit.model.domains import contains, domain_classes
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import ChannelAtom
from keystore_audit.model.matching.alphabet import DEAD, Alphabet, Budget, Universe, ros_alphabet
from keystore_audit.model.matching.atoms import residual_names
from keystore_audit.model.matching.automaton import STATE_UNITS, Automaton
from keystore_audit.model.matching.expression import Pattern, any_matches
from keystore_audit.model.matching.patterns import Patterns
from keystore_audit.model.matching.tokens import Token
from keystore_audit.model.names import (
    ACTION_PART,
    ACTION_TOPICS,
    REPLY_PREFIX,
    REPLY_SUFFIX,
    REQUEST_PREFIX,
    REQUEST_SUFFIX,
    TOPIC_PREFIX,
)
from keystore_audit.model.semantics import CHECKED_TOGETHER, DIRECTIONS
from keystore_audit.profiles import Access, Matcher

DEFAULT_BUDGET: Final = 10_000
"""States of the automaton and of its walks in step, together: about half a second. What people write needs 1,000."""

_Set = frozenset[int]


class Affix(NamedTuple):
    """What a DDS topic has before and behind the ROS name: `rq` and `Request`."""

    prefix: str
    suffix: str

    def topic(self, name: str) -> str:
        """The DDS topic of the ROS name."""
        return self.prefix + name + self.suffix

    def name(self, topic: str) -> str | None:
        """The ROS name of which `topic` is made, None where it is made of none."""
        if not topic.endswith(self.suffix) or not topic.startswith(self.prefix):
            return None
        end = len(topic) - len(self.suffix)
        name = topic[len(self.prefix) : end] if end >= len(self.prefix) else ""
        return name if is_ros_name(name) else None

    def between(self, texts: Iterable[str]) -> set[str]:
        """What stands between the two in these expressions, from the slash on, whether or not it is a name."""
        begin, end = f"{self.prefix}/", -len(self.suffix)
        return {text[len(self.prefix) : end] for text in texts if text.startswith(begin) and text.endswith(self.suffix)}


REQUEST: Final = Affix(REQUEST_PREFIX, REQUEST_SUFFIX)
REPLY: Final = Affix(REPLY_PREFIX, REPLY_SUFFIX)
OF_ACTIONS: Final = tuple(Affix(TOPIC_PREFIX, ACTION_PART + topic) for topic in ACTION_TOPICS)
"""The topics of an action."""


class RosClass(Struct, frozen=True, kw_only=True):
    """All fully qualified ROS names with the same matches; `name` is a short one of them.

    `members`: for each affix, the expressions (indices into what was classified) that match the topic.
    """

    name: str
    members: tuple[frozenset[int], ...]


def classify_ros_names(
    patterns: Sequence[Pattern], affixes: Sequence[Affix], *, budget: int = DEFAULT_BUDGET
) -> tuple[RosClass, ...]:
    """Return the classes of all fully qualified ROS names, in the order of their names.

    Every name that an expression without wildcards gives with one of the `affixes` is a class of its own. Raises
    BudgetExceeded where the classes are too many; there is no partial answer.
    """
    return _Classification(patterns, affixes, budget).classes()


class _Classification:
    """The classes in the making."""

    def __init__(self, patterns: Sequence[Pattern], affixes: Sequence[Affix], budget: int) -> None:
        self._affixes = affixes
        self._budget = Budget(
            STATE_UNITS * budget,
            f"{len(patterns)} expressions need more than {budget} states to be told apart over ROS names",
        )
        self._literals: dict[str, list[int]] = {}
        wildcards: dict[tuple[Token, ...], list[int]] = {}
        for number, pattern in enumerate(patterns):
            if pattern.literal is None:
                wildcards.setdefault(pattern.tokens, []).append(number)
            else:
                self._literals.setdefault(pattern.literal, []).append(number)
        self._numbers = list(wildcards.values())
        self._wildcards = [patterns[numbers[0]] for numbers in self._numbers]
        alphabet = ros_alphabet(wildcards, self._budget)
        automaton = Automaton(list(wildcards), alphabet, self._budget)
        self._walk = _InStep(automaton, len(wildcards), affixes, self._budget)
        self._universe = _full_names(alphabet)

    def classes(self) -> tuple[RosClass, ...]:
        """All classes."""
        names = {affix.name(topic) for topic in self._literals for affix in self._affixes} - {None}
        literal = {name: self._walk.of_name(name) for name in names if name is not None}
        found = [RosClass(name=name, members=self._members(accepted, name)) for name, accepted in literal.items()]
        for accepted, name in residual_names(self._walk, self._universe, self._budget, literal).items():
            self._verify(name, accepted)
            found.append(RosClass(name=name, members=self._members(accepted, None)))
        return tuple(sorted(found, key=lambda each: each.name))

    def _members(self, accepted: _Set, literal: str | None) -> tuple[_Set, ...]:
        """By affix: the patterns that the numbers stand for, and those that are the topic itself."""
        members: list[set[int]] = [set() for _ in self._affixes]
        for number in accepted:
            place, wildcard = divmod(number, len(self._wildcards))
            members[place].update(self._numbers[wildcard])
        if literal is not None:
            for place, affix in enumerate(self._affixes):
                members[place].update(self._literals.get(affix.topic(literal), ()))
        return tuple(map(frozenset, members))

    def _verify(self, name: str, accepted: _Set) -> None:
        """Asks the patterns themselves; raises AuditError where they contradict the automaton."""
        self._budget.spend(len(self._wildcards) // 8)
        for place, affix in enumerate(self._affixes):
            topic = affix.topic(name)
            for number, pattern in enumerate(self._wildcards, place * len(self._wildcards)):
                if pattern.matches(topic) != (number in accepted):
                    raise AuditError(
                        f"keystore-audit contradicts itself about whether {pattern.text!r} matches {topic!r}; please "
                        "report this"
                    )


class _InStep:
    """The automaton, walked with one name for every affix: its states are tuples of states.

    `accepts`: place of the affix × number of expressions + expression, for all that match at the end of the suffix.
    """

    def __init__(self, automaton: Automaton, expressions: int, affixes: Sequence[Affix], budget: Budget) -> None:
        self._automaton = automaton
        self._expressions = expressions
        self._affixes = affixes
        self._budget = budget
        self.alphabet = automaton.alphabet
        self.accepts: list[_Set] = []
        self._states: list[tuple[int, ...]] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        self._moves: dict[int, tuple[Mapping[int, int], int]] = {}
        self._ends: dict[tuple[int, str], _Set] = {}
        self._target(tuple(automaton.walk(affix.prefix) for affix in affixes))

    def of_name(self, name: str) -> _Set:
        """What `accepts` has for the name."""
        return self._accepted(tuple(self._automaton.walk(affix.prefix + name) for affix in self._affixes))

    def moves(self, state: int) -> tuple[Mapping[int, int], int]:
        """The next state by character class, and that of every class that is not named."""
        known = self._moves.get(state)
        if known is None:
            rows = [self._automaton.moves(each) for each in self._states[state]]
            named = {number for by_class, _default in rows for number in by_class}
            default = self._target(tuple(default for _by_class, default in rows))
            targets = {
                number: self._target(tuple(by_class.get(number, default) for by_class, default in rows))
                for number in named
            }
            known = self._moves[state] = targets, default
        return known

    def _target(self, states: tuple[int, ...]) -> int:
        number = self._numbers.get(states)
        if number is None:
            self._budget.spend(len(states))
            number = self._numbers[states] = len(self._states)
            self._states.append(states)
            self.accepts.append(self._accepted(states))
        return number

    def _accepted(self, states: Iterable[int]) -> _Set:
        return frozenset(
            place * self._expressions + number
            for place, (state, affix) in enumerate(zip(states, self._affixes, strict=True))
            for number in self._at_end(state, affix.suffix)
        )

    def _at_end(self, state: int, suffix: str) -> _Set:
        """The expressions that match where the suffix is read from the state on."""
        known = self._ends.get((state, suffix))
        if known is None:
            at = state
            for character in suffix:
                by_class, default = self._automaton.moves(at)
                at = by_class.get(self.alphabet.class_of(character), default)
            known = self._ends[state, suffix] = self._automaton.accepts[at]
        return known


def _full_names(alphabet: Alphabet) -> Universe:
    """Fully qualified ROS names (`names.is_ros_name`): behind nothing, behind a slash, within a token."""
    slash = alphabet.class_of("/")
    starts = {alphabet.class_of(character) for character in string.ascii_letters + "_"}
    digits = {alphabet.class_of(character) for character in string.digits}
    return Universe(
        classes=sorted({slash} | starts | digits),
        accepting=(False, False, True),
        moves=(
            ({slash: 1}, DEAD),
            (dict.fromkeys(starts, 2), DEAD),
            ({slash: 1, **dict.fromkeys(starts | digits, 2)}, DEAD),
        ),
    )


# The DDS topics that are made of ROS names, as channels: what decides about them is the same as for all others.


MAX_CHANNELS: Final = 200_000
"""Classes × affixes × domain classes of one enclave: a second; 5,000 services in two domains take a tenth."""


class RosChannels(Struct, frozen=True, kw_only=True):
    """Channels for every class of ROS names, with each of the affixes, in the default partition.

    `starts`: by governed domain class, its first channel; from there on all classes with the first affix, then all with
    the second. `unmarked`: the classes (bit set) whose names no mark matches. By operation, of allow rules: `literals`
    are the expressions, `numbers` those with their numbers among the members of classes.
    """

    channels: Channels
    classes: tuple[RosClass, ...]
    affixes: tuple[Affix, ...]
    starts: tuple[int, ...]
    unmarked: int
    literals: Mapping[Operation, frozenset[str]]
    numbers: Mapping[Operation, frozenset[tuple[str, int]]]

    def of_affix(self, affix: Affix) -> int:
        """The place of the first channel with the affix, counted from a start."""
        return self.affixes.index(affix) * len(self.classes)

    def by_class(self, channels: int, start: int, place: int) -> int:
        """The channels that have the affix of `place`, as a bit set of classes."""
        return channels >> (start + place) & ((1 << len(self.classes)) - 1)

    def listed(self, operation: Operation, affix: Affix) -> int:
        """The classes whose topic is listed by name for the operation."""
        listed = self.literals[operation]
        return bits(number for number, each in enumerate(self.classes) if affix.topic(each.name) in listed)

    def naming(self, operation: Operation, affix: Affix, part: str) -> int:
        """The classes whose topic an expression with `part` in it lists for the operation."""
        place = self.affixes.index(affix)
        numbers = frozenset(number for text, number in self.numbers[operation] if part in text)
        return bits(n for n, each in enumerate(self.classes) if not numbers.isdisjoint(each.members[place]))

    def is_literal(self, number: int) -> bool:
        """Whether the class is a name that is listed with some affix."""
        name = self.classes[number].name
        return any(affix.topic(name) in listed for affix in self.affixes for listed in self.literals.values())


def ros_channels(
    read: Mapping[Access, Sequence[ReadDocument]], affixes: Sequence[Affix], marks: Iterable[str] = ()
) -> RosChannels:
    """The channels that these documents tell apart, as implementations of each access row read them.

    `marks`: POSIX expressions for topics with the first affix. Raises errors.BudgetExceeded where there are too many.
    """
    patterns = Patterns()
    marking = {patterns.number(mark, Matcher.POSIX) for mark in marks}
    regions: dict[ReadRegion, None] = {}
    for access, documents in read.items():
        for document in documents:
            for topic_rule in (each for rule in document.domain_rules or () for each in rule.topic_rules):
                regions[access.matcher, topic_rule.region] = None
            for rule in (rule for grant in document.grants or () for rule in grant.rules):
                together = CHECKED_TOGETHER[access.topic_check]
                for region in (rule.publish, rule.subscribe, *map(rule.listed, together)):
                    regions[access.matcher, region] = None
    for matcher, region in regions:
        for text in (text for area in region for text in area.topics):
            patterns.number(text, matcher)
    classes = classify_ros_names(patterns.patterns, affixes)
    governed, ruled = domain_covers(read)
    domains = domain_classes([*governed, *ruled])
    covered = [n for n, atom in enumerate(domains) if any(contains(each, atom.intervals[0][0]) for each in governed)]
    if len(classes) * len(affixes) * len(covered) > MAX_CHANNELS:
        raise BudgetExceeded(f"{len(classes)} classes of ROS names are too many in {len(covered)} classes of domains.")
    topics = [(affix.topic(each.name), affix) for affix in affixes for each in classes]
    in_domain: list[range] = []
    for number in range(len(domains)):
        start = in_domain[-1].stop if in_domain else 0
        in_domain.append(range(start, start + (len(topics) if number in covered else 0)))
    starts = tuple(here.start for here in in_domain if here)
    marked = bits(n for n, each in enumerate(classes) if not marking.isdisjoint(each.members[0]))
    return RosChannels(
        channels=Channels(
            domains=domains,
            channels=tuple(
                ChannelAtom(domain=domain, topic=topic, partition="", ros=True, infinite=False)
                for domain in covered
                for topic, _affix in topics
            ),
            regions=_found(regions, patterns, classes, affixes, starts),
            in_domain=tuple(in_domain),
        ),
        classes=classes,
        affixes=tuple(affixes),
        starts=starts,
        unmarked=(1 << len(classes)) - 1 & ~marked,
        literals={each: frozenset(text for text, _matcher in _allowed(read, each)) for each in DIRECTIONS},
        numbers={
            each: frozenset((text, patterns.number(text, matcher)) for text, matcher in _allowed(read, each))
            for each in DIRECTIONS
        },
    )


def _allowed(read: Mapping[Access, Sequence[ReadDocument]], operation: Operation) -> Iterator[tuple[str, Matcher]]:
    """What allow rules list."""
    for access, documents in read.items():
        for document in documents:
            for rule in (rule for grant in document.grants or () for rule in grant.rules if rule.allow):
                yield from ((text, access.matcher) for text in rule.texts(operation))


def _found(
    regions: Iterable[ReadRegion],
    patterns: Patterns,
    classes: Sequence[RosClass],
    affixes: Sequence[Affix],
    starts: Sequence[int],
) -> dict[ReadRegion, frozenset[int]]:
    """The channels of each region: those in the default partition."""
    places: list[list[int]] = [[] for _ in patterns.patterns]
    for at, each in enumerate(classes):
        for affix in range(len(affixes)):
            for pattern in each.members[affix]:
                places[pattern].append(affix * len(classes) + at)
    found = {}
    for named in regions:
        matcher, region = named
        matched = {
            place
            for area in region
            if area.partitions is None or any_matches(area.partitions, "", matcher)
            for text in area.topics
            for place in places[patterns.number(text, matcher)]
        }
        found[named] = frozenset(start + place for start in starts for place in matched)
    return found
