"""What is to be granted: the least policy for what was observed, launched or written, and the permissions of it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from operator import itemgetter
from typing import Final

from msgspec import Struct

from keystore_audit.circumstances import Circumstances
from keystore_audit.errors import UsageError
from keystore_audit.grouped import gathered
from keystore_audit.intent.intent import Action, Intent
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Grant
from keystore_audit.model.domains import covered
from keystore_audit.model.intended.drift_rights import written_grant
from keystore_audit.model.intended.observed_needs import EnclavePolicy, LeastPolicy, least_policy
from keystore_audit.model.intended.observed_rights import Deciders, listed_usages
from keystore_audit.model.names import dds_expressions
from keystore_audit.text import terminal

LAST_OF_OPEN_RANGE: Final = 230
"""The domain that ends a range without an end: the last that an id may be (DDS-Security 1.1, Annex A)."""

DAY: Final = timedelta(days=1)
FIRST: Final = datetime.min.replace(tzinfo=timezone.utc)


class Suggestion(Struct, frozen=True, kw_only=True):
    """The least policy for the enclaves of a keystore.

    `unknown`: paths of enclaves that the keystore does not have. `doubts`: sentences about what may be missing.
    """

    policy: LeastPolicy
    unknown: tuple[str, ...]
    doubts: tuple[str, ...]


class Suggester:
    """What `intents` come to for the keystore at `path`, at `at` (aware UTC).

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
            raise UsageError(f"The subject {certificate.subject!r} holds what no plain document can.")
        domains = self._domains(enclave)
        if not domains:
            raise UsageError(f"The governance of {policy.path!r} names no domain: say which with --domain.")
        return _grant(policy, certificate, domains)

    def _usages(self, path: str, name: str) -> tuple[Action, ...]:
        enclave = self._enclaves.get(path)
        return () if enclave is None else listed_usages(enclave, name, self._deciders)

    def _domains(self, enclave: Enclave) -> tuple[DomainRange, ...]:
        if self._domain is not None:
            return (DomainRange(low=self._domain, high=self._domain, line=None),)
        ranges = enclave.governance.domains if enclave.governance else []
        highest = max((each.high for each in ranges if each.high is not None), default=0)
        last = max(LAST_OF_OPEN_RANGE, highest)
        return tuple(DomainRange(low=low, high=min(high, last), line=None) for low, high in covered(ranges))


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
    """As sros2 writes it: UTC, though it does not say so."""
    return _text(instant.replace(tzinfo=None).isoformat(timespec="seconds"))
