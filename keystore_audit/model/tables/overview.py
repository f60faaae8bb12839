"""What the pictures of a report show, beside its findings: who may do what, flows, certificates and dates.

No verdict rests on it, so it is worked out only where a report draws it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.asked import Attacker, Search
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.formal.flow import Flows, Lane
from keystore_audit.model.formal.steps import decided
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import certificates_of
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.rights import Window
from keystore_audit.model.tables.access_table import AccessTable, TableBuilder
from keystore_audit.model.trust.revocation import lists_carried
from keystore_audit.profiles import Profile

# Who vouches for whom: the certificates of a keystore, what each issued and which documents each signed.
#
# Names and signatures alone count here, as in `CertificateAtom.issuers`; whether a run time accepts a chain at an
# instant is `model.trust.verdicts`'s and the properties' question.


class IssuedCertificate(Struct, frozen=True, kw_only=True):
    """A certificate and what depends on it. Names are raw text, dates aware UTC.

    `key_kind` as in `Certificate`. `identity_of`: enclaves whose identity it is; `identity_ca_of`, `permissions_ca_of`:
    how many enclaves trust it as that. `issued`: places among all certificates; `is_root`: no other one issued it.
    `signed`: documents (paths) whose signature it made. `revoked`: some enclave's revocation list revokes it.
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

    certificates: tuple[IssuedCertificate, ...] = ()
    unsigned: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()


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


# From whom samples come to an enclave, and to whom its own go, in one step: hops of the flows of `model.formal.flow`.
# No question, so that no engine decides it.


ANYBODY: Final = None
"""Stands for whoever is on the network, without any key."""


class PeerGroup(Struct, frozen=True, kw_only=True):
    """Names (places in the access table) on which the same peers are at the other end.

    `peers`: paths of enclaves, ANYBODY last. `by_right`: peers grant it; else it takes a compromised sender or
    receiver, with the keys that it holds or as anybody on the network.
    """

    peers: tuple[str | None, ...]
    names: tuple[int, ...]
    by_right: bool


class Neighbourhood(Struct, frozen=True, kw_only=True):
    """The groups of peers to and from the enclave `path`; by right first, then those with the fewest peers."""

    path: str
    incoming: tuple[PeerGroup, ...]
    outgoing: tuple[PeerGroup, ...]


def neighbourhoods(system: System, window: Window, left_out: int, limit: int) -> tuple[Neighbourhood, ...]:
    """Of the first `limit` enclaves of the system. `left_out`: names (bit set) that are not looked at."""
    flows = Flows(system, trust_domain_views(system))
    kept = window.all & ~left_out if window.governed else 0
    honest = _Lanes(flows.by_right(), window, kept)
    attacked = _Lanes(flows.lanes(Search(attacker=Attacker.RELAYS)), window, kept)
    labels: list[str | None] = [*(enclave.label for enclave in system.enclaves), ANYBODY]
    found = []
    for node, enclave in enumerate(system.enclaves[:limit]):
        by_right = honest.received(node), honest.sent(node)
        with_keys = attacked.received(node), attacked.sent(node)
        incoming, outgoing = (
            (*_groups(rightly, labels, by_right=True), *_groups(_beyond(able, rightly), labels, by_right=False))
            for rightly, able in zip(by_right, with_keys, strict=True)
        )
        found.append(Neighbourhood(path=enclave.label, incoming=incoming, outgoing=outgoing))
    return tuple(found)


def _beyond(able: Mapping[int, int], rightly: Mapping[int, int]) -> dict[int, int]:
    return {peer: names & ~rightly.get(peer, 0) for peer, names in able.items() if names & ~rightly.get(peer, 0)}


class _Lanes:
    """Who puts what into the lanes of a flow and gets what out of them, in names of the window."""

    def __init__(self, lanes: Iterable[Lane], window: Window, kept: int) -> None:
        self._puts: dict[int, list[tuple[int, int]]] = {}
        self._gets: dict[int, list[tuple[int, int]]] = {}
        self._putting: list[list[tuple[int, int]]] = []
        self._getting: list[list[tuple[int, int]]] = []
        for number, lane in enumerate(lanes):
            self._putting.append(_there(lane.puts, window, kept))
            self._getting.append(_there(lane.gets, window, kept))
            for node, names in self._putting[-1]:
                self._puts.setdefault(node, []).append((number, names))
            for node, names in self._getting[-1]:
                self._gets.setdefault(node, []).append((number, names))

    def sent(self, node: int) -> dict[int, int]:
        """By receiver: the names on which it gets samples of `node`."""
        return _met(node, self._puts.get(node, ()), self._getting)

    def received(self, node: int) -> dict[int, int]:
        """By sender: the names on which `node` gets its samples."""
        return _met(node, self._gets.get(node, ()), self._putting)


