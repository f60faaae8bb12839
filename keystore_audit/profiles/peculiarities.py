"""What implementations may do differently, as types: a field for each row of quirks.toml, which says what it means."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct
from msgspec.structs import replace


class Syntax(str, Enum):
    """How the XML of a document is read where it is not of the plain form (`keystore.syntax`)."""

    SCHEMA = "by-the-schema"
    IN_ORDER = "in-the-order-of-the-schema"
    ANY_ORDER = "in-any-order"
    UNKNOWN = "not-known"


class Matcher(str, Enum):
    """A pattern language: which names a text matches.

    POSIX: `fnmatch` with flags 0 as glibc has it in the C locale (our reading of the specification). POSIX_NOESCAPE:
    the same with FNM_NOESCAPE, where a backslash is an ordinary character. SIMPLE_BRACKETS and SINGLE_TRY: see the
    modules of `model.matching` of these names.
    """

    POSIX = "posix"
    POSIX_NOESCAPE = "posix-noescape"
    SIMPLE_BRACKETS = "simple-brackets"
    SINGLE_TRY = "stars-without-second-try"


class OpenRange(str, Enum):
    """What an `<id_range>` with one bound holds."""

    UNBOUNDED = "absent-bound-is-none"
    LONE_BOUND_IS_THAT_ID = "lone-bound-is-that-id"
    LONE_MAX_REFUSED = "lone-min-is-that-id-lone-max-refused"


class DateReading(str, Enum):
    """How the dates of a grant are read (`model.validity`)."""

    XSD = "xsd"
    ROBOT_TIME = "standard-time-of-the-robot"
    UNREADABLE_IS_PAST = "unreadable-is-long-past"
    SHIFTED_CLOCK = "utc-clock-in-local-time"


class PartitionReading(str, Enum):
    """Where the partitions of a rule count.

    CRITERION: each criterion has its own (DDS-Security 1.1, 9.4.1.3.2.3), a deny rule without any denies in all.
    CRITERION_NAMED: the same, except for an endpoint without a partition name, in the default partition. It is in those
    of every allow rule and of no deny rule that lists some.
    CRITERION_DEFAULT: the same, and a deny rule without any denies in the default partition alone. RULE: the first rule
    whose topics match decides. Partitions of all its criteria of the kind count for all its topics. Outside of them,
    and anywhere in a deny rule, it denies.
    """

    CRITERION = "of-the-criterion"
    CRITERION_NAMED = "of-the-criterion-default-one-allowed"
    CRITERION_DEFAULT = "of-the-criterion-denied-in-default-one"
    RULE = "of-the-first-rule"


class TopicCheck(str, Enum):
    """Which rules decide whether there is a topic at all, where read and write access control are on.

    NONE: none does. FIRST_RULE: the first that lists it, for either operation and in any partition. EACH: for each
    operation the first that lists it for that one, in any partition, else the default; there is one if either allows.
    """

    NONE = "none"
    FIRST_RULE = "first-rule"
    EACH = "first-rule-of-each-operation"


class RelayReading(str, Enum):
    """What a `<relay>` criterion gives.

    RELAY: the keys of submessages, to pass them on (DDS-Security 1.1, 9.4.1.3.2.3). READ: to a peer's reader what a
    `<subscribe>` gives, where none of the rule lists the topic. NOTHING: it is passed over.
    """

    RELAY = "passes-submessages-on"
    READ = "gives-data-to-readers"
    NOTHING = "nothing"


class JoinCheck(str, Enum):
    """What a grant needs so that an implementation creates its own participant.

    ALLOWED_DOMAIN: where join access control is on, an allow rule for the domain or the default ALLOW. This is
    DDS-Security 1.1, Table 63, except that the table would refuse every stock enclave. ANY_ALLOW_RULE: one of whatever
    domain. LOOSE_TOPIC: as ALLOWED_DOMAIN, unless some topic rule of the domain has read or write access control off.
    TABLE_63: to the letter.
    """

    ALLOWED_DOMAIN = "allow-rule-for-the-domain"
    ANY_ALLOW_RULE = "any-allow-rule"
    LOOSE_TOPIC = "allow-rule-or-loose-topic"
    TABLE_63 = "table-63"


class RevocationLists(str, Enum):
    """Where revocation lists of identities are read from."""

    NONE = "none"
    CRL_FILE = "crl.pem"
    CRL_AND_CA_FILE = "crl.pem and the identity CA file"


class SubjectComparison(str, Enum):
    """How the subject_name of a grant is compared with the subject of a certificate (`model.subjects.comparison`)."""

    EXACT = "exact"
    PIECES_IN_ORDER = "pieces-in-order"
    ATTRIBUTES = "attributes-in-any-order"
    PIECES_WITHIN = "pieces-within"
    TRIMMED_PIECES_WITHIN = "pieces-within-blanks-off"
    RELATIVE_NAMES = "relative-names"


class Trust(Struct, frozen=True, kw_only=True, eq=False):
    """Whom an implementation trusts. Profiles with one row read a keystore alike; equal rows are one object."""

    pins_signer: bool
    first_authority_only: bool
    needs_root: bool
    checks_root_signature: bool
    checks_permissions_ca: bool
    strict_authorities: bool
    revocation: RevocationLists
    subjects: SubjectComparison
    ca_algorithms: frozenset[str] | None
    identity_algorithms: frozenset[str] | None
    identity_keys: frozenset[str] | None
    compares_key: bool
    compares_permissions_ca: bool
    trusts_declarations: bool


class Access(Struct, frozen=True, kw_only=True, eq=False):
    """What documents mean to an implementation, its own enclave's and those of peers; equal rows are one object."""

    matcher: Matcher
    matches_octets: bool
    syntax: Syntax
    open_ranges: OpenRange
    highest_domain: int | None
    refuses_unauthenticated_with_rtps: bool
    dates: DateReading
    skips_grants_out_of_date: bool
    honours_default: bool
    partitions: PartitionReading
    relay: RelayReading
    topic_check: TopicCheck
    requires_grant: bool
    joins_out_of_date: bool
    any_governance_rule: bool
    authenticates_origin: bool


