"""Our schemas on generated documents: two validators, the tables of the specification, the published schemas."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
import xmlschema
from hypothesis import given, settings
from lxml import etree
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit import toml
from keystore_audit.keystore.document import Grammar
from keystore_audit.resources import schemas
from tests.amount import tried
from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import ARDENT_GOVERNANCE, CRYSTAL_PERMISSIONS, EVERYTHING_ALLOWED
from tests.oracles.xsd.grammar import is_valid
from tests.strategies.documents import Tree, changed, documents, single_changes, valid

SHARED = Path(__file__).resolve().parents[4] / "shared/reference/xsd"
"""The published schemas, which a user's clone does not have."""

PUBLISHED = {
    Grammar.GOVERNANCE: (
        "sros2-rolling/governance.xsd",
        "fast-dds/governance.xsd",
        "opendds/omg_shared_ca_governance.xsd",
    ),
    Grammar.PERMISSIONS: (
        "sros2-rolling/permissions.xsd",
        "fast-dds/permissions.xsd",
        "opendds/omg_shared_ca_permissions.xsd",
    ),
}
TYPES = {
    "integer": re.compile("id|min|max"),
    "boolean": re.compile("allow_unauthenticated_participants|enable_.*"),
    "dateTime": re.compile("not_before|not_after"),
}
PLAIN = {"integer": "0", "boolean": "true", "dateTime": "2024-01-01T00:00:00"}


class Difference(Struct, frozen=True):
    """An entry of differences.toml."""

    other: str
    types: list[str]
    values: list[str]
    pattern: str
    ours: bool
    theirs: bool
    reason: str

    def without(self, tree: Tree) -> Tree:
        """The same document with a value that nobody disagrees about wherever this difference could show."""
        for kind in self.types:
            if TYPES[kind].fullmatch(tree.tag) and re.fullmatch(self.pattern, tree.text):
                return replace(tree, text=PLAIN[kind], children=tuple(self.without(child) for child in tree.children))
        return replace(tree, children=tuple(self.without(child) for child in tree.children))


DIFFERENCES = [
    Difference(**entry)
    for entry in toml.loads((Path(__file__).parent / "differences.toml").read_text("utf-8"))["difference"]
]

Validator = Callable[[etree._Element], bool]


def own_path(grammar: Grammar, version: str = "1.1") -> Path:
    return schemas() / f"dds_security_{version}" / f"{grammar.value}.xsd"


@lru_cache(maxsize=16)
def libxml2(path: Path) -> Validator:
    schema = path.read_bytes()  # in OpenDDS's, a comment stands before the declaration
    return etree.XMLSchema(etree.fromstring(schema[schema.index(b"<?xml") :])).validate


@lru_cache(maxsize=4)
def explaining(path: Path) -> Validator:
    is_valid: Validator = xmlschema.XMLSchema10(str(path)).is_valid
    return is_valid


def other_validator(name: str, grammar: Grammar) -> Validator:
    if name == "xmlschema":
        return explaining(own_path(grammar, "1.1"))
    if not SHARED.is_dir():
        pytest.skip("no ../shared here")
    return libxml2(SHARED / name)


def check(tree: Tree, ours: Validator, theirs: Validator, name: str) -> None:
    """Both give one verdict, but for what is listed."""
    root = tree.element()
    if ours(root) == theirs(root):
        return
    for difference in DIFFERENCES:
        if difference.other == name:
            tree = difference.without(tree)
    root = tree.element()
    assert ours(root) == theirs(root), f"an unlisted difference to {name}: {tree.xml().decode()}"


@pytest.mark.parametrize("version", ["1.0", "1.1"])
@pytest.mark.parametrize("grammar", Grammar)
def test_the_grammar_of_the_specification_is_valid(grammar: Grammar, version: str) -> None:
    """What DDS-Security's tables allow, for both validators, and nothing of one document for the other."""
    ours, explains = libxml2(own_path(grammar, version)), explaining(own_path(grammar, version))
    other = libxml2(own_path(next(each for each in Grammar if each is not grammar), version))

    @settings(max_examples=tried(60))
    @given(valid(grammar, version))
    def accepted(tree: Tree) -> None:
        root = tree.element()
        assert ours(root)
        assert explains(root)
        assert not other(root)

    accepted()


