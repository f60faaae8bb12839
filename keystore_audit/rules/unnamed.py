"""Identities that no grant of the document that they carry names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.profiles import VARIANTS, Profile, SubjectComparison
from keystore_audit.model.subject import matching, same_meaning
from keystore_audit.model.trust import Verdict
from keystore_audit.rules.acceptance import ROWS, verdict
from keystore_audit.rules.subjects import PermissionsUse


def unnamed(use: PermissionsUse, named: Sequence[str]) -> Iterator[tuple[Enclave, Certificate, list[Profile]]]:
    """Enclaves whose identity has none of these names to the letter, each with the variants that take one for it.

    Left out is who does not take the document, and whose name is meant and only written otherwise for some.
    """
    lacking = [
        (enclave, enclave.identity)
        for enclave in use.enclaves
        if enclave.identity is not None and enclave.identity.subject not in named and not _refused_by(use, enclave)
    ]
    firsts = [first for _enclave, first in lacking]
    tables = {each: matching(named, firsts, each) for each in SubjectComparison} if firsts else {}
    for number, (enclave, first) in enumerate(lacking):
        naming = {each: [text for text in named if number in table[text]] for each, table in tables.items()}
        if not any(same_meaning(text, first) for texts in naming.values() for text in texts):
            yield enclave, first, [profile for profile in VARIANTS.values() if naming[profile.trust.subjects]]


def _refused_by(use: PermissionsUse, enclave: Enclave) -> bool:
    """Whether the enclave takes the document under no known implementation."""
    return all(verdict(use.signed, enclave, trust) is Verdict.REFUSED for trust in ROWS)
