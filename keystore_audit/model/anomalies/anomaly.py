"""What is odd about rules of a document, though they mean something: values of `model.anomalies.find`."""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from itertools import count
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.profiles import Matcher


class AnomalyKind(str, Enum):
    """Kinds of anomalies.

    A rule *fires* where it is the first that matches; where it does, it decides. UNREACHABLE: the rule fires nowhere,
    and somewhere an earlier one decides the opposite. EXPRESSION_UNREACHABLE: the same of one expression of a rule
    that fires by others. REDUNDANT: nothing changes if the rule is taken out. SAME_AS_DEFAULT: nothing changes, since
    the default decides as it does. CORRELATED: two expressions of opposite rules share names, neither holds all of the
    other's, and their order decides. GENERALISED: the earlier of two opposite expressions is an exception to the later
    one. UNGOVERNED_DOMAIN: no governance covers a domain of the rule. MATCHES_NOTHING: an expression without a name
    that it could be about. NOT_ROS: it matches names, but none that ROS 2 produces. NO_COUNTERPART: a topic that may
    be written and that nobody may read, or the reverse. TOPIC_RULE_SHADOWED, DOMAIN_RULE_SHADOWED: rules of the
    governance that apply to nothing. NOT_WORKED_OUT: there is too much to compare.
    """

    UNREACHABLE = "rule unreachable"
    EXPRESSION_UNREACHABLE = "expression unreachable"
    REDUNDANT = "rule redundant"
    SAME_AS_DEFAULT = "rule same as default"
    CORRELATED = "rules correlated"
    GENERALISED = "rule generalised"
    UNGOVERNED_DOMAIN = "rule in no governed domain"
    MATCHES_NOTHING = "expression matches nothing"
    NOT_ROS = "expression matches no ROS name"
    NO_COUNTERPART = "no counterpart"
    TOPIC_RULE_SHADOWED = "topic rule shadowed"
    DOMAIN_RULE_SHADOWED = "domain rule shadowed"
    NOT_WORKED_OUT = "not worked out"


class Point(NamedTuple):
    """One name of a topic and of a partition in one domain, and what is done there."""

    operation: Operation
    topic: str
    partition: str
    domain: int


class RuleAnomaly(Struct, frozen=True, kw_only=True):
    """An anomaly among ordered rules, by their numbers.

    `rule`: the one it is about; `other`: the one that decides in its place, makes it redundant or contradicts it.
    `operation`, `expression`, `other_expression`: where it is about single expressions. `point`: an example.
    """

    kind: AnomalyKind
    rule: int
    other: int | None = None
    operation: Operation | None = None
    expression: str | None = None
    other_expression: str | None = None
    point: Point | None = None


class Anomaly(Struct, frozen=True, kw_only=True):
    """An anomaly of a document.

    `allow`: whether the rule allows (True of a governance). `subject`: whom the grant names. `line`, `other`: of what
    it is about, and of what decides in its place. `texts`: the expression concerned, or those of the rule.
    `other_text`: that of the other rule, the name meant, the operation or the domains. `point`: an example, or None.
    `key`: the rule and expression by what they say, without lines. `rules`: the lines of the rules concerned.
    `serious`: a denial or protection that is written down is not there. `profiles`: the chosen ones under which it is
    so; empty: all that read the document.
    """

    kind: AnomalyKind
    allow: bool = True
    subject: str = ""
    line: int | None
    other: int | None = None
    texts: tuple[str, ...] = ()
    other_text: str = ""
    point: Point | None = None
    key: str
    serious: bool = False
    rules: frozenset[int | None] = frozenset()
    profiles: tuple[str, ...] = ()


# The names of one document in classes: the quick way for what people write, `atoms.classify` for the rest.
#
# Expressions with one `*` at most lie inside one another or apart, most often. Their classes then need no automaton: a
# literal is one. Of an expression with a `*` it is what no narrower one takes: always infinitely many names.


_TIERS: Final = (64, 512, 2_048)
"""States with which `classify` is tried, one after the other: what people write needs some dozens."""

_STATES: Final = 8_192
_STATES_PER_DOCUMENT: Final = 64
"""States for all documents of one keystore: about half a second, and three milliseconds for each document."""

_MAX_CHARACTERS: Final = 10_000
_CHARACTERS_PER_STATE: Final = 8
"""Characters of the expressions that `classify` is given, and as many of them as cost what a state does."""

_MAX_PAIRS: Final = 40_000
"""Pairs of expressions that the quick way compares, some ten milliseconds."""

_FILLERS: Final = string.ascii_lowercase + string.ascii_uppercase + "_" + string.digits
_LEADS: Final = ("", "/", "t/", "rt/", "q/", "rq/", "rr/")
"""What may stand for a `*`: one of these and a character, so `*` becomes `rt/a`."""


class NameClass(NamedTuple):
    """Names that exactly the expressions `members` match (indices), and one of them."""

    members: frozenset[int]
    witness: str


