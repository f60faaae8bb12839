"""A `System` as an Alloy module: atoms and constant relations, nothing concluded from them.

The relations are functions without arguments over `one sig` atoms, because these are constants for the translator:
as fields of sigs, equated in facts, the same keystore costs some hundred times as much (100 enclaves and 200 topics:
21 to 62 s a command against 0.1 to 0.2 s). The text is deterministic, in the order of the system's indices.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress, count
from pathlib import Path
from typing import Final

from keystore_audit import resources, text
from keystore_audit.assumptions import EVERY
from keystore_audit.engine.alloy import application, claims, expiry, paths
from keystore_audit.engine.alloy.atoms import Sort, declare, declare_apart, name_atoms
from keystore_audit.engine.alloy.readme import describe_folders, describe_system, folder_names
from keystore_audit.engine.alloy.relations import Relations, Row, function
from keystore_audit.engine.alloy.user_vocabulary import VOCABULARY, write_vocabulary
from keystore_audit.errors import UsageError
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import DomainRuleAtom, Reading, System, TopicRuleAtom
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.property import Property

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

THEME: Final = "keystore_audit.thm"
"""How the Analyzer's window draws an instance."""

SCENARIOS: Final = "scenarios.als"  # for what is meant to happen, with commands that its reader writes

SPLIT_ATOMS: Final = 400
"""Atoms up to which all stand in `keystore` (`fact_modules`)."""

MODULE_GROUPS: Final = 2  # of up to `atoms.GROUP` atoms in one module, where there are more atoms

TIME: Final = "expiry"
"""The folder of the model with a moving clock."""

README: Final = "README.md"

_DRAWN: Final = """\
-- for the Analyzer's window, which draws functions without arguments, and those of the main module only

/** Who has which identity. */
fun has_identity: Enclave -> Certificate { identity }
/** Who carries which permissions document. */
fun has_permissions: Enclave -> Document { permissions }
/** Whose realm has which governance document. */
fun has_governance: Enclave -> Document { in_realm.governance }
/** Who signed a document. */
fun signed_by: Document -> Certificate { signer }
/** Who issued a certificate; of one that signed itself, nobody else. */
fun issued_by: Certificate -> Certificate { issuer - iden }

/** Who can write in some realm. */
fun writes: Enclave -> Channel { { e: Enclave, c: Channel | some r: Realm | c in e.(may_write[r]) } }
/** Who can read in some realm. */
fun reads: Enclave -> Channel { { e: Enclave, c: Channel | some r: Realm | c in e.(may_read[r]) } }
/** Who can write or read in some realm without a grant. */
fun ungranted: Enclave -> Channel {
	{ e: Enclave, c: Channel | some r: Realm | c in e.(writes_without_a_grant[r] + reads_without_a_grant[r]) }
}
"""
"""Relations for pictures, in the words of `keystore_audit.thm`."""

_CLOCK: Final = """\
var one sig Clock in Instant {}
fun audit_instant: one Instant { Clock }"""
"""What stands for the audit instant where it moves."""

CONSISTENCY: Final = "FactsAreConsistent"
"""The run that must have an instance: no check means anything without it."""

EXERCISED: Final = {
    "authentication": "AuthenticationIsExercised",
    "encryption": "EncryptionIsExercised",
    "access_control": "AccessControlIsExercised",
}
"""For each family of properties (modules of `keystore_audit.properties`) the run that shows it has an object."""


def facts(system: System, *, moving: bool = False) -> str:
    """Return the module `keystore` for `system`. Names of the keystore stand in comments only.

    `moving`: the audit instant is where a variable clock stands, for the module `expiry`.
    """
    sorts = name_atoms(system).sorts()
    sections = _Facts(system, moving=moving).sections()
    return "\n\n".join([_header(system), *filter(None, map(declare, sorts)), *sections]) + "\n"


