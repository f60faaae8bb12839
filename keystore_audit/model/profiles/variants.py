"""The canonical variants and their aliases (design section 3).

The rows are those of the project's tables; docs/profiles.md and docs/security-model.md give them with their sources.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.model.matching.expression import Matcher
from keystore_audit.model.profiles.access import Access, JoinCheck, Local, OpenRange, PartitionReading, RelayReading
from keystore_audit.model.profiles.profile import Evidence, Profile, RevocationLists, SubjectComparison, Trust
from keystore_audit.model.validity import DateReading
from keystore_audit.text import meant

_SPEC: Final = Trust(
    pins_signer=True,
    first_authority_only=False,
    needs_root=False,
    checks_root_signature=False,
    checks_permissions_ca=False,
    strict_authorities=False,
    revocation=RevocationLists.CRL_FILE,
    subjects=SubjectComparison.EXACT,
    ca_algorithms=None,
    identity_algorithms=None,
    identity_keys=None,
    compares_key=True,
    compares_permissions_ca=False,
    trusts_declarations=False,
)
"""DDS-Security 1.1: each certificate of a CA file is an anchor (9.3.1.1), it signs documents itself (9.4.1.1)."""

_FASTDDS_ALGORITHMS: Final = frozenset({"ecdsa-with-SHA256", "sha256WithRSAEncryption", "sha1WithRSAEncryption"})
"""What `get_signature_algorithm` of Fast DDS knows (Permissions.cpp, PKIDH.cpp); measured on 2.9.1."""

_FASTDDS: Final = Trust(
    pins_signer=True,
    first_authority_only=False,
    needs_root=True,
    checks_root_signature=True,
    checks_permissions_ca=True,
    strict_authorities=True,
    revocation=RevocationLists.CRL_AND_CA_FILE,
    subjects=SubjectComparison.FASTDDS_PARSED,
    ca_algorithms=_FASTDDS_ALGORITHMS,
    identity_algorithms=_FASTDDS_ALGORITHMS,
    identity_keys=None,
    compares_key=True,
    compares_permissions_ca=True,
    trusts_declarations=False,
)
_FASTDDS_2_6: Final = replace(_FASTDDS, subjects=SubjectComparison.FASTDDS_ORDERED)
_FASTDDS_UNPINNED: Final = replace(_FASTDDS_2_6, pins_signer=False, strict_authorities=False)

_CYCLONEDDS_11: Final = Trust(
    pins_signer=True,
    first_authority_only=True,
    needs_root=True,
    checks_root_signature=False,
    checks_permissions_ca=False,
    strict_authorities=False,
    revocation=RevocationLists.CRL_FILE,
    subjects=SubjectComparison.CYCLONEDDS_TRIMMED,
    ca_algorithms=None,
    identity_algorithms=None,
    # RSA of 2,048 bits, or EC of 256 bits on whatever curve (auth_utils.c, check_key_type_and_size).
    identity_keys=frozenset({"RSA 2048", "EC secp256r1", "EC secp256k1", "EC brainpoolP256r1"}),
    compares_key=False,
    compares_permissions_ca=False,
    trusts_declarations=True,
)
_CYCLONEDDS_0_10: Final = replace(
    _CYCLONEDDS_11, pins_signer=False, checks_permissions_ca=True, subjects=SubjectComparison.CYCLONEDDS
)

_OPENDDS: Final = replace(
    _CYCLONEDDS_11,
    revocation=RevocationLists.NONE,
    subjects=SubjectComparison.OPENDDS,
    identity_keys=None,
    trusts_declarations=False,
)

_SPEC_ACCESS: Final = Access(
    matcher=Matcher.POSIX,
    matches_octets=False,
    open_ranges=OpenRange.SPEC,
    highest_domain=None,
    reads_1_0=True,
    refuses_unauthenticated_with_rtps=False,
    dates=DateReading.XSD,
    skips_grants_out_of_date=True,
    honours_default=True,
    partitions=PartitionReading.CRITERION,
    relay=RelayReading.RELAY,
    first_rule_decides_topic=False,
    requires_grant=False,
    joins_out_of_date=False,
    any_governance_rule=False,
    authenticates_origin=True,
)
"""DDS-Security 1.1, 9.4.1.2 and 9.4.1.3, expressions by glibc's `fnmatch` (see `Matcher`)."""

_FASTDDS_ACCESS: Final = Access(
    matcher=Matcher.POSIX_NOESCAPE,
    matches_octets=True,
    open_ranges=OpenRange.FASTDDS,
    highest_domain=None,
    reads_1_0=False,
    refuses_unauthenticated_with_rtps=True,
    dates=DateReading.FASTDDS,
    skips_grants_out_of_date=True,
    honours_default=False,
    partitions=PartitionReading.RULE,
    relay=RelayReading.READ,
    first_rule_decides_topic=False,
    requires_grant=True,
    joins_out_of_date=False,
    any_governance_rule=False,
    authenticates_origin=True,
)
_FASTDDS_OLD_ACCESS: Final = replace(_FASTDDS_ACCESS, refuses_unauthenticated_with_rtps=False)

