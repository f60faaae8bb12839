"""What is odd about rules of a document, though they mean something: values of `model.anomalies.find`."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from msgspec import Struct

from keystore_audit.keystore.permissions import Operation


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
