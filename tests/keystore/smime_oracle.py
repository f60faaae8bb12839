"""OpenSSL itself as the oracle of signed documents: `oracle/smime_oracle.c`, compiled and asked in one process."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.trust import Verdict, document_verdict
from tests.conftest import IN_CI

_SOURCE = Path(__file__).parent / "oracle" / "smime_oracle.c"


@dataclass(frozen=True)
class Oracle:
    """What a DDS implementation that trusts one certificate does with a message."""

    process: subprocess.Popen[str]
    message: Path

    def content(self, data: bytes) -> str | None:
        """SHA-256 of the content that is accepted; None if the message is refused."""
        self.message.write_bytes(data)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{self.message}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        assert answer, f"the oracle died on {data!r}"
        assert answer[0] in {"ok", "no"}, f"accepted from a file or from memory alone: {data!r}"
        return answer[1] if answer[0] == "ok" else None


@contextmanager
def running(find: Callable[[str], str], directory: Path, authority: bytes) -> Iterator[Oracle]:
    """Compile the oracle and keep it running for the permissions CA file `authority`."""
    program, trusted = directory / "smime_oracle", directory / "trusted.pem"
    command = [find("cc"), "-O1", "-Wall", "-Wextra", "-Werror", "-o", program, _SOURCE, "-lcrypto"]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    if compiled.returncode != 0:
        missing = f"the S/MIME oracle does not compile (libssl-dev?): {compiled.stderr[:400]}"
        if IN_CI:
            pytest.fail(missing)
        pytest.skip(missing)
    trusted.write_bytes(authority)
    with subprocess.Popen(
        [program, trusted], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as process:
        yield Oracle(process, directory / "message")
        assert process.stdin is not None
        process.stdin.close()


def disagreement(document: SignedDocument, authority: CertificateFile, accepted: str | None) -> str | None:
    """Why our verdict contradicts the oracle's; None where it does not. Unknown never does: the gate is then shut.

    Accepted has to mean accepted with the same bytes, refused has to mean refused: a robot that grants what we call
    denied is as bad as the opposite.
    """
    verdict = document_verdict(document, authority, pins_signer=True)
    if verdict is Verdict.ACCEPTED:
        assert document.content is not None
        if accepted is None:
            return "we accept, OpenSSL refuses"
        if hashlib.sha256(document.content).hexdigest() != accepted:
            return "we read other bytes than OpenSSL"
    elif verdict is Verdict.REFUSED and accepted is not None:
        return f"we refuse, OpenSSL accepts: {[defect.kind.value for defect in document.defects]}"
    return None
