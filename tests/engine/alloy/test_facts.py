"""Facts are a function of the system, and nothing that a keystore's author writes becomes Alloy."""

from __future__ import annotations

import re
from datetime import timedelta
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import LETTERS, ROLE_SORTS, atom_of, index_of, name_atoms, union
from keystore_audit.engine.alloy.export import SCENARIOS, commands, write_model
from keystore_audit.engine.alloy.facts import MODULES, fact_modules, facts
from keystore_audit.errors import UsageError
from keystore_audit.findings import Location
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.result import Role
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.systems import healthy, judging, lively, random_system, stock, with_claims

ALL_MODULES = (*MODULES, *claims.MODULES, "propagation.als")
"""All that are written by hand."""

HOSTILE = st.text(max_size=60) | st.sampled_from(
    [
        "*/ fact { no univ } /*",
        "\nfact { no univ }\n--",
        "a\r\nassert x { some univ }",
        "\u2028fact { no univ }",
        "one sig Evil extends Enclave {}",
        "//",
        "--",
        "/*",
        "$0",
        "E9_evil$0",
        "\x00\x1b[2J",
        "\ud800",
        "ʺ\u202e",
    ]
)


def renamed(system: System, name: str) -> System:
    """The same system with every text of its author's choosing replaced."""
    location = Location(path=name, line=3)
    return replace(
        system,
        certificates=tuple(replace(c, label=name, location=location) for c in system.certificates),
        documents=tuple(replace(d, label=name, location=location) for d in system.documents),
        enclaves=tuple(replace(e, label=name, location=location) for e in system.enclaves),
        domains=tuple(replace(d, label=name) for d in system.domains),
        channels=tuple(c._replace(topic=name, partition=name) for c in system.channels),
        grants=tuple(replace(g, location=location) for g in system.grants),
        rules=tuple(replace(r, location=location) for r in system.rules),
    )


def bare(module: str) -> str:
    """A module without its comments and without the decoration of atoms."""
    code = "\n".join(line for line in re.sub(r"/\*.*?\*/", "", module, flags=re.DOTALL).split("\n") if line[:2] != "--")
    return re.sub(r"\b([A-Z]{1,2}\d+)_\w+", r"\1", code)


@given(HOSTILE, st.integers(0, 50))
def test_names_of_the_keystore_never_change_the_model(name: str, seed: int) -> None:
    system = random_system(seed)
    plain, hostile = facts(renamed(system, "")), facts(renamed(system, name))
    assert bare(hostile) == bare(plain)
    assert hostile.isascii()
    for line in hostile.split("\n"):
        assert line.isprintable() or line.startswith("\t")


@given(HOSTILE)
def test_an_atom_is_an_identifier_that_leads_back_to_its_index(name: str) -> None:
    for sort in name_atoms(renamed(healthy(), name)).values():
        for atom in sort.atoms:
            assert re.fullmatch(r"[A-Z]{1,2}\d+(_[A-Za-z0-9_]+)?", atom.name)
    for role in (Role.ENCLAVE, Role.CHANNEL, Role.DOCUMENT):
        sort = name_atoms(renamed(healthy(), name))[ROLE_SORTS[role]]
        for index, atom in enumerate(sort.atoms):
            assert index_of(f"vacuity/properties/keystore/{atom.name}$0", role, healthy()) == index
            assert index_of(f"{atom.name}$0", Role.TRUST_DOMAIN, healthy()) is None


@pytest.mark.parametrize("answer", ["", "E1", "E1$1", "E1 $0", "E1$0\n", "e1$0", "E$0", "E1-x$0", "E٣$0", "x/E1$0/"])
def test_what_is_no_atom_of_ours_plays_no_role(answer: str) -> None:
    assert index_of(answer, Role.ENCLAVE, healthy()) is None


def claiming(name: str = "keystore-audit.toml") -> System:
    """A system with claims of all kinds; `name`: what their author calls his files."""
    system = with_claims(random_system(5), 5, 12)
    where = Location(path=name, line=1)
    return replace(system, claims=tuple(replace(claim, location=where) for claim in system.claims))


@given(HOSTILE)
def test_names_of_a_user_never_change_the_commands(name: str) -> None:
    plain, hostile = commands(PROPERTIES, claiming("")), commands(PROPERTIES, claiming(name))
    assert bare(hostile) == bare(plain)
    assert hostile.isascii()
    for line in hostile.split("\n"):
        assert line.lstrip("\t").isprintable()


def test_equal_systems_give_equal_text() -> None:
    assert facts(random_system(7)) == facts(random_system(7))
    assert facts(random_system(7)) != facts(random_system(8))


def test_unions_are_balanced_and_complete() -> None:
    terms = [f"T{number}" for number in range(1000)]
    text = union(terms)
    assert re.findall(r"T\d+", text) == terms
    depth = deepest = 0
    for character in text:
        depth += {"(": 1, ")": -1}.get(character, 0)
        deepest = max(deepest, depth)
    assert depth == 0
    assert deepest <= 10


