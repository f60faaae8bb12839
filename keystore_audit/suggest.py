"""What is to be granted: the least policy for what was observed, launched or written, and the permissions of it."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta, timezone
from operator import itemgetter
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.errors import UsageError
from keystore_audit.grouped import gathered
from keystore_audit.intent.intent import Action, Intent, is_path, is_ros_name
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Grant
from keystore_audit.model.domains import covered
from keystore_audit.model.intended.drift_rights import written_grant
from keystore_audit.model.intended.observed_needs import DISCOVERY, Denials, EnclavePolicy, LeastPolicy, least_policy
from keystore_audit.model.intended.observed_rights import Deciders, listed_usages, listed_uses
from keystore_audit.model.names import dds_channels, dds_expressions, plain_name
from keystore_audit.text import terminal
from keystore_audit.zenoh.answers import channels, plain
from keystore_audit.zenoh.links import alternative_names
from keystore_audit.zenoh.network import common_name
from keystore_audit.zenoh.suggested import Party, peers, router_and_clients, written

LAST_OF_OPEN_RANGE: Final = 230
"""The domain that ends a range without an end: the last that an id may be (DDS-Security 1.1, Annex A)."""

_HOST: Final = re.compile(r"[A-Za-z0-9.-]+")
"""Names and addresses that an endpoint takes as they are: no pattern, and none of version 6."""

Rights = Sequence[tuple[Action, str]]
"""Actions on fully qualified names."""

DAY: Final = timedelta(days=1)
FIRST: Final = datetime.min.replace(tzinfo=timezone.utc)


class Suggestion(Struct, frozen=True, kw_only=True):
    """The least policy for the enclaves of a keystore.

    `unknown`: paths of enclaves that the keystore does not have. `doubts`: sentences about what may be missing.
    """

    policy: LeastPolicy
    unknown: tuple[str, ...]
    doubts: tuple[str, ...]


class SuggestedNetwork(Struct, frozen=True, kw_only=True):
    """What sessions and their router start with, by enclave. `left_out`: sentences about what no file grants."""

    files: Mapping[str, str]
    left_out: tuple[str, ...]


class Suggester:
    """What `intents` amount to for the keystore at `path`, at `at` (aware UTC).

    `zone`, `domain`: where the robots are and which domain they use, None if that is not known. Raises
    errors.NothingToAudit where there is no keystore.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        intents: Sequence[Intent],
        given: Circumstances,
    ) -> None:
        self._intents = intents
        self._keystore = given.keystore(path)
        self._enclaves = {enclave.path: enclave for enclave in reversed(self._keystore.enclaves)}
        accesses = given.accesses(self._keystore)
        self._deciders = Deciders(given.profiles, given.at, accesses, given.domain)
        self._domain = given.domain

    def suggestion(self, *, usual: bool) -> Suggestion:
        """The least policy. `usual` False: without what every node does beside its work."""
        policy = least_policy(self._intents, self._keystore.layout.kind, self._usages, usual=usual)
        unknown = tuple(enclave.path for enclave in policy.enclaves if enclave.path not in self._enclaves)
        return Suggestion(policy=policy, unknown=unknown, doubts=policy.doubts)

    def grant(self, policy: EnclavePolicy) -> Grant:
        """The grant of an enclave's permissions: its certificate's subject and dates, its governance's domains.

        Raises UsageError where the keystore has no such enclave, or one without either of the two.
        """
        enclave = self._enclaves.get(policy.path)
        if enclave is None:
            raise UsageError(f"There is no enclave {policy.path!r}, and so no certificate that a grant could name.")
        certificate = enclave.identity
        if certificate is None:
            raise UsageError(f"The certificate of {policy.path!r} cannot be read: a grant has to name its subject.")
        if any(terminal(sign) != sign for sign in certificate.subject):
            raise UsageError(f"The subject {certificate.subject!r} has characters that no plain document can hold.")
        domains = self._domains(enclave)
        if not domains:
            raise UsageError(f"The governance of {policy.path!r} names no domain: say which with --domain.")
        return _grant(policy, certificate, domains)

    def network(self, policy: LeastPolicy | None, router: str | None, addresses: Mapping[str, str]) -> SuggestedNetwork:
        """Files that grant what a policy says, or (None) what permissions grant by name, in the given domain.

        `router`: the enclave whose certificate the router has, None: sessions are peers. `addresses`: by enclave host
        and port where it listens; a router else at the first host that its certificate is for. Nothing is granted that
        cannot be said exactly. Raises UsageError where there is no such enclave or address, or others have its common
        name.
        """
        for path in sorted(({*addresses} if router is None else {router}) - {*self._enclaves}):
            raise UsageError(f"There is no enclave {path!r} that could listen.")
        if router is not None:
            addresses = {router: addresses.get(router) or self._own_address(router)}
        names = Counter(self._party(each).name for each in self._keystore.enclaves)
        shared = {name for name, number in names.items() if number > 1 or not name.strip()}
        domain = self._domain or 0
        left_out: list[str] = []
        parties: dict[str, Party] = {}
        for path, enclave in sorted(self._enclaves.items()):
            party = self._party(enclave, addresses.get(path, ""))
            if path == router and party.name in shared:
                raise UsageError(f"The certificate of {router!r} has no common name, or one that others have.")
            if party.name in shared or not is_path(path):
                left_out.append(f"{path} gets no file: its certificate has no common name, or one that others have.")
                continue
            if path != router:
                rights, doubts = self._by_permissions(enclave) if policy is None else _by_policy(policy, path)
                left_out += (f"{path} is not granted {doubt}." for doubt in doubts)
                keys = (each for action, name in rights for each in channels(action.value, name, domain))
                party = replace(party, rights=frozenset((operation, plain(key)) for operation, key in keys))
            parties[path] = party
        if router is None:
            own, apart = peers([*parties.values()], domain)
            left_out += (f"{one} and {other} have no link: neither listens (--listen)." for one, other in apart)
            made = dict(zip(parties, own, strict=True))
        else:
            center = parties.pop(router)
            first, own = router_and_clients(center, [*parties.values()], domain)
            made = {router: first, **dict(zip(parties, own, strict=True))}
        return SuggestedNetwork(files={path: written(each) for path, each in made.items()}, left_out=tuple(left_out))

    def _own_address(self, path: str) -> str:
        """The address of the first host that the certificate of the enclave is for."""
        host = next((each for each in _hosts(self._enclaves[path]) if _HOST.fullmatch(each)), None)
        if host is None:
            raise UsageError(f"The certificate of {path!r} names no host: say where it listens with --listen.")
        return f"{host}:7447"

    def _party(self, enclave: Enclave, address: str = "") -> Party:
        """The enclave as a party, without rights."""
        root = os.path.realpath(self._keystore.root)
        places = {role: os.path.join(root, file.path) for role, file in enclave.files.files.items()}
        name = common_name(enclave.identity) if enclave.identity is not None else None
        verified = address.rpartition(":")[0] in _hosts(enclave)
        return Party(name=name or "", files=places, address=address, verified=verified)

    def _by_permissions(self, enclave: Enclave) -> tuple[Rights, list[str]]:
        """What its permissions grant by name to all readers, and what else they list."""
        listed = listed_uses(enclave).difference(DISCOVERY)
        names = dict.fromkeys(name for _operation, topic in sorted(listed) if (name := plain_name(topic)) is not None)
        usages = listed_usages(enclave, names, self._deciders)
        rights = [(action, name) for name, actions in usages.items() for action in actions]
        granted = {use for action, name in rights for use in dds_channels(action.value, name)}
        doubts = [
            f"{operation.value} {topic}: it is an expression, half of a service, or not certainly granted"
            for operation, topic in sorted(listed - granted)
        ]
        if not enclave.grants or any(grant.default_allow for grant in enclave.grants):
            doubts.append("anything by default: its permissions allow that, or cannot be read")
        return rights, doubts

    def _usages(self, path: str, name: str) -> tuple[Action, ...]:
        enclave = self._enclaves.get(path)
        return () if enclave is None else listed_usages(enclave, (name,), self._deciders)[name]

    def _domains(self, enclave: Enclave) -> tuple[DomainRange, ...]:
        if self._domain is not None:
            return (DomainRange(low=self._domain, high=self._domain, line=None),)
        ranges = enclave.governance.domains if enclave.governance else []
        highest = max((each.high for each in ranges if each.high is not None), default=0)
        last = max(LAST_OF_OPEN_RANGE, highest)
        return tuple(DomainRange(low=low, high=min(high, last), line=None) for low, high in covered(ranges))


