"""Where each violation of a property stands, so that it can be told whether some finding is its cause.

One cause does not explain whatever else violates the same property. What stands at no place of a cause makes another
violation of it: who accepted the cause's has not accepted that.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from msgspec.structs import replace

from keystore_audit.engine import causes
from keystore_audit.engine.breaches import told
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role as FileRole
from keystore_audit.model.formal.system import Reading, System
from keystore_audit.properties.property import Answer, Role, Status, Witness
from keystore_audit.properties.result import Breach, Place, PropertyResult


def with_places(
    results: Iterable[PropertyResult],
    keystore: Keystore,
    systems: Sequence[System],
    answers: Sequence[Mapping[str, Answer]],
) -> tuple[PropertyResult, ...]:
    """The results, each with what violates it, as far as the native engine keeps it. `answers`: by system."""
    files = _Files(keystore)
    readers = [_Reader(system, files) if system.reading is Reading.MAY else None for system in systems]
    return tuple(
        replace(result, violations=tuple(sorted(set(_breaches(result, readers, answers)), key=lambda each: each.name)))
        for result in results
    )


def _breaches(
    result: PropertyResult, readers: Sequence[_Reader | None], answers: Sequence[Mapping[str, Answer]]
) -> Iterator[Breach]:
    violated = {name for name, each in result.profiles.items() if each.status is Status.VIOLATED}
    for reader, answered in zip(readers, answers, strict=True):
        profiles = violated.intersection(reader.system.profiles) if reader is not None else set()
        if reader is None or not profiles:
            continue
        for witness in answered[result.prop.id].witnesses:
            yield Breach(name=reader.named(witness), places=reader.places(witness), profiles=frozenset(profiles))


class _Files:
    """The files that enclaves and governances are made of, by all their names."""

    def __init__(self, keystore: Keystore) -> None:
        self._enclaves = {enclave.path: enclave for enclave in keystore.enclaves}
        self._held: dict[str, frozenset[Place]] = {}
        self._governances: dict[str, set[str]] = {}
        for enclave in keystore.enclaves:
            file = enclave.files.files[FileRole.GOVERNANCE]
            self._governances.setdefault(file.sha256 or file.place, set()).update((file.path, file.place))

    def of(self, label: str) -> frozenset[Place]:
        """Of an enclave, but its governance; of nobody's none."""
        if label not in self._held and label in self._enclaves:
            files = self._enclaves[label].files
            held = (file for file in files.every if file is not files.files[FileRole.GOVERNANCE])
            paths = {files.directory, *(path for file in held for path in (file.path, file.place))}
            self._held[label] = frozenset(map(Place, paths))
        return self._held.get(label, frozenset())

    def copies(self, path: str) -> Collection[str]:
        """The names of a governance document, by which enclaves have it or one of equal bytes."""
        return next((names for names in self._governances.values() if path in names), {path})


class _Reader:
    """The names and places of what violates a property of one system."""

    def __init__(self, system: System, files: _Files) -> None:
        self.system = system
        self._files = files
        self._names = {number: channel.topic for number, channel in enumerate(system.channels)}
        self._decided: dict[tuple[Location | None, ...], frozenset[Place]] = {}
        self._lines: dict[str, list[int]] = {}
        places = [rule.location for rule in system.domain_rules] + [rule.location for rule in system.topic_rules]
        for place in places:
            self._lines.setdefault(place.path, []).append(place.line or 0)
        for lines in self._lines.values():
            lines.sort()

    def named(self, witness: Witness) -> str:
        """The violation by names that do not hang on the order of atoms."""
        return told(self.system, self._names, witness)

    def places(self, witness: Witness) -> tuple[frozenset[Place], ...]:
        """Where it stands: the rules about its topics and domains, the files of its enclaves, its documents.

        What many have in common is one object.
        """
        system, found = self.system, list[frozenset[Place]]()
        for role, atom in witness.items():
            if role in (Role.CHANNEL, Role.OTHER_CHANNEL, Role.DOMAIN):
                found.append(self._governed(witness[Role.REALM], atom, whole=role is Role.DOMAIN))
            elif role in (Role.ENCLAVE, Role.OTHER):
                enclave = system.enclaves[atom]
                found.append(self._files.of(enclave.label) or frozenset({Place(enclave.location.path)}))
            elif role is Role.DOCUMENT:
                found.append(frozenset(map(Place, self._files.copies(system.documents[atom].location.path))))
            elif role in (Role.CERTIFICATE, Role.OTHER_CERTIFICATE):
                found.append(frozenset({Place(system.certificates[atom].location.path)}))
        return tuple(found)

    def _governed(self, realm: int, atom: int, *, whole: bool) -> frozenset[Place]:
        """The rules that decide about a channel, or (`whole`) a domain; where none does, the document."""
        domain = atom if whole else self.system.channels[atom].domain
        by_domain = causes.domain_rule(self.system, realm, domain)
        by_topic = None if whole else causes.topic_rule(self.system, realm, atom)
        document = causes.governance(self.system, realm)
        key = tuple(None if each is None else each.location for each in (by_domain, by_topic, document))
        if key not in self._decided:
            rules = [location for location in key[:2] if location is not None]
            found = {place for location in rules for place in self._span(location)}
            paths = self._files.copies(document.location.path) if document is not None and not found else ()
            self._decided[key] = frozenset(found or map(Place, paths))
        return self._decided[key]

    def _span(self, location: Location) -> Iterator[Place]:
        """The lines from a rule to the next one, in each copy."""
        lines, first = self._lines[location.path], location.line or 0
        after = bisect_right(lines, first)
        last = lines[after] - 1 if after < len(lines) else None
        for path in self._files.copies(location.path):
            yield Place(path, first, last)
