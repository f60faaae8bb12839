"""What an enclave mostly has in common with others, and what about it keeps a participant from being created.

Whatever does not depend on the instant is worked out once for all enclaves of which the `Sight` is the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from cryptography import x509

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.issuer import may_issue, names_itself
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.participants.doubt import file_doubts
from keystore_audit.model.trust.chain import chain_refusal
from keystore_audit.model.trust.revocation import lists_carried
from keystore_audit.model.trust.verdicts import (
    authorities_read,
    certificate_alike,
    document_alike,
    envelope,
    is_root,
    may_have_issued,
)
from keystore_audit.profiles import Trust
from keystore_audit.truth import Truth

REQUIRED = (
    Role.IDENTITY_CA,
    Role.CERTIFICATE,
    Role.KEY,
    Role.PERMISSIONS_CA,
    Role.GOVERNANCE,
    Role.PERMISSIONS,
)
"""Files without which rmw_dds_common hands no security to the implementation (its security.cpp)."""


class Sight(NamedTuple):
    """All that bears on whether an enclave starts but what its grants say, and the dates of its certificate.

    `alone`: its directory, where it is like no other, since something in its files is in doubt or revokes.
    """

    alone: str | None

    absent: tuple[str, ...]
    """Reasons."""
    encrypted: bool
    mismatched: bool
    """The private key is another certificate's."""
    certificate: tuple[bool, str, str] | None
    """Whether it has a critical extension that nobody knows, its kind of key and its signature algorithm."""
    identity_ca: CertificateFile | None
    permissions_ca: CertificateFile | None
    governance: GovernanceFile | None
    issued: Certificate | None
    """The first certificate that chains do not tell from its own."""
    signed: SignedDocument | None
    """The first message that is not told from that in which the permissions are."""


def sight_of(enclave: Enclave) -> Sight:
    """What is to be seen of the enclave."""
    certificate, key = enclave.identity, enclave.key
    signed = enclave.permissions.signed if enclave.permissions is not None else None
    listed = enclave.crl is not None or enclave.files.files[Role.CRL].status.unknown or lists_carried(enclave)
    doubtful = file_doubts(enclave) or (signed is not None and envelope(signed).verdict is Truth.UNKNOWN)
    alone, file = bool(listed or doubtful), enclave.identity_ca
    seen = None
    if certificate is not None:
        seen = bool(certificate.unknown_critical), certificate.key_kind, certificate.signature_algorithm
    return Sight(
        alone=enclave.files.directory if alone else None,
        absent=tuple(_absent(enclave)),
        encrypted=key is not None and key.encrypted,
        mismatched=bool(key and key.key is not None and certificate is not None and key.key != certificate.key),
        certificate=seen,
        identity_ca=file,
        permissions_ca=enclave.permissions_ca,
        governance=enclave.governance,
        issued=certificate_alike(certificate, file) if certificate is not None and file is not None else None,
        signed=document_alike(signed) if signed is not None else None,
    )


def _absent(enclave: Enclave) -> Iterator[str]:
    for role in REQUIRED:
        file = enclave.files.files[role]
        if file.status is Status.PRESENT or file.status.unknown or role in enclave.files.pkcs11:
            continue
        yield f"{role.value}: {file.detail or file.status.value}"


def key_refusals(sight: Sight, trust: Trust) -> Iterator[str]:
    """Reasons in the private key."""
    if sight.certificate is None:
        return
    if sight.encrypted:
        yield "the private key is encrypted, and no password is passed"
    elif trust.compares_key and sight.mismatched:
        yield "the private key does not belong to the certificate"


def certificate_refusals(sight: Sight, trust: Trust) -> Iterator[str]:
    """Reasons in what kind of certificate the identity is."""
    if sight.certificate is None:
        return
    unknown_critical, key_kind, algorithm = sight.certificate
    if unknown_critical:
        yield "the identity certificate has a critical extension that no implementation knows"
    authority = sight.identity_ca.first if sight.identity_ca is not None else None
    for kind in dict.fromkeys((key_kind, *((authority.key_kind,) if authority is not None else ()))):
        if trust.identity_keys is not None and kind not in trust.identity_keys:
            yield f"it takes no identity, and no identity CA, with a key of kind {kind}"
    if trust.identity_algorithms is not None and algorithm not in trust.identity_algorithms:
        yield f"it takes no identity signed with {algorithm}"


_LOADS_NONE: Final = "it loads no CA signed with"
_LOADS_NOT: Final = "it does not load"
UNLOADED: Final = (_LOADS_NONE, _LOADS_NOT)
"""How reasons begin that are in what the file of an authority is."""


def authority_refusals(sight: Sight, trust: Trust) -> Iterator[str]:
    """Reasons in the CA files."""
    for file in dict.fromkeys((sight.identity_ca, sight.permissions_ca)):
        if file is None or file.first is None:
            continue
        read = authorities_read(file, trust)
        unknown = trust.ca_algorithms is not None and read[0].signature_algorithm not in trust.ca_algorithms
        if unknown or (trust.strict_authorities and not any(each.sha256 == file.first.sha256 for each in read)):
            # Strictly, the first certificate is verified, and one that was left out has been freed before: that this
            # fails is read, and seen of the same calls on OpenSSL 3.0, not measured on Fast DDS.
            yield f"{_LOADS_NONE} {file.first.signature_algorithm} ({file.file.place})"
        refusal = strict_refusal(file.first) if trust.strict_authorities else None
        if refusal is None and trust.strict_authorities and not names_itself(file.first):
            refusal = chain_refusal(file.first, file, trust)
        if refusal is not None:
            yield f"{_LOADS_NOT} {file.file.place}: {refusal}"
    file = sight.permissions_ca
    if file is None or file.first is None:
        return
    if trust.checks_permissions_ca and not any(is_root(authority) for authority in authorities_read(file, trust)):
        yield f"no certificate that counts in {file.file.place} is self-signed, so the permissions CA is refused"


_WANTED_BELOW_A_ROOT: Final = {
    x509.KeyUsage: "key usage",
    x509.SubjectKeyIdentifier: "subject key identifier",
    x509.AuthorityKeyIdentifier: "authority key identifier",
}
"""What X509_STRICT asks of an authority in a chain of several (x509_vfy.c, check_extensions)."""


def strict_refusal(authority: Certificate) -> str | None:
    """Why the first certificate of a CA file fails X509_verify_cert with X509_STRICT; None where it does not.

    As Fast DDS since 2.6.10, 2.14.5 and 3.2 verifies it when it loads the file (FileProvider.cpp; checked with `openssl
    verify -x509_strict -check_ss_sig`). Of one that is not self-signed far more is asked than sros2 writes; the same is
    asked of those above it, which are not looked at here.
    """
    if not names_itself(authority):
        present = {type(extension.value): extension.critical for extension in authority.parsed.extensions}
        missing = [name for extension, name in _WANTED_BELOW_A_ROOT.items() if extension not in present]
        if missing:
            return f"its first certificate is not self-signed and has no {', no '.join(missing)}"
        if present.get(x509.BasicConstraints) is False:
            return "its first certificate is not self-signed, and its basic constraints are not critical"
        return None
    if not may_have_issued(authority, authority):
        return "its first certificate names itself, and another key signed it"
    if authority.is_ca is None and may_issue(authority):
        return "its first certificate does not say that it is an authority"
    if authority.is_ca and not may_issue(authority):
        return "the key usage of its first certificate does not admit signing certificates"
    return None
