"""What a reader of alloy/ who knows Alloy and not DDS relies on: the comments, as far as a machine can hold them."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest

from keystore_audit import resources

GENERATED = {"keystore", "nodes"}
"""Constant functions, which `dds_security` and a header explain together."""

SHIPPED = sorted(path.stem for path in resources.alloy().glob("*.als"))

_COMMENT = re.compile(r"/\*.*?\*/|--[^\n]*", re.DOTALL)
_DECLARED = re.compile(r"^(?:var )?(?:abstract sig|one sig|sig|fun|pred|assert|fact) ", re.ASCII)
_ABBREVIATION = re.compile(r"\b[A-Z][A-Z0-9]*(?:/[A-Z]+|[A-Z])[A-Z0-9]*\b", re.ASCII)

TITLES = {"CVE", "RFC"}
"""What begins the number of a document."""

WORDS = (
    "access control",
    "discovery",
    "enclave",
    "endpoint",
    "governance",
    "grant",
    "identity",
    "implementation",
    "intermediate",
    "keystore",
    "match",
    "message",
    "node",
    "participant",
    "partition",
    "payload",
    "peer",
    "permissions",
    "reader",
    "relay",
    "revoke",
    "sample",
    "subject",
    "submessage",
    "topic",
    "trust anchor",
    "writer",
)
"""Words of DDS, ROS 2 and certificates that the comments use."""


def text(module: str) -> str:
    return (resources.alloy() / f"{module}.als").read_text(encoding="ascii")


def comments(module: str) -> str:
    return "\n".join(_COMMENT.findall(text(module)))


def code(module: str) -> str:
    return _COMMENT.sub(" ", text(module))


def header() -> str:
    """What stands above `module dds_security`: where a reader begins."""
    return text("dds_security").partition("\nmodule ")[0]


@pytest.mark.parametrize("module", sorted({*SHIPPED} - GENERATED))
def test_everything_that_is_declared_has_a_comment_directly_above(module: str) -> None:
    lines = text(module).split("\n")
    declared = [(before, line) for before, line in pairwise(lines) if _DECLARED.match(line)]
    assert declared
    assert [line for before, line in declared if not before.endswith("*/")] == []


@pytest.mark.parametrize("module", SHIPPED)
def test_every_module_begins_with_what_it_is_about(module: str) -> None:
    assert re.match(r"/\*\*\s.{20,}?\*/\nmodule " + module + "\n", text(module), re.DOTALL)


def test_every_function_of_the_facts_is_explained_where_a_reader_begins() -> None:
    explained = set(re.findall(r"\w+", "\n".join(re.findall(r"(?m)^ \*   ([a-z_]+(?:, [a-z_.]+)*) {2,}", header()))))
    flags = re.compile(r"(?:allow|enable)_\w+|\w+_protection_kind", re.ASCII)
    functions = set(re.findall(r"(?m)^fun (\w+)", text("keystore")))
    assert len(functions) > 30
    assert {name for name in functions - explained if not flags.fullmatch(name)} == set()
    assert set(re.findall(r"(?m)^fun (\w+)", text("nodes"))) <= set(re.findall(r"\w+", comments("nodes")))


def test_every_module_is_in_the_order_of_reading() -> None:
    order = re.findall(r"\w+", header().partition("Words, for who")[0])
    assert set(SHIPPED) <= set(order)


@pytest.mark.parametrize("word", WORDS)
def test_the_words_of_the_field_are_explained_where_a_reader_begins(word: str) -> None:
    used = [module for module in SHIPPED if re.search(rf"\b{word}", comments(module)) and module != "dds_security"]
    assert used, "no comment uses it any more"
    assert re.search(rf"\*{word}s?\*|(?m:^ \*   (?:[\w ]+, )*{word}s?[ ,])", header())


@pytest.mark.parametrize("module", sorted({*SHIPPED} - GENERATED))
def test_abbreviations_are_explained_where_a_reader_begins(module: str) -> None:
    words = {word for name in SHIPPED for word in re.findall(r"\w+", code(name))}
    unknown = set(_ABBREVIATION.findall(re.sub(r"`[^`\n]+`", "", comments(module)))) - words - TITLES
    assert unknown <= set(_ABBREVIATION.findall(header()))


@pytest.mark.parametrize("module", sorted({*SHIPPED} - GENERATED))
def test_names_in_comments_are_names_of_the_model(module: str) -> None:
    """A comment that speaks of something renamed or gone misleads more than none."""
    words = {word for name in SHIPPED for word in re.findall(r"\w+", code(name))} | {*SHIPPED}
    quoted = set(re.findall(r"`([^`\n]+)`", comments(module))) - ELSEWHERE
    stale = {each for each in quoted if not set(re.findall(r"\w+", each)) <= words}
    assert stale == set()


ELSEWHERE = {
    "<domain_rule>",
    "<topic_rule>",
    "<grant>",
    "<allow_rule>",
    "<deny_rule>",
    "keystore-audit explain PROPERTY",
    "keystore-audit.toml",
    "_WITH_ORIGIN_AUTHENTICATION",
    "Clock",
    "Beginning",
}
"""What comments quote of documents, of the command line, and of facts whose audit instant moves."""