def test_the_example_in_the_source_tree_is_what_would_be_written_today() -> None:
    """Made with `facts(stock())`: it lets each module run by itself."""
    assert (resources.alloy() / "keystore.als").read_text() == facts(stock())
    assert (resources.alloy() / "audit.als").read_text() == commands(PROPERTIES, window=True)


def test_each_module_opens_one_other() -> None:
    """The Analyzer parses a module once for each path to it: diamonds double the time at every level."""
    chain = ["dds_security", "keystore", *(name.removesuffix(".als") for name in ALL_MODULES[1:])]
    for before, module in pairwise(chain):
        text = (resources.alloy() / f"{module}.als").read_text()
        assert re.findall(r"^open (\w+)$", text, re.MULTILINE) == [before]
    assert re.findall(r"^open (\w+)$", (resources.alloy() / SCENARIOS).read_text(), re.MULTILINE) == ["propagation"]
    for system, last in ((None, "vacuity"), (claiming(), "claims")):
        assert re.findall(r"^open (\w+)$", commands(PROPERTIES, system), re.MULTILINE) == [last]


def test_everything_that_is_declared_has_a_comment() -> None:
    for module in (*ALL_MODULES, SCENARIOS):
        lines = (resources.alloy() / module).read_text().split("\n")
        for before, line in pairwise(lines):
            if re.match(r"(abstract sig|one sig|sig|fun|pred|assert|fact)\b", line):
                assert before.endswith("*/"), f"{module}: {line}"


def test_every_property_is_a_predicate_over_its_roles() -> None:
    text = (resources.alloy() / "properties.als").read_text()
    for prop in PROPERTIES:
        match = re.search(rf"pred {prop.predicate} {{\s*all ([^|]*)\|", text)
        assert match is not None
        without_arguments = re.sub(r"\[[^\]]*\]", "", match[1])
        declared = re.findall(rf"\b({'|'.join(role.value for role in Role)})\b(?=[,:])", without_arguments)
        assert declared == [role.value for role in prop.roles]


def test_a_model_goes_only_into_an_empty_directory(tmp_path: Path) -> None:
    write_model([stock()], tmp_path / "new" / "model")
    assert (tmp_path / "new/model/keystore.als").read_text() == facts(stock())
    with pytest.raises(UsageError, match="not empty"):
        write_model([stock()], tmp_path / "new" / "model")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        write_model([stock()], blocked)


def test_several_models_get_a_folder_each_and_the_names_are_told(tmp_path: Path) -> None:
    pinned = stock()
    unpinned = judging(pinned, pins_signer=False)
    write_model([pinned, unpinned, unpinned], tmp_path / "certain")
    write_model([pinned, replace(pinned, may=True)], tmp_path / "doubtful")
    assert [path.name for path in folders(tmp_path / "certain")] == [
        "pinned-signer",
        "unpinned-signer",
        "unpinned-signer-3",
    ]
    assert [path.name for path in folders(tmp_path / "doubtful")] == ["pinned-signer-may", "pinned-signer-must"]
    readme = (tmp_path / "certain/pinned-signer/README.md").read_text()
    assert "| `E0_talker` | /talker | enclaves/talker |" in readme
    assert "`unpinned-signer-3`" in (tmp_path / "certain/README.md").read_text()


def folders(directory: Path) -> list[Path]:
    return sorted(path for path in directory.iterdir() if path.is_dir())


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_many_atoms_stand_in_modules_of_their_own_and_say_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    modules = shipped()
    system = with_claims(lively(random_system(5), 5), 5)
    (plain,) = fact_modules(system).values()
    left_out = set(facts(system).split("\n")) - set(plain.split("\n"))
    assert {line.split()[0] for line in left_out} == {"/**", "*", "*/", "--"}
    later = tuple(instant + timedelta(days=1) for instant in system.instants)
    assert fact_modules(replace(system, instants=later)) == {"keystore.als": plain}
    assert facts(replace(system, instants=later)) != facts(system)
    monkeypatch.setattr("keystore_audit.engine.alloy.facts.MODULE_GROUPS", 1)
    monkeypatch.setattr("keystore_audit.engine.alloy.facts.SPLIT_ATOMS", 0)
    monkeypatch.setattr("keystore_audit.engine.alloy.atoms.GROUP", 2)
    split, sorts = fact_modules(system), name_atoms(system).values()
    assert len(split) > 24
    relations = [line for line in split["keystore.als"].split("\n") if line[:5] != "open "]
    assert set(relations) <= set(facts(system).split("\n"))
    assert all(
        f"fun {atom.name}: {s.sig} {{ {atom.name}_ }}" in "".join(split.values()) for s in sorts for atom in s.atoms
    )
    asked = {"audit.als": commands(PROPERTIES, system)}
    whole = outcomes(tmp_path, modules | {"keystore.als": facts(system)} | asked)
    assert outcomes(tmp_path, modules | split | asked) == whole
    assert len(set(whole.values())) == 2
    for letters, sort in LETTERS.items():
        assert atom_of(f"keystore/names_3/atoms_3/{letters}7_name_$0") == (sort, 7)
        assert atom_of(f"keystore/names_3/atoms_3/{letters}7_$0") == (sort, 7)
