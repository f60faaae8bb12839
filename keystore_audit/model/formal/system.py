"""The normalised system that both engines are asked about.

A `System` states facts, not answers. It has certificates with issuers, keys and dates, documents with signers,
ordered rules with their domains and channels, and governance rules with their flags. Who is authentic, which grant and
which rule decides, who can read or forge: each engine works that out on its own (docs/model.md).

Everything is an atom with an index into its tuple; a reference to another atom is that index. The order of
rules (grants, domain rules, topic rules) within their parent is the order of their indices.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from enum import Enum
from typing import Final, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.assumptions import DOCUMENTS, EVERY, IDENTITIES, WORLD, Assumption
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import Operation, ProtectionKind, Rule
from keystore_audit.model.formal.asked import ClaimAtom, DeterminismAtom, PlaceAtom
from keystore_audit.model.matching.expression import naming
from keystore_audit.profiles import Matcher


class CertificateAtom(Struct, frozen=True, kw_only=True):
    """A certificate. `issuers`: certificates whose subject it names and whose key verifies its signature.

    `authority`: CA:TRUE and, where keyUsage is present, keyCertSign. `fit_to_sign`: fit for S/MIME signing.
    `not_before`, `not_after`: instants. `key`: equal keys have equal numbers. `opaque`: (MAY only) it stands
    for everything that unread CA files may hold. `elsewhere`: it is not here, and stands for any certificate elsewhere
    with the subject `label` (`model.claims.named`).
    """

    label: str
    location: Location
    issuers: frozenset[int]
    authority: bool
    fit_to_sign: bool
    key: int
    not_before: int
    not_after: int
    opaque: bool = False
    elsewhere: bool = False


class Reading(Struct, frozen=True, kw_only=True):
    """How one kind of implementation judges its peers and what they present.

    `pins_signer`: documents must be signed by a permissions CA certificate itself; otherwise by any certificate that
    chains to one and is fit to sign (CVE-2023-24010). `skips_grants_out_of_date`: of a document the first grant in
    force that names a certificate counts; otherwise the first that names it, if it is in force. `requires_grant`: where
    join access control is off, it lets in whom some document grants something, not everybody. `joins_out_of_date`: the
    first grant that names a certificate lets it join whatever its dates. `asks_announced_only`: it asks permissions of
    an endpoint only where a peer announces it as under access control. `matcher`: how it reads expressions.
    """

    pins_signer: bool
    skips_grants_out_of_date: bool
    requires_grant: bool
    joins_out_of_date: bool = False
    asks_announced_only: bool = False
    matcher: Matcher = Matcher.POSIX


class DocumentAtom(Struct, frozen=True, kw_only=True):
    """A signed document, as one of the readings of the system has it: a message has one for each.

    `intact`: it is S/MIME as run times read it, every SignerInfo verifies under a known certificate that it
    names; `signers` are those certificates. `opaque`: (MAY only) some run time may accept it, and we do not
    know what it says.
    """

    label: str
    location: Location
    intact: bool
    signers: frozenset[int]
    opaque: bool
    reading: int = 0


class TrustDomainAtom(Struct, frozen=True, kw_only=True):
    """Enclaves that trust alike: same identity CAs, permissions CAs and revocations, and governances that say the same.
    Their implementations are of one `reading`, and take documents of this reading alone.

    A peer's verdict depends on its trust domain only. `identity_ca`, `permissions_ca`: the certificates of those files.
    `governance`: the document of the first of them, None where it is missing or (MUST) unreadable. `revoked`:
    certificates on its CRL. `revoked_later`: the same from later moments (`permission.Permissions`) at which another
    list counts, ascending. `list_unread`: (MAY only) its list is unknown, so anybody may be revoked.
    `told`: what members tell peers of their permissions CA, if both sides compare that; None: unknown. Trust domains
    with different values refuse each other, unless one tells what the other expects.
    `refuses`: certificates that members refuse although an identity CA vouches for them; for claims of ability alone.
    `refuses_later`: from moments on at which these are others.
    """

    identity_ca: frozenset[int]
    permissions_ca: frozenset[int]
    governance: int | None
    revoked: frozenset[int]
    list_unread: bool = False
    told: int | None = 0
    refuses: frozenset[int] = frozenset()
    revoked_later: tuple[tuple[int, frozenset[int]], ...] = ()
    refuses_later: tuple[tuple[int, frozenset[int]], ...] = ()
    reading: int = 0

    def at(self, moment: int) -> TrustDomainAtom:
        """The same as it is then."""
        if not (self.revoked_later or self.refuses_later):
            return self
        *_, revoked = self.revoked, *(each for begin, each in self.revoked_later if begin <= moment)
        *_, refuses = self.refuses, *(each for begin, each in self.refuses_later if begin <= moment)
        return replace(self, revoked=revoked, revoked_later=(), refuses=refuses, refuses_later=())

    @property
    def always_revoked(self) -> frozenset[int]:
        """Certificates that are revoked at each moment."""
        return self.revoked.intersection(*(each for _begin, each in self.revoked_later))

    @property
    def ever_revoked(self) -> frozenset[int]:
        """Certificates that are revoked at some moment."""
        return self.revoked.union(*(each for _begin, each in self.revoked_later))

    def talks_to(self, other: TrustDomainAtom) -> bool:
        """Whether members of both may talk, as far as what they tell of their permissions CAs goes."""
        return self.told == other.told or None in (self.told, other.told)


NOWHERE: Final = -1
"""The trust domain of those that were left out."""


class ParticipantKind(Enum):
    """What a participant is to the keystore.

    ENCLAVE: of this keystore. UNMANAGED: a certificate that is no enclave's here, whoever holds it; without an
    identity, an unread one. UNREAD: an enclave whose identity is unknown, or all enclaves behind an unread place.
    """

    ENCLAVE = "enclave"
    UNMANAGED = "unmanaged"
    UNREAD = "unread"


class Participant(Struct, frozen=True, kw_only=True):
    """Who takes part. `identity`: its certificate. `permissions`: the document that it carries, in each reading.
    `possible`: (MAY only) whether anybody has its key is unknown.

    `reads_alone`, `writes_alone`: channels that its own implementation lets it read, and write, where that may be more
    than peers concede. `refused_writes`, `refused_reads`: those on which it refuses a writer, or a reader, that peers
    would take. `later`: the same enclave from moments on (`permission.Permissions`), ascending, at which these are
    others.
    """

    label: str
    location: Location
    trust_domain: int
    identity: int | None
    permissions: frozenset[int]
    kind: ParticipantKind = ParticipantKind.ENCLAVE
    possible: bool = False
    reads_alone: frozenset[int] = frozenset()
    writes_alone: frozenset[int] = frozenset()
    refused_writes: frozenset[int] = frozenset()
    refused_reads: frozenset[int] = frozenset()
    later: tuple[tuple[int, Participant], ...] = ()

    def at(self, moment: int) -> Participant:
        """The same as it is then, without later changes."""
        *_, found = self, *(each for begin, each in self.later if begin <= moment)
        return replace(found, later=()) if found.later else found

    @property
    def document(self) -> int | None:
        """One of its permissions, all of which stand in one place; None where it carries none."""
        return min(self.permissions, default=None)

    @property
    def unmanaged(self) -> bool:
        """Whether it is nobody's enclave here."""
        return self.kind is ParticipantKind.UNMANAGED

    @property
    def opaque(self) -> bool:
        """(MAY only) Whether it may be anybody."""
        return self.kind is ParticipantKind.UNREAD or (self.unmanaged and self.identity is None)

    @property
    def by_itself(self) -> tuple[frozenset[int], ...]:
        """The channels about which its own implementation decides otherwise than peers, way by way."""
        return self.reads_alone, self.writes_alone, self.refused_writes, self.refused_reads


