"""Drift: what a policy grants and what the signed permissions grant, compared by meaning and both ways.

Compared are rule lists: the grant which sros2 would write (`policy_grant`), and the grant which the enclave's
implementation takes. So is any other that a peer may take for the enclave's. Governance is left aside: where
it has access control off, and what it does not cover, are findings of their own. Names, partitions and domains are
compared in classes, exactly; `ros_discovery_info` is never drift, since DDS needs it and Zenoh has none.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from datetime import datetime

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.intent.policy import Policy, Profiles
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.intended.drift_rights import Comparison, DriftedRights, PolicyGrant, Taken, policy_grant
from keystore_audit.model.inventory import documents_of, may_be_taken, permissions_cas
from keystore_audit.model.participants.doubt import document_doubt, identity_doubt, opens
from keystore_audit.model.question import Doubt
from keystore_audit.model.semantics import deciding_grant
from keystore_audit.model.subjects.comparison import matching
from keystore_audit.profiles import Profile, SubjectComparison


class EnclaveDrift(Struct, frozen=True, kw_only=True):
    """The drift of one enclave against one document (its place).

    `own`: the enclave carries the document; else a peer may take it for the enclave's. `granted`: whether a grant of it
    names the enclave; None: there is no document. `policy`: where the policy introduces the enclave.
    """

    enclave: str
    document: str
    own: bool
    granted: bool | None
    policy: Location
    lacking: DriftedRights
    exceeding: DriftedRights


class Drift(Struct, frozen=True, kw_only=True):
    """Everything that differs between a policy and a keystore.

    `undecided`: what could not be compared. `missing`: what the policy says of enclaves that the keystore does not
    have. `unnamed`: enclaves of which the policy says nothing. `lost`: what the policy says and no implementation asks.
    `unenforced`: no enclave has permissions, as where rmw_zenoh alone runs; nothing is compared then.
    """

    policy: Policy
    enclaves: tuple[EnclaveDrift, ...]
    undecided: tuple[Doubt, ...]
    missing: tuple[Profiles, ...]
    unnamed: tuple[Enclave, ...]
    lost: tuple[Profiles, ...]
    unenforced: bool


def drift(
    keystore: Keystore,
    policy: Policy,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    domain: int | None = None,
) -> Drift:
    """Compare the policy with the keystore as the profiles read it at `at` (aware UTC).

    `domain`: the one that robots use; None: those that governance and grant of an enclave have in common.
    """
    counting = {each.enclave: each for each in policy.profiles if not each.lost}
    known = {enclave.path for enclave in keystore.enclaves}
    whole = keystore.layout.kind is not LayoutKind.ENCLAVE
    unenforced = not any(_has_permissions(enclave) for enclave in keystore.enclaves)
    found = _Search(keystore, profiles, at, accesses, domain)
    compared = [] if unenforced else [e for e in keystore.enclaves if e.path in counting]
    drifts = [each for enclave in compared for each in found.of(enclave, counting[enclave.path])]
    return Drift(
        policy=policy,
        enclaves=tuple(drifts),
        undecided=tuple(found.undecided),
        missing=tuple(each for path, each in counting.items() if path not in known) if whole else (),
        unnamed=tuple(enclave for enclave in keystore.enclaves if enclave.path not in counting),
        lost=tuple(each for each in policy.profiles if each.lost),
        unenforced=unenforced,
    )


def _has_permissions(enclave: Enclave) -> bool:
    return enclave.files.files[Role.PERMISSIONS].status is not Status.MISSING


class _Search:
    """The documents of one keystore, asked enclave by enclave."""

    def __init__(
        self,
        keystore: Keystore,
        profiles: Sequence[Profile],
        at: datetime,
        accesses: AccessViews,
        domain: int | None,
    ) -> None:
        self._profiles = profiles
        self._at = at
        self._accesses = accesses
        self._domain = domain
        self._naming = _Naming(keystore)
        self.undecided: list[Doubt] = []

    def of(self, enclave: Enclave, profiles: Profiles) -> Iterator[EnclaveDrift]:
        """Where the enclave's rights differ from the policy."""
        meant = policy_grant(profiles)
        certificate = enclave.identity
        doubt = self._doubt(enclave)
        if doubt is not None:
            self.undecided.append(doubt)
            return
        if certificate is None:
            return  # that it has no identity is another rule's finding, and nothing can be granted to nobody
        if enclave.permissions is None:
            place = enclave.files.files[Role.PERMISSIONS].place
            nothing = [Taken(profile=profile, read=None) for profile in self._profiles]
            yield from self._compared(enclave, profiles, meant, place, nothing, own=True)
            return
        for file in (enclave.permissions, *self._naming.elsewhere(enclave, certificate)):
            own = file is enclave.permissions
            taken = list(self._taken(file, certificate, own=own))
            yield from self._compared(enclave, profiles, meant, file.signed.file.place, taken, own=own)

    def _compared(
        self,
        enclave: Enclave,
        profiles: Profiles,
        meant: PolicyGrant,
        place: str,
        taken: Sequence[Taken],
        *,
        own: bool,
    ) -> Iterator[EnclaveDrift]:
        comparison = Comparison(meant, place, self._accesses, self._domain)
        try:
            lacking, exceeding = comparison.compare(taken, enclave.governance, both=own)
        except BudgetExceeded as exceeded:
            self._undecide(enclave, Location(path=place), exceeded.message)
            return
        for location, reason in comparison.undefined:
            self._undecide(enclave, location, reason)
        if lacking.rights or exceeding.rights:
            granted = None if enclave.permissions is None else any(each.read is not None for each in taken)
            yield EnclaveDrift(
                enclave=enclave.path,
                document=place,
                own=own,
                granted=granted,
                policy=profiles.location,
                lacking=lacking,
                exceeding=exceeding,
            )

    def _undecide(self, enclave: Enclave, location: Location, reason: str) -> None:
        self.undecided.append(Doubt(enclave=enclave.path, location=location, reason=reason))

    def _doubt(self, enclave: Enclave) -> Doubt | None:
        """Why it is unknown what the enclave's own permissions grant it."""
        doubt = identity_doubt(enclave)
        if opens(doubt):
            return doubt
        file = enclave.files.files[Role.PERMISSIONS]
        if file.status.unknown:
            return Doubt(enclave=enclave.path, location=Location(path=file.path), reason=file.detail)
        if enclave.permissions is None:
            return None
        for row in self._accesses.rows(self._profiles):
            read = self._accesses.read(enclave.permissions, row)
            if read.is_silent:
                return document_doubt(enclave.path, enclave.permissions, read)
        return None

    def _taken(self, file: PermissionsFile, certificate: Certificate, *, own: bool) -> Iterator[Taken]:
        """By profile, the grant that decides. What an implementation refuses as a whole is another rule's finding."""
        for profile in self._profiles:
            row = self._accesses.row(profile.access)
            read = self._accesses.read(file, row)
            if read.grants is None:
                continue
            subjects = self._naming.subjects(certificate, profile.trust.subjects)
            named = [grant for grant in read.grants if grant.grant.subject_name.text in subjects]
            chosen = deciding_grant(named, self._at, row)
            if own:  # of these the first where none is in force: that it is not in force is another rule's finding
                chosen = chosen or next(iter(named), None)
            if chosen is not None or own:
                yield Taken(profile=profile, read=chosen)