_CYCLONEDDS_0_10_ACCESS: Final = Access(
    matcher=Matcher.CYCLONEDDS,
    matches_octets=True,
    open_ranges=OpenRange.CYCLONEDDS,
    highest_domain=230,
    reads_1_0=False,
    refuses_unauthenticated_with_rtps=False,
    dates=DateReading.CYCLONEDDS,
    skips_grants_out_of_date=False,
    honours_default=True,
    partitions=PartitionReading.CRITERION_DEFAULT,
    relay=RelayReading.NOTHING,
    first_rule_decides_topic=True,
    requires_grant=False,
    joins_out_of_date=False,
    any_governance_rule=False,
    authenticates_origin=True,
)

_CYCLONEDDS_11_ACCESS: Final = replace(_CYCLONEDDS_0_10_ACCESS, first_rule_decides_topic=False)

_OPENDDS_ACCESS: Final = replace(
    _SPEC_ACCESS,
    matcher=Matcher.OPENDDS,
    matches_octets=True,
    dates=DateReading.OPENDDS,
    partitions=PartitionReading.CRITERION_NAMED,
    relay=RelayReading.NOTHING,
    skips_grants_out_of_date=False,
    joins_out_of_date=True,
    any_governance_rule=True,
    authenticates_origin=False,
)

_SPEC_LOCAL: Final = Local(
    joins=JoinCheck.SPEC,
    binds_domains=True,
    starts_ungoverned=False,
    reads_names_as_expressions=False,
    topic_names=None,
    splits_partitions=False,
    most_sent=None,
)
_FASTDDS_LOCAL: Final = Local(
    joins=JoinCheck.FASTDDS,
    binds_domains=False,
    starts_ungoverned=True,
    reads_names_as_expressions=True,
    topic_names=None,
    splits_partitions=True,
    # Of the 65,500 of its transports' messages; the rest is for keys, signature and headers. With 2.9.1 63,100 fit and
    # 63,600 do not (measured; depends on the kind of key). Other versions are taken to be alike.
    most_sent=63_000,
)
_CYCLONEDDS_LOCAL: Final = replace(
    _SPEC_LOCAL, joins=JoinCheck.CYCLONEDDS, topic_names="(?!DCPS)[A-Za-z_/][A-Za-z0-9_/]*"
)
_OPENDDS_LOCAL: Final = replace(_SPEC_LOCAL, joins=JoinCheck.OPENDDS)

SPEC = Profile(
    name="spec",
    title="DDS-Security 1.1",
    distributions=(),
    trust=_SPEC,
    access=_SPEC_ACCESS,
    local=_SPEC_LOCAL,
    evidence=Evidence.READ,
)

VARIANTS: dict[str, Profile] = {
    profile.name: profile
    for profile in (
        SPEC,
        Profile(
            name="fastdds-2.6.4",
            title="Fast DDS up to 2.6.4",
            distributions=("galactic",),
            trust=_FASTDDS_UNPINNED,
            access=_FASTDDS_OLD_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.READ,
        ),
        Profile(
            name="fastdds-2.6",
            title="Fast DDS 2.6",
            distributions=("humble",),
            trust=_FASTDDS_2_6,
            access=_FASTDDS_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.MEASURED,
        ),
        Profile(
            name="fastdds-2.9",
            title="Fast DDS 2.9.1",
            distributions=(),
            trust=_FASTDDS_UNPINNED,
            access=_FASTDDS_OLD_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.TESTED,
        ),
        Profile(
            name="fastdds-2.14",
            title="Fast DDS 2.14",
            distributions=("jazzy",),
            trust=_FASTDDS,
            access=_FASTDDS_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.MEASURED,
        ),
        Profile(
            name="fastdds-3.2",
            title="Fast DDS 3.2",
            distributions=("kilted",),
            trust=_FASTDDS,
            access=_FASTDDS_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.MEASURED,
        ),
        Profile(
            name="fastdds-3.6",
            title="Fast DDS 3.6",
            distributions=("lyrical", "rolling"),
            trust=_FASTDDS,
            access=_FASTDDS_ACCESS,
            local=_FASTDDS_LOCAL,
            evidence=Evidence.MEASURED,
        ),
        Profile(
            name="cyclonedds-0.10",
            title="Cyclone DDS 0.10",
            distributions=("humble", "jazzy", "kilted"),
            trust=_CYCLONEDDS_0_10,
            access=_CYCLONEDDS_0_10_ACCESS,
            local=_CYCLONEDDS_LOCAL,
            evidence=Evidence.TESTED,
        ),
        Profile(
            name="cyclonedds-11",
            title="Cyclone DDS 11",
            distributions=("lyrical", "rolling"),
            trust=_CYCLONEDDS_11,
            access=_CYCLONEDDS_11_ACCESS,
            local=_CYCLONEDDS_LOCAL,
            evidence=Evidence.MEASURED,
        ),
        Profile(
            name="opendds",
            title="OpenDDS",
            distributions=(),
            trust=_OPENDDS,
            access=_OPENDDS_ACCESS,
            local=_OPENDDS_LOCAL,
            evidence=Evidence.READ,
        ),
    )
}

