"""Whoever has an identity at large, as an enclave: what their own implementation lets them do is asked like one's own.

They start it in a folder with files of their own. The permissions CA is that of some enclave, or peers would have
nothing to do with their permissions. Whom they trust beside it, revocation lists and governance are their own affair,
which no peer looks at: there may be no list, any authorities in both CA files, and any governance that one of them
signed. Of permissions any document that names them will do.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import EnclaveFiles, Role
from keystore_audit.keystore.permissions import PermissionsFile
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.model.inventory import (
    Document,
    TrustFiles,
    governance_at_large,
    identities_at_large,
    may_be_taken,
    named_by_some,
    permissions_at_large,
    trust_files,
)
from keystore_audit.model.participants.at_large import Candidate
from keystore_audit.model.participants.doubt import at_large_doubt, realm_doubt
from keystore_audit.model.participants.lone_endpoints import Alone, Timeline
from keystore_audit.model.trust.verdicts import MAX_AUTHORITIES, may_take
from keystore_audit.profiles import Profile, Trust

MAX_HOLDERS: Final = 4_000
"""Identities at large, each with each document that names it in each realm: as many as enclaves in a large keystore."""


class Holder(Struct, frozen=True, kw_only=True, eq=False):
    """One with a document, in a realm. `identity`: the number of the certificate."""

    identity: int
    realm: TrustFiles
    enclave: Enclave


class Large:
    """The identities at large of a keystore `at` an instant (aware UTC), and who may start with them.

    `numbers`: of certificates, by their SHA-256.
    """

    def __init__(
        self,
        keystore: Keystore,
        numbers: Mapping[str, int],
        documents: Iterable[Document],
        profiles: Sequence[Profile],
        at: datetime,
    ) -> None:
        self._keystore = keystore
        self._numbers = numbers
        self._documents = documents
        self._profiles = profiles
        self._at = at

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """The identities."""
        return tuple(
            Candidate(
                certificate=each.certificate,
                number=self._numbers[each.certificate.sha256],
                doubted=at_large_doubt(each) is not None,
                possible=each.key is not None,
                alone=each.certificate in each.authorities,
            )
            for each in identities_at_large(self._keystore, self._at)
        )

    @cached_property
    def hosts(self) -> dict[TrustFiles, Enclave]:
        """In whose place somebody may start with one; nobody's where there is none. Raises errors.BudgetExceeded."""
        return hosts_of(self._keystore) if self.candidates else {}

    @cached_property
    def unread(self) -> str | None:
        """Where a governance may be that could not be read, with which one may start; None where there is none.

        That of an enclave opens everything already.
        """
        strays = permissions_at_large(self._keystore) if self.candidates else ()
        unread = (s.place for s in strays if not isinstance(s.document, PermissionsFile) or not s.document.permissions)
        return next(unread, None)

    @cached_property
    def holders(self) -> tuple[Holder, ...]:
        """Whoever has one. Raises errors.BudgetExceeded."""
        identities = {each.number: each.certificate for each in self.candidates}
        return holders_of(self.hosts, identities, self._documents, self._profiles)


def hosts_of(keystore: Keystore) -> dict[TrustFiles, Enclave]:
    """In whose place they may start: enclaves, by realm; and with each identity CA file, each permissions CA file and
    each governance there is, without revocation lists.

    Who has no list refuses nobody whom others take, and nobody knows what else stands in its CA files: all authorities
    there are. Where it is unknown whom an enclave trusts, all is open already. Raises errors.BudgetExceeded.
    """
    found = {trust_files(enclave): enclave for enclave in keystore.enclaves}
    known = [enclave for enclave in found.values() if realm_doubt(enclave) is None]
    strays = (stray.document for stray in governance_at_large(keystore))
    several = (*(enclave.governance for enclave in known), *strays)
    governances = {each.signed.file.sha256: each for each in several if isinstance(each, GovernanceFile)}
    trusted = _with_all(enclave.identity_ca for enclave in known)
    for permissions_ca in _with_all(enclave.permissions_ca for enclave in known):
        for governance in governances.values():
            for identity_ca in trusted if may_be_taken(governance.signed, (permissions_ca,)) else ():
                host = _with(known[0], identity_ca, permissions_ca, governance)
                found.setdefault(trust_files(host), host)
    return found