class DomainAtom(Struct, frozen=True, kw_only=True):
    """Domain ids that no document tells apart: closed intervals within 0..232."""

    label: str
    intervals: tuple[tuple[int, int], ...]


class ChannelAtom(NamedTuple):
    """A domain class × topic class × partition class, merged where no rule of any document tells them apart.

    `topic` and `partition` are witnesses. `ros`: a ROS 2 name lies in it; `infinite`: it holds infinitely
    many names. A tuple, since there may be 300,000.
    """

    domain: int
    topic: str
    partition: str
    ros: bool
    infinite: bool


def easiest(channels: Sequence[ChannelAtom], numbers: Iterable[int]) -> int:
    """Of the channels of these numbers, the one that a person reads most easily."""
    return min(numbers, key=lambda n: (not channels[n].ros, channels[n].infinite, n))


class DomainRuleAtom(Struct, frozen=True, kw_only=True):
    """A `<domain_rule>` of the governance `document`; `domains` are the classes its ids cover."""

    document: int
    domains: frozenset[int]
    allow_unauthenticated_participants: bool
    enable_join_access_control: bool
    discovery_protection_kind: ProtectionKind
    liveliness_protection_kind: ProtectionKind
    rtps_protection_kind: ProtectionKind
    location: Location


class TopicRuleAtom(Struct, frozen=True, kw_only=True):
    """A `<topic_rule>` of `domain_rule`; `channels` are those whose topic its expression matches.

    Channels of every domain class that the domain rule covers are among them, whether or not an earlier rule
    decides.
    """

    domain_rule: int
    channels: frozenset[int]
    enable_discovery_protection: bool
    enable_liveliness_protection: bool
    enable_read_access_control: bool
    enable_write_access_control: bool
    metadata_protection_kind: ProtectionKind
    data_protection_kind: ProtectionKind
    location: Location