class Local(Struct, frozen=True, kw_only=True, eq=False):
    """What an implementation asks of its own enclave, beside what its documents mean; equal rows are one object."""

    joins: JoinCheck
    binds_domains: bool
    starts_ungoverned: bool
    reads_names_as_expressions: bool
    topic_names: str | None
    splits_partitions: bool
    most_sent: int | None


class Evidence(str, Enum):
    """How the rows of a profile are known (docs/profiles.md tells row by row).

    TESTED: this project's tests ask the real implementation. MEASURED: on the real implementation, for the project's
    tables; the tests do not ask it again. READ: in its source, or in the specification.
    """

    TESTED = "tested"
    MEASURED = "measured"
    READ = "read"


class Profile(Struct, frozen=True, kw_only=True):
    """What one implementation does.

    `distributions`: ROS 2 distributions that ship it. `trust`: whom it trusts; `access`: what documents mean to it;
    `local`: what it asks of its own participant. `evidence`: how the rows are known. `family`: whose release it is.
    `versions`: those that the row holds for; `asked`: the one that this project's tests ask. `others`: in a mixed fleet
    the enclaves, by path, that run another implementation than this one.
    """

    name: str
    title: str
    distributions: tuple[str, ...] = ()
    trust: Trust
    access: Access
    local: Local
    evidence: Evidence
    family: str
    versions: str
    asked: str | None = None
    others: tuple[tuple[str, Profile], ...] = ()

    def run_by(self, enclave: str) -> Profile:
        """What the enclave, by its path, runs in the fleet."""
        if not self.others:  # nearly always
            return self
        return next((other for path, other in self.others if path == enclave), replace(self, others=()))
