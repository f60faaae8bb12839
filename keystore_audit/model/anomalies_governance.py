"""Rules of a governance that apply to nothing, since earlier ones of it apply to all that they name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.keystore.governance import DomainRule, ProtectionKind, Text, TopicRule
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.anomalies_classes import Effort, NameClass, name_classes
from keystore_audit.model.anomalies_rules import domain_bits
from keystore_audit.model.anomaly import Anomaly, AnomalyKind, Point
from keystore_audit.model.domains import describe
from keystore_audit.model.expression import Matcher
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.model.semantics import ReadDomainRule


def governance_anomalies(rules: Sequence[ReadDomainRule], matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """The anomalies of a governance: the first domain rule that covers a domain counts, of it the first topic rule.

    Raises errors.BudgetExceeded.
    """
    taken = 0
    winning: list[tuple[int, DomainRule]] = []
    known: dict[int, list[DomainRule]] = {}
    for read in rules:
        cover = domain_bits(read.domains)
        if cover and not cover & ~taken:
            if cover not in known:  # no later rule wins any of these domains
                known[cover] = [rule for domains, rule in winning if domains & cover]
            yield _shadowed_domain_rule(read, known[cover], matcher, effort)
            continue
        if cover & ~taken:
            winning.append((cover & ~taken, read.rule))
        if len(read.topic_rules) > 1:
            yield from _topic_rules(read, matcher, effort)
        taken |= cover


def _shadowed_domain_rule(
    read: ReadDomainRule, winners: Sequence[DomainRule], matcher: Matcher, effort: Effort
) -> Anomaly:
    weaker = [rule for rule in winners if _lacks(rule, read.rule, matcher, effort)]
    domains = describe(read.domains)
    return Anomaly(
        kind=AnomalyKind.DOMAIN_RULE_SHADOWED,
        allow=True,
        subject="",
        line=read.rule.line,
        other=(weaker or winners)[0].line,
        texts=(),
        other_text=domains,
        point=None,
        key=f"domain rule {domains}",
        serious=bool(weaker),
    )


def _lacks(winner: DomainRule, shadowed: DomainRule, matcher: Matcher, effort: Effort) -> bool:
    """Whether the rule that applies lacks a protection that the other one has."""
    if _of_domain(shadowed) - _of_domain(winner):
        return True
    texts = dict.fromkeys(rule.expression.text for each in (winner, shadowed) for rule in each.topic_rules)
    names = list(texts)
    for topics in name_classes(names, matcher, effort):
        listed = {names[member] for member in topics.members}
        applying, lost = (
            next((rule for rule in each.topic_rules if rule.expression.text in listed), None)
            for each in (winner, shadowed)
        )
        effort.compare(1)
        if applying is not None and (lost is None or _of_topic(lost) - _of_topic(applying)):
            return True
    return False


def _topic_rules(read: ReadDomainRule, matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """Topic rules of which earlier ones of the domain rule leave nothing."""
    rules = read.rule.topic_rules
    names = list(dict.fromkeys(rule.expression.text for rule in rules))
    at = {text: number for number, text in enumerate(names)}
    holding: dict[int, list[int]] = {}
    classes = name_classes(names, matcher, effort)
    for number, topics in enumerate(classes):
        for member in topics.members:
            holding.setdefault(member, []).append(number)
    winner: dict[int, TopicRule] = {}
    for rule in rules:
        held = holding.get(at[rule.expression.text], ())
        effort.compare(len(held) // 16 + 1)
        fresh = [number for number in held if number not in winner]
        winner.update(dict.fromkeys(fresh, rule))
        if held and not fresh:
            weaker = [number for number in held if _of_topic(rule) - _of_topic(winner[number])]
            shown = min(weaker or held, key=lambda number: _readable(classes[number]))
            yield _shadowed_topic_rule(read, rule, winner[shown], classes[shown].witness, serious=bool(weaker))


def _shadowed_topic_rule(
    read: ReadDomainRule, rule: TopicRule, winner: TopicRule, witness: str, *, serious: bool
) -> Anomaly:
    domains = describe(read.domains)
    text: Text = rule.expression
    return Anomaly(
        kind=AnomalyKind.TOPIC_RULE_SHADOWED,
        allow=True,
        subject="",
        line=rule.line,
        other=winner.line,
        texts=(text.text,),
        other_text=winner.expression.text,
        point=Point(Operation.PUBLISH, witness, "", read.domains[0][0] if read.domains else 0),
        key=f"{domains} {text.text}",
        serious=serious,
    )


def _readable(topics: NameClass) -> tuple[object, ...]:
    return not is_ros_dds_name(topics.witness), len(topics.witness), topics.witness


def _of_domain(rule: DomainRule) -> frozenset[str]:
    """The protections of a domain rule, each by itself."""
    flags = {
        "only authenticated participants": not rule.allow_unauthenticated_participants,
        "join access control": rule.enable_join_access_control,
    }
    return _protections(
        flags,
        discovery=rule.discovery_protection_kind,
        liveliness=rule.liveliness_protection_kind,
        rtps=rule.rtps_protection_kind,
    )


def _of_topic(rule: TopicRule) -> frozenset[str]:
    """The protections of a topic rule, each by itself."""
    flags = {
        "discovery protection": rule.enable_discovery_protection,
        "liveliness protection": rule.enable_liveliness_protection,
        "read access control": rule.enable_read_access_control,
        "write access control": rule.enable_write_access_control,
    }
    return _protections(flags, metadata=rule.metadata_protection_kind, data=rule.data_protection_kind)


def _protections(flags: dict[str, bool], **kinds: ProtectionKind) -> frozenset[str]:
    found = {name for name, on in flags.items() if on}
    for name, kind in kinds.items():
        found |= {f"{name} authenticated"} if kind.authenticates else set()
        found |= {f"{name} encrypted"} if kind.encrypts else set()
        found |= {f"{name} authenticated by origin"} if kind.authenticates_origin else set()
    return frozenset(found)
