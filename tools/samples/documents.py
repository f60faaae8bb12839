"""Governance and permissions of DDS-Security 1.1 (9.4.1.2, 9.4.1.3), written as sros2 lays them out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/{}/omg_shared_ca_{}.xsd"
DDS = '<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{}">'

NOT_BEFORE = "2020-01-01T00:00:00"
NOT_AFTER = "2100-01-01T00:00:00"

Line = tuple[float, str]
"""A line of a document and how deep it stands in."""

Domain = int | tuple[int | None, int | None]
"""An `<id>`, or an `<id_range>` with its min and max, each of which may be absent."""


class TopicRule(Struct, frozen=True, kw_only=True):
    """A `<topic_rule>`; the defaults are those of sros2's governance."""

    expression: str = "*"
    discovery_protection: bool = True
    liveliness_protection: bool = True
    read_access_control: bool = True
    write_access_control: bool = True
    metadata: str = "ENCRYPT"
    data: str = "ENCRYPT"


class DomainRule(Struct, frozen=True, kw_only=True):
    """A `<domain_rule>`; the defaults are those of sros2's governance."""

    domains: tuple[Domain, ...] = (0,)
    allow_unauthenticated: bool = False
    join_access_control: bool = True
    discovery: str = "ENCRYPT"
    liveliness: str = "ENCRYPT"
    rtps: str = "SIGN"
    topics: tuple[TopicRule, ...] = (TopicRule(),)


class Governance(Struct, frozen=True, kw_only=True):
    """A governance document. `indent` is 4 in sros2's own file, whose domain ids stand in by only 2."""

    rules: tuple[DomainRule, ...] = (DomainRule(),)
    version: str = "20170901"
    indent: int = 4

    def xml(self) -> str:
        """The document, ending in a line feed."""
        lines: list[Line] = [(0, DDS.format(SCHEMA.format(self.version, "governance")))]
        lines.append((1, "<domain_access_rules>"))
        for rule in self.rules:
            lines += self._domain_rule(rule)
        lines += [(1, "</domain_access_rules>"), (0, "</dds>")]
        return _text(lines, self.indent)

    def _domain_rule(self, rule: DomainRule) -> Iterator[Line]:
        yield 2, "<domain_rule>"
        yield from _domains(3, rule.domains, 2 / self.indent)
        yield 3, _element("allow_unauthenticated_participants", rule.allow_unauthenticated)
        yield 3, _element("enable_join_access_control", rule.join_access_control)
        yield 3, _element("discovery_protection_kind", rule.discovery)
        yield 3, _element("liveliness_protection_kind", rule.liveliness)
        yield 3, _element("rtps_protection_kind", rule.rtps)
        yield 3, "<topic_access_rules>"
        for topic in rule.topics:
            yield from self._topic_rule(topic)
        yield 3, "</topic_access_rules>"
        yield 2, "</domain_rule>"

    def _topic_rule(self, rule: TopicRule) -> Iterator[Line]:
        yield 4, "<topic_rule>"
        yield 5, _element("topic_expression", rule.expression)
        yield 5, _element("enable_discovery_protection", rule.discovery_protection)
        if self.version != "20160303":  # The form of DDS-Security 1.0 does not have it.
            yield 5, _element("enable_liveliness_protection", rule.liveliness_protection)
        yield 5, _element("enable_read_access_control", rule.read_access_control)
        yield 5, _element("enable_write_access_control", rule.write_access_control)
        yield 5, _element("metadata_protection_kind", rule.metadata)
        yield 5, _element("data_protection_kind", rule.data)
        yield 4, "</topic_rule>"


class Criterion(Struct, frozen=True, kw_only=True):
    """A `<publish>`, `<subscribe>` or `<relay>`."""

    topics: tuple[str, ...]
    partitions: tuple[str, ...] = ()
    data_tag: str = ""


class Rule(Struct, frozen=True, kw_only=True):
    """An `<allow_rule>`, or with `allow` False a `<deny_rule>`.

    Topics given as plain strings make one criterion.
    """

    publish: tuple[Criterion | str, ...] = ()
    subscribe: tuple[Criterion | str, ...] = ()
    relay: tuple[Criterion | str, ...] = ()
    allow: bool = True
    domains: tuple[Domain, ...] = (0,)


