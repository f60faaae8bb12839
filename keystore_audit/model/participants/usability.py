"""Whether a participant of an enclave would be created, and every reason why not (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import Typed
from keystore_audit.model.participants.doubt import enclave_doubts
from keystore_audit.model.participants.joining import Governed, governed, join_refusals
from keystore_audit.model.participants.sight import (
    Sight,
    authority_refusals,
    certificate_refusals,
    key_refusals,
    sight_of,
)
from keystore_audit.model.question import Usability
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.trust.chain import chain_refusal, path_refusal
from keystore_audit.model.trust.revocation import list_broken, list_missing, list_used, lists_read, revoked
from keystore_audit.model.trust.verdicts import document_verdict, is_issued, may_sign, signers_taken
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Profile, Trust
from keystore_audit.truth import Truth

UNGOVERNED: Final = ("the governance covers no domain", "the governance does not cover domain")
"""How reasons begin that are about domains, as `joining.UNGRANTED`: only governance and permissions mend them."""

_NOT_ISSUED: Final = "the identity CA did not issue the identity certificate"
_NO_LIST: Final = "no revocation list that it carries can be used for the identity, so every identity is refused"


class _Dated(Struct, frozen=True, kw_only=True):
    """What depends on the instant, but for the certificate and the grants of each enclave."""

    identity_ca: CertificateFile | None
    """None where no authority of the file issued the identity: that is a reason of its own."""
    permissions_ca: Certificate | None
    """None where its dates do not count."""
    governed: Governed | None
    """The domains of which a grant has to let the enclave join one; None where the governance says nothing."""
    listed: Enclave | None
    """The enclave, where it carries revocation lists."""
    signed: tuple[tuple[Role, SignedDocument, CertificateFile], ...]
    """The documents, each with its role and the permissions CA file, where others than the permissions CA may sign: the
    dates of the signers, and of the authorities above them, count (measured)."""


class _Own(NamedTuple):
    """What is an enclave's own: its certificate, and the grants that name it (None: the document says nothing)."""

    certificate: Certificate | None
    grants: tuple[ReadGrant, ...] | None
    alike: list[Enclave]
    """Those of which all else is the same, the first for all; itself among them."""

    @property
    def limited(self) -> tuple[Certificate | ReadGrant, ...]:
        """What of it is in force or is not."""
        return (*filter(None, (self.certificate,)), *(self.grants or ()))


_USABLE: Final = Usability(usable=Truth.YES, reasons=())

_NO_GRANT: Final = "no grant in force names"
"""A reason that is told with the subject."""