class Effort(Struct):
    """What may still be spent on one keystore's anomalies. `documents`: how many it has."""

    states: int
    pairs: int

    @classmethod
    def of(cls, documents: int) -> Effort:
        """The effort for so many documents."""
        return cls(states=_STATES + _STATES_PER_DOCUMENT * documents, pairs=_MAX_PAIRS + 100 * documents)

    def compare(self, pairs: int) -> None:
        """Raises errors.BudgetExceeded once more pairs were compared than may be."""
        self.pairs -= pairs
        if self.pairs < 0:
            raise BudgetExceeded("there are too many pairs of expressions that overlap")


def name_classes(texts: Sequence[str], matcher: Matcher, effort: Effort) -> Sequence[NameClass]:
    """The classes of the names that one of the distinct expressions `texts` matches.

    Raises errors.BudgetExceeded where there are too many to be worked out.
    """
    patterns = [parse(text, matcher) for text in texts]
    quick = _nested(patterns)
    return quick if quick is not None else _classified(patterns, effort)


def _classified(patterns: Sequence[Pattern], effort: Effort) -> Sequence[NameClass]:
    characters = sum(len(pattern.text) for pattern in patterns if pattern.literal is None)
    if characters > _MAX_CHARACTERS:
        raise BudgetExceeded("there are too many expressions with several wildcards")
    for states in _TIERS:
        effort.states -= states + characters // _CHARACTERS_PER_STATE
        if effort.states < 0:
            raise BudgetExceeded("there are too many expressions with several wildcards")
        try:
            found = classify(patterns, budget=states)
        except BudgetExceeded:
            if states == _TIERS[-1]:
                raise
            continue
        return [NameClass(each.members, each.witness) for each in found if each.members]
    return ()


def _nested(patterns: Sequence[Pattern]) -> list[NameClass] | None:
    """The classes of literals and of expressions with one `*`, of which each two lie apart or inside one another."""
    literals: dict[str, list[int]] = {}
    stars: dict[tuple[str, str], list[int]] = {}
    for number, pattern in enumerate(patterns):
        name = pattern.literal
        if name is not None:
            literals.setdefault(name, []).append(number)
            continue
        ends = pattern.pieces
        if len(ends) != 2 or not isinstance(ends[0], str) or not isinstance(ends[1], str):
            return None
        stars.setdefault((ends[0], ends[1]), []).append(number)
    if len(stars) * (len(stars) + len(literals)) > _MAX_PAIRS:
        return None
    inside = _inside(list(stars))
    if inside is None:
        return None
    found = []
    for name, own in literals.items():
        around = [n for (prefix, suffix), n in stars.items() if _holds(prefix, suffix, name)]
        if name:
            found.append(NameClass(frozenset(own).union(*around) if around else frozenset(own), name))
    for star, narrower in inside.items():
        witness = _beside(star, narrower, literals)
        if witness is None:
            return None
        wider = (stars[other] for other, within in inside.items() if star in within)
        members = frozenset(stars[star]).union(*wider)
        found.append(NameClass(members, witness))
    return found


_Star = tuple[str, str]
"""What an expression with one `*` has before and behind it."""


def _holds(prefix: str, suffix: str, name: str) -> bool:
    return len(name) >= len(prefix) + len(suffix) and name.startswith(prefix) and name.endswith(suffix)


def _inside(stars: Sequence[_Star]) -> dict[_Star, set[_Star]] | None:
    """For each star, those inside of it; None where two overlap otherwise."""
    inside: dict[_Star, set[_Star]] = {star: set() for star in stars}
    for number, one in enumerate(stars):
        for other in stars[number + 1 :]:
            before = _order(one[0].startswith(other[0]), other[0].startswith(one[0]))
            behind = _order(one[1].endswith(other[1]), other[1].endswith(one[1]))
            if before is None or behind is None:  # no name begins, or ends, in both ways
                continue
            if before * behind < 0:
                return None
            wide, narrow = (other, one) if before + behind > 0 else (one, other)
            inside[wide].add(narrow)
    return inside


def _order(first_extends: bool, second_extends: bool) -> int | None:
    """1: the first is the longer, -1: the second is, 0: they are equal, None: neither extends the other."""
    if first_extends and second_extends:
        return 0
    return 1 if first_extends else -1 if second_extends else None


def _beside(star: _Star, narrower: Iterable[_Star], literals: Mapping[str, object]) -> str | None:
    """A name of the expression that no narrower one takes and that is no literal; None if no character is left.

    What stands for the `*` begins and ends unlike the narrower ones do there. It is a name of ROS 2, if possible.
    """
    prefix, suffix = star
    begun = {each[0][len(prefix)] for each in narrower if len(each[0]) > len(prefix)}
    ended = {each[1][-len(suffix) - 1] for each in narrower if len(each[1]) > len(suffix)}
    filler = next((filler for filler in _FILLERS if filler not in ended and filler not in begun), None)
    if filler is None:
        return None
    ways = (lead + filler for lead in _LEADS if not lead or lead[0] not in begun)
    way = next((way for way in ways if is_ros_dds_name(prefix + way + suffix)), filler)
    longer = (f"{prefix}{way}{filler * more}{suffix}" for more in count())
    return next(name for name in longer if name not in literals)
