"""Whether a grant has an effect: who accepts a finding about one that has none does not accept that it gets one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cached_property
from hashlib import sha256
from typing import Final

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.document import MAX_DOMAIN, Text
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.permissions import Grant, PermissionsFile
from keystore_audit.model.domains import covered, domain_bits
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.subjects.comparison import matching
from keystore_audit.model.trust.revocation import revoked
from keystore_audit.model.trust.verdicts import is_issued
from keystore_audit.model.validity import DateReading, read_date
from keystore_audit.rules.subjects import ROWS, governance_uses

_BY_TRUST: Final = {trust: [profile.name for profile in VARIANTS.values() if profile.trust == trust] for trust in ROWS}
"""The names of the implementations that trust alike: each row is asked once."""


def instant_of(date: Text) -> datetime | None:
    """The instant that a date of a grant names to the specification, None for years that nobody reads.

    Where implementations read another one, date-read-differently and date-not-portable say so.
    """
    dated = read_date(date.text, DateReading.XSD, None)
    return dated.instant if dated is not None else None


class Effects:
    """What the effect of grants rests on besides what they say, in one keystore `at` an instant (aware UTC)."""

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._keystore = keystore
        self._at = at
        self._told: dict[str, str] = {}
        self._lists: dict[tuple[int, Trust], frozenset[Certificate]] = {}

    def of(self, grants: Sequence[Grant]) -> Iterator[str]:
        """For each grant of a document: whether it is in force, in which governed domains it allows anything, whether
        peers let in whom it names, and which grants stand before it, since the first that names somebody may be the
        only one that counts.
        """
        before = ""
        for grant in grants:
            in_force = self._in_force(grant)
            yield f"{in_force} {self._allowed(grant) & self._governed:x} {self._let_in(grant)}{before}"
            before = sha256(
                f"{before}\0{in_force}\0{grant.subject_name.text}".encode("utf-8", "surrogatepass")
            ).hexdigest()

    def _in_force(self, grant: Grant) -> bool:
        start, end = instant_of(grant.not_before), instant_of(grant.not_after)
        return start is not None and end is not None and start <= self._at <= end

    def _let_in(self, grant: Grant) -> str:
        """Nothing where every implementation lets in all whom the grant names, else whom, and which ones do.

        So a new certificate for the same subject changes nothing.
        """
        text = grant.subject_name.text
        if text not in self._told:
            by: dict[str, set[str]] = {}
            for trust, profiles in _BY_TRUST.items():
                for number in self._named[trust.subjects].get(text, ()):
                    names = by.setdefault(self._identities[number].subject, set())
                    names.update(profiles if self._is_let_in(number, trust) else ())
            everybody = by and all(len(names) == len(VARIANTS) for names in by.values())
            told = sorted((subject, *sorted(names)) for subject, names in by.items() if names)
            self._told[text] = "" if everybody else f"{told} "
        return self._told[text]

    def _is_let_in(self, number: int, trust: Trust) -> bool:
        """Whether some enclave's peers take the identity for what it says."""
        certificate = self._identities[number]
        return certificate.not_before <= self._at <= certificate.not_after and any(
            file is not None
            and is_issued(file, certificate, trust, self._at)
            and certificate not in self._revoked(realm, trust)
            for realm, file in enumerate(each.identity_ca for each in self._realms)
        )

    def _revoked(self, realm: int, trust: Trust) -> frozenset[Certificate]:
        if (realm, trust) not in self._lists:
            found = revoked(self._realms[realm], self._identities, trust, self._at)
            self._lists[realm, trust] = frozenset(found)
        return self._lists[realm, trust]

    @cached_property
    def _realms(self) -> list[Enclave]:
        """Enclaves, one for all that let in the same."""
        files = ((each.identity_ca, each.crl) for each in self._keystore.enclaves)
        digests = (tuple(file.file.sha256 if file else None for file in both) for both in files)
        return list(dict(zip(digests, self._keystore.enclaves, strict=True)).values())

    @cached_property
    def _identities(self) -> list[Certificate]:
        """Whoever's private key may be in the tree."""
        carried = (each.identity for each in self._keystore.enclaves)
        found = [*filter(None, carried), *(each.certificate for each in self._keystore.identities.found)]
        return list({each.sha256: each for each in found}.values())

    @cached_property
    def _named(self) -> dict[SubjectComparison, dict[str, frozenset[int]]]:
        """By implementation and subject_name of a grant, the identities that it names."""
        files = (each.file for each in documents_of(self._keystore) if isinstance(each.file, PermissionsFile))
        texts = {grant.subject_name.text for each in files for grant in each.grants}
        kinds = {profile.trust.subjects for profile in VARIANTS.values()}
        return {kind: matching(sorted(texts), self._identities, kind) for kind in kinds}

    @staticmethod
    def _allowed(grant: Grant) -> int:
        """The domains in which it allows anything, as a bit set."""
        if grant.default_allow:
            return domain_bits([(0, MAX_DOMAIN)])
        return domain_bits(covered(grant.allowed_domains))

    @cached_property
    def _governed(self) -> int:
        """The domains that a governance covers which an enclave carries and somebody may take."""
        taken = (use.document for use in governance_uses(self._keystore) if use.may_be_taken)
        return union(domain_bits(covered(document.domains)) for document in taken)