DISCOVERY = Rule(publish=("ros_discovery_info",), subscribe=("ros_discovery_info",))
"""What sros2 adds for run times that announce the graph on a topic of its own."""


class Grant(Struct, frozen=True, kw_only=True):
    """A `<grant>` for `subject` (None: CN= and the path); dates as they stand in the document."""

    path: str
    subject: str | None = None
    not_before: str = NOT_BEFORE
    not_after: str = NOT_AFTER
    rules: tuple[Rule, ...] = ()
    default: str = "DENY"


class Permissions(Struct, frozen=True, kw_only=True):
    """A permissions document."""

    grants: tuple[Grant, ...]
    version: str = "20170901"

    def xml(self) -> str:
        """The document, ending in a line feed."""
        lines: list[Line] = [(0, DDS.format(SCHEMA.format(self.version, "permissions")))]
        lines.append((1, "<permissions>"))
        for grant in self.grants:
            lines += _grant(grant)
        lines += [(1, "</permissions>"), (0, "</dds>")]
        return _text(lines, 2)


def edited(text: str, old: str, new: str) -> str:
    """`text` with the one occurrence of `old` replaced.

    Raises ValueError where there is none, or more than one.
    """
    if text.count(old) != 1:
        raise ValueError(f"{old!r} occurs {text.count(old)} times")
    return text.replace(old, new)


def _grant(grant: Grant) -> Iterator[Line]:
    subject = f"CN={grant.path}" if grant.subject is None else grant.subject
    yield 2, f'<grant name="{grant.path}">'
    yield 3, _element("subject_name", subject)
    yield 3, "<validity>"
    yield 4, _element("not_before", grant.not_before)
    yield 4, _element("not_after", grant.not_after)
    yield 3, "</validity>"
    for rule in grant.rules:
        yield from _rule(rule)
    yield 3, _element("default", grant.default)
    yield 2, "</grant>"


def _rule(rule: Rule) -> Iterator[Line]:
    element = "allow_rule" if rule.allow else "deny_rule"
    yield 3, f"<{element}>"
    yield from _domains(4, rule.domains, 1)
    for name, criteria in (("publish", rule.publish), ("subscribe", rule.subscribe), ("relay", rule.relay)):
        plain = tuple(c for c in criteria if isinstance(c, str))
        for criterion in ((Criterion(topics=plain),) if plain else ()) + tuple(
            c for c in criteria if isinstance(c, Criterion)
        ):
            yield from _criterion(name, criterion)
    yield 3, f"</{element}>"


def _criterion(name: str, criterion: Criterion) -> Iterator[Line]:
    yield 4, f"<{name}>"
    for kind, values in (("topic", criterion.topics), ("partition", criterion.partitions)):
        if values:
            yield 5, f"<{kind}s>"
            for value in values:
                yield 6, _element(kind, value)
            yield 5, f"</{kind}s>"
    if criterion.data_tag:
        tag = _element("name", criterion.data_tag) + _element("value", "yes")
        yield 5, f"<data_tags><tag>{tag}</tag></data_tags>"
    yield 4, f"</{name}>"


def _domains(level: float, domains: tuple[Domain, ...], step: float) -> Iterator[Line]:
    yield level, "<domains>"
    for domain in domains:
        if isinstance(domain, int):
            yield level + step, _element("id", str(domain))
        else:
            low, high = domain
            bounds = "".join(_element(n, str(v)) for n, v in (("min", low), ("max", high)) if v is not None)
            yield level + step, f"<id_range>{bounds}</id_range>"
    yield level, "</domains>"


def _element(name: str, value: str | bool) -> str:
    text = str(value).lower() if isinstance(value, bool) else value
    return f"<{name}>{text}</{name}>"


def _text(lines: Iterable[Line], indent: int) -> str:
    return "".join(" " * round(level * indent) + text + "\n" for level, text in lines)
