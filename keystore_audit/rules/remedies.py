"""Remedies that several rules give, and how a finding gets its own: with the files of this keystore."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Act, FixKind, Location, Remedy, Step, decision, mechanical
from keystore_audit.intent.intent import is_ros_name
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role

CREATE_PERMISSION: Final = "`ros2 security create_permission KEYSTORE ENCLAVE policy.xml`"
CREATE_ENCLAVE: Final = (
    f"`ros2 security create_enclave KEYSTORE ENCLAVE`, then {CREATE_PERMISSION}, since the first alone allows "
    "everything"
)

ISSUE_AGAIN: Final = mechanical("", Act.ISSUE)
RENEW_AUTHORITY: Final = mechanical("", Act.RENEW)
SIGN_AGAIN: Final = mechanical("", Act.SIGN)
LINK_AGAIN: Final = mechanical("", Act.LINK)
SEPARATE: Final = mechanical("", Act.NEW_PERMISSIONS_CA)


def in_governance(text: str) -> Remedy:
    """An edit of the governance. `text` says what to edit, without a stop at its end."""
    return decision(f"{text}.", Act.EDIT_GOVERNANCE)


def in_permissions(text: str) -> Remedy:
    """An edit of an enclave's permissions, or of the policy that they are made from."""
    return decision(f"{text}.", Act.EDIT_PERMISSIONS)


def issue_again(text: str) -> Remedy:
    """Another identity for the enclave, after what `text` says."""
    return mechanical(text, Act.ISSUE)


def sign_again(text: str) -> Remedy:
    """The same document signed again, after what `text` says."""
    return mechanical(text, Act.SIGN)


COVER_DOMAIN: Final = in_governance(
    "Set ROS_DOMAIN_ID to a governed domain, or let the governance cover this one (and <domains> in permissions.xml "
    "too)"
)

ALLOW_DOMAINS: Final = in_permissions(
    "Give the grant an allow rule for every governed domain (sros2 writes that of ROS_DOMAIN_ID: set it as on the "
    "robots)"
)

LINKED: Final = (Role.GOVERNANCE, Role.IDENTITY_CA, Role.PERMISSIONS_CA)
"""Of what sros2 makes a link in each enclave but the root's."""

_DOCUMENTS: Final = {
    Act.SIGN: (Role.GOVERNANCE, Role.PERMISSIONS),
    Act.EDIT: (Role.GOVERNANCE, Role.PERMISSIONS),
    Act.EDIT_GOVERNANCE: (Role.GOVERNANCE,),
    Act.EDIT_PERMISSIONS: (Role.PERMISSIONS,),
}


