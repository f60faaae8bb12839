"""Which implementations a verdict is about: aliases, distributions of ROS 2 and middleware (design section 3)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.profiles.peculiarities import Profile
from keystore_audit.profiles.routed import Release
from keystore_audit.profiles.table import FAMILIES, ROUTED, SPEC, VARIANTS
from keystore_audit.text import meant

_SUPPORTED: Final = ("humble", "jazzy", "kilted", "lyrical")

DISTRIBUTIONS: Final = (*_SUPPORTED, "rolling")
"""What ROS_DISTRO may say, where it is known here which variants run."""

DEFAULT: Final[tuple[str, ...]] = tuple(
    name for name, profile in VARIANTS.items() if profile is SPEC or {*_SUPPORTED} & {*profile.distributions}
)
"""`spec` and every variant that a supported distribution ships."""

MIDDLEWARE: Final[Mapping[str, str]] = {word: name for name, family in FAMILIES.items() for word in family.middleware}
"""What RMW_IMPLEMENTATION may say, by the family whose profiles tell what it does."""

ALIASES: Final[Mapping[str, tuple[str, ...]]] = {
    # Of a family every release that a supported distribution ships: users of one have the older ones, too.
    **{
        family: tuple(name for name in DEFAULT if VARIANTS[name].family == family)
        for family in dict.fromkeys(MIDDLEWARE.values())
    },
    **{
        distribution: tuple(name for name, profile in VARIANTS.items() if distribution in profile.distributions)
        for distribution in DISTRIBUTIONS
    },
    "all": tuple(VARIANTS),
}

ROUTING: Final = ("zenoh", "rmw_zenoh_cpp")
"""What --rmw may say of the middleware that routes, of which no permissions bind the processes."""


def resolve(names: Iterable[str]) -> tuple[Profile, ...]:
    """The profiles that `names` (variants or aliases) stand for, in canonical order; none: the default ones.

    Those of `ROUTED` are passed over: `releases`. Raises UsageError, with the known names and the nearest one, for a
    name that is none of all these.
    """
    wanted: set[str] = set()
    for name in names:
        if name in VARIANTS:
            wanted.add(name)
        elif name in ALIASES:
            wanted.update(ALIASES[name])
        elif name not in ROUTED:
            known = [*VARIANTS, *ROUTED, *ALIASES]
            raise UsageError(f"Unknown profile {name!r}.{meant(name, known)} Known: {', '.join(known)}.")
    chosen = wanted or set(DEFAULT)
    return tuple(profile for name, profile in VARIANTS.items() if name in chosen)


def releases(names: Iterable[str]) -> tuple[Release, ...]:
    """Those of the middleware that routes that `names` stand for, as for `resolve`; none: what is shipped."""
    wanted = {*names}
    named = [each for each in ROUTED.values() if each.name in wanted or "all" in wanted]
    shipped = [each for each in ROUTED.values() if wanted & {*each.distributions}]
    return tuple(named or shipped or (each for each in ROUTED.values() if each.distributions))


def in_scope(
    distributions: Sequence[str], middleware: Sequence[str], names: Sequence[str], *, routed: bool = False
) -> tuple[str, ...]:
    """The variants that one of the `distributions` ships, that one of the `middleware` runs on, and that `names` stand
    for; what is empty leaves all. `middleware`: families, or what RMW_IMPLEMENTATION says. `routed`: whether there are
    files of the middleware that routes: then its releases are in scope, too, and chosen alone it leaves all variants.

    Raises UsageError for what is not known, or routes where there are no such files, and where no variant is all three.
    """
    for word in (*middleware, *names):
        if not routed and (word in ROUTING or word in ROUTED):
            raise UsageError(
                f"{word!r}: a keystore's permissions do not bind rmw_zenoh. Name its files with --zenoh DIR, which "
                "audit, can and access take."
            )
    chosen = releases(names)
    middleware = [word for word in middleware if word not in ROUTING]
    for option, words, known in (
        ("--distro", distributions, DISTRIBUTIONS),
        ("--rmw", middleware, (*dict.fromkeys(MIDDLEWARE.values()), *MIDDLEWARE)),
    ):
        for word in words:
            if word not in known:
                raise UsageError(f"{option}: {word!r} is not one of {', '.join(known)}.{meant(word, known)}")
    families = [MIDDLEWARE.get(word, word) for word in middleware]
    found = tuple(
        profile.name
        for profile in resolve(names)
        if (not distributions or not {*distributions}.isdisjoint(profile.distributions))
        if not families or profile.family in families
    )
    if not found:
        raise UsageError("No known implementation matches --distro, --rmw and --profile together.")
    shipping = (each.name for each in chosen if not distributions or {*distributions} & {*each.distributions})
    return (*found, *shipping) if routed else found


def fleets(profiles: Sequence[Profile], runs: Mapping[str, Sequence[str]]) -> tuple[Profile, ...]:
    """Each profile as all run it whom `runs` does not name; by the path of an enclave, what one may run instead.

    Of several the one counts that is shipped with the profile, and that is among `profiles` if one of those is. Where
    that leaves more than one, the specification, which nobody ships, is judged as if all ran it, if others are judged
    too. Raises UsageError of any other profile.
    """
    return tuple(_fleet(profile, profiles, runs) for profile in profiles)


def _fleet(profile: Profile, profiles: Sequence[Profile], runs: Mapping[str, Sequence[str]]) -> Profile:
    others = []
    for path, names in runs.items():
        found = [VARIANTS[name] for name in names]
        found = [each for each in found if {*each.distributions} & {*profile.distributions}] or found
        found = [each for each in found if each in profiles] or found
        if len(found) > 1 and profile == SPEC and len(profiles) > 1:
            return profile
        if len(found) > 1:
            raise UsageError(
                f"{path} may run {' or '.join(each.name for each in found)} in a fleet on {profile.name}: name one as "
                "its profile, or choose a distribution (--distro)."
            )
        others += [(path, each) for each in found if each != profile]
    return replace(profile, others=tuple(others)) if others else profile


def at_work(profiles: Iterable[Profile], names: Collection[str] | None = None) -> tuple[Profile, ...]:
    """The implementations that some enclave runs in a fleet on one of these (of these names), each once."""
    found: dict[str, Profile] = {}
    for profile in (each for each in profiles if names is None or each.name in names):
        found[profile.name] = replace(profile, others=()) if profile.others else profile
        found |= {other.name: other for _path, other in profile.others if other.name not in found}
    return tuple(found.values())


def running(distribution: str, middleware: str) -> tuple[str, ...]:
    """The variants that run where ROS_DISTRO and RMW_IMPLEMENTATION say so; all default ones that they leave open.

    Of a distribution that is not known here, every one: which release it ships, we cannot tell.
    """
    shipped = ALIASES["all"] if distribution else DEFAULT
    if distribution in DISTRIBUTIONS:
        shipped = ALIASES[distribution]
    family = MIDDLEWARE.get(middleware)
    return tuple(name for name in shipped if family is None or VARIANTS[name].family == family)
