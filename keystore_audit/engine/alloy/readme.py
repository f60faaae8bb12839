"""What stands beside an exported model: how to open it, and which atom is what in the keystore."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit import text
from keystore_audit.engine.alloy.application import node_sort
from keystore_audit.engine.alloy.atoms import Atom, Sort, name_atoms
from keystore_audit.model.formal.system import Reading, System

MAX_NAME: Final = 200
"""Characters of one cell of the table."""

_OPENING: Final = """\
Open `audit.als` in the Alloy Analyzer (6.2.0) and choose Execute All. A check without counterexample is a property
that holds: the facts are constants, so it is a proof about this keystore. Where there is a counterexample, show it
and load the theme `keystore_audit.thm` (Theme, Load Theme): the atoms marked with the names of the check's variables
are the witness. Without a window: `java -jar JAR exec -f -t text -d 0 -s sat4j -o solutions audit.als` prints each
command with UNSAT (a check holds, a run finds nothing) or SAT, and puts instances into the folder `solutions`;
`-c OutsidersCannotRead` before the file is that command alone. `keystore-audit engine` says which `java` and JAR are
there. Keep `for 0` in commands of your own: a larger scope adds what the keystore does not have.
"""

_FILES: Final = """\
`keystore.als` holds the facts and nothing else, `audit.als` the commands; all other modules are the same for every
keystore. To read them, begin with `dds_security.als`: it explains the words of DDS, SROS2 and certificates, what each
function of `keystore.als` means, and the order in which to read on. Claims of
`keystore-audit.toml` stand at the end of `audit.als`, `Claim0` and so on: of a claim about flows an instance is a
compartment that nothing leaves, so that the claim holds where there is one (of "able": is violated). `paths.als`, where
it is there, looks for a shortest path of each. The folder `expiry` holds the same model with a clock that moves over
all dates from the audit on: execute `expiry_audit.als` there. `scenarios.als` has words for what is meant to happen:
open it in a file of your own, say what is wired, and run `can_arrive` or check `arrives_fairly`, for as many steps as
there are enclaves, and two.
"""

_APPLICATION: Final = """\
`nodes.als` has the nodes and what they are there to do, `application.als` the words for what is wired and what is
permitted: execute `application_audit.als`. A check without counterexample holds there too.
"""

_ATOMS: Final = """\
An atom is called by letters for its kind (D domains, T channel of a topic, I instant, K key, C certificate, P document,
R realm, E enclave, DR domain rule, TR topic rule, G grant, PR rule, N node), a number, and a piece of its name. A
channel stands for all topics that no document tells apart, and is called by one of them: `rt/` begins the DDS name of
a ROS 2 topic, `rq/` and `rr/` those of a service's requests and replies; "DDS only" says that no name of ROS 2 is
among them.
"""

_UNNAMED: Final = {"DomainRule": "domain rule", "TopicRule": "topic rule", "Grant": "grant", "Rule": "rule of a grant"}
"""What atoms without a name of their own are. Of others without one, their place says what they are."""

_READINGS: Final = """\
Implementations differ in what they accept, and what could not be read may mean anything or nothing. Each folder is
one way to read the keystore, and a property is reported as holding only where it holds in all.
"""


def folder_names(systems: Sequence[System]) -> tuple[str, ...]:
    """Return a folder name for each system, all different, from what tells them apart."""
    doubtful = len({system.reading for system in systems}) > 1
    names: list[str] = []
    for system in systems:
        name = f"{'pinned' if system.pins_signer else 'unpinned'}-signer"
        name += f"-{system.reading.value}" if doubtful else ""
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
    for sort in (*name_atoms(system).sorts(), node_sort(system)):
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


def _kind(system: System) -> str:
    signer = (
        "Documents must be signed by the permissions CA itself"
        if system.pins_signer
        else "Documents may be signed by any certificate that the permissions CA issued"
    )
    counted = "counts as anything" if system.reading is Reading.MAY else "is left out"
    return f"{signer}; what could not be read {counted}; as {', '.join(system.profiles)} do"


def _cell(name: str) -> str:
    return text.markdown(text.shorten(name, MAX_NAME))
