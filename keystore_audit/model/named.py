"""The names that a keystore's documents tell apart, each class by a witness, for tables that people read.

Unlike channels (`model.channels`), names are not merged where no rule tells them apart: a topic that a document lists
keeps a place of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from keystore_audit.dataclass import dataclass
from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import MAX_CELLS
from keystore_audit.model.expression import Matcher, Pattern, parse
from keystore_audit.model.matching.patterns import classes_of
from keystore_audit.model.semantics import Area


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """The topic names of one class, in a class of partitions.

    `topic`: one of them, the only one unless there are `several`. `ros`: whether ROS 2 can produce one. `expressions`:
    those with wildcards in permissions that match it, longest first. `partition`: one of the names that are alike.
    """

    topic: str
    partition: str
    ros: bool
    several: bool
    expressions: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """All names. `rest`: the place of the class that the fewest expressions match, of whatever no document lists."""

    names: tuple[Named, ...]
    rest: int


def names_of(read: Iterable[tuple[Matcher, ReadDocument]], most: int = MAX_CELLS) -> Names:
    """The classes of all topic names in all partitions, for documents as implementations read them.

    `most`: pairs of both, those of the default partition apart. Raises errors.BudgetExceeded where they are more.
    """
    topics, partitions = _Expressions(), _Expressions()
    for matcher, document in read:
        for domain_rule in document.domain_rules or ():
            for topic_rule in domain_rule.topic_rules:
                for area in topic_rule.region:
                    topics.add(area.topics, matcher, granted=False)
        for grant in document.grants or ():
            for rule in grant.rules:
                for area in (*rule.publish, *rule.subscribe, *rule.relay):
                    _add(area, matcher, topics, partitions)
    classes = classes_of(topics.patterns)
    others: list[str] = []
    if any(pattern.literal != "" for pattern in partitions.patterns):
        others = [each.witness for each in classes_of(partitions.patterns, topics=False)]
    if len(classes) * (1 + len(others)) > MAX_CELLS or len(classes) * len(others) > most:
        message = f"{len(classes)} topic classes in {1 + len(others)} partition classes are more than can be shown."
        raise BudgetExceeded(message)
    names = tuple(
        Named(
            topic=each.witness,
            partition=partition,
            ros=each.ros,
            several=all(topics.patterns[member].literal is None for member in each.members),
            expressions=topics.wildcards(each.members),
        )
        for partition in ("", *others)
        for each in classes
    )
    rest = min(range(len(classes)), key=lambda n: (not classes[n].infinite, len(classes[n].members), n))
    return Names(names=names, rest=rest)


def _add(area: Area, matcher: Matcher, topics: _Expressions, partitions: _Expressions) -> None:
    topics.add(area.topics, matcher, granted=True)
    partitions.add(area.partitions or (), matcher, granted=True)


class _Expressions:
    """Expressions of one sort of name, each meaning once."""

    def __init__(self) -> None:
        self.patterns: list[Pattern] = []
        self._numbers: dict[object, int] = {}
        self._known: dict[tuple[str, Matcher], int] = {}
        self._granted: dict[int, str] = {}

    def add(self, texts: Iterable[str], matcher: Matcher, *, granted: bool) -> None:
        """Expressions of permissions (`granted`) or of a governance."""
        for text in texts:
            number = self._known.get((text, matcher))
            if number is None:
                pattern = parse(text, matcher)
                number = self._numbers.setdefault(pattern.meaning, len(self.patterns))
                if number == len(self.patterns):
                    self.patterns.append(pattern)
                self._known[text, matcher] = number
            if granted and self.patterns[number].literal is None:
                self._granted.setdefault(number, text)

    def wildcards(self, members: Sequence[int] | frozenset[int]) -> tuple[str, ...]:
        """The texts of those among the numbers that are expressions of permissions with wildcards."""
        found = {self._granted[number] for number in members if number in self._granted}
        return tuple(sorted(found, key=lambda text: (-len(text), text)))
