"""Remedies that several rules give, and how a finding gets its own: with the files of this keystore."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Final

from keystore_audit.dataclass import replace
from keystore_audit.findings import Location
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.remedy import Act, Kind, Remedy, Step, decision, leads_to, mechanical

PLAIN_ENCLAVE: Final = re.compile(r"(?:/\w+)+", re.ASCII)
"""Enclaves as ROS names them. A certificate is issued to no other: its subject might be read otherwise."""

CREATE_PERMISSION: Final = "`ros2 security create_permission KEYSTORE ENCLAVE policy.xml`"
CREATE_ENCLAVE: Final = (
    f"`ros2 security create_enclave KEYSTORE ENCLAVE`, then {CREATE_PERMISSION}, since the first leaves permissions "
    "that allow everything"
)

ISSUE_AGAIN: Final = mechanical("", Act.ISSUE)
RENEW_AUTHORITY: Final = mechanical("", Act.RENEW)
SIGN_AGAIN: Final = mechanical("", Act.SIGN)
SEPARATE: Final = mechanical("", Act.NEW_PERMISSIONS_CA)


def in_governance(text: str) -> Remedy:
    """An edit of the governance. `text` says what to edit, without a stop at its end."""
    return decision(f"{text}.", Act.SIGN_GOVERNANCE)


def in_permissions(text: str) -> Remedy:
    """An edit of an enclave's permissions, or of the policy that they are made from."""
    return decision(f"{text}.", Act.SIGN_PERMISSIONS)


def issue_again(text: str) -> Remedy:
    """Another identity for the enclave, after what `text` says."""
    return mechanical(text, Act.ISSUE)


def sign_again(text: str) -> Remedy:
    """The same document signed again, after what `text` says."""
    return mechanical(text, Act.SIGN)


_DOCUMENTS: Final = {
    Act.SIGN: (Role.GOVERNANCE, Role.PERMISSIONS),
    Act.SIGN_GOVERNANCE: (Role.GOVERNANCE,),
    Act.SIGN_PERMISSIONS: (Role.PERMISSIONS,),
}
_AUTHORITIES: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)
_LINKED: Final = (*_AUTHORITIES, Role.GOVERNANCE)


