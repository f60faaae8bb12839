"""Identities beside the enclaves: certificates that no enclave carries, with private keys that lie in the same tree.

Whoever has both is a participant, whatever folder they are in: a run time starts from any six files.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from keystore_audit.dataclass import dataclass
from keystore_audit.keystore.certificate import Certificate, read_certificates
from keystore_audit.keystore.files import File

MAX_BYTES: Final = 4 * 1024 * 1024
"""Of files with certificates outside enclaves that are parsed: 5,000 certificates, a quarter of a second."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrayIdentity:
    """A certificate that no enclave has as its own, and the place of the private key that belongs to it."""

    certificate: Certificate
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StrayIdentities:
    """Those of a keystore, by place. `unread`: files that were not parsed, beyond the limit."""

    found: tuple[StrayIdentity, ...] = ()
    unread: tuple[File, ...] = ()


def read_stray_identities(
    files: Iterable[File], keys: Mapping[str, str], known: Iterable[Certificate]
) -> StrayIdentities:
    """What the certificates in `files` and the private keys make.

    `files`: with content. `keys`: by the identity of the public half (`Certificate.key`), where the private one lies.
    `known`: certificates that enclaves have, which are no strays.
    """
    ours = {certificate.sha256 for certificate in known}
    found: dict[str, StrayIdentity] = {}
    unread: list[File] = []
    left = MAX_BYTES
    for file in files:
        left -= len(file.content or b"")
        if left < 0:
            unread.append(file.holding(None))
            continue
        for certificate in read_certificates(file).certificates:
            if certificate.key in keys and certificate.sha256 not in ours:
                found.setdefault(certificate.sha256, StrayIdentity(certificate=certificate, key=keys[certificate.key]))
    return StrayIdentities(found=tuple(found.values()), unread=tuple(unread))
