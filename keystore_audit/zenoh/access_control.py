"""What one process lets through: its access control, decided as measured (tests/oracles/zenoh).

Each link is judged by what is known of the process at its other end. A subject is what has all of its properties; of
several subjects that a process is, one that allows is enough. A rule is about a message if its expression includes the
message's: a wildcard message evades a rule that is narrower.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from itertools import product
from typing import Final

from msgspec import Struct

from keystore_audit.intent.source import Value, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.model.matching.key_expressions import EVERYTHING, VERBATIM, includes, intersects
from keystore_audit.profiles.routed import Release
from keystore_audit.truth import Truth, all_of, any_of
from keystore_audit.zenoh.json5 import Unclear, find, items

MAX_SUBJECTS: Final = 20_000
"""Subjects with one value of each property: lists of values multiply, and nobody writes so many."""


class Kind(str, Enum):
    """A kind of message (the values are those of `messages` in a rule)."""

    PUT = "put"
    DELETE = "delete"
    SUBSCRIBE = "declare_subscriber"
    QUERY = "query"
    REPLY = "reply"
    SERVE = "declare_queryable"
    TOKEN = "liveliness_token"  # noqa: S105 - a kind of message, not a password
    TOKEN_QUERY = "liveliness_query"  # noqa: S105 - the same
    TOKEN_SUBSCRIBE = "declare_liveliness_subscriber"  # noqa: S105 - the same


class Flow(str, Enum):
    """Whether a message comes in over a link, or goes out."""

    INGRESS = "ingress"
    EGRESS = "egress"


class Rule(Struct, frozen=True, kw_only=True):
    """A rule; `keys`: expressions, each with its line."""

    name: str
    line: int
    allow: bool
    kinds: frozenset[str]
    flows: frozenset[str]
    keys: tuple[tuple[str, int], ...]

    def is_about(self, kind: Kind, flow: Flow) -> bool:
        """Whether it is about such messages."""
        return kind.value in self.kinds and flow.value in self.flows


class Subject(Struct, frozen=True, kw_only=True):
    """Who a process is at the other end of a link, with one value of each property; None: any."""

    interface: str | None
    name: str | None
    """The first common name of its certificate."""
    user: str | None
    protocol: str | None
    zid: str | None

    @property
    def authenticated(self) -> bool:
        """Whether the other end has to prove something."""
        return self.name is not None or self.user is not None


class AccessControl(Struct, frozen=True, kw_only=True):
    """An access control that is enabled. `subjects`: the rules that policies give to each, and its line."""

    line: int
    allows: bool
    """Whether what no rule is about is allowed."""
    default_line: int
    rules: tuple[Rule, ...]
    subjects: Mapping[Subject, tuple[int, tuple[Rule, ...]]]
    unused: tuple[tuple[str, int], ...]
    """Rules and subjects that no policy names, with their lines."""

    @property
    def by_names(self) -> bool:
        """Whether nothing passes but what some rule allows to a certificate's name."""
        return not self.allows and all(subject.name is not None for subject in self.subjects)


class Remote(Struct, frozen=True):
    """What a process knows of another over their link.

    `name`: the common name that it authenticated, None: none. `free`: no access control is applied to the link.
    `chosen`: the other end is an attacker, who chooses its id.
    """

    name: str | None
    protocol: str
    free: bool = False
    chosen: bool = False


class Meant(Enum):
    """What a key expression stands for. That is each key of it by itself, one message with it, or any message that
    meets it. Or it is whatever somebody likes, whether it meets it or not.
    """

    EACH = "each"
    ONE = "one"
    ANY = "any"
    FREE = "free"


class Key(Struct, frozen=True):
    """What a message is about.

    `apart`: keys of it are left out that a narrower expression of a rule has, or one of these (None: all count).
    """

    text: str
    meant: Meant = Meant.EACH
    apart: tuple[str, ...] | None = None

    def has(self, rule: str, *, allow: bool) -> Truth:
        """Whether the expression of a rule is about it."""
        if self.meant is Meant.FREE:
            return Truth.UNKNOWN
        if self.meant is Meant.ANY and not allow:  # evaded by a wider message, which has the verbatim chunks of the key
            sure = VERBATIM not in self.text and includes(rule, EVERYTHING)
        else:
            sure = includes(rule, self.text)
        if sure or self.meant is Meant.ONE or not intersects(rule, self.text):
            return Truth.YES if sure else Truth.NO
        left_out = self.apart is not None and any(includes(each, rule) for each in (self.text, *self.apart))
        return Truth.NO if left_out else Truth.UNKNOWN


