"""Domains in which an enclave's own implementation starts it although peers do not let it in.

Fast DDS wants some allow rule, of any domain; Cyclone DDS lets a participant start wherever some topic has no access
control (docs/profiles.md). Two such participants refuse each other, unless one of them attacks.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.trust.revocation import ends_of_lists
from keystore_audit.model.validity import SECOND
from keystore_audit.profiles import VARIANTS, JoinCheck


def starts_alone(
    system: System,
    keystore: Keystore,
    channels: Channels,
    usabilities: Usabilities,
    enclaves: Iterable[int],
    until: datetime | None,
) -> frozenset[tuple[int, int]]:
    """Those of `enclaves` with such domain classes, at the audit instant or any later one up to `until`."""
    profiles = [VARIANTS[name] for name in system.profiles]
    profiles = [profile for profile in profiles if profile.local.joins is not JoinCheck.ALLOWED_DOMAIN]
    if not profiles:
        return frozenset()
    permissions = Permissions(system)
    views = trust_domain_views(system, permissions)
    by_path = {enclave.path: enclave for enclave in keystore.enclaves}
    now = system.instants[system.now]
    last = now if until is None else max(now, until)
    dated = [each for each in system.instants if now < each <= last]
    found = set()
    for number in enclaves:
        enclave = by_path.get(system.enclaves[number].label)
        if enclave is None:
            continue
        lists = {date for profile in profiles for date in ends_of_lists(enclave, profile.trust, now)}
        moments = [now, *_later({*dated, *lists}, now, last)]
        everywhere = permissions.all_domains
        for view in views:
            everywhere &= view.joined(number)
        for domain, atom in enumerate(channels.domains):
            if everywhere >> domain & 1 and until is None:
                continue
            there = usabilities.in_domain(atom.intervals[0][0])
            answers = {there.of(enclave, at, profile).usable for profile in profiles for at in moments}
            if any(each.may if system.may else each.must for each in answers):
                found.add((number, domain))
    return frozenset(found)


def _later(instants: Iterable[datetime], now: datetime, last: datetime) -> Iterable[datetime]:
    """Those up to the last one at which something begins or has just ended."""
    dates = {each for each in instants if now < each <= last}
    return sorted(dates | {each + SECOND for each in dates if each < last})
