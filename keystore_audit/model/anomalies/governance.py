"""Rules of a governance that apply to nothing, since earlier ones of it apply to all that they name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

from keystore_audit.grouped import gathered
from keystore_audit.keystore.governance import DomainRule, ProtectionKind, TopicRule
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Point
from keystore_audit.model.anomalies.classes import Effort, NameClass, name_classes
from keystore_audit.model.domains import describe, domain_bits
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.model.semantics import ReadDomainRule
from keystore_audit.profiles import Matcher


class _Protections(NamedTuple):
    """What a domain rule protects: as a whole, and by its topic rules, each with its expression."""

    domain: frozenset[str]
    topics: tuple[tuple[str, frozenset[str]], ...]


def governance_anomalies(rules: Sequence[ReadDomainRule], matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """The anomalies of a governance: the first domain rule that covers a domain counts, of it the first topic rule.

    Raises errors.BudgetExceeded.
    """
    taken = 0
    winning: list[tuple[int, DomainRule, _Protections]] = []
    known: dict[int, list[tuple[int, DomainRule, _Protections]]] = {}
    lacking: dict[tuple[_Protections, _Protections], bool] = {}  # thousands of rules may say the same
    for read in rules:
        cover = domain_bits(read.domains)
        own = _Protections(
            _of_domain(read.rule), tuple((topic.expression.text, _of_topic(topic)) for topic in read.rule.topic_rules)
        )
        if cover and not cover & ~taken:
            if cover not in known:  # no later rule wins any of these domains
                known[cover] = [winner for winner in winning if winner[0] & cover]
            weaker = None
            for _, rule, winner in known[cover]:
                if (winner, own) not in lacking:
                    lacking[winner, own] = _lacks(winner, own, matcher, effort)
                if lacking[winner, own]:
                    weaker = rule
                    break
            yield _shadowed_domain_rule(read, weaker or known[cover][0][1], serious=weaker is not None)
            continue
        if cover & ~taken:
            winning.append((cover & ~taken, read.rule, own))
        if len(read.topic_rules) > 1:
            yield from _topic_rules(read, matcher, effort)
        taken |= cover


def _shadowed_domain_rule(read: ReadDomainRule, winner: DomainRule, *, serious: bool) -> Anomaly:
    domains = describe(read.domains)
    return Anomaly(
        kind=AnomalyKind.DOMAIN_RULE_SHADOWED,
        line=read.rule.line,
        other=winner.line,
        other_text=domains,
        key=f"domain rule {domains}",
        serious=serious,
    )


def _lacks(winner: _Protections, shadowed: _Protections, matcher: Matcher, effort: Effort) -> bool:
    """Whether the rule that applies lacks a protection that the other one has."""
    if shadowed.domain - winner.domain:
        return True
    names = list(dict.fromkeys(text for each in (winner, shadowed) for text, _ in each.topics))
    for topics in name_classes(names, matcher, effort):
        listed = {names[member] for member in topics.members}
        applying, lost = (
            next((protections for text, protections in each.topics if text in listed), None)
            for each in (winner, shadowed)
        )
        effort.compare(1)
        if applying is not None and (lost is None or lost - applying):
            return True
    return False


def _topic_rules(read: ReadDomainRule, matcher: Matcher, effort: Effort) -> Iterator[Anomaly]:
    """Topic rules of which earlier ones of the domain rule leave nothing."""
    rules = read.rule.topic_rules
    names = list(dict.fromkeys(rule.expression.text for rule in rules))
    at = {text: number for number, text in enumerate(names)}
    classes = name_classes(names, matcher, effort)
    holding = gathered((member, number) for number, topics in enumerate(classes) for member in topics.members)
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
    return Anomaly(
        kind=AnomalyKind.TOPIC_RULE_SHADOWED,
        line=rule.line,
        other=winner.line,
        texts=(rule.expression.text,),
        other_text=winner.expression.text,
        point=Point(Operation.PUBLISH, witness, "", read.domains[0][0] if read.domains else 0),
        key=f"{domains} {rule.expression.text}",
        serious=serious,
    )


def _readable(topics: NameClass) -> tuple[object, ...]:
    return not is_ros_dds_name(topics.witness), len(topics.witness), topics.witness


def _of_domain(rule: DomainRule) -> frozenset[str]:
    """The protections of a domain rule, each by itself."""
    return _protections(
        ("only authenticated participants", not rule.allow_unauthenticated_participants),
        ("join access control", rule.enable_join_access_control),
        ("discovery", rule.discovery_protection_kind),
        ("liveliness", rule.liveliness_protection_kind),
        ("rtps", rule.rtps_protection_kind),
    )


def _of_topic(rule: TopicRule) -> frozenset[str]:
    """The protections of a topic rule, each by itself."""
    return _protections(
        ("discovery protection", rule.enable_discovery_protection),
        ("liveliness protection", rule.enable_liveliness_protection),
        ("read access control", rule.enable_read_access_control),
        ("write access control", rule.enable_write_access_control),
        ("metadata", rule.metadata_protection_kind),
        ("data", rule.data_protection_kind),
    )


@lru_cache(maxsize=1_024)
def _protections(*named: tuple[str, bool | ProtectionKind]) -> frozenset[str]:
    """Flags that are on, and what each kind does; some hundreds of sets, however many rules there are."""
    found = set()
    for name, value in named:
        if isinstance(value, ProtectionKind):
            found |= {f"{name} authenticated"} if value.authenticates else set()
            found |= {f"{name} encrypted"} if value.encrypts else set()
            found |= {f"{name} authenticated by origin"} if value.authenticates_origin else set()
        elif value:
            found.add(name)
    return frozenset(found)
