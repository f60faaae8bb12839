"""The grants that peers take from each enclave, and the services that their texts are about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from keystore_audit.keystore.permissions import Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.attacker import RealmView
from keystore_audit.model.coverage import allows_everything, has_wildcard
from keystore_audit.model.domains import contains
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.permission import Permissions
from keystore_audit.model.profiles import Access
from keystore_audit.model.ros_texts import line_in
from keystore_audit.model.semantics import Area, ReadGrant
from keystore_audit.model.system import System

_PARTITIONS: Final = ("", "*")
"""Partitions in which an endpoint meets those of ROS 2: the default one, and the name that is a pattern for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Right:
    """The line of a document that lets somebody do something."""

    path: str
    line: int | None


class Placed:
    """A grant with the document it stands in, and what its publish criteria list, by the kind of name."""

    def __init__(self, place: str, grant: ReadGrant) -> None:
        self.place = place
        self.grant = grant
        texts = [text for rule in grant.rules if rule.allow for area in rule.publish for text in area.topics]
        self.requests = {text[2:-7] for text in texts if text.startswith("rq/") and text.endswith("Request")}
        self.replies = {text[2:-5] for text in texts if text.startswith("rr/") and text.endswith("Reply")}
        self.wild: tuple[str, ...] = ()
        self.everything = grant.default_allow
        self.allows_only = all(rule.allow for rule in grant.rules)
        if has_wildcard("\n".join(texts)):
            self.wild = tuple(dict.fromkeys(text for text in texts if has_wildcard(text) and _may_be_service(text)))
            self.requests = {name for name in self.requests if not has_wildcard(name)}
            self.replies = {name for name in self.replies if not has_wildcard(name)}
            self.everything = self.everything or allows_everything(grant.grant)

    @property
    def expressions(self) -> Iterator[str]:
        """All that its publish criteria list, of rules that allow and that deny."""
        return (text for rule in self.grant.rules for area in rule.publish for text in area.topics)


def _may_be_service(text: str) -> bool:
    return not text.startswith("rt/")


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
        self.requests: set[str] = set().union(*(grant.requests for grant in grants))
        self.replies: set[str] = set().union(*(grant.replies for grant in grants))
        wild = tuple(dict.fromkeys(text for grant in grants for text in grant.wild))
        self.wild_requests = tuple(text for text in wild if not text.startswith("rr/"))
        self.wild_replies = tuple(text for text in wild if not text.startswith("rq/"))

    @property
    def expressions(self) -> Iterator[str]:
        """Everything that its publish criteria list."""
        return (text for grant in self.grants for text in grant.expressions)

    def right(self, operation: Operation, topic: str) -> Right | None:
        """The line that lists the topic for the operation."""
        for placed in self.grants:
            line = line_in(placed.grant.grant, operation, topic)
            if line is not None:
                return Right(path=placed.place, line=line)
        return None


def holders(system: System, files: Mapping[str, PermissionsFile], accesses: AccessViews, row: Access) -> list[Holder]:
    """The enclaves of the system; `files`: permissions by place, which implementations of the row read."""
    permissions = Permissions(system)
    realms = [RealmView(system, realm, permissions) for realm in range(len(system.realms))]
    placed = list(_placed(system, files, accesses, row))
    found = []
    for number, enclave in enumerate(system.enclaves):
        taken: dict[int, None] = {}
        for realm in realms:
            if realm.authenticated(number):
                taken.update(dict.fromkeys(permissions.chosen(enclave.identity, realm.accepted)))
        carried = frozenset(() if enclave.permissions is None else (enclave.permissions,))
        own = permissions.chosen(enclave.identity, carried)
        grants = tuple(each for each in (placed[grant] for grant in taken) if each is not None)
        mine = tuple(each for each in (placed[grant] for grant in own if grant in taken) if each is not None)
        found.append(Holder(enclave.label, grants, mine))
    return found


def _placed(
    system: System, files: Mapping[str, PermissionsFile], accesses: AccessViews, row: Access
) -> Iterator[Placed | None]:
    """The grants of the system in order: those of each document as it lists them."""
    following: dict[int, Iterator[ReadGrant]] = {}
    for atom in system.grants:
        place = system.documents[atom.document].location.path
        if atom.document not in following:
            file = files.get(place)
            following[atom.document] = iter(accesses.read(file, row).grants or () if file is not None else ())
        grant = next(following[atom.document], None)
        yield Placed(place, grant) if grant is not None else None


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
    if area.partitions is not None and not _any_matches(area.partitions, matcher, partition):
        return False
    return topic in area.topics or _any_matches(filter(has_wildcard, area.topics), matcher, topic)


def _any_matches(texts: Iterable[str], matcher: Matcher, name: str) -> bool:
    return any(parse(text, matcher).matches(name) for text in texts)