def fact_modules(system: System) -> dict[str, str]:
    """Return `facts` as the files that the Analyzer reads fast: name to text.

    For each name the Analyzer looks through all sigs that can be seen from where the name stands, and for each sig
    and function through all sigs of its module. So many atoms stand in modules of their own. Beside each stands one
    with a function for each atom, and what it opens is private, so that from `keystore` no atom's sig can be seen.
    """
    sorts = name_atoms(system).sorts()
    if sum(len(sort.atoms) for sort in sorts) <= SPLIT_ATOMS:
        return {KEYSTORE: facts(system)}
    groups = [group for sort in sorts for group in declare_apart(sort)]
    opened, modules = [], {}
    for number, start in enumerate(range(0, len(groups), MODULE_GROUPS)):
        sigs, names = zip(*groups[start : start + MODULE_GROUPS], strict=True)
        modules[f"atoms_{number}.als"] = "\n".join([f"module atoms_{number}\nopen dds_security\n", *sigs]) + "\n"
        head = f"module names_{number}\nprivate open atoms_{number}\n"
        modules[f"names_{number}.als"] = "\n".join([head, *names]) + "\n"
        opened.append(f"open names_{number}")
    header = "\n".join([_header(system), *opened])
    modules[KEYSTORE] = "\n\n".join([header, *_Facts(system, moving=False).sections()]) + "\n"
    return modules


def commands(properties: Sequence[Property], system: System | None = None, *, window: bool = False) -> str:
    """Return the module `audit`: the runs against vacuity, a check of each of `properties`, the claims of `system`.

    `window`: for the Analyzer's window, with short atom names and relations to draw. Not for the solver alone, since
    the Analyzer parses a module once for each path of `open` that leads to it, and the facts are the largest.
    """
    asked = claims.write_claims(system) if system is not None else ""
    lines = [
        "/**",
        " * The audit: every property of `properties`, after the runs that show what they speak of.",
        " *",
        " * To read the model, begin with `dds_security`: words, order of the modules, and why `for 0` is a proof.",
        *([" * The first two are opened again so that the window shows their atoms by short names."] if window else []),
        " */",
        "module audit",
        *(["open dds_security", "open keystore"] if window else []),
        "open claims" if asked else "open vacuity",
        "",
        *(f"run {name} for 0" for name in (CONSISTENCY, *EXERCISED.values())),
        "",
        *(f"check {prop.assertion} for 0" for prop in properties),
        *(["", asked] if asked else []),
        *(["", _DRAWN] if window else []),
    ]
    return "\n".join(lines).rstrip("\n") + "\n"


def _header(system: System) -> str:
    counted = "counts as anything" if system.reading is Reading.MAY else "is left out"
    instant = text.instant(system.instants[system.now])
    lines = [
        "/**",
        " * The facts of one keystore, written by keystore-audit. Do not edit.",
        " *",
        f" * As read by {text.alloy_comment(', '.join(system.profiles))}.",
        f" * What could not be read {counted}. The audit instant is {instant}.",
        " * Above each atom stands what it is in the keystore, and where; what functions mean, `dds_security` says.",
        " * A channel is called by one of its names, and stands for all names that no document tells apart from it.",
        " * ROS 2 topics begin with `rt/`; a service is two topics, which begin with `rq/` and `rr/`. `DDS only`: in",
        " * this channel lies no name of ROS 2.",
        " */",
        "module keystore",
        "open dds_security",
    ]
    return "\n".join(lines)


