"""What is set while a launch file is followed: arguments, environment, namespace, and texts in them."""

from __future__ import annotations

from typing import Final

from msgspec import Struct

from keystore_audit.intent.environment import DOMAIN, ENABLE, KEYSTORE, OVERRIDE, RMW, STRATEGY
from keystore_audit.intent.launch_elements import MAX_TEXT, Element, Part, Text, Unknown
from keystore_audit.intent.ros_names import ROOT, joined
from keystore_audit.intent.source import shown

NAMES: Final[tuple[str, ...]] = (OVERRIDE, ENABLE, STRATEGY, KEYSTORE, DOMAIN, RMW)
"""What rcl and rmw read before they take an enclave (rcl's `security.c`, `domain_id.c`, rmw_implementation)."""

_TRUE: Final = frozenset({"true", "1"})
_FALSE: Final = frozenset({"false", "0"})


class Scope(Struct, kw_only=True):
    """All that is set at one point. An Unknown stands where something is set and cannot be told.

    `remaps`: names that are remapped for all nodes; `environment` may hold other variables than `NAMES`, too.
    """

    arguments: dict[str, str | Unknown]
    environment: dict[str, str | Unknown] = {}
    namespace: str | Unknown = ROOT
    remaps: tuple[str, ...] = ()

    def copy(self) -> Scope:
        """The same, to be changed apart."""
        return Scope(
            arguments=dict(self.arguments),
            environment=dict(self.environment),
            namespace=self.namespace,
            remaps=self.remaps,
        )

    def doubt(self, other: Scope, reason: Unknown) -> None:
        """Take in what may have become of this scope, `other`: what differs cannot be told any longer."""
        for mine, theirs in ((self.arguments, other.arguments), (self.environment, other.environment)):
            for name in {*mine, *theirs}:
                if mine.get(name) != theirs.get(name):
                    mine[name] = reason
        if self.namespace != other.namespace:
            self.namespace = reason
        self.remaps = other.remaps

    def known(self, text: Text) -> str | Unknown:
        """Work out the text, or say why not."""
        whole = ""
        for part in text:
            piece = self._piece(part)
            if isinstance(piece, Unknown):
                return piece
            whole += piece
            if len(whole) > MAX_TEXT:
                return Unknown(reason=f"a text of more than {MAX_TEXT} characters")
        return whole

    def _piece(self, part: Part) -> str | Unknown:
        if isinstance(part, (str, Unknown)):
            return part
        if part.environment:
            # What the file sets is known; this machine's environment says nothing about the robot's.
            return self.environment.get(part.name, Unknown(reason=f"the environment variable {shown(part.name)}"))
        unset = Unknown(reason=f"the argument {shown(part.name)}, which nothing sets")
        return self.arguments.get(part.name, unset if part.default is None else part.default)

    def shows(self, text: Text) -> str:
        """The text, with `$` for what cannot be told."""
        pieces = map(self._piece, text)
        return "".join(piece if isinstance(piece, str) else "$" for piece in pieces)

    def holds(self, element: Element) -> bool | Unknown:
        """Whether the conditions of the element hold, as far as it can be told."""
        doubt: Unknown | None = None
        for word, wanted in (("if", _TRUE), ("unless", _FALSE)):
            text = self.known(element.attributes.get(word, ("true" if word == "if" else "false",)))
            told = text.strip().lower() if isinstance(text, str) else ""
            if isinstance(text, Unknown):
                doubt = doubt or text
            elif told not in _TRUE | _FALSE:
                doubt = doubt or Unknown(reason=f"{shown(text)}, which is neither true nor false")
            elif told not in wanted:
                return False
        return True if doubt is None else doubt

    def below(self, element: Element) -> str | Unknown:
        """The namespace that the element says: below that of the scope unless it begins with `/`."""
        text = self.known(element.attributes.get("namespace", ()))
        if isinstance(text, Unknown):
            return text
        path = text.rstrip("/")
        if text.startswith("/"):
            return path or ROOT
        return self.namespace if isinstance(self.namespace, Unknown) or not path else joined(self.namespace, path)
