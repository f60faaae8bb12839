"""Variables that decide about security, as a process of a launch file starts with them."""

from __future__ import annotations

import shlex
from typing import Final

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, STRATEGY
from keystore_audit.intent.launch_actions import StartNode, Unknown
from keystore_audit.intent.launch_scope import Scope
from keystore_audit.intent.source import Source, shown

PREFIX: Final = "launch-prefix"
"""The launch configuration that stands before each program that has no prefix of its own (launch, execute_local)."""

NAMES: Final[tuple[str, ...]] = (OVERRIDE, ENABLE, STRATEGY, KEYSTORE, DOMAIN)
"""What rcl and rmw read before they take an enclave (rcl's `security.c`, `domain_id.c`)."""


def started_with(action: StartNode, scope: Scope, source: Source) -> dict[str, str | Unknown]:
    """The values of those of `NAMES` that the launch file sets for a process; the rest come from its own start."""
    found = {name: scope.environment[name] for name in NAMES if name in scope.environment}
    for name, value in action.environment:
        variable = scope.known(name, source)
        if isinstance(variable, Unknown):
            found |= dict.fromkeys(NAMES, variable)
        elif variable in NAMES:
            found[variable] = scope.known(value, source)
    prefix = scope.arguments.get(PREFIX, "") if action.prefix is None else scope.known(action.prefix, source)
    if isinstance(prefix, Unknown):
        return {**found, OVERRIDE: prefix}
    return {**found, **_before(prefix)}


def _before(prefix: str) -> dict[str, str | Unknown]:
    """What stands before the program, such as `env NAME=VALUE`, sets."""
    spoken = [name for name in NAMES if name in prefix]
    if not spoken:
        return {}
    found: dict[str, str | Unknown] = {}
    try:
        words = shlex.split(prefix)
    except ValueError:
        words = [prefix]
    for word in words:
        name, is_set, value = word.partition("=")
        if name in NAMES and is_set:
            found[name] = value
            continue
        for each in spoken:
            if each in word:
                reason = f"{shown(prefix)}, which stands before the program and speaks of {each}"
                return {**found, **dict.fromkeys(spoken, Unknown(reason=reason))}
    return found
