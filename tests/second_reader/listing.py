"""The second reader's list of what a keystore holds: enclaves, certificates, keys, messages, who is unmanaged."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from datetime import datetime
from functools import cached_property, partial
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from tests.second_reader import openssl
from tests.second_reader.documents import DomainRule, Grant, governance_in, permissions_in
from tests.second_reader.implementations import Implementation
from tests.second_reader.openssl import Certificate
from tests.second_reader.walk import EnclaveFolder, Tree


class Enclave(Struct, frozen=True, dict=True):
    """An enclave: its first certificate, what its CA files hold, its documents as they lie there."""

    folder: EnclaveFolder
    identity: Certificate | None
    identity_ca: tuple[Certificate, ...]
    permissions_ca: tuple[Certificate, ...]
    governance: bytes | None
    permissions: bytes | None
    crl: bytes | None

    @property
    def trust(self) -> tuple[object, ...]:
        """What its verdict on peers rests on: equal for those that trust alike."""
        files = self.folder.files
        return tuple(files[role].content for role in ("identity_ca", "permissions_ca", "governance", "crl"))

    @property
    def doubtful(self) -> bool:
        """Whether a file on which that rests was not read, or is one of Fast DDS's PKCS#11 references."""
        files = self.folder.files
        unread = any(files[role].unread for role in ("identity_ca", "permissions_ca", "governance", "crl", "cert"))
        return unread or bool(self.folder.p11)


class Bounds(NamedTuple):
    """What an implementation does with the files as they are, and what one may do: in CA files with certificates of
    one name OpenSSL takes the first and tries no other, and what it finds depends on its version and on the order.
    """

    certain: bool
    possible: bool


def _bounds(
    asked: Callable[[tuple[Certificate, ...], tuple[Certificate, ...]], bool],
    anchors: tuple[Certificate, ...],
    added: tuple[Certificate, ...],
) -> Bounds:
    if asked(anchors, ()):
        return Bounds(certain=True, possible=True)
    some = [each for count in range(len(anchors), 0, -1) for each in combinations(anchors, count)]
    # An attacker leaves out what leads OpenSSL astray: it goes to a root that it finds, trusted or not.
    below = tuple(each for each in added if not each.names_itself)
    several = dict.fromkeys((added, below, *((each,) for each in below)))
    return Bounds(certain=False, possible=any(asked(each, more) for each in some for more in several))


