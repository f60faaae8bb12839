"""Which identities several keystores of a run have in common."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from keystore_audit.keystore.descent import display
from keystore_audit.keystore.identity import Beside, Compared, Identity, LooseKey, alike
from keystore_audit.keystore.key_quality import Material, PublicKey, Signed, related_keys, shared_nonces


class Identities:
    """The identities of every keystore of a run, by the number of the keystore."""

    def __init__(self) -> None:
        self._places: dict[int, str] = {}
        self._inside: defaultdict[str, set[str]] = defaultdict(set)
        self._own: dict[int, Compared] = {}
        self._named: dict[int, Collection[str]] = {}
        self._subjects: set[tuple[str, ...]] = set()
        self._by_key: defaultdict[str, set[int]] = defaultdict(set)
        self._by_subject: defaultdict[tuple[tuple[str, ...], str], set[int]] = defaultdict(set)
        self._loose: defaultdict[str, set[int]] = defaultdict(set)
        self._related: dict[int, Material] | None = None

    def add(self, number: int, place: str, compared: Compared, named: Collection[str] = ()) -> None:
        """Take in those of a keystore; `place`: its directory, links resolved; `named`: whom grants name there."""
        self._places[number] = place
        self._named[number] = named
        for parent in Path(place).parents:
            self._inside[str(parent)].add(place)
        self._own[number] = compared
        for loose in compared.keys:
            self._loose[loose.key].add(number)
        for identity in compared.identities:
            self._subjects.add(identity.subject_alike)
            self._by_key[identity.key].add(number)
            for authority in identity.authorities:
                self._by_subject[identity.subject_alike, authority].add(number)

    def of(self, number: int) -> tuple[Identity, ...]:
        """Those of one keystore."""
        return self.compared(number).identities

    def compared(self, number: int) -> Compared:
        """What one keystore was compared by."""
        return self._own.get(number, Compared())

    def beside(self, number: int) -> Beside:
        """What is known of the other keystores to the audit of one."""
        return Beside(shared=self.shared_with(number), compared=self.compared(number), apart=self.within(number))

    def within(self, number: int) -> frozenset[str]:
        """The keystores in the directory of one: where they lie in it, as `layout.Nested.path`."""
        here = self._places[number]
        inside = (os.path.relpath(place, here) for place in self._inside.get(here, ()))
        return frozenset(display(os.fsencode(place)) for place in inside)

    def shared_with(self, number: int) -> Compared:
        """Those of other keystores that have a key, or a subject under one authority, with this one in common; and
        loose keys of theirs that are of identities of this one.

        A subject that a grant names here counts as one of this keystore, and so does a loose key.
        In order of the keystores' numbers. One directory named twice is no other keystore.
        """
        own = self.of(number)
        own_keys = {identity.key for identity in own}
        keys = own_keys.union(loose.key for loose in self.compared(number).keys)
        subjects = {(identity.subject_alike, authority) for identity in own for authority in identity.authorities}
        authorities = {authority for _subject, authority in subjects}
        named = self._subjects.intersection(map(alike, self._named.get(number, ())))  # most are nobody's
        subjects.update((name, authority) for name in named for authority in authorities)
        others: set[int] = set()
        for key in keys:
            others |= self._by_key[key]
        for subject in subjects:
            others.update(self._by_subject.get(subject, ()))
        here = self._places.get(number)
        return Compared(
            identities=tuple(
                identity
                for other in sorted(others)
                if self._places[other] != here
                for identity in self.of(other)
                if identity.key in keys
                or any((identity.subject_alike, authority) in subjects for authority in identity.authorities)
            ),
            keys=tuple(self._lying_elsewhere(own_keys, here)),
            material=self._material().get(number, Material()),
        )

    def _material(self) -> dict[int, Material]:
        """By keystore, the keys and signatures of others that tell something beside its own; of all at once."""
        if self._related is None:
            whose: defaultdict[PublicKey | Signed, set[int]] = defaultdict(set)
            for number, compared in self._own.items():
                for key in compared.material.keys:
                    whose[key].add(number)
                for signature in compared.material.signed:
                    whose[signature].add(number)
            keys = [each for each in whose if isinstance(each, PublicKey)]
            signed = [each for each in whose if isinstance(each, Signed)]
            found: defaultdict[int, dict[PublicKey | Signed, None]] = defaultdict(dict)
            groups: list[Sequence[PublicKey | Signed]] = [*related_keys(keys), *shared_nonces(signed)]
            for group in groups:
                for number in set[int]().union(*(whose[each] for each in group)):
                    for other in group:
                        if number not in whose[other]:
                            found[number][other] = None
            self._related = {
                number: Material(
                    keys=tuple(each for each in others if isinstance(each, PublicKey)),
                    signed=tuple(each for each in others if isinstance(each, Signed)),
                )
                for number, others in found.items()
            }
        return self._related

    def _lying_elsewhere(self, keys: Collection[str], here: str | None) -> Iterator[LooseKey]:
        for other in sorted(set[int]().union(*(self._loose[key] for key in keys if key in self._loose))):
            inside = tuple(f"{path}/" for path in self.within(other))
            if self._places[other] != here:
                yield from (k for k in self._own[other].keys if k.key in keys and not k.path.startswith(inside))
