"""What of a keystore depends on the implementation: a view for each kind, by its trust row and its access row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from typing import NamedTuple

from msgspec.structs import replace

from keystore_audit.assumptions import Assumption
from keystore_audit.grouped import grouped
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.system import Reading, TrustDomainAtom
from keystore_audit.model.inventory import Document, TrustFiles, Typed, governance_alike, permissions_cas, trust_files
from keystore_audit.model.participants.doubt import may_say_anything
from keystore_audit.model.participants.lone_endpoints import Alone
from keystore_audit.model.subjects.comparison import matching
from keystore_audit.model.trust.revocation import ends_of_lists, list_dates, revoked
from keystore_audit.model.trust.verdicts import (
    authorities_read,
    envelope,
    is_first_embedded,
    is_pinned,
    signers_taken,
    signing_authorities,
    trusted_authorities,
)
from keystore_audit.model.validity import SECOND
from keystore_audit.profiles import Access, Profile, SubjectComparison, Trust, at_work
from keystore_audit.truth import Truth


class Kind(NamedTuple):
    """Implementations that read a keystore alike, by the rows of one of them.

    `alone`: by enclave, and then by holder of an unmanaged identity, what they let it do by themselves, or refuse it.
    Empty where that is what peers concede it.
    """

    trust: Trust
    access: Access
    alone: tuple[Alone, ...] = ()

    def reading(self, assumed: frozenset[Assumption], *, mixed: bool) -> Reading:
        """How they judge peers. Unless the fleet is mixed, what depends on no announcement is told as nobody's."""
        announced = mixed or Assumption.TRUTHFUL_ANNOUNCEMENTS not in assumed
        return Reading(
            pins_signer=self.trust.pins_signer,
            skips_grants_out_of_date=self.access.skips_grants_out_of_date,
            requires_grant=self.access.requires_grant,
            joins_out_of_date=self.access.joins_out_of_date,
            asks_announced_only=self.trust.trusts_declarations and announced,
            matcher=self.access.matcher,
        )


class Fleet(NamedTuple):
    """The kinds of implementation that enclaves run, and by enclave which (empty: the first); unmanaged identities run
    any of them.
    """

    kinds: tuple[Kind, ...]
    runs: tuple[int, ...] = ()


def fleet_of(profile: Profile, paths: Sequence[str], kind: Callable[[Profile], Kind]) -> Fleet:
    """The fleet on the profile with enclaves of these paths; `kind`: how an implementation reads the keystore."""
    if not profile.others:  # nearly always
        return Fleet((kind(profile),))
    run = [kind(profile.run_by(path)) for path in paths]
    kinds = tuple(dict.fromkeys(run)) or (kind(profile),)
    return Fleet(kinds, tuple(map(kinds.index, run)) if len(kinds) > 1 else ())


class TrustDomains:
    """The trust domains of a system, numbered in the order in which they come: of those that judge alike the first.

    `documents`: what is in those of the system, each with its reading. `known`: by reading and files those of which
    nothing is unknown.
    """

    def __init__(self, documents: Iterable[tuple[int, Typed | None]]) -> None:
        first: dict[tuple[int, Typed], int] = {}
        self._alike: dict[int | None, int] = {
            number: first.setdefault((reading, governance_alike(file)), number)
            for number, (reading, file) in enumerate(documents)
            if isinstance(file, GovernanceFile)
        }
        self._numbers: dict[TrustDomainAtom, int] = {}
        self._atoms: list[TrustDomainAtom] = []
        self.known: dict[tuple[int, TrustFiles], int] = {}

    def __contains__(self, trust_domain: TrustDomainAtom) -> bool:
        return self._judging(trust_domain) in self._numbers

    def number(self, trust_domain: TrustDomainAtom) -> int:
        """The number of one, a new one for a new one."""
        number = self._numbers.setdefault(self._judging(trust_domain), len(self._atoms))
        if number == len(self._atoms):
            self._atoms.append(trust_domain)
        return number

    def _judging(self, trust_domain: TrustDomainAtom) -> TrustDomainAtom:
        """The same with the first governance that is like its own."""
        governance = trust_domain.governance
        return replace(trust_domain, governance=self._alike.get(governance, governance))

    @property
    def atoms(self) -> tuple[TrustDomainAtom, ...]:
        """All numbered so far."""
        return tuple(self._atoms)


