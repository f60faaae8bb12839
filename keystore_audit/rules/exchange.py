"""Authorities whose files hold each other's certificate: to sign or issue again would only spoil what is right."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.verdicts import vouches
from keystore_audit.remedy import Remedy, decision

EXCHANGED: Final = "The files of the two authorities hold each other's certificate."

_IN_PUBLIC: Final = decision(
    "Exchange public/identity_ca.cert.pem and public/permissions_ca.cert.pem; likewise the keys in private/ "
    "if they are exchanged too, and copies in enclaves."
)
_COPIES: Final = decision(
    "Exchange identity_ca.cert.pem and permissions_ca.cert.pem in the folders of the enclaves, which have copies of "
    "them; and in public/, and their keys in private/, only where these are exchanged too."
)


def exchange(enclaves: Collection[Enclave], signer: Certificate) -> Remedy | None:
    """What to do where that is so, as far as these enclaves and the signer of a document of theirs tell."""
    exchanged = all(
        any(signer.sha256 == authority.sha256 for authority in enclave.trusts(Role.IDENTITY_CA))
        and enclave.identity is not None
        and any(vouches(authority, enclave.identity) for authority in enclave.trusts(Role.PERMISSIONS_CA))
        for enclave in enclaves
    )
    if not exchanged:
        return None
    authorities = (authority for enclave in enclaves for authority in enclave.trusts(Role.PERMISSIONS_CA))
    return _IN_PUBLIC if any(authority.path.startswith("public/") for authority in authorities) else _COPIES


def exchange_for(enclave: Enclave) -> Remedy | None:
    """The same of one enclave, by whoever signed its documents."""
    documents = (each for each in (enclave.permissions, enclave.governance) if each is not None)
    signers = (c for each in documents for made in each.signed.signatures for c in made.verified_by)
    return next((remedy for signer in signers if (remedy := exchange([enclave], signer)) is not None), None)
