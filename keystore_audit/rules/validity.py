"""KA5: the dates of grants (DDS-Security 1.1, 9.4.1.3), read as `spec` has them: without a zone they are UTC."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from keystore_audit.findings import Severity
from keystore_audit.keystore.permissions import Grant
from keystore_audit.rules.contents import dated
from keystore_audit.rules.context import Context
from keystore_audit.rules.effect import instant_of
from keystore_audit.rules.permissions import about, own_grants
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import PermissionsUse, speaks
from keystore_audit.rules.wording import quoted
from keystore_audit.text import instant

_LATER = in_permissions("Let the grant end later")
_CLAUSE = "DDS-Security 1.1, 9.4.1.3 (validity: not_before, not_after)"


def _dated(use: PermissionsUse) -> Iterator[tuple[Grant, datetime, datetime]]:
    """Grants that name an enclave which carries the document, with the instants between which they are in force."""
    for grant in own_grants(use):
        start, end = instant_of(grant.not_before), instant_of(grant.not_after)
        if start is not None and end is not None:
            yield grant, start, end


def _whose(grant: Grant) -> str:
    return f"The grant of {quoted(grant.subject_name.text)}"


@rule(
    "KA505",
    Severity.HIGH,
    clause=_CLAUSE,
    remedy=_LATER,
    applies=speaks,
    stops=True,
)
def grant_expired(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant of the enclave is past its not_after, so that it cannot start, and peers refuse it.

    Dates without a zone are read as UTC; Fast DDS reads every date in the zone of the machine (measured), which shifts
    it by up to 14 hours. Sessions that run already go on where the implementation has no timer for it.
    """
    for grant, start, end in _dated(use):
        if start <= end < context.at:
            message = f"{_whose(grant)} expired at {instant(end)} (audited for {instant(context.at)})."
            yield about(use, grant, grant.not_after.line, message, key=dated(grant))


@rule(
    "KA506",
    Severity.HIGH,
    clause=_CLAUSE,
    remedy=in_permissions("Wait until then, or let the grant begin earlier"),
    applies=speaks,
    stops=True,
)
def grant_not_yet_valid(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant of the enclave is before its not_before, so that it cannot start, and peers refuse it.

    A robot without a battery behind its clock may start before every not_before; that cannot be seen here.
    """
    for grant, start, end in _dated(use):
        if context.at < start <= end:
            message = f"{_whose(grant)} is valid from {instant(start)} on (audited for {instant(context.at)})."
            yield about(use, grant, grant.not_before.line, message, key=dated(grant))


@rule(
    "KA507",
    Severity.MEDIUM,
    clause=_CLAUSE,
    remedy=_LATER,
    applies=speaks,
)
def grant_expires_soon(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """The grant of the enclave ends within the notice period (--expires-within, 30 days): then nothing new starts."""
    for grant, start, end in _dated(use):
        if start <= end and context.at <= end and end - context.at <= context.expires_within:
            message = (
                f"{_whose(grant)} expires at {instant(end)}, in {(end - context.at).days} days (notice: "
                f"{context.expires_within.days})."
            )
            yield about(use, grant, grant.not_after.line, message, key=dated(grant))


@rule(
    "KA513",
    Severity.LOW,
    clause=_CLAUSE,
    remedy=in_permissions("Let the grant end with the identity"),
    applies=speaks,
)
def grant_outlives_certificate(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant ends later than the identity that it names.

    The next identity of that name has its rights without anybody signing them: a signed grant cannot be taken back
    before it ends.
    """
    ends: dict[str, datetime] = {}
    for enclave in use.enclaves:
        first = enclave.identity
        if first is not None:
            ends[first.subject] = max(first.not_after, ends.get(first.subject, first.not_after))
    for grant, start, end in _dated(use):
        identity_ends = ends[grant.subject_name.text]
        if start <= end and end > identity_ends:
            message = f"{_whose(grant)} is good until {instant(end)}, the identity only until {instant(identity_ends)}."
            yield about(use, grant, grant.not_after.line, message, key=dated(grant))


@rule(
    "KA516",
    Severity.HIGH,
    clause=_CLAUSE,
    remedy=in_permissions("Let not_before come before not_after"),
    applies=speaks,
    stops=True,
)
def validity_inverted(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant ends before it begins: it is never in force. Zones count: `Z` and `+02:00` name different instants."""
    for grant, start, end in _dated(use):
        if start > end:
            message = f"{_whose(grant)} begins at {instant(start)} and ends before that, at {instant(end)}."
            yield about(use, grant, grant.not_before.line, message, key=dated(grant))
