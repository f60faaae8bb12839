"""Variables that decide about security, as a process of a launch file starts with them.

What a shell, a program before another, or code that is not followed makes of variables is not worked out: where such a
text speaks of security, what it sets is not known (`speaks_of`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, RMW, SECURE, STRATEGY
from keystore_audit.intent.launch_actions import (
    AssignEnvironment,
    Condition,
    Group,
    Reference,
    StartProcess,
    Text,
    Unknown,
    Variable,
)
from keystore_audit.intent.launch_scope import Scope
from keystore_audit.intent.source import Source

PREFIX: Final = "launch-prefix"
"""The launch configuration that stands before each program that has no prefix of its own (launch, execute_local)."""

NAMES: Final[tuple[str, ...]] = (OVERRIDE, ENABLE, STRATEGY, KEYSTORE, DOMAIN, RMW)
"""What rcl and rmw read before they take an enclave (rcl's `security.c`, `domain_id.c`, rmw_implementation)."""

_SPEAKING: Final = re.compile(
    "ROS_SECURITY[A-Z_]*|ROS_DOMAIN_ID|RMW_IMPLEMENTATION|[A-Z_]{0,20}(?:DDS|RTPS|ZENOH)_[A-Z_]+|enclave"
)
"""Variables of security, of the middleware and of its configuration, and the option `--enclave`."""


def speaks_of(*texts: str) -> str:
    """The first word of security that stands in the texts; empty where there is none."""
    found = (_SPEAKING.search(text) for text in texts)
    return next((match[0] for match in found if match), "")


def replaced(
    values: Iterable[tuple[Text, Text]],
    *,
    line: int,
    conditions: tuple[Condition, ...],
    earlier: bool,
) -> Group:
    """All variables give way to these, or (`earlier`) to those that there were before."""
    before = Unknown(reason="an earlier environment") if earlier else ""
    every = (*(((name,), (before,)) for name in NAMES), *values)
    actions = tuple(AssignEnvironment(line=line, name=name, value=value) for name, value in every)
    return Group(line=line, conditions=conditions, actions=actions, scoped=False)


def command_line(action: StartProcess, scope: Scope, source: Source) -> str:
    """What is run; `$` stands for what cannot be told."""
    known = (scope.known((part,), source) for word in action.command for part in (*word, " "))
    return "".join(each if isinstance(each, str) else "$" for each in known)


def is_itself(name: str, default: str | None) -> bool:
    """Whether a variable that is set to what it is already, or to `default`, stays what it is to ROS 2.

    Security that is not set is the worst that there is, and domain 0 is the one where none is set.
    """
    return name in SECURE or default in (None, "", "0" if name == DOMAIN else "")


def started_with(action: StartProcess, scope: Scope, source: Source) -> dict[str, str | Unknown]:
    """The values of those of `NAMES` that the launch file sets for a process; the rest come from its own start."""
    found = {name: scope.environment[name] for name in NAMES if name in scope.environment}
    for name, value in action.environment:
        variable = scope.known(name, source)
        if isinstance(variable, Unknown):
            found |= dict.fromkeys(NAMES, variable)
        elif variable in NAMES and is_lookup(variable, value):
            found.pop(variable, None)
            found |= {variable: scope.environment[variable]} if variable in scope.environment else {}
        elif variable in NAMES:
            found[variable] = scope.known(value, source)
    return found


def before_program(action: StartProcess, scope: Scope, source: Source) -> str:
    """What stands before the program, as far as it can be told."""
    prefix = scope.arguments.get(PREFIX, "") if action.prefix is None else scope.known(action.prefix, source)
    return prefix if isinstance(prefix, str) else ""


def is_lookup(name: str, value: Text) -> bool:
    """Whether a variable is set to itself."""
    match value:
        case (Reference(variable=Variable.ENVIRONMENT, name=(str(looked_up),), default=default),):
            told = None if default is None else "".join(each if isinstance(each, str) else "$" for each in default)
            return looked_up == name and is_itself(name, told)
    return False
