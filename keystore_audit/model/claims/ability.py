"""Where a claim of ability does not count on data: channels that no node of ROS 2 uses, or that do not exist.

What is left out makes such a claim harder to keep, never easier.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.channels import Channels, illegal_names
from keystore_audit.model.claims.globs import IN_DEFAULT_PARTITION, Globs, left_out, matching, region_of
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.domains import contains
from keystore_audit.model.formal.asked import Place
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.participants.refusals import may_refuse_peers, refusals_of_peer
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Usability
from keystore_audit.model.trust.revocation import list_dates
from keystore_audit.model.validity import LAST, SECOND
from keystore_audit.profiles import JoinCheck, Local, Profile, Trust, at_work
from keystore_audit.truth import Truth

MAX_PAIRS: Final = 10_000
"""Pairs of places of one claim: some ten seconds."""

_SILENT: Final = frozenset({"Ed25519", "Ed448"})
"""Kinds of keys with which no implementation proves who it is: the handshake's algorithms are ECDSA and RSA-PSS."""


def pairs(
    claim: Claim, system: System, channels: Channels, known: Iterable[str], unusable: frozenset[int]
) -> tuple[tuple[Place, Place], ...]:
    """From which place data must get to which: from each enclave that globs name, and each topic or glob on topics, to
    each other. `known`: the paths of all enclaves; those that the system lacks (MUST) are a place that is nowhere.

    Raises errors.UsageError for more than MAX_PAIRS.
    """
    number = {enclave.label: index for index, enclave in enumerate(system.enclaves)}
    paths = sorted(known)

    def places(globs: Globs) -> list[Place]:
        listed = [path for path in paths if any(matching(glob, (path,)) for glob in globs.enclaves)]
        found = [Place(enclaves=frozenset({number[path]})) for path in listed if path in number]
        if left_out(system, globs.enclaves, paths):
            found.append(Place())
        topics = (channels.regions[region_of((topic,))] for topic in globs.topics)
        found += [Place(channels=each - unusable) for each in topics]
        return [*found, Place(outsider=True)] if globs.outsider else found

    sources, targets = places(claim.source), places(claim.target)
    if len(sources) * len(targets) > MAX_PAIRS:
        raise UsageError(
            f"{claim.place}: {len(sources)} places from which data must get to {len(targets)} are too many pairs "
            f"(limit {MAX_PAIRS})."
        )
    return tuple((one, other) for one in sources for other in targets if one != other or not one.enclaves)


def unusable(
    system: System, channels: Channels, keystore: Keystore, usabilities: Usabilities, profiles: Sequence[Profile]
) -> frozenset[int]:
    """The channels that robots do not use: of other partitions than the default one, and of other domains if one is
    given. Also those whose name is no topic's under some implementation of the system. Also those of domains in which
    an enclave does not start although it does elsewhere.

    `usabilities`: who starts, in that domain.
    """
    found = set(range(len(channels.channels))) - channels.regions[IN_DEFAULT_PARTITION]
    domain = usabilities.domain
    if domain is not None:
        inside = {n for n, each in enumerate(channels.domains) if contains(each.intervals, domain)}
        found.update(n for n, channel in enumerate(channels.channels) if channel.domain not in inside)
    for legal in {profile.local.topic_names for profile in at_work(profiles)} - {None}:
        found.update(illegal_names(channels, legal or ""))
    if domain is None:
        at = system.instants[system.now]
        closed = set(_closed(system, channels, keystore.enclaves, usabilities, profiles, at))
        found.update(n for n, channel in enumerate(channels.channels) if closed and channel.domain in closed)
    return frozenset(found)


def stopped(
    system: System,
    keystore: Keystore,
    usability: Mapping[tuple[str, str], Usability],
    profiles: Sequence[Profile],
) -> frozenset[int]:
    """Enclaves that do not start under some profile of the system, or (MUST) may not, and those without any peer.

    `usability`: by directory and profile, at the audit instant.
    """
    paths = {e.path for e in keystore.enclaves if not all(talks(e, each.run_by(e.path).local) for each in profiles)}
    for enclave in keystore.enclaves:
        if not _starts(system, (usability[enclave.files.directory, profile] for profile in system.profiles)):
            paths.add(enclave.path)
    return _among(system, paths)


