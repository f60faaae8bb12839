"""Private keys in enclaves' key files that are not their own: whoever has such a file is somebody else too."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from keystore_audit.findings import Location
from keystore_audit.keystore.key_quality import Place, material_of_keystore, weaknesses
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.comparison.change import Direction, direction_of
from keystore_audit.model.comparison.facts import Fact, Placed, listing
from keystore_audit.model.comparison.sides import Sides

_WORDS = {
    Direction.GAINED: "holds a private key that is not its own",
    Direction.LOST: "no longer holds a private key that is not its own",
    Direction.MIXED: "holds another private key that is not its own",
}


def foreign_keys(sides: Sides) -> Iterator[tuple[str, Placed]]:
    """The enclaves of either keystore in whose key files others' keys came or went, with what that is."""
    holders: _Holders | None = None
    for path in sorted({*sides.enclaves[0], *sides.enclaves[1]}):
        old, new = (_foreign(by_path.get(path)) for by_path in sides.enclaves)
        gone, come = old.keys() - new.keys(), new.keys() - old.keys()
        if not gone and not come:
            continue
        holders = holders or _Holders(sides)
        direction = direction_of(gains=bool(come), losses=bool(gone))
        aspect = listing("private key", set(map(holders.told, gone)), set(map(holders.told, come)), direction)
        whose = [holders.enclaves(key) for key in gone | come]
        fact = Fact(
            "private-key",
            direction,
            f"its key file {_WORDS[direction]}",
            (aspect,),
            touched=tuple(sorted({owner for owners in whose for owner in owners})),
            whole=not all(whose),
        )
        yield path, (fact, _place(sides.enclaves[0].get(path), old), _place(sides.enclaves[1].get(path), new))


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
            found.setdefault(other.key or f"unread {enclave.key.file.sha256} {other.line}", other.line)
    return found


def weak_keys(sides: Sides) -> Iterator[Placed]:
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
    for direction, found in ((Direction.GAINED, come), (Direction.LOST, gone)):
        for (fact, _keys), places in found.items():
            one, other = (_first(places, keystore.root) for keystore in sides.keystores)
            verb = "a key" if direction is Direction.GAINED else "no longer: a key"
            yield Fact("weak-key", direction, f"{verb} {fact}", ()), one, other


def _first(places: Iterable[Place], root: str) -> Location | None:
    return next((Location(path=each.path, line=each.line) for each in places if each.root == root), None)


class _Holders:
    """Whose the keys are in either keystore: authorities', or enclaves' identities."""

    def __init__(self, sides: Sides) -> None:
        self._authorities: dict[str, str] = {}
        self._enclaves: dict[str, dict[str, str]] = {}
        for by_path in sides.enclaves:
            for path, enclave in by_path.items():
                for file in (enclave.permissions_ca, enclave.identity_ca):
                    for certificate in file.certificates if file is not None else ():
                        self._authorities.setdefault(certificate.key, certificate.subject)
                first = enclave.identity
                if first is not None:
                    self._enclaves.setdefault(first.key, {}).setdefault(path, first.subject)

    def told(self, key: str) -> str:
        """Whose the key is, in words."""
        if key.startswith("unread "):
            return "one that could not be read"
        if key in self._authorities:
            return f"the authority {self._authorities[key]} (key {key[:12]})"
        return f"{next(iter(self._enclaves.get(key, {}).values()), 'nobody here')} (key {key[:12]})"

    def enclaves(self, key: str) -> Collection[str]:
        """Whose it is; none where it may open anything: an authority's, or one that nobody here is known to have."""
        return () if key in self._authorities else self._enclaves.get(key, {}).keys()


def _place(enclave: Enclave | None, lines: Mapping[str, int | None]) -> Location | None:
    if enclave is None or enclave.key is None:
        return None
    return Location(path=enclave.key.file.place, line=next(iter(lines.values()), None))
