"""Identities that are no enclave's own (`inventory.unmanaged_identities`) as participants of a system.

Whoever has such a certificate's key joins under it, with the grants of its subject, and peers cannot tell. Where
nothing of that is unknown, they are in both readings. MAY has to have them, or a flow over them would be missing. MUST
has to have them as well, since peers let them in for certain. Else a doubt about something else would make their acts
unknown. `model.claims.claims` sees to it that nothing good rests on them.

What their own implementation lets them do is asked as of an enclave. They start it in a folder with files of their own.
The permissions CA is some enclave's, or peers would reject their permissions. Peers look at none of the other files:
whom they trust beside it, revocation lists and governance. There may be no list, any authorities in both CA files, and
any governance that one of them signed. Of permissions, any document that names them will do.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import EnclaveFiles, Role
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.keystore.unmanaged import UnmanagedIdentity
from keystore_audit.model.formal.system import CertificateAtom, Participant, ParticipantKind, TrustDomainAtom
from keystore_audit.model.inventory import (
    Document,
    TrustFiles,
    behind,
    governance_alike,
    may_be_taken,
    named_by_some,
    trust_files,
    unmanaged_governance,
    unmanaged_identities,
    unmanaged_permissions,
)
from keystore_audit.model.participants.doubt import opens, trust_domain_doubt, unmanaged_doubt
from keystore_audit.model.participants.lone_endpoints import Alone, Endpoints, Timeline, joined, made_alone, within
from keystore_audit.model.trust.verdicts import MAX_AUTHORITIES, may_take
from keystore_audit.profiles import Profile, Trust
from keystore_audit.text import shorten

MAX_SUBJECT: Final = 160
"""Characters of a subject in the name of its identity."""

MAX_PARTICIPANTS: Final = 2_000
"""Participants that are no enclaves; in large keystores each costs as much as an enclave does."""

MAX_HOLDERS: Final = 4_000
"""Identities, each with the documents that name it in each trust domain: as many as enclaves."""

Holder = tuple[int, TrustFiles, Enclave]
"""A holder of an identity: the number of its certificate, a trust domain, and the folder that it starts with."""


class Unmanaged:
    """The unmanaged identities of a keystore `at` an instant (aware UTC), and who may start with them.

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
        self.identities = unmanaged_identities(keystore, at)

    def number(self, each: UnmanagedIdentity) -> int:
        """The number of its certificate."""
        return self._numbers[each.certificate.sha256]

    @cached_property
    def hosts(self) -> dict[TrustFiles, Enclave]:
        """In whose place somebody may start with an unmanaged identity; empty without any. Raises BudgetExceeded."""
        return _hosts(self._keystore) if self.identities else {}

    @cached_property
    def unread(self) -> str | None:
        """Where an unread governance may be with which an unmanaged identity may start; None where there is none.

        An unread one of an enclave opens everything already.
        """
        others = unmanaged_permissions(self._keystore) if self.identities else ()
        unread = (o.place for o in others if not isinstance(o.document, PermissionsFile) or not o.document.permissions)
        return next(unread, None)

    @cached_property
    def holders(self) -> tuple[Holder, ...]:
        """Everybody who may start with one, with each document that names it. Raises errors.BudgetExceeded."""
        if not self.identities:  # nearly always
            return ()
        files = [document.file for document in self._documents if isinstance(document.file, PermissionsFile)]
        certificates = [each.certificate for each in self.identities]
        named = _named(files, certificates, self._profiles)
        if sum(map(len, named)) * len(self.hosts) > MAX_HOLDERS:
            raise BudgetExceeded(
                f"{len(certificates)} identities without an enclave may start in more than {MAX_HOLDERS} ways, with "
                "the documents that name them."
            )
        return tuple(
            (self.number(self.identities[place]), files_of, _folder(certificates[place], file, host, count))
            for file, places in zip(files, named, strict=True)
            for place in sorted(places)
            for count, (files_of, host) in enumerate(self.hosts.items())
        )

    def let_in(
        self,
        enclaves: Iterable[Participant],
        trust_domains: Sequence[TrustDomainAtom],
        certificates: Sequence[CertificateAtom],
        *,
        may: bool,
    ) -> list[UnmanagedIdentity]:
        """Those that some enclave takes for one of its trust domain, possibly (MAY) or certainly (MUST). Others have
        no peers, whatever they start with.
        """
        peers = [trust_domains[number] for number in sorted({enclave.trust_domain for enclave in enclaves})]
        asked = (each for each in self.identities if may or (each.held and unmanaged_doubt(each) is None))
        return [each for each in asked if any(self.admits(peer, each, certificates) for peer in peers)]

    def admits(
        self, trust_domain: TrustDomainAtom, each: UnmanagedIdentity, certificates: Sequence[CertificateAtom]
    ) -> bool:
        """Whether members of the trust domain take who has the certificate for one of theirs, whatever the dates.

        One in an identity CA file itself is no authority of a trust domain. So any trust domain may be the one that
        takes it.
        """
        number = self.number(each)
        issuers = certificates[number].issuers & trust_domain.identity_ca
        vouched = each.certificate in each.authorities or any(certificates[issuer].authority for issuer in issuers)
        return vouched and number not in trust_domain.always_revoked

    def participants(
        self,
        let_in: Iterable[UnmanagedIdentity],
        enclaves: Sequence[Participant],
        trust_domains: Sequence[TrustDomainAtom],
        certificates: Sequence[CertificateAtom],
        names: Mapping[Hashable, frozenset[int]],
        own: Mapping[tuple[int, int], Sequence[Timeline]],
    ) -> Iterator[Participant]:
        """The identities that a trust domain lets in, in each that does.

        Its trust domain matters for what it accepts itself. Nobody knows which files it starts with (`hosts`): an
        enclave with its key need not use its own files, nor need anybody else.
        `names`: the certificates that subjects of grants mean. `own`: by certificate and trust domain, the endpoints
        that their implementation creates with each document that names them. Left out is one that peers cannot
        distinguish from an enclave's own identity, or from another, if it has no further endpoints: it adds nothing. A
        renewed certificate is one. Raises errors.BudgetExceeded.
        """
        let_in = tuple(let_in)
        if not let_in:  # nearly always
            return
        told = _told(trust_domains, certificates, names)
        known: dict[tuple[int, object], list[Timeline]] = {}
        for enclave in enclaves:
            if enclave.identity is not None:
                moments = ((0, enclave), *enclave.later)
                timeline = tuple((begin, Endpoints(atom.reads_alone, atom.writes_alone)) for begin, atom in moments)
                known.setdefault((enclave.trust_domain, told(enclave.identity)), []).append(timeline)
        count = 0
        for each in let_in:
            number, doubted = self.number(each), unmanaged_doubt(each) is not None
            about = told(number)
            for trust_domain, atom in enumerate(trust_domains):
                if not self.admits(atom, each, certificates):
                    continue
                timeline = joined(own.get((number, trust_domain), ()))
                alike = known.setdefault((trust_domain, about), [])
                if not doubted and any(within(timeline, other) for other in alike):
                    continue
                alike.append(timeline)
                count += 1
                if count > MAX_PARTICIPANTS:
                    raise BudgetExceeded(
                        f"More than {MAX_PARTICIPANTS} identities without an enclave are too many to tell apart, "
                        f"{each.certificate.path}:{each.certificate.line} among them."
                    )
                made = Participant(
                    label=f"{shorten(each.certificate.subject, MAX_SUBJECT)} ({each.certificate.path}, no enclave)",
                    location=Location(path=each.certificate.path, line=each.certificate.line),
                    trust_domain=trust_domain,
                    identity=None if doubted else number,
                    permissions=frozenset(),
                    kind=ParticipantKind.UNMANAGED,
                    possible=not each.held,
                )
                yield made_alone(made, timeline)

    def own_endpoints(
        self, alone: Sequence[Sequence[Alone]], trust_domains: Mapping[tuple[int, TrustFiles], int], *, may: bool
    ) -> dict[tuple[int, int], list[Timeline]]:
        """By certificate and trust domain what their own implementation creates, possibly (MAY) or certainly (MUST).

        `alone`: by reading and holder; empty where it creates nothing. Whose trust domain could not be read is left
        out: there everybody may do anything.
        """
        return gathered(
            ((number, trust_domains[reading, files]), each.possible if may else each.certain)
            for reading, made in enumerate(alone)
            for (number, files, _enclave), each in zip(self.holders if made else (), made, strict=True)
            if (reading, files) in trust_domains
        )


