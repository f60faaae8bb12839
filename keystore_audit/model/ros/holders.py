"""The grants that peers take from each enclave, and the services that their texts are about."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.domains import Interval, contains
from keystore_audit.model.formal.attacker import RealmView, enclaves_views
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import EnclaveAtom, System
from keystore_audit.model.matching.coverage import allows_everything
from keystore_audit.model.matching.expression import any_matches, has_wildcard
from keystore_audit.model.ros.classes import REPLY, REQUEST
from keystore_audit.model.ros.texts import Lines
from keystore_audit.model.semantics import Area, ReadGrant
from keystore_audit.profiles import Access, Matcher

_PARTITIONS: Final = ("", "*")
"""Partitions in which an endpoint meets those of ROS 2: the default one, and the name that is a pattern for it."""


class Placed:
    """A grant with the document it stands in, and what its publish criteria list, by the kind of name."""

    def __init__(self, place: str, grant: ReadGrant) -> None:
        self.place = place
        self.grant = grant
        self.lines = Lines(grant.grant)
        texts = [text for rule in grant.rules if rule.allow for text in rule.texts(Operation.PUBLISH)]
        self.requests = REQUEST.between(texts)
        self.replies = REPLY.between(texts)
        self.certain = _certain(grant)
        self.wild: tuple[str, ...] = ()
        self.everything = grant.default_allow
        self.allows_only = all(rule.allow for rule in grant.rules)
        if has_wildcard("\n".join(texts)):
            self.wild = tuple(dict.fromkeys(t for t in texts if has_wildcard(t) and not t.startswith("rt/")))
            self.requests = {name for name in self.requests if not has_wildcard(name)}
            self.replies = {name for name in self.replies if not has_wildcard(name)}
            self.everything = self.everything or allows_everything(grant.grant)

    @property
    def expressions(self) -> Iterator[str]:
        """All that its publish criteria list, of rules that allow and that deny."""
        return (text for rule in self.grant.rules for text in rule.texts(Operation.PUBLISH))


def _certain(grant: ReadGrant) -> tuple[Interval, ...] | None:
    """The domains in which whatever an allow rule lists is allowed, in the default partition; None: look closer."""
    domains = grant.rules[0].domains if grant.rules else ()
    for rule in grant.rules:
        if (
            not rule.allow
            or rule.domains != domains
            or any("" not in (area.partitions or ("",)) for area in rule.publish)
        ):
            return None
    return domains


class Holder:
    """An enclave (its path) with the grants that peers take from it, `own` those of its own document.

    `requests`, `replies`: services that they list by name; `wild_requests`, `wild_replies`: patterns.
    `everything`: some grant allows everything, by its rules or by default.
    """

    def __init__(self, path: str, grants: tuple[Placed, ...], own: tuple[Placed, ...]) -> None:
        self.path = path
        self.grants = grants
        self.own = own
        self.everything = any(grant.everything for grant in grants)
        self.allows_only = all(grant.allows_only for grant in grants)
        self.certain = {domains for grant in grants if (domains := grant.certain)} if len(grants) == 1 else set()
        self.requests: set[str] = set().union(*(grant.requests for grant in grants))
        self.replies: set[str] = set().union(*(grant.replies for grant in grants))
        wild = tuple(dict.fromkeys(text for grant in grants for text in grant.wild))
        self.wild_requests = tuple(text for text in wild if not text.startswith("rr/"))
        self.wild_replies = tuple(text for text in wild if not text.startswith("rq/"))

    @property
    def expressions(self) -> Iterator[str]:
        """Everything that its publish criteria list."""
        return (text for grant in self.grants for text in grant.expressions)

    def right(self, operation: Operation, topic: str) -> Location | None:
        """The line that lists the topic for the operation."""
        for placed in self.grants:
            line = placed.lines.of(operation, topic)
            if line is not None:
                return Location(path=placed.place, line=line)
        return None


class Holders:
    """Makes the holders of one keystore's systems; what several have in common is made once.

    `files`: permissions documents by place.
    """

    def __init__(self, files: Mapping[str, PermissionsFile], accesses: AccessViews) -> None:
        self._files = files
        self._accesses = accesses
        self._placed: dict[tuple[str, int, Access], Placed] = {}
        self._known: dict[tuple[str, tuple[Placed, ...], tuple[Placed, ...]], Holder] = {}

    def of(self, system: System, row: Access) -> tuple[Holder, ...]:
        """The enclaves of the system, whose documents implementations of the row read; equal ones are one object.

        Nodes are in enclaves: identities at large are no holders.
        """
        permissions = Permissions(system)
        realms = enclaves_views(system, permissions)
        placed = list(self._grants(system, row))
        return tuple(
            self._holder(number, enclave, realms, permissions, placed)
            for number, enclave in enumerate(system.enclaves)
            if not enclave.at_large
        )

    def _holder(
        self,
        number: int,
        enclave: EnclaveAtom,
        realms: Sequence[RealmView],
        permissions: Permissions,
        placed: Sequence[Placed | None],
    ) -> Holder:
        taken: dict[int, None] = {}
        for realm in realms:
            if realm.authenticated(number):
                taken.update(dict.fromkeys(permissions.chosen(enclave.identity, realm.accepted)))
        carried = frozenset(() if enclave.permissions is None else (enclave.permissions,))
        own = permissions.chosen(enclave.identity, carried)
        grants = tuple(each for each in (placed[grant] for grant in taken) if each is not None)
        mine = tuple(each for each in (placed[grant] for grant in own if grant in taken) if each is not None)
        key = (enclave.label, grants, mine)
        if key not in self._known:
            self._known[key] = Holder(*key)
        return self._known[key]

    def _grants(self, system: System, row: Access) -> Iterator[Placed | None]:
        """The grants of the system in order: those of each document as it lists them."""
        counted: dict[int, int] = {}
        for atom in system.grants:
            ordinal = counted.get(atom.document, 0)
            counted[atom.document] = ordinal + 1
            place = system.documents[atom.document].location.path
            key = (place, ordinal, row)
            if key not in self._placed:
                file = self._files.get(place)
                grants = (self._accesses.read(file, row).grants or ()) if file is not None else ()
                if ordinal >= len(grants):
                    yield None
                    continue
                self._placed[key] = Placed(place, grants[ordinal])
            yield self._placed[key]


def allows(placed: Placed, matcher: Matcher, operation: Operation, topic: str, domain: int) -> bool:
    """Whether the first rule of the grant that matches allows it, in a partition that meets the default one."""
    grant = placed.grant
    return any(_allows(grant, matcher, operation, topic, domain, partition) for partition in _PARTITIONS)


def _allows(grant: ReadGrant, matcher: Matcher, operation: Operation, topic: str, domain: int, partition: str) -> bool:
    for rule in grant.rules:
        if contains(rule.domains, domain) and any(
            _matches(area, matcher, topic, partition) for area in rule.region(operation)
        ):
            return rule.allow
    return grant.default_allow


def _matches(area: Area, matcher: Matcher, topic: str, partition: str) -> bool:
    if area.partitions is not None and not any_matches(area.partitions, partition, matcher):
        return False
    return topic in area.topics or any_matches(filter(has_wildcard, area.topics), topic, matcher)
