"""What an enclave's own implementation decides, now and at each later instant at which another grant may count, or at
which it may come to start.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import NamedTuple

from keystore_audit.keystore.keystore import Enclave, every_certificate
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.profiles import Access, Profile
from keystore_audit.model.revocation import ends_of_lists
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.validity import END


class Endpoints(NamedTuple):
    """Channels on which it decides about readers and writers of the enclave."""

    reads: frozenset[int]
    writes: frozenset[int]


NO_ENDPOINTS = Endpoints(frozenset(), frozenset())


class LocalMoments:
    """Of the enclaves of one keystore, from `at` (aware UTC) on; each instant is worked out once."""

    def __init__(self, accesses: AccessViews, channels: Channels, at: datetime) -> None:
        self._accesses = accesses
        self._channels = channels
        self._at = at
        self._rights: dict[datetime, LocalRights] = {}

    def grants(self, enclave: Enclave, access: Access) -> tuple[ReadGrant, ...]:
        """What its own document grants, to whomever."""
        return () if enclave.permissions is None else self._accesses.read(enclave.permissions, access).grants or ()

    def of(self, enclave: Enclave, profile: Profile) -> Iterator[tuple[datetime, LocalRights]]:
        """The instants, and what is decided then."""
        grants = self.grants(enclave, profile.access)
        lists = ends_of_lists(enclave, profile.trust, self._at)
        ends = {grant.not_after for grant in grants if grant.not_after < END}.union(lists)
        later = {end + datetime.resolution for end in ends}.union(lists, (grant.not_before for grant in grants))
        later.update(certificate.not_before for certificate in every_certificate((enclave,), (), ()))
        for at in (self._at, *sorted(moment for moment in later if moment > self._at)):
            if at not in self._rights:
                self._rights[at] = LocalRights(self._accesses, self._channels, at)
            yield at, self._rights[at]
