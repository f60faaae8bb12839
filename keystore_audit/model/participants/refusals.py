"""Why an implementation creates no participant of an enclave, reason by reason (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import islice
from typing import Final

from cryptography import x509

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.issuer import may_issue, names_itself
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.domains import Interval, contains, elementary
from keystore_audit.model.semantics import ReadDomainRule, ReadGrant
from keystore_audit.model.trust.chain import chain_refusal, path_refusal
from keystore_audit.model.trust.revocation import list_broken, list_missing, list_used, lists_read, revoked
from keystore_audit.model.trust.verdicts import (
    authorities_read,
    document_verdict,
    is_issued,
    is_root,
    may_have_issued,
    may_sign,
    signers_taken,
)
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Access, JoinCheck, Trust
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

UNGOVERNED: Final = ("the governance covers no domain", "the governance does not cover domain")
"""How reasons begin that are about domains, as UNGRANTED: only governance and permissions fix them."""

UNGRANTED: Final = "the grant allows no"
"""How reasons begin that only permissions fix."""

_LOADS_NONE: Final = "it loads no CA signed with"
_LOADS_NOT: Final = "it does not load"
UNLOADED: Final = (_LOADS_NONE, _LOADS_NOT)
"""How reasons begin that are about an authority's file."""

_NOT_ISSUED: Final = "the identity CA did not issue the identity certificate"
_NO_LIST: Final = "no revocation list that it carries can be used for the identity, so every identity is refused"


def absent(enclave: Enclave) -> tuple[str, ...]:
    """Which files are missing."""
    files = ((role, enclave.files.files[role]) for role in REQUIRED if role not in enclave.files.pkcs11)
    return tuple(
        f"{role.value}: {file.detail or file.status.value}"
        for role, file in files
        if file.status is not Status.PRESENT and not file.status.unknown
    )


def other_key(enclave: Enclave) -> bool:
    """Whether the private key is another certificate's."""
    certificate, key = enclave.identity, enclave.key
    return key is not None and key.key is not None and certificate is not None and key.key != certificate.key


def refusals(enclave: Enclave, trust: Trust) -> Iterator[str]:
    """Reasons in its certificates and its key that hold at every instant, in order of the files."""
    yield from absent(enclave)
    certificate = enclave.identity
    if certificate is not None:
        if enclave.key is not None and enclave.key.encrypted:
            yield "the private key is encrypted, and no password is passed"
        elif trust.compares_key and other_key(enclave):
            yield "the private key does not belong to the certificate"
        yield from _chain_refusals(enclave, certificate, trust)
        yield from _certificate_refusals(certificate, enclave.identity_ca, trust)
    yield from _authority_refusals(enclave, trust)


def _certificate_refusals(certificate: Certificate, identity_ca: CertificateFile | None, trust: Trust) -> Iterator[str]:
    """Reasons in what kind of certificate the identity is."""
    if certificate.unknown_critical:
        yield "the identity certificate has a critical extension that no implementation knows"
    authority = identity_ca.first if identity_ca is not None else None
    for kind in dict.fromkeys(each.key_kind for each in (certificate, authority) if each is not None):
        if trust.identity_keys is not None and kind not in trust.identity_keys:
            yield f"it accepts no identity, and no identity CA, with a key of kind {kind}"
    algorithm = certificate.signature_algorithm
    if trust.identity_algorithms is not None and algorithm not in trust.identity_algorithms:
        yield f"it accepts no identity signed with {algorithm}"


