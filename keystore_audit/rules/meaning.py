"""What findings are about, as digests: who accepts a finding accepts that, and nothing that comes later.

A fingerprint says which finding it is. Its meaning is what the files said then, as they were parsed: without lines and
layout, and of dates only whether they have come. So signing again, reformatting and renewing with the same key change
nothing. A finding of KA1 to KA5 is about what stands at its places. One of KA6 to KA8 is about all that the answer may
rest on. That is every document, certificate, revocation list and file of no enclave, the scope and the assumptions. A
property's finding is also about what violates the property.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from functools import cache, cached_property
from itertools import chain
from operator import attrgetter
from typing import Any, Final

from msgspec import Struct

from keystore_audit.findings import OF_NETWORKS, OF_PROPERTIES
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import CrlFile, RevocationList
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.keystore.typed import DomainRule, GovernanceFile, Grant, PermissionsFile, Rule, TopicRule
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import UserResult
from keystore_audit.rules import registry
from keystore_audit.rules.subjects import instant_of, signed_bytes

_ACROSS: Final = ("KA6", OF_PROPERTIES, OF_NETWORKS)
"""Families of rules whose answers rest on the whole keystore; one also on the files of sessions and routers."""

_LEFT_OUT: Final = {
    *("line", "lines", "default_line", "path", "sha256", "serial", "parsed", "signed_part"),
    *("not_before", "not_after", "this_update", "next_update"),
    *("subject_name", "issuer_name", "subject_der", "issuer_der"),
}
"""Where something stands, how long it is in force, and the forms of what is told already."""

_ORDERED: Final = frozenset({Rule, Grant, DomainRule, TopicRule, Certificate, RevocationList})
"""Of these the first that matches decides."""

_CARRIED: Final = attrgetter("identity_ca", "permissions_ca", "certificate", "key", "crl", "governance", "permissions")
"""What of an enclave is read."""


def told(value: Any, at: datetime) -> str:
    """What a part of a file says at an instant; two that say the same are told alike.

    The order of rules and certificates decides, that of what stands within one does not.
    """
    kind: Any = type(value)
    if kind is Text:  # nearly all
        return f"Text({value.text!r})"
    if isinstance(value, Struct):
        parts = [told(getattr(value, name), at) for name in _fields(kind)]
        return f"{kind.__name__}({','.join([*parts, *_begun(value, at)])})"
    if isinstance(value, (tuple, frozenset)):
        parts = [told(each, at) for each in value]
        ordered = not _ORDERED.isdisjoint(map(type, value))
        return f"({','.join(parts if ordered else sorted(set(parts)))})"
    return repr(value)


def _begun(value: Struct, at: datetime) -> Iterator[str]:
    """Which of the two dates of a part have passed; a date that is none stands for itself."""
    if isinstance(value, Grant):
        for date in (value.not_before, value.not_after):
            instant = instant_of(date)
            yield date.text if instant is None else f"{instant <= at}"
    elif isinstance(value, Certificate):
        yield f"{value.not_before <= at} {value.not_after < at}"
    elif isinstance(value, RevocationList):
        yield f"{value.this_update <= at} {value.next_update is not None and value.next_update < at}"


@cache
def _fields(kind: type[Struct]) -> tuple[str, ...]:
    return tuple(name for name in kind.__struct_fields__ if name not in _LEFT_OUT)


class Meanings:
    """What the findings of one audit are about."""

    def __init__(self, context: registry.Context) -> None:
        self._context = context
        self._keystore = context.keystore

    def of(self, rule: registry.Rule[Any], violation: registry.Violation) -> str:
        """The digest of what a finding is about."""
        if rule.family in _ACROSS:
            network = self._context.network if rule.family == OF_NETWORKS else None
            files = (each.file.sha256 for each in network.processes) if network is not None else ()
            return _digest([self._everything, *files, *self._violating({*violation.properties, rule.name})])
        places = {place.path for place in (*violation.locations, *violation.against) if not place.beside}
        return _digest([self._anchors, *map(self._file, sorted(places))])

    @cached_property
    def _anchors(self) -> str:
        """The keys of those whom enclaves trust."""
        trusted = (
            file for enclave in self._keystore.enclaves for file in (enclave.identity_ca, enclave.permissions_ca)
        )
        keys = {" ".join(each.key for each in file.certificates) for file in trusted if file is not None}
        return "\n".join(sorted(keys))

    @cached_property
    def _everything(self) -> str:
        keystore, context = self._keystore, self._context
        files = {file.path for enclave in keystore.enclaves for file in enclave.files.for_run_time}
        files |= {each.place for each in keystore.unmanaged} | {file.place for file in keystore.identities.unread}
        held = (*keystore.identities.found, *keystore.identities.possible)
        return _digest(
            [
                *map(self._file, sorted(files)),
                *sorted(f"{each.certificate.sha256} {each.key}" for each in held),
                *(profile.name for profile in context.profiles),
                *context.conditions,
                *(f"{part}" for system in context.meaning.systems for part in _wired(system)),
            ]
        )

    def _violating(self, properties: Iterable[str]) -> Iterator[str]:
        """All that violates the properties, and what users assert with them."""
        for result in self._context.results:
            if result.prop.id in properties:
                yield from result.violations
                if isinstance(result, UserResult):
                    yield from (result.meaning, *(result.breaches or ()))

    def _file(self, path: str) -> str:
        """What a file says, and who carries it: a further enclave takes over what was accepted of the file."""
        return f"{path}\0{self._said.get(path, '')}\0{self._carriers.get(path, '')}"

    @cached_property
    def _carriers(self) -> Mapping[str, str]:
        """Of each file that enclaves reach over links, whether all enclaves have it, else which."""
        enclaves = self._keystore.enclaves
        found: dict[str, dict[str, None]] = {}
        names: dict[str, str] = {}
        for enclave in enclaves:
            for file in enclave.files.for_run_time:
                found.setdefault(file.place, {})[enclave.files.directory] = None
                if file.path != file.place:
                    names[file.path] = names[file.place] = file.place
        who = {place: "*" if len(each) == len(enclaves) else "\n".join(each) for place, each in found.items()}
        return {name: who[place] for name, place in names.items()}

    @cached_property
    def _said(self) -> Mapping[str, str]:
        """By path, what each file says: its bytes, or why it was not read, where that is all that is known."""
        keystore = self._keystore
        found = dict(keystore.contents)
        for enclave in keystore.enclaves:
            for file in enclave.files.every:
                found[file.path] = file.sha256 or f"{file.status.value} {file.detail}"
        others = (each.document for each in keystore.unmanaged)
        carried = chain.from_iterable(map(_CARRIED, keystore.enclaves))
        for read in dict.fromkeys((*keystore.authorities, *keystore.authority_keys, *others, *carried)):
            if read is not None:
                file = read.signed.file if isinstance(read, (GovernanceFile, PermissionsFile)) else read.file
                found[file.path] = found[file.place] = self._read(read)
        for enclave in keystore.enclaves:
            if enclave.permissions is not None:  # what it gives depends on who carries it, and where
                file = enclave.permissions.signed.file
                found[file.path] = found[file.place] = f"{found[file.place]}\0{self._holder(enclave, found)}"
        return found

    def _read(self, read: CertificateFile | CrlFile | PrivateKey | GovernanceFile | PermissionsFile) -> str:
        at = self._context.at
        if isinstance(read, PrivateKey):
            return f"{read.file.sha256}" if None in read.keys else " ".join(filter(None, read.keys))
        if isinstance(read, (GovernanceFile, PermissionsFile)):
            typed = read.governance if isinstance(read, GovernanceFile) else read.permissions
            signers = sorted({each.key for made in read.signed.signatures for each in made.verified_by})
            return _digest([signed_bytes(read.signed) if typed is None else told(typed, at), *signers])
        certificates = read.certificates if isinstance(read, CertificateFile) else ()
        rest = read.file.sha256 if read.defects else ""  # what is no certificate stands for itself, byte by byte
        return _digest([told((*certificates, *read.revocation_lists), at), f"{rest}"])

    def _holder(self, enclave: Enclave, found: Mapping[str, str]) -> str:
        """Who may use an enclave's permissions, in which domains, and whether some implementation lets it start."""
        known = self._context.meaning.usability
        usable = {
            f"{known[enclave.files.directory, profile.name].usable.value}"
            for profile in self._context.profiles
            if (enclave.files.directory, profile.name) in known
        }
        documents = (enclave.governance.signed.file,) if enclave.governance is not None else ()
        files = (*documents, *((enclave.certificate.file,) if enclave.certificate is not None else ()))
        return _digest([*(found[file.place] for file in files), *sorted(usable)])


def _wired(system: System) -> Iterator[tuple[object, ...]]:
    """What each node is, and what it is to use by the graphs, launch files and policies that were named."""
    for node in system.nodes:
        used = ((system.channels[number] for number in sorted(each)) for each in (node.publishes, node.subscribes))
        yield node.label, node.enclave, *([(c.domain, c.topic, c.partition) for c in channels] for channels in used)


def _digest(parts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