class Decision(Struct, frozen=True):
    """Whether a message passes, the line that decides, None where that is no line, and why."""

    truth: Truth
    line: int | None
    reason: str


def read_access_control(value: Value | None) -> AccessControl | None:
    """Read a section that is well formed; None where it is not enabled, whatever else it says (measured).

    Raises Malformed where the process would not start with it, and Unclear where subjects are too many.
    """
    enabled, default = find(value, "enabled"), find(value, "default_permission")
    if value is None or enabled is None or enabled.content is not True:
        return None
    lists = [find(value, name) for name in ("rules", "subjects", "policies")]
    if None in lists:
        raise Malformed(value.line, "access_control is enabled and lacks rules, subjects or policies")
    rules, subjects, policies = map(items, lists)
    by_name = {_text(each, "id"): _rule(each) for each in rules}
    for what, every in (("rule", rules), ("subject", subjects), ("policy", policies)):
        _check_ids(what, every)
    given: dict[str, list[Rule]] = {_text(each, "id"): [] for each in subjects}
    for policy in policies:
        _give(policy, by_name, given)
    named = {rule.name for each in given.values() for rule in each}
    return AccessControl(
        line=value.line,
        allows=default is not None and default.content == "allow",
        default_line=value.line if default is None else default.line,
        rules=tuple(by_name.values()),
        subjects=_subjects(subjects, given),
        unused=(
            *((f"rule {rule.name}", rule.line) for rule in by_name.values() if rule.name not in named),
            *((f"subject {_text(s, 'id')}", s.line) for s in subjects if not given[_text(s, "id")]),
        ),
    )


def _text(value: Value, name: str) -> str:
    found = find(value, name)
    return f"{found.content}" if found is not None else ""


def _texts(value: Value, name: str) -> list[tuple[str, int]]:
    return [(f"{each.content}", each.line) for each in items(find(value, name))]


def _rule(value: Value) -> Rule:
    flows = [text for text, _line in _texts(value, "flows")]
    return Rule(
        name=_text(value, "id"),
        line=value.line,
        allow=_text(value, "permission") == "allow",
        kinds=frozenset(text for text, _line in _texts(value, "messages")),
        flows=frozenset(flows or (each.value for each in Flow)),
        keys=tuple(_texts(value, "key_exprs")),
    )


def _check_ids(what: str, every: Iterable[Value]) -> None:
    """Raise Malformed for an id that is empty or stands twice; policies may have none."""
    seen: set[str] = set()
    for each in every:
        said = find(each, "id")
        name = f"{said.content}" if said is not None else ""
        if said is not None and not name.strip():
            raise Malformed(each.line, f"a {what} has an empty id")
        if said is not None and name in seen:
            raise Malformed(each.line, f"the id {shown(name)} is that of two {what}s".replace("policys", "policies"))
        seen.add(name)


def _give(policy: Value, rules: Mapping[str, Rule], given: Mapping[str, list[Rule]]) -> None:
    """Give the policy's rules to its subjects. Raises Malformed for ids that nothing has."""
    named, who = _texts(policy, "rules"), _texts(policy, "subjects")
    if not named or not who:
        raise Malformed(policy.line, "a policy has no rules or no subjects")
    for name, line in who:
        if name not in given:
            raise Malformed(line, f"a policy names the subject {shown(name)}, which is not there")
        for rule, place in named:
            if rule not in rules:
                raise Malformed(place, f"a policy names the rule {shown(rule)}, which is not there")
            given[name].append(rules[rule])


_PROPERTIES: Final = ("interfaces", "cert_common_names", "usernames", "link_protocols", "zids")


