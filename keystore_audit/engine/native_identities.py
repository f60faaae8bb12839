"""The native engine about identities that serve two enclaves: by a key, or by a subject that a grant names.

One of two may be at large, no enclave but a certificate beside theirs: of an enclave's key, it is that enclave's too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations

from keystore_audit.assumptions import DOCUMENTS
from keystore_audit.model.formal.system import System
from keystore_audit.properties.property import Role, Witness


def shared_identities(system: System) -> Iterator[Witness]:
    """Pairs of enclaves with one identity key; an opaque enclave may be any other, even one that is not here."""
    subjects = _subjects(system) if any(enclave.at_large for enclave in system.enclaves) else {}
    for sharing in system.holders().values():
        for one, other in permutations(sharing, 2):
            at_large = system.enclaves[one].at_large, system.enclaves[other].at_large
            renewed = any(at_large) and subjects[one] == subjects[other]
            if not (all(at_large) or renewed):
                yield {Role.ENCLAVE: one, Role.OTHER: other}
    for one in range(len(system.enclaves)):
        if system.anybody(one):
            yield {Role.ENCLAVE: one, Role.OTHER: one}


def _subjects(system: System) -> dict[int, tuple[frozenset[int], Sequence[int]]]:
    """By enclave, who issued its certificate and which grants name it: equal where a certificate was renewed."""
    naming: dict[int, list[int]] = {}
    for number, grant in enumerate(system.grants):
        for certificate in grant.names:
            naming.setdefault(certificate, []).append(number)
    return {
        number: (system.certificates[enclave.identity].issuers, naming.get(enclave.identity, []))
        for number, enclave in enumerate(system.enclaves)
        if enclave.identity is not None
    }


def shared_subjects(system: System) -> Iterator[Witness]:
    """Pairs of enclaves that one grant names; an opaque enclave may have any subject, a document any grant."""
    governances = {realm.governance for realm in system.realms}
    opaque = (number for number, document in enumerate(system.documents) if document.opaque)
    if any(number not in governances for number in opaque) or not system.assumed >= DOCUMENTS:
        for one, other in permutations(range(len(system.enclaves)), 2):
            yield {Role.ENCLAVE: one, Role.OTHER: other}
    by_certificate: dict[int, list[int]] = {}
    for enclave, atom in enumerate(system.enclaves):
        if system.anybody(enclave):
            yield {Role.ENCLAVE: enclave, Role.OTHER: enclave}
        elif atom.identity is not None:
            by_certificate.setdefault(atom.identity, []).append(enclave)
    holders = system.holders()
    for names in dict.fromkeys(grant.names for grant in system.grants):
        named = [enclave for certificate in sorted(names) for enclave in by_certificate.get(certificate, ())]
        for one, other in permutations(named, 2):
            if _serve_two(system, holders, one, other):
                yield {Role.ENCLAVE: one, Role.OTHER: other}


def _serve_two(system: System, holders: Mapping[int, Sequence[int]], one: int, other: int) -> bool:
    """Whether two enclaves have these identities: one at large is that of each enclave that has its key."""
    first, second = sorted((one, other), key=lambda enclave: system.enclaves[enclave].at_large)
    key = system.key_of(second)
    if not system.enclaves[second].at_large or key is None:
        return True
    sharing = [enclave for enclave in holders[key] if not system.enclaves[enclave].at_large]
    return not system.enclaves[first].at_large and any(enclave != first for enclave in sharing)
