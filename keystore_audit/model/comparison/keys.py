"""Keys that more than one has: in enclaves' key files, of identities with one key, and those that anybody can have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.key_quality import Place, material_of_keystore, weaknesses
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.model.comparison.change import Direction, direction_of
from keystore_audit.model.comparison.facts import Draft, fact, listing, parted, place_of, placed
from keystore_audit.model.comparison.sides import Sides

_UNREAD: Final = "unread "
_WORDS: Final = {
    Direction.GAINED: "holds a private key that is not its own",
    Direction.LOST: "no longer holds a private key that is not its own",
    Direction.MIXED: "holds another private key that is not its own",
}


def shared_keys(sides: Sides) -> Iterator[Draft]:
    """Enclaves whose identity has the key of another one: whoever holds it has the rights of both."""
    holders = [
        gathered((each.identity.key, path) for path, each in by_path.items() if each.identity is not None)
        for by_path in sides.enclaves
    ]
    for path in sides.common:
        firsts = [by_path[path].identity for by_path in sides.enclaves]
        one, other = (
            set(found[first.key]) - {path} if first is not None else set[str]()
            for found, first in zip(holders, firsts, strict=True)
        )
        if one != other:
            direction = direction_of(other - one, one - other)
            word = "another enclave" if direction is not Direction.LOST else "another enclave no longer"
            aspect = listing("shared with", one, other, direction)
            found = fact("identity-shared", direction, f"its identity has the key of {word}", aspect)
            yield from placed([found], map(place_of, firsts), path)


def foreign_keys(sides: Sides) -> Iterator[Draft]:
    """Enclaves in whose key files others' private keys came or went: whoever has such a file is somebody else too."""
    authorities: dict[str, str] = {}
    owners: dict[str, dict[str, str]] = {}
    for by_path in sides.enclaves:
        for path, enclave in by_path.items():
            for certificate in (*enclave.trusts(Role.PERMISSIONS_CA), *enclave.trusts(Role.IDENTITY_CA)):
                authorities.setdefault(certificate.key, certificate.subject)
            if enclave.identity is not None:
                owners.setdefault(enclave.identity.key, {}).setdefault(path, enclave.identity.subject)

    def told(key: str) -> str:
        if key.startswith(_UNREAD):
            return "one that could not be read"
        if key in authorities:
            return f"the authority {authorities[key]} (key {key[:12]})"
        return f"{next(iter(owners.get(key, {}).values()), 'nobody here')} (key {key[:12]})"

    for path in sorted({*sides.enclaves[0], *sides.enclaves[1]}):
        files = [by_path.get(path) for by_path in sides.enclaves]
        old, new = (_foreign(enclave) for enclave in files)
        gone, come, direction = parted({key: key for key in old}, {key: key for key in new})
        if gone or come:
            aspect = listing("private key", {*map(told, gone)}, {*map(told, come)}, direction)
            # None where it may open anything: an authority's, or one that nobody here is known to have.
            whose = [owners.get(key, {}) if key not in authorities else {} for key in (*gone, *come)]
            found = replace(
                fact("private-key", direction, f"its key file {_WORDS[direction]}", aspect),
                touched=tuple(sorted({owner for each in whose for owner in each})),
                whole=not all(whose),
            )
            places = (_key_file(enclave, lines) for enclave, lines in zip(files, (old, new), strict=True))
            yield from placed([found], places, path)


def _foreign(enclave: Enclave | None) -> Mapping[str, int | None]:
    """By key the line; a key of which it is not known whose it is, by the file."""
    if enclave is None or enclave.key is None:
        return {}
    first = enclave.identity
    own = first.key if first is not None else enclave.key.key
    found: dict[str, int | None] = {}
    if enclave.key.key is not None and enclave.key.key != own:
        found[enclave.key.key] = None
    for other in enclave.key.others:
        if other.key is None or other.key != own:
            found.setdefault(other.key or f"{_UNREAD}{enclave.key.file.sha256} {other.line}", other.line)
    return found


def _key_file(enclave: Enclave | None, lines: Mapping[str, int | None]) -> Location | None:
    if enclave is None or enclave.key is None:
        return None
    return Location(path=enclave.key.file.place, line=next(iter(lines.values()), None))


def weak_keys(sides: Sides) -> Iterator[Draft]:
    """Keys of which anybody can have the private half: by themselves, beside each other, by what they signed.

    What the two keystores tell together is new: whoever has both finds it. A weak key is gone where nobody has it.
    """
    old, new = (material_of_keystore(keystore) for keystore in sides.keystores)
    before, after, together = (
        {(each.fact, each.keys): each.places for each in weaknesses(material)} for material in (old, new, old + new)
    )
    kept = {each.key for each in new.keys}
    come = {name: places for name, places in (together | after).items() if name not in before}
    gone = {name: places for name, places in before.items() if name not in after and kept.isdisjoint(name[1])}
    for direction, verb, found in (
        (Direction.GAINED, "a key", come),
        (Direction.LOST, "no longer: a key", gone),
    ):
        for (said, _keys), places in found.items():
            first = (_first(places, keystore.root) for keystore in sides.keystores)
            yield from placed([fact("weak-key", direction, f"{verb} {said}")], first)


def _first(places: Iterable[Place], root: str) -> Location | None:
    return next((Location(path=each.path, line=each.line) for each in places if each.root == root), None)
