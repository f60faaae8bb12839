"""What stands at the places of a finding: who accepts a finding accepts that, and nothing else that comes there.

Without lines, layout and dates of grants: a document that is written or signed again says the same. Of permissions it
is the grant at the place and whether it has an effect, of a file of certificates the certificate there, else all of
the file; of a file that enclaves reach over links also which of them do.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import datetime
from enum import Enum
from functools import cache, cached_property
from itertools import chain
from operator import attrgetter
from typing import Any, Final

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.crl import CrlFile, RevocationList
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.files import File
from keystore_audit.keystore.governance import DomainRule, GovernanceFile, TopicRule
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Grant, PermissionsFile, Rule
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.rules.effect import Effects

_LEFT_OUT: Final = frozenset({"line", "lines", "default_line", "not_before", "not_after"})
"""Where something stands, and how long grants are in force: rules about dates have these in their keys."""

_ORDERED: Final = frozenset({Rule, Grant, DomainRule, TopicRule})
"""Of these the first that matches decides."""

_CARRIED: Final = ("identity_ca", "permissions_ca", "certificate", "key", "crl", "governance", "permissions")
"""What of an enclave is read."""

_At = Callable[[int | None], str]
"""What stands at a line of a file."""


def told(value: Any) -> str:
    """What a typed document or a part of it says; two that say the same are told alike.

    The order of rules decides, that of what stands within one does not.
    """
    kind: Any = type(value)
    if kind is Text:  # nearly all
        return f"Text({value.text!r})"
    said_by = _said_by(kind)
    if said_by is not None:
        return f"{kind.__name__}({','.join(map(told, said_by(value)))})"
    if isinstance(value, tuple):
        parts = [*map(told, value)]
        ordered = not _ORDERED.isdisjoint(map(type, value))
        return f"({','.join(parts if ordered else sorted(set(parts)))})"
    return repr(value.value if isinstance(value, Enum) else value)


@cache
def _said_by(kind: type[Any]) -> Callable[[object], Iterable[object]] | None:
    """What reads the fields of a typed part that say something; None for what has no fields."""
    if not hasattr(kind, "__struct_fields__"):
        return None
    names = [name for name in kind.__struct_fields__ if name not in _LEFT_OUT]
    return attrgetter(*names) if len(names) > 1 else lambda value: [getattr(value, name) for name in names]


def dated(grant: Grant) -> str:
    """Whom the grant names and when it is in force: the key of what is about dates."""
    return f"{grant.subject_name.text} {grant.not_before.text} {grant.not_after.text}"


def signed_bytes(signed: SignedDocument) -> str:
    """What was signed to the letter, whoever signed it and however; of a file without such a text all of it."""
    return signed.file.sha256 or "" if signed.content is None else hashlib.sha256(signed.content).hexdigest()


class Contents:
    """What stands where in a keystore, worked out for the files that findings are about."""

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._keystore = keystore
        self._effects = Effects(keystore, at)

    def at(self, places: Collection[Location]) -> str:
        """A digest of what stands at the places, in whatever order; files that the user named are not asked."""
        found = sorted({f"{place.path}\0{self._at(place)}" for place in places if not place.beside})
        return _digest(found)

    @cached_property
    def everything(self) -> str:
        """A digest of what the files say that enclaves carry, and documents and identities beside them."""
        keystore = self._keystore
        paths = {file.path for enclave in keystore.enclaves for file in enclave.files.for_run_time}
        paths.update(stray.place for stray in keystore.strays)
        paths.update(each.certificate.path for each in keystore.identities.found)
        return self.at([Location(path=path) for path in paths])

    @staticmethod
    def names(places: Collection[Location]) -> str:
        """A digest of the places alone."""
        return _digest(sorted({place.path for place in places if not place.beside}))

    def _at(self, place: Location) -> str:
        known = self._files.get(place.path)
        return f"{known(place.line)}{self._carriers.get(place.path, '')}" if known is not None else ""

    @cached_property
    def _files(self) -> dict[str, _At]:
        """What stands in every file."""
        found = self._unread()
        for file, there in self._read():  # under its name in the enclave and the one that a link leads to
            found[file.path] = found[file.place] = there
        return found

    @cached_property
    def _carriers(self) -> dict[str, str]:
        """Of each file that enclaves reach over links, whether all enclaves have it, else which: a further one there
        takes over what was accepted of the file.
        """
        enclaves = self._keystore.enclaves
        found: dict[str, dict[str, None]] = {}
        names: dict[str, str] = {}
        for enclave in enclaves:
            for file in enclave.files.for_run_time:
                found.setdefault(file.place, {})[enclave.files.directory] = None
                if file.path != file.place:
                    names[file.path] = names[file.place] = file.place
        told = {place: "*" if len(each) == len(enclaves) else "\n".join(each) for place, each in found.items()}
        return {name: f"\0carried {told[place]}" for name, place in names.items()}

    def _unread(self) -> dict[str, _At]:
        """Every file, by its bytes, and of those that could not be read why."""
        found = {path: _always(sha256) for path, sha256 in self._keystore.contents}
        for enclave in self._keystore.enclaves:
            for file in enclave.files.every:
                found[file.path] = _always(file.sha256 or f"{file.status.value} {file.detail}")
        return found

    def _read(self) -> Iterator[tuple[File, _At]]:
        """The files that were understood, by what they say."""
        keystore = self._keystore
        for authority in keystore.authorities:
            yield authority.file, _certificates(authority)
        for key in keystore.authority_keys:
            yield key.file, _always(_key(key))
        for stray in keystore.strays:
            if stray.document is not None:
                yield stray.file, self._document(stray.document)
        every = map(attrgetter(*_CARRIED), keystore.enclaves)
        for read in dict.fromkeys(chain.from_iterable(every)):  # they share most of it
            if isinstance(read, CertificateFile):
                yield read.file, _certificates(read)
            elif isinstance(read, PrivateKey):
                yield read.file, _always(_key(read))
            elif isinstance(read, CrlFile):
                yield read.file, _crl(read)
            elif read is not None:
                yield read.signed.file, self._document(read)

    def _document(self, document: GovernanceFile | PermissionsFile) -> _At:
        grants = document.grants if isinstance(document, PermissionsFile) else ()
        said = cache(lambda: self._told(grants))  # thousands of places may be in one document
        whole = cache(lambda: _whole(document) or " ".join(said()))
        lines = [grant.line or 0 for grant in grants]

        def at(line: int | None) -> str:
            end = bisect_right(lines, line) if line is not None else 0
            return " ".join(said()[bisect_left(lines, lines[end - 1]) : end]) if end else whole()

        return at

    def _told(self, grants: Sequence[Grant]) -> list[str]:
        """What each of the grants says, and what its effect rests on."""
        return [_digest([told(grant), effect]) for grant, effect in zip(grants, self._effects.of(grants), strict=True)]


def _whole(document: GovernanceFile | PermissionsFile) -> str:
    """What a document says as a whole; nothing for grants, each of which is told by itself."""
    if isinstance(document, GovernanceFile):
        governance = document.governance
        return signed_bytes(document.signed) if governance is None else _digest([told(governance)])
    return signed_bytes(document.signed) if document.permissions is None else ""


def _certificates(file: CertificateFile) -> _At:
    by_line: dict[int | None, str] = {each.line: each.sha256 for each in file.certificates}
    whole = cache(lambda: " ".join(_every(file)))
    return lambda line: by_line.get(line) or whole()


def _every(file: CertificateFile) -> Iterator[str]:
    yield from (each.sha256 for each in file.certificates)
    yield from map(_revocations, file.revocation_lists)
    if file.defects:  # what is no certificate stands for itself, byte by byte
        yield file.file.sha256 or ""


def _key(key: PrivateKey) -> str:
    return f"{key.file.sha256}" if None in key.keys else " ".join(filter(None, key.keys))


def _crl(file: CrlFile) -> _At:
    """Worked out where it is asked: every enclave has a copy, and each may revoke thousands."""

    @cache
    def said() -> str:
        lists = " ".join(map(_revocations, file.revocation_lists))
        return f"{lists} {file.file.sha256}" if file.defects else lists

    return lambda _line: said()


def _revocations(revocations: RevocationList) -> str:
    """What a list revokes: it is issued again every few days."""
    return told((revocations.issuer, tuple(sorted(revocations.revoked)), revocations.delta, *sorted(revocations.scope)))


def _always(said: str) -> _At:
    return lambda _line: said


def _digest(parts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