def behind_participant(place: str, trust_domain: int) -> Participant:
    """What stands for all enclaves behind a place that was not read."""
    return Participant(
        label=behind(place),
        location=Location(path=place),
        trust_domain=trust_domain,
        identity=None,
        permissions=frozenset(),
        kind=ParticipantKind.UNREAD,
    )


def unread_certificate(root: str, key: int, last: int) -> CertificateAtom:
    """What stands for all certificates with this key in unread CA files of the keystore at `root`, up to the `last`
    instant.
    """
    return CertificateAtom(
        label="whatever is in a CA file that could not be read",
        location=Location(path=root),
        issuers=frozenset(),
        authority=False,
        fit_to_sign=False,
        key=key,
        not_before=0,
        not_after=last,
        opaque=True,
    )


def unread_participants(places: Sequence[str], trust_domains: Sequence[TrustDomainAtom]) -> Iterator[Participant]:
    """(MAY) Identities in files outside enclaves that were not read: one stands for all, in each trust domain."""
    for trust_domain in range(len(trust_domains)) if places else ():
        yield Participant(
            label=f"whoever is in {places[0]}{f' and {len(places) - 1} more files' if len(places) > 1 else ''}",
            location=Location(path=places[0]),
            trust_domain=trust_domain,
            identity=None,
            permissions=frozenset(),
            kind=ParticipantKind.UNMANAGED,
        )


