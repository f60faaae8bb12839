"""What `suggest` writes: a grant as a permissions document, and a policy as SROS2 reads it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Final

from keystore_audit.intent.intent import Action
from keystore_audit.keystore.typed import Grant
from keystore_audit.model.intended.observed_needs import LeastPolicy, PolicyRight
from keystore_audit.report.templated import environment
from keystore_audit.text import html

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

    Plain XML without comments, which implementations read in different ways. Criteria are in the default partition.
    """
    return environment(html).get_template("permissions.xml.j2").render(grant=grant)


def policy_xml(policy: LeastPolicy) -> str:
    """Version 0.2.0 of the ROS 2 design article "SROS2 access control policies"; ends in a line feed.

    The usual rights of a node stand behind a comment. Names are absolute, so that no namespace changes them. Each
    enclave has one `<profiles>`: of several, sros2 makes several grants, and implementations ask the first alone.
    """
    template = environment(html).get_template("policy.xml.j2")
    return template.render(policy=policy, elements=_ELEMENTS, lists=_lists)


def _lists(rights: Iterable[PolicyRight]) -> list[tuple[PolicyRight, list[PolicyRight]]]:
    """Rights that one list can hold together, behind the first of them."""
    groups = (list(group) for _what, group in groupby(rights, lambda right: (right.usual, right.allow, right.action)))
    return [(group[0], group) for group in groups]
