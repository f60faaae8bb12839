"""From when to when the parts of a keystore hold: certificates, grants, revocation lists."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from enum import Enum

from msgspec import Struct

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.formal.system import System
from keystore_audit.model.tables.issuance import Issuance
from keystore_audit.model.trust.revocation import lists_carried


class Dated(str, Enum):
    """What has dates."""

    AUTHORITY = "CA certificate"
    IDENTITY = "identity certificate"
    OTHER = "other certificate"
    GRANT = "grant"
    REVOCATIONS = "revocation list"


class Period(Struct, frozen=True, kw_only=True):
    """Things of one kind with the same dates (aware UTC). `end` None: without an end. `names`: raw text, sorted."""

    kind: Dated
    start: datetime
    end: datetime | None
    names: tuple[str, ...]


def periods(keystore: Keystore, system: System, found: Issuance) -> tuple[Period, ...]:
    """Every period of the keystore, by kind, then those that end first."""
    together: dict[tuple[Dated, datetime, datetime | None], set[str]] = {}
    for kind, start, end, name in (*_certificates(found), *_grants(system), *_lists(keystore)):
        together.setdefault((kind, start, end), set()).add(name)
    order = {kind: place for place, kind in enumerate(Dated)}
    return tuple(
        Period(kind=kind, start=start, end=end, names=tuple(sorted(names)))
        for (kind, start, end), names in sorted(
            together.items(), key=lambda entry: (order[entry[0][0]], entry[0][2] is None, entry[0][2] or entry[0][1])
        )
    )


_Dates = tuple[Dated, datetime, "datetime | None", str]


def _certificates(found: Issuance) -> Iterator[_Dates]:
    for certificate in found.certificates:
        if certificate.identity_ca_of or certificate.permissions_ca_of:
            kind = Dated.AUTHORITY
        else:
            kind = Dated.IDENTITY if certificate.identity_of else Dated.OTHER
        for name in certificate.identity_of if kind is Dated.IDENTITY else (certificate.subject,):
            yield kind, certificate.not_before, certificate.not_after, name


def _grants(system: System) -> Iterator[_Dates]:
    for grant in system.grants:
        place = system.documents[grant.document].location.path
        yield Dated.GRANT, system.instants[grant.not_before], system.instants[grant.not_after], place


def _lists(keystore: Keystore) -> Iterator[_Dates]:
    for enclave in keystore.enclaves:
        for each in lists_carried(enclave):
            yield Dated.REVOCATIONS, each.this_update, each.next_update, each.path
