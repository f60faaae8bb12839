"""The model of a keystore for the Alloy Analyzer's window: modules, facts, commands, theme and a README.

What the audit itself never asks stands here: paths of flows, and whether nodes may do what they are there for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from keystore_audit import text
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import Atom, Relations, Sort, declare, make_sort, name_atoms
from keystore_audit.engine.alloy.claims import check, write_places
from keystore_audit.engine.alloy.facts import CONSISTENCY, KEYSTORE, MAIN, MODULES, facts, module_texts
from keystore_audit.errors import UsageError
from keystore_audit.model.formal.asked import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.result import Property

THEME: Final = "keystore_audit.thm"
"""How the Analyzer's window draws an instance."""

SCENARIOS: Final = "scenarios.als"  # for what is meant to happen, with commands that its reader writes

README: Final = "README.md"

EXERCISED: Final = ("AuthenticationIsExercised", "EncryptionIsExercised", "AccessControlIsExercised")
"""For each family of properties the run that shows that it has an object."""

PATHS: Final = "paths.als"
"""The generated main file that asks for the way that data takes where a claim says that none flows."""

APPLICATION: Final = "application_audit.als"
"""The generated main file about nodes."""

WIRED: Final = "WiringIsExercised"
"""The run that shows that there is something wired."""

WIRING: Final = ("NodesHaveEnclaves", "NodesHaveTheRightsThatTheyNeed", "WiredFlowsArePermitted", "RightsAreUsed")
"""What is asserted of every application."""

_DRAWN: Final = """\
-- for the Analyzer's window, which draws functions without arguments, and those of the main module only

/** Who has which identity. */
fun has_identity: Enclave -> Certificate { identity }
/** Who carries which permissions document. */
fun has_permissions: Enclave -> Document { permissions }
/** Whose trust domain has which governance document. */
fun has_governance: Enclave -> Document { in_trust_domain.governance }
/** Who signed a document. */
fun signed_by: Document -> Certificate { signer }
/** Who issued a certificate; of one that signed itself, nobody else. */
fun issued_by: Certificate -> Certificate { issuer - iden }

/** Who can write in some trust domain. */
fun writes: Enclave -> Channel { { e: Enclave, c: Channel | some r: TrustDomain | c in e.(may_write[r]) } }
/** Who can read in some trust domain. */
fun reads: Enclave -> Channel { { e: Enclave, c: Channel | some r: TrustDomain | c in e.(may_read[r]) } }
/** Who can write or read in some trust domain without a grant. */
fun ungranted: Enclave -> Channel {
	{ e: Enclave, c: Channel | some r: TrustDomain | c in e.(writes_without_a_grant[r] + reads_without_a_grant[r]) }
}
"""
"""Relations for pictures, in the words of `keystore_audit.thm`."""


def commands(properties: Sequence[Property], system: System | None = None, *, window: bool = False) -> str:
    """Return the module `audit`: the runs against vacuity, a check of each of `properties`, the claims of `system`.

    `window`: for the Analyzer's window, with short atom names and relations to draw. Not for the solver: the Analyzer
    parses a module once for each path of `open` to it, and the facts are the largest module.
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
        *(f"run {name} for 0" for name in (CONSISTENCY, *EXERCISED)),
        "",
        *(check(prop.predicate) for prop in properties),
        *(["", asked] if asked else []),
        *(["", _DRAWN] if window else []),
    ]
    return "\n".join(lines).rstrip("\n") + "\n"


def write_model(systems: Sequence[System], directory: Path, beside: Mapping[str, str] | None = None) -> None:
    """Write the model of each system for the Alloy Analyzer's window: modules, facts, commands, theme and a README.

    `beside`: files of users (name to text), each of which opens the vocabulary.

    One system goes into `directory` itself, several into a folder each. Raises UsageError if the directory holds
    anything or cannot be written.
    """
    names = folder_names(systems)
    several = len(systems) > 1
    folders = {
        name if several else "": _files(system, beside or {}) for system, name in zip(systems, names, strict=True)
    }
    if several:
        folders[""] = {README: describe_folders(systems, names)}
    write_folders(folders, directory)


def write_folders(folders: Mapping[str, Mapping[str, str]], directory: Path) -> None:
    """Write files, texts by name, into folders of the directory, which is made; "" is itself.

    Raises UsageError if the directory holds anything or cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise UsageError(f"{directory} is not empty: the model goes into a new or an empty directory.")
        for folder, files in folders.items():
            (directory / folder).mkdir(exist_ok=True)
            for name, content in files.items():
                (directory / folder / name).write_text(content, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"The model cannot be written to {directory}: {error.strerror or error}.") from error