class _Naming:
    """Which grants name which identity, computed once for the whole keystore."""

    def __init__(self, keystore: Keystore) -> None:
        files = [document.file for document in documents_of(keystore)]
        self._files = [file for file in files if isinstance(file, PermissionsFile) and file.permissions is not None]
        self._authorities = permissions_cas(keystore)
        identities = filter(None, (enclave.identity for enclave in keystore.enclaves))
        self._certificates = list({each.sha256: each for each in identities}.values())
        self._holding: dict[str, list[PermissionsFile]] = {}
        for file in self._files:
            for subject in file.subjects:
                self._holding.setdefault(subject, []).append(file)
        self._subjects: dict[SubjectComparison, dict[str, frozenset[str]]] = {}

    def subjects(self, certificate: Certificate, comparison: SubjectComparison) -> Collection[str]:
        """The texts that are taken to name the certificate."""
        if comparison not in self._subjects:
            found: dict[str, set[str]] = {each.sha256: set() for each in self._certificates}
            for text, numbers in matching(list(self._holding), self._certificates, comparison).items():
                for number in numbers:
                    found[self._certificates[number].sha256].add(text)
            self._subjects[comparison] = {sha256: frozenset(texts) for sha256, texts in found.items()}
        return self._subjects[comparison].get(certificate.sha256, frozenset())

    def elsewhere(self, enclave: Enclave, certificate: Certificate) -> Iterator[PermissionsFile]:
        """Documents other than the enclave's own that name it and that a peer may take."""
        own = enclave.permissions
        texts = {text for comparison in SubjectComparison for text in self.subjects(certificate, comparison)}
        files = dict.fromkeys(file for text in sorted(texts) for file in self._holding[text])
        for file in files:
            if file is own or (own is not None and file.signed.file.sha256 == own.signed.file.sha256):
                continue
            if may_be_taken(file.signed, self._authorities):
                yield file
