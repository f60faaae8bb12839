"""What is set while a launch file is followed: arguments, environment, namespace and remappings, and texts in them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from msgspec import Struct, field

from keystore_audit.intent.launch_actions import MAX_TEXT, Condition, Reference, Remap, Text, Unknown, Variable
from keystore_audit.intent.ros_names import ROOT, joined
from keystore_audit.intent.source import Source, shown

MAX_DEPTH: Final = 64
"""Defaults within defaults."""

_TRUE: Final = frozenset({"true", "1"})
_FALSE: Final = frozenset({"false", "0"})


class Unresolvable(Exception):
    """A text that cannot be worked out; the message says what it depends on, words."""


class GlobalRemap(Struct, kw_only=True):
    """A remapping for all nodes of a scope; `users`: nodes that started under it, as (enclave, node, name used)."""

    line: int
    file: Source
    source: str
    target: str
    users: list[tuple[str, str, str]] = field(default_factory=list)


class Scope(Struct, kw_only=True):
    """All that is set at one point. An Unknown stands where something is set and cannot be told."""

    arguments: dict[str, str | Unknown]
    environment: dict[str, str | Unknown] = field(default_factory=dict)
    namespace: str | Unknown = ROOT
    remaps: list[GlobalRemap] = field(default_factory=list)

    def copy(self) -> Scope:
        """The same, to be changed apart."""
        return Scope(
            arguments=dict(self.arguments),
            environment=dict(self.environment),
            namespace=self.namespace,
            remaps=list(self.remaps),
        )

    def doubt(self, other: Scope, reason: str) -> None:
        """Take in what may have become of this scope, `other`: what differs cannot be told any longer."""
        for mine, theirs in ((self.arguments, other.arguments), (self.environment, other.environment)):
            for name in {*mine, *theirs}:
                if mine.get(name) != theirs.get(name):
                    mine[name] = Unknown(reason=reason)
        if self.namespace != other.namespace:
            self.namespace = Unknown(reason=reason)
        self.remaps = list(other.remaps)

    def text(self, text: Text, source: Source, depth: int = 0) -> str:
        """Work out `text`, which stands in `source`. Raises Unresolvable."""
        if depth > MAX_DEPTH:
            raise Unresolvable(f"substitutions more than {MAX_DEPTH} deep")
        pieces: list[str] = []
        length = 0
        for part in text:
            if isinstance(part, Unknown):
                raise Unresolvable(part.reason)
            piece = part if isinstance(part, str) else self._reference(part, source, depth)
            pieces.append(piece)
            length += len(piece)
            if length > MAX_TEXT:
                raise Unresolvable(f"a text of more than {MAX_TEXT} characters")
        return "".join(pieces)

    def known(self, text: Text, source: Source) -> str | Unknown:
        """Work out `text`, or say why not."""
        try:
            return self.text(text, source)
        except Unresolvable as error:
            return Unknown(reason=str(error))

    def remapped(self, remap: Remap, source: Source) -> tuple[str, str] | Unknown:
        """The names that a remapping is from and to, or why one of them cannot be told."""
        origin, target = self.known(remap.source, source), self.known(remap.target, source)
        if isinstance(target, Unknown):
            return target
        return origin if isinstance(origin, Unknown) else (origin, target)

    def _reference(self, reference: Reference, source: Source, depth: int) -> str:
        if reference.variable is Variable.DIRECTORY:
            return source.directory
        name = self.text(reference.name, source, depth + 1)
        if reference.variable is Variable.ENVIRONMENT:
            # What the file sets is known; this machine's environment says nothing about the robot's.
            value = self.environment.get(name, Unknown(reason=f"the environment variable {shown(name)}"))
        elif name in self.arguments:
            value = self.arguments[name]
        elif reference.default is not None:
            return self.text(reference.default, source, depth + 1)
        else:
            raise Unresolvable(f"the argument {shown(name)}, which nothing sets")
        if isinstance(value, Unknown):
            raise Unresolvable(value.reason)
        return value

    def holds(self, conditions: Iterable[Condition], source: Source) -> bool | Unknown:
        """Whether all conditions hold, as far as it can be told."""
        doubt: Unknown | None = None
        for condition in conditions:
            holds = self._holds(condition, source)
            if holds is False:
                return False
            if isinstance(holds, Unknown):
                doubt = doubt or holds
        return True if doubt is None else doubt

    def _holds(self, condition: Condition, source: Source) -> bool | Unknown:
        try:
            text = self.text(condition.text, source)
        except Unresolvable as error:
            return Unknown(reason=str(error))
        word = text.strip().lower()
        if word not in _TRUE | _FALSE:
            return Unknown(reason=f"{shown(text)}, which is neither true nor false")
        return (word in _TRUE) is not condition.negated

    def below(self, namespace: Text | None, source: Source) -> str | Unknown:
        """The namespace that `namespace` is here: below that of the scope unless it begins with `/`."""
        if namespace is None:
            return self.namespace
        text = self.known(namespace, source)
        if isinstance(text, Unknown):
            return text
        path = text.rstrip("/")
        if text.startswith("/"):
            return path or ROOT
        if isinstance(self.namespace, Unknown) or not path:
            return self.namespace
        return joined(self.namespace, path)