def _files(system: System, beside: Mapping[str, str]) -> dict[str, str]:
    files = {
        **module_texts((*MODULES, *claims.MODULES, "propagation.als", SCENARIOS, THEME)),
        KEYSTORE: facts(system),
        MAIN: commands(PROPERTIES, system, window=True),
        README: describe_system(system),
        **beside,
    }
    if flows := [number for number, claim in enumerate(system.claims) if claim.kind is ClaimKind.NO_FLOW]:
        files[PATHS] = write_paths(system, flows)
    if system.nodes:
        files |= {**module_texts((MODULE,)), NODES: write_nodes(system), APPLICATION: write_wiring_commands()}
    if beside:
        files[f"{VOCABULARY}.als"] = write_vocabulary(system)
    return files


def write_paths(system: System, numbers: Sequence[int]) -> str:
    """Return the main file that asks for a path for each of the claims of these indices.

    A path visits at most every enclave, the outsider and, where it ends where it began, one of them again.
    """
    steps = len(system.enclaves) + 2
    lines = [
        "/** For each claim that is violated by a flow, a shortest one. */",
        "module paths",
        "open propagation",
        "",
        write_places(system, numbers),
    ]
    for number in numbers:
        walk = f"walk[{claims.flow(system.claims[number], number)}]"
        lines.append(f"run Path{number} {{\n\t{walk}\n}} for 0 but 1..{steps} steps")
    return "\n".join(lines) + "\n"


def write_wiring_commands() -> str:
    """Return the main file: that something is wired, then whether it may be."""
    head = ["/** What nodes are to do, and what they may. */", "module application_audit", "open application", ""]
    checks = [f"check {name} for 0" for name in WIRING]
    return "\n".join([*head, f"run {WIRED} for 0", *checks]) + "\n"


MAX_NAME: Final = 200
"""Characters of one cell of the table."""

_OPENING: Final = """\
Open `audit.als` in the Alloy Analyzer (6.2.0) and choose Execute All. A check without counterexample is a property
that holds. The facts are constants, so it is a proof about this keystore. If there is a counterexample, show it and
load the theme `keystore_audit.thm` (Theme, Load Theme). The atoms with the names of the check's variables are the
witness. Without a window, run `java -jar JAR exec -f -t text -d 0 -s sat4j -o solutions audit.als`. It prints each
command with UNSAT (a check holds, a run finds nothing) or SAT, and writes instances to the folder `solutions`.
`-c OutsidersCannotRead` before the file runs that command alone. `keystore-audit engine` says which `java` and JAR are
installed. Keep `for 0` in your own commands: a larger scope adds what the keystore does not have.
"""

_FILES: Final = """\
`keystore.als` holds the facts and nothing else, `audit.als` the commands; all other modules are the same for every
keystore. To read them, begin with `dds_security.als`. It explains the words of DDS, SROS2 and certificates, the
functions of `keystore.als`, and the order in which to read on. Claims of `keystore-audit.toml` are at the end of
`audit.als`, `Claim0` and so on. For a claim about flows, an instance is a compartment that nothing leaves. So the claim
holds if there is an instance (one of "able" is violated). `paths.als`, if present, looks for a shortest path of each.
`scenarios.als` has words for what is meant to happen. Open it in your own file, say what is wired, and run `can_arrive`
or check `arrives_fairly`. The steps are the number of enclaves plus two.
"""

_APPLICATION: Final = """\
`nodes.als` has the nodes and what they are there to do, `application.als` the words for what is wired and what is
permitted. Execute `application_audit.als`. A check without counterexample holds there too.
"""

_ATOMS: Final = """\
The name of an atom has letters for its kind, a number, and a piece of its name. Kinds are D domains, T channel of a
topic, I instant, K key, C certificate, P document, R trust domain and E enclave. Also DR domain rule, TR topic rule, G
grant, PR rule and N node. A channel stands for all topics that no document tells apart, and has the name of one. `rt/`
begins the DDS name of a ROS 2 topic, `rq/` and `rr/` those of a service's requests and replies. "DDS only" means that
no ROS 2 name is among them.
"""

_UNNAMED: Final = {"DomainRule": "domain rule", "TopicRule": "topic rule", "Grant": "grant", "Rule": "rule of a grant"}
"""What atoms without a name of their own are. Of others without one, their place says what they are."""

_READINGS: Final = """\
Implementations differ in what they accept, and what could not be read may mean anything or nothing. Each folder is
one way to read the keystore, and a property is reported as holding only where it holds in all.
"""


