"""Signed documents that no enclave carries, whatever they are called and wherever in the keystore they lie.

Peers take any validly signed document that is presented to them: an old `permissions.p7s.bak` still gives what it says.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import File
from keystore_audit.keystore.governance import GovernanceFile, read_governance
from keystore_audit.keystore.permissions import PermissionsFile, read_permissions
from keystore_audit.keystore.smime import Candidates

MAX_STRAYS: Final = 2_000
"""Distinct documents outside enclaves that are read, three seconds; beyond it one, unread, stands for the rest."""

_GOVERNANCE_ONLY: Final = b"domain_access_rules"
"""The element that every governance document has and no permissions document."""


class Stray(Struct, frozen=True, kw_only=True, eq=False):
    """A signed message that no enclave carries as its own; `document` is None where it could not be read."""

    file: File
    document: GovernanceFile | PermissionsFile | None

    @property
    def place(self) -> str:
        """Where it lies, relative to the keystore."""
        return self.file.place


def read_strays(messages: Iterable[File], carried: Collection[str], candidates: Candidates) -> Iterator[Stray]:
    """Read every message but those `carried` by enclaves; what OpenSSL takes for no message is left out.

    The mark of a message where OpenSSL reads none is one that could not be read (`message.concealed`).

    `messages`: files that may be one, each content once; without content, they were not read. `carried`: the SHA-256 of
    the documents of the enclaves, since a copy of one gives nothing more.
    """
    others = []
    for file in messages:
        if file.concealed:  # in what enclaves carry, too
            detail = f"{file.concealed}; anybody can make a document of it, and it was not read"
            yield Stray(file=replace(file, content=None, detail=detail), document=None)
        elif file.sha256 not in carried:
            others.append(file)
    yield from (Stray(file=file, document=None) for file in others if file.content is None)
    readable = [file for file in others if file.content is not None]
    if len(readable) > MAX_STRAYS:  # one that may say anything stands for all of them
        detail = f"{len(readable)} documents lie outside enclaves; from this on they were not read (limit {MAX_STRAYS})"
        yield Stray(file=replace(readable[MAX_STRAYS], content=None, detail=detail), document=None)
    for file in readable[:MAX_STRAYS]:
        document = _document(file, candidates)
        if not any(defect.kind is Kind.NOT_SMIME for defect in document.signed.defects):
            yield Stray(file=file, document=document)


def _document(file: File, candidates: Candidates) -> GovernanceFile | PermissionsFile:
    """Read a document as what it is. What has no meaning as either may be permissions, which give more."""
    if file.content is not None and _GOVERNANCE_ONLY in file.content:
        governance = read_governance(file, candidates)
        if governance.governance is not None:
            return governance
    return read_permissions(file, candidates)
