"""Columns: the pairs of a topic class and a partition class that no region tells apart, merged.

Classes that the same areas list are one block, so that as many topics in as many partitions of one rule are one pair.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import product
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.matching.atoms import TopicClass

MAX_PAIRS: Final = 400_000
"""Most pairs of a block of topics and one of partitions, without those of the first partitions: 0.5 s and 50 MB.
200 topics each in 20 partitions have 4,000; 600 topics each in a partition of its own have 360,000."""

MAX_MEETINGS: Final = 1_000_000
"""Pairs of such pairs for which it is computed whether endpoints of one are met in the other: half a second."""

Shape = tuple[tuple[tuple[int, ...], "tuple[int, ...] | None", bool], ...]
"""A region by what its expressions mean: of each area the numbers of topic and of partition patterns, and `every`."""

Block = tuple[Sequence[int], Sequence[int]]
"""Classes of partitions and of topics, ascending: all pairs of them."""


class Cell(NamedTuple):
    """A class of topics in a class of partitions, by one name each. `infinite`: it holds infinitely many."""

    topic: str
    partition: str
    infinite: bool


class Column(Struct, frozen=True):
    """One merged set of (topic class, partition class) pairs: the shapes that hold it, and its witness."""

    hits: tuple[int, ...]
    topic: TopicClass
    partition: str
    infinite: bool
    blocks: Sequence[Block] = ()  # of the classes below
    topics: Sequence[TopicClass] = ()
    partitions: Sequence[TopicClass] = ()

    def named(self) -> list[Cell]:
        """What was merged."""
        return [
            Cell(
                self.topics[topic].witness,
                self.partitions[partition].witness,
                self.topics[topic].infinite or self.partitions[partition].infinite,
            )
            for partition, topic in sorted(pair for block in self.blocks for pair in product(*block))
        ] or [Cell(self.topic.witness, self.partition, infinite=False)]


Table = tuple[list[Column], dict[int, frozenset[int]]]
"""Columns, and which of them meet which others."""


class Columns:
    """The columns of some shapes, in the making.

    `topics_of`, `partitions_of`: by pattern, the classes that it matches. `met_by`: by partition class, the others with
    endpoints that are met in it, in regions that one of the shapes `allowing` lists (None: anywhere). What a pair is
    met by is part of what tells it apart: rights in one column mean one thing then.
    """

    def __init__(
        self,
        shapes: Iterable[tuple[Shape, int]],
        topics_of: Sequence[Sequence[int]],
        partitions_of: Sequence[Sequence[int]],
        met_by: Mapping[int, Sequence[int]],
        allowing: Set[int] | None,
    ) -> None:
        self._allowing = allowing
        self._shape: list[int] = []  # by area
        self._anywhere: list[bool] = []
        self._topics: dict[int, list[int]] = {}
        self._partitions: dict[int, list[int]] = {}
        for shape, number in shapes:
            for topics, partitions, _every in shape:
                area = len(self._shape)
                self._shape.append(number)
                self._anywhere.append(partitions is None)
                for topic in {topic for pattern in topics for topic in topics_of[pattern]}:
                    self._topics.setdefault(topic, []).append(area)
                for partition in {partition for pattern in partitions or () for partition in partitions_of[pattern]}:
                    self._partitions.setdefault(partition, []).append(area)
        self._met_by = met_by
        self._signatures: dict[tuple[int, ...], int] = {}

    def table(self, topics: Sequence[TopicClass], partitions: Sequence[TopicClass]) -> Table:
        """All columns. Raises errors.BudgetExceeded where they are too many."""
        topic_blocks = _blocks(tuple(self._topics.get(topic, ())) for topic in range(len(topics)))
        partition_blocks = _blocks(
            (tuple(self._partitions.get(each, ())), tuple(self._met_by.get(each, ())))
            for each in range(len(partitions))
        )
        _check(len(topic_blocks) * (len(partition_blocks) - 1), MAX_PAIRS, "pairs of topics and partitions")
        block_of = {each: number for number, block in enumerate(partition_blocks) for each in block}
        meeting = [sorted({block_of[other] for other in self._met_by.get(block[0], ())}) for block in partition_blocks]
        _check(len(topic_blocks) * sum(map(len, meeting)), MAX_MEETINGS, "pairs of partitions that meet")
        rows = self._rows(topic_blocks, partition_blocks)
        opens = [self._allowing is None or not self._allowing.isdisjoint(shapes) for shapes in self._signatures]
        found: dict[tuple[int, frozenset[int]], list[Block]] = {}
        numbers: dict[tuple[int, frozenset[int]], int] = {}
        places: list[list[int]] = []
        for row, partition_block, met in zip(rows, partition_blocks, meeting, strict=True):
            at = []
            for number, (signature, topic_block) in enumerate(zip(row, topic_blocks, strict=True)):
                others = _NOTHING_MET
                if met:
                    others = frozenset(rows[other][number] for other in met if opens[rows[other][number]]) - {signature}
                found.setdefault((signature, others), []).append((partition_block, topic_block))
                at.append(numbers.setdefault((signature, others), len(numbers)))
            places.append(at)
        hits = list(self._signatures)
        best = {
            block[0]: min(block, key=lambda n: (not topics[n].ros, topics[n].infinite, n)) for block in topic_blocks
        }
        columns = [
            _column(hits[signature], blocks, best, topics, partitions) for (signature, _), blocks in found.items()
        ]
        return columns, _met_columns(rows, places, meeting, opens)

    def _rows(
        self, topic_blocks: Sequence[Sequence[int]], partition_blocks: Sequence[Sequence[int]]
    ) -> list[list[int]]:
        """By block of partitions, then of topics: the number of the signature, which are the shapes that list both."""
        everywhere: list[list[int]] = []
        listing: dict[int, list[int]] = {}
        for number, block in enumerate(topic_blocks):
            areas = self._topics.get(block[0], ())
            everywhere.append([self._shape[area] for area in areas if self._anywhere[area]])
            for area in areas:
                listing.setdefault(area, []).append(number)
        plain = [self._signature(shapes) for shapes in everywhere]
        rows: list[list[int]] = []
        for block in partition_blocks:
            more: dict[int, list[int]] = {}
            for area in self._partitions.get(block[0], ()):
                for number in listing.get(area, ()):
                    more.setdefault(number, []).append(self._shape[area])
            row = plain.copy()
            for number, shapes in more.items():
                row[number] = self._signature(everywhere[number] + shapes)
            rows.append(row)
        return rows

    def _signature(self, shapes: Iterable[int]) -> int:
        return self._signatures.setdefault(tuple(sorted({*shapes})), len(self._signatures))


_NOTHING_MET: Final = frozenset[int]()


def _met_columns(
    rows: Sequence[Sequence[int]],
    places: Sequence[Sequence[int]],
    meeting: Iterable[Iterable[int]],
    opens: Sequence[bool],
) -> dict[int, frozenset[int]]:
    """By column, those in which its endpoints are met.

    `rows`, `places`: by block of partitions, then of topics, the signature and the column. `meeting`: by block of
    partitions, those whose endpoints are met in it. `opens`: by signature, whether there may be endpoints.
    """
    meets: dict[int, set[int]] = {}
    for at, met in zip(places, meeting, strict=True):
        for other in met:
            for column, one, signature in zip(at, places[other], rows[other], strict=True):
                if column != one and opens[signature]:
                    meets.setdefault(one, set()).add(column)
    return {column: frozenset(others) for column, others in meets.items()}


def _blocks(listed: Iterable[object]) -> list[list[int]]:
    """The numbers of equal items, in the order of the first of each."""
    blocks: dict[object, list[int]] = {}
    for number, each in enumerate(listed):
        blocks.setdefault(each, []).append(number)
    return list(blocks.values())


def _check(count: int, most: int, words: str) -> None:
    if count > most:
        raise BudgetExceeded(f"{count} {words} are more than can be told apart (limit {most}).")


def _column(
    hits: tuple[int, ...],
    blocks: Sequence[Block],
    best: Mapping[int, int],
    topics: Sequence[TopicClass],
    partitions: Sequence[TopicClass],
) -> Column:
    """The column of these blocks, with the witness that a person reads most easily: of `best`, by first topic."""
    pairs = [(listed[0], best[named[0]]) for listed, named in blocks]
    partition, topic = min(
        pairs, key=lambda pair: (pair[0] != 0, not topics[pair[1]].ros, topics[pair[1]].infinite, pair)
    )
    several = len(blocks) > 1 or len(blocks[0][0]) * len(blocks[0][1]) > 1
    return Column(
        hits=hits,
        topic=topics[topic],
        partition=partitions[partition].witness,
        infinite=several or topics[topic].infinite or partitions[partition].infinite,
        blocks=blocks,
        topics=topics,
        partitions=partitions,
    )
