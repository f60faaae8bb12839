"""Labels in settings (`[lattice]`, `[[label]]`, `[[declassifier]]`, `[[endorser]]`) and `single_writer`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from msgspec import Meta, field

from keystore_audit.findings import Severity
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import (
    Claim,
    CyclicOrder,
    Declassifier,
    Labelled,
    Labelling,
    Lattice,
    chain,
    ordered,
    powerset,
    turned,
)
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.settings.document import (
    Enclaves,
    Source,
    Table,
    Text,
    Topics,
    Word,
    dds_topic,
    dds_topics,
    instant,
    several,
)

if TYPE_CHECKING:
    from keystore_audit.settings.settings import SettingsTable

MAX_LABELS: Final = 100
"""Of a lattice: nobody keeps more apart."""

NO_CATEGORY: Final = "no category"
"""The label without any."""

Words = Word | Annotated[list[Word], Meta(min_length=1, max_length=MAX_LABELS)]
"""Names of labels or categories."""

Label = Text | list[Text]
"""A label by its name, or as a set of categories."""


class LatticeTable(Table, frozen=True, kw_only=True):
    """The `[lattice]`: which labels there are, in one of three forms."""

    preset: Literal["bell-lapadula", "biba"] = "bell-lapadula"
    levels: Words | None = None
    categories: Words | None = None
    order: Annotated[dict[Word, Word | list[Word]], Meta(min_length=1, max_length=MAX_LABELS)] | None = None
    severity: Severity = Severity.HIGH
    attacker: Literal["relays", "source", "honest"] = "relays"
    include_ambient: bool = False
    until: Any = None


class LabelTable(Table, frozen=True, kw_only=True):
    """A `[[label]]`."""

    label: Label
    enclaves: Enclaves | None = None
    topics: Topics | None = None


class DeclassifierTable(Table, frozen=True, kw_only=True):
    """A `[[declassifier]]` or an `[[endorser]]`."""

    enclaves: Enclaves
    taken: Label = field(name="from")
    given: Label = field(name="to")


def read_labels(root: SettingsTable, source: Source) -> Labelling | None:
    """What the file says of labels, None: nothing. Raises errors.UsageError."""
    trusting = {"declassifier": root.declassifier, "endorser": root.endorser}
    table, here = root.lattice, source.at("lattice")
    if table is None:
        for key, tables in ({"label": root.label} | trusting).items():
            if tables:
                source.at(key).wrong(f"expected a [lattice] beside {key}: which labels there are, and in which order")
        return None
    names = _Names(table, here)
    labelled = tuple(_labelled(each, source.at("label", number), names) for number, each in enumerate(root.label))
    declassifiers = tuple(
        _declassifier(each, source.at(key, number), names)
        for key, tables in trusting.items()
        for number, each in enumerate(tables)
    )
    used = {one.label for one in labelled} | {label for one in declassifiers for label in (one.taken, one.given)}
    if len(used) < 2:
        here.wrong(f"expected two labels in use at least, found {len(used)}: nothing would be compared")
    lattice = names.lattice or powerset(names.sets)
    return Labelling(
        lattice=turned(lattice) if table.preset == "biba" else lattice,
        labelled=labelled,
        declassifiers=declassifiers,
        attacker=Attacker(table.attacker),
        include_ambient=table.include_ambient,
        severity=table.severity,
        until=instant(table.until, here.at("until")),
        location=here.location,
        place=here.place,
    )


class _Names:
    """The labels of a lattice, by what they are called; of `categories`, the `sets` that were asked for."""

    def __init__(self, table: LatticeTable, source: Source) -> None:
        forms = ("levels", "categories", "order")
        said = [form for form in forms if getattr(table, form) is not None]
        if len(said) != 1:
            source.wrong(f"expected exactly one of {', '.join(forms)}, found {len(said)}")
        self._categories = several(table.categories)
        self.sets: dict[str, tuple[str, ...]] = {}
        self.lattice: Lattice | None = None
        if table.order is not None:
            self.lattice = _order({label: several(lower) for label, lower in table.order.items()}, source.at("order"))
            return
        words = several(table.levels or self._categories)
        for number, word in enumerate(words):
            if word in words[:number]:
                source.at(said[0]).wrong(f"{word!r} stands here twice: expected each once")
        self.lattice = chain(words) if table.levels is not None else None

    def named(self, label: Label, source: Source) -> str:
        """The label that is written so; none of the categories in an empty array."""
        if self.lattice is None:
            for category in several(label):
                if category not in self._categories:
                    source.wrong(f"{category!r} is no category; expected some of {', '.join(self._categories)}")
            categories = tuple(sorted(set(several(label)), key=self._categories.index))
            name = ", ".join(categories) or NO_CATEGORY
            self.sets[name] = categories
            return name
        if not isinstance(label, str) or label not in self.lattice:
            source.wrong(f"{label!r} is no label of the lattice; expected {', '.join(self.lattice)}")
        return label


def _labelled(table: LabelTable, source: Source, names: _Names) -> Labelled:
    if table.enclaves is None and table.topics is None:
        source.wrong("expected enclaves or topics: what has the label")
    return Labelled(
        label=names.named(table.label, source.at("label")),
        enclaves=several(table.enclaves),
        topics=dds_topics(table.topics or ()),
        place=source.place,
        marks=source.marks(table),
    )


def _declassifier(table: DeclassifierTable, source: Source, names: _Names) -> Declassifier:
    return Declassifier(
        enclaves=several(table.enclaves),
        taken=names.named(table.taken, source.at("from")),
        given=names.named(table.given, source.at("to")),
        place=source.place,
        marks=source.marks(table),
    )


def _order(below: Mapping[str, tuple[str, ...]], source: Source) -> Lattice:
    """Labels with those directly below each."""
    for label, lower in below.items():
        for one in lower:
            if one not in below:
                source.at(label).wrong(f"{one!r} is no label of this order; expected {one} = [...] beside it")
    try:
        return ordered(below)
    except CyclicOrder as cycle:
        way = " below ".join(map(repr, reversed((*cycle.labels, cycle.labels[0]))))
        source.at(cycle.labels[0]).wrong(f"{way}: expected an order without cycles")


def single_writers(topics: Topics | None, source: Source) -> Iterator[Claim]:
    """The topics of which one enclave alone may be the publisher. Raises errors.UsageError."""
    ids: set[str] = set()
    for topic in several(topics):
        if has_wildcard(topic):
            source.wrong(f'{topic!r} has wildcards: expected one topic each, e.g. "/cmd_vel"')
        claim_id = f"single-writer-{re.sub('[^a-z0-9]+', '-', topic.lower()).strip('-')}"
        if claim_id in ids:
            claim_id = f"{claim_id}-{len(ids) + 1}"
        ids.add(claim_id)
        yield Claim(
            id=claim_id,
            statement=f"No more than one enclave may publish {topic}.",
            kind=ClaimKind.ONLY_PUBLISH,
            attacker=Attacker.INSIDER,
            source=Globs(),
            target=Globs(topics=(dds_topic(topic),)),
            include_ambient=True,
            location=source.location,
            place=source.place,
        )