class Filling:
    """Fills remedies in with the files of one keystore."""

    def __init__(self, keystore: Keystore) -> None:
        """Notes which document is what."""
        self._keystore = keystore
        self._enclaves = keystore.by_path
        self._documents = {
            enclave.files.files[role].place: role for enclave in keystore.enclaves for role in _DOCUMENTS[Act.SIGN]
        }
        if keystore.layout.governance is not None:
            self._documents.setdefault(keystore.layout.governance.place, Role.GOVERNANCE)

    def __call__(self, remedy: Remedy, enclave: str | None, locations: Iterable[Location]) -> Remedy:
        """The remedy for a finding about this enclave at these places."""
        at = tuple(dict.fromkeys(place.path for place in locations if not place.beside))
        steps = tuple(self._step(step, enclave, at) for step in remedy.steps)
        lost = any(step.act is not None and not step.paths for step in steps)
        kind = FixKind.DECISION if lost and remedy.kind is FixKind.MECHANICAL else remedy.kind
        return replace(remedy, kind=kind, steps=steps)

    def _step(self, step: Step, enclave: str | None, at: tuple[str, ...]) -> Step:
        if step.act is not None:
            since_foxy = self._keystore.layout.kind is LayoutKind.SROS2
            return step.at(tuple(dict.fromkeys(self._paths(step.act, enclave, at))) if since_foxy else ())
        if enclave is None or not is_ros_name(enclave):
            return step
        return replace(step, text=step.text.replace("ENCLAVE", enclave))

    def _paths(self, act: Act, enclave: str | None, at: tuple[str, ...]) -> Iterable[str]:
        if act in _DOCUMENTS:
            return self._signed(act, enclave, at)
        if act is Act.NEW_PERMISSIONS_CA:
            return (*self._authority(Role.PERMISSIONS_CA), *self._documents)
        if act is Act.NEW_IDENTITY_CA:
            return (*self._authority(Role.IDENTITY_CA), *_identities(self._keystore.enclaves))
        if act is Act.ISSUE:
            return _identities(self._concerned(enclave, at))
        if act is Act.RENEW:
            return self._renewed(at)
        return self._links(at) if act is Act.LINK else at

    def _signed(self, act: Act, enclave: str | None, at: tuple[str, ...]) -> list[str]:
        """The documents that the finding is about; of several, where it names no enclave, all."""
        roles = _DOCUMENTS[act]
        own = self._enclaves.get(enclave or "")
        files = [own.files.files[role] for role in roles] if own is not None else []
        mine = [file.place for file in files if file.status in (Status.PRESENT, Status.MISSING)]
        if act is Act.EDIT_PERMISSIONS and own is not None:
            return mine
        signed = (place.removesuffix(".xml") + ".p7s" if place.endswith(".xml") else place for place in at)
        told = [path for path in dict.fromkeys(signed) if self._documents.get(path) in roles]
        if own is not None:
            return (told or mine)[:1]
        every = [path for path, role in self._documents.items() if role is Role.GOVERNANCE]
        return told or (every if act is Act.EDIT_GOVERNANCE else [])

    def _concerned(self, enclave: str | None, at: tuple[str, ...]) -> Iterator[Enclave]:
        """The enclaves whose identity the finding is about."""
        for each in self._keystore.enclaves:
            own = {each.files.files[role].place for role in (Role.CERTIFICATE, Role.KEY)}
            if each.path == enclave or (enclave is None and own & {*at}):
                yield each

    def _renewed(self, at: tuple[str, ...]) -> Iterator[str]:
        """The authorities' files among the places, and the documents that name their certificate."""
        files = [file for file in self._keystore.authorities if file.file.place in at and file.certificates]
        yield from (file.file.place for file in files)
        keys = {certificate.key for file in files for certificate in file.certificates}
        trusted = (each.trusts(Role.PERMISSIONS_CA) for each in self._keystore.enclaves)
        if any(certificate.key in keys for certificates in trusted for certificate in certificates):
            yield from self._documents

    def _links(self, at: tuple[str, ...]) -> Iterator[str]:
        linked = {each.files.files[role].path for each in self._keystore.enclaves for role in linked_in(each)}
        return (path for path in at if path in linked)

    def _authority(self, role: Role) -> Iterator[str]:
        """The key and the certificate of a new authority, and the files of enclaves that hold copies."""
        name = role.value.removesuffix(".cert")
        public = f"public/{name}.cert.pem"
        yield from (f"private/{name}.key.pem", public)
        for each in self._keystore.enclaves:
            file = each.files.files[role]
            as_sros2 = f"{'../' * file.path.count('/')}{public}"
            if file.status is Status.PRESENT and file.link != as_sros2:
                yield file.path


def linked_in(enclave: Enclave) -> tuple[Role, ...]:
    """Of what sros2 makes a link in this enclave."""
    return LINKED if enclave.path != "/" else ()


def _identities(enclaves: Iterable[Enclave]) -> tuple[str, ...]:
    """Certificate and key of each; nothing at all where the subject of one has to be chosen by somebody."""
    found: list[str] = []
    for each in enclaves:
        identity = each.identity
        if not is_ros_name(each.path) or (identity is not None and identity.subject != f"CN={each.path}"):
            return ()
        found += [each.files.files[role].path for role in (Role.CERTIFICATE, Role.KEY)]
    return tuple(found)