class Listing:
    """A keystore's list."""

    def __init__(self, root: Path) -> None:
        self.tree = Tree(root)
        self.contents = {path: self.tree.content(path) for path in self.tree.files}

    @cached_property
    def enclaves(self) -> tuple[Enclave, ...]:
        """By name."""
        return tuple(map(self._enclave, self.tree.enclaves))

    def _enclave(self, folder: EnclaveFolder) -> Enclave:
        content = {role: entry.content for role, entry in folder.files.items()}
        held = {
            role: openssl.certificates_in(content[role] or b"") for role in ("cert", "identity_ca", "permissions_ca")
        }
        if folder.folder == "" and held["cert"]:  # a single enclave's folder goes by its certificate
            common = [part[3:] for part in held["cert"][0].subject.split(",") if part.startswith("CN=/")]
            folder = replace(folder, name=common[0] if common else "/")
        return Enclave(
            folder=folder,
            identity=held["cert"][0] if held["cert"] else None,
            identity_ca=held["identity_ca"],
            permissions_ca=held["permissions_ca"],
            governance=content["governance"],
            permissions=content["permissions"],
            crl=content["crl"],
        )

    @cached_property
    def messages(self) -> dict[bytes, list[str]]:
        """Every signed message, by its bytes, with where it lies."""
        found: dict[bytes, list[str]] = {}
        for path, content in self.contents.items():
            if content is not None and b"pkcs7" in content.lower() and openssl.message_in(content) is not None:
                found.setdefault(content, []).append(path)
        return found

    @cached_property
    def certificates(self) -> dict[str, Certificate]:
        """Every certificate, by SHA-256: of all files, and those that messages bring along."""
        found = {}
        for content in filter(None, self.contents.values()):
            found.update({each.sha256: each for each in openssl.certificates_in(content)})
        for content in self.messages:
            message = openssl.message_in(content)
            found.update({each.sha256: each for each in message.embedded} if message else {})
        return found

    @cached_property
    def keys(self) -> dict[str, list[str]]:
        """By public key the places of its private key."""
        found: dict[str, list[str]] = {}
        for path, content in self.contents.items():
            for key in openssl.keys_in(content) if content is not None else ():
                found.setdefault(key, []).append(path)
        return found

    def says(self, content: bytes) -> tuple[tuple[DomainRule, ...] | None, tuple[Grant, ...] | None]:
        """A message as a governance and as permissions."""
        text = openssl.signed_content(content, tuple(self.certificates.values()))
        return (None, None) if text is None else (governance_in(text), permissions_in(text))

    def anchors(self, enclave: Enclave, role: str, way: Implementation) -> tuple[Certificate, ...]:
        """The certificates of a CA file that an implementation reads."""
        held = enclave.identity_ca if role == "identity_ca" else enclave.permissions_ca
        return held[:1] if way.first_only else held

    def lets_in(self, enclave: Enclave, certificate: Certificate, way: Implementation) -> Bounds:
        """Whether the enclave takes a certificate for an identity of its trust domain, whatever the dates."""
        anchors = self.anchors(enclave, "identity_ca", way)
        how = {"partial": not way.needs_root, "checks_root": way.checks_root}
        return _bounds(lambda some, _all: openssl.chains(certificate, some, **how), anchors, ())

    def usable(self, certificate: Certificate, anchors: tuple[Certificate, ...], way: Implementation) -> Bounds:
        """Whether a certificate of an identity CA file vouches for others."""
        if not certificate.may_issue or not way.needs_root:
            return Bounds(certificate.may_issue, certificate.may_issue)
        return _bounds(lambda some, _all: openssl.chains(certificate, some, checks_root=way.checks_root), anchors, ())

    def obeys(self, enclave: Enclave, content: bytes, way: Implementation) -> Bounds:
        """Whether the enclave takes a document, whatever the dates: as it lies there, or with certificates added."""
        anchors = self.anchors(enclave, "permissions_ca", way)
        if way.pins:
            taken = openssl.pinned_content(content, anchors) is not None
            return Bounds(taken, taken)
        if openssl.chained_content(content, anchors) is not None:
            return Bounds(certain=True, possible=True)
        every = tuple(self.certificates.values())
        if openssl.signed_content(content, every) is None:
            return Bounds(certain=False, possible=False)

        def chain(some: tuple[Certificate, ...], more: tuple[Certificate, ...]) -> bool:
            signers = openssl.signers_in(content, every)
            return all(openssl.chains(each, some, more, signing=True) for each in signers)

        return Bounds(certain=False, possible=_bounds(chain, anchors, every).possible)

    def can_sign(self, enclave: Enclave, key: str, way: Implementation, at: datetime) -> Bounds:
        """Whether who has a key signs what the enclave takes: any certificate of the tree may be embedded.

        A key that may issue makes itself a certificate that may sign. Certain is what no expired one takes part in.
        """
        anchors = self.anchors(enclave, "permissions_ca", way)
        if way.pins or any(each.key == key for each in anchors):
            own_key = any(each.key == key for each in anchors)
            return Bounds(own_key, own_key)

        def signs(each: Certificate, some: tuple[Certificate, ...], more: tuple[Certificate, ...]) -> bool:
            if each.may_sign and openssl.chains(each, some, more, signing=True):
                return True
            return each.may_issue and openssl.chains(each, some, more)

        def by(every: tuple[Certificate, ...]) -> bool:
            own = [each for each in every if each.key == key]
            return any(_bounds(partial(signs, each), anchors, every).possible for each in own)

        certificates = tuple(self.certificates.values())
        return Bounds(by(tuple(each for each in certificates if each.not_after >= at)), by(certificates))

    @cached_property
    def unmanaged(self) -> dict[str, Certificate]:
        """Certificates of no enclave by which somebody may join: their private key is here, or it is an enclave's.

        What stands in a CA file to vouch or to sign is none of these.
        """
        own = {each.identity.sha256 for each in self.enclaves if each.identity is not None}
        own_keys = {each.identity.key for each in self.enclaves if each.identity is not None}
        vouching = {c.sha256 for each in self.enclaves for c in each.identity_ca if c.may_issue}
        signing = {c.sha256 for e in self.enclaves for n, c in enumerate(e.permissions_ca) if n == 0 or c.may_issue}
        return {
            sha256: each
            for sha256, each in self.certificates.items()
            if sha256 not in own | vouching | signing and (each.key in self.keys or each.key in own_keys)
        }

    @staticmethod
    def digest(content: bytes | None) -> str | None:
        """A short name for bytes."""
        return None if content is None else hashlib.sha256(content).hexdigest()[:12]
