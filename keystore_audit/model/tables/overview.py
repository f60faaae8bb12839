"""What the pictures of a report show, beside its findings: who may do what, flows, certificates and dates.

No verdict rests on it, so it is worked out only where a report draws it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.steps import decided
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import certificates_of
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.tables.access_table import AccessTable, access_table
from keystore_audit.model.tables.neighbours import Neighbourhood, neighbourhoods
from keystore_audit.model.trust.revocation import lists_carried
from keystore_audit.model.window import Window
from keystore_audit.profiles import Profile

# Who vouches for whom: the certificates of a keystore, what each issued and which documents each signed.
#
# Names and signatures alone count here, as in `CertificateAtom.issuers`; whether a run time accepts a chain at an
# instant
# is `model.trust.verdicts`'s and the properties' question.


class IssuedCertificate(Struct, frozen=True, kw_only=True):
    """A certificate and what hangs on it. Names are raw text, dates aware UTC.

    `key_kind` as in `Certificate`. `identity_of`: enclaves whose identity it is; `identity_ca_of`, `permissions_ca_of`:
    how many enclaves trust it as that. `issued`: places among all certificates; `is_root`: no other one issued it.
    `signed`: documents (paths) whose signature it made. `revoked`: some enclave's revocation list takes it back.
    """

    subject: str
    location: Location
    key_kind: str
    signature_algorithm: str
    not_before: datetime
    not_after: datetime
    identity_of: tuple[str, ...]
    identity_ca_of: int
    permissions_ca_of: int
    issued: tuple[int, ...]
    signed: tuple[str, ...]
    is_root: bool
    revoked: bool


class Issuance(Struct, frozen=True, kw_only=True):
    """`certificates` by place. `unsigned`: documents (paths) whose signature none of them made. `unread`: those of
    which that cannot be told.
    """

    certificates: tuple[IssuedCertificate, ...]
    unsigned: tuple[str, ...]
    unread: tuple[str, ...]


def issuance(keystore: Keystore, system: System) -> Issuance:
    """Of the keystore whose `system` this is (its certificates are all systems').

    Those behind them stand for what was not read, or is elsewhere.
    """
    certificates = certificates_of(keystore, system.instants[system.now])
    issued: list[list[int]] = [[] for _ in certificates]
    roots = [True] * len(certificates)
    for number, atom in enumerate(system.certificates[: len(certificates)]):
        for issuer in atom.issuers - {number}:
            issued[issuer].append(number)
            roots[number] = False
    signed: list[list[str]] = [[] for _ in certificates]
    for document in system.documents:
        for signer in document.signers:
            signed[signer].append(document.location.path)
    revoked = {certificate for trust_domain in system.trust_domains for certificate in trust_domain.revoked}
    identities = gathered((each.identity.sha256, each.path) for each in keystore.enclaves if each.identity is not None)
    trusting = {
        role: Counter(sha256 for each in keystore.enclaves for sha256 in {c.sha256 for c in each.trusts(role)})
        for role in (Role.IDENTITY_CA, Role.PERMISSIONS_CA)
    }
    return Issuance(
        certificates=tuple(
            IssuedCertificate(
                subject=certificate.subject,
                location=Location(path=certificate.path, line=certificate.line),
                key_kind=certificate.key_kind,
                signature_algorithm=certificate.signature_algorithm,
                not_before=certificate.not_before,
                not_after=certificate.not_after,
                identity_of=tuple(identities.get(certificate.sha256, ())),
                identity_ca_of=trusting[Role.IDENTITY_CA][certificate.sha256],
                permissions_ca_of=trusting[Role.PERMISSIONS_CA][certificate.sha256],
                issued=tuple(sorted(issued[number], key=lambda n: (certificates[n].subject, n))),
                signed=tuple(sorted(signed[number])),
                is_root=roots[number],
                revoked=number in revoked,
            )
            for number, certificate in enumerate(certificates)
        ),
        unsigned=tuple(each.location.path for each in system.documents if not each.signers and not each.opaque),
        unread=tuple(each.location.path for each in system.documents if each.opaque),
    )


# From when to when the parts of a keystore hold: certificates, grants, revocation lists.


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


MAX_NEIGHBOURHOODS: Final = 400
"""Enclaves whose neighbours are looked for: each is held against each, and nobody looks at more pictures."""

MAX_VIEWS: Final = 10_000
"""Pairs of an enclave and a trust domain beyond which no neighbours are looked for: hundreds of enclaves, each with a
governance file of its own."""


class Allowance(Struct, frozen=True, kw_only=True):
    """`names`: places in the table, as a bit set, for which `location` (None: no line) allows the operation.

    `reason`: why, raw text.
    """

    operation: Operation
    names: int
    reason: str
    location: Location | None


class Overview(Struct, frozen=True, kw_only=True):
    """`access`: in one domain; None where that could not be worked out, and `refused` says why (a sentence).

    `allowances`: by enclave path, under the profiles of the table's last group, as `neighbourhoods` are, of which there
    are at most MAX_NEIGHBOURHOODS, or none, and `undrawn` says why (a sentence). `ambient`: names (bit set) that those
    leave out.
    """

    access: AccessTable | None
    refused: str
    allowances: Mapping[str, tuple[Allowance, ...]]
    neighbourhoods: tuple[Neighbourhood, ...]
    undrawn: str
    ambient: int
    issuance: Issuance
    periods: tuple[Period, ...]


def overview(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    domain: int | None,
    systems: Sequence[System],
) -> Overview:
    """Of a keystore at `at` (aware UTC), as the profiles read it.

    `domain`: that of the table, None: the lowest that some governance covers. `systems`: the keystore's; where there
    are none, nothing could be worked out.
    """
    if not systems:
        return _nothing("The classes of names are too many.")
    issued = issuance(keystore, systems[0])
    dates = periods(keystore, systems[0], issued)
    try:
        table = access_table(keystore, profiles, at, accesses, domain)
    except BudgetExceeded as exceeded:
        return _nothing(exceeded.message, issued, dates)
    shown = next(profile for profile in profiles if profile.name == table.groups[-1].profiles[0])
    points = [(name.topic, name.partition) for name in table.names]
    builder = SystemBuilder(keystore, [shown], at, accesses, points)
    window = Window(builder.channels, table.domain, len(points))
    local = LocalRights(accesses, builder.channels, at)
    system = builder.systems()[0]
    many = len(system.trust_domains) * len(system.enclaves) > MAX_VIEWS
    ambient = bits(number for number, name in enumerate(table.names) if name.topic in AMBIENT and not name.several)
    return Overview(
        access=table,
        refused="",
        allowances={each.path: tuple(_allowances(each, shown, local, window)) for each in keystore.enclaves},
        neighbourhoods=() if many else neighbourhoods(system, window, ambient, MAX_NEIGHBOURHOODS),
        undrawn=f"{len(system.trust_domains)} ways to trust are too many to hold each enclave against each."
        if many
        else "",
        ambient=ambient,
        issuance=issued,
        periods=dates,
    )


def _nothing(why: str, issued: Issuance | None = None, dates: tuple[Period, ...] = ()) -> Overview:
    return Overview(
        access=None,
        refused=why,
        allowances={},
        neighbourhoods=(),
        undrawn=why,
        ambient=0,
        issuance=issued or Issuance(certificates=(), unsigned=(), unread=()),
        periods=dates,
    )


def _allowances(enclave: Enclave, profile: Profile, local: LocalRights, window: Window) -> Iterator[Allowance]:
    """Everything that allows it something on its own implementation, in the order in which it is asked."""
    for operation in Operation:
        for step, channels in decided(local.steps(enclave, profile, operation)):
            names = window.of(channels)
            if names and step.allow:
                reason, location = step.by.at(None)
                yield Allowance(operation=operation, names=names, reason=reason, location=location)