def _with_all(files: Iterable[CertificateFile | None]) -> list[CertificateFile]:
    """Each with the authorities of all behind its own, without revocation lists; those that then are alike once.

    What is behind adds to whom its owner trusts; peers are told what is first. Raises errors.BudgetExceeded.
    """
    distinct = dict.fromkeys(file for file in files if file is not None)
    every = {each.sha256: each for file in distinct for each in file.certificates}
    if len(every) > MAX_AUTHORITIES:
        raise BudgetExceeded(
            f"Whoever has an identity of no enclave may trust all {len(every)} authorities of the enclaves, which "
            f"are more than chains are looked for among (limit {MAX_AUTHORITIES})."
        )
    found: dict[tuple[str, ...], CertificateFile] = {}
    for file in distinct:
        several = {each.sha256: each for each in file.certificates} | every
        same = len(several) == len(file.certificates) and not file.revocation_lists
        certificates = tuple(several.values())
        extended = file if same else replace(file, certificates=certificates, revocation_lists=())
        found.setdefault(tuple(several), extended)
    return [*found.values()]


def _with(
    enclave: Enclave, identity_ca: CertificateFile, permissions_ca: CertificateFile, governance: GovernanceFile
) -> Enclave:
    """The enclave with these files, and without a list of its own."""
    none = replace(enclave.files.files[Role.CRL], status=Status.MISSING, content=None)
    files = replace(enclave.files, files={**enclave.files.files, Role.CRL: none})
    return replace(
        enclave, files=files, identity_ca=identity_ca, permissions_ca=permissions_ca, governance=governance, crl=None
    )


def may_apply(host: Enclave, trust: Trust) -> bool:
    """Whether an implementation takes the host's governance document for the permissions CA's, or perhaps does."""
    return host.governance is None or may_take(host.governance.signed, (host.permissions_ca,), trust)


def holders_of(
    hosts: Mapping[TrustFiles, Enclave],
    identities: Mapping[int, Certificate],
    documents: Iterable[Document],
    profiles: Sequence[Profile],
) -> tuple[Holder, ...]:
    """Everybody who may start with one of these, by number, in place of the `hosts`. Raises errors.BudgetExceeded."""
    if not identities:  # nearly always
        return ()
    files = [document.file for document in documents if isinstance(document.file, PermissionsFile)]
    numbered = tuple(identities)
    named = _named(files, [*identities.values()], profiles)
    if sum(map(len, named)) * len(hosts) > MAX_HOLDERS:
        raise BudgetExceeded(
            f"{len(identities)} identities that are no enclave's own may start in more than {MAX_HOLDERS} ways, with "
            "the documents that name them."
        )
    return tuple(
        Holder(identity=number, realm=realm, enclave=_enclave(identities[number], file, host, count))
        for file, places in zip(files, named, strict=True)
        for number in (numbered[place] for place in sorted(places))
        for count, (realm, host) in enumerate(hosts.items())
    )


def own_endpoints(
    holders: Iterable[Holder], alone: Iterable[Alone], realms: Mapping[TrustFiles, int], *, may: bool
) -> dict[tuple[int, int], list[Timeline]]:
    """By certificate and realm what their own implementation creates, possibly (MAY) or certainly (MUST).

    `alone`: by holder. Whose realm could not be read is left out: there everybody may do anything.
    """
    return gathered(
        ((holder.identity, realms[holder.realm]), each.possible if may else each.certain)
        for holder, each in zip(holders, alone, strict=True)
        if holder.realm in realms
    )


def _named(
    files: Iterable[PermissionsFile], identities: Sequence[Certificate], profiles: Iterable[Profile]
) -> list[frozenset[int]]:
    """By document the identities that one of its grants names, to some implementation."""
    texts = [frozenset(grant.subject_name.text for grant in file.grants) for file in files]
    named = named_by_some(frozenset[str]().union(*texts), identities, profiles)
    return [frozenset[int]().union(*(named[text] for text in each)) for each in texts]


def _enclave(certificate: Certificate, permissions: PermissionsFile, host: Enclave, number: int) -> Enclave:
    """The host's folder with this identity and document in place of its own. `number`: of the host."""
    there = File(path=certificate.path, resolved=certificate.path, status=Status.PRESENT)
    files = dict.fromkeys(Role, there) | {Role.CRL: host.files.files[Role.CRL]}
    directory = f"{number} {certificate.sha256} {permissions.signed.file.place}"  # tells it from others
    return Enclave(
        files=EnclaveFiles(path=certificate.subject, directory=directory, files=files, pkcs11={}, unsigned={}),
        identity_ca=host.identity_ca,
        certificate=CertificateFile(file=there, certificates=(certificate,), revocation_lists=(), defects=()),
        key=PrivateKey(file=there, key=certificate.key, key_kind=certificate.key_kind, encrypted=False, defects=()),
        permissions_ca=host.permissions_ca,
        governance=host.governance,
        permissions=permissions,
        crl=host.crl,
    )
