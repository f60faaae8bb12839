"""Endpoints that an enclave's own implementation decides about otherwise than its peers: those that it creates although
peers would refuse them, and those that it refuses it although peers would take them.

Whoever attacks gives its keys to anybody, and takes samples from anybody. So what gets from an attacker to an honest
enclave is bounded by what that one's own implementation lets it read, and what gets from an honest enclave to an
attacker, or to anybody on the network, by what its own lets it write: not by what honest peers concede. Some
implementations let it do more: Fast DDS applies rules of other domains to its own endpoints, Cyclone DDS lets a
participant start wherever some topic has no access control (docs/profiles.md).

And data gets somewhere while nobody attacks only if the implementations on the way create their own endpoints. Some
refuse what they would concede to a peer: to its own endpoints Fast DDS applies deny rules of other domains too, and a
`<relay>` gives them nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import NamedTuple

from keystore_audit.keystore.governance import GovernanceFile
from keystore_audit.keystore.keystore import Enclave, Keystore, every_certificate
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.decision import LocalRights, wildcard_names
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Meetings
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.profiles import Access, Profile
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.trust.revocation import ends_of_lists
from keystore_audit.model.validity import END


class Endpoints(NamedTuple):
    """Channels on which it decides about readers and writers of the enclave."""

    reads: frozenset[int]
    writes: frozenset[int]


NO_ENDPOINTS = Endpoints(frozenset(), frozenset())


class LocalMoments:
    """What an enclave's own implementation decides, now and at each later instant at which another grant may count, or
    at which it may come to start. Of the enclaves of one keystore, from `at` (aware UTC) on.
    """

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
        documents = (document for document in (enclave.governance, enclave.permissions) if document is not None)
        choices = [enclave.trusts(Role.IDENTITY_CA), enclave.trusts(Role.PERMISSIONS_CA)]
        choices += [document.signed.embedded for document in documents]
        # Where one of several authorities ends, another of its name is tried (`trust.verdicts.issuers_taken`).
        ends.update(each.not_after for authorities in choices if len(authorities) > 1 for each in authorities)
        later = {end + datetime.resolution for end in ends}.union(lists, (grant.not_before for grant in grants))
        later.update(certificate.not_before for certificate in every_certificate((enclave,), (), ()))
        for at in (self._at, *sorted(moment for moment in later if moment > self._at)):
            if at not in self._rights:
                self._rights[at] = LocalRights(self._accesses, self._channels, at)
            yield at, self._rights[at]


class Alone(NamedTuple):
    """What its own implementation lets an enclave do where it possibly starts, and where it certainly does."""

    possible: Endpoints
    certain: Endpoints


NOTHING = Alone(NO_ENDPOINTS, NO_ENDPOINTS)
"""Of an enclave whose implementation lets it do nothing but what its peers concede it."""


class LoneEndpoints:
    """Those that are created: of the enclaves of one keystore, and of `holders` beside them, at all the `moments`.

    `meets`: by channel, those in which endpoints of its partition are met; empty where partitions are plain names.
    """

    def __init__(
        self,
        keystore: Keystore,
        accesses: AccessViews,
        channels: Channels,
        moments: LocalMoments,
        meets: Sequence[frozenset[int]],
        holders: Iterable[Enclave] = (),
    ) -> None:
        self._enclaves = (*keystore.enclaves, *holders)
        self._accesses = accesses
        self._channels = channels
        self._moments = moments
        self._meetings = Meetings(meets)
        self._odd_names = bool(wildcard_names(channels))
        self._differing: dict[tuple[Access, bool], set[int]] = {}
        self._usabilities = Usabilities(None, accesses)
        self._ruled: dict[tuple[str, Access], frozenset[int]] = {}
        self._sets: dict[int, frozenset[int]] = {}

    def of(self, profile: Profile) -> tuple[Alone, ...]:
        """By enclave, then by holder; empty where none may differ from what peers concede it."""
        row = self._accesses.row(profile.access)
        odd_names = self._odd_names and profile.local.reads_names_as_expressions
        if (row, odd_names) not in self._differing:
            self._differing[row, odd_names] = {
                number
                for number, enclave in enumerate(self._enclaves)
                if enclave.governance is not None
                and (odd_names or self._may_differ(enclave.governance, self._moments.grants(enclave, row), row))
            }
        differing = self._differing[row, odd_names]
        if not differing:  # nearly always
            return ()
        enclaves = enumerate(self._enclaves)
        found = tuple(self._alone(each, profile) if number in differing else NOTHING for number, each in enclaves)
        return found if any(any(each.possible) for each in found) else ()

    def _alone(self, enclave: Enclave, profile: Profile) -> Alone:
        reads, writes = (self._allowed(enclave, profile, each) for each in (Operation.SUBSCRIBE, Operation.PUBLISH))
        return Alone(*(Endpoints(*sides) for sides in zip(reads, writes, strict=True)))

    def _allowed(self, enclave: Enclave, profile: Profile, operation: Operation) -> tuple[frozenset[int], ...]:
        """The channels on which it is allowed, in domains in which it possibly and in which it certainly starts."""
        possible, certain = 0, 0
        for at, local in self._moments.of(enclave, profile):
            allowed = self._meetings.met(local.allowed(enclave, profile, operation))
            for domain in range(len(self._channels.domains)):
                here = allowed & self._channels.bits_in(domain)
                if here:
                    lowest = self._channels.domains[domain].intervals[0][0]
                    usable = self._usabilities.in_domain(lowest).of(enclave, at, profile).usable
                    possible |= here if usable is not False else 0
                    certain |= here if usable else 0
        return self._set(possible), self._set(certain)

    def _set(self, channels: int) -> frozenset[int]:
        """The channels of a bit set; the same object for the same ones, of which there may be 300,000."""
        if channels not in self._sets:
            self._sets[channels] = frozenset(members(channels))
        return self._sets[channels]

    def _may_differ(self, governance: GovernanceFile, grants: Iterable[ReadGrant], access: Access) -> bool:
        """Whether the enclave might do what peers would not concede it.

        It might not where each rule of its grants is about all domains that the governance covers, and about its own
        endpoints as about those of peers: then peers let it join them all, and rules apply there as they do here.
        It may where any rule of the governance counts, while the first alone says what is protected.
        """
        ruled = self._ruled_by(governance, access)
        return access.any_governance_rule or any(
            not (grant.default_allow or any(rule.allow for rule in grant.rules))
            or any(rule.of_peers or not ruled <= self._channels.covered(rule.domains) for rule in grant.rules)
            for grant in grants
        )

    def _ruled_by(self, governance: GovernanceFile, access: Access) -> frozenset[int]:
        """The domain classes that some rule of the governance is about."""
        key = (governance.signed.file.place, access)
        if key not in self._ruled:
            rules = self._accesses.deciding(governance, access)
            self._ruled[key] = frozenset[int]().union(*(self._channels.covered(rule.domains) for rule in rules))
        return self._ruled[key]


class LoneRefusals:
    """Those that are refused: of the enclaves of one keystore, at any of the `moments`."""

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