def _authority_refusals(enclave: Enclave, trust: Trust) -> Iterator[str]:
    """Reasons in the CA files."""
    for file in dict.fromkeys((enclave.identity_ca, enclave.permissions_ca)):
        if file is None or file.first is None:
            continue
        read = authorities_read(file, trust)
        unknown = trust.ca_algorithms is not None and read[0].signature_algorithm not in trust.ca_algorithms
        if unknown or (trust.strict_authorities and not any(each.sha256 == file.first.sha256 for each in read)):
            # Strictly, the first certificate is verified, and one that was left out has been freed before. That this
            # fails is read, and seen of the same calls on OpenSSL 3.0, not measured on Fast DDS.
            yield f"{_LOADS_NONE} {file.first.signature_algorithm} ({file.file.place})"
        refusal = strict_refusal(file.first) if trust.strict_authorities else None
        if refusal is None and trust.strict_authorities and not names_itself(file.first):
            refusal = chain_refusal(file.first, file, trust)
        if refusal is not None:
            yield f"{_LOADS_NOT} {file.file.place}: {refusal}"
    file = enclave.permissions_ca
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
    verify -x509_strict -check_ss_sig`). One that is not self-signed must meet far more than sros2 writes. So must those
    above it, which are not looked at here.
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


def _chain_refusals(enclave: Enclave, certificate: Certificate, trust: Trust) -> Iterator[str]:
    file = enclave.identity_ca
    if file is None or first_opaque(file.defects) is not None:
        return
    refusal = chain_refusal(certificate, file, trust)
    if refusal is not None:
        yield f"{_NOT_ISSUED}: {refusal}"
    elif list_missing(enclave, certificate, trust):
        yield _NO_LIST


def refusals_at(enclave: Enclave, trust: Trust, at: datetime) -> Iterator[str]:
    """Reasons in its certificates and their revocation that hold `at` an instant (aware UTC) and not at each."""
    certificate, permissions_ca = enclave.identity, enclave.permissions_ca
    if certificate is not None and not in_force(certificate, at):
        yield "the identity certificate is outside its validity"
    if certificate is not None and enclave.identity_ca is not None:
        yield from _chain_refusals_at(certificate, enclave.identity_ca, trust, at, loads=trust.strict_authorities)
    dated = trust.checks_permissions_ca and (trust.first_authority_only or trust.strict_authorities)
    authority = permissions_ca.first if permissions_ca is not None and dated else None
    if authority is not None and not in_force(authority, at):
        yield "the permissions CA certificate is outside its validity"
    if permissions_ca is not None and not trust.pins_signer:
        yield from _signers_refused_at(enclave, permissions_ca, authority, trust, at)
    if certificate is not None:
        yield from _revocations_at(enclave, certificate, trust, at)


def may_refuse_peers(enclave: Enclave, trust: Trust) -> bool:
    """Whether the enclave may refuse anybody for whom an authority of its file vouches (`refusals_of_peer`)."""
    file = enclave.identity_ca
    return file is not None and (len(file.certificates) > 1 or bool(lists_read(enclave, trust)))


def refusals_of_peer(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> Iterator[str]:
    """Why the enclave refuses the certificate's holder, whatever grants say: it asks the same of itself at start."""
    yield from _chain_refusals(enclave, certificate, trust)
    if enclave.identity_ca is not None:
        yield from _chain_refusals_at(certificate, enclave.identity_ca, trust, at)
    yield from _revocations_at(enclave, certificate, trust, at)


def _chain_refusals_at(
    certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime, *, loads: bool = False
) -> Iterator[str]:
    """Why no chain is found at an instant, but is at others: none is in force, or another authority of its name is.
    `loads`: the first certificate of the file is verified when it is loaded (`strict_refusal`).
    """
    if not is_issued(file, certificate, trust):
        return
    if not is_issued(file, certificate, trust, at):
        yield "the identity CA certificate is outside its validity"
    elif loads and file.first is not None and not in_force(file.first, at):
        yield f"{_LOADS_NOT} {file.file.place}: its first certificate is outside its validity"
    refusal = chain_refusal(certificate, file, trust, at)
    known = first_opaque(file.defects) is None
    if known and refusal is not None and chain_refusal(certificate, file, trust) is None:
        yield f"{_NOT_ISSUED}: {refusal}"


def _signers_refused_at(
    enclave: Enclave, permissions_ca: CertificateFile, authority: Certificate | None, trust: Trust, at: datetime
) -> Iterator[str]:
    """What is wrong with the documents' signers `at` an instant, where others than the permissions CA may sign. Dates
    of signers and of the authorities above them count (measured). `authority`: whose own dates are told.
    """
    documents = (Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)
    taken = [
        (role, read.signed)
        for role, read in documents
        if read is not None and document_verdict(read.signed, permissions_ca, trust) is Truth.YES
    ]
    signers = [(each, signed) for _role, signed in taken for each in signers_taken(signed, trust) if each != authority]
    if not all(in_force(signer, at) for signer, _signed in signers):
        yield "the certificate that signed a document is outside its validity"
    elif not all(may_sign(signer, signed, permissions_ca, trust, at) for signer, signed in signers):
        yield "a certificate above the one that signed a document is outside its validity"
    for role, signed in taken:
        lost = path_refusal(signed, permissions_ca, trust, at)
        if lost is not None and path_refusal(signed, permissions_ca, trust) is None:
            yield f"{role.value}.p7s is not validly signed by anybody whom the permissions CA vouches for: {lost}"


def signature_refusal(role: Role, signed: SignedDocument, permissions_ca: CertificateFile, trust: Trust) -> str | None:
    """Why a document's signatures never count; None where they may."""
    verdict = document_verdict(signed, permissions_ca, trust)
    lost = path_refusal(signed, permissions_ca, trust) if verdict is Truth.YES else None
    if verdict is not Truth.NO and lost is None:
        return None
    whom = "the permissions CA" if trust.pins_signer else "anybody whom the permissions CA vouches for"
    return f"{role.value}.p7s is not validly signed by {whom}{f': {lost}' if lost else ''}"


def _revocations_at(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> Iterator[str]:
    """What the revocation list says in which the identity is looked up."""
    lists = lists_read(enclave, trust)
    if not lists:  # nearly always
        return
    if revoked(enclave, (certificate,), trust, at):
        yield "the identity certificate is revoked"
    if list_missing(enclave, certificate, trust, at) and not list_missing(enclave, certificate, trust):
        yield _NO_LIST
    if len(lists) > 1 and list_broken(enclave, certificate, trust, at):
        yield "the newest revocation list is not validly signed, so every identity is refused"
    used = list_used(enclave, certificate, trust, at)
    if used is not None and used.next_update is not None and used.next_update < at:
        yield "the revocation list is stale, so every identity is refused"
    if used is not None and used.this_update > at:
        yield "the revocation list is not yet valid, so every identity is refused"


# Whether a grant lets its holder join a domain, as implementations ask before they create a participant.


Governed = tuple[tuple[Interval, ReadDomainRule], ...]
"""Domains in question, each with the rules of the governance that decide there."""

_BY_DOMAIN: Final = (JoinCheck.ALLOWED_DOMAIN, JoinCheck.LOOSE_TOPIC)
_NOT_JOINING: Final = {
    **dict.fromkeys(_BY_DOMAIN, f"{UNGRANTED} domain that the governance covers"),
    JoinCheck.ANY_ALLOW_RULE: "the grant has no allow rule, and without one no participant is created",
    JoinCheck.TABLE_63: "join access control is on and no topic is without access control, "
    "so no participant is created",
}


def governed(rules: Sequence[ReadDomainRule], domain: int | None, access: Access) -> Governed:
    """The first rule for the domain, or (None) for each that they tell apart; all rules where any counts."""
    asked = elementary(rule.domains for rule in rules) if domain is None else ((domain, domain),)
    most = None if access.any_governance_rule else 1
    return tuple(
        (interval, rule)
        for interval in asked
        for rule in islice((rule for rule in rules if contains(rule.domains, interval[0])), most)
    )


def join_refusals(covered: Governed, grant: ReadGrant, check: JoinCheck) -> Iterator[str]:
    """Why none of the domains can be joined, where that is so."""
    if not _joins(covered, grant, check):
        asked = {interval for interval, _rule in covered}
        low, high = min(asked, default=(0, 232))
        one = check in _BY_DOMAIN and len(asked) == 1 and low == high
        yield f"{UNGRANTED}thing in domain {low}" if one else _NOT_JOINING[check]


def _joins(covered: Governed, grant: ReadGrant, check: JoinCheck) -> bool:
    """Whether the grant lets its holder join one of the domains."""
    if check is JoinCheck.ANY_ALLOW_RULE:
        return any(rule.allow for rule in grant.rules)
    if not covered:
        return True  # that the governance covers no domain is a reason of its own, where it is one
    if check is JoinCheck.TABLE_63:
        return any(not read.rule.enable_join_access_control or _is_loose(read) for _domains, read in covered)
    return any(
        not read.rule.enable_join_access_control
        or (check is JoinCheck.LOOSE_TOPIC and _is_loose(read))
        or grant.default_allow
        or any(low <= upper and lower <= high for each in grant.rules if each.allow for lower, upper in each.domains)
        for (low, high), read in covered
    )


def _is_loose(read: ReadDomainRule) -> bool:
    """Whether some topic of the domain rule has no access control in one direction."""
    topics = read.rule.topic_rules
    return any(not (topic.enable_read_access_control and topic.enable_write_access_control) for topic in topics)
