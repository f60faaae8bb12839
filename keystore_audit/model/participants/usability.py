"""Whether a participant of an enclave would be created, and every reason why not (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from functools import lru_cache

from msgspec.structs import replace

from keystore_audit.keystore.keystore import Enclave, every_certificate
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.typed import GovernanceFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import governance_alike
from keystore_audit.model.participants.doubt import enclave_doubts, file_doubts
from keystore_audit.model.participants.refusals import (
    UNGOVERNED,
    Governed,
    absent,
    governed,
    join_refusals,
    other_key,
    refusals,
    refusals_at,
    signature_refusal,
)
from keystore_audit.model.question import Usability
from keystore_audit.model.semantics import FIRST_IS_OVER, NO_GRANT, ReadGrant, without_grant
from keystore_audit.model.trust.revocation import ends_of_lists, lists_carried
from keystore_audit.model.trust.verdicts import certificate_alike, document_alike, envelope, file_alike
from keystore_audit.model.validity import END, Limited, in_force
from keystore_audit.profiles import Profile
from keystore_audit.truth import Truth

_Grants = tuple[ReadGrant, ...] | None
"""The grants of an enclave's own document that name it; None: the document says nothing."""


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
        self._own: dict[tuple[str, object, object], tuple[int, int, _Grants]] = {}
        self._kinds: dict[Profile, object] = {}
        self._alike: dict[object, int] = {}
        self._standing: dict[tuple[int, object], tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._answers: dict[tuple[int, object], tuple[datetime, Usability]] = {}

    def in_domain(self, domain: int) -> Usabilities:
        """The answers for the same enclaves in this domain."""
        if domain not in self._in_domain:
            self._in_domain[domain] = Usabilities(domain, self._accesses)
        return self._in_domain[domain]

    def kind(self, profile: Profile) -> object:
        """Equal for profiles whose answers are equal."""
        found = self._kinds.get(profile)
        if found is None:
            others = tuple((path, self.kind(other)) for path, other in profile.others)
            found = self._kinds[profile] = profile.trust, self._accesses.row(profile.access), profile.local, others
        return found

    def dates(self, enclave: Enclave, profile: Profile, at: datetime) -> set[datetime]:
        """The instants from `at` on at which, or right after which, the answer may become another one."""
        profile, document = profile.run_by(enclave.path), enclave.permissions
        grants = self._accesses.read(document, profile.access).grants if document is not None else None
        limited: tuple[Limited, ...] = (*(grants or ()), *every_certificate((enclave,), (), ()))
        dates = {date for each in limited for date in (each.not_before, each.not_after) if at <= date < END}
        return dates.union(ends_of_lists(enclave, profile.trust, at))

    def of(self, enclave: Enclave, at: datetime, profile: Profile) -> Usability:
        """Whether a participant of the enclave is created at `at` (aware UTC).

        It is unknown where something could not be read and nothing else already rules it out.
        """
        profile = profile.run_by(enclave.path)
        (alike, here, grants), kind = self._own_of(enclave, profile), self.kind(profile)
        limited: tuple[Limited | None, ...] = (enclave.identity, *(grants or ()))
        now = kind, tuple([each is None or in_force(each, at) for each in limited])
        known = self._answers.get((alike, now))
        if known is None or known[0] != at or known[1].reasons:  # which name files: of copies, its own
            known = self._answers.get((here, now))
        if known is None or known[0] != at:
            if (here, kind) not in self._standing:
                doubts = enclave_doubts(enclave, profile.trust, self._accesses.row(profile.access), self._accesses)
                reasons = tuple(self._refusals(enclave, profile))
                self._standing[here, kind] = reasons, tuple(doubt.reason for doubt in doubts)
            standing, unknown = self._standing[here, kind]
            reasons = (*standing, *self._refusals_at(enclave, grants, profile, at))
            truth = Truth.NO if reasons else Truth.UNKNOWN if unknown else Truth.YES
            known = (at, Usability(usable=truth, reasons=reasons or unknown))
            self._answers[alike, now] = self._answers[here, now] = known
        named = {NO_GRANT, FIRST_IS_OVER}  # reasons that are told with the subject
        if named.isdisjoint(known[1].reasons):
            return known[1]
        subject = (enclave.identity.subject if enclave.identity is not None else "") or "the empty subject"
        told = (each.format(subject) if each in named else each for each in known[1].reasons)
        return replace(known[1], reasons=tuple(told))

    def _own_of(self, enclave: Enclave, profile: Profile) -> tuple[int, int, _Grants]:
        """Two numbers and its grants. Enclaves with the same first number start alike, as long as the same of their own
        is in force. With the same second number, the files that they share are in one place, and no copies.
        """
        directory, row = enclave.files.directory, self._accesses.row(profile.access)
        known = self._own.get((directory, row, profile.trust.subjects))
        if known is None:
            grants = self._accesses.own_grants(enclave, profile)
            read = self._accesses.read(enclave.permissions, row) if enclave.permissions is not None else None
            rules = (
                (each.default_allow, *[(rule.allow, rule.domains) for rule in each.rules]) for each in grants or ()
            )
            seen: object = directory if read is not None and read.is_silent else _seen(enclave)
            governance = enclave.governance and id(self._accesses.read(enclave.governance, row))
            alike = seen, governance, row, profile.trust.subjects, read and read.refusal, grants is None, tuple(rules)
            number = self._alike.setdefault(alike, len(self._alike))
            shared = number, enclave.identity_ca, enclave.permissions_ca, enclave.governance
            here = self._alike.setdefault(shared, len(self._alike))
            known = self._own[directory, row, profile.trust.subjects] = number, here, grants
        return known

    def _refusals(self, enclave: Enclave, profile: Profile) -> Iterator[str]:
        """Reasons that hold at every instant, in order of the files."""
        yield from refusals(enclave, profile.trust)
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            if read is not None and enclave.permissions_ca is not None:
                unsigned = signature_refusal(role, read.signed, enclave.permissions_ca, profile.trust)
                if unsigned is not None:
                    yield unsigned
                refusal = self._accesses.read(read, profile.access).refusal
                if refusal is not None:
                    yield f"it refuses {role.value}.p7s: {refusal}"
        if self._governed_domains(enclave.governance, profile) == () and not profile.local.starts_ungoverned:
            yield UNGOVERNED[0] if self.domain is None else f"{UNGOVERNED[1]} {self.domain}"

    def _refusals_at(self, enclave: Enclave, grants: _Grants, profile: Profile, at: datetime) -> Iterator[str]:
        """Reasons that hold `at` an instant."""
        yield from refusals_at(enclave, profile.trust, at)
        if grants is None:
            return
        access = profile.access
        eligible = (grant for grant in grants if in_force(grant, at) or not access.skips_grants_out_of_date)
        grant = next(eligible, None)
        if grant is None or not (in_force(grant, at) or access.joins_out_of_date):
            yield without_grant(grants, at)
        else:
            domains = self._governed_domains(enclave.governance, profile)
            yield from join_refusals(domains, grant, profile.local.joins) if domains is not None else ()

    def _governed_domains(self, file: GovernanceFile | None, profile: Profile) -> Governed | None:
        """The domains in question, each with the domain rules that decide; None where the document says nothing."""
        if file is None or self._accesses.read(file, profile.access).domain_rules is None:
            return None
        key = (file.signed.file.place, self._accesses.row(profile.access))
        if key not in self._governed:
            self._governed[key] = governed(self._accesses.deciding(file, profile.access), self.domain, profile.access)
        return self._governed[key]


@lru_cache(maxsize=1)  # asked under each kind of implementation, one enclave after the other
def _seen(enclave: Enclave) -> object:
    """All that bears on whether an enclave starts, except its grants and the dates of its certificate. Where something
    is in doubt, or there are revocation lists, it is the directory: the enclave is like no other.
    """
    signed = enclave.permissions.signed if enclave.permissions is not None else None
    listed = enclave.crl is not None or enclave.files.files[Role.CRL].status.unknown or lists_carried(enclave)
    if listed or file_doubts(enclave) or (signed is not None and envelope(signed).verdict is Truth.UNKNOWN):
        return enclave.files.directory
    certificate, governance = enclave.identity, enclave.governance
    file, permissions_ca = (each and file_alike(each) for each in (enclave.identity_ca, enclave.permissions_ca))
    return (
        absent(enclave),
        enclave.key is not None and enclave.key.encrypted,
        other_key(enclave),
        certificate and (bool(certificate.unknown_critical), certificate.key_kind, certificate.signature_algorithm),
        file,
        permissions_ca,
        governance and governance_alike(governance),
        certificate_alike(certificate, file) if certificate is not None and file is not None else None,
        document_alike(signed) if signed is not None else None,
    )
