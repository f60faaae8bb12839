"""Names that users give to enclaves and topics of their own, and what they are in one system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.globs import Globs, named_paths, region_of, topic_regions
from keystore_audit.model.claims.named_enclaves import at_large, means_everybody, named_enclaves, nameless
from keystore_audit.model.claims.stated import check_granted, granted_channels
from keystore_audit.model.formal.claim import PlaceAtom
from keystore_audit.model.formal.system import System


class NamedPlace(Struct, frozen=True, kw_only=True):
    """A name for enclaves, or for topics (`globs`). `place`: where a user gave it, `FILE:LINE`."""

    name: str
    globs: Globs
    place: str


def place_regions(places: Iterable[NamedPlace]) -> tuple[ReadRegion, ...]:
    """The sets of topics that have names: they take part in the classes, so that a name is exact."""
    with_topics = (place.globs.topics for place in places if place.globs.topics)
    return tuple(dict.fromkeys(region for topics in with_topics for region in topic_regions(topics)))


def with_places(
    systems: Sequence[System], places: Sequence[NamedPlace], channels: Channels, keystore: Keystore
) -> tuple[System, ...]:
    """The systems with the places as facts.

    Raises errors.UsageError for a name of something that is not in the keystore: whatever is said of it would be true.
    """
    if not places or not systems:
        return tuple(systems)
    _check(places, systems, channels, keystore)
    known = {enclave.path for enclave in keystore.enclaves}
    return tuple(
        replace(system, places=tuple(_atom(place, system, channels, known) for place in places)) for system in systems
    )


def _check(places: Sequence[NamedPlace], systems: Sequence[System], channels: Channels, keystore: Keystore) -> None:
    """Raises errors.UsageError for globs that find nothing."""
    paths = [enclave.path for enclave in keystore.enclaves]
    used = granted_channels(systems)
    for place in places:
        for glob in place.globs.enclaves:
            named_paths(glob, paths, place.place)
        for glob in place.globs.topics:
            check_granted(glob, channels, used, place.place)


def _atom(place: NamedPlace, system: System, channels: Channels, known: set[str]) -> PlaceAtom:
    """`known`: the paths of enclaves."""
    globs = place.globs.enclaves
    enclaves = named_enclaves(system, globs, known, unread=False)
    if any(map(means_everybody, globs)):
        enclaves |= at_large(system)
    return PlaceAtom(
        name=place.name,
        enclaves=enclaves if globs else None,
        channels=channels.regions[region_of(place.globs.topics)] if place.globs.topics else None,
        unread=bool(globs) and bool(nameless(system, known)),
    )
