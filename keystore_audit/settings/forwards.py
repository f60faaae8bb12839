"""What nodes forward (`[[forward]]`), and the properties that rest on it (`deterministic`), in settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Final

from msgspec import Meta, field

from keystore_audit.model.claims.forwards import Determinism, Forward, leading_to
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.formal.behaviour import Scheduler
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.settings.document import Source, Table, Texts, Topics, dds_topics, described, place_of, several

if TYPE_CHECKING:
    from keystore_audit.settings.claims import PropertyTable

MAX_TOPICS: Final = 8
"""In one list of a forward: the states to look at grow with it as powers of nine."""

OneEnclave = Annotated[str, Meta(pattern=r"^/[^*?\[\\]*\Z", description='the path of one enclave, e.g. "/multiplexer"')]


class ForwardTable(Table, frozen=True, kw_only=True):
    """A `[[forward]]`."""

    enclave: OneEnclave
    sources: Topics = field(name="from")
    targets: Topics = field(name="to")
    scheduler: Scheduler


class Deterministic(Table, frozen=True, kw_only=True):
    """The form of a `[[property]]`: two runs show the same."""

    low: Topics
    high: Texts | None = None
    include_ambient: bool = False


def read_forwards(tables: Sequence[ForwardTable], source: Source) -> tuple[Forward, ...]:
    """The `[[forward]]` tables. Raises errors.UsageError."""
    return tuple(
        Forward(
            enclave=table.enclave,
            sources=_topics(table.sources, here.at("from")),
            targets=_topics(table.targets, here.at("to")),
            scheduler=table.scheduler,
            location=here.location,
            place=here.place,
            marks=here.marks(table),
        )
        for table, here in ((table, source.at(number)) for number, table in enumerate(tables))
    )


def _topics(value: Topics, source: Source) -> tuple[str, ...]:
    """DDS topics, one name each."""
    names = dds_topics(value)
    for name in names:
        if has_wildcard(name):
            source.wrong(f"{name!r}: expected the name of one topic, without a pattern: what is forwarded is exact")
    if len(set(names)) < len(names):
        source.wrong("a topic stands here twice")
    if len(names) > MAX_TOPICS:
        source.wrong(f"expected at most {MAX_TOPICS} topics, found {len(names)}")
    return names


def read_determinism(
    table: PropertyTable, form: Deterministic, forwards: Sequence[Forward], source: Source
) -> Determinism:
    """The `[[property]]` of the form `deterministic`. Raises errors.UsageError."""
    within = source.at("deterministic")
    low = _topics(form.low, within.at("low"))
    high = place_of(form.high, within.at("high")) if form.high is not None else Globs()
    if high.outsider:
        within.at("high").wrong("expected enclaves or topics: it is about what happens while nobody attacks")
    if any(map(has_wildcard, high.topics)):
        within.at("high").wrong("expected names of topics, without a pattern")
    leading = leading_to(low, forwards)
    if not leading and form.high is None:
        within.at("low").wrong("no [[forward]] leads to it: it would be as its publishers make it, whatever they do")
    besides = f", whatever comes from {', '.join(several(form.high))}" if form.high is not None else ""
    alone = "" if leading else " (No declared forward leads there: that nothing high gets there at all would say so.)"
    listed = ", ".join(several(form.low))
    said = f"The same inputs, round by round, make the same on {listed}{besides}, while nobody attacks.{alone}"
    return Determinism(
        id=table.name,
        statement=described(table.description, said),
        severity=table.severity,
        high=high,
        low=low,
        forwards=leading,
        include_ambient=form.include_ambient,
        location=source.location,
        place=source.place,
        marks=source.marks(table),
    )