def stopping(
    system: System, keystore: Keystore, usabilities: Usabilities, until: datetime, profiles: Sequence[Profile]
) -> frozenset[int]:
    """Enclaves that do not start at some instant until then, by dates of certificates, lists and grants."""
    now = system.instants[system.now]
    if until <= now:
        return frozenset()
    paths = set()
    for enclave in keystore.enclaves:
        for profile in profiles:
            moments = _moments_until(usabilities.dates(enclave, profile, now), now, until) | {until}
            if not _starts(system, (usabilities.of(enclave, moment, profile) for moment in moments)):
                paths.add(enclave.path)
    return _among(system, paths)


def _moments_until(dates: Iterable[datetime], now: datetime, until: datetime) -> set[datetime]:
    """The dates up to then, and the instants right after them, that are still to come."""
    moments = (date + behind for date in dates for behind in (timedelta(0), datetime.resolution))
    return {moment for moment in moments if now < moment <= until}


def starts_alone(
    system: System,
    keystore: Keystore,
    channels: Channels,
    usabilities: Usabilities,
    enclaves: Iterable[int],
    until: datetime | None,
    profiles: Sequence[Profile],
) -> frozenset[tuple[int, int]]:
    """Those of `enclaves`, each with a domain class in which its own implementation starts it although peers do not let
    it in. It does so at the audit instant or any later one up to `until`.

    Fast DDS wants some allow rule, of any domain; Cyclone DDS lets a participant start wherever some topic has no
    access control (docs/profiles.md). Two such participants refuse each other, unless one of them attacks.
    """
    if all(profile.local.joins is JoinCheck.ALLOWED_DOMAIN for profile in at_work(profiles)):
        return frozenset()
    permissions = Permissions(system)
    views = trust_domain_views(system, permissions)
    by_path = {enclave.path: enclave for enclave in keystore.enclaves}
    now = system.instants[system.now]
    found = set()
    for number in enclaves:
        enclave = by_path.get(system.enclaves[number].label)
        if enclave is None:
            continue
        everywhere = permissions.all_domains
        for view in views:
            everywhere &= view.joined(number)
        own = {profile.run_by(enclave.path) for profile in profiles}
        for profile in (each for each in own if each.local.joins is not JoinCheck.ALLOWED_DOMAIN):
            dates = usabilities.dates(enclave, profile, now) if until is not None else ()
            moments = {now, *_moments_until(dates, now, until or now)}
            for domain, atom in enumerate(channels.domains):
                if not everywhere >> domain & 1 or until is not None:
                    there = usabilities.in_domain(atom.intervals[0][0])
                    answers = (there.of(enclave, at, profile).usable for at in moments)
                    if any(each.may if system.may else each.must for each in answers):
                        found.add((number, domain))
    return frozenset(found)


def with_refusals(system: System, keystore: Keystore, profiles: Sequence[Profile]) -> System:
    """The system with whom enclaves refuse under some profile, from the audit instant on.

    That splits trust domains: two may trust alike but read the same authorities in another order.
    """
    number = {atom.label: n for n, atom in enumerate(system.enclaves)}
    there = [(number[each.path], each) for each in keystore.enclaves if each.path in number]
    identities = [(system.enclaves[n].identity, each.identity) for n, each in there]
    known = {n: certificate for n, certificate in identities if n is not None and certificate is not None}
    enclaves, trust_domains = (
        list(system.enclaves),
        {trust_domain: n for n, trust_domain in enumerate(system.trust_domains)},
    )
    refused: dict[object, list[tuple[int, frozenset[int]]]] = {}
    for n, enclave in there:
        file, crl = enclave.identity_ca, enclave.files.files[Role.CRL]
        trusts = tuple(dict.fromkeys(profile.run_by(enclave.path).trust for profile in profiles))
        files = file and file.file.sha256, crl.sha256, crl.status, trusts  # of copies one is asked
        if files not in refused:
            asked = [trust for trust in trusts if may_refuse_peers(enclave, trust)]
            refused[files] = list(_refused(enclave, known, asked, _moments(system, enclave, asked)))
        (_now, refuses), *later = refused[files]
        trust_domain = replace(
            system.trust_domains[enclaves[n].trust_domain], refuses=refuses, refuses_later=tuple(later)
        )
        enclaves[n] = replace(enclaves[n], trust_domain=trust_domains.setdefault(trust_domain, len(trust_domains)))
    return replace(system, enclaves=tuple(enclaves), trust_domains=tuple(trust_domains))


