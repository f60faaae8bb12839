"""What the governance of two keystores says of each name: the rules that decide there, before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.comparison.change import Aspect, Direction, Layer, direction_of, joint_direction
from keystore_audit.model.comparison.facts import Draft, folded
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.steps import Step, decided
from keystore_audit.model.formal.system import TopicRuleAtom
from keystore_audit.model.semantics import OF_DOMAINS, OF_TOPICS, OPENING, strengths

DOMAIN_COVERED: Final = "domain_rule"
TOPIC_COVERED: Final = "topic_rule"
_OPENS: Final = OPENING | {DOMAIN_COVERED, TOPIC_COVERED}
"""What lets more happen where it is there: without a rule that covers it nothing can be used (DDS-Security 1.1,
9.4.1.2)."""

_Value = bool | ProtectionKind


class _Part(NamedTuple):
    """Names about which a governance says the same: which rules cover them, and what those say."""

    says: Mapping[str, _Value]
    channels: int
    location: Location | None


def governance_changes(sides: Sides) -> Iterator[Draft]:
    """One draft for each set of names about which the same aspects changed, of the same enclaves."""
    for alike in grouped(_changes(sides), lambda draft: draft.channels).values():
        together = grouped(folded(alike, sides), lambda draft: (draft.profiles, draft.enclaves))
        for several in together.values():
            aspects = tuple(aspect for each in several for aspect in each.aspects)
            yield replace(several[0], aspects=aspects, direction=joint_direction(aspects))


def _changes(sides: Sides) -> Iterator[Draft]:
    """One for each aspect, enclave and pair."""
    for pair in sides.pairs:
        known: dict[tuple[int | None, ...], list[Draft]] = {}
        for path in sides.compared:
            if sides.refused(pair, path, "governance"):
                continue  # whether it starts says so
            documents = tuple(_document(view, path) for view in (pair.old, pair.new))
            if documents not in known:
                known[documents] = list(_differences(pair, path, sides.mask))
            for draft in known[documents]:
                yield replace(draft, enclaves=(path,))


def same_protection(pair: Pair, path: str) -> bool:
    """Whether the enclave's governance says the same of every name, in whatever domain."""
    return not any(_differences(pair, path, pair.old.decisions.all_channels))


def _document(view: View, path: str) -> int | None:
    return view.system.trust_domains[view.enclave(path).trust_domain].governance


def _parts(view: View, document: int | None) -> list[_Part]:
    """All channels by the rules that decide, whoever signed the document."""
    system, parts = view.system, list[_Part]()
    topics = gathered((topic.domain_rule, topic) for topic in system.topic_rules)
    rules: list[Step[int | None]] = [
        Step(view.decisions.within(rule.domains), True, number)
        for number, rule in enumerate(system.domain_rules)
        if rule.document == document
    ]
    rules.append(Step(view.decisions.all_channels, False, None))
    for step, within in decided(rules):
        if step.by is None:
            parts.append(_Part({DOMAIN_COVERED: False}, within, None))
            continue
        rule = system.domain_rules[step.by]
        domain = {DOMAIN_COVERED: True} | {name: getattr(rule, name) for name in OF_DOMAINS}
        listed: list[Step[TopicRuleAtom | None]] = [
            Step(bits(topic.channels), True, topic) for topic in topics.get(step.by, ())
        ]
        listed.append(Step(-1, False, None))
        for each, hit in decided(listed):
            topic = each.by
            says = {name: getattr(topic, name) for name in OF_TOPICS} if topic is not None else {}
            parts.append(_Part(domain | {TOPIC_COVERED: each.allow} | says, hit & within, (topic or rule).location))
    return parts


def _differences(pair: Pair, path: str, mask: int) -> Iterator[Draft]:
    """Each aspect that differs, with all names about which it does; where one side covers nothing, that alone."""
    old, new = (_parts(view, _document(view, path)) for view in (pair.old, pair.new))
    found: dict[tuple[str, _Value, _Value], list[tuple[int, _Part, _Part]]] = {}
    for before in old:
        for after in new:
            both = before.channels & after.channels & mask
            for name in before.says if both and before.says != after.says else ():
                if name in after.says and before.says[name] != after.says[name]:
                    key = name, before.says[name], after.says[name]
                    found.setdefault(key, []).append((both, before, after))
    for (name, one, other), parts in found.items():
        direction = _direction(name, one, other)
        yield Draft(
            layer=Layer.TRUST,
            kind="protection",
            direction=direction,
            what="what the governance protects",
            profiles=pair.profiles,
            aspects=(Aspect(name, _word(one), _word(other), direction),),
            channels=union(channels for channels, _before, _after in parts),
            old=parts[0][1].location,
            new=parts[0][2].location,
        )


def _word(value: _Value) -> str:
    return value.value if isinstance(value, ProtectionKind) else str(value).lower()


def _direction(name: str, old: _Value, new: _Value) -> Direction:
    if isinstance(old, ProtectionKind) and isinstance(new, ProtectionKind):
        before, after = strengths(old), strengths(new)
        return direction_of(before - after, after - before)
    opens = bool(new) if name in _OPENS else not new
    return Direction.GAINED if opens else Direction.LOST