def trusting_all(trust_domains: Iterable[TrustDomainAtom], unread: TrustDomainAtom) -> TrustDomainAtom:
    """(MAY) The trust domain of a governance that could not be read, with the authorities of all these."""
    several = tuple(trust_domains)
    return replace(
        unread,
        identity_ca=frozenset[int]().union(*(each.identity_ca for each in several)),
        permissions_ca=frozenset[int]().union(*(each.permissions_ca for each in several)),
    )


def _told(
    trust_domains: Sequence[TrustDomainAtom],
    certificates: Sequence[CertificateAtom],
    names: Mapping[Hashable, frozenset[int]],
) -> Callable[[int], object]:
    """All that a peer looks at in a certificate, except dates; equal for certificates that serve alike."""
    revoked = gathered(
        (certificate, (number, moment))
        for number, trust_domain in enumerate(trust_domains)
        for moment, several in ((-1, trust_domain.revoked), *trust_domain.revoked_later)
        for certificate in several
    )
    named = gathered((certificate, text) for text, several in names.items() for certificate in several)

    def told(number: int) -> object:
        atom = certificates[number]
        looked_at = atom.key, atom.issuers, atom.authority, atom.fit_to_sign
        return looked_at, tuple(revoked.get(number, ())), tuple(named.get(number, ()))

    return told


def _hosts(keystore: Keystore) -> dict[TrustFiles, Enclave]:
    """Whose place they may take: enclaves, by trust domain. Also each identity CA file with each permissions CA file
    and each governance there is, without revocation lists.

    Who has no list refuses nobody whom others take, and nobody knows what else stands in its CA files: all authorities
    there are. Where it is unknown whom an enclave trusts, all is open already. Raises errors.BudgetExceeded.
    """
    found = {trust_files(enclave): enclave for enclave in keystore.enclaves}
    known = [enclave for enclave in found.values() if not opens(trust_domain_doubt(enclave))]
    others = (each.document for each in unmanaged_governance(keystore))
    several = (*(enclave.governance for enclave in known), *others)
    governances = {governance_alike(each): each for each in several if isinstance(each, GovernanceFile)}
    trusted = _with_all(enclave.identity_ca for enclave in known)
    for permissions_ca in _with_all(enclave.permissions_ca for enclave in known):
        for governance in governances.values():
            for identity_ca in trusted if may_be_taken(governance.signed, (permissions_ca,)) else ():
                host = _with(known[0], identity_ca, permissions_ca, governance)
                found.setdefault(trust_files(host), host)
    return found


def _with_all(files: Iterable[CertificateFile | None]) -> list[CertificateFile]:
    """Each file with the authorities of all others behind its own, without revocation lists; equal results once.

    What is behind adds to whom its owner trusts; peers are told what is first. Raises errors.BudgetExceeded.
    """
    distinct = dict.fromkeys(file for file in files if file is not None)
    every = {each.sha256: each for file in distinct for each in file.certificates}
    if len(every) > MAX_AUTHORITIES:
        raise BudgetExceeded(
            f"An identity without an enclave may trust all {len(every)} authorities of the enclaves, too many to "
            f"search for chains (limit {MAX_AUTHORITIES})."
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


def _named(
    files: Iterable[PermissionsFile], identities: Sequence[Certificate], profiles: Iterable[Profile]
) -> list[frozenset[int]]:
    """By document the identities that one of its grants names, to some implementation."""
    texts = [file.subjects for file in files]
    named = named_by_some(frozenset[str]().union(*texts), identities, profiles)
    return [frozenset[int]().union(*(named[text] for text in each)) for each in texts]


def _folder(certificate: Certificate, permissions: PermissionsFile, host: Enclave, number: int) -> Enclave:
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
