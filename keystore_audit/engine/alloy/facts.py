"""A `System` as an Alloy module: atoms and constant relations, nothing concluded from them.

The relations are functions without arguments over `one sig` atoms: these are constants for the translator. As fields
of sigs, equated in facts, the same keystore takes some hundred times as long. With 100 enclaves and 200 topics, a
command then takes 21 to 62 s instead of 0.1 to 0.2 s. The text is deterministic, in the order of the system's indices.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit import resources, text
from keystore_audit.assumptions import EVERY
from keystore_audit.engine.alloy.atoms import (
    SORTS,
    Relations,
    Row,
    declare,
    declare_apart,
    function,
    keys_of,
    name_atoms,
)
from keystore_audit.errors import EngineFailed
from keystore_audit.grouped import gathered
from keystore_audit.model.formal.system import System

MODULES: Final = (
    "dds_security.als",
    "precedence.als",
    "authentication.als",
    "documents.als",
    "governance.als",
    "permissions.als",
    "capabilities.als",
    "outsiders.als",
    "enforcement.als",
    "properties.als",
    "vacuity.als",
)
"""The hand-written modules, each opening the one before (`keystore.als` stands after the first)."""

KEYSTORE: Final = "keystore.als"
"""The generated module of facts."""

MAIN: Final = "audit.als"
"""The generated main file: commands only."""

SPLIT_ATOMS: Final = 400
"""Atoms up to which all stand in `keystore` (`fact_modules`)."""

MODULE_GROUPS: Final = 2  # of up to `atoms.GROUP` atoms in one module, where there are more atoms

_HEADER: Final = "module keystore\nopen dds_security"

CHILDREN: Final = {
    "domain_rules": ("domain_rule", "document", "documents"),
    "topic_rules": ("topic_rule", "domain_rule", "domain_rules"),
    "grants": ("grant", "document", "documents"),
    "rules": ("rule", "grant", "grants"),
}
"""By sort of entries: the relation from their parents, the field that names the parent, and the sort of that."""

REFERENCES: Final[Mapping[str, Mapping[str, str]]] = {
    "certificates": {"issuers": "certificates"},
    "documents": {"signers": "certificates"},
    "trust_domains": {
        **dict.fromkeys(("identity_ca", "permissions_ca"), "certificates"),
        "governance": "documents",
        **dict.fromkeys(("revoked", "refuses"), "certificates"),
    },
    "enclaves": {
        "identity": "certificates",
        "permissions": "documents",
        **dict.fromkeys(("reads_alone", "writes_alone", "refused_writes", "refused_reads"), "channels"),
    },
    "topic_rules": {"channels": "channels"},
    "grants": {"names": "certificates"},
    "rules": dict.fromkeys(("publish", "subscribe", "relay"), "channels"),
}
"""By sort: the fields, apart from an entry's parent, that name atoms which `merging` may leave out, and their sort."""

_BELONGING: Final[Mapping[str, Mapping[str, str]]] = {
    "enclaves": {"trust_domain": "trust_domains"},
    "channels": {"domain": "domains"},
}
"""By sort the field that names what an entry lies in, which is never left out."""

_FLAGS: Final = {
    "certificates": ("authority", "fit_to_sign"),
    "documents": ("intact",),
    "domain_rules": ("allow_unauthenticated_participants", "enable_join_access_control"),
    "topic_rules": (
        "enable_discovery_protection",
        "enable_liveliness_protection",
        "enable_read_access_control",
        "enable_write_access_control",
    ),
    "grants": ("default_allow",),
    "rules": ("allow",),
}
"""By sort its flags: a set each."""

_KINDS: Final = {"domain_rules": ("discovery", "liveliness", "rtps"), "topic_rules": ("metadata", "data")}
"""By sort its protection kinds."""

_RELATIONS: Final = {
    "issuers": "issuer",
    "signers": "signer",
    "channels": "topic_expression",
    "names": "subject_name",
    "trust_domain": "in_trust_domain",
    "domain": "in_domain",
    "allow": "allow_rule",
}
"""By such a field its relation or set, where that is called otherwise."""

CONSISTENCY: Final = "FactsAreConsistent"
"""The run that must have an instance: no check means anything without it."""


def facts(system: System) -> str:
    """Return the module `keystore` for `system`. Names of the keystore stand in comments only."""
    sorts = name_atoms(system).values()
    sections = _Facts(system).sections()
    return "\n\n".join([_header(system), *filter(None, map(declare, sorts)), *sections]) + "\n"


