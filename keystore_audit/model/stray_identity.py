"""Identities that lie beside the enclaves and that peers of theirs take for one of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import islice

from keystore_audit.dataclass import dataclass
from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.permissions import Grant, PermissionsFile
from keystore_audit.keystore.stray_identity import StrayIdentity
from keystore_audit.model.inventory import authorities_of, documents_of, may_be_taken, permissions_cas
from keystore_audit.model.profiles import Profile
from keystore_audit.model.revocation import revoked
from keystore_audit.model.subject import matching
from keystore_audit.model.trust import is_issued
from keystore_audit.model.validity import ANY_ZONE, DateReading, read_date
from keystore_audit.model.views import TrustFiles, trust_files


@dataclass(frozen=True, slots=True, kw_only=True)
class Admitted:
    """An identity beside the enclaves that peers take. `key`: where its private key lies.

    `rights`: what lets it in: grants that name it, in documents that a peer may take, or a governance that wants none.
    `enclave`: one that has the same subject, and so the same rights already; None: nobody has.
    """

    certificate: Certificate
    key: str
    rights: tuple[Location, ...]
    enclave: str | None


def admitted(
    keystore: Keystore, strays: Sequence[StrayIdentity], profiles: Sequence[Profile], at: datetime
) -> tuple[Admitted, ...]:
    """Those of `strays` that some peer takes under some profile `at` an instant, or later by a grant that begins.

    `at`: aware UTC.
    """
    enclaves = list({trust_files(enclave): enclave for enclave in keystore.enclaves}.values())
    authorities = {certificate.key for certificate in authorities_of(keystore)}
    vouched = [
        each
        for each in strays
        if each.certificate.key not in authorities
        and any(_takes(enclave, each.certificate, profile, at) for enclave in enclaves for profile in profiles)
    ]
    if not vouched:  # nearly always
        return ()
    certificates = [each.certificate for each in vouched]
    granted = _granted(keystore, certificates, profiles, at)
    subjects = {each.identity.subject: each.path for each in keystore.enclaves if each.identity is not None}
    open_to_all = [*islice(_without_grants(enclaves), 1)]
    return tuple(
        Admitted(
            certificate=each.certificate,
            key=each.key,
            rights=rights,
            enclave=subjects.get(each.certificate.subject),
        )
        for number, each in enumerate(vouched)
        if (rights := tuple(granted.get(number, open_to_all)))
    )


def _takes(enclave: Enclave, certificate: Certificate, profile: Profile, at: datetime) -> bool:
    """Whether the enclave authenticates who has the certificate; its dates count."""
    file, trust = enclave.identity_ca, profile.trust
    return (
        file is not None
        and at <= certificate.not_after
        and is_issued(file, certificate, trust)
        and not revoked(enclave, (certificate,), trust, at)
    )


def _granted(
    keystore: Keystore, certificates: Sequence[Certificate], profiles: Sequence[Profile], at: datetime
) -> dict[int, list[Location]]:
    """By certificate, the grants that have not ended and name it, in documents that some peer may take."""
    files = permissions_cas(keystore)
    grants = [
        (grant, Location(path=file.signed.file.place, line=grant.line))
        for document in documents_of(keystore)
        if isinstance(file := document.file, PermissionsFile) and may_be_taken(file.signed, files)
        for grant in file.grants
        if not _ended(grant, at)
    ]
    texts = list(dict.fromkeys(grant.subject_name.text for grant, _place in grants))
    named: dict[str, set[int]] = {text: set() for text in texts}
    for comparison in dict.fromkeys(profile.trust.subjects for profile in profiles):
        for text, numbers in matching(texts, certificates, comparison).items():
            named[text] |= numbers
    found: dict[int, list[Location]] = {}
    for grant, place in grants:
        for number in named[grant.subject_name.text]:
            found.setdefault(number, []).append(place)
    return found


def _ended(grant: Grant, at: datetime) -> bool:
    """Whether every implementation takes it for over, wherever the robot is."""
    dated = read_date(grant.not_after.text, DateReading.XSD, None)
    return dated is not None and at - dated.instant > ANY_ZONE


def _without_grants(enclaves: Sequence[Enclave]) -> Iterator[Location]:
    """Governances under which whoever is authenticated may join."""
    for enclave in enclaves:
        file: GovernanceFile | None = enclave.governance
        for rule in file.governance.domain_rules if file is not None and file.governance is not None else ():
            if file is not None and not rule.enable_join_access_control:
                yield Location(path=file.signed.file.place, line=rule.line)


class Takers:
    """Which enclaves of a keystore authenticate somebody `at` an instant (aware UTC), or later."""

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._at = at
        self._alike: dict[TrustFiles, list[Enclave]] = {}
        for enclave in keystore.enclaves:
            self._alike.setdefault(trust_files(enclave), []).append(enclave)

    def of(self, certificate: Certificate, profiles: Sequence[Profile]) -> Iterator[str]:
        """The paths of those that do so under some of the profiles."""
        for enclaves in self._alike.values():
            if any(_takes(enclaves[0], certificate, profile, self._at) for profile in profiles):
                yield from (enclave.path for enclave in enclaves)
