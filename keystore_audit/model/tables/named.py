"""The names that a keystore's documents tell apart, each class by a witness, for tables that people read.

Unlike channels (`model.channels`), names are not merged where no rule tells them apart: a topic that a document lists
keeps a place of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import MAX_CELLS
from keystore_audit.model.matching.patterns import Patterns
from keystore_audit.profiles import Access


class Named(Struct, frozen=True, kw_only=True):
    """The topic names of one class, in a class of partitions.

    `topic`: one of them, the only one unless there are `several`. `ros`: whether ROS 2 can produce one. `expressions`:
    those with wildcards in permissions that match it, longest first. `partition`: one of the names that are alike.
    """

    topic: str
    partition: str
    ros: bool
    several: bool
    expressions: tuple[str, ...]


class Names(Struct, frozen=True, kw_only=True):
    """All names. `rest`: the place of the class that the fewest expressions match, of whatever no document lists."""

    names: tuple[Named, ...]
    rest: int


def names_of(read: Mapping[Access, Sequence[ReadDocument]], most: int = MAX_CELLS) -> Names:
    """The classes of all topic names in all partitions, for documents as implementations of each access row read them.

    `most`: pairs of both, those of the default partition apart. Raises errors.BudgetExceeded where they are more.
    """
    topics, partitions = Patterns(), Patterns(topics=False)
    granted: dict[int, str] = {}
    for matcher, document in ((access.matcher, document) for access, several in read.items() for document in several):
        for domain_rule in document.domain_rules or ():
            for topic_rule in domain_rule.topic_rules:
                for text in (text for area in topic_rule.region for text in area.topics):
                    topics.number(text, matcher)
        for grant in document.grants or ():
            for area in (area for rule in grant.rules for area in (*rule.publish, *rule.subscribe, *rule.relay)):
                for text in area.topics:
                    granted.setdefault(topics.number(text, matcher), text)
                for text in area.partitions or ():
                    partitions.number(text, matcher)
    classes = topics.classes()
    wildcards = {number: text for number, text in granted.items() if topics.patterns[number].literal is None}
    others: list[str] = []
    if any(pattern.literal != "" for pattern in partitions.patterns):
        others = [each.witness for each in partitions.classes()]
    if len(classes) * (1 + len(others)) > MAX_CELLS or len(classes) * len(others) > most:
        message = f"{len(classes)} topic classes in {1 + len(others)} partition classes are more than can be shown."
        raise BudgetExceeded(message)
    names = tuple(
        Named(
            topic=each.witness,
            partition=partition,
            ros=each.ros,
            several=all(topics.patterns[member].literal is None for member in each.members),
            expressions=tuple(
                sorted({wildcards[n] for n in each.members if n in wildcards}, key=lambda text: (-len(text), text))
            ),
        )
        for partition in ("", *others)
        for each in classes
    )
    rest = min(range(len(classes)), key=lambda n: (not classes[n].infinite, len(classes[n].members), n))
    return Names(names=names, rest=rest)