def fact_modules(system: System, lone: Collection[str] = ()) -> dict[str, str]:
    """Return `facts` as the files that the Analyzer reads fast: name to text, without what only people read.

    Equal systems have the same files, whatever the instant, or where their documents lie. `lone`: atoms that need not
    be there, of a system of at most SPLIT_ATOMS.

    For each name the Analyzer looks through all sigs that are visible there. For each sig and function it looks through
    all sigs of its module. So atoms, if many, are in modules of their own, each with a module of functions for them.
    These modules open the atoms privately, so that `keystore` sees no atom's sig.
    """
    sorts = name_atoms(system).values()
    if sum(len(sort.atoms) for sort in sorts) <= SPLIT_ATOMS:
        declared = filter(None, (declare(sort, commented=False, lone=lone) for sort in sorts))
        return {KEYSTORE: "\n\n".join([_HEADER, *declared, *_Facts(system).sections()]) + "\n"}
    groups = [group for sort in sorts for group in declare_apart(sort)]
    opened, modules = [], {}
    for number, start in enumerate(range(0, len(groups), MODULE_GROUPS)):
        sigs, names = zip(*groups[start : start + MODULE_GROUPS], strict=True)
        modules[f"atoms_{number}.als"] = "\n".join([f"module atoms_{number}\nopen dds_security\n", *sigs]) + "\n"
        head = f"module names_{number}\nprivate open atoms_{number}\n"
        modules[f"names_{number}.als"] = "\n".join([head, *names]) + "\n"
        opened.append(f"open names_{number}")
    header = "\n".join([_HEADER, *opened])
    modules[KEYSTORE] = "\n\n".join([header, *_Facts(system).sections()]) + "\n"
    return modules


def count_atoms(system: System) -> int:
    """Return how many atoms the model of `system` has."""
    stated = (getattr(system, sort) for sort in SORTS if sort not in ("keys", "nodes"))
    return len(keys_of(system)) + sum(map(len, stated))


def module_texts(names: Sequence[str]) -> dict[str, str]:
    """Return the text of hand-written modules."""
    folder = resources.alloy()
    try:
        return {name: (folder / name).read_text(encoding="ascii") for name in names}
    except (OSError, UnicodeDecodeError) as error:
        raise EngineFailed(f"This installation is incomplete: an Alloy module cannot be read ({error}).") from error


def _header(system: System) -> str:
    counted = "counts as anything" if system.may else "is left out"
    instant = text.instant(system.instants[system.now])
    lines = [
        "/**",
        " * The facts of one keystore, written by keystore-audit. Do not edit.",
        " *",
        f" * As read by {text.alloy_comment(', '.join(system.profiles))}.",
        f" * What could not be read {counted}. The audit instant is {instant}.",
        " * Above each atom is what it is in the keystore, and where. `dds_security` says what functions mean.",
        " * A channel has one of its names, and stands for all names that no document tells apart from it.",
        " * ROS 2 topics begin with `rt/`; a service is two topics, which begin with `rq/` and `rr/`. `DDS only` means",
        " * that no ROS 2 name is in this channel.",
        " */",
        _HEADER,
    ]
    return "\n".join(lines)


