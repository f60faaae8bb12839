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


_FIELDS = {
    # By relation: the letter of atoms on the left, of those on the right, where they stand, and the field.
    ("issuer", "C", "C"): ("certificates", "issuers"),
    ("signer", "P", "C"): ("documents", "signers"),
    **{(name, "R", "C"): ("trust_domains", name) for name in ("identity_ca", "permissions_ca", "revoked", "refuses")},
    ("governance", "R", "P"): ("trust_domains", "governance"),
    ("in_trust_domain", "E", "R"): ("enclaves", "trust_domain"),
    ("identity", "E", "C"): ("enclaves", "identity"),
    ("permissions", "E", "P"): ("enclaves", "permissions"),
    **{
        (name, "E", "T"): ("enclaves", name)
        for name in ("reads_alone", "writes_alone", "refused_writes", "refused_reads")
    },
    ("topic_expression", "TR", "T"): ("topic_rules", "channels"),
    ("subject_name", "G", "C"): ("grants", "names"),
    **{(name, "PR", "T"): ("rules", name) for name in ("publish", "subscribe", "relay")},
    ("in_domain", "T", "D"): ("channels", "domain"),
    ("domains", "DR", "D"): ("domain_rules", "domains"),
    ("domains", "PR", "D"): ("rules", "domains"),
    **{(name, letter, "I"): (where, name) for name in ("not_before", "not_after")
       for letter, where in (("C", "certificates"), ("G", "grants"))},
}  # fmt: skip
_FLAGS = {
    ("certificates", "C"): ("authority", "fit_to_sign", "opaque"),
    ("documents", "P"): ("intact", "opaque"),
    ("enclaves", "E"): ("opaque",),
    ("domain_rules", "DR"): ("allow_unauthenticated_participants", "enable_join_access_control"),
    ("topic_rules", "TR"): (
        *("enable_discovery_protection", "enable_liveliness_protection"),
        *("enable_read_access_control", "enable_write_access_control"),
    ),
    ("grants", "G"): ("default_allow",),
    ("rules", "PR"): ("allow",),
}
_KINDS = {
    ("domain_rules", "DR"): ("discovery", "liveliness", "rtps"),
    ("topic_rules", "TR"): ("metadata", "data"),
}
_PARENTS = {
    # By relation: the letter of the parent and of what belongs to it, where that stands, and the field.
    ("domain_rule", "P", "DR"): ("domain_rules", "document"),
    ("topic_rule", "DR", "TR"): ("topic_rules", "domain_rule"),
    ("grant", "P", "G"): ("grants", "document"),
    ("rule", "G", "PR"): ("rules", "grant"),
}
_BY_READING = {
    # What the reading says of each trust domain or of each grant.
    "R": ("asks_announced_only", "pins_signer", "requires_grant"),
    "G": ("skips_grants_out_of_date", "joins_out_of_date"),
}
_OTHERWISE = {"allow": "allow_rule", "skips_grants_out_of_date": "skipped_out_of_date"}
"""Fields whose relation has another name."""


def of_system(s: Any) -> Relations:
    """The same of the `System` that the native engine reads."""
    found: dict[str, set[tuple[str, ...]]] = {}

    def put(name: str, pairs: Iterable[tuple[str, ...]]) -> None:
        found.setdefault(_OTHERWISE.get(name, name), set()).update(pairs)

    for (name, left, right), (where, field) in _FIELDS.items():
        for number, each in enumerate(getattr(s, where)):
            value = getattr(each, field)
            several = () if value is None else (value,) if isinstance(value, int) else value
            put(name, ((f"{left}{number}", f"{right}{other}") for other in several))
        put(name, ())
    for (where, letter), fields in _FLAGS.items():
        for field in fields:
            put(field, ((f"{letter}{n}",) for n, each in enumerate(getattr(s, where)) if getattr(each, field)))
    for (where, letter), fields in _KINDS.items():
        for field in (f"{name}_protection_kind" for name in fields):
            put(field, ((f"{letter}{n}", getattr(each, field).value) for n, each in enumerate(getattr(s, where))))
    for (name, above, letter), (where, field) in _PARENTS.items():
        parents = [getattr(each, field) for each in getattr(s, where)]
        put(name, ((f"{above}{parent}", f"{letter}{n}") for n, parent in enumerate(parents)))
        put("precedes", _following(letter, parents))
    by_letter = {"R": list(s.trust_domains), "G": [s.documents[each.document] for each in s.grants]}
    for letter, fields in _BY_READING.items():
        numbered = [(f"{letter}{n}", s.readings[each.reading]) for n, each in enumerate(by_letter[letter])]
        for field in fields:
            put(field, ((atom,) for atom, reading in numbered if getattr(reading, field)))
    put(
        "reading",
        (
            (f"R{n}", f"P{document}")
            for n, each in enumerate(s.trust_domains)
            for document, other in enumerate(s.documents)
            if each.reading == other.reading
        ),
    )
    keys = {key: n for n, key in enumerate(sorted({c.key for c in s.certificates}))}
    put("public_key", ((f"C{n}", f"K{keys[c.key]}") for n, c in enumerate(s.certificates)))
    every = {each.value for each in type(next(iter(s.assumed)))} if s.assumed else set()
    told = {each.value for each in s.assumed}
    names = {"".join(word.capitalize() for word in each.split("-")) for each in told}
    put("assumed", [("Assumption",)] if told == every else [(name,) for name in names])
    put("audit_instant", [(f"I{s.now}",)])
    put("meets", ((f"T{n}", f"T{other}") for n, several in enumerate(s.meets) for other in several))
    put("following", ((f"I{n}", f"I{n + 1}") for n in range(len(s.instants) - 1)))
    return {name: frozenset(pairs) for name, pairs in found.items()}


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
