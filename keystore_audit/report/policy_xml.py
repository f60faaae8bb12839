"""A policy as SROS2 reads it: version 0.2.0 of the ROS 2 design article "SROS2 access control policies".

Names are absolute, so that no namespace changes them. Each enclave has one `<profiles>`: of several, sros2 makes
several grants, and implementations ask the first alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Final

from keystore_audit.intent.intent import Action
from keystore_audit.model.intended.least_policy import EnclavePolicy, LeastPolicy, NodePolicy, PolicyRight
from keystore_audit.text import html

USUAL: Final = "<!-- usual: every node has these, whatever it is for -->"

_ELEMENTS: Final = {
    Action.PUBLISH: "topic",
    Action.SUBSCRIBE: "topic",
    Action.REQUEST: "service",
    Action.REPLY: "service",
    Action.CALL: "action",
    Action.EXECUTE: "action",
}
_INDENT: Final = "  "


def policy_xml(policy: LeastPolicy) -> str:
    """The document, ending in a line feed; the usual rights of a node stand behind a comment."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<policy version="0.2.0">', f"{_INDENT}<enclaves>"]
    for enclave in policy.enclaves:
        lines += _enclave(enclave)
    lines += [f"{_INDENT}</enclaves>", "</policy>", ""]
    return "\n".join(lines)


def _enclave(enclave: EnclavePolicy) -> Iterator[str]:
    yield f'{_INDENT * 2}<enclave path="{html(enclave.path)}">'
    yield f"{_INDENT * 3}<profiles>"
    for node in enclave.nodes:
        yield from _profile(node)
    yield f"{_INDENT * 3}</profiles>"
    yield f"{_INDENT * 2}</enclave>"


def _profile(node: NodePolicy) -> Iterator[str]:
    namespace, _, name = node.name.rpartition("/")
    yield f'{_INDENT * 4}<profile ns="{html(namespace or "/")}" node="{html(name)}">'
    marked = False
    for (usual, allow, action), rights in groupby(node.rights, _list):
        if usual and not marked:
            yield f"{_INDENT * 5}{USUAL}"
            marked = True
        element = _ELEMENTS[action]
        yield f'{_INDENT * 5}<{element}s {action.value}="{"ALLOW" if allow else "DENY"}">'
        for right in rights:
            yield f"{_INDENT * 6}<{element}>{html(right.name)}</{element}>"
        yield f"{_INDENT * 5}</{element}s>"
    yield f"{_INDENT * 4}</profile>"


def _list(right: PolicyRight) -> tuple[bool, bool, Action]:
    """What rights of one list have in common."""
    return right.usual, right.allow, right.action