@pytest.mark.parametrize(
    ("grammar", "version", "content"),
    [
        (Grammar.GOVERNANCE, "1.1", GOVERNANCE),
        (Grammar.GOVERNANCE, "1.0", ARDENT_GOVERNANCE),
        (Grammar.PERMISSIONS, "1.1", EVERYTHING_ALLOWED),
        (Grammar.PERMISSIONS, "1.0", CRYSTAL_PERMISSIONS),
        (Grammar.PERMISSIONS, "1.0", EVERYTHING_ALLOWED),
    ],
)
def test_every_single_change(grammar: Grammar, version: str, content: bytes) -> None:
    """Each change of a whole document: what the tables say, and the published schemas where they are."""
    ours = libxml2(own_path(grammar, version))
    names = PUBLISHED[grammar] if version == "1.1" and SHARED.is_dir() else ()
    whole = Tree.of(etree.fromstring(content))
    assert ours(whole.element())
    verdicts: list[bool] = []
    for tree in single_changes(whole):
        verdicts.append(ours(tree.element()))
        assert verdicts[-1] == is_valid(tree, grammar, version), tree.xml().decode()
        for name in names:
            check(tree, ours, libxml2(SHARED / name), name)
    assert len(verdicts) > 600
    assert 0.05 < sum(verdicts) / len(verdicts) < 0.9, "there are valid and invalid ones"


@pytest.mark.parametrize("version", ["1.0", "1.1"])
@pytest.mark.parametrize("grammar", Grammar)
def test_two_validators_and_the_tables_agree(grammar: Grammar, version: str) -> None:
    ours, theirs = libxml2(own_path(grammar, version)), explaining(own_path(grammar, version))
    verdicts: list[bool] = []

    @settings(max_examples=tried(200))
    @given(changed(grammar, version))
    def agree(tree: Tree) -> None:
        verdicts.append(ours(tree.element()))
        assert verdicts[-1] == is_valid(tree, grammar, version), tree.xml().decode()
        check(tree, ours, theirs, "xmlschema")

    agree()
    assert 0.05 < sum(verdicts) / len(verdicts) < 0.9, "there are valid and invalid ones"


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared here")
@pytest.mark.parametrize("grammar", Grammar)
def test_the_published_schemas_say_the_same(grammar: Grammar) -> None:
    ours = libxml2(own_path(grammar))
    theirs = {name: libxml2(SHARED / name) for name in PUBLISHED[grammar]}
    verdicts: list[bool] = []

    @settings(max_examples=tried(400))
    @given(documents(grammar))
    def agree(tree: Tree) -> None:
        verdicts.append(ours(tree.element()))
        for name, validator in theirs.items():
            check(tree, ours, validator, name)

    agree()
    assert 0.05 < sum(verdicts) / len(verdicts) < 0.9, "there are valid and invalid ones"


@pytest.mark.parametrize(
    ("difference", "value"), [(difference, value) for difference in DIFFERENCES for value in difference.values]
)
def test_every_listed_difference_is_one(difference: Difference, value: str) -> None:
    """Each value of the list, in a document that is valid otherwise: an entry that is no longer true has to go."""
    assert difference.reason
    assert difference.ours != difference.theirs
    for kind in difference.types:
        grammar = Grammar.PERMISSIONS if kind == "dateTime" else Grammar.GOVERNANCE
        ours, theirs = libxml2(own_path(grammar)), other_validator(difference.other, grammar)
        tree = _with_value(kind, value)
        root: Any = tree.element()
        assert (ours(root), theirs(root)) == (difference.ours, difference.theirs), (kind, value)
        root = difference.without(tree).element()
        assert ours(root)
        assert theirs(root)


def _with_value(kind: str, value: str) -> Tree:
    """A small valid document, but for `value` in its first element of the type."""
    kinds = [Tree(f"{what}_protection_kind", text="NONE") for what in ("discovery", "liveliness", "rtps")]
    flags = ("discovery_protection", "liveliness_protection", "read_access_control", "write_access_control")
    topic = Tree(
        "topic_rule",
        (
            Tree("topic_expression", text="*"),
            *(Tree(f"enable_{flag}", text="true") for flag in flags),
            *(Tree(f"{what}_protection_kind", text="NONE") for what in ("metadata", "data")),
        ),
    )
    domains = Tree("domains", (Tree("id", text=value if kind == "integer" else "0"),))
    rule = Tree(
        "domain_rule",
        (
            domains,
            Tree("allow_unauthenticated_participants", text=value if kind == "boolean" else "false"),
            Tree("enable_join_access_control", text="true"),
            *kinds,
            Tree("topic_access_rules", (topic,)),
        ),
    )
    if kind != "dateTime":
        return Tree("dds", (Tree("domain_access_rules", (rule,)),))
    validity = Tree("validity", (Tree("not_before", text=value), Tree("not_after", text="2034-01-01T00:00:00")))
    grant = (Tree("subject_name", text="CN=/g"), validity, Tree("default", text="DENY"))
    return Tree("dds", (Tree("permissions", (Tree("grant", grant, attributes=(("name", "g"),)),)),))
