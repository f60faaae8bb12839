"""What nodes forward (`[[forward]]`), and the properties that rest on it (`deterministic`), in settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.findings import Severity
from keystore_audit.model.claims.forwards import Determinism, Forward, leading_to
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.formal.behaviour import Scheduler
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.settings.table import Table

FORM: Final = "deterministic"
"""The form of a `[[property]]`."""

MAX_TOPICS: Final = 8
"""In one list of a forward: the states to look at grow with it as powers of nine."""


def read_forwards(root: Table) -> tuple[Forward, ...]:
    """The `[[forward]]` tables. Raises errors.UsageError."""
    return tuple(_forward(table) for table in root.tables("forward"))


def _forward(table: Table) -> Forward:
    table.only("enclave", "from", "to", "scheduler")
    enclave = table.text("enclave")
    if not enclave.startswith("/") or has_wildcard(enclave):
        table.wrong("enclave", f'{enclave!r}: expected the path of one enclave, e.g. "/multiplexer"')
    if "scheduler" not in table.values:
        table.wrong(None, 'expected scheduler = "priority" (the first topic of from that has a sample) or "any"')
    scheduler = table.choice("scheduler", tuple(each.value for each in Scheduler))
    return Forward(
        enclave=enclave,
        sources=_topics(table, "from"),
        targets=_topics(table, "to"),
        scheduler=Scheduler(scheduler),
        location=table.location,
        place=table.place(),
        marks=(*table.marks, (enclave, table.place("enclave"))),
    )


def _topics(table: Table, key: str) -> tuple[str, ...]:
    """DDS topics, one name each."""
    words, names = table.texts(key) if key in table.values else (), table.topics(key)
    for word in words:
        if has_wildcard(word):
            table.wrong(key, f"{word!r}: expected the name of one topic, without a pattern: what is forwarded is exact")
    if len(set(names)) < len(names):
        table.wrong(key, "a topic stands here twice")
    if len(names) > MAX_TOPICS:
        table.wrong(key, f"expected at most {MAX_TOPICS} topics, found {len(names)}")
    return names


def read_determinism(table: Table, name: str, severity: Severity, forwards: Sequence[Forward]) -> Determinism:
    """The `[[property]]` of the form `deterministic`. Raises errors.UsageError."""
    if "until" in table.values:
        table.wrong("until", f"expected no until beside {FORM}: it is decided at the audit instant")
    form = table.table(FORM)
    form.only("low", "high", "include_ambient")
    low = _topics(form, "low")
    high = form.place_of("high") if "high" in form.values else Globs()
    if high.outsider:
        form.wrong("high", "expected enclaves or topics: it is about what happens while nobody attacks")
    if any(map(has_wildcard, high.topics)):
        form.wrong("high", "expected names of topics, without a pattern")
    leading = leading_to(low, forwards)
    unreachability = not leading
    if unreachability and high == Globs():
        form.wrong("low", "no [[forward]] leads to it: it would be as its publishers make it, whatever they do")
    return Determinism(
        id=name,
        statement=table.described(_statement(form, unreachability)),
        severity=severity,
        high=high,
        low=low,
        forwards=leading,
        include_ambient=form.flag("include_ambient"),
        location=table.location,
        place=table.place(),
        marks=table.marks,
    )


def _statement(form: Table, unreachability: bool) -> str:
    low = ", ".join(form.texts("low"))
    besides = f", whatever comes from {', '.join(form.texts('high'))}" if "high" in form.values else ""
    said = f"The same inputs, round by round, make the same on {low}{besides}, while nobody attacks."
    if not unreachability:
        return said
    return f"{said} (No declared forward leads there: that nothing high gets there at all would say so.)"