def write_model(systems: Sequence[System], directory: Path, beside: Mapping[str, str] | None = None) -> None:
    """Write the model of each system for the Alloy Analyzer's window: modules, facts, commands, theme and a README.

    `beside`: files of users (name to text), each of which opens the vocabulary.

    One system goes into `directory` itself, several into a folder each. Raises UsageError if the directory holds
    anything or cannot be written.
    """
    names = folder_names(systems)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise UsageError(f"{directory} is not empty: the model goes into a new or an empty directory.")
        for system, name in zip(systems, names, strict=True):
            folder = directory / name if len(systems) > 1 else directory
            folder.mkdir(exist_ok=True)
            _write_folder(system, folder)
            for user, content in (beside or {}).items():
                (folder / f"{VOCABULARY}.als").write_text(write_vocabulary(system), encoding="ascii")
                (folder / user).write_text(content, encoding="ascii")
            _write_time(system, folder / TIME)
            (folder / README).write_text(describe_system(system), encoding="utf-8")
        if len(systems) > 1:
            (directory / README).write_text(describe_folders(systems, names), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"The model cannot be written to {directory}: {error.strerror or error}.") from error


def _write_folder(system: System, folder: Path) -> None:
    for module in (*MODULES, *claims.MODULES, *paths.MODULES, SCENARIOS, THEME):
        shutil.copyfile(resources.alloy() / module, folder / module)
    (folder / KEYSTORE).write_text(facts(system), encoding="ascii")
    (folder / MAIN).write_text(commands(PROPERTIES, system, window=True), encoding="ascii")
    if flows := [number for number, claim in enumerate(system.claims) if claim.kind is ClaimKind.NO_FLOW]:
        (folder / paths.MAIN).write_text(paths.write_paths(system, flows), encoding="ascii")
    if system.nodes:
        shutil.copyfile(resources.alloy() / application.MODULE, folder / application.MODULE)
        (folder / application.NODES).write_text(application.write_nodes(system), encoding="ascii")
        (folder / application.MAIN).write_text(application.write_commands(), encoding="ascii")


def _write_time(system: System, folder: Path) -> None:
    """Write the model with a moving clock: its facts differ, so it stands in a folder of its own."""
    folder.mkdir()
    for module in (*MODULES, *claims.MODULES, expiry.MODULE):
        shutil.copyfile(resources.alloy() / module, folder / module)
    timed = expiry.timed(system)
    (folder / KEYSTORE).write_text(facts(timed, moving=True), encoding="ascii")
    (folder / expiry.MAIN).write_text(expiry.write_expiry(timed), encoding="ascii")


