"""ROS arguments on a node's command line: its enclave, its names and its remappings.

Source: rcl's `arguments.c` and the ROS 2 design article "ROS Command Line Arguments": what stands between `--ros-args`
and `--` is ROS's, the last `--enclave` counts, and of remappings the first that matches.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.intent.launch_actions import Unknown

Word = str | Unknown
"""One word of a command line, or why it cannot be told."""

_WITH_VALUE: Final[Mapping[str, str]] = {
    "-r": "remap",
    "--remap": "remap",
    "-e": "enclave",
    "--enclave": "enclave",
    "-p": "",
    "--param": "",
    "--params-file": "",
    "--log-level": "",
    "--log-config-file": "",
    "--log-file-name": "",
}
_SCHEMES: Final = ("rostopic://", "rosservice://")


class Rule(Struct, frozen=True, kw_only=True):
    """A remapping as written, `source:=target`; `node`: the only node that it is for, "" for all of the process."""

    node: str
    source: str
    target: str


class RosArguments(Struct, frozen=True, kw_only=True):
    """What the command line says to ROS. `enclave` None: nothing; an Unknown: something that cannot be told."""

    enclave: Word | None
    rules: tuple[Rule, ...]
    unknown: tuple[Unknown, ...]
    """Remappings that there may be."""


def read(arguments: Sequence[Word], ros_arguments: Sequence[Word]) -> RosArguments:
    """Read a command line: the node's own arguments, then those that launch puts behind `--ros-args`."""
    found = _Found()
    found.plain(arguments)
    found.ros(iter(ros_arguments))
    return RosArguments(enclave=found.enclave, rules=tuple(found.rules), unknown=tuple(found.unknown))


def rule(text: str) -> Rule | None:
    """Read one remapping; None if it is none."""
    source, sign, target = text.partition(":=")
    if not sign or not source or not target:
        return None
    node = ""
    if not source.startswith(_SCHEMES) and ":" in source:
        node, _, source = source.partition(":")
    for scheme in _SCHEMES:
        source = source.removeprefix(scheme)
        target = target.removeprefix(scheme)
    return Rule(node=node, source=source, target=target) if source and target else None


class _Found:
    def __init__(self) -> None:
        self.enclave: Word | None = None
        self.rules: list[Rule] = []
        self.unknown: list[Unknown] = []

    def plain(self, words: Iterable[Word]) -> None:
        """Words of the whole command line: a word that cannot be told may be `--ros-args` itself."""
        doubt: Unknown | None = None
        left = iter(words)
        for word in left:
            if isinstance(word, Unknown):
                doubt = word
            elif word == "--ros-args":
                self.ros(left)
                doubt = None
            elif doubt is not None and _WITH_VALUE.get(word):
                self._cannot_be_told(doubt)

    def ros(self, left: Iterable[Word]) -> None:
        """Words up to `--`, all ROS's."""
        words = iter(left)
        for word in words:
            if isinstance(word, Unknown):
                self._cannot_be_told(word)
            elif word == "--":
                return
            elif word in _WITH_VALUE:
                value = next(words, None)
                if value is not None:
                    self._option(_WITH_VALUE[word], value)

    def _option(self, meaning: str, value: Word) -> None:
        if meaning == "enclave":
            self.enclave = value
        elif meaning == "remap" and isinstance(value, Unknown):
            self.unknown.append(value)
        elif meaning == "remap" and isinstance(value, str):
            read = rule(value)
            if read is None:
                self.unknown.append(Unknown(reason=f"a remapping that is none ({value[:80]!r})"))
            else:
                self.rules.append(read)

    def _cannot_be_told(self, word: Unknown) -> None:
        self.enclave = word
        self.unknown.append(word)
