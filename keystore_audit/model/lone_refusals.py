"""Endpoints that an enclave's own implementation refuses it although its peers would take them.

Data gets somewhere while nobody attacks only if the implementations on the way create their own endpoints; and some
refuse what they would concede to a peer: to its own endpoints Fast DDS applies deny rules of other domains too, and a
`<relay>` gives them nothing (docs/profiles.md).
"""

from __future__ import annotations

from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.local_moments import NO_ENDPOINTS, Endpoints, LocalMoments
from keystore_audit.model.permission import members
from keystore_audit.model.profiles import Profile
from keystore_audit.model.semantics import ReadGrant


class LoneRefusals:
    """Of the enclaves of one keystore: what is refused at any of the `moments` counts."""

    def __init__(self, keystore: Keystore, moments: LocalMoments) -> None:
        self._enclaves = keystore.enclaves
        self._moments = moments
        governances = (enclave.governance for enclave in keystore.enclaves if enclave.governance is not None)
        self._several = len({governance.signed.file.sha256 for governance in governances}) > 1

    def of(self, profile: Profile) -> tuple[Endpoints, ...]:
        """By enclave; empty where no implementation refuses what peers concede."""
        found = tuple(self._refused(enclave, profile) for enclave in self._enclaves)
        return found if any(any(each) for each in found) else ()

    def _refused(self, enclave: Enclave, profile: Profile) -> Endpoints:
        grants = self._moments.grants(enclave, profile.access)
        if not any(self._may_refuse(grant, profile) for grant in grants):  # nearly always
            return NO_ENDPOINTS
        reads, writes = 0, 0
        for _at, local in self._moments.of(enclave, profile):
            reads |= self._conceded_not_allowed(local, enclave, profile, Operation.SUBSCRIBE)
            writes |= self._conceded_not_allowed(local, enclave, profile, Operation.PUBLISH)
        return Endpoints(frozenset(members(reads)), frozenset(members(writes)))

    @staticmethod
    def _conceded_not_allowed(local: LocalRights, enclave: Enclave, profile: Profile, operation: Operation) -> int:
        return local.conceded(enclave, profile, operation) & ~local.allowed(enclave, profile, operation)

    def _may_refuse(self, grant: ReadGrant, profile: Profile) -> bool:
        """Whether its rules may decide otherwise about the enclave's own endpoints than about those of a peer."""
        if all(rule.allow and not rule.of_peers for rule in grant.rules):  # nearly always
            return False
        if any(rule.of_peers for rule in grant.rules):
            return True
        if not profile.local.binds_domains and len({rule.domains for rule in grant.rules}) > 1:
            return True
        return profile.access.first_rule_decides_topic and self._several  # each asks its own governance
