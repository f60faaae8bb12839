"""What of the evidence plays a part in the model: documents, certificates and instants, each once and in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import PermissionsFile
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.trust import envelope, is_authority


@dataclass(frozen=True, slots=True)
class Document:
    """A document of the keystore by its place; `file` is None where it could not be read at all."""

    place: str
    file: GovernanceFile | PermissionsFile | None


def documents_of(keystore: Keystore) -> tuple[Document, ...]:
    """Every distinct document that an enclave carries, and those it carries that we could not read, by place."""
    found: dict[str, Document] = {}
    for enclave in keystore.enclaves:
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            file = enclave.files.files[role]
            if read is not None or (role is Role.PERMISSIONS and file.status.unknown):
                found.setdefault(file.place, Document(file.place, read))
    return tuple(found[place] for place in sorted(found))


def embedded_authorities(documents: Iterable[Document]) -> Iterator[Certificate]:
    """Authorities that signed messages bring along: implementations that do not pin the signer chain over them."""
    for document in documents:
        if document.file is not None and envelope(document.file.signed).signers:
            yield from (certificate for certificate in document.file.signed.embedded if is_authority(certificate))


def certificates_of(keystore: Keystore, documents: Iterable[Document]) -> tuple[Certificate, ...]:
    """Every distinct certificate that plays a part: identities, authorities and signers, by place."""
    found: dict[str, Certificate] = {}
    for enclave in keystore.enclaves:
        for file in (enclave.identity_ca, enclave.permissions_ca):
            for certificate in file.certificates if file else ():
                found.setdefault(certificate.sha256, certificate)
        if enclave.certificate is not None and enclave.certificate.first is not None:
            found.setdefault(enclave.certificate.first.sha256, enclave.certificate.first)
        for document in (enclave.governance, enclave.permissions):
            for signer in envelope(document.signed).signers if document else ():
                found.setdefault(signer.sha256, signer)
    for certificate in embedded_authorities(documents):
        found.setdefault(certificate.sha256, certificate)
    return tuple(sorted(found.values(), key=lambda c: (c.path, c.line, c.sha256)))


def instants_of(certificates: Iterable[Certificate], grants: Iterable[ReadGrant], at: datetime) -> tuple[datetime, ...]:
    """Every validity boundary and the audit instant, sorted."""
    instants = {at}
    for certificate in certificates:
        instants.update((certificate.not_before, certificate.not_after))
    for grant in grants:
        instants.update((grant.not_before, grant.not_after))
    return tuple(sorted(instants))
