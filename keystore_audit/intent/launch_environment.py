"""Variables that decide about security, as a process of a launch file starts with them."""

from __future__ import annotations

import re
import shlex
from bisect import bisect_left
from collections.abc import Iterable
from typing import Final

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, RMW, SECURE, STRATEGY
from keystore_audit.intent.launch_actions import (
    AssignEnvironment,
    Comparison,
    Condition,
    Group,
    Reference,
    StartProcess,
    Text,
    Unknown,
    Variable,
)
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

_INSTALLED: Final = re.compile(r"^(?:/usr)?/bin/")
"""Where they are; what is called so in a folder of one's own may do anything."""

_OPTION: Final = re.compile(r"-.*|[0-9][0-9A-Za-z,.:-]*|record|stat|trace")
"""Their options and numbers; any other word may be a program, which may change variables as `sudo` does."""

_TITLED: Final = frozenset({"-T", "-title", "-n"})
"""Options of xterm that any word may stand behind."""

_DEBUGGERS: Final = frozenset({"gdb", "gdbserver", "lldb"})
_DEBUGGING: Final = re.compile(
    r"-{0,2}(?:args|q|quiet|tui|batch|o|ex|ex=r|ex=run|r|run|bt|bt full|backtrace|quit|catch throw)?"
    r"|thread apply all bt(?: full)?|set (?:pagination|confirm) off|[a-z]*:[0-9]+"
)
"""What they are told; they can change variables, too."""

_LATER: Final = re.compile(r"""sleep [0-9.]+ ?(?:;|&&) ?(?:exec )?(["']?)\$0\1 (["']?)\$@\2""")
"""What a shell does in the usual prefix of a node that starts later, `bash -c 'sleep 5; $0 $@'`."""

_END: Final = re.compile("[;&|\n]")

_UNSET: Final = re.compile(r"\bunset\b|(?:^|\s)-u|--unset")
"""What takes back the variables that are named behind it: a shell's own word, and options of env."""

_TOUCHED: Final = re.compile(r"\b(?:declare|export|for|getopts|local|mapfile|printf|read|readarray|typeset)\s")
"""What a shell may change a variable by, to whatever: `export -n NAME`, `read NAME`."""

_BEGUN: Final = re.compile(r"\^?([A-Z]+_(?:[A-Z]+_)*)(?![A-Z0-9_])")
"""How names of variables begin."""

_AS_ANOTHER: Final = re.compile(
    r"\b(?:sudo|(doas|docker|kubectl|lxc|machinectl|pkexec|podman|runuser|ssh|su|systemd-run|tmux))(?=\s)"
)
"""What starts programs as somebody else or elsewhere, and takes back all variables that it is not told to keep."""

_KEPT: Final = re.compile(r"\s(?:-[A-Za-z]*E|--preserve-env)\s")
_NODE: Final = re.compile(r"\bros2\s|--ros-args|/opt/ros/")

_ROS2: Final = re.compile(r"(\S{0,200})\bros2\s")
_SHELLS: Final = re.compile("(?:/usr)?(?:/bin/)?(?:ba|da|z)?sh")
_HARMLESS: Final = re.compile(
    r"[!({]|command|do|elif|else|exec|if|then|time|until|while|[A-Za-z_][A-Za-z0-9_]*=\S*|[($]*(?:[\w.~-]*/)*"
)
"""What may stand before a program in a shell, and the path of a program; of the values of `NAMES` is asked apart."""

_READ_FIRST: Final = re.compile(
    r"\beval\s|\bBASH_ENV=|(?:\bsource|(?:^|[;&|(){!`\n]|\s-[A-Za-z]*c\s"
    r"|\b(?:builtin|command|do|elif|else|if|then|time|until|while)\s)[ \t]*(?:[A-Za-z_]\w*=\S{0,200}[ \t]+){0,9}\.)\s+"
    r"(?!(?:\S*/)?(?:(?:local_)?setup\.[a-z]+|\.bashrc|\.profile|activate)(?:[\s;&|]|$))"
)
"""What brings variables into a shell that a command line does not say. Files of ROS 2 set none of security, and what a
shell always reads is the robot's.
"""
_NAMING: Final = re.compile(r"\b(?:declare|export|local|typeset|unset)\b")
"""Behind which the name of a variable may be worked out: `unset ${!ROS_*}`, `unset ROS_SECURITY_{ENABLE,STRATEGY}`."""
_WORKED_OUT: Final = r"\s\w*[$`{]"

