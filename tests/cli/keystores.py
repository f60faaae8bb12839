"""Keystores with permissions of the test's choosing, and the program run in this process."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any
from unittest.mock import patch

from cryptography import x509

from keystore_audit.cli.program import run
from tests.keystore import documents
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave
from tests.keystore.documents import criterion

AT = "2026-11-21T12:00:00Z"
"""Within every sample's and every built document's validity."""

_DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<dds>
  <permissions>
    <grant name="g">
      <subject_name>CN={path}</subject_name>
      <validity><not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T00:00:00</not_after></validity>
{rules}
      <default>{default}</default>
    </grant>
  </permissions>
</dds>
"""


_GRANT = _DOCUMENT[_DOCUMENT.index("    <grant") : _DOCUMENT.index("  </permissions>")]


def grant_of(path: str, *rules: str, default: str = "DENY") -> str:
    """A grant in XML for an enclave."""
    return _GRANT.format(path=path, rules="\n".join(rules), default=default)


def document_of(*grants: str) -> bytes:
    """A permissions document of these grants."""
    return _DOCUMENT.replace(_GRANT, "".join(grants)).encode()


def rule(
    publish: tuple[str, ...] = (), subscribe: tuple[str, ...] = (), *, allow: bool = True, partition: str = ""
) -> str:
    """A rule of domain 0 in one line."""
    where = (partition,) if partition else ()
    listed = (("publish", publish), ("subscribe", subscribe))
    return documents.rule(*(criterion(way, *each, partitions=where) for way, each in listed if each), allow=allow)


def keystore(
    root: Path,
    enclaves: Mapping[str, tuple[str, ...]],
    *,
    governance: bytes = GOVERNANCE,
    default: str = "DENY",
    host: str | None = None,
) -> Path:
    """A keystore of two authorities whose enclaves have these rules."""
    documents = {path: document_of(grant_of(path, *rules, default=default)) for path, rules in enclaves.items()}
    return signed_keystore(root, documents, governance=governance, host=host)


def signed_keystore(
    root: Path, documents: Mapping[str, bytes], *, governance: bytes = GOVERNANCE, host: str | None = None
) -> Path:
    """A keystore of two authorities whose enclaves have these permissions, and certificates for a host."""
    names = ((x509.SubjectAlternativeName([x509.DNSName(host)]), False),) if host is not None else ()
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    for path, document in documents.items():
        own = certificate(path, identity, extensions=names)
        write_enclave(root / "enclaves" / path.strip("/"), own, document, identity, permissions, governance)
    return root


@contextmanager
def _caught(name: str) -> Iterator[Callable[[], str]]:
    """What is written to that standard stream."""
    written = io.BytesIO()
    stream, kept = io.TextIOWrapper(written, encoding="utf-8", write_through=True), getattr(sys, name)
    setattr(sys, name, stream)
    try:
        yield lambda: written.getvalue().decode()
    finally:
        setattr(sys, name, kept)


def answer(*args: str | Path) -> tuple[int, str]:
    """The exit code and what is written to standard output."""
    with _caught("stdout") as out:
        return run([str(arg) for arg in args]), out()


def run_at(folder: Path, *args: str, **environment: str) -> CompletedProcess[str]:
    """As a process started there, with these variables and without CI, is run; but it is this one."""
    kept = os.getcwd()
    os.chdir(folder)
    try:
        with patch.dict(os.environ, environment), _caught("stdout") as out, _caught("stderr") as err:
            if "CI" not in environment:
                os.environ.pop("CI", None)
            return CompletedProcess(args, run(list(args)), out(), err())
    finally:
        os.chdir(kept)


def properties(root: Path, settings: str, *options: str | Path) -> dict[str, dict[str, Any]]:
    """What the native engine says of each property in a keystore, by its id; these settings are put beside it."""
    file = root.parent / "keystore-audit.toml"
    file.write_text(settings, "utf-8")
    words = ("--engine", "native", "--at", AT, "--settings", file, "-f", "json", *options)
    return {each["id"]: each for each in json.loads(answer("audit", root, *words)[1])["properties"]}
