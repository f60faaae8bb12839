"""Variables that decide about security, as a process of a launch file starts with them."""

from __future__ import annotations

import re
import shlex
from typing import Final

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, RMW, STRATEGY
from keystore_audit.intent.launch_actions import StartProcess, Unknown
from keystore_audit.intent.launch_scope import Scope
from keystore_audit.intent.source import Source, shown

PREFIX: Final = "launch-prefix"
"""The launch configuration that stands before each program that has no prefix of its own (launch, execute_local)."""

FILTER: Final = "launch-prefix-filter"
"""The one that says for which programs (launch, executable)."""

NAMES: Final[tuple[str, ...]] = (OVERRIDE, ENABLE, STRATEGY, KEYSTORE, DOMAIN, RMW)
"""What rcl and rmw read before they take an enclave (rcl's `security.c`, `domain_id.c`, rmw_implementation)."""

_KEEPERS: Final = re.compile(
    "chrt|gdb|gdbserver|heaptrack|ionice|lldb|ltrace|nice|nohup|numactl|perf|rr|setsid|stdbuf|strace|taskset|time|timeout"
    "|unbuffer|valgrind|xterm"
)
"""Programs that start another one in the environment that they have themselves."""

_CHANGERS: Final = frozenset({"sudo", "su", "doas", "runuser", "sh", "bash", "dash", "zsh", "ssh", "systemd-run"})
"""What may start with other variables, and is often started by one of `_KEEPERS`."""


def started_with(action: StartProcess, scope: Scope, source: Source) -> dict[str, str | Unknown]:
    """The values of those of `NAMES` that the launch file sets for a process; the rest come from its own start."""
    found = {name: scope.environment[name] for name in NAMES if name in scope.environment}
    if action.clean:
        found = dict.fromkeys(NAMES, "")
    for name, value in action.environment:
        variable = scope.known(name, source)
        if isinstance(variable, Unknown):
            found |= dict.fromkeys(NAMES, variable)
        elif variable in NAMES:
            found[variable] = scope.known(value, source)
    prefix = scope.arguments.get(PREFIX, "") if action.prefix is None else scope.known(action.prefix, source)
    before = _unknown(prefix) if isinstance(prefix, Unknown) else _before(prefix)
    if action.prefix is None and before and scope.arguments.get(FILTER):
        before = dict.fromkeys(before, Unknown(reason=f"{FILTER}, which says for which programs {PREFIX} counts"))
    return {**found, **before}


def _before(prefix: str) -> dict[str, str | Unknown]:
    """What stands before the program, such as `env NAME=VALUE`, sets."""
    may_change = Unknown(reason=f"{shown(prefix)}, which stands before the program and may change its environment")
    try:
        words = shlex.split(prefix)
    except ValueError:
        return _unknown(may_change)
    found: dict[str, str | Unknown] = {}
    program = ""
    for word in words:
        called = word.rpartition("/")[2]
        name, is_set, value = word.partition("=")
        if called == "env" or _KEEPERS.fullmatch(called):
            program = called
        elif program == "env" and is_set and not name.startswith("-"):
            found |= {name: value} if name in NAMES else {}
        elif program in ("", "env") or called in _CHANGERS or any(each in word for each in NAMES):
            return {**found, **_unknown(may_change)}
    return found


def _unknown(reason: Unknown) -> dict[str, str | Unknown]:
    """Whether there is security at all, and in which enclave, cannot be told."""
    return {OVERRIDE: reason, ENABLE: reason}
