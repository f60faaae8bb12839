"""The canonical variants and their aliases (design section 3).

Trust rows from the project's measurements on the real plugins: `signer` was put to each version
marked measured with documents signed by a leaf of the CA.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from keystore_audit.errors import UsageError
from keystore_audit.model.profiles.profile import Profile

SPEC = Profile(
    name="spec",
    title="DDS-Security 1.1",
    versions="formal/2018-04-01",
    distributions=(),
    pins_signer=True,
    measured=False,
    source="DDS-Security 1.1, 9.4.1.1: the permissions CA signs governance and permissions",
)

VARIANTS: dict[str, Profile] = {
    profile.name: profile
    for profile in (
        SPEC,
        Profile(
            name="fastdds-2.6.4",
            title="Fast DDS up to 2.6.4",
            versions="2.3.6, 2.6.0 to 2.6.4, 2.7.1",
            distributions=("galactic",),
            pins_signer=False,
            measured=False,
            source="eProsima/Fast-DDS tags: PKCS7_NOINTERN only from 2.6.5 on",
        ),
        Profile(
            name="fastdds-2.6",
            title="Fast DDS 2.6",
            versions="2.6.5 to 2.6.12; 2.6.12 measured",
            distributions=("humble",),
            pins_signer=True,
            measured=True,
            source="leaf-signed documents refused by 2.6.12",
        ),
        Profile(
            name="fastdds-2.9",
            title="Fast DDS 2.9.1",
            versions="2.9.1 (Debian's package)",
            distributions=(),
            pins_signer=False,
            measured=True,
            source="leaf-signed documents accepted by 2.9.1",
        ),
        Profile(
            name="fastdds-2.14",
            title="Fast DDS 2.14",
            versions="2.14.5 and 2.14.6; 2.14.6 measured",
            distributions=("jazzy",),
            pins_signer=True,
            measured=True,
            source="leaf-signed documents refused by 2.14.6",
        ),
        Profile(
            name="fastdds-3.2",
            title="Fast DDS 3.2",
            versions="3.2.5",
            distributions=("kilted",),
            pins_signer=True,
            measured=True,
            source="leaf-signed documents refused by 3.2.5",
        ),
        Profile(
            name="fastdds-3.6",
            title="Fast DDS 3.6",
            versions="3.6.2",
            distributions=("lyrical", "rolling"),
            pins_signer=True,
            measured=True,
            source="leaf-signed documents refused by 3.6.2",
        ),
        Profile(
            name="cyclonedds-0.10",
            title="Cyclone DDS 0.10",
            versions="0.10.2 measured; 0.10.5 has the same code",
            distributions=("humble", "jazzy", "kilted"),
            pins_signer=False,
            measured=True,
            source="leaf-signed documents accepted by 0.10.2",
        ),
        Profile(
            name="cyclonedds-11",
            title="Cyclone DDS 11",
            versions="11.0.1",
            distributions=("lyrical", "rolling"),
            pins_signer=True,
            measured=True,
            source="leaf-signed documents refused by 11.0.1",
        ),
        Profile(
            name="opendds",
            title="OpenDDS",
            versions="after 2023-01-18 (read at 2fea234)",
            distributions=(),
            pins_signer=True,
            measured=False,
            source="OpenDDS/OpenDDS:dds/DCPS/security/SSL/SignedDocument.cpp",
        ),
    )
}

ALIASES: dict[str, tuple[str, ...]] = {
    "fastdds": ("fastdds-3.6",),
    "cyclonedds": ("cyclonedds-11",),
    "humble": ("fastdds-2.6", "cyclonedds-0.10"),
    "jazzy": ("fastdds-2.14", "cyclonedds-0.10"),
    "kilted": ("fastdds-3.2", "cyclonedds-0.10"),
    "lyrical": ("fastdds-3.6", "cyclonedds-11"),
    "rolling": ("fastdds-3.6", "cyclonedds-11"),
    "all": tuple(VARIANTS),
}

_SUPPORTED = ("humble", "jazzy", "kilted", "lyrical")

DEFAULT: tuple[str, ...] = tuple(
    name for name in VARIANTS if name == "spec" or any(name in ALIASES[distribution] for distribution in _SUPPORTED)
)
"""`spec` and every variant that a supported distribution ships."""


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
            nearest = get_close_matches(name, known, n=1)
            hint = f" Did you mean {nearest[0]}?" if nearest else ""
            raise UsageError(f"Unknown profile {name!r}.{hint} Known: {', '.join(known)}.")
    chosen = wanted or set(DEFAULT)
    return tuple(profile for name, profile in VARIANTS.items() if name in chosen)
