"""What somebody can make with a key: identities where it is an authority's, rights where it signs permissions.

The holder becomes enclaves of a system like any other, so what peers accept decides what they can do. It has new
certificates by every authority with the key, for every subject that a grant names. Permissions cross the network in
clear and are bound to a name, not to a key (DDS-Security 1.1, 9.4.1.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.model.blast_radius import NOTHING, BlastRadius, Radii
from keystore_audit.model.formal.system import CertificateAtom, Participant, System
from keystore_audit.model.subjects.told import grants_naming

MAX_SUBJECTS: Final = 5_000
"""Identities that are made for the holder of an authority's key: half a minute."""

HOLDER: Final = "whoever holds the key"
"""The label of the enclaves that are added."""


def authorities(system: System, key: int) -> frozenset[int]:
    """Certificates with the key that can vouch for identities in some trust domain."""
    trusted = {number for trust_domain in system.trust_domains for number in trust_domain.identity_ca}
    return frozenset(n for n in trusted if system.certificates[n].key == key and system.certificates[n].authority)


def holding(system: System, key: int) -> System:
    """The system with the holder of the key in it: as every identity that it has, and as every one that it can make.

    The enclaves after those of `system` are the holder's, as are those of `system` that have the key. Raises
    errors.BudgetExceeded where grants name too many subjects.
    """
    known = {enclave.identity for enclave in system.enclaves}
    held = (n for n, certificate in enumerate(system.certificates) if certificate.key == key and n not in known)
    issuers = authorities(system, key)
    return _added(system, key, held, [(issuers, named) for named in _subjects(system)] if issuers else [])


def holding_both(system: System, key: int) -> System:
    """The same for somebody who also holds the key of an enclave, whichever it is: its identity with this key."""
    identities = sorted({enclave.identity for enclave in system.enclaves if enclave.identity is not None})
    named = ((each, (n for n, grant in enumerate(system.grants) if each in grant.names)) for each in identities)
    made = [(system.certificates[each].issuers, frozenset(grants)) for each, grants in named]
    return _added(holding(system, key), key, (), made)


def _subjects(system: System) -> Iterable[frozenset[int]]:
    """Which grants name a subject, for every subject that some grant names, and for one that none does.

    Those of certificates here, and those that grants tell. To Cyclone DDS a grant names who is here where its subject
    begins with theirs. Whoever has just that subject may be named by fewer grants.
    """
    by_certificate: dict[int, set[int]] = {}
    found = {frozenset[int]()}
    texts: dict[str, None] = {}
    for number, grant in enumerate(system.grants):
        for certificate in grant.names:
            by_certificate.setdefault(certificate, set()).add(number)
        if grant.subject:
            texts[grant.subject] = None
        elif not grant.names:
            found.add(frozenset({number}))
    found.update(frozenset(grants) for grants in by_certificate.values())
    count = max(len(found), len(texts))
    if count <= MAX_SUBJECTS:
        found.update(grants for sets in grants_naming(system, texts).values() for grants in sets)
        count = len(found)
    if count > MAX_SUBJECTS:
        raise BudgetExceeded(
            f"{count} subjects that grants name are more identities than can be tried (limit {MAX_SUBJECTS})."
        )
    return sorted(found, key=sorted)


def radius(system: System, left_out: int, held: System, key: int) -> BlastRadius:
    """The blast radius of the key, whose holder is in `held` as `holding` or `holding_both` makes it of `system`.

    `left_out`: channels (bit set) that no flow takes.
    """
    mine = [number for number in range(len(held.enclaves)) if held.key_of(number) == key]
    if not mine:
        return NOTHING
    radii = Radii(held, left_out)
    found = radii.of(mine[0])
    known = range(len(system.certificates))
    made = (number for number in mine if held.enclaves[number].identity not in known)
    everybody = authorities(system, key) and any(radii.authenticated(number) for number in made)
    posed = {enclave.label for enclave in system.enclaves} if everybody else found.passes_for - {HOLDER}
    if not everybody and mine[0] < len(system.enclaves):
        posed = posed | {system.enclaves[mine[0]].label}
    return replace(
        found,
        passes_for=frozenset(posed),
        reached_alone=found.reached_alone - {HOLDER},
        reached=found.reached - {HOLDER},
    )


def radius_of_enclave(system: System, left_out: int, path: str) -> BlastRadius:
    """The blast radius of the key of the enclave, which is not said to pass for itself; NOTHING where there is none."""
    number = next((n for n, enclave in enumerate(system.enclaves) if enclave.label == path), None)
    if number is None:
        return NOTHING
    key = system.key_of(number)
    if system.enclaves[number].opaque or key is None:
        return Radii(system, left_out).of(number)
    found = radius(system, left_out, holding(system, key), key)
    return replace(
        found,
        passes_for=found.passes_for - {path},
        reached=found.reached - {path},
        reached_alone=found.reached_alone - {path},
    )


def _added(
    system: System, key: int, held: Iterable[int], made: Sequence[tuple[frozenset[int], frozenset[int]]]
) -> System:
    """With enclaves of the key's holder, in whatever trust domain: their own verdicts matter to nobody.

    `held`: certificates that are their identities. `made`: new ones with the key, always in force, by who issued each
    and the grants that name its subject.
    """
    first = len(system.certificates)
    numbers = [*held, *range(first, first + len(made))] if system.trust_domains else ()
    naming = gathered((grant, first + n) for n, (_issuers, grants) in enumerate(made) for grant in grants)
    certificates = (
        CertificateAtom(
            label=HOLDER,
            location=Location(path=""),
            issuers=issuers,
            authority=False,
            fit_to_sign=True,
            key=key,
            not_before=0,
            not_after=len(system.instants) - 1,
        )
        for issuers, _grants in made
    )
    enclaves = (
        Participant(
            label=HOLDER, location=Location(path=""), trust_domain=0, identity=identity, permissions=frozenset()
        )
        for identity in numbers
    )
    grants = (
        replace(grant, names=grant.names.union(naming[number])) if number in naming else grant
        for number, grant in enumerate(system.grants)
    )
    return replace(
        system,
        certificates=(*system.certificates, *certificates),
        enclaves=(*system.enclaves, *enclaves),
        grants=tuple(grants),
    )