_CLEAN: Final = re.compile(
    r"\benv\s+(?:(?:-[0v]*[uC]|--unset|--chdir)\s+\S+\s+|-(?![0v]*[uC]\s|-unset\s|-chdir\s)\S+\s+){0,9}?"
    r"(?:(?:-[0v]*S|--split-string)[=\s]*)?(?:-[0v]*i\S*|-|--ignore-e[a-z]*)\s"
    r"|\bexec\s+(?:-a\s+\S+\s+)?-[al]*c[al]*\s"
)
"""What takes back all, env or a shell: options of one letter may stand together, and long ones may be cut short."""


def replaced(
    values: Iterable[tuple[Text, Text]],
    *,
    line: int,
    conditions: tuple[Condition | Comparison, ...],
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


def starts_node(command: str) -> bool:
    """Whether what is run says that it is of ROS 2."""
    return _NODE.search(command) is not None


def set_by_command(command: str) -> dict[str, str | Unknown]:
    """The values that a command line itself gives to `NAMES`, in any of its words: `env NAME=VALUE`, or a shell's."""
    plain = _unquoted(command)
    found: dict[str, str | Unknown] = dict.fromkeys(NAMES, "") if _CLEAN.search(plain) else {}
    taken_back = _taken_back(plain)
    another = Unknown(reason=f"{shown(command)}, which starts it as somebody else or elsewhere")
    if taken_back:
        found |= _unknown(another)
    for name in NAMES:
        values = set(re.findall(rf"(?<![A-Za-z0-9_]){name}=([^\s;&|]*)", plain[taken_back:]))
        if values:
            value = values.pop()
            told = not values and not re.search(r"[$`]", value)
            found[name] = value if told else Unknown(reason=f"{shown(command)}, which sets {name}")
        elif _behind(_UNSET, name, plain):
            found[name] = ""
        elif re.search(rf"\b{name}\+=", plain) or _behind(_TOUCHED, rf"(?<![$A-Za-z0-9_{{]){name}\b", plain):
            found[name] = Unknown(reason=f"{shown(command)}, which names {name}")
    if taken_back and not isinstance(found[ENABLE], Unknown):
        found.setdefault(STRATEGY, another)
    return found


def changed_before(command: str) -> dict[str, str | Unknown]:
    """What is not known of a process of ROS 2, since a program before `ros2` may change it, or what a shell reads or
    works out.
    """
    plain = _unquoted(command)
    changed = _READ_FIRST.search(plain) is not None or _behind(_NAMING, _WORKED_OUT, plain)
    for part in _END.split(plain):
        started = _ROS2.search(part)
        words = [*part[: started.start()].split(), started[1]] if started else []
        told = ["nice" if _SHELLS.fullmatch(word) else word for word in words if not _HARMLESS.fullmatch(word)]
        changed = changed or any(isinstance(value, Unknown) for value in set_by_prefix(" ".join(told)).values())
    return _unknown(Unknown(reason=f"{shown(command)}, in which something may change it first")) if changed else {}


def _unquoted(command: str) -> str:
    return re.sub(r"""["'\\]""", "", command)


def _taken_back(command: str) -> int:
    """Behind which character values count, where sudo or the like keeps none of those before it, and a node is started
    by it or by something behind it; else 0.
    """
    nodes = [each.start() for each in _NODE.finditer(command)]
    at = taken_back = 0
    for part in _END.split(command):
        found = list(_AS_ANOTHER.finditer(part))
        for another, following in zip(found, [*(each.start() for each in found[1:]), len(part)], strict=False):
            if not nodes or at + another.end() > nodes[-1]:
                break
            own = nodes[bisect_left(nodes, at + another.end())] - at
            if another[1] or not _KEPT.search(part, another.end(), min(own, following)):
                taken_back = at + another.end()
        at += len(part) + 1
    return taken_back


def _behind(word: re.Pattern[str], name: str, command: str) -> bool:
    """Whether the name stands behind such a word in the same command; what is behind the first is looked at once."""
    at = 0
    while match := word.search(command, at):
        end = _END.search(command, match.end())
        at = len(command) if end is None else end.start()
        if re.compile(name).search(command, match.end(), at):
            return True
    return False


def touched(text: str) -> tuple[str, ...]:
    """The variables of `NAMES` that a text is the name of, or the first part of, as `ROS_` and `ROS_SECURITY_*`; or
    that it sets or takes back as part of a command.
    """
    if text in NAMES:
        return (text,)
    begun = _BEGUN.match(text)
    return tuple(name for name in NAMES if begun and name.startswith(begun[1])) or tuple(set_by_command(f"{text} "))


def is_itself(name: str, default: str | None) -> bool:
    """Whether a variable that is set to what it is already, or to `default`, stays what it is to ROS 2.

    Security that is not set is the worst that there is, and domain 0 is the one where none is set.
    """
    return name in SECURE or default in (None, "", "0" if name == DOMAIN else "")


def started_with(action: StartProcess, scope: Scope, source: Source) -> dict[str, str | Unknown]:
    """The values of those of `NAMES` that the launch file sets for a process; the rest come from its own start."""
    found = {name: scope.environment[name] for name in NAMES if name in scope.environment}
    if action.earlier:
        found = dict.fromkeys(found, Unknown(reason="an earlier environment"))
    if action.clean:
        found = dict.fromkeys(NAMES, "")
    for name, value in action.environment:
        variable = scope.known(name, source)
        if isinstance(variable, Unknown):
            found |= dict.fromkeys(NAMES, variable)
        elif variable in NAMES and is_lookup(variable, value):
            found.pop(variable, None)
            found |= {variable: scope.environment[variable]} if variable in scope.environment else {}
        elif variable in NAMES:
            found[variable] = scope.known(value, source)
    prefix = scope.arguments.get(PREFIX, "") if action.prefix is None else scope.known(action.prefix, source)
    before = _unknown(prefix) if isinstance(prefix, Unknown) else set_by_prefix(prefix)
    if action.prefix is None and before and scope.arguments.get(FILTER):
        before = dict.fromkeys(before, Unknown(reason=f"{FILTER}, which says for which programs {PREFIX} counts"))
    return {**found, **before}


def is_lookup(name: str, value: Text) -> bool:
    """Whether a variable is set to itself."""
    match value:
        case (Reference(variable=Variable.ENVIRONMENT, name=(str(looked_up),), default=default),):
            told = None if default is None else "".join(each if isinstance(each, str) else "$" for each in default)
            return looked_up == name and is_itself(name, told)
    return False


def set_by_prefix(prefix: str) -> dict[str, str | Unknown]:
    """What stands before the program, such as `env NAME=VALUE`, sets."""
    may_change = Unknown(reason=f"{shown(prefix)}, which stands before the program and may change its environment")
    try:
        words = shlex.split(prefix)
    except ValueError:
        return _unknown(may_change)
    if len(words) == 3 and words[0] in ("sh", "bash") and words[1] == "-c" and _LATER.fullmatch(words[2]):
        return {}
    words = words[2:] if words[:2] == ["sudo", "-E"] else words  # which keeps the environment, or starts nothing
    found: dict[str, str | Unknown] = {}
    program = ""
    for before, word in zip(["", *words], words, strict=False):
        called = _INSTALLED.sub("", word)
        name, is_set, value = word.partition("=")
        if called == "env" or _KEEPERS.fullmatch(called):
            program = called
        elif program == "env" and is_set and not name.startswith("-"):
            if name in NAMES:
                found[name] = value
        elif not _is_harmless(word, before, program) or any(each in word for each in NAMES):
            return {**found, **_unknown(may_change)}
    return found


def _is_harmless(word: str, before: str, program: str) -> bool:
    """Whether a word behind the program, one of `_KEEPERS`, changes no variables."""
    if program in _DEBUGGERS:
        return _DEBUGGING.fullmatch(word) is not None
    titled = program == "xterm" and before in _TITLED
    return program not in ("", "env") and (titled or _OPTION.fullmatch(word) is not None)


def _unknown(reason: Unknown) -> dict[str, str | Unknown]:
    """Whether there is security at all, and in which enclave, cannot be told."""
    return {OVERRIDE: reason, ENABLE: reason}
