"""What both engines are given of a system: the `System` itself, and the text for Alloy, each as named relations.

The text is parsed back here by its grammar alone: `one sig` atoms, functions that are unions of products. An atom is
its letters and its number, so that the two can be compared as they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

Tuples = frozenset[tuple[str, ...]]
Relations = dict[str, Tuples]

_FUNCTION = re.compile(r"^(?:private )?fun (\w+): [^{]*\{(.*?)\}\s*$", re.MULTILINE | re.DOTALL)
_SIG = re.compile(r"^(?:private )?(abstract|one) sig (\w+) extends (\w+) \{\}$", re.MULTILINE)
_TOKEN = re.compile(r"->|[+()]|[\w/]+")
_SORTS = frozenset(
    [
        "Certificate",
        "Key",
        "Instant",
        "Document",
        "TrustDomain",
        "Enclave",
        "Domain",
        "Channel",
        "DomainRule",
        "TopicRule",
        "Grant",
        "Rule",
        "Unmanaged",
    ]
)
_ATOM = re.compile(r"([A-Z]{1,2}\d+)(?:_\w*)?")


def of_alloy(text: str) -> Relations:
    """The relations of a module of facts."""
    return _Module(text).relations()


class _Module:
    def __init__(self, text: str) -> None:
        text = "\n".join(line for line in text.split("\n") if not line.startswith(("--", " *", "/**")))
        self._members: dict[str, set[str]] = {}
        parents = {"Unmanaged": "Enclave"}
        for kind, name, parent in _SIG.findall(text):
            parents[name] = parent
            if kind == "one":
                self._members[name] = {name}
        for name in [name for name, members in self._members.items() if members == {name}]:
            above = parents.get(name)
            while above is not None:
                self._members.setdefault(above, set()).add(name)
                above = parents.get(above)
        self._bodies = dict(_FUNCTION.findall(text))
        self._known: dict[str, Tuples] = {}

    def relations(self) -> Relations:
        return {name: self._function(name) for name in self._bodies if not re.match(r"some_|\w+_\d+$", name)}

    def _function(self, name: str) -> Tuples:
        if name not in self._known:
            self._known[name] = self._union(_TOKEN.findall(self._bodies[name]))
        return self._known[name]

    def _union(self, tokens: list[str]) -> Tuples:
        found, rest = self._sum(tokens)
        assert not rest, rest
        return found

    def _sum(self, tokens: list[str]) -> tuple[Tuples, list[str]]:
        found, tokens = self._product(tokens)
        while tokens and tokens[0] == "+":
            more, tokens = self._product(tokens[1:])
            found |= more
        return found, tokens

    def _product(self, tokens: list[str]) -> tuple[Tuples, list[str]]:
        found, tokens = self._primary(tokens)
        while tokens and tokens[0] == "->":
            right, tokens = self._primary(tokens[1:])
            found = frozenset(a + b for a in found for b in right)
        return found, tokens

    def _primary(self, tokens: list[str]) -> tuple[Tuples, list[str]]:
        if tokens[0] == "(":
            found, tokens = self._sum(tokens[1:])
            assert tokens[0] == ")"
            return found, tokens[1:]
        name = tokens[0]
        if name == "none":
            return frozenset(), tokens[1:]
        if name in self._bodies:
            return self._function(name), tokens[1:]
        members = self._members.get(name, set() if name in _SORTS else {name})
        return frozenset((_short(member),) for member in members), tokens[1:]


def _short(name: str) -> str:
    match = _ATOM.fullmatch(name)
    return match[1] if match else name


def of_system(system: Any) -> Relations:  # noqa: C901 - a list
    """The same of the `System` that the native engine reads."""
    s, found = system, {}

    def put(name: str, pairs: Iterable[tuple[str, ...]]) -> None:
        found[name] = frozenset(pairs)

    def rows(left: str, right: str, several: Iterable[Iterable[int] | None]) -> Iterator[tuple[str, str]]:
        yield from ((f"{left}{n}", f"{right}{m}") for n, each in enumerate(several) for m in each or ())

    def lone(number: int | None) -> tuple[int, ...]:
        return () if number is None else (number,)

    def flags(letter: str, several: Iterable[bool]) -> Iterator[tuple[str]]:
        yield from ((f"{letter}{n}",) for n, each in enumerate(several) if each)

    keys = {key: n for n, key in enumerate(sorted({c.key for c in s.certificates}))}
    put("issuer", rows("C", "C", [c.issuers for c in s.certificates]))
    put("authority", flags("C", [c.authority for c in s.certificates]))
    put("fit_to_sign", flags("C", [c.fit_to_sign for c in s.certificates]))
    put("public_key", rows("C", "K", [[keys[c.key]] for c in s.certificates]))
    for name in ("not_before", "not_after"):
        dated = [(letter, getattr(each, name), n) for letter, several in (("C", s.certificates), ("G", s.grants))
                 for n, each in enumerate(several)]  # fmt: skip
        put(name, ((f"{letter}{n}", f"I{instant}") for letter, instant, n in dated))
    put("audit_instant", [(f"I{s.now}",)])
    put("intact", flags("P", [d.intact for d in s.documents]))
    put("signer", rows("P", "C", [d.signers for d in s.documents]))
    opaque = [("P", s.documents), ("E", s.enclaves), ("C", s.certificates)]
    put("opaque", (row for letter, several in opaque for row in flags(letter, [each.opaque for each in several])))
    every_trust_domain = [(f"R{n}",) for n in range(len(s.trust_domains))]
    every = {each.value for each in type(next(iter(s.assumed)))} if s.assumed else set()
    told = {each.value for each in s.assumed}
    names = {"".join(word.capitalize() for word in each.split("-")) for each in told}
    put("assumed", [("Assumption",)] if told == every else [(name,) for name in names])
    put("asks_announced_only", every_trust_domain if s.asks_announced_only else [])
    put("pins_signer", every_trust_domain if s.pins_signer else [])
    put("requires_grant", every_trust_domain if s.requires_grant else [])
    for name in ("identity_ca", "permissions_ca", "revoked", "refuses"):
        put(name, rows("R", "C", [getattr(trust_domain, name) for trust_domain in s.trust_domains]))
    put("governance", rows("R", "P", [lone(trust_domain.governance) for trust_domain in s.trust_domains]))
    put("in_trust_domain", rows("E", "R", [[e.trust_domain] for e in s.enclaves]))
    put("identity", rows("E", "C", [lone(e.identity) for e in s.enclaves]))
    put("permissions", rows("E", "P", [lone(e.permissions) for e in s.enclaves]))
    for name in ("reads_alone", "writes_alone", "refused_writes", "refused_reads"):
        put(name, rows("E", "T", [getattr(e, name) for e in s.enclaves]))
    siblings = (
        ("DR", [rule.document for rule in s.domain_rules]),
        ("TR", [rule.domain_rule for rule in s.topic_rules]),
        ("G", [grant.document for grant in s.grants]),
        ("PR", [rule.grant for rule in s.rules]),
    )
    put("precedes", (pair for letter, parents in siblings for pair in _following(letter, parents)))
    put("domain_rule", ((f"P{r.document}", f"DR{n}") for n, r in enumerate(s.domain_rules)))
    put("topic_rule", ((f"DR{r.domain_rule}", f"TR{n}") for n, r in enumerate(s.topic_rules)))
    put("grant", ((f"P{g.document}", f"G{n}") for n, g in enumerate(s.grants)))
    put("rule", ((f"G{r.grant}", f"PR{n}") for n, r in enumerate(s.rules)))
    covered = [*rows("DR", "D", [r.domains for r in s.domain_rules]), *rows("PR", "D", [r.domains for r in s.rules])]
    put("domains", covered)
    for letter, several, names in (
        ("DR", s.domain_rules, ("allow_unauthenticated_participants", "enable_join_access_control")),
        ("TR", s.topic_rules, ("enable_discovery_protection", "enable_liveliness_protection",
                               "enable_read_access_control", "enable_write_access_control")),
        ("G", s.grants, ("default_allow",)),
    ):  # fmt: skip
        for name in names:
            put(name, flags(letter, [getattr(each, name) for each in several]))
    for letter, several, names in (
        ("DR", s.domain_rules, ("discovery", "liveliness", "rtps")),
        ("TR", s.topic_rules, ("metadata", "data")),
    ):
        for name in (f"{name}_protection_kind" for name in names):
            put(name, ((f"{letter}{n}", getattr(each, name).value) for n, each in enumerate(several)))
    put("topic_expression", rows("TR", "T", [r.channels for r in s.topic_rules]))
    put("subject_name", rows("G", "C", [g.names for g in s.grants]))
    every_grant = [(f"G{n}",) for n in range(len(s.grants))]
    put("skipped_out_of_date", every_grant if s.skips_grants_out_of_date else [])
    put("joins_out_of_date", every_grant if s.joins_out_of_date else [])
    put("allow_rule", flags("PR", [r.allow for r in s.rules]))
    for name in ("publish", "subscribe", "relay"):
        put(name, rows("PR", "T", [getattr(r, name) for r in s.rules]))
    put("in_domain", ((f"T{n}", f"D{c.domain}") for n, c in enumerate(s.channels)))
    put("meets", rows("T", "T", s.meets))
    put("following", ((f"I{n}", f"I{n + 1}") for n in range(len(s.instants) - 1)))
    return found


def _following(letter: str, parents: list[int]) -> Iterator[tuple[str, str]]:
    last: dict[int, int] = {}
    for number, parent in enumerate(parents):
        if parent in last:
            yield f"{letter}{last[parent]}", f"{letter}{number}"
        last[parent] = number


def differences(system: Any, text: str) -> list[str]:
    """Where the text for Alloy does not say what the system says."""
    native, alloy = of_system(system), of_alloy(text)
    alloy.pop("refuses_trust_domain", None)  # worked out from what trust domains tell one another
    return [
        f"{name}: native alone {sorted(native.get(name, set()) - alloy.get(name, set()))[:3]}, "
        f"Alloy alone {sorted(alloy.get(name, set()) - native.get(name, set()))[:3]}"
        for name in sorted({*native, *alloy})
        if native.get(name) != alloy.get(name)
    ]
