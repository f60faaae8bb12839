"""Keystores whose documents break the plain form somewhere: elements, attributes, values, text, in random places.

Reproducible: the same seed gives the same keystore, dates apart.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from random import Random

from lxml import etree

from tests.keystore.documents import allow, criterion, deny, domain_rule, governance, ids, pub, sub, topic_rule
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.recipe import Recipe, of_rules

_RULES = of_rules(
    deny(pub("rt/d"), domains=ids(0, 7)),
    allow(criterion("publish", "rt/a", "rt/b", partitions=("", "p")), sub("rt/*"), domains=ids((0, 3), 9)),
    allow(pub("rt/c*")),
)
_GOVERNANCE = governance(
    domain_rule(topic_rule("rt/open", read=False, write=False), topic_rule("rt/*"), domains=ids((0, 1), 7)),
    domain_rule(domains=ids(2, 3)),
)
_ENDPOINTS = (
    *(publish(f"rt/{name}") for name in ("a", "b", "c", "d", "open")),
    publish("rt/a", "p"),
    *(subscribe(f"rt/{name}") for name in ("a", "open")),
)
_BLANKS = (*(" ", "\n  ", "\t") * 4, "\u00a0")
"""The last one is none to anybody, and what that makes of a number nobody has measured."""
_FLAGS = ("TRUE", "FALSE", "True", "False", "tRuE", "1", "0", "yes", "", "2", " true ", "\nfalse\n")
_KINDS = ("NONE", "SIGN", "sign", "ENCRYPT", "", " SIGN ", "ALL", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
_NUMBERS = ("0", " 0 ", "+0", "00", "7", "\n0\n", "no")
_WORDS = ("ALLOW", "allow", "DENY", " ALLOW ", "ALLOW\n", "YES")
_KNOWN = sorted({str(each.tag) for text in (_RULES, _GOVERNANCE) for each in etree.fromstring(text.encode()).iter()})
_VALUES = {"default": _WORDS, **dict.fromkeys(("id", "min", "max"), _NUMBERS)}


def _of(random: Random, root: etree._Element, *, leaf: bool | None = None) -> etree._Element:
    """One of its elements, the root apart where it has others."""
    found = [
        each for each in root.iter(etree.Element) if each is not root and (leaf is None or leaf == (len(each) == 0))
    ]
    return random.choice(found or [root])


def _values(tag: str) -> tuple[str, ...]:
    if tag.startswith(("enable_", "allow_un")):
        return _FLAGS
    return _KINDS if tag.endswith("_kind") else _VALUES.get(tag, ())


def _drop(random: Random, root: etree._Element) -> None:
    element = _of(random, root)
    element.getparent().remove(element)


def _repeat(random: Random, root: etree._Element) -> None:
    element = _of(random, root)
    parent = element.getparent()
    parent.insert(random.choice((parent.index(element), len(parent))), copy.deepcopy(element))


def _move(random: Random, root: etree._Element) -> None:
    element = _of(random, root)
    parent = element.getparent()
    parent.insert(random.randrange(len(parent)), element)


def _foreign(random: Random, root: etree._Element) -> None:
    parent = random.choice([root, _of(random, root, leaf=False)])
    other = etree.Element(random.choice(("note", "enable_key_revision", "data_tags", "tag", *_KNOWN)))
    other.text = "true"
    parent.insert(random.randrange(len(parent) + 1), other)


def _rename(random: Random, root: etree._Element) -> None:
    element = random.choice([root, _of(random, root)])
    element.tag = random.choice((str(element.tag).upper(), str(element.tag).title(), "note"))


def _attribute(random: Random, root: etree._Element) -> None:
    instance = "{http://www.w3.org/2001/XMLSchema-instance}"
    name = random.choice(("id", "name", f"{instance}noNamespaceSchemaLocation", f"{instance}schemaLocation"))
    random.choice([root, _of(random, root)]).set(name, "a\n b")


def _nameless(_random: Random, root: etree._Element) -> None:
    for grant in root.iter("grant"):
        grant.attrib.pop("name", None)


def _text(random: Random, root: etree._Element) -> None:
    _of(random, root).tail = "text"


def _blanks(random: Random, root: etree._Element) -> None:
    leaf, blank = _of(random, root, leaf=True), random.choice(_BLANKS)
    leaf.text = random.choice((f"{blank}{leaf.text}", f"{leaf.text}{blank}", f"{blank}{leaf.text}{blank}"))


def _comment(random: Random, root: etree._Element) -> None:
    element, comment = random.choice([root, _of(random, root)]), etree.Comment("c")
    if len(element) == 0:
        text = element.text or ""
        cut = random.randrange(len(text) + 1)
        element.text, comment.tail = text[:cut], text[cut:]
    element.insert(random.randrange(len(element) + 1), comment)


def _instruction(random: Random, root: etree._Element) -> None:
    _of(random, root, leaf=False).insert(0, etree.PI("pi", "x"))


def _empty(random: Random, root: etree._Element) -> None:
    _of(random, root, leaf=False)[:] = []


def _value(random: Random, root: etree._Element) -> None:
    element = random.choice([each for each in root.iter(etree.Element) if _values(str(each.tag))] or [root])
    element.text = random.choice(_values(str(element.tag)) or ("text",))


_CHANGES: tuple[Callable[[Random, etree._Element], None], ...] = (
    *(_drop, _repeat, _move, _foreign, _rename, _attribute, _nameless),
    *(_text, _blanks, _blanks, _comment, _instruction, _empty, _value, _value),
)


def _changed(random: Random, text: str) -> str:
    root = etree.fromstring(text.encode())
    for change in random.choices(_CHANGES, k=random.choice((1, 1, 1, 2))):
        change(random, root)
    return etree.tostring(root, encoding="unicode").replace("&#10;", "\n")  # in attributes, as editors break lines


def keystore(seed: int) -> Recipe:
    """One keystore of which one document is out of form."""
    random = Random(seed)
    rights = random.random() < 0.5
    return Recipe(
        title=f"form, seed {seed}",
        governance=_GOVERNANCE if rights else _changed(random, _GOVERNANCE),
        permissions=_changed(random, _RULES) if rights else _RULES,
        endpoints=_ENDPOINTS,
    )
