"""What `suggest` writes: a grant as a permissions document, and a policy as SROS2 reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Final

from keystore_audit.intent.intent import Action
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.permissions import Criterion, Grant, Rule
from keystore_audit.model.intended.observed_needs import LeastPolicy, NodePolicy, PolicyRight
from keystore_audit.text import html

_SCHEMA: Final = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd"
_DDS: Final = f'dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{_SCHEMA}"'

_ELEMENTS: Final = {
    Action.PUBLISH: "topic",
    Action.SUBSCRIBE: "topic",
    Action.REQUEST: "service",
    Action.REPLY: "service",
    Action.CALL: "action",
    Action.EXECUTE: "action",
}


def permissions_xml(grant: Grant) -> str:
    """The document with this one grant (DDS-Security 1.1, 9.4.1.3), ready to be signed; ends in a line feed.

    Plain XML without comments, which implementations read in different ways.
    """
    return "".join(f"{line}\n" for line in _inside(_DDS, _inside("permissions", _grant(grant))))


def policy_xml(policy: LeastPolicy) -> str:
    """Version 0.2.0 of the ROS 2 design article "SROS2 access control policies"; ends in a line feed.

    The usual rights of a node stand behind a comment. Names are absolute, so that no namespace changes them. Each
    enclave has one `<profiles>`: of several, sros2 makes several grants, and implementations ask the first alone.
    """
    enclaves: list[str] = []
    for each in policy.enclaves:
        nodes = (line for node in each.nodes for line in _node(node))
        enclaves += _inside(f'enclave path="{html(each.path)}"', _inside("profiles", nodes))
    lines = _inside('policy version="0.2.0"', _inside("enclaves", enclaves))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "".join(f"{line}\n" for line in lines)


def _inside(opening: str, lines: Iterable[str]) -> Iterator[str]:
    """The lines within an element."""
    yield f"<{opening}>"
    yield from (f"  {line}" for line in lines)
    yield f"</{opening.split(' ', maxsplit=1)[0]}>"


def _element(name: str, text: Text) -> str:
    return f"<{name}>{html(text.text)}</{name}>"


def _grant(grant: Grant) -> Iterator[str]:
    validity = _element("not_before", grant.not_before), _element("not_after", grant.not_after)
    parts = [
        _element("subject_name", grant.subject_name),
        *_inside("validity", validity),
        *(line for rule in grant.rules for line in _rule(rule)),
        f"<default>{'ALLOW' if grant.default_allow else 'DENY'}</default>",
    ]
    return _inside(f'grant name="{html(grant.name)}"', parts)


def _rule(rule: Rule) -> Iterator[str]:
    domains: list[str] = []
    for each in rule.domains:
        ends = f"<min>{each.low}</min>", f"<max>{each.high}</max>"
        domains += [f"<id>{each.low}</id>"] if each.low == each.high else _inside("id_range", ends)
    criteria = (line for criterion in rule.criteria for line in _criterion(criterion))
    return _inside("allow_rule" if rule.allow else "deny_rule", [*_inside("domains", domains), *criteria])


def _criterion(criterion: Criterion) -> Iterator[str]:
    """A criterion in the default partition."""
    topics = (_element("topic", topic) for topic in criterion.topics)
    return _inside(criterion.operation.value, _inside("topics", topics))


def _node(node: NodePolicy) -> Iterator[str]:
    namespace, _, name = node.name.rpartition("/")
    lines: list[str] = []
    comment = "<!-- usual: every node has these, whatever it is for -->"
    for (usual, allow, action), rights in groupby(node.rights, _list):
        if usual and comment not in lines:
            lines.append(comment)
        element = _ELEMENTS[action]
        named = (f"<{element}>{html(right.name)}</{element}>" for right in rights)
        lines += _inside(f'{element}s {action.value}="{"ALLOW" if allow else "DENY"}"', named)
    return _inside(f'profile ns="{html(namespace or "/")}" node="{html(name)}"', lines)


def _list(right: PolicyRight) -> tuple[bool, bool, Action]:
    """What rights of one list have in common."""
    return right.usual, right.allow, right.action
