"""What of the evidence plays a part in the model: documents, certificates and instants, each once and in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.governance import DomainRange, Governance, GovernanceFile, Text
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Grant, Permissions, PermissionsFile
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.trust import envelope, is_authority
from keystore_audit.model.validity import parse_instant


@dataclass(frozen=True, slots=True)
class Document:
    """A document of the keystore by its place: what it says, if that could be read."""

    place: str
    file: GovernanceFile | PermissionsFile | None
    governance: Governance | None = None
    permissions: Permissions | None = None

    @property
    def readable(self) -> bool:
        """Whether it has a meaning."""
        return self.governance is not None or self.permissions is not None


def dates_of(grant: Grant) -> tuple[datetime, datetime]:
    """The validity of a grant that `readable` has let through."""
    not_before, not_after = parse_instant(grant.not_before.text), parse_instant(grant.not_after.text)
    if not_before is None or not_after is None:
        raise ValueError("a grant whose dates do not parse is no part of a readable document")
    return not_before, not_after


def documents_of(keystore: Keystore) -> tuple[Document, ...]:
    """Every distinct document that an enclave carries, and those it carries that we could not read, by place."""
    found: dict[str, Document] = {}
    for enclave in keystore.enclaves:
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            file = enclave.files.files[role]
            if isinstance(read, GovernanceFile):
                governance = None if unclear(read) else read.governance
                found.setdefault(file.place, Document(file.place, read, governance=governance))
            elif isinstance(read, PermissionsFile):
                permissions = None if unclear(read) else read.permissions
                found.setdefault(file.place, Document(file.place, read, permissions=permissions))
            elif role is Role.PERMISSIONS and file.status.unknown:
                found.setdefault(file.place, Document(file.place, None))
    return tuple(found[place] for place in sorted(found))


@lru_cache(maxsize=16_384)
def unclear(read: GovernanceFile | PermissionsFile) -> tuple[str, int | None] | None:
    """Why a document that parsed has no one meaning, and the line: a date or expression that readers take differently.

    None where it has one, or where it did not parse (its defects tell).
    """
    for text in _expressions(read):
        malformed = parse(text.text, Matcher.POSIX).malformed
        if malformed is not None:
            return f"the expression {text.text!r} {malformed}", text.line
    for range_ in _ranges(read):
        if range_.low is None or range_.high is None:
            return "an <id_range> without <min> or <max>, in which implementations read different domains", range_.line
    if isinstance(read, PermissionsFile) and read.permissions is not None:
        for grant in read.permissions.grants:
            for text in (grant.not_before, grant.not_after):
                if parse_instant(text.text) is None:
                    return f"{text.text!r} is no date that every implementation reads", text.line
    return None


def _ranges(read: GovernanceFile | PermissionsFile) -> Iterator[DomainRange]:
    """Every domain id and range of the document."""
    if isinstance(read, GovernanceFile):
        for rule in read.governance.domain_rules if read.governance else ():
            yield from rule.domains
        return
    for grant in read.permissions.grants if read.permissions else ():
        for permission_rule in grant.rules:
            yield from permission_rule.domains


def _expressions(read: GovernanceFile | PermissionsFile) -> Iterator[Text]:
    """Every topic and partition expression of the document."""
    if isinstance(read, GovernanceFile):
        for rule in read.governance.domain_rules if read.governance else ():
            yield from (topic.expression for topic in rule.topic_rules)
        return
    for grant in read.permissions.grants if read.permissions else ():
        for permission_rule in grant.rules:
            for criterion in permission_rule.criteria:
                yield from criterion.topics
                yield from criterion.partitions or ()


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


def instants_of(
    certificates: Sequence[Certificate], documents: Sequence[Document], at: datetime
) -> tuple[datetime, ...]:
    """Every validity boundary and the audit instant, sorted."""
    instants = {at}
    for certificate in certificates:
        instants.update((certificate.not_before, certificate.not_after))
    for document in documents:
        for grant in document.permissions.grants if document.permissions else ():
            instants.update(dates_of(grant))
    return tuple(sorted(instants))
