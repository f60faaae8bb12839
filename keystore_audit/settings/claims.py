"""What settings assert (`[[property]]`), and what they declare that nodes forward (`[[forward]]`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final, Literal

from msgspec import Meta, field

from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.named import Declared, Determinism, Forward, leading_to
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import Attacker, ClaimKind, Scheduler
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.properties import BY_ID
from keystore_audit.settings.document import (
    OUTSIDER,
    Enclave,
    Enclaves,
    Source,
    Table,
    Text,
    Texts,
    Topics,
    Word,
    dds_topics,
    described,
    globs,
    instant,
    place_of,
    several,
)

FlowAttacker = Literal["relays", "source", "honest"]


class NoFlow(Table, frozen=True, kw_only=True):
    """From some places nothing gets to others."""

    source: Texts = field(name="from")
    target: Texts = field(name="to")
    through: Enclaves | None = None
    attacker: FlowAttacker = "relays"
    include_ambient: bool = False


class Able(Table, frozen=True, kw_only=True):
    """From some places data can get to others."""

    source: Texts = field(name="from")
    target: Texts = field(name="to")
    include_ambient: bool = False


class OnlyPublish(Table, frozen=True, kw_only=True):
    """Nobody but these enclaves may publish a topic."""

    topic: Topics
    enclaves: Enclaves


class Encrypted(Table, frozen=True, kw_only=True):
    """A topic is encrypted."""

    topic: Topics
    against: Literal["outsider", "insider"] = "outsider"


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


_TWO: Final = 'two enclaves, or globs on enclaves, e.g. ["/arm/*", "/logger"]'


class PropertyTable(Table, frozen=True, kw_only=True):
    """A `[[property]]`: one of the forms, which stand last."""

    name: Word
    description: Text | None = None
    severity: Severity = Severity.HIGH
    until: Any = None
    no_flow: NoFlow | None = None
    only_publish: OnlyPublish | None = None
    encrypted: Encrypted | None = None
    never_share_domain: Annotated[list[Enclave], Meta(min_length=2, max_length=2, description=_TWO)] | None = None
    able: Able | None = None
    deterministic: Deterministic | None = None


def read_properties(
    tables: Sequence[PropertyTable], forwards: Sequence[ForwardTable], source: Source
) -> tuple[tuple[Claim, ...], Declared]:
    """What is asserted, and what is declared and asserted of behaviour. Raises errors.UsageError."""
    declared = read_forwards(forwards, source.at("forward"))
    claims: dict[str, Claim | Determinism] = {}
    for number, table in enumerate(tables):
        here = source.at("property", number)
        if table.name in claims:
            here.at("name").wrong(f"there is a property {table.name!r} already, at {claims[table.name].place}")
        claims[table.name] = _claim(table, here, declared)
    asserted = tuple(claim for claim in claims.values() if isinstance(claim, Claim))
    determined = tuple(claim for claim in claims.values() if isinstance(claim, Determinism))
    return asserted, Declared(forwards=declared, claims=determined)


def place(word: str) -> Globs:
    """Where a flow begins or ends, written as in settings. Raises errors.UsageError."""
    try:
        return globs((word,))
    except ValueError as error:
        raise UsageError(f"{error}.") from error


def _claim(table: PropertyTable, source: Source, forwards: tuple[Forward, ...]) -> Claim | Determinism:
    if table.name in BY_ID:
        source.at("name").wrong(f"{table.name!r} is the name of a property that is always decided")
    known = (*FORMS, "deterministic")
    forms = [form for form in known if getattr(table, form) is not None]
    if len(forms) != 1:
        source.wrong(f"expected exactly one of {', '.join(known)} in property {table.name!r}, found {len(forms)}")
    (form,) = forms
    if table.deterministic is not None:
        if table.until is not None:
            source.at("until").wrong("expected no until beside deterministic: it is decided at the audit instant")
        return read_determinism(table, table.deterministic, forwards, source)
    said = FORMS[form](getattr(table, form), source.at(form))
    statement = said.pop("statement")
    return Claim(
        id=table.name,
        statement=described(table.description, statement),
        severity=table.severity,
        until=instant(table.until, source.at("until")),
        location=source.location,
        place=source.place,
        marks=source.marks(table),
        **said,
    )


def _no_flow(form: NoFlow, source: Source) -> dict[str, Any]:
    through = several(form.through)
    besides = f" except through {_listed(through)}" if through else ""
    apart = "" if form.include_ambient else ", apart from topics that nearly every node uses, unless named here"
    return {
        "kind": ClaimKind.NO_FLOW,
        "attacker": Attacker(form.attacker),
        "source": place_of(form.source, source.at("from")),
        "target": place_of(form.target, source.at("to")),
        "through": through,
        "include_ambient": form.include_ambient,
        "statement": f"Nothing gets from {_listed(form.source)} to {_listed(form.target)}{besides}{apart}.",
    }


def _able(form: Able, source: Source) -> dict[str, Any]:
    return {
        "kind": ClaimKind.ABLE,
        "attacker": Attacker.HONEST,
        "source": place_of(form.source, source.at("from")),
        "target": place_of(form.target, source.at("to")),
        "include_ambient": form.include_ambient,
        "statement": f"Permissions allow data to get from {_each(form.source)} to {_each(form.target)}. "
        "Not checked: that governances match (KA416), that nodes can be made (KA636), and that nodes use it.",
    }


def _only_publish(form: OnlyPublish, _source: Source) -> dict[str, Any]:
    return {
        "kind": ClaimKind.ONLY_PUBLISH,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=several(form.enclaves)),
        "target": Globs(topics=dds_topics(form.topic)),
        "include_ambient": True,
        "statement": f"Only {_listed(form.enclaves)} may publish {_listed(form.topic)}.",
    }


def _encrypted(form: Encrypted, _source: Source) -> dict[str, Any]:
    whom = "outsiders" if form.against == OUTSIDER else "insiders without a grant to read it"
    return {
        "kind": ClaimKind.ENCRYPTED,
        "attacker": Attacker(form.against),
        "source": Globs(),
        "target": Globs(topics=dds_topics(form.topic)),
        "include_ambient": True,
        "statement": f"{_listed(form.topic)} is encrypted against {whom}.",
    }


def _never_share_domain(sides: Sequence[str], _source: Source) -> dict[str, Any]:
    one, other = sides
    return {
        "kind": ClaimKind.SEPARATE_DOMAINS,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=(one,)),
        "target": Globs(enclaves=(other,)),
        "include_ambient": True,
        "statement": f"{one} and {other} can never join one domain.",
    }


FORMS: Final[dict[str, Callable[[Any, Source], dict[str, Any]]]] = {
    "no_flow": _no_flow,
    "only_publish": _only_publish,
    "encrypted": _encrypted,
    "never_share_domain": _never_share_domain,
    "able": _able,
}
"""By form what it claims: what a `Claim` says beside its name and its place."""


def _listed(value: str | Sequence[str]) -> str:
    return ", ".join(several(value))


def _each(value: str | Sequence[str]) -> str:
    """All of the places, one by one, where they are several; a glob on topics is one place."""
    words = several(value)
    told = _listed([f"some topic of {w}" if has_wildcard(w) and not w.startswith("/") else w for w in words])
    alone = len(words) == 1 and not (has_wildcard(words[0]) and words[0].startswith("/"))
    return told if alone else f"each of {told}"


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
            source.wrong(f"{name!r}: expected the name of one topic, without a pattern: forwards are exact")
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
        within.at("low").wrong("no [[forward]] leads to it: only its publishers decide what it carries")
    besides = f", whatever comes from {', '.join(several(form.high))}" if form.high is not None else ""
    alone = "" if leading else " (No declared forward leads there: a no-flow property says the same.)"
    listed = ", ".join(several(form.low))
    said = f"The same inputs in each round give the same samples on {listed}{besides}, while nobody attacks.{alone}"
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
