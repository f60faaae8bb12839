"""How an implementation reads governance and permissions, and what it asks of its own participant."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from keystore_audit.model.matching.expression import Matcher
from keystore_audit.model.validity import DateReading


class OpenRange(str, Enum):
    """What an `<id_range>` with one bound holds (measured; OPENDDS read).

    SPEC, OPENDDS: the absent bound does not bound. FASTDDS: a lone `<min>`, or a `<max>` of 0, is that one id.
    CYCLONEDDS: a lone `<min>` is that one id; a lone `<max>` and the governance is refused, while in permissions
    it ends the process that comes to it, and no other.
    """

    SPEC = "spec"
    FASTDDS = "fastdds"
    CYCLONEDDS = "cyclonedds"


class PartitionReading(str, Enum):
    """Where the partitions of a rule count.

    CRITERION: each criterion has its own (DDS-Security 1.1, 9.4.1.3.2.3), a deny rule without any denies in all.
    CRITERION_NAMED: the same, but an endpoint without any name of a partition, in the default one, is in those of every
    allow rule and of no deny rule that lists some.
    CRITERION_DEFAULT: the same, and a deny rule without any denies in the default partition alone. RULE: the first rule
    whose topics match decides; those of all its criteria of the kind count for all its topics, and outside of them, and
    anywhere in a deny rule, it denies.
    """

    CRITERION = "criterion"
    CRITERION_NAMED = "criterion, of endpoints that name a partition"
    CRITERION_DEFAULT = "criterion, default partition where a deny rule has none"
    RULE = "rule"


class RelayReading(str, Enum):
    """What a `<relay>` criterion gives.

    RELAY: the keys of submessages, to pass them on (DDS-Security 1.1, 9.4.1.3.2.3). READ: to a peer's reader what a
    `<subscribe>` gives, where none of the rule lists the topic (measured on Fast DDS 2.9.1: it receives plain data).
    NOTHING: it is passed over.
    """

    RELAY = "relay"
    READ = "read"
    NOTHING = "nothing"


class Access(Struct, frozen=True, kw_only=True, eq=False):
    """What documents mean to an implementation, its own enclave's and those of peers alike.

    `matcher`: of topic and partition expressions; `matches_octets`: beyond ASCII, `?` and brackets take octets or
    characters, we cannot tell which. `highest_domain`: a document that names a higher id is refused (None: no limit).
    `reads_1_0`: whether a governance in the form of DDS-Security 1.0 is read. `refuses_unauthenticated_with_rtps`: a
    governance that allows unauthenticated participants beside a protected RTPS is refused. `skips_grants_out_of_date`:
    the first grant in force decides, not the first. `honours_default`: `<default>ALLOW` allows; otherwise it denies.
    `first_rule_decides_topic`: where read and write access control are both on, the first rule that lists a topic, for
    publishing or subscribing and in whatever partition, decides whether there is such a topic at all (measured on
    Cyclone DDS 0.10.2, of its own topics and of peers'). `requires_grant`: a peer without a grant in force is refused,
    even where join access control is off. `joins_out_of_date`: a grant lets its holder join
    whatever its dates, which bind endpoints alone. `any_governance_rule`: access control is off where any matching rule
    of the governance has it off, not the first; topics that the first domain rule does not list are looked up in the
    later ones of the domain. `authenticates_origin`: kinds WITH_ORIGIN_AUTHENTICATION are more than those without.
    """

    matcher: Matcher
    matches_octets: bool
    open_ranges: OpenRange
    highest_domain: int | None
    reads_1_0: bool
    refuses_unauthenticated_with_rtps: bool
    dates: DateReading
    skips_grants_out_of_date: bool
    honours_default: bool
    partitions: PartitionReading
    relay: RelayReading
    first_rule_decides_topic: bool
    requires_grant: bool
    joins_out_of_date: bool
    any_governance_rule: bool
    authenticates_origin: bool


class JoinCheck(str, Enum):
    """What a grant needs so that the implementation creates its own participant.

    SPEC: where join access control is on, an allow rule for the domain or the default ALLOW (DDS-Security 1.1, Table
    63, save that it would refuse every stock enclave). FASTDDS: an allow rule of whatever domain. CYCLONEDDS: as SPEC,
    unless some topic rule of the domain has read or write access control off. OPENDDS: Table 63 to the letter.
    """

    SPEC = "spec"
    FASTDDS = "fastdds"
    CYCLONEDDS = "cyclonedds"
    OPENDDS = "opendds"


class Local(Struct, frozen=True, kw_only=True, eq=False):
    """What an implementation asks of its own enclave, beside what its documents mean.

    `binds_domains`: rules of other domains do not apply. `starts_ungoverned`: a participant starts in a domain that the
    governance does not cover, with no topic to use. `reads_names_as_expressions`: a topic rule applies to a topic whose
    name, taken for an expression, matches its own as well. `topic_names`: what a topic can be called, a regular
    expression (None: anything). `splits_partitions`: an endpoint's partition is taken apart at semicolons.
    `most_sent`: octets of certificate and permissions that fit in a message of the handshake (None: however many).
    """

    joins: JoinCheck
    binds_domains: bool
    starts_ungoverned: bool
    reads_names_as_expressions: bool
    topic_names: str | None
    splits_partitions: bool
    most_sent: int | None
