"""Policies, permissions and what differs between them, worked out name by name without the code under test."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

from keystore_audit.intent.policy import Policy, read_policy
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Grant, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.intended.drift import Drift, EnclaveDrift, drift
from keystore_audit.model.inventory import documents_of
from keystore_audit.profiles import DEFAULT, VARIANTS
from tests.rules.evidence import AT, allow, enclave, grant, keystore, permissions

Right = tuple[str, str]
"""`publish` or `subscribe`, and a DDS topic."""


class Listed(NamedTuple):
    """A rule in plain: what it lists, in the default partition."""

    allows: bool
    publish: tuple[str, ...]
    subscribe: tuple[str, ...]

    def topics(self, operation: str) -> tuple[str, ...]:
        return self.publish if operation == "publish" else self.subscribe

    def rule(self) -> Rule:
        """The same as evidence."""
        return allow(self.publish, self.subscribe, allows=self.allows)


def listed_in(document: Path) -> dict[str, list[Listed]]:
    """The rules of a permissions document, by the path in the name of the grant."""
    found = {}
    for each in ET.parse(document).getroot().iter("grant"):
        rules = [rule for rule in each if rule.tag in ("allow_rule", "deny_rule")]
        found[str(each.get("name"))] = [
            Listed(
                rule.tag == "allow_rule",
                tuple(str(topic.text) for topic in rule.findall("publish/topics/topic")),
                tuple(str(topic.text) for topic in rule.findall("subscribe/topics/topic")),
            )
            for rule in rules
        ]
    return found


def allowed(rules: Iterable[Listed], names: Iterable[str]) -> set[Right]:
    """What the rules allow of these names: the first rule that lists a name decides, by the letters of the clause."""
    found = set()
    every = list(rules)
    for operation in ("publish", "subscribe"):
        for name in names:
            for rule in every:
                if any(matches(text, name) for text in rule.topics(operation)):
                    if rule.allows:
                        found.add((operation, name))
                    break
    return found


def matches(expression: str, name: str) -> bool:
    """fnmatch of POSIX without brackets and backslashes."""
    return (
        re.fullmatch("".join({"*": ".*", "?": "."}.get(sign) or re.escape(sign) for sign in expression), name)
        is not None
    )


def store(rules: dict[str, Sequence[Listed]], **more: Any) -> Keystore:
    """A keystore whose enclaves are granted these rules; none for an empty list, since a grant has to have one."""
    made = []
    for path, each in rules.items():
        granted: Grant = grant(path, *([one.rule() for one in each] or [allow()]), **more)
        made.append(enclave(path, permissions=permissions(f"enclaves{path}/permissions.p7s", granted)))
    return keystore(*made)


def compared(policy: Policy, held: Keystore, *profiles: str, domain: int | None = None) -> Drift:
    """The drift under these profiles, or the default ones."""
    accesses = AccessViews(documents_of(held), AT, None)
    return drift(held, policy, [VARIANTS[name] for name in profiles or DEFAULT], AT, accesses, domain)


def sole(found: Drift) -> tuple[set[Right], set[Right]]:
    """What is lacking and exceeding in the one enclave that drifts, by the witnesses; nothing where none does."""
    lacking: set[Right] = set()
    exceeding: set[Right] = set()
    for each in found.enclaves:
        lacking |= {(right.operation.value, right.topic) for right in each.lacking.rights}
        exceeding |= {(right.operation.value, right.topic) for right in each.exceeding.rights}
    return lacking, exceeding


def only(found: Drift) -> EnclaveDrift:
    (each,) = found.enclaves
    return each


def policy_of(folder: Path, profiles: str, *paths: str) -> Policy:
    """A policy with these `<profiles>` for each of the enclaves, /talker if none is named."""
    enclaves = "".join(f'<enclave path="{path}">{profiles}</enclave>' for path in paths or ("/talker",))
    text = f'<policy version="0.2.0"><enclaves>{enclaves}</enclaves></policy>'
    file = folder / "a.policy.xml"
    file.write_text(text, "utf-8")
    return read_policy(file)
