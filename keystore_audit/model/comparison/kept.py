"""What whoever keeps files of OLD has where peers are those of NEW: documents and identities that lie beside it."""

from __future__ import annotations

from typing import Final

from msgspec.structs import replace

from keystore_audit.keystore.keystore import Keystore, every_certificate
from keystore_audit.keystore.permissions import PermissionsFile, read_permissions
from keystore_audit.keystore.smime import Candidates
from keystore_audit.keystore.stray import Stray
from keystore_audit.keystore.stray_identity import StrayIdentity

BEFORE: Final = "old:"
"""Begins the places of what OLD alone has."""


def with_what_was(old: Keystore, new: Keystore) -> Keystore:
    """NEW, with the documents and the identities beside it that OLD alone has."""
    known = {e.permissions.signed.file.sha256 for e in new.enclaves if e.permissions is not None}
    known |= {stray.file.sha256 for stray in new.strays}
    carried = (enclave.permissions for enclave in old.enclaves)
    strays = (stray.document for stray in old.strays)
    files = [file for file in (*carried, *strays) if isinstance(file, PermissionsFile)]
    gone = {file.signed.file.sha256: file for file in files if file.signed.file.sha256 not in known}
    # An identity of the same name and authority may do what this one may.
    named = {(e.identity.subject, e.identity.issuer) for e in new.enclaves if e.identity is not None}
    owned = [e.identity for e in old.enclaves if e.identity is not None]
    owned += [each.certificate for each in old.identities.found]
    identities = {c.sha256: c for c in owned if (c.subject, c.issuer) not in named}
    if not gone and not identities:
        return new
    signers = Candidates(c for k in (new, old) for c in every_certificate(k.enclaves, k.authorities, ()))
    return replace(
        new,
        strays=(
            *new.strays,
            *(
                Stray(
                    file=replace(file.signed.file, path=BEFORE + file.signed.file.place, resolved=None),
                    document=read_permissions(file.signed.file, signers),
                )
                for file in gone.values()
            ),
        ),
        identities=replace(
            new.identities,
            found=(
                *new.identities.found,
                *(
                    StrayIdentity(certificate=replace(each, path=BEFORE + each.path), key=BEFORE)
                    for each in identities.values()
                ),
            ),
        ),
    )
