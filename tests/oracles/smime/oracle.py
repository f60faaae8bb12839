"""OpenSSL itself as the oracle of signed documents: `smime_oracle.c`, compiled and asked in one process."""

from __future__ import annotations

import os
import select
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from msgspec import Struct, field

from tests.oracles.xml.parsers import compiled

_SOURCE = Path(__file__).parent / "smime_oracle.c"

PATIENCE = 20
"""Seconds after which an answer is no longer awaited: a message of some kilobytes takes a millisecond."""


class Answer(Struct, frozen=True, kw_only=True):
    """The content that is accepted, None if the message is refused: by implementations that pin, by those that chain.

    `split`: the same message is read differently from a file (Fast DDS) and from memory (Cyclone DDS). The contents
    are then those from memory.
    """

    pinned: bytes | None
    chained: bytes | None
    split: bool


class Oracle(Struct):
    """What DDS implementations that trust one permissions CA file do with messages.

    `crashes`: messages at which OpenSSL died or did not come back; it was started anew, and they count as refused.
    """

    program: Path
    crashes: list[bytes] = field(default_factory=list)
    _trusted: bytes = b""
    _process: subprocess.Popen[bytes] | None = None
    _received: bytearray = field(default_factory=bytearray)

    def trust(self, authorities: bytes) -> None:
        """Take a permissions CA file (PEM) for the messages from here on."""
        if authorities != self._trusted:
            self._trusted = authorities
            if self._process is not None:
                self._send(b"T", authorities)

    def content(self, message: bytes) -> bytes | None:
        """The content that an implementation accepts which pins the signer; None if it refuses."""
        answer = self.ask(message)
        assert not answer.split, f"read differently from a file and from memory: {message!r}"
        return answer.pinned

    def ask(self, message: bytes) -> Answer:
        """What becomes of a message."""
        try:
            self._send(b"M", message)
            memory = self._verdict(), self._verdict()
            file = self._verdict(), self._verdict()
        except (EOFError, BrokenPipeError):
            self.crashes.append(message)
            self.stop()
            return Answer(pinned=None, chained=None, split=False)
        return Answer(pinned=memory[0], chained=memory[1], split=memory != file)

    def stop(self) -> None:
        """End the process; the next question starts another."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
            self._received.clear()

    def _send(self, kind: bytes, content: bytes) -> None:
        if self._process is None:
            self._process = subprocess.Popen([self.program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self._send(b"T", self._trusted)
        assert self._process.stdin is not None
        self._process.stdin.write((len(content) + 1).to_bytes(4, "big") + kind + content)
        self._process.stdin.flush()

    def _verdict(self) -> bytes | None:
        accepted = self._read(1) == b"\x01"
        content = self._read(int.from_bytes(self._read(4), "big"))
        return content if accepted else None

    def _read(self, size: int) -> bytes:
        assert self._process is not None
        assert self._process.stdout is not None
        stdout = self._process.stdout.fileno()
        while len(self._received) < size:
            if not select.select([stdout], [], [], PATIENCE)[0]:
                raise EOFError
            some = os.read(stdout, 1 << 16)
            if not some:
                raise EOFError
            self._received += some
        data = bytes(self._received[:size])
        del self._received[:size]
        return data


def compile_oracle(find: Callable[[str], str], directory: Path) -> Path:
    """Compile the program; where that fails the test is skipped, in CI it fails."""
    return compiled(find("cc"), _SOURCE, directory, "-lcrypto")


@contextmanager
def running(find: Callable[[str], str], directory: Path, authority: bytes = b"") -> Iterator[Oracle]:
    """Compile the oracle and keep it running; `authority` is the permissions CA file that it trusts at first."""
    oracle = Oracle(compile_oracle(find, directory))
    oracle.trust(authority)
    try:
        yield oracle
    finally:
        oracle.stop()