class _Facts:
    """Writes the relations of one system, section by section. Sorts are called as in `System`."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._atoms = name_atoms(system)
        self._relations = Relations()

    def sections(self) -> Iterator[str]:
        """What the tables say of each sort, then what is its own."""
        more: dict[str, Iterator[str]] = {
            "certificates": self._dates(),
            "documents": self._taken_for_granted(),
            "trust_domains": self._refusals(),
            "domain_rules": self._order(),
            "grants": self._out_of_date(),
            "channels": iter([self._map("meets", "channels", "channels", self._system.meets)]),
        }
        for sort in self._atoms:
            written = [*self._tables(sort), *more.get(sort, ())]  # before its helpers are taken
            if written:
                yield "\n".join([f"-- {sort.replace('_', ' ')}", *self._relations.take_private(), *written])

    def _tables(self, sort: str) -> Iterator[str]:
        atoms, entries = self._atoms[sort], getattr(self._system, sort, ())
        if sort in CHILDREN:
            yield self._children(sort)
        for field, to in {**_BELONGING.get(sort, {}), **REFERENCES.get(sort, {})}.items():
            declared = f"{atoms.sig} -> {self._atoms[to].sig}"
            yield self._relations.relation(_RELATIONS.get(field, field), declared, self._rows(sort, field, to))
        for flag in _FLAGS.get(sort, ()):
            yield self._relations.subset(_RELATIONS.get(flag, flag), atoms, self._those(sort, flag))
        for name in (f"{each}_protection_kind" for each in _KINDS.get(sort, ())):
            kinds = [getattr(rule, name).value for rule in entries]
            rows = self._relations.constant_rows(atoms, kinds)
            yield self._relations.relation(name, f"{atoms.sig} -> ProtectionKind", rows)

    def _dates(self) -> Iterator[str]:
        system = self._system
        keys = {key: number for number, key in enumerate(keys_of(system))}
        yield self._map("public_key", "certificates", "keys", [{keys[c.key]} for c in system.certificates])
        yield self._map("following", "instants", "instants", [{n + 1} for n in range(len(system.instants) - 1)])
        yield function("audit_instant", "one Instant", self._atoms["instants"].name(system.now))
        for name in ("not_before", "not_after"):
            rows = [*self._rows("certificates", name, "instants"), *self._rows("grants", name, "instants")]
            yield self._relations.relation(name, "(Certificate + Grant) -> Instant", rows)

    def _taken_for_granted(self) -> Iterator[str]:
        system = self._system
        sorts = ("documents", "enclaves", "certificates")
        found = [self._relations.atoms(self._atoms[sort], self._those(sort, "opaque")) for sort in sorts]
        opaque = " + ".join(members for members in found if members != "none") or "none"
        yield function("opaque", "set Document + Enclave + Certificate", opaque)
        assumed = " + ".join(sorted(each.atom for each in system.assumed)) or "none"
        yield function("assumed", "set Assumption", "Assumption" if system.assumed == EVERY else assumed)
        read = [system.readings[each.reading] for each in system.trust_domains]
        for name in ("asks_announced_only", "pins_signer", "requires_grant"):
            yield self._flagged(name, "TrustDomain", [getattr(each, name) for each in read])

    def _refusals(self) -> Iterator[str]:
        trust_domains = self._system.trust_domains
        refused = [{n for n, other in enumerate(trust_domains) if not r.talks_to(other)} for r in trust_domains]
        yield self._map("refuses_trust_domain", "trust_domains", "trust_domains", refused)
        documents = gathered((each.reading, number) for number, each in enumerate(self._system.documents))
        taken = [documents.get(each.reading, ()) for each in trust_domains]
        yield self._map("reading", "trust_domains", "documents", taken)

    def _order(self) -> Iterator[str]:
        """Where rules count; and siblings, which are entries of one sort with one parent, by their indices."""
        covered = [*self._rows("domain_rules", "domains", "domains"), *self._rows("rules", "domains", "domains")]
        yield self._relations.relation("domains", "(DomainRule + Rule) -> Domain", covered)
        rows: list[Row] = []
        for sort, (_name, parent, _parents) in CHILDREN.items():
            entries = self._atoms[sort]
            last: dict[int, int] = {}
            for index, atom in enumerate(getattr(self._system, sort)):
                above = getattr(atom, parent)
                if above in last:
                    rows.append(Row(expression=f"{entries.name(last[above])} -> {entries.name(index)}", weight=1))
                last[above] = index
        yield self._relations.relation("precedes", "Entry -> Entry", rows)

    def _out_of_date(self) -> Iterator[str]:
        system = self._system
        read = [system.reading_of(grant) for grant in system.grants]
        yield self._flagged("skipped_out_of_date", "Grant", [each.skips_grants_out_of_date for each in read])
        yield self._flagged("joins_out_of_date", "Grant", [each.joins_out_of_date for each in read])

    def _flagged(self, name: str, sig: str, flags: Sequence[bool]) -> str:
        """The atoms of which a flag is true; of all, by their sig."""
        (sort,) = (each for each in self._atoms.values() if each.sig == sig)
        some = self._relations.atoms(sort, (index for index, flag in enumerate(flags) if flag))
        return function(name, f"set {sig}", sig if flags and all(flags) else some)

    def _those(self, sort: str, flag: str) -> Iterator[int]:
        """The atoms of which a flag is true."""
        return (index for index, atom in enumerate(getattr(self._system, sort)) if getattr(atom, flag))

    def _map(self, name: str, sort: str, to: str, rows: Sequence[Iterable[int]]) -> str:
        left, right = self._atoms[sort], self._atoms[to]
        return self._relations.relation(name, f"{left.sig} -> {right.sig}", self._relations.rows(left, right, rows))

    def _rows(self, sort: str, field: str, to: str) -> list[Row]:
        """What the field of each atom of a sort names of another: an index, perhaps none, or a set of them."""
        named = [getattr(atom, field) for atom in getattr(self._system, sort)]
        members = [() if each is None else (each,) if isinstance(each, int) else each for each in named]
        return self._relations.rows(self._atoms[sort], self._atoms[to], members)

    def _children(self, sort: str) -> str:
        name, field, parents = CHILDREN[sort]
        rows: list[set[int]] = [set() for _ in getattr(self._system, parents)]
        for child, atom in enumerate(getattr(self._system, sort)):
            rows[getattr(atom, field)].add(child)
        return self._map(name, parents, sort, rows)
