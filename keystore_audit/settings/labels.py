"""Labels in settings (`[lattice]`, `[[label]]`, `[[declassifier]]`, `[[endorser]]`) and `single_writer`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

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
)
from keystore_audit.model.formal.claim import Attacker, ClaimKind
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.settings.table import WORD, Table, dds_topic

KEYS: Final = ("lattice", "label", "declassifier", "endorser", "single_writer")
"""Of the file."""

BELL_LAPADULA: Final = "bell-lapadula"
BIBA: Final = "biba"

NO_CATEGORY: Final = "no category"
"""The label without any."""

MAX_LABELS: Final = 100
"""Of a lattice: nobody keeps more apart."""

_FORMS: Final = ("levels", "categories", "order")


def read_labels(root: Table) -> Labelling | None:
    """What the file says of labels, None: nothing. Raises errors.UsageError."""
    trusting = [key for key in ("declassifier", "endorser") if key in root.values]
    if "lattice" not in root.values:
        for key in ("label", *trusting):
            if key in root.values:
                root.wrong(key, f"expected a [lattice] beside {key}: which labels there are, and in which order")
        return None
    table = root.table("lattice")
    table.only("preset", *_FORMS, "severity", "attacker", "include_ambient", "until")
    reader = _Reader(table, [*root.tables("label"), *(each for key in trusting for each in root.tables(key))])
    labelled = tuple(reader.labelled(each) for each in root.tables("label"))
    declassifiers = tuple(reader.declassifier(each) for key in trusting for each in root.tables(key))
    used = {one.label for one in labelled} | {label for one in declassifiers for label in (one.taken, one.given)}
    if len(used) < 2:
        table.wrong(None, f"expected two labels in use at least, found {len(used)}: nothing would be compared")
    return Labelling(
        lattice=reader.lattice,
        labelled=labelled,
        declassifiers=declassifiers,
        attacker=table.attacker(),
        include_ambient=table.flag("include_ambient"),
        severity=table.severity(),
        until=table.instant("until"),
        location=table.location,
        place=table.place(),
    )


class _Reader:
    """The lattice of a file, and labels in its words. `tables`: those in which labels stand."""

    def __init__(self, table: Table, tables: list[Table]) -> None:
        self._table = table
        forms = [form for form in _FORMS if form in table.values]
        if len(forms) != 1:
            table.wrong(None, f"expected exactly one of {', '.join(_FORMS)}, found {len(forms)}")
        self._categories = _words(table, "categories") if forms == ["categories"] else None
        lattice = self._lattice(forms[0], tables)
        self.lattice = lattice.turned if table.choice("preset", (BELL_LAPADULA, BIBA)) == BIBA else lattice

    def _lattice(self, form: str, tables: list[Table]) -> Lattice:
        if form == "levels":
            return chain(_words(self._table, "levels"))
        if form == "order":
            return _order(self._table.table("order"))
        used = {}
        for table in tables:
            for key in ("label", "from", "to"):
                if key in table.values:
                    categories = self._set(table, key)
                    used[_set_name(categories)] = categories
        return powerset(used)

    def _set(self, table: Table, key: str) -> tuple[str, ...]:
        """Categories; none at all in an empty array."""
        if table.values.get(key) == []:
            return ()
        known = self._categories or ()
        for category in table.texts(key):
            if category not in known:
                table.wrong(key, f"{category!r} is no category; expected some of {', '.join(known)}")
        return tuple(sorted(set(table.texts(key)), key=known.index))

    def _label(self, table: Table, key: str) -> str:
        if self._categories is not None:
            if key not in table.values:
                table.wrong(None, f"expected {key} = [...], categories")
            return _set_name(self._set(table, key))
        label = table.text(key)
        if label not in self.lattice.targets:
            table.wrong(key, f"{label!r} is no label of the lattice; expected {', '.join(self.lattice.targets)}")
        return label

    def labelled(self, table: Table) -> Labelled:
        """A `[[label]]`."""
        table.only("label", "enclaves", "topics")
        if "enclaves" not in table.values and "topics" not in table.values:
            table.wrong(None, "expected enclaves or topics: what has the label")
        return Labelled(
            label=self._label(table, "label"),
            enclaves=table.enclaves("enclaves") if "enclaves" in table.values else (),
            topics=table.topics("topics") if "topics" in table.values else (),
            place=table.place(),
            marks=table.marks,
        )

    def declassifier(self, table: Table) -> Declassifier:
        """A `[[declassifier]]` or `[[endorser]]`."""
        table.only("enclaves", "from", "to")
        return Declassifier(
            enclaves=table.enclaves("enclaves"),
            taken=self._label(table, "from"),
            given=self._label(table, "to"),
            place=table.place(),
            marks=table.marks,
        )


def _words(table: Table, key: str) -> tuple[str, ...]:
    """Names of labels or categories, each once."""
    words = table.texts(key)
    if len(words) > MAX_LABELS:
        table.wrong(key, f"expected at most {MAX_LABELS} names, found {len(words)}")
    for number, word in enumerate(words):
        _check_word(table, key, word)
        if word in words[:number]:
            table.wrong(key, f"{word!r} stands here twice: expected each once")
    return words


def _check_word(table: Table, key: str, word: str) -> None:
    if not WORD.fullmatch(word):
        table.wrong(key, f"{word!r} is no name of a label; expected letters a to z, digits and hyphens")


def _order(table: Table) -> Lattice:
    """Labels with those directly below each."""
    below: Mapping[str, tuple[str, ...]] = {
        label: () if table.values[label] == [] else table.texts(label) for label in table.values
    }
    if not 0 < len(below) <= MAX_LABELS:
        table.wrong(None, f"expected 1 to {MAX_LABELS} labels, each with those directly below it")
    for label, lower in below.items():
        _check_word(table, label, label)
        for one in lower:
            if one not in below:
                table.wrong(label, f"{one!r} is no label of this order; expected {one} = [...] beside it")
    try:
        return ordered(below)
    except CyclicOrder as cycle:
        way = " below ".join(map(repr, reversed((*cycle.labels, cycle.labels[0]))))
        table.wrong(cycle.labels[0], f"{way}: expected an order without cycles")


def _set_name(categories: tuple[str, ...]) -> str:
    return ", ".join(categories) or NO_CATEGORY


def read_single_writers(root: Table) -> tuple[Claim, ...]:
    """The topics of which one enclave alone may be the publisher. Raises errors.UsageError."""
    if "single_writer" not in root.values:
        return ()
    claims: dict[str, Claim] = {}
    for number, topic in enumerate(root.texts("single_writer")):
        if has_wildcard(topic):
            root.wrong("single_writer", f'{topic!r} has wildcards: expected one topic each, e.g. "/cmd_vel"')
        try:
            name = dds_topic(topic)
        except ValueError as error:
            root.wrong("single_writer", str(error))
        claim_id = f"single-writer-{re.sub('[^a-z0-9]+', '-', topic.lower()).strip('-')}"
        if claim_id in claims:
            claim_id = f"{claim_id}-{len(claims) + 1}"
        claims[claim_id] = Claim(
            id=claim_id,
            statement=f"No more than one enclave may publish {topic}.",
            kind=ClaimKind.ONLY_PUBLISH,
            attacker=Attacker.INSIDER,
            source=Globs(),
            target=Globs(topics=(name,)),
            include_ambient=True,
            location=root.file.location(("single_writer",)),
            place=root.file.place(("single_writer", number)),
        )
    return tuple(claims.values())