class Filling:
    """Fills remedies in with the files of one keystore."""

    def __init__(self, keystore: Keystore) -> None:
        """Notes which file is what."""
        self._since_foxy = keystore.layout.kind is LayoutKind.SROS2
        self._keystore = keystore
        self._documents: dict[str, Role] = {}
        self._linked: set[str] = set()
        for enclave in keystore.enclaves:
            for role, file in enclave.files.files.items():
                if role in _LINKED and enclave.path != "/":
                    self._linked.add(file.path)
                if role in _DOCUMENTS[Act.SIGN]:
                    self._documents[file.place] = role
        shared = keystore.layout.governance
        if shared is not None:
            self._documents.setdefault(shared.place, Role.GOVERNANCE)

    def __call__(self, remedy: Remedy, enclave: str | None, locations: Iterable[Location]) -> Remedy:
        """The remedy for a finding about this enclave at these places."""
        at = tuple(dict.fromkeys(place.path for place in locations if not place.beside))
        plain = enclave if enclave is not None and PLAIN_ENCLAVE.fullmatch(enclave) else None
        steps = tuple(self._step(step, enclave, plain, at) for step in remedy.steps)
        lost = any(step.act is not None and not step.paths for step in steps)
        kind = Kind.DECISION if lost and remedy.kind is Kind.MECHANICAL else remedy.kind
        return replace(remedy, kind=kind, steps=steps)

    def _step(self, step: Step, enclave: str | None, plain: str | None, at: tuple[str, ...]) -> Step:
        if step.act is not None:
            paths = tuple(dict.fromkeys(self._paths(step.act, enclave, at))) if self._since_foxy else ()
            return step.at(paths)
        return replace(step, text=step.text.replace("ENCLAVE", plain)) if plain else step

    def _paths(self, act: Act, enclave: str | None, at: tuple[str, ...]) -> Iterable[str]:
        found: dict[Act, Callable[[], Iterable[str]]] = {
            Act.SIGN_ALL: lambda: self._documents,
            Act.NEW_PERMISSIONS_CA: lambda: (*self._authority(Role.PERMISSIONS_CA), *self._documents),
            Act.NEW_IDENTITY_CA: lambda: (*self._authority(Role.IDENTITY_CA), *self._identities(self._plain())),
            Act.ISSUE: lambda: self._identities(self._concerned(enclave, at)),
            Act.RENEW: lambda: self._renewed(at),
            Act.LINK: lambda: (path for path in at if path in self._linked),
            Act.CLOSE_KEY: lambda: at,
            Act.CLOSE: lambda: at,
        }
        return found[act]() if act in found else self._signed(act, enclave, at)

    def _signed(self, act: Act, enclave: str | None, at: tuple[str, ...]) -> list[str]:
        """The documents that the finding is about; of several, where it names no enclave, all."""
        roles = _DOCUMENTS[act]
        told = [path for path in at if self._documents.get(path) in roles]
        beside = [path for place in at if (path := f"{place.removesuffix('.xml')}.p7s") != place]
        told = told or [path for path in beside if self._documents.get(path) in roles]
        own = next((each for each in self._keystore.enclaves if each.path == enclave), None)
        files = [own.files.files[role] for role in roles] if own is not None else []
        mine = [file.place for file in files if file.status in (Status.PRESENT, Status.MISSING)]
        if act is Act.SIGN_PERMISSIONS and own is not None:
            return mine
        if not told and act is Act.SIGN_GOVERNANCE and own is None:
            told = [path for path, role in self._documents.items() if role is Role.GOVERNANCE]
        return (told or mine) if own is None else (told or mine)[:1]

    def _concerned(self, enclave: str | None, at: tuple[str, ...]) -> Iterator[Enclave]:
        """The enclaves whose identity the finding is about."""
        for each in self._keystore.enclaves:
            own = {each.files.files[role].place for role in (Role.CERTIFICATE, Role.KEY)}
            if each.path == enclave or (enclave is None and own & {*at}):
                yield each

    def _plain(self) -> Iterator[Enclave]:
        return (each for each in self._keystore.enclaves if each.certificate is not None)

    def _identities(self, enclaves: Iterable[Enclave]) -> Iterator[str]:
        """Certificate and key of each; nothing at all where the subject of one has to be chosen by somebody."""
        found: list[str] = []
        for each in enclaves:
            identity = each.identity
            usual = identity is None or identity.subject == f"CN={each.path}"
            if not usual or not PLAIN_ENCLAVE.fullmatch(each.path):
                return iter(())
            found += [each.files.files[role].path for role in (Role.CERTIFICATE, Role.KEY)]
        return iter(found)

    def _renewed(self, at: tuple[str, ...]) -> Iterator[str]:
        """The authorities' files among the places, and the documents that name their certificate."""
        files = [file for file in self._keystore.authorities if file.file.place in at and file.certificates]
        yield from dict.fromkeys(file.file.place for file in files)
        keys = {certificate.key for file in files for certificate in file.certificates}
        if any(
            certificate.key in keys
            for each in self._keystore.enclaves
            for certificate in each.trusts(Role.PERMISSIONS_CA)
        ):
            yield from self._documents

    def _authority(self, role: Role) -> Iterator[str]:
        """The key and the certificate of a new authority, and the files of enclaves that hold copies."""
        name = role.value.removesuffix(".cert")
        yield from (f"private/{name}.key.pem", f"public/{name}.cert.pem")
        for each in self._keystore.enclaves:
            file = each.files.files[role]
            if file.status is Status.PRESENT and not leads_to(file.path, file.link, f"public/{name}.cert.pem"):
                yield file.path
