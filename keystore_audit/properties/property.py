"""A property: a named question that both engines answer about a `model.formal.system.System`."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from msgspec import Struct


class Role(str, Enum):
    """What an atom does in a counterexample; the value is the variable's name in the Alloy assertion."""

    REALM = "realm"
    DOMAIN = "domain"
    ENCLAVE = "enclave"
    OTHER = "other"
    DOCUMENT = "document"
    CHANNEL = "channel"
    CERTIFICATE = "certificate"
    OTHER_CERTIFICATE = "other_certificate"
    OTHER_CHANNEL = "other_channel"
    PUBLISHER = "publisher"
    """An enclave, a certificate that no enclave has, or (none of both) anybody; a witness names what it is."""
    INSIDER = "insider"
    """Likewise."""


class Property(Struct, frozen=True, kw_only=True):
    """One question.

    `id` is also the name of its KA7 rule; `roles` the quantified variables of its assertion, outermost first;
    `attacker` who is meant to fail; `clause` what it rests on.
    """

    id: str
    statement: str
    attacker: str
    clause: str
    roles: tuple[Role, ...]

    @property
    def assertion(self) -> str:
        """The same name in `alloy/properties.als`."""
        return "".join(word.capitalize() for word in self.id.split("-"))


class Status(str, Enum):
    """The answer to a property. UNKNOWN never counts as HOLDS."""

    HOLDS = "holds"
    VIOLATED = "violated"
    UNKNOWN = "unknown"


Witness = Mapping[Role, int]
"""A counterexample: the index of the atom that plays each role."""


class Hop(Struct, frozen=True, kw_only=True):
    """One step of a flow: a participant hands a sample of the channel to the next.

    Enclaves by index; None: the outsider, or, at the first and last hop, that the flow begins or ends at the channel.
    `instant`: at which (index).
    """

    sender: int | None
    channel: int
    receiver: int | None
    instant: int


class Acts(Struct, frozen=True, kw_only=True):
    """What one of two runs does in a round (`model.formal.asked`).

    `sent`: by writer, which of two values it publishes, None for nothing. `taken`: the slots that forwards emptied.
    """

    sent: tuple[int | None, ...]
    taken: tuple[int, ...]


class Round(Struct, frozen=True, kw_only=True):
    """The same round of two runs that are compared."""

    one: Acts
    other: Acts


class Answer(Struct, frozen=True, kw_only=True):
    """One engine's answer about one system. `witnesses` is empty exactly where a property holds.

    An engine may give one witness or several, the most telling first; UNKNOWN only of determinism: within one reading
    everything else is decided. Of determinism: `rounds` are two runs that differ in the last one, in the behaviour of
    this index. Of a claim (`model.formal.asked`): `path` is a shortest flow that violates it, where its kind has
    flows, and `moment`, where the engine says so, the first at which it is violated: twice the index of an instant,
    plus one for the time between it and the next.
    """

    status: Status
    witnesses: tuple[Witness, ...] = ()
    path: tuple[Hop, ...] = ()
    moment: int | None = None
    rounds: tuple[Round, ...] = ()
    behaviour: int = 0
