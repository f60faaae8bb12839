"""Builds the `System`s of a keystore.

Evidence in, normalised facts out: one for each kind of implementation and reading.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache, cached_property
from typing import Final

from msgspec.structs import replace

from keystore_audit.assumptions import WORLD, Assumption
from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.issuer import fit_to_sign
from keystore_audit.keystore.keystore import Enclave, Keystore, every_certificate
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.typed import GovernanceFile
from keystore_audit.keystore.unmanaged import UnmanagedIdentity
from keystore_audit.model.access_view import AccessViews, ReadDocument
from keystore_audit.model.channels import Channels, Point, ReadRegion, document_channels
from keystore_audit.model.claims.claims import claim_regions
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.folding import together
from keystore_audit.model.formal.system import (
    NOWHERE,
    CertificateAtom,
    DocumentAtom,
    Participant,
    ParticipantKind,
    System,
    TrustDomainAtom,
)
from keystore_audit.model.inventory import (
    Document,
    certificates_of,
    embeddable,
    instants_of,
    issuers_of,
    system_documents,
    trust_files,
    unread_places,
)
from keystore_audit.model.participants.doubt import identity_doubt, opens, trust_domain_doubt
from keystore_audit.model.participants.lone_endpoints import NOTHING, LoneEndpoints, made_alone
from keystore_audit.model.participants.unmanaged import (
    Unmanaged,
    behind_participant,
    may_apply,
    trusting_all,
    unread_certificate,
    unread_participants,
)
from keystore_audit.model.participants.views import Fleet, Kind, TrustDomains, Views, fleet_of
from keystore_audit.model.rights import Atoms, RuleAtoms, one_after_another
from keystore_audit.model.trust.revocation import list_unread
from keystore_audit.model.trust.verdicts import is_authority
from keystore_audit.profiles import Access, Profile, at_work

MAX_JUDGED: Final = 100_000
"""Pairs of a trust domain and a participant that it judges: half a minute and 350 MB."""


class SystemBuilder:
    """The systems of a keystore for the implementations in question; what they share is computed once.

    `accesses`: how they read its documents. `points`: only these names are channels; None: all names, in classes.
    `claims`: the names and instants that they speak of take part. `channels`: these, which tell apart all that the
    keystore's documents do. `named`: sets of names that are told apart as well. `literal`: as in
    `channels.document_channels`. `instants` (attribute): at which anything may begin or end, sorted, `at` among them.
    Raises errors.BudgetExceeded where the classes are too many.
    """

    def __init__(
        self,
        keystore: Keystore,
        profiles: Sequence[Profile],
        at: datetime,
        accesses: AccessViews,
        points: Sequence[Point] | None = None,
        claims: Sequence[Claim] = (),
        channels: Channels | None = None,
        named: Sequence[ReadRegion] = (),
        *,
        literal: bool | None = None,
    ) -> None:
        self._keystore = keystore
        self._profiles, working = profiles, at_work(profiles)
        self._at = at
        self._documents = system_documents(keystore)
        self._accesses = accesses
        read = () if keystore.unread_foreign else (Assumption.NOTHING_IN_UNREAD_FILES,)
        self._assumed = accesses.assumed.union(read)
        self._certificates = certificates_of(keystore, at)
        self._number = {certificate.sha256: n for n, certificate in enumerate(self._certificates)}
        self._unmanaged = Unmanaged(keystore, self._number, self._documents, working, at)
        self._views = Views(keystore, self._documents, self._certificates, accesses, at, self._unmanaged.hosts.values())
        self._trust_domain_doubts = [trust_domain_doubt(enclave) for enclave in keystore.enclaves]
        self._unread_places = unread_places(keystore)
        self._read = {row: self._read_all(row) for row in accesses.rows(profiles)}
        grants = (g for read in self._read.values() for document in read for g in document.grants or ())
        ends = {c.until for c in claims if c.until is not None and c.until > at} | self._views.list_dates(profiles)
        # Certificates that no chain rests on have dates too by which an enclave starts, or does not.
        presented = every_certificate(keystore.enclaves, (), ())
        self.instants = tuple(sorted({*instants_of((*self._certificates, *presented), grants, at), *ends}))
        if channels is None:
            regions = (*claim_regions(claims), *named)
            opened = self._may_be_open()
            channels = document_channels(self._read, points, regions, opened=opened, literal=literal)
        self.channels = channels
        self._issuers = issuers_of(keystore, self._certificates)
        doubts = [(each.identity, identity_doubt(each)) for each in keystore.enclaves]
        self._unknown = [opens(doubt) for _identity, doubt in doubts]
        self._narrowed = frozenset(self._number[i.sha256] for i, doubt in doubts if i and doubt and doubt.narrows)
        self._meets = channels.meets
        self._rule_atoms = RuleAtoms(self.channels, self.instants)
        self._typed: dict[object, Atoms] = {}
        self._keys = {key: n for n, key in enumerate(dict.fromkeys(c.key for c in self._certificates))}

    def _may_be_open(self) -> bool:
        """Whether the governance of a trust domain, or what is in place of it, may say anything."""
        governances = [d for d in self._documents if isinstance(d.file, GovernanceFile)]
        kinds = {Kind(each.trust, self._accesses.row(each.access)) for each in at_work(self._profiles)}
        opens = self._opens or self._unmanaged.unread is not None
        opens = opens or Assumption.ROBOTS_ENFORCE not in self._assumed
        return opens or any(self._views.is_opaque(each, kind) for kind in kinds for each in governances)

    def _read_all(self, access: Access) -> list[ReadDocument]:
        """The documents as they are read, in order."""
        files = (document.file for document in self._documents)
        return [ReadDocument() if file is None else self._accesses.read(file, access) for file in files]

    def systems(self) -> tuple[System, ...]:
        """A system for each way in which the profiles read the keystore, with a MUST reading where there is doubt.

        Raises errors.BudgetExceeded where trust domains have too many participants to judge.
        """
        unmanaged = [folder for _number, _files, folder in self._unmanaged.holders]
        about = self._accesses, self.channels, self.instants, self._at, self._meets
        lone = LoneEndpoints(self._keystore, *about, unmanaged)
        kind = cache(lambda each: Kind(each.trust, self._accesses.row(each.access), lone.of(each)))
        readings = cache(self._readings)
        paths = [enclave.path for enclave in self._keystore.enclaves]
        fleets = ((each, fleet_of(each, paths, kind)) for each in self._profiles)
        return together(
            replace(each, profiles=(by.name,), others=tuple(dict.fromkeys(other.name for _path, other in by.others)))
            for by, fleet in fleets
            for each in readings(fleet)
        )

    def _readings(self, fleet: Fleet) -> tuple[System, ...]:
        may = self.build(fleet, may=True)
        if len(may.trust_domains) * len(may.enclaves) > MAX_JUDGED:
            raise BudgetExceeded(
                f"{len(may.trust_domains)} trust domains are too many for {len(may.enclaves)} participants, since each "
                f"judges each (limit {MAX_JUDGED} pairs)."
            )
        doubt = may.has_doubt or may.mixed or self._narrowed or any(self._trust_domain_doubts)
        return (may, self.build(fleet, may=False)) if doubt else (may,)

    def build(self, fleet: Fleet, *, may: bool) -> System:
        """The system as these implementations read it, without profiles yet."""
        read: list[tuple[int, Document]] = []
        atoms: list[DocumentAtom] = []
        parts: list[tuple[int, Atoms]] = []
        for reading, kind in enumerate(fleet.kinds):
            opaque = self._views.opaque(kind)
            documents = [d for d in self._documents if may or d.place not in opaque]
            parts.append((len(atoms), self._typed_atoms(documents, kind)))
            read += ((reading, document) for document in documents)
            made = (self._document_atom(each, kind, opaque=each.place in opaque) for each in documents)
            atoms += (replace(each, reading=reading) for each in made)
        enclaves, trust_domains = self._participants(fleet, read, atoms, may=may)
        domain_rules, topic_rules, grants, rules = one_after_another(parts)
        assumed = self._assumed
        return System(
            profiles=(),
            readings=tuple(kind.reading(assumed, mixed=len(fleet.kinds) > 1) for kind in fleet.kinds),
            assumed=assumed if may else assumed | WORLD,
            may=may,
            instants=self.instants,
            now=self.instants.index(self._at),
            certificates=(*self._in_use(enclaves, atoms, may=may), *(self._unread if may and self._opens else ())),
            documents=tuple(atoms),
            trust_domains=trust_domains,
            enclaves=enclaves,
            domains=self.channels.domains,
            channels=self.channels.channels,
            domain_rules=domain_rules,
            topic_rules=topic_rules,
            grants=grants,
            rules=rules,
            meets=self._meets,
            left_out=() if may else tuple(self._left_out()),
        )

    def _left_out(self) -> Iterator[Participant]:
        """(MUST) The enclaves of which it is not certain who they are, or what they accept."""
        doubts = zip(self._keystore.enclaves, self._unknown, self._trust_domain_doubts, strict=True)
        for enclave, unknown, doubt in doubts:
            if unknown or doubt is not None:
                yield self._enclave(enclave, NOWHERE, unknown=unknown)
        yield from (behind_participant(place, NOWHERE) for place in self._unread_places)

    def _participants(
        self, fleet: Fleet, read: Sequence[tuple[int, Document]], atoms: list[DocumentAtom], *, may: bool
    ) -> tuple[tuple[Participant, ...], tuple[TrustDomainAtom, ...]]:
        """The participants and their trust domains. Adds to `atoms` (documents) those of open trust domains."""
        number = {(reading, document.place): n for n, (reading, document) in enumerate(read)}
        trust_domains = TrustDomains([(reading, document.file) for reading, document in read])
        unmanaged, count = self._unmanaged, len(self._keystore.enclaves)
        found = list(self._enclaves(fleet, number, atoms, trust_domains, may=may))
        if may:
            open_to = ((place, self._open_trust_domain(atoms, place)) for place in self._unread_places)
            found += [behind_participant(place, trust_domains.number(each)) for place, each in open_to]
        let_in = unmanaged.let_in(found, trust_domains.atoms, self._certificate_atoms, may=may)
        for reading in range(len(fleet.kinds)) if let_in else ():
            self._add_hosts(fleet, reading, number, let_in, trust_domains, may=may)
        if may and let_in and unmanaged.unread is not None:
            opened = self._open_trust_domain(atoms, unmanaged.unread)
            trust_domains.number(trusting_all(trust_domains.atoms, opened))
        own = unmanaged.own_endpoints([kind.alone[count:] for kind in fleet.kinds], trust_domains.known, may=may)
        named = (
            ((n, text), who) for n, k in enumerate(fleet.kinds) for text, who in self._views.names(k.trust).items()
        )
        names: dict[Hashable, frozenset[int]] = dict(named) if let_in else {}
        found += unmanaged.participants(let_in, found, trust_domains.atoms, self._certificate_atoms, names, own)
        if may:
            found += unread_participants([file.place for file in self._keystore.identities.unread], trust_domains.atoms)
        return tuple(found), trust_domains.atoms

    def _enclaves(
        self,
        fleet: Fleet,
        number: Mapping[tuple[int, str], int],
        atoms: list[DocumentAtom],
        trust_domains: TrustDomains,
        *,
        may: bool,
    ) -> Iterator[Participant]:
        """The enclaves of the keystore, each with its trust domain."""
        several = self._keystore.enclaves
        rows = zip(several, self._unknown, self._trust_domain_doubts, fleet.runs or (0,) * len(several), strict=True)
        for place, (enclave, unknown, doubt, reading) in enumerate(rows):
            if not may and (unknown or doubt is not None):  # of what it accepts, nothing is certain
                continue
            files = reading, trust_files(enclave)
            if doubt is not None and not doubt.narrows:
                made = self._open_trust_domain(atoms, doubt.location.path, reading)
                if doubt.location.path == enclave.files.files[Role.GOVERNANCE].path:  # its authorities were read
                    known = self._trust_domain(enclave, number, fleet, reading, may=may)
                    made = replace(known, governance=made.governance)
                trust_domain = trust_domains.number(made)
            elif files in trust_domains.known:
                trust_domain = trust_domains.known[files]
            else:
                made = self._trust_domain(enclave, number, fleet, reading, may=may)
                trust_domain = trust_domains.known[files] = trust_domains.number(made)
            carried = enclave.files.files[Role.PERMISSIONS].place  # it may be unread (MAY)
            permissions = frozenset(
                n for n in (number.get((r, carried)) for r in range(len(fleet.kinds))) if n is not None
            )
            own = self._enclave(enclave, trust_domain, permissions, unknown=unknown)
            alone = fleet.kinds[reading].alone
            lone = alone[place] if alone else NOTHING
            yield made_alone(own, lone.possible if may else lone.certain, lone.refused)

    def _enclave(
        self, enclave: Enclave, trust_domain: int, permissions: frozenset[int] = frozenset(), *, unknown: bool
    ) -> Participant:
        return Participant(
            label=enclave.path,
            location=_place(enclave),
            trust_domain=trust_domain,
            identity=None if unknown else self._identity(enclave),
            permissions=permissions,
            kind=ParticipantKind.UNREAD if unknown else ParticipantKind.ENCLAVE,
        )

    def _add_hosts(
        self,
        fleet: Fleet,
        reading: int,
        number: Mapping[tuple[int, str], int],
        let_in: Sequence[UnmanagedIdentity],
        trust_domains: TrustDomains,
        *,
        may: bool,
    ) -> None:
        """Adds the trust domains that have only unmanaged identities, which start in place of a host."""
        for host_files, host in self._unmanaged.hosts.items():
            doubt, files = trust_domain_doubt(host), (reading, host_files)
            certain = not opens(doubt) if may else doubt is None
            if files not in trust_domains.known and certain and may_apply(host, fleet.kinds[reading].trust):
                trust_domain = self._trust_domain(host, number, fleet, reading, may=may)
                admitted = (self._unmanaged.admits(trust_domain, each, self._certificate_atoms) for each in let_in)
                if trust_domain in trust_domains or any(admitted):
                    trust_domains.known[files] = trust_domains.number(trust_domain)

    def _in_use(
        self, enclaves: Iterable[Participant], documents: Iterable[DocumentAtom], *, may: bool
    ) -> Iterable[CertificateAtom]:
        """The certificates. An unmanaged one that adds nothing gets no issuer, so that no stranger seems to have it.

        Signers add something, and so do the authorities over which they chain, and what an attacker may embed.
        (MUST) No authority certainly vouches for an identity where an extension narrows what is accepted.
        """
        idle = frozenset[int]() if may else self._narrowed
        if not self._unmanaged.identities and not idle:  # nearly always
            return self._certificate_atoms
        used = {enclave.identity for enclave in enclaves}.union(*(document.signers for document in documents))
        used |= {self._number[certificate.sha256] for certificate in embeddable(self._keystore, self._at)}
        idle |= {self._unmanaged.number(each) for each in self._unmanaged.identities} - used.union(*self._issuers)
        atoms = enumerate(self._certificate_atoms)
        return [replace(atom, issuers=frozenset()) if number in idle else atom for number, atom in atoms]

    @property
    def _opens(self) -> bool:
        """Whether there are open trust domains."""
        return bool(self._unread_places) or any(map(opens, self._trust_domain_doubts))

    def _open_trust_domain(self, atoms: list[DocumentAtom], place: str, reading: int = 0) -> TrustDomainAtom:
        """(MAY) The trust domain of an enclave whose trust could not be read.

        It has an opaque governance, so it accepts everything, and authorities of which nothing is known.
        """
        none, unread, number = frozenset[int](), frozenset({len(self._certificate_atoms)}), len(atoms)
        made = DocumentAtom(label=place, location=Location(place), intact=False, signers=none, opaque=True)
        atoms.append(replace(made, reading=reading))
        return TrustDomainAtom(
            identity_ca=unread, permissions_ca=unread, governance=number, revoked=none, told=None, reading=reading
        )

    @property
    def _unread(self) -> tuple[CertificateAtom, ...]:
        return (unread_certificate(self._keystore.root, len(self._keys), len(self.instants) - 1),)

    def _document_atom(self, document: Document, kind: Kind, *, opaque: bool) -> DocumentAtom:
        signers = self._views.signers(document, kind.trust) if not opaque else frozenset()
        place = document.place
        return DocumentAtom(label=place, location=Location(place), intact=bool(signers), signers=signers, opaque=opaque)

    def _trust_domain(
        self, enclave: Enclave, number: Mapping[tuple[int, str], int], fleet: Fleet, reading: int, *, may: bool
    ) -> TrustDomainAtom:
        """What the enclave's verdict on peers depends on. (MUST) With an unknown list, anybody may be revoked."""
        place, trust = enclave.governance and enclave.governance.signed.file.place, fleet.kinds[reading].trust
        identity_ca, permissions_ca, revoked = self._views.authorities(enclave, trust)
        unread, kinds = list_unread(enclave, trust) is not None, len(fleet.kinds)
        return TrustDomainAtom(
            identity_ca=identity_ca,
            permissions_ca=permissions_ca,
            governance=number.get((reading, place)) if place else None,
            revoked=revoked if may or not unread else frozenset(range(len(self._certificates))),
            list_unread=may and unread,
            # Whether implementations of two kinds finish a handshake with each other depends on more than is known.
            told=None if may and kinds > 1 else self._views.told(enclave, trust) * kinds + reading,
            revoked_later=self._views.revoked_later(enclave, trust, self.instants),
            reading=reading,
        )

    def _identity(self, enclave: Enclave) -> int | None:
        return None if enclave.identity is None else self._number[enclave.identity.sha256]

    @cached_property
    def _certificate_atoms(self) -> tuple[CertificateAtom, ...]:
        index = {instant: n for n, instant in enumerate(self.instants)}
        return tuple(
            CertificateAtom(
                label=certificate.subject,
                location=Location(path=certificate.path, line=certificate.line),
                issuers=self._issuers[n],
                authority=is_authority(certificate),
                fit_to_sign=fit_to_sign(certificate),
                key=self._keys[certificate.key],
                not_before=index[certificate.not_before],
                not_after=index[certificate.not_after],
            )
            for n, certificate in enumerate(self._certificates)
        )

    def _typed_atoms(self, documents: Sequence[Document], kind: Kind) -> Atoms:
        """What the documents say, the same objects for every kind of implementation that reads the same there."""
        names = self._views.names(kind.trust)
        key = (tuple(document.place for document in documents), tuple(names.items()), kind.access)
        if key not in self._typed:
            by_place = {d.place: read for d, read in zip(self._documents, self._read[kind.access], strict=True)}
            read = [(document.place, by_place[document.place]) for document in documents]
            self._typed[key] = self._rule_atoms.of(read, names, kind.access)
        return self._typed[key]


def _place(enclave: Enclave) -> Location:
    """Where the enclave is introduced: its certificate, else its directory."""
    if enclave.certificate is not None:
        return Location(path=enclave.certificate.file.place, line=1)
    return Location(path=enclave.files.directory)