def folder_names(systems: Sequence[System]) -> tuple[str, ...]:
    """Return a folder name for each system, all different, from what tells them apart."""
    doubtful = len({system.may for system in systems}) > 1
    names: list[str] = []
    for system in systems:
        name = f"{_signers(system)}-signer"
        name += f"-{'may' if system.may else 'must'}" if doubtful else ""
        names.append(name if name not in names else f"{name}-{len(names) + 1}")
    return tuple(names)


def describe_system(system: System) -> str:
    """Return the README of one model: what it models, how to open it, atoms and names."""
    lines = [
        "# The Alloy model of a keystore",
        "",
        _kind(system) + ".",
        "",
        _OPENING,
        _FILES,
        *([_APPLICATION] if system.nodes else []),
        _ATOMS,
        "| atom | what it is | where |",
        "|---|---|---|",
    ]
    for sort in (*name_atoms(system).values(), make_sort(system, "nodes")):
        lines += [f"| `{atom.name}` | {' | '.join(map(_cell, _told(sort, atom)))} |" for atom in sort.atoms]
    return "\n".join(lines) + "\n"


def describe_folders(systems: Sequence[System], names: Sequence[str]) -> str:
    """Return the README above several models."""
    lines = [
        "# The Alloy models of a keystore",
        "",
        _READINGS,
        *(f"- `{name}`: {_kind(system)}." for system, name in zip(systems, names, strict=True)),
    ]
    return "\n".join(lines) + "\n"


def _told(sort: Sort, atom: Atom) -> tuple[str, str]:
    """What an atom is, and where."""
    if what := atom.label or _UNNAMED.get(sort.sig, ""):
        return what, atom.place
    return atom.place, ""


def _signers(system: System) -> str:
    """Whose signatures count in the fleet."""
    pinned = {reading.pins_signer for reading in system.readings}
    return "mixed" if len(pinned) > 1 else "pinned" if True in pinned else "unpinned"


_SIGNERS: Final = {
    "pinned": "Documents must be signed by the permissions CA itself",
    "unpinned": "Documents may be signed by any certificate that the permissions CA issued",
    "mixed": "To some enclaves any certificate that the permissions CA issued may sign documents, to others it alone",
}


def _kind(system: System) -> str:
    signer = _SIGNERS[_signers(system)]
    counted = "counts as anything" if system.may else "is left out"
    return f"{signer}; what could not be read {counted}; as {', '.join(system.profiles)} do"


def _cell(name: str) -> str:
    return text.markdown(text.shorten(name, MAX_NAME))


MODULE: Final = "application.als"
"""The hand-written module, which opens the claims and `NODES`."""

NODES: Final = "nodes.als"
"""The generated module of nodes."""

VOCABULARY: Final = "keystore_audit"
"""The name of the module that users' files open."""


def write_nodes(system: System) -> str:
    """Return the module `nodes`. Names stand in comments only."""
    atoms, nodes, relations = name_atoms(system), make_sort(system, "nodes"), Relations()
    enclaves = [() if node.enclave is None else (node.enclave,) for node in system.nodes]
    lines = [
        relations.relation(name, declared, relations.rows(nodes, sort, rows))
        for name, declared, sort, rows in (
            ("runs_in", "Node -> Enclave", atoms["enclaves"], enclaves),
            ("publishes_to", "Node -> Channel", atoms["channels"], [node.publishes for node in system.nodes]),
            ("subscribes_to", "Node -> Channel", atoms["channels"], [node.subscribes for node in system.nodes]),
        )
    ]
    head = [
        "/**",
        " * The nodes of a graph, launch file or policy, and their wiring, written by keystore-audit. Do not edit.",
        " *",
        " * `runs_in`: the enclave with which a node starts. `publishes_to`, `subscribes_to`: what it is there to do.",
        " */",
        "module nodes",
        "open keystore",
        "",
        "/** A ROS 2 node, by its name. */",
        "abstract sig Node {}",
    ]
    return "\n".join([*head, declare(nodes), "", *relations.take_private(), *lines]) + "\n"


def write_vocabulary(system: System) -> str:
    """Return the module, with a function for each of the places of `system`."""
    atoms, relations = name_atoms(system), Relations()
    lines = []
    for place in system.places:
        sort, members = (
            (atoms["enclaves"], place.enclaves) if place.channels is None else (atoms["channels"], place.channels)
        )
        lines.append(relations.subset(place.name, sort, members or ()))
    head = f"/** What files of properties open: docs/alloy-properties.md. */\nmodule {VOCABULARY}\n"
    head += "open application\n" if system.nodes else "open claims\n"
    return "\n".join([head, *relations.take_private(), *lines]) + "\n"
