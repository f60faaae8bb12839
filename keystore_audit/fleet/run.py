"""A run over many keystores: first whose identities they share, then each on its own."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import EXIT_USAGE, UsageError
from keystore_audit.fleet.pools import Lost, Pool, carried_out
from keystore_audit.fleet.task import Audited, Task, carry_out, identify, lost
from keystore_audit.keystore.descent import display
from keystore_audit.keystore.identity import Beside, Compared, Identity, LooseKey, alike
from keystore_audit.keystore.key_quality import Material, PublicKey, Signed, related_keys, shared_nonces
from keystore_audit.keystore.layout import Role, keeps_enclaves_apart, starts_by_itself

# Finds the keystores below a directory.


_ENCLAVES: Final = "enclaves"
"""The folder that makes a directory a keystore since Foxy."""

_FILES: Final = frozenset(
    (
        *(f"{role.value}.{extension}".encode() for role in Role for extension in ("pem", "p11", "p7s")),
        b"ca.cert.pem",
        b"ca.key.pem",
    )
)
"""Files of an enclave, or of the root of a keystore before Foxy."""


class Found(Struct, frozen=True, kw_only=True):
    """What is below a directory, in order of path; paths begin with the directory as it was given.

    `keystores`: each to be audited. `unseen`: what was not looked into, with the reason. That is directories that
    cannot be listed, and links to directories that are not searched, which are not followed.
    """

    keystores: tuple[str, ...]
    unseen: tuple[tuple[str, str], ...]


def find_keystores(directory: str, *, beside: Sequence[str] = ()) -> Found:
    """The topmost directories at or below `directory` that hold `enclaves`, or a file of an enclave or an authority.

    Nothing is left out silently: where such a file is, it belongs to one of the keystores found or is in `unseen`.
    Folders of single enclaves that lie side by side are keystores of their own. So is a keystore or enclave, even an
    incomplete one, within a keystore that has its own below enclaves/. The audit of that judges no others. `beside`:
    other directories that are searched, into which links may lead.
    """
    keystores: list[str] = []
    unseen: list[tuple[str, str]] = []
    searched = [os.path.realpath(each) for each in (directory, *beside)]
    stack = [(directory, False)]
    while stack:
        place, within = stack.pop()
        try:
            with os.scandir(place) as listing:
                entries = sorted(listing, key=lambda entry: os.fsencode(entry.name))
        except OSError as error:
            unseen.append((place, error.strerror or str(error)))
            continue
        names = frozenset(os.fsencode(entry.name) for entry in entries)
        if starts_by_itself(names) or (not within and names & _FILES):
            keystores.append(place)
            if not keeps_enclaves_apart(names):
                continue  # whatever is below is one of its enclaves
            within = True
            entries = [entry for entry in entries if entry.name != _ENCLAVES]  # its audit judges those
        below = [entry for entry in entries if entry.is_dir(follow_symlinks=False)]
        stack.extend((entry.path, within) for entry in reversed(below))
        unseen.extend(_links_out(entries, searched))
    return Found(keystores=tuple(keystores), unseen=tuple(unseen))


def _links_out(entries: list[os.DirEntry[str]], searched: list[str]) -> Iterator[tuple[str, str]]:
    """Links to directories that are not searched in their own place; those that lead nowhere do not count."""
    for entry in entries:
        if not entry.is_symlink():
            continue
        try:
            directory = entry.is_dir()
        except OSError as error:  # in a directory that is closed, or a circle: nobody knows what is there
            yield entry.path, f"a link: {error.strerror or error}"
            continue
        target = os.path.realpath(entry.path)
        if directory and not any(os.path.commonpath((inside, target)) == inside for inside in searched):
            yield entry.path, "a link to a directory elsewhere, which is not followed"


# Which identities several keystores of a run have in common.


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
        """Add those of a keystore; `place`: its directory, links resolved; `named`: subjects that grants name there."""
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
        """The identities of one keystore."""
        return self.compared(number).identities

    def compared(self, number: int) -> Compared:
        """What of one keystore was compared."""
        return self._own.get(number, Compared())

    def beside(self, number: int) -> Beside:
        """What the audit of one keystore knows of the others."""
        return Beside(shared=self.shared_with(number), compared=self.compared(number), apart=self.within(number))

    def within(self, number: int) -> frozenset[str]:
        """The keystores in the directory of one, by their places in it, as `layout.Nested.path`."""
        here = self._places[number]
        inside = (os.path.relpath(place, here) for place in self._inside.get(here, ()))
        return frozenset(display(os.fsencode(place)) for place in inside)

    def shared_with(self, number: int) -> Compared:
        """Identities of other keystores that share a key, or a subject under one authority, with this one. Also loose
        keys of theirs that belong to identities of this one.

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
        """By keystore, the keys and signatures of others that tell something beside its own; for all at once."""
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


Step = Callable[[str, int], None]
"""Told of each step: its name, and how many keystores it is done with."""


def audited(
    tasks: Sequence[Task], pool: Pool | None, step: Step, identities: Identities | None
) -> Generator[tuple[int, Audited], None, None]:
    """Yield the number of each keystore and what became of it, as they come, each exactly once.

    `identities`: filled with those of the keystores before the audits begin; None: a single keystore needs none.
    Raises errors.UsageError for options that make no sense, whatever the keystore. Closing the generator ends what is
    under way.
    """
    without: dict[int, Audited] = {}
    if identities is not None:
        with closing(carried_out(pool, identify, tasks)) as known:
            for done, (number, found) in enumerate(known, start=1):
                if isinstance(found, Lost):  # it might share some
                    without[number] = _ended(tasks[number], found)
                else:
                    identities.add(number, *found)
                step("reading identities", done)
    yield from without.items()
    numbers = [number for number in range(len(tasks)) if number not in without]
    if identities is None or len(tasks) == 1:
        asked: Iterable[Task] = tasks
    else:
        asked = (replace(tasks[number], beside=identities.beside(number)) for number in numbers)
    with closing(carried_out(pool, carry_out, asked)) as results:
        for done, (place, result) in enumerate(results, start=len(without) + 1):
            number = numbers[place]
            outcome = _ended(tasks[number], result) if isinstance(result, Lost) else result
            if outcome.row.exit_code == EXIT_USAGE:
                told = outcome.row.error
                raise UsageError(f"{tasks[number].root}: {told}" if len(tasks) > 1 else told)
            step("auditing", done)
            yield number, outcome


def _ended(task: Task, ended: Lost) -> Audited:
    return lost(task, f"{task.root}: nothing is decided. {ended.reason}")