class Views:
    """The views of one keystore at an instant (aware UTC). A certificate is its index in `certificates`.

    `hosts`: in whose place an unmanaged identity may start.
    """

    def __init__(
        self,
        keystore: Keystore,
        documents: Sequence[Document],
        certificates: Sequence[Certificate],
        accesses: AccessViews,
        at: datetime,
        hosts: Iterable[Enclave],
    ) -> None:
        self._accesses = accesses
        self._at = at
        self._documents = documents
        self._certificates = certificates
        self._number = {certificate.sha256: number for number, certificate in enumerate(certificates)}
        self._with_key = grouped(certificates, lambda certificate: certificate.key)
        self._trust_domains = list({trust_files(enclave): enclave for enclave in (*keystore.enclaves, *hosts)}.values())
        self._permissions_cas = permissions_cas(keystore)
        self._told: dict[tuple[str, bool], int] = {}
        self._named: dict[SubjectComparison, dict[str, frozenset[int]]] = {}

    def authorities(self, enclave: Enclave, trust: Trust) -> tuple[frozenset[int], frozenset[int], frozenset[int]]:
        """Identity CAs that vouch, certificates that count as permissions CA, and revoked certificates."""
        vouching = trusted_authorities(enclave.identity_ca, trust) if enclave.identity_ca else ()
        signing = signing_authorities(enclave.permissions_ca, trust) if enclave.permissions_ca else ()
        if trust.pins_signer:
            alike = [certificate for each in signing for certificate in self._with_key[each.key]]
            signing = tuple(certificate for certificate in alike if is_pinned(certificate, signing))
        return (
            frozenset(self._number[certificate.sha256] for certificate in vouching),
            frozenset(self._number[certificate.sha256] for certificate in signing),
            self._revoked(enclave, trust, self._at),
        )

    def _revoked(self, enclave: Enclave, trust: Trust, at: datetime) -> frozenset[int]:
        return frozenset(self._number[c.sha256] for c in revoked(enclave, self._certificates, trust, at))

    def _later(self, enclave: Enclave, trust: Trust) -> Iterator[tuple[datetime, int, frozenset[int]]]:
        """What is revoked at each instant at which another list counts (0), and right after it (1)."""
        for date in list_dates(enclave, trust, self._at):
            yield from ((date, behind, self._revoked(enclave, trust, date + behind * SECOND)) for behind in (0, 1))

    def revoked_later(
        self, enclave: Enclave, trust: Trust, instants: Sequence[datetime]
    ) -> tuple[tuple[int, frozenset[int]], ...]:
        """The same by moments, `instants` being those of the system."""
        return tuple((2 * instants.index(date) + behind, each) for date, behind, each in self._later(enclave, trust))

    def list_dates(self, profiles: Iterable[Profile]) -> set[datetime]:
        """All these instants, and those at which a list begins or ends."""
        trusts = dict.fromkeys(profile.trust for profile in at_work(profiles))
        asked = [(each, trust, self._at) for trust in trusts for each in self._trust_domains]
        return {date for each in asked for date in (*list_dates(*each), *ends_of_lists(*each))}

    def told(self, enclave: Enclave, trust: Trust) -> int:
        """What the enclave tells peers of its permissions CA: equal numbers, equal things."""
        if not trust.compares_permissions_ca:
            return 0
        return self._told.setdefault(_introduction(enclave.permissions_ca, trust), len(self._told))

    def names(self, trust: Trust) -> dict[str, frozenset[int]]:
        """The certificates that each subject_name of a grant is taken to name."""
        if trust.subjects not in self._named:
            subjects = [
                subject
                for document in self._documents
                if isinstance(document.file, PermissionsFile)
                for subject in document.file.subjects
            ]
            self._named[trust.subjects] = matching(subjects, self._certificates, trust.subjects)
        return self._named[trust.subjects]

    def opaque(self, kind: Kind) -> frozenset[str]:
        """The places of documents that some enclave may accept although we do not know what they say."""
        return frozenset(document.place for document in self._documents if self.is_opaque(document, kind))

    def is_opaque(self, document: Document, kind: Kind) -> bool:
        """Whether this is one of them."""
        if document.file is None:
            return True
        read = self._accesses.read(document.file, kind.access)
        return may_say_anything(document.file, read, self._permissions_cas, kind.trust, to_peers=True)

    def signers(self, document: Document, trust: Trust) -> frozenset[int]:
        """Who made the signatures, as the implementation finds them: in the message, where it does not pin."""
        if document.file is None:
            return frozenset()
        signed = document.file.signed
        judged = envelope(signed)
        if judged.verdict is not Truth.YES:
            return frozenset()
        signers = signers_taken(signed, trust)
        if not trust.pins_signer and not all(is_first_embedded(signer, signed) for signer in signers):
            return frozenset()
        return frozenset(self._number[signer.sha256] for signer in signers)


def _introduction(file: CertificateFile | None, trust: Trust) -> tuple[str, bool]:
    """What a participant with this permissions CA file tells its peers of it: the name of the first certificate. Also
    whether the first that counts is signed with RSA. Fast DDS tells no more; `ca_algorithms` are this and ECDSA.
    """
    if file is None or file.first is None:
        return "", False
    return file.first.subject, any("RSA" in read.signature_algorithm for read in authorities_read(file, trust)[:1])