class GrantAtom(Struct, frozen=True, kw_only=True):
    """A `<grant>` of the permissions `document`.

    `names`: certificates whose subject its subject_name, `subject`, matches.
    """

    document: int
    names: frozenset[int]
    not_before: int
    not_after: int
    default_allow: bool
    location: Location
    subject: str = ""


class RuleAtom(Struct, frozen=True, kw_only=True):
    """An `<allow_rule>` or `<deny_rule>` of `grant`.

    `domains`: the classes its ids cover. `publish`, `subscribe`, `relay`: channels, in any domain class, whose topic
    and partition one of its criteria matches. A rule applies to a channel only if `domains` holds the channel's domain.
    `source`: as it is written.
    """

    grant: int
    allow: bool
    domains: frozenset[int]
    publish: frozenset[int]
    subscribe: frozenset[int]
    relay: frozenset[int]
    location: Location
    source: Rule | None = None

    def named(self, operation: Operation) -> frozenset[int]:
        """The channels that its criteria match for the operation."""
        if operation is Operation.PUBLISH:
            return self.publish
        return self.subscribe if operation is Operation.SUBSCRIBE else self.relay


class NodeAtom(Struct, frozen=True, kw_only=True):
    """A ROS 2 node that is to run in `enclave` (None: one that is not in the keystore, or (MUST) unreadable).

    `publishes`, `subscribes`: the channels that it is there to use.
    """

    label: str
    location: Location
    enclave: int | None
    publishes: frozenset[int]
    subscribes: frozenset[int]


