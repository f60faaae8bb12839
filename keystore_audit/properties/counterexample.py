"""A counterexample in the user's names."""

from __future__ import annotations

from msgspec import Struct


class Step(Struct, frozen=True, kw_only=True):
    """One thing that makes the counterexample possible, and the line that says so.

    `channel`: what is meant, in words (`domain 0, topic rt/chatter`); `witness`: a concrete DDS topic name
    (or enclave, certificate or document) of it. `path` and `line` as in `findings.Location`; `expression`: the
    one there that takes in the witness, where it is not the witness itself.
    """

    enclave: str | None
    channel: str | None
    witness: str
    path: str | None
    line: int | None
    expression: str = ""


class Counterexample(Struct, frozen=True, kw_only=True):
    """`text` is one sentence for people; untrusted names in it are not escaped yet."""

    text: str
    steps: tuple[Step, ...]
