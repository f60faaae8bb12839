"""Private keys in enclaves' key files that are not their own: whoever has such a file is somebody else too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.comparison import Aspect, Direction, direction_of
from keystore_audit.model.comparison_facts import Fact, Placed
from keystore_audit.model.comparison_sides import Sides

_WORDS = {
    Direction.GAINED: "holds a private key that is not its own",
    Direction.LOST: "no longer holds a private key that is not its own",
    Direction.MIXED: "holds another private key that is not its own",
}


def foreign_keys(sides: Sides) -> Iterator[tuple[str, Placed]]:
    """The enclaves of either keystore in whose key files others' keys came or went, with what that is."""
    holders: dict[str, str] | None = None
    for path in sorted({*sides.enclaves[0], *sides.enclaves[1]}):
        old, new = (_foreign(by_path.get(path)) for by_path in sides.enclaves)
        gone, come = old.keys() - new.keys(), new.keys() - old.keys()
        if not gone and not come:
            continue
        holders = holders or _holders(sides)
        direction = direction_of(gains=bool(come), losses=bool(gone))
        told = [", ".join(sorted({_told(key, holders) for key in keys})) or None for keys in (gone, come)]
        aspect = Aspect(what="private key", old=told[0], new=told[1], direction=direction)
        whose = [_owners(key, sides) for key in gone | come]
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
    first = enclave.certificate.first if enclave.certificate is not None else None
    own = first.key if first is not None else enclave.key.key
    found: dict[str, int | None] = {}
    if enclave.key.key is not None and enclave.key.key != own:
        found[enclave.key.key] = None
    for other in enclave.key.others:
        if other.key is None or other.key != own:
            found.setdefault(other.key or f"unread {enclave.key.file.sha256} {other.line}", other.line)
    return found


def _holders(sides: Sides) -> dict[str, str]:
    """By key the subject of an authority or identity of either keystore."""
    found: dict[str, str] = {}
    for by_path in sides.enclaves:
        for enclave in by_path.values():
            for file in (enclave.permissions_ca, enclave.identity_ca):
                for certificate in file.certificates if file is not None else ():
                    found.setdefault(certificate.key, f"the authority {certificate.subject}")
    for by_path in sides.enclaves:
        for enclave in by_path.values():
            if enclave.certificate is not None and enclave.certificate.first is not None:
                found.setdefault(enclave.certificate.first.key, enclave.certificate.first.subject)
    return found


def _owners(key: str, sides: Sides) -> set[str]:
    """The enclaves of either keystore whose identity has the key; none where it may open anything: an authority's, or
    one that nobody here is known to have.
    """
    owners: set[str] = set()
    for by_path in sides.enclaves:
        for path, enclave in by_path.items():
            for file in (enclave.permissions_ca, enclave.identity_ca):
                if file is not None and any(certificate.key == key for certificate in file.certificates):
                    return set()
            first = enclave.certificate.first if enclave.certificate is not None else None
            if first is not None and first.key == key:
                owners.add(path)
    return owners


def _told(key: str, holders: Mapping[str, str]) -> str:
    if key.startswith("unread "):
        return "one that could not be read"
    return f"{holders.get(key, 'nobody here')} (key {key[:12]})"


def _place(enclave: Enclave | None, lines: Mapping[str, int | None]) -> Location | None:
    if enclave is None or enclave.key is None:
        return None
    return Location(path=enclave.key.file.place, line=next(iter(lines.values()), None))
