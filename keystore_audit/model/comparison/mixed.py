"""Keystores between two: each enclave carries the files of OLD or those of NEW (docs/model.md, Updates)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import cache
from typing import Final

from msgspec.structs import replace

from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.files import File
from keystore_audit.keystore.keystore import Enclave, Keystore, every_certificate
from keystore_audit.keystore.smime import Candidates
from keystore_audit.keystore.typed import GovernanceFile, read_governance, read_permissions
from keystore_audit.keystore.unmanaged import UnmanagedDocument, UnmanagedIdentity
from keystore_audit.model.comparison.sides import BEFORE
from keystore_audit.model.inventory import Typed, governance_says

Version = tuple[str, bool]
"""The path of an enclave, and whether it carries the files of NEW."""

_IDENTITIES: Final = ("found", "copies", "keyless", "locked", "unread")
"""What there is of identities beside enclaves."""


class RollOut:
    """The way from OLD to NEW. Places in OLD begin with `BEFORE`.

    `changing`: the paths of enclaves whose files differ, in order. If only one side has the enclave, its other version
    is that it is not there. `governances_differ`: some enclave gets one that says other things. `added`: the places of
    documents that OLD has not. `leaves_identities`: somebody keeps one that no enclave has any more.
    """

    def __init__(self, old: Keystore, new: Keystore) -> None:
        self._old, self._new = old, new
        signers = Candidates(c for k in (old, new) for c in every_certificate(k.enclaves, k.authorities, ()))

        @cache
        def again(document: Typed) -> Typed:
            """The document in its place in OLD, with all who may have signed it in both."""
            read = read_governance if isinstance(document, GovernanceFile) else read_permissions
            return read(_was(document.signed.file), signers)

        def version(enclave: Enclave) -> Enclave:
            placed = {role: _was(file) for role, file in enclave.files.files.items()}
            own = enclave.certificate
            return replace(
                enclave,
                files=replace(enclave.files, directory=BEFORE + enclave.files.directory, files=placed),
                certificate=own and replace(own, file=_was(own.file)),
                governance=enclave.governance and again(enclave.governance),
                permissions=enclave.permissions and again(enclave.permissions),
            )

        before = gathered((each.path, version(each)) for each in old.enclaves)
        after = gathered((each.path, each) for each in new.enclaves)
        self._beside = [replace(u, file=_was(u.file), document=u.document and again(u.document)) for u in old.unmanaged]
        was = (each for several in before.values() for each in _documents(several))
        self._beside += [UnmanagedDocument(file=each.signed.file, document=each) for each in was]
        paths = sorted({*before, *after})
        self.changing = tuple(p for p in paths if _content(before.get(p, ())) != _content(after.get(p, ())))
        self._same = [each for path in paths if path not in self.changing for each in after[path]]
        held = {each.file.sha256 for each in self._beside}
        come = (*(each.signed.file for each in _documents(new.enclaves)), *(each.file for each in new.unmanaged))
        self.added = frozenset(file.place for file in come if file.sha256 not in held)
        was_said, says = ({path: _says(each) for path, each in side.items()} for side in (before, after))
        self.governances_differ = any(was_said[path] != says[path] for path in was_said.keys() & says)
        sides = enumerate((before, after))
        self._versions = {(path, new): side.get(path, []) for new, side in sides for path in self.changing}
        self.leaves_identities = any(self._gone((path, True) for path in self.changing))

    def keystore(self, versions: Collection[Version]) -> Keystore:
        """That of these versions and of all enclaves that do not change, with what attackers hold by then.

        Of an enclave there may be both versions, or none: no such keystore is on the way, but it holds more, or less.
        Attackers hold every document of OLD, those of NEW that some enclave carries, and identities that enclaves no
        longer have. They hold what lies beside the enclaves of OLD, and of NEW once anything of NEW is in use.
        Where an enclave could not be read at all, OLD or NEW is not decided.
        """
        enclaves = [*self._same, *(each for version in sorted(versions) for each in self._versions[version])]
        used = (self._old, self._new) if any(is_new for _path, is_new in versions) else (self._old,)
        others = (*self._beside, *(each for keystore in used[1:] for each in keystore.unmanaged))
        lying = {each.file.sha256 or each.place: each for each in others}
        carried = {each.signed.file.sha256 for each in _documents(enclaves)}
        gone = (UnmanagedIdentity(certificate=each, key=BEFORE) for each in self._gone(versions))
        beside = {n: tuple(e for keystore in used for e in getattr(keystore.identities, n)) for n in _IDENTITIES}
        return replace(
            used[-1],
            enclaves=tuple(enclaves),
            authorities=tuple(each for keystore in used for each in keystore.authorities),
            unmanaged=tuple(each for digest, each in lying.items() if digest not in carried),
            identities=replace(used[-1].identities, **{**beside, "found": (*beside["found"], *gone)}),
        )

    def _gone(self, versions: Iterable[Version]) -> Iterator[Certificate]:
        """Identities that enclaves had. One with the same name and authority as a present one may do the same."""
        for path in sorted(path for path, is_new in versions if is_new):
            was, now = (
                {
                    (each.identity.subject, each.identity.issuer): each.identity
                    for each in self._versions[path, is_new]
                    if each.identity
                }
                for is_new in (False, True)
            )
            yield from (replace(each, path=BEFORE + each.path) for name, each in was.items() if name not in now)


def _was(file: File) -> File:
    """A file of OLD in a place of its own."""
    return replace(file, path=BEFORE + file.place, resolved=None)


def _says(enclaves: Iterable[Enclave]) -> list[object]:
    return [each.governance and governance_says(each.governance) for each in enclaves]


def _documents(enclaves: Iterable[Enclave]) -> Iterator[Typed]:
    for each in enclaves:
        yield from filter(None, (each.governance, each.permissions))


def _content(enclaves: Iterable[Enclave]) -> object:
    """What is in the files that a run time may read."""
    return tuple((file.status, file.sha256) for each in enclaves for file in each.files.for_run_time)
