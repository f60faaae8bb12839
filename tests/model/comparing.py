"""Keystores that differ in one thing: written from a description, with the same keys and bytes each time."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from functools import lru_cache
from pathlib import Path

from cryptography.hazmat.primitives.serialization import Encoding
from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.comparison.change import Aspect, Change, Comparison, Consequence
from keystore_audit.model.comparison.compare import compare
from keystore_audit.profiles import Profile, resolve
from tests.keystore.builder import END, Signed, certificate, crl, enclave, key, signed_document, write
from tests.keystore.documents import governance

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)


@lru_cache(maxsize=256)
def authority(name: str, *, end: datetime = END, serial: int = 7) -> Signed:
    return certificate(name, ca=True, key=key(name), serial=serial, end=end)


_issued, _signed, _revoked = (lru_cache(maxsize=4096)(made) for made in (certificate, signed_document, crl))


class Member(Struct, frozen=True, kw_only=True):
    """An enclave: what its permissions say, and what is special about its identity."""

    permissions: str
    subject: str | None = None
    key: str | None = None
    private_key: str | None = None
    serial: int = 100
    end: datetime = END
    ca: bool = False
    issuer: Signed | None = None
    signer: Signed | None = None
    governance: str | None = None
    tampered: bool = False


class Store(Struct, frozen=True, kw_only=True):
    """A keystore of two authorities. `strays`: documents; `files`: whatever lies there, or in place of what is said."""

    members: Mapping[str, Member]
    governance: str = field(default_factory=governance)
    identity: tuple[Signed, ...] = field(default_factory=lambda: (authority("identityCA"),))
    permissions: tuple[Signed, ...] = field(default_factory=lambda: (authority("permissionsCA"),))
    revoked: tuple[int, ...] | None = None
    crl_end: datetime = END
    governance_signer: Signed | None = None
    strays: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)

    def member(self, path: str, **changed: object) -> Store:
        """The same with another member of this path."""
        return replace(self, members={**self.members, path: replace(self.members[path], **changed)})  # type: ignore[arg-type]

    def without(self, path: str) -> Store:
        return replace(self, members={name: member for name, member in self.members.items() if name != path})

    def write(self, root: Path) -> Path:
        for path, member in self.members.items():
            write(root / "enclaves" / path.strip("/"), self._files(path, member))
        strays = {name: _signed(document.encode(), self.permissions[0]) for name, document in self.strays.items()}
        return write(root, {**strays, **self.files})

    def _files(self, path: str, member: Member) -> dict[str, bytes]:
        own = _issued(
            member.subject or path,
            member.issuer or self.identity[0],
            key=key(member.key or path),
            serial=member.serial,
            end=member.end,
            ca=member.ca,
        )
        own = replace(own, key=key(member.private_key)) if member.private_key else own
        authorities = (b"".join(each.pem for each in several) for several in (self.identity, self.permissions))
        document = _signed(member.permissions.encode(), member.signer or self.permissions[0])
        document = document.replace(b"chatter", b"changed") if member.tampered else document
        governance = (member.governance or self.governance).encode()
        governed = _signed(governance, self.governance_signer or self.permissions[0])
        files = enclave(own, *authorities, governed, document)
        if self.revoked is not None:
            files["crl.pem"] = _revoked(self.identity[0], self.revoked, end=self.crl_end).public_bytes(Encoding.PEM)
        return files


def compared(
    old: Store,
    new: Store,
    root: Path,
    profiles: tuple[str, ...] = (),
    *,
    domain: int | None = None,
) -> Comparison:
    """What the program finds, both ways round: one has to be the mirror of the other."""
    chosen: tuple[Profile, ...] = tuple(resolve(profiles))
    one, other = read_keystore(old.write(root / "old")), read_keystore(new.write(root / "new"))
    found = compare(one, other, chosen, AT, domain=domain)
    assert shapes(found, turned=True) == shapes(compare(other, one, chosen, AT, domain=domain))
    return found


Shape = tuple[object, ...]
_OTHER_WAY = {
    "gained": "lost",
    "lost": "gained",
    "enclave-added": "enclave-removed",
    "enclave-removed": "enclave-added",
}


def shapes(found: Comparison, *, turned: bool = False) -> list[Shape]:
    """Everything about the changes but their wording, in order; `turned`: what the other way round has to be found."""
    words = _OTHER_WAY if turned else {}

    def sides(old: object, new: object) -> tuple[object, object]:
        return (new, old) if turned else (old, new)

    def direction(each: Change | Aspect | Consequence) -> str:
        return words.get(each.direction.value, each.direction.value)

    return sorted(
        (
            (
                change.layer.value,
                words.get(change.kind, change.kind),
                direction(change),
                change.enclaves,
                change.operation or "",
                repr(change.names),
                change.profiles,
                repr(sides(change.old, change.new)),
                sorted((a.what, *sides(a.old or "", a.new or ""), direction(a)) for a in change.aspects),
                repr(change.influenced),
                sorted(
                    (direction(c), c.enclaves, repr(c.names), c.profiles, repr(c.influenced))
                    for c in change.consequences
                ),
            )
            for change in found.changes
        ),
        key=repr,
    )