def _there(sets: Sequence[int], window: Window, kept: int) -> list[tuple[int, int]]:
    windowed = ((node, window.of(channels) & kept) for node, channels in enumerate(sets) if channels)
    return [(node, names) for node, names in windowed if names]


def _met(node: int, own: Iterable[tuple[int, int]], others: Sequence[list[tuple[int, int]]]) -> dict[int, int]:
    met: dict[int, int] = {}
    for lane, names in own:
        for other, theirs in others[lane]:
            common = names & theirs
            if common and other != node:
                met[other] = met.get(other, 0) | common
    return met


def _groups(met: Mapping[int, int], labels: Sequence[str | None], *, by_right: bool) -> list[PeerGroup]:
    """Names with the same peers are of one group."""
    masks = gathered((names, peer) for peer, names in met.items())
    parts: dict[int, tuple[int, ...]] = {}
    for mask, peers in masks.items():  # splits the names known so far, and adds the new ones
        new = mask
        split: dict[int, tuple[int, ...]] = {}
        for names, known in parts.items():
            new &= ~names
            if names & mask:
                split[names & mask] = (*known, *peers)
            if names & ~mask:
                split[names & ~mask] = known
        if new:
            split[new] = tuple(peers)
        parts = split
    groups = [
        PeerGroup(peers=tuple(labels[peer] for peer in sorted(peers)), names=tuple(members(names)), by_right=by_right)
        for names, peers in parts.items()
    ]
    return sorted(groups, key=lambda group: (len(group.peers), group.names))


MAX_NEIGHBOURHOODS: Final = 400
"""Enclaves whose neighbours are looked for: each is held against each, and nobody looks at more pictures."""

MAX_VIEWS: Final = 10_000
"""Pairs of an enclave and a trust domain beyond which no neighbours are looked for. That takes hundreds of enclaves,
each with its own governance file."""


class Allowance(Struct, frozen=True, kw_only=True):
    """`names`: places in the table, as a bit set, for which `location` (None: no line) allows the operation.

    `by_pattern`: those of them that the rule does not write out. `reason`: why, raw text.
    """

    operation: Operation
    names: int
    by_pattern: int
    reason: str
    location: Location | None


class Overview(Struct, frozen=True, kw_only=True):
    """`access`: in one domain; None where that could not be worked out, and `refused` says why (a sentence).

    `allowances`: by enclave path, under the profiles of the table's last group, as `neighbourhoods` are. There are at
    most MAX_NEIGHBOURHOODS of these, or none, and `undrawn` says why (a sentence). `ambient`: names (bit set) that
    those leave out.
    """

    access: AccessTable | None = None
    refused: str = ""
    allowances: Mapping[str, tuple[Allowance, ...]] = {}
    neighbourhoods: tuple[Neighbourhood, ...] = ()
    undrawn: str = ""
    ambient: int = 0
    issuance: Issuance = Issuance()
    periods: tuple[Period, ...] = ()


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
        why = "The classes of names are too many."
        return Overview(refused=why, undrawn=why)
    issued = issuance(keystore, systems[0])
    dates = periods(keystore, systems[0], issued)
    try:
        built = TableBuilder(keystore, profiles, at, accesses, domain)
    except BudgetExceeded as exceeded:
        return Overview(refused=exceeded.message, undrawn=exceeded.message, issuance=issued, periods=dates)
    table, window = built.table(), built.window
    shown = next(profile for profile in profiles if profile.name == table.groups[-1].profiles[0])
    system = built.systems[shown.name]
    many = len(system.trust_domains) * len(system.enclaves) > MAX_VIEWS
    ambient = bits(number for number, name in enumerate(table.names) if name.topic in AMBIENT and not name.several)
    return Overview(
        access=table,
        allowances={each.path: tuple(_allowances(each, shown, built, table)) for each in keystore.enclaves},
        neighbourhoods=() if many else neighbourhoods(system, window, ambient, MAX_NEIGHBOURHOODS),
        undrawn=f"{len(system.trust_domains)} trust domains are too many to compare each enclave with each."
        if many
        else "",
        ambient=ambient,
        issuance=issued,
        periods=dates,
    )


def _allowances(enclave: Enclave, profile: Profile, built: TableBuilder, table: AccessTable) -> Iterator[Allowance]:
    """Everything that allows it something on its own implementation, in the order in which it is asked."""
    for operation in Operation:
        for step, channels in decided(built.local.steps(enclave, profile, operation)):
            names, by = built.window.of(channels), step.by
            if names and step.allow:
                criteria = by.rule.rule.criteria if by.rule is not None else ()
                written = {topic.text for each in criteria for topic in each.topics}
                patterned = (n for n in members(names) if by.by_permissions and table.names[n].topic not in written)
                reason, location = by.at(None)
                yield Allowance(
                    operation=operation, names=names, by_pattern=bits(patterned), reason=reason, location=location
                )