def _subjects(every: Iterable[Value], given: Mapping[str, list[Rule]]) -> dict[Subject, tuple[int, tuple[Rule, ...]]]:
    """By what they are: two ids with the same properties are one subject (measured)."""
    found: dict[Subject, tuple[int, tuple[Rule, ...]]] = {}
    for each in every:
        values: list[list[tuple[str, int]]] = [_texts(each, name) for name in _PROPERTIES]
        for text, line in (*values[0], *values[1], *values[2]):
            if not text.strip():
                raise Malformed(line, "a subject has an empty text as a property")
        choices: list[list[str | None]] = [[text for text, _line in texts] or [None] for texts in values]
        for one in product(*choices):
            subject = Subject(interface=one[0], name=one[1], user=one[2], protocol=one[3], zid=one[4])
            line, rules = found.get(subject, (each.line, ()))
            found[subject] = line, (*rules, *given[_text(each, "id")])
            if len(found) > MAX_SUBJECTS:
                raise Unclear(f"more than {MAX_SUBJECTS} subjects, which are not read")
    return found


def decide(
    access: AccessControl | None, remote: Remote, kind: Kind, flow: Flow, key: Key, release: Release
) -> Decision:
    """Whether the message passes over the link to `remote`."""
    if access is None or remote.free:
        why = "no access control is enabled" if access is None else "no access control is applied to a multicast link"
        return Decision(Truth.YES, None, why)
    if kind is Kind.DELETE and flow is Flow.EGRESS and release.deletes_as_puts:
        kind = Kind.PUT
    judged = [
        (is_it, *_of_subject(access, rules, kind, flow, key))
        for subject, (_l, rules) in access.subjects.items()
        if (is_it := _is(subject, remote)).may
    ]
    default = Decision(
        Truth.YES if access.allows else Truth.NO,
        access.default_line,
        f"no rule is about it, and the default is {'allow' if access.allows else 'deny'}",
    )
    if not judged:
        return default
    if release.asks_one_subject and len(judged) > 1:
        answers = {truth for _is_it, truth, _line, _why in judged}
        answers |= set() if any(is_it.must for is_it, _truth, _line, _why in judged) else {default.truth}
        truth = answers.pop() if len(answers) == 1 else Truth.UNKNOWN
    else:
        allowed = any_of(all_of((is_it, truth)) for is_it, truth, _line, _why in judged)
        nobody = all_of(is_it.negated for is_it, _truth, _line, _why in judged)
        truth = any_of((allowed, all_of((nobody, default.truth))))
    line, reason = next(((line, why) for _is, own, line, why in judged if own is truth), judged[0][2:])
    return Decision(truth, line, reason)


def _is(subject: Subject, remote: Remote) -> Truth:
    """Whether the process at the other end is the subject: all is compared exactly, letter by letter (measured)."""
    said = (
        Truth.YES if subject.interface is None else Truth.UNKNOWN,
        Truth.YES if subject.name in (None, remote.name) else Truth.NO,
        Truth.YES if subject.user is None else Truth.UNKNOWN,
        Truth.YES if subject.protocol in (None, remote.protocol) else Truth.NO,
        Truth.YES if subject.zid is None or remote.chosen else Truth.UNKNOWN,
    )
    return all_of(said)


def _of_subject(
    access: AccessControl, rules: Iterable[Rule], kind: Kind, flow: Flow, key: Key
) -> tuple[Truth, int | None, str]:
    """What the rules of one subject say: a deny wins, order does not count (measured)."""
    hits = {
        allow: _hit((r for r in rules if r.allow is allow and r.is_about(kind, flow)), key) for allow in (True, False)
    }
    (denied, deny_line, denial), (allowed, allow_line, allowance) = hits[False], hits[True]
    passes = Truth.YES if access.allows else allowed
    truth = all_of((passes, denied.negated))
    if denied.may and (denied.must or truth is not Truth.YES):
        return truth, deny_line, f"the rule {denial} denies {kind.value}"
    if allowed.may:
        return truth, allow_line, f"the rule {allowance} allows {kind.value}"
    return truth, access.default_line, f"no rule is about {kind.value} of it ({flow.value})"


def _hit(rules: Iterator[Rule], key: Key) -> tuple[Truth, int | None, str]:
    """Whether some rule is about the key, the line of its expression, and its name."""
    best: tuple[Truth, int | None, str] = (Truth.NO, None, "")
    for rule in rules:
        for text, line in rule.keys:
            had = key.has(text, allow=rule.allow)
            if had is Truth.YES:
                return had, line, shown(rule.name)
            if had.may and not best[0].may:
                best = (had, line, shown(rule.name))
    return best