def _hosts(enclave: Enclave) -> tuple[str, ...]:
    """Names and addresses that its certificate is for."""
    return alternative_names(enclave.identity) if enclave.identity is not None else ()


def _by_policy(policy: LeastPolicy, path: str) -> tuple[Rights, list[str]]:
    """What a policy allows the enclave by name and denies in no part, and what else it allows."""
    rights = [each for enclave in policy.enclaves if enclave.path == path for each in enclave.rights]
    denied = Denials((each.action, each.name) for each in rights if not each.allow)
    allowed = [(each.action, each.name) for each in rights if each.allow]
    exact = [right for right in allowed if is_ros_name(right[1]) and not denied.touches(*right)]
    others = (right for right in allowed if right not in exact)
    return exact, [f"{action.value} {name}: it is an expression, or denied in part" for action, name in others]


def _grant(policy: EnclavePolicy, certificate: Certificate, domains: tuple[DomainRange, ...]) -> Grant:
    """The grant as sros2 would write it: what is denied, what is allowed, and discovery.

    It begins a day before the certificate, so that it is in force in whatever zone a robot reads its dates.
    """
    listed = gathered(
        ((right.usual, right.allow, operation), expression)
        for right in policy.rights
        for operation, expression in dds_expressions(right.action.value, right.name)
    )
    criteria = (
        (allow, operation, map(_text, sorted({*listed[usual, allow, operation]})))
        for usual, allow, operation in sorted(listed, key=itemgetter(0))
    )
    dates = _date(max(certificate.not_before, FIRST + DAY) - DAY), _date(certificate.not_after)
    return written_grant(policy.path, _text(certificate.subject), dates, domains, criteria)


def _text(text: str) -> Text:
    return Text(text=text, line=None)


def _date(instant: datetime) -> Text:
    """The date as sros2 writes it: UTC, without saying so."""
    return _text(instant.replace(tzinfo=None).isoformat(timespec="seconds"))