def _moments(system: System, enclave: Enclave, trusts: Iterable[Trust]) -> Iterator[tuple[int, datetime]]:
    """The moments (`permission.Permissions`), from the audit's on, at which the enclave may come to refuse others."""
    now = system.instants[system.now]
    authorities = enclave.identity_ca.certificates if enclave.identity_ca is not None else ()
    dates = {now, *(date for each in authorities for date in (each.not_before, each.not_after))}
    dates.update(date for trust in trusts for date in list_dates(enclave, trust, now))
    for number, instant in enumerate(system.instants):
        if now <= instant <= LAST and instant in dates:
            yield from ((2 * number + behind, instant + behind * SECOND) for behind in (0, 1))


def _refused(
    enclave: Enclave,
    known: Mapping[int, Certificate],
    trusts: Collection[Trust],
    moments: Iterable[tuple[int, datetime]],
) -> Iterator[tuple[int, frozenset[int]]]:
    """The known certificates that the enclave refuses under some of the rows; again at each moment that changes it."""
    before: frozenset[int] | None = None
    for moment, at in moments:
        found = frozenset(
            number
            for number, certificate in (known.items() if trusts else ())
            if any(any(refusals_of_peer(enclave, certificate, trust, at)) for trust in trusts)
        )
        if found != before:
            yield moment, found
        before = found


def _starts(system: System, usable: Iterable[Usability]) -> bool:
    may = system.may
    return all(each.usable.may if may else each.usable.must for each in usable)


def _among(system: System, paths: Collection[str]) -> frozenset[int]:
    return frozenset(number for number, enclave in enumerate(system.enclaves) if enclave.label in paths)


def talks(enclave: Enclave, row: Local) -> bool:
    """Whether it can prove who it is once it has started.

    Cyclone DDS starts with a private key that is not the certificate's. Fast DDS starts with one of a kind that signs
    no digest. Neither completes a handshake (measured). Nor does whoever has more to send than fits.
    """
    first = enclave.identity
    key = enclave.key.key if enclave.key is not None else None
    if row.most_sent is not None and sent(enclave) > row.most_sent:
        return False
    return first is None or (first.key_kind not in _SILENT and (key is None or first.key == key))


def sent(enclave: Enclave) -> int:
    """Octets of what it shows its peers in the handshake: certificate and permissions."""
    signed = enclave.permissions.signed if enclave.permissions is not None else None
    return sum(len(each.file.content or b"") for each in (enclave.certificate, signed) if each is not None)


def _closed(
    system: System,
    channels: Channels,
    enclaves: Sequence[Enclave],
    usabilities: Usabilities,
    profiles: Iterable[Profile],
    at: datetime,
) -> Iterator[int]:
    """Governed domain classes in which an enclave does not start, although it does in others.

    Only OpenDDS decides that by the domain's rules; elsewhere, an enclave with rights in a domain starts there.
    """
    for profile in profiles:
        if all(each.local.joins is not JoinCheck.TABLE_63 for each in at_work((profile,))):
            continue
        starting = [each for each in enclaves if usabilities.of(each, at, profile).usable.may]
        governed = _governed(system)
        trust_domains = {enclave.label: enclave.trust_domain for enclave in system.enclaves}
        for number, domain in enumerate(channels.domains):
            there = usabilities.in_domain(domain.intervals[0][0])
            for enclave in starting:
                covered = number in governed[trust_domains[enclave.path]] if enclave.path in trust_domains else False
                if covered and there.of(enclave, at, profile).usable is Truth.NO:
                    yield number
                    break


def _governed(system: System) -> list[set[int]]:
    """By trust domain: the domain classes that its governance covers."""
    by_document: dict[int | None, set[int]] = {}
    for rule in system.domain_rules:
        by_document.setdefault(rule.document, set()).update(rule.domains)
    return [by_document.get(trust_domain.governance, set()) for trust_domain in system.trust_domains]
