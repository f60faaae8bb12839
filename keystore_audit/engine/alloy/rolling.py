"""Whether anything fails in a state of a roll-out, as Alloy: which enclaves carry which files is left free.

The facts are those of all versions of all enclaves. One version of each enclave is there. With it comes what exists
only because an enclave carries it: trust domains, and permissions that OLD does not have.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.claims import Question
from keystore_audit.engine.alloy.facts import MODULES, SPLIT_ATOMS, count_atoms, fact_modules, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.runner import questions
from keystore_audit.engine.alloy.solvers import run
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.grouped import gathered
from keystore_audit.model.formal.asked import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES

MAIN: Final = "rolling.als"
"""The generated main file."""


class Choice(Struct, frozen=True):
    """What is free in a system that has all versions of all enclaves.

    `versions`: of each enclave that changes, one or two; `new`: those of NEW. `added`: the places of documents that OLD
    has not.
    """

    system: System
    versions: Sequence[Sequence[int]]
    new: frozenset[int]
    added: frozenset[str]


def failing(choices: Sequence[Choice], analyzer: Analyzer) -> list[frozenset[str]]:
    """Of each, the properties and claims, by id, that some state violates; claims `able` are not asked about.

    Raises EngineOutOfScale for too large a keystore, and an EngineError where the Analyzer does not answer.
    """

    def read(job: int, told: Mapping[str, bool], _solutions: Path) -> frozenset[str]:
        consistent, *asked = _questions(choices[job].system)
        if not told[consistent.command.name]:
            raise EngineFailed("The model contradicts itself, so that nothing would fail in it.")
        return frozenset(each.id for each in asked if told[each.command.name])

    return run([*map(_job, choices)], analyzer, read)


def _questions(system: System) -> list[Question]:
    """Whether the facts are consistent, then what finds a state in which a property or claim is violated.

    Of claims about flows that is a flow: that in each state there is a compartment is not first-order.
    """
    claimed = {each.id: (number, each) for number, each in enumerate(system.claims)}
    found = []
    for each in questions(system, PROPERTIES):
        number, claim = claimed.get(each.id, (0, None))
        if claim is not None and claim.kind is ClaimKind.NO_FLOW:
            flow = _flow(system, claims.flow(claim, number))
            found.append(replace(each, text=f"run {each.command.name} {{\n\t{flow}\n}} for 0"))
        elif claim is None or claim.kind is not ClaimKind.ABLE:
            found.append(each)
    return found


def _flow(system: System, asked: str) -> str:
    """That there is such a flow. Pairs of trust domains are named, since each is looked at once then."""
    named = [each.name for each in name_atoms(system)["trust_domains"].atoms]
    powers = ", ".join(asked.split(", ")[-3:])
    hops = "\n\t\t+ ".join(f"handed[{one}, {other}, {powers}]" for one, other in product(named, repeat=2))
    return f"let hop = ({hops}) - iden |\n\t\tflows_over[hop, {asked}]"


def _job(choice: Choice) -> Job:
    system = choice.system
    if (atoms := count_atoms(system)) > SPLIT_ATOMS:
        raise EngineOutOfScale(f"Both keystores have {atoms} atoms; a roll-out is asked about up to {SPLIT_ATOMS}.")
    main, lone = write_question(choice)
    return Job(
        files={
            **module_texts((*MODULES, *claims.MODULES, "fallen.als")),
            **fact_modules(system, lone=lone),
            MAIN: main,
        },
        main=MAIN,
        commands=[each.command for each in _questions(system)],
        atoms=atoms,
    )


def write_question(choice: Choice) -> tuple[str, frozenset[str]]:
    """Return the main file, and the atoms that need not be there: what is there together, and all commands."""
    system, atoms = choice.system, name_atoms(choice.system)
    enclaves, trust_domains, documents = (atoms[sort] for sort in ("enclaves", "trust_domains", "documents"))
    free = {each for versions in choice.versions for each in versions}
    carriers = gathered(
        (atom, number)
        for number, each in enumerate(system.enclaves)
        for atom in (trust_domains.name(each.trust_domain), *map(documents.name, each.permissions))
    )
    governances = {each.governance for each in system.trust_domains}  # each stands for all that say the same
    added = (
        documents.name(at)
        for at, each in enumerate(system.documents)
        if each.location.path in choice.added and at not in governances
    )
    bound = {
        atom: those
        for atom in (*(each.name for each in trust_domains.atoms), *added)
        if free.issuperset(those := carriers.get(atom) or [*choice.new])
    }

    def some(those: Iterable[int]) -> str:
        return f"({' + '.join(enclaves.name(each) for each in sorted(those))})"

    together = [f"\tone {some(each)}" for each in choice.versions if len(each) > 1]
    together += [f"\tsome {atom} iff some {some(those)}" for atom, those in bound.items()]
    sizes = ", ".join(f"{len(each.atoms)} {each.sig}" for each in (enclaves, trust_domains, documents))
    lines = ["module rolling", "open fallen", "", "fact Carried {", *together, "}", ""]
    lines += [claims.write_places(system, range(len(system.claims)))]
    lone = frozenset((*map(enclaves.name, free), *bound))
    return "\n".join([*lines, *(f"{each.text} but {sizes}" for each in _questions(system))]) + "\n", lone
