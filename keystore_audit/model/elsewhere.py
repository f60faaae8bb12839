"""Subjects that grants name and no enclave here has: whoever has such an identity may present the grant.

The keystore of one robot holds its own enclaves; its authorities vouch for those of others too, and peers take a
document from whoever has a subject that it names. So each such subject becomes a certificate that no enclave has. It
is there for claims of who alone may do something, and takes part in no flow: nobody knows what it forwards.
"""

from __future__ import annotations

from collections.abc import Iterable

from keystore_audit.dataclass import replace
from keystore_audit.findings import Location
from keystore_audit.model.system import CertificateAtom, GrantAtom, System

UNREAD = "somebody whom a document names that could not be read"
"""The subject that stands for all that are named there."""


def with_subjects_elsewhere(systems: Iterable[System]) -> tuple[System, ...]:
    """The systems, each with a certificate for every subject that its grants name and that is no enclave's here."""
    known: dict[object, tuple[GrantAtom, ...]] = {}
    return tuple(_with_subjects(system, known) for system in systems)


def _with_subjects(system: System, known: dict[object, tuple[GrantAtom, ...]]) -> System:
    """`known`: grants that systems have in common stay so, since decisions are worked out once for equal objects."""
    identities = {enclave.identity for enclave in system.enclaves} | {each.identity for each in system.left_out}
    here = frozenset(identity for identity in identities if identity is not None)
    named = {grant.subject for grant in system.grants if grant.names & here}
    places: dict[str, Location] = {}
    for grant in system.grants:
        if grant.subject not in named:
            places.setdefault(grant.subject, grant.location)
    unread = next((document.location for document in system.documents if document.opaque), None)
    if unread is not None:
        places[UNREAD] = unread
    if not places:
        return system
    first = len(system.certificates)
    number = {subject: first + place for place, subject in enumerate(places)}
    key = (id(system.grants), here, first)
    if key not in known:
        known[key] = tuple(
            replace(g, names=g.names | {number[g.subject]}) if g.subject in number else g for g in system.grants
        )
    issuers = frozenset[int]().union(*(realm.identity_ca for realm in system.realms))
    keys = 1 + max((certificate.key for certificate in system.certificates), default=-1)
    made = tuple(
        CertificateAtom(
            label=subject,
            location=place,
            issuers=issuers,
            authority=False,
            fit_to_sign=False,
            key=keys + at,
            not_before=0,
            not_after=len(system.instants) - 1,
        )
        for at, (subject, place) in enumerate(places.items())
    )
    return replace(system, certificates=(*system.certificates, *made), grants=known[key])
