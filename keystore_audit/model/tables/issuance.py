"""Who vouches for whom: the certificates of a keystore, what each issued and which documents each signed.

Names and signatures alone count here, as in `CertificateAtom.issuers`; whether a run time accepts a chain at an instant
is `model.trust.verdicts`'s and the properties' question.
"""

from __future__ import annotations

from collections import Counter
from datetime import datetime

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import certificates_of


class IssuedCertificate(Struct, frozen=True, kw_only=True):
    """A certificate and what hangs on it. Names are raw text, dates aware UTC.

    `key_kind` as in `Certificate`. `identity_of`: enclaves whose identity it is; `identity_ca_of`, `permissions_ca_of`:
    how many enclaves trust it as that. `issued`: places among all certificates; `is_root`: no other one issued it.
    `signed`: documents (paths) whose signature it made. `revoked`: some enclave's revocation list takes it back.
    """

    subject: str
    location: Location
    key_kind: str
    signature_algorithm: str
    not_before: datetime
    not_after: datetime
    identity_of: tuple[str, ...]
    identity_ca_of: int
    permissions_ca_of: int
    issued: tuple[int, ...]
    signed: tuple[str, ...]
    is_root: bool
    revoked: bool


class Issuance(Struct, frozen=True, kw_only=True):
    """`certificates` by place. `unsigned`: documents (paths) whose signature none of them made. `unread`: those of
    which that cannot be told.
    """

    certificates: tuple[IssuedCertificate, ...]
    unsigned: tuple[str, ...]
    unread: tuple[str, ...]


def issuance(keystore: Keystore, system: System) -> Issuance:
    """Of the keystore whose `system` this is (its certificates are all systems').

    Those behind them stand for what was not read, or is elsewhere.
    """
    certificates = certificates_of(keystore, system.instants[system.now])
    issued: list[list[int]] = [[] for _ in certificates]
    roots = [True] * len(certificates)
    for number, atom in enumerate(system.certificates[: len(certificates)]):
        for issuer in atom.issuers - {number}:
            issued[issuer].append(number)
            roots[number] = False
    signed: list[list[str]] = [[] for _ in certificates]
    for document in system.documents:
        for signer in document.signers:
            signed[signer].append(document.location.path)
    revoked = {certificate for realm in system.realms for certificate in realm.revoked}
    identities = gathered((each.identity.sha256, each.path) for each in keystore.enclaves if each.identity is not None)
    trusting = {
        role: Counter(sha256 for each in keystore.enclaves for sha256 in {c.sha256 for c in each.trusts(role)})
        for role in (Role.IDENTITY_CA, Role.PERMISSIONS_CA)
    }
    return Issuance(
        certificates=tuple(
            IssuedCertificate(
                subject=certificate.subject,
                location=Location(path=certificate.path, line=certificate.line),
                key_kind=certificate.key_kind,
                signature_algorithm=certificate.signature_algorithm,
                not_before=certificate.not_before,
                not_after=certificate.not_after,
                identity_of=tuple(identities.get(certificate.sha256, ())),
                identity_ca_of=trusting[Role.IDENTITY_CA][certificate.sha256],
                permissions_ca_of=trusting[Role.PERMISSIONS_CA][certificate.sha256],
                issued=tuple(sorted(issued[number], key=lambda n: (certificates[n].subject, n))),
                signed=tuple(sorted(signed[number])),
                is_root=roots[number],
                revoked=number in revoked,
            )
            for number, certificate in enumerate(certificates)
        ),
        unsigned=tuple(each.location.path for each in system.documents if not each.signers and not each.opaque),
        unread=tuple(each.location.path for each in system.documents if each.opaque),
    )
