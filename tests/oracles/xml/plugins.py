"""The vendors' access control plugins as oracles of whole documents: verified, parsed, chosen and decided by them."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from cryptography import x509
from msgspec import Struct, field

from tests.keystore.builder import END, GOVERNANCE, START, Signed, authority, certificate, signed_document
from tests.keystore.documents import PERMISSIONS
from tests.oracles.xml.ours import DocumentKind
from tests.oracles.xml.parsers import compiled

_PASSING = re.compile(r" file://\S+| \(\./src.*|: [0-9A-F]{16}:error.*", re.DOTALL)
"""Of a message: where the file was, where the source stands, addresses in OpenSSL's errors."""


class Answer(Struct, frozen=True):
    """`refused`: the plugin's code and message, or "crash"; None where the participant starts.

    `topics`: by topic, what it may do: see cyclone_access_control.c; Fast DDS answers alike.
    """

    refused: str | None
    topics: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.refused is not None:
            return self.refused
        return ", ".join(f"{topic} {flags}" for topic, flags in self.topics.items())


class Plugin:
    """One enclave, /talker, and the plugin in a process that is started again when a document crashes it.

    The process gets the tests' environment changed by `environment`; the certificates are good from `start` to `end`.
    """

    def __init__(
        self,
        *command: str | Path,
        environment: Mapping[str, str] | None = None,
        start: datetime = START,
        end: datetime = END,
    ) -> None:
        self._command = command
        self._environment = os.environ | (environment or {})
        self._process: subprocess.Popen[bytes] | None = None
        self._lifetime = {"start": start, "end": end}
        self._authority: Signed = authority("permissions CA", **self._lifetime)
        self.take("/talker")
        self._plain = {DocumentKind.GOVERNANCE: self.sign(GOVERNANCE), DocumentKind.PERMISSIONS: self.sign(PERMISSIONS)}

    def take(self, subject: str | x509.Name) -> Signed:
        """Take another identity, which is given back."""
        identity = certificate(subject, self._authority, **self._lifetime)
        self._identity = identity.pem + identity.key_pem
        return identity

    def sign(self, document: bytes) -> bytes:
        """The signed message, as sros2 makes it."""
        return signed_document(document, self._authority)

    def ask(self, message: bytes, kind: DocumentKind, *topics: str) -> Answer:
        """What becomes of the enclave in domain 0 with this document and a plain one of the other kind."""
        both = self._plain | {kind: message}
        documents = both[DocumentKind.GOVERNANCE], both[DocumentKind.PERMISSIONS]
        return self._answer(self._authority.pem, self._identity, *documents, b"0", "\n".join(topics).encode())

    def ask_enclave(self, enclave: Path) -> Answer:
        """What becomes of a keystore's enclave in domain 0 (Cyclone DDS alone: its plugin does not look at the key)."""
        names = ("permissions_ca.cert.pem", "cert.pem", "governance.p7s", "permissions.p7s")
        return self._answer(*((enclave / name).read_bytes() for name in names), b"0", b"rt/chatter")

    def _answer(self, *fields: bytes) -> Answer:
        process = self._running()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"".join(len(each).to_bytes(4, "big") + each for each in fields))
        process.stdin.flush()
        header = process.stdout.read(4)
        if len(header) < 4:
            self.close()
            assert process.returncode in (-11, -6), f"the plugin ended with {process.returncode} on {fields[2:4]!r}"
            return Answer("crash")
        strings = process.stdout.read(int.from_bytes(header, "big")).decode("utf-8", "replace").split("\0")[:-1]
        if strings[0] == "R":
            return Answer(f"{strings[1]}: {_PASSING.sub('', strings[2])}")
        return Answer(None, dict(zip(strings[4::3], strings[5::3], strict=True)))

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(
                self._command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=self._environment
            )
        return self._process

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.communicate(timeout=10)
            self._process = None


@contextmanager
def both(find: Callable[[str], str], directory: Path) -> Iterator[dict[str, Plugin]]:
    """By vendor; without compiler, header or library the test skips, in CI it fails."""
    files = directory / "files"
    files.mkdir()
    cyclone = compiled(find("cc"), "cyclone_access_control.c", directory, "-lddsc", "-ldl")
    fastdds = compiled(find("c++"), "fastdds_access_control.cpp", directory, "-lfastrtps", "-lfastcdr")
    plugins = {"cyclone": Plugin(cyclone), "fastdds": Plugin(fastdds, files)}
    yield plugins
    for plugin in plugins.values():
        plugin.close()