_SUPPORTED = ("humble", "jazzy", "kilted", "lyrical")

DEFAULT: tuple[str, ...] = tuple(
    name for name, profile in VARIANTS.items() if name == "spec" or {*_SUPPORTED} & {*profile.distributions}
)
"""`spec` and every variant that a supported distribution ships."""


def _vendor(name: str) -> str:
    return name.rpartition("-")[0]


ALIASES: dict[str, tuple[str, ...]] = {
    # Of a vendor every release that a supported distribution ships: users of one have the older ones, too.
    **{vendor: tuple(name for name in DEFAULT if _vendor(name) == vendor) for vendor in ("fastdds", "cyclonedds")},
    **{
        distribution: tuple(name for name, profile in VARIANTS.items() if distribution in profile.distributions)
        for distribution in (*_SUPPORTED, "rolling")
    },
    "all": tuple(VARIANTS),
}

MIDDLEWARE: dict[str, str] = {
    "rmw_fastrtps_cpp": "fastdds",
    "rmw_fastrtps_dynamic_cpp": "fastdds",
    "rmw_cyclonedds_cpp": "cyclonedds",
}
"""What RMW_IMPLEMENTATION may say, by the vendor whose profiles tell what it does."""

DISTRIBUTIONS: Final = frozenset({*_SUPPORTED, "rolling"})
"""What ROS_DISTRO may say, where it is known here which variants run."""


def resolve(names: Iterable[str]) -> tuple[Profile, ...]:
    """The profiles that `names` (variants or aliases) stand for, in canonical order; none: the default ones.

    Raises UsageError, with the known names and the nearest one, for a name that is neither.
    """
    wanted: set[str] = set()
    for name in names:
        if name in VARIANTS:
            wanted.add(name)
        elif name in ALIASES:
            wanted.update(ALIASES[name])
        else:
            known = [*VARIANTS, *ALIASES]
            raise UsageError(f"Unknown profile {name!r}.{meant(name, known)} Known: {', '.join(known)}.")
    chosen = wanted or set(DEFAULT)
    return tuple(profile for name, profile in VARIANTS.items() if name in chosen)


def in_scope(distributions: Sequence[str], middleware: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """The variants that one of the `distributions` ships, that one of the `middleware` runs on, and that `names` stand
    for; what is empty leaves all. `middleware`: vendors, or what RMW_IMPLEMENTATION says.

    Raises UsageError for what is not known or not modelled, and where no variant is all three.
    """
    for word in middleware:
        if "zenoh" in word:
            raise UsageError(f"--rmw {word}: rmw_zenoh is not modelled; no permissions of a keystore bind it.")
    vendors = [MIDDLEWARE.get(word, word) for word in middleware]
    for option, words, known in (
        ("--distro", distributions, (*_SUPPORTED, "rolling")),
        ("--rmw", middleware, (*dict.fromkeys(MIDDLEWARE.values()), *MIDDLEWARE)),
    ):
        for word in words:
            if word not in known:
                raise UsageError(f"{option}: {word!r} is not one of {', '.join(known)}.{meant(word, known)}")
    shipped = {name for distribution in distributions for name in ALIASES[distribution]}
    found = tuple(
        profile.name
        for profile in resolve(names)
        if (not distributions or profile.name in shipped) and (not vendors or _vendor(profile.name) in vendors)
    )
    if not found:
        raise UsageError("No known implementation is all that --distro, --rmw and --profile say together.")
    return found


def running(distribution: str, middleware: str) -> tuple[str, ...]:
    """The variants that run where ROS_DISTRO and RMW_IMPLEMENTATION say so; all default ones that they leave open.

    Of a distribution that is not known here, every one: which release it ships, we cannot tell.
    """
    shipped = ALIASES["all"] if distribution else DEFAULT
    if distribution in DISTRIBUTIONS:
        shipped = ALIASES[distribution]
    vendor = MIDDLEWARE.get(middleware)
    return tuple(name for name in shipped if vendor is None or _vendor(name) == vendor)
