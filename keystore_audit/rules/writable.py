"""KA1: who may write what enclaves trust, by the modes of files and folders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.files import File
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.remedy import Act, mechanical
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import listed, places
from keystore_audit.text import counted

_GROUP: Final = 0o020
_EVERYBODY: Final = 0o002
_STICKY: Final = 0o1000

_AUTHORITIES: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)


def _written_by_others(file: File) -> bool:
    """Whether others than the owner may write it. Unknown where there are no modes: then nothing is said."""
    mode = file.mode or 0
    return bool(mode & _EVERYBODY or (mode & _GROUP and file.shared_group))


@rule(
    "KA119",
    Severity.HIGH,
    clause="DDS-Security 1.1, 9.3.1 and 9.4.1 (the CA certificates decide who is trusted); CWE-732",
    remedy=mechanical("Compare what is there with what was issued: whoever could write may have done so.", Act.CLOSE),
)
def writable_by_others(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Others than the owner may write CA certificates, folders on the way to what enclaves read, or files of enclaves.

    Whoever may put a CA certificate of his own into the place of both is everybody to those who trust it. What the
    authorities signed nobody can change unseen, but an older document or list of theirs can be put back: a step less.
    Whoever may write cert.p11 or key.p11 can have the enclave use something else on its token: a step less, too. High
    in a tree that goes on a robot (--deployed), medium elsewhere, as in the checkout of a pipeline. CA certificates,
    folders, signed files and addresses of a token are a finding each. A file's group counts unless it is the owner's
    own: where the two have one number, as on distributions that give every user a group (0664 is usual there). A group
    of another number counts even if its user is alone in it: that is known to the machine on which the files are used,
    and to no keystore. In a sticky folder others can add files but replace none: it does not count, unless it is an
    enclave's, where a crl.pem or a `.p11` may be added, which Fast DDS takes before the `.pem`. Who is in a group, who
    owns what, access control lists and folders above the keystore are not looked at.
    """
    enclaves = keystore.layout.enclaves
    authorities = {
        file.place: file
        for file in (
            *keystore.layout.authorities,
            *(by[role] for each in enclaves for by in (each.files, each.pkcs11) for role in _AUTHORITIES if role in by),
        )
    }
    signed = {
        file.place: file
        for each in enclaves
        for role, file in each.files.items()
        if file.place not in authorities and role is not Role.KEY  # KA108 has that one
    }
    addresses = [file for each in enclaves for file in each.pkcs11.values() if file.place not in authorities]
    severity, less = (Severity.HIGH, Severity.MEDIUM) if context.deployed else (Severity.MEDIUM, Severity.LOW)
    trusted = "whoever puts a CA certificate of his own there issues identities or signs rights that the enclaves trust"
    own = {each.directory for each in enclaves}
    folders = [each for each in keystore.layout.folders if each.place in own or not (each.mode or 0) & _STICKY]
    yield from _found(authorities.values(), ("CA certificate", "CA certificates"), trusted, severity)
    replaced = "whoever may write in one replaces what it leads to, with CA certificates of his own"
    yield from _found(folders, ("folder", "folders"), replaced, severity)
    again = "whoever kept an older one of its authority can put it back"
    yield from _found(signed.values(), ("signed file", "signed files"), again, less)
    another = "whoever may write one has its enclave take another key or certificate from the token"
    yield from _found(addresses, ("PKCS #11 address", "PKCS #11 addresses"), another, less)


def _found(files: Iterable[File], called: tuple[str, str], so: str, severity: Severity) -> Iterator[Violation]:
    modes = {file.place: f"{(file.mode or 0) & 0o7777:04o}" for file in files if _written_by_others(file)}
    if modes:
        shown = listed(f"{place} ({mode})" for place, mode in modes.items())
        yield Violation(
            message=f"Others than the owner may write {counted(len(modes), *called)}: {shown}; {so}.",
            locations=places(Location(path=place) for place in modes),
            severity=severity,
            key="\n".join(f"{place} {mode}" for place, mode in sorted(modes.items())),
            contents=False,
        )
