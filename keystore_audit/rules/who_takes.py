"""Which enclaves take identities of no enclave: who accepts that some do does not accept that more do."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from datetime import datetime
from typing import Final

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.participants.stray_identity import Takers
from keystore_audit.profiles import VARIANTS

MAX_PAIRS: Final = 100_000
"""Certificates and enclaves that may take them; beyond it nobody is asked: some seconds."""

_PROFILES: Final = tuple({profile.trust: profile for profile in VARIANTS.values()}.values())
"""Of those known that take the same identities, one each."""


class Taken:
    """Who takes `certificates` `at` an instant (aware UTC) or later."""

    def __init__(self, keystore: Keystore, certificates: Collection[Certificate], at: datetime) -> None:
        too_many = len(certificates) * len(keystore.enclaves) > MAX_PAIRS
        self._takers = None if too_many else Takers(keystore, at)
        self._trusted = "\n".join(sorted(map(_trusted, keystore.enclaves))) if too_many else ""

    def told(self, certificates: Collection[Certificate]) -> str:
        """Some of them, and which enclaves take them under which variants, as a part of a key.

        Where they are too many to ask, all that enclaves trust stands for it.
        """
        every = {each.sha256: each for each in certificates}
        parts = (" ".join([sha256, *self._by(every[sha256])]) for sha256 in sorted(every))
        return "\n".join([*parts, self._trusted])

    def _by(self, certificate: Certificate) -> Iterator[str]:
        if self._takers is not None:
            for profile in _PROFILES:
                yield profile.name
                yield from sorted(self._takers.of(certificate, (profile,)))


def _trusted(enclave: Enclave) -> str:
    files = (each.file.sha256 if each is not None else None for each in (enclave.identity_ca, enclave.crl))
    return " ".join([enclave.path, *(sha256 or "" for sha256 in files)])