class System(Struct, frozen=True, kw_only=True):
    """One keystore as a fleet reads it, at one instant, in one of two readings: MAY and MUST.

    `may`: what could not be read may do, grant and open anything; else it does, grants and opens nothing, and is left
    out. `left_out`: enclaves without a trust domain, whose identity or trust is unknown.
    `profiles`: the variants that read it so (all facts equal). `readings`: one, unless some enclaves run one of
    `others` (variants) instead. `instants`: sorted; `now`: index of the audit instant among them.
    `meets`: by channel, the others whose endpoints meet one allowed in it, because its partition may be a pattern.
    Empty where no channel meets another. `assumed`: what is taken for granted; in MUST, whatever nobody can see
    (`assumptions.WORLD`) is.
    """

    profiles: tuple[str, ...]
    readings: tuple[Reading, ...]
    others: tuple[str, ...] = ()
    assumed: frozenset[Assumption] = EVERY
    may: bool
    instants: tuple[datetime, ...]
    now: int
    certificates: tuple[CertificateAtom, ...]
    documents: tuple[DocumentAtom, ...]
    trust_domains: tuple[TrustDomainAtom, ...]
    enclaves: tuple[Participant, ...]
    domains: tuple[DomainAtom, ...]
    channels: tuple[ChannelAtom, ...]
    domain_rules: tuple[DomainRuleAtom, ...]
    topic_rules: tuple[TopicRuleAtom, ...]
    grants: tuple[GrantAtom, ...]
    rules: tuple[RuleAtom, ...]
    claims: tuple[ClaimAtom, ...] = ()
    determinism: tuple[DeterminismAtom, ...] = ()
    places: tuple[PlaceAtom, ...] = ()
    nodes: tuple[NodeAtom, ...] = ()
    meets: tuple[frozenset[int], ...] = ()
    left_out: tuple[Participant, ...] = ()

    def place(self, rule: RuleAtom, operation: Operation, channel: int) -> Location:
        """The line of the expression (its message, if not the name) that takes in the channel, else the rule's."""
        topic = self.channels[channel].topic
        matcher = self.reading_of(self.grants[rule.grant]).matcher
        text = None if rule.source is None else naming(rule.source, operation, topic, matcher)
        if text is None or text.line is None:
            return rule.location
        return replace(rule.location, line=text.line, message="" if text.text == topic else text.text)

    @property
    def mixed(self) -> bool:
        """Whether trust domains judge by different readings."""
        return len({trust_domain.reading for trust_domain in self.trust_domains}) > 1

    def reading_of(self, grant: GrantAtom) -> Reading:
        """How those judge who take the grant's document for what this atom of it says."""
        return self.readings[self.documents[grant.document].reading]

    def at(self, moment: int) -> System:
        """The same with trust domains and enclaves as they are then, and no later changes. Dates say what is valid."""
        trust_domains = tuple(trust_domain.at(moment) for trust_domain in self.trust_domains)
        return replace(
            self, trust_domains=trust_domains, enclaves=tuple(enclave.at(moment) for enclave in self.enclaves)
        )

    def key_of(self, enclave: int) -> int | None:
        """The key of the enclave's identity, None where none is known. Holders of equal keys count as one."""
        identity = self.enclaves[enclave].identity
        return None if identity is None else self.certificates[identity].key

    def holders(self) -> dict[int, list[int]]:
        """By key: enclaves and unmanaged identities that have it, except unread ones."""
        keys = ((self.key_of(n), n) for n in range(len(self.enclaves)) if not self.anybody(n))
        return gathered((key, number) for key, number in keys if key is not None)

    def anybody(self, enclave: int) -> bool:
        """Whether the enclave may have any identity: its own could not be read, or authorities may have made others."""
        return self.enclaves[enclave].opaque or not self.assumed >= IDENTITIES

    @property
    def anything_granted(self) -> bool:
        """Whether a document may grant anything: one could not be read, or is not here."""
        return any(document.opaque for document in self.documents) or not self.assumed >= DOCUMENTS

    def trust_domains_of_enclaves(self) -> dict[int, list[int]]:
        """The trust domains that have enclaves, each with these; others have unmanaged identities alone."""
        members = gathered((each.trust_domain, n) for n, each in enumerate(self.enclaves) if not each.unmanaged)
        return dict(sorted(members.items()))

    @property
    def has_doubt(self) -> bool:
        """Whether anything in it is opaque, unread or not taken for granted, so that the other reading may differ."""
        opaque = any(d.opaque for d in self.documents) or any(e.opaque or e.possible for e in self.enclaves)
        return opaque or any(each.list_unread for each in self.trust_domains) or not self.assumed >= WORLD