class _Facts:
    """Writes the relations of one system, section by section."""

    def __init__(self, system: System, *, moving: bool) -> None:
        self._system = system
        self._moving = moving
        self._atoms = name_atoms(system)
        self._relations = Relations()

    def sections(self) -> Iterator[str]:
        for title, functions in (
            ("certificates and dates", self._certificates()),
            ("documents", self._documents()),
            ("realms and enclaves", self._enclaves()),
            ("order: each entry and its next sibling", self._precedes()),
            ("governance: domain rules", self._domain_rules()),
            ("governance: topic rules", self._topic_rules()),
            ("permissions", self._permissions()),
            ("channels", self._channels()),
        ):
            written = list(functions)  # before its helpers are taken
            yield "\n".join([f"-- {title}", *self._relations.take_private(), *written])

    def _certificates(self) -> Iterator[str]:
        a, rows, grants = self._atoms, self._system.certificates, self._system.grants
        yield self._map("issuer", a.certificates, a.certificates, [c.issuers for c in rows])
        yield self._set("authority", a.certificates, [c.authority for c in rows])
        yield self._set("fit_to_sign", a.certificates, [c.fit_to_sign for c in rows])
        yield self._map("public_key", a.certificates, a.keys, [{a.key_index[c.key]} for c in rows])
        following = [{index + 1} for index in range(len(self._system.instants) - 1)]
        yield self._map("following", a.instants, a.instants, following)
        if self._moving:
            yield _CLOCK
        now = a.instants.name(self._system.now)
        yield function("Beginning" if self._moving else "audit_instant", "one Instant", now)
        yield self._dates("not_before", [c.not_before for c in rows], [g.not_before for g in grants])
        yield self._dates("not_after", [c.not_after for c in rows], [g.not_after for g in grants])

    def _documents(self) -> Iterator[str]:
        a, documents, enclaves = self._atoms, self._system.documents, self._system.enclaves
        yield self._set("intact", a.documents, [d.intact for d in documents])
        yield self._map("signer", a.documents, a.certificates, [d.signers for d in documents])
        opaque = (
            self._relations.atoms(a.documents, compress(count(), [d.opaque for d in documents])),
            self._relations.atoms(a.enclaves, compress(count(), [e.opaque for e in enclaves])),
            self._relations.atoms(a.certificates, compress(count(), [c.opaque for c in self._system.certificates])),
        )
        found = [members for members in opaque if members != "none"]
        yield function("opaque", "set Document + Enclave + Certificate", " + ".join(found) or "none")
        assumed = " + ".join(sorted(each.atom for each in self._system.assumed)) or "none"
        yield function("assumed", "set Assumption", "Assumption" if self._system.assumed == EVERY else assumed)
        yield function("asks_announced_only", "set Realm", "Realm" if self._system.asks_announced_only else "none")
        yield function("pins_signer", "set Realm", "Realm" if self._system.pins_signer else "none")
        yield function("requires_grant", "set Realm", "Realm" if self._system.requires_grant else "none")

    def _enclaves(self) -> Iterator[str]:
        a, realms, enclaves = self._atoms, self._system.realms, self._system.enclaves
        yield self._map("identity_ca", a.realms, a.certificates, [r.identity_ca for r in realms])
        yield self._map("permissions_ca", a.realms, a.certificates, [r.permissions_ca for r in realms])
        yield self._map("governance", a.realms, a.documents, [_lone(r.governance) for r in realms])
        yield self._map("revoked", a.realms, a.certificates, [r.revoked for r in realms])
        yield self._map("refuses", a.realms, a.certificates, [r.refuses for r in realms])
        refused = [{n for n, other in enumerate(realms) if not r.talks_to(other)} for r in realms]
        yield self._map("refuses_realm", a.realms, a.realms, refused)
        yield self._map("in_realm", a.enclaves, a.realms, [{e.realm} for e in enclaves])
        yield self._map("identity", a.enclaves, a.certificates, [_lone(e.identity) for e in enclaves])
        yield self._map("permissions", a.enclaves, a.documents, [_lone(e.permissions) for e in enclaves])
        yield self._map("reads_alone", a.enclaves, a.channels, [e.reads_alone for e in enclaves])
        yield self._map("writes_alone", a.enclaves, a.channels, [e.writes_alone for e in enclaves])
        yield self._map("refused_writes", a.enclaves, a.channels, [e.refused_writes for e in enclaves])
        yield self._map("refused_reads", a.enclaves, a.channels, [e.refused_reads for e in enclaves])

    def _precedes(self) -> Iterator[str]:
        """Siblings are entries of one sort with one parent, in the order of their indices."""
        a, system = self._atoms, self._system
        entries = (
            (a.domain_rules, [rule.document for rule in system.domain_rules]),
            (a.topic_rules, [rule.domain_rule for rule in system.topic_rules]),
            (a.grants, [grant.document for grant in system.grants]),
            (a.rules, [rule.grant for rule in system.rules]),
        )
        rows = [row for sort, parents in entries for row in _next_siblings(sort, parents)]
        yield self._relations.relation("precedes", "Entry -> Entry", rows)

    def _domain_rules(self) -> Iterator[str]:
        a, rules = self._atoms, self._system.domain_rules
        yield self._children("domain_rule", a.documents, a.domain_rules, [r.document for r in rules])
        covered = self._relations.rows(a.domain_rules, a.domains, [r.domains for r in rules])
        covered += self._relations.rows(a.rules, a.domains, [r.domains for r in self._system.rules])
        yield self._relations.relation("domains", "(DomainRule + Rule) -> Domain", covered)
        for flag in ("allow_unauthenticated_participants", "enable_join_access_control"):
            yield self._set(flag, a.domain_rules, [getattr(rule, flag) for rule in rules])
        for kind in ("discovery_protection_kind", "liveliness_protection_kind", "rtps_protection_kind"):
            yield self._kind(kind, a.domain_rules, rules)

    def _topic_rules(self) -> Iterator[str]:
        a, rules = self._atoms, self._system.topic_rules
        yield self._children("topic_rule", a.domain_rules, a.topic_rules, [r.domain_rule for r in rules])
        yield self._map("topic_expression", a.topic_rules, a.channels, [r.channels for r in rules])
        for flag in (
            "enable_discovery_protection",
            "enable_liveliness_protection",
            "enable_read_access_control",
            "enable_write_access_control",
        ):
            yield self._set(flag, a.topic_rules, [getattr(rule, flag) for rule in rules])
        for kind in ("metadata_protection_kind", "data_protection_kind"):
            yield self._kind(kind, a.topic_rules, rules)

    def _permissions(self) -> Iterator[str]:
        a, grants, rules = self._atoms, self._system.grants, self._system.rules
        yield self._children("grant", a.documents, a.grants, [g.document for g in grants])
        yield self._map("subject_name", a.grants, a.certificates, [g.names for g in grants])
        skipped = "Grant" if self._system.skips_grants_out_of_date and self._system.grants else "none"
        yield function("skipped_out_of_date", "set Grant", skipped)
        undated = "Grant" if self._system.joins_out_of_date and self._system.grants else "none"
        yield function("joins_out_of_date", "set Grant", undated)
        yield self._set("default_allow", a.grants, [g.default_allow for g in grants])
        yield self._children("rule", a.grants, a.rules, [r.grant for r in rules])
        yield self._set("allow_rule", a.rules, [r.allow for r in rules])
        yield self._map("publish", a.rules, a.channels, [r.publish for r in rules])
        yield self._map("subscribe", a.rules, a.channels, [r.subscribe for r in rules])
        yield self._map("relay", a.rules, a.channels, [r.relay for r in rules])

    def _channels(self) -> Iterator[str]:
        a = self._atoms
        yield self._map("in_domain", a.channels, a.domains, [{c.domain} for c in self._system.channels])
        yield self._map("meets", a.channels, a.channels, self._system.meets)

    def _set(self, name: str, sort: Sort, members: Sequence[bool]) -> str:
        return self._relations.subset(name, sort, compress(count(), members))

    def _map(self, name: str, left: Sort, right: Sort, rows: Sequence[Iterable[int]]) -> str:
        return self._relations.relation(name, f"{left.sig} -> {right.sig}", self._relations.rows(left, right, rows))

    def _kind(self, name: str, sort: Sort, rules: Sequence[DomainRuleAtom] | Sequence[TopicRuleAtom]) -> str:
        kinds = [getattr(rule, name).value for rule in rules]
        return self._relations.relation(
            name, f"{sort.sig} -> ProtectionKind", self._relations.constant_rows(sort, kinds)
        )

    def _dates(self, name: str, certificates: Sequence[int], grants: Sequence[int]) -> str:
        a = self._atoms
        rows = self._relations.rows(a.certificates, a.instants, [{instant} for instant in certificates])
        rows += self._relations.rows(a.grants, a.instants, [{instant} for instant in grants])
        return self._relations.relation(name, "(Certificate + Grant) -> Instant", rows)

    def _children(self, name: str, parents: Sort, children: Sort, parent_of: Sequence[int]) -> str:
        rows: list[set[int]] = [set() for _ in parents.atoms]
        for child, parent in enumerate(parent_of):
            rows[parent].add(child)
        return self._map(name, parents, children, rows)


def _next_siblings(sort: Sort, parents: Sequence[int]) -> Iterator[Row]:
    last: dict[int, int] = {}
    for index, parent in enumerate(parents):
        if parent in last:
            yield Row(expression=f"{sort.name(last[parent])} -> {sort.name(index)}", weight=1)
        last[parent] = index


def _lone(index: int | None) -> set[int]:
    return set() if index is None else {index}