class Usabilities:
    """Answers for the enclaves of one keystore; what does not depend on the instant is worked out once.

    `domain`: the domain that a participant is wanted in; None: some domain of 0..232. `accesses`: how implementations
    read the keystore's documents.
    """

    def __init__(self, domain: int | None, accesses: AccessViews) -> None:
        self.domain = domain
        self._accesses = accesses
        self._in_domain: dict[int, Usabilities] = {}
        self._governed: dict[tuple[str, object], Governed] = {}
        self._sights: dict[str, Sight] = {}
        self._own: dict[tuple[str, object, object], _Own] = {}
        self._alike: dict[object, list[Enclave]] = {}
        self._limited: dict[int, tuple[Certificate | ReadGrant, set[str]]] = {}
        self._standing: dict[tuple[str, object], tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._dated: dict[tuple[str, object], _Dated] = {}
        self._answers: dict[tuple[object, ...], tuple[datetime, Usability]] = {}

    def in_domain(self, domain: int) -> Usabilities:
        """The answers for the same enclaves in this domain."""
        if domain not in self._in_domain:
            self._in_domain[domain] = Usabilities(domain, self._accesses)
        return self._in_domain[domain]

    def kind(self, profile: Profile) -> object:
        """Equal for profiles whose answers are equal."""
        return profile.trust, self._accesses.row(profile.access), profile.local

    def of(self, enclave: Enclave, at: datetime, profile: Profile) -> Usability:
        """Whether a participant of the enclave is created at `at` (aware UTC).

        It is unknown where something could not be read and nothing else already rules it out.
        """
        own, kind = self._own_of(enclave, profile), self.kind(profile)
        key = (own.alike[0].files.directory, kind, *[in_force(each, at) for each in own.limited])
        known = self._answers.get(key)
        if known is None or known[0] != at:
            known = self._answers[key] = (at, self._answer(own, profile, at))
        return known[1] if _NO_GRANT not in known[1].reasons else _naming(known[1], enclave)

    def _answer(self, own: _Own, profile: Profile, at: datetime) -> Usability:
        """The answer for all that are like one enclave and of which the same is in force."""
        enclave = own.alike[0]
        key = (enclave.files.directory, self.kind(profile))
        if key not in self._standing:
            row = self._accesses.row(profile.access)
            self._standing[key] = (
                self._refusals(enclave, profile),
                tuple(doubt.reason for doubt in enclave_doubts(enclave, profile.trust, row, self._accesses)),
            )
            self._dated[key] = self._dates(enclave, profile)
        refusals, doubts = self._standing[key]
        reasons = (*refusals, *_refusals_at(self._dated[key], own, profile, at))
        if reasons:
            return Usability(usable=Truth.NO, reasons=reasons)
        return Usability(usable=Truth.UNKNOWN, reasons=doubts) if doubts else _USABLE

    def touched(self, one: datetime, other: datetime) -> frozenset[str]:
        """The directories of the enclaves, of those asked about, whose answers may differ between two instants.

        An answer rests on whether certificates and grants are in force. Of revocation lists nothing is ruled out.
        """

        def changes(each: Certificate | ReadGrant | None) -> bool:
            return each is None or in_force(each, one) != in_force(each, other)

        together = {
            directory for (directory, _kind), dated in self._dated.items() if any(map(changes, _rests_on(dated)))
        }
        groups = (each for each in self._alike.values() if each[0].files.directory in together)
        apart = (directories for each, directories in self._limited.values() if changes(each))
        return frozenset(each.files.directory for group in groups for each in group).union(*apart)

    def _own_of(self, enclave: Enclave, profile: Profile) -> _Own:
        """What is the enclave's own, and which others are like it for the profile."""
        directory, row = enclave.files.directory, self._accesses.row(profile.access)
        known = self._own.get((directory, row, profile.trust.subjects))
        if known is None:
            grants = self._accesses.own_grants(enclave, profile)
            alike = self._alike.setdefault(self._seen(enclave, grants, profile), [])
            alike.append(enclave)
            known = _Own(certificate=enclave.identity, grants=grants, alike=alike)
            self._own[directory, row, profile.trust.subjects] = known
            for each in known.limited:
                self._limited.setdefault(id(each), (each, set()))[1].add(directory)
        return known

    def _seen(self, enclave: Enclave, grants: tuple[ReadGrant, ...] | None, profile: Profile) -> object:
        """Equal for enclaves that start alike as long as the same of their own is in force."""
        directory, row = enclave.files.directory, self._accesses.row(profile.access)
        if directory not in self._sights:
            self._sights[directory] = sight_of(enclave)
        read = self._accesses.read(enclave.permissions, row) if enclave.permissions is not None else None
        if read is not None and read.is_silent:
            return directory, row, profile.trust.subjects
        said = tuple(
            [(each.default_allow, *[(rule.allow, rule.domains) for rule in each.rules]) for each in grants or ()]
        )
        refusal = read.refusal if read is not None else None
        return self._sights[directory], row, profile.trust.subjects, refusal, grants is None, said

    def _refusals(self, enclave: Enclave, profile: Profile) -> tuple[str, ...]:
        """Reasons that hold at every instant, in order of the files."""
        sight, trust = self._sights[enclave.files.directory], profile.trust
        certificate = enclave.identity
        governed = self._governed_domains(enclave.governance, profile)
        none = self.domain is None
        said = UNGOVERNED[0] if none else f"{UNGOVERNED[1]} {self.domain}"
        return (
            *sight.absent,
            *key_refusals(sight, trust),
            *(_chain_refusals(enclave, certificate, trust) if certificate is not None else ()),
            *certificate_refusals(sight, trust),
            *authority_refusals(sight, trust),
            *self._document_refusals(Role.GOVERNANCE, enclave.governance, enclave.permissions_ca, profile),
            *self._document_refusals(Role.PERMISSIONS, enclave.permissions, enclave.permissions_ca, profile),
            *((said,) if governed == () and not profile.local.starts_ungoverned else ()),
        )

    def _document_refusals(
        self, role: Role, read: Typed | None, permissions_ca: CertificateFile | None, profile: Profile
    ) -> list[str]:
        if read is None or permissions_ca is None:
            return []
        found = []
        verdict = document_verdict(read.signed, permissions_ca, profile.trust)
        lost = path_refusal(read.signed, permissions_ca, profile.trust) if verdict is Truth.YES else None
        if verdict is Truth.NO or lost is not None:
            whom = "the permissions CA" if profile.trust.pins_signer else "anybody whom the permissions CA vouches for"
            found.append(f"{role.value}.p7s is not validly signed by {whom}{f': {lost}' if lost else ''}")
        refusal = self._accesses.read(read, profile.access).refusal
        if refusal is not None:
            found.append(f"it refuses {role.value}.p7s: {refusal}")
        return found

    def _dates(self, enclave: Enclave, profile: Profile) -> _Dated:
        certificate = enclave.identity
        file, trust = enclave.identity_ca, profile.trust
        issued = file is not None and certificate is not None and is_issued(file, certificate, trust, None)
        authority = enclave.permissions_ca.first if enclave.permissions_ca else None
        dated_first = trust.checks_permissions_ca and (trust.first_authority_only or trust.strict_authorities)
        return _Dated(
            identity_ca=file if issued else None,
            permissions_ca=authority if dated_first else None,
            governed=self._governed_domains(enclave.governance, profile),
            listed=enclave if lists_read(enclave, trust) else None,
            signed=() if trust.pins_signer else tuple(_signed_validly(enclave, trust)),
        )

    def _governed_domains(self, file: GovernanceFile | None, profile: Profile) -> Governed | None:
        """The domains in question, each with the domain rules that decide; None where the document says nothing."""
        if file is None or self._accesses.read(file, profile.access).domain_rules is None:
            return None
        key = (file.signed.file.place, self._accesses.row(profile.access))
        if key not in self._governed:
            self._governed[key] = governed(self._accesses.deciding(file, profile.access), self.domain, profile.access)
        return self._governed[key]


def _naming(answer: Usability, enclave: Enclave) -> Usability:
    """The answer for all that are alike as it is for this one, by its name."""
    subject = enclave.identity.subject if enclave.identity is not None else ""
    named = f"{_NO_GRANT} {subject or 'the empty subject'}"
    return Usability(usable=Truth.NO, reasons=tuple(named if each is _NO_GRANT else each for each in answer.reasons))


def may_refuse_peers(enclave: Enclave, trust: Trust) -> bool:
    """Whether the enclave may refuse anybody for whom an authority of its file vouches (`refusals_of_peer`)."""
    file = enclave.identity_ca
    return file is not None and (len(file.certificates) > 1 or bool(lists_read(enclave, trust)))


def refusals_of_peer(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> Iterator[str]:
    """Why the enclave refuses who has the certificate, whatever grants say: what it asks of its own when it starts."""
    file = enclave.identity_ca
    yield from _chain_refusals(enclave, certificate, trust)
    if file is not None and is_issued(file, certificate, trust, None):
        if not is_issued(file, certificate, trust, at):
            yield "the identity CA certificate is outside its validity"
        yield from _chain_refusals_at(certificate, file, trust, at)
    if lists_read(enclave, trust):
        yield from _revocations_at(enclave, certificate, trust, at)


def _chain_refusals(enclave: Enclave, certificate: Certificate, trust: Trust) -> tuple[str, ...]:
    file = enclave.identity_ca
    if file is None or first_opaque(file.defects) is not None:
        return ()
    refusal = chain_refusal(certificate, file, trust)
    if refusal is not None:
        return (f"{_NOT_ISSUED}: {refusal}",)
    if list_missing(enclave, certificate, trust):
        return (_NO_LIST,)
    return ()


def _chain_refusals_at(certificate: Certificate, file: CertificateFile, trust: Trust, at: datetime) -> Iterator[str]:
    """Why no chain is found at an instant where one is at others: another authority of its name is in force then."""
    refusal = chain_refusal(certificate, file, trust, at)
    known = first_opaque(file.defects) is None
    if known and refusal is not None and chain_refusal(certificate, file, trust) is None:
        yield f"{_NOT_ISSUED}: {refusal}"


def _signed_validly(enclave: Enclave, trust: Trust) -> Iterator[tuple[Role, SignedDocument, CertificateFile]]:
    """The enclave's documents that are taken at some instant."""
    file = enclave.permissions_ca
    for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
        if read is None or file is None:
            continue
        if document_verdict(read.signed, file, trust) is Truth.YES:
            yield role, read.signed, file


def _rests_on(dated: _Dated) -> Iterator[Certificate | ReadGrant | None]:
    """Whatever of it is in force or is not; None for revocation lists."""
    if dated.permissions_ca is not None:
        yield dated.permissions_ca
    for _role, signed, file in dated.signed:
        yield from (*file.certificates, *signed.embedded)
    yield from dated.identity_ca.certificates if dated.identity_ca is not None else ()
    if dated.listed is not None:
        yield None


def _refusals_at(dated: _Dated, own: _Own, profile: Profile, at: datetime) -> Iterator[str]:
    """Reasons that hold at `at`."""
    certificate, trust, access = own.certificate, profile.trust, profile.access
    if certificate is not None and not in_force(certificate, at):
        yield "the identity certificate is outside its validity"
    file = dated.identity_ca
    if certificate is not None and file is not None:
        verified = file.first if trust.strict_authorities else None  # when the file is loaded (`sight.strict_refusal`)
        if not is_issued(file, certificate, trust, at):
            yield "the identity CA certificate is outside its validity"
        elif verified is not None and not in_force(verified, at):
            yield f"it does not load {file.file.place}: its first certificate is outside its validity"
        yield from _chain_refusals_at(certificate, file, trust, at)
    authority = dated.permissions_ca
    if authority is not None and not in_force(authority, at):
        yield "the permissions CA certificate is outside its validity"
    yield from _signers_refused_at(dated, trust, at)
    if certificate is not None and dated.listed is not None:
        yield from _revocations_at(dated.listed, certificate, trust, at)
    if certificate is not None and own.grants is not None:
        eligible = (grant for grant in own.grants if in_force(grant, at) or not access.skips_grants_out_of_date)
        grant = next(eligible, None)
        if grant is None or not (in_force(grant, at) or access.joins_out_of_date):
            yield _NO_GRANT
        elif dated.governed is not None:
            yield from join_refusals(dated.governed, grant, profile.local.joins)


def _signers_refused_at(dated: _Dated, trust: Trust, at: datetime) -> Iterator[str]:
    """What is wrong `at` an instant with who signed the documents."""
    authority = dated.permissions_ca
    signers = [
        (signer, signed, file) for _role, signed, file in dated.signed for signer in signers_taken(signed, trust)
    ]
    if any(signer != authority and not in_force(signer, at) for signer, _signed, _file in signers):
        yield "the certificate that signed a document is outside its validity"
    elif not all(signer == authority or may_sign(signer, signed, file, trust, at) for signer, signed, file in signers):
        yield "a certificate above the one that signed a document is outside its validity"
    for role, signed, file in dated.signed:
        lost = path_refusal(signed, file, trust, at)
        if lost is not None and path_refusal(signed, file, trust) is None:
            yield f"{role.value}.p7s is not validly signed by anybody whom the permissions CA vouches for: {lost}"


def _revocations_at(enclave: Enclave, certificate: Certificate, trust: Trust, at: datetime) -> Iterator[str]:
    """What the revocation list says in which the identity is looked up."""
    if revoked(enclave, (certificate,), trust, at):
        yield "the identity certificate is revoked"
    if list_missing(enclave, certificate, trust, at) and not list_missing(enclave, certificate, trust):
        yield _NO_LIST
    if len(lists_read(enclave, trust)) > 1 and list_broken(enclave, certificate, trust, at):
        yield "the newest revocation list is not validly signed, so every identity is refused"
    used = list_used(enclave, certificate, trust, at)
    if used is not None and used.next_update is not None and used.next_update < at:
        yield "the revocation list is stale, so every identity is refused"
    if used is not None and used.this_update > at:
        yield "the revocation list is not yet valid, so every identity is refused"
