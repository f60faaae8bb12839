"""Whether data or control gets from one place to another: `flow`, and the Python interface to it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import (
    Engines,
    asserted,
    combine_claims,
    combine_falls,
    run_engines,
    run_falls,
)
from keystore_audit.engine.native import NativeEngine
from keystore_audit.engine.needs import solved_again, taken_for_granted, with_needs
from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.blast_radius import BlastRadius, Ground, ground
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import ATTACKERS, Attacker, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import claimed_systems
from keystore_audit.model.participants.doubt import keystore_doubts
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.stolen_key import holding, holding_both, radius, radius_of_enclave
from keystore_audit.profiles import Release, at_work, declared
from keystore_audit.properties.result import (
    AssertedResult,
    Change,
    CompromiseAnswer,
    EngineRun,
    FallResult,
    KeyAnswer,
    ProfileRadius,
    Status,
    Stolen,
)
from keystore_audit.settings.claims import place

if TYPE_CHECKING:
    from pathlib import Path

    from keystore_audit.zenoh.stolen import StolenAnswer


class FlowQuestion(Struct, frozen=True, kw_only=True):
    """From where to where, as places are written in settings; `through`: globs on enclaves that do not count.

    `attackers`: None for each under which a flow is possible at all. `compromised`: instead of them, at most so many
    enclaves attack, whichever they are; then `able` are claims that a change of rights must keep.
    """

    source: str
    target: str
    attackers: tuple[Attacker, ...] | None = None
    through: tuple[str, ...] = ()
    include_ambient: bool = False
    compromised: int | None = None
    able: tuple[Claim, ...] = ()


class FlowAnswer(Struct, frozen=True, kw_only=True):
    """Whether there is a flow, by attacker: a result is VIOLATED where there is one for certain.

    Where it is asked who may fall, `falls` has each smallest set of compromised participants instead. Where some break
    it, `change` is the smallest one of rights. `doubts`: places of what could not be read, which an unknown answer
    depends on; none where no answer is unknown.
    """

    question: FlowQuestion
    at: datetime
    profiles: tuple[str, ...]
    results: tuple[tuple[Attacker, AssertedResult], ...]
    falls: tuple[FallResult, ...]
    engines: tuple[EngineRun, ...]
    doubts: tuple[Location, ...]
    change: Change | None = None
    declared: str = ""
    """What enclaves run that settings name."""
    folder: str = ""
    """That of sessions and routers whose files decide, where they do."""
    unclear: tuple[tuple[Location, str], ...] = ()
    """Why nothing is kept out for certain by them."""

    @property
    def status(self) -> Status:
        """The worst of all: unknown, then violated (a flow), then holds (none)."""
        statuses = {result.status for _who, result in (*self.results, *self.falls)}
        if Status.UNKNOWN in statuses or any(run.failed for run in self.engines):
            return Status.UNKNOWN
        return Status.VIOLATED if Status.VIOLATED in statuses else Status.HOLDS


def find_flow(
    path: str | os.PathLike[str],
    question: FlowQuestion,
    given: Circumstances,
    *,
    engines: Engines | None = None,
) -> FlowAnswer:
    """Whether there is a flow in the keystore at `path`.

    Raises errors.NothingToAudit, errors.UsageError for a place that names nothing there, and errors.BudgetExceeded
    where there are too many classes of names.
    """
    claims, profiles, at = questions(question), given.profiles, given.at
    keystore, accesses, native = posed(path, claims, given)
    engines = engines or Engines()
    results, falls = tuple[AssertedResult, ...](), tuple[FallResult, ...]()
    if question.compromised is None:
        runs, answers = run_engines(native, engines, None, claims=True)
        made = taken_for_granted(keystore, given.assumed)
        results, minimal = with_needs(combine_claims(claims, native.systems, answers, given.names), native, made)
        results, runs = solved_again(results, minimal, runs, engines, None)
    else:
        runs, told = run_falls(native.systems, question.compromised, engines)
        falls = combine_falls(claims[0], native.systems, told, given.names)
    every = (*results, *(result for _fallen, result in falls))
    change = None
    if question.compromised is not None and {each.status for each in every} == {Status.VIOLATED}:
        from keystore_audit.fewer_rights import smallest_change  # most flows are not asked that

        change = smallest_change(keystore, claims[0], question.compromised, question.able, given, engines)
    asked = at_work(profiles) if any(result.status is Status.UNKNOWN for result in every) else ()
    doubts = (doubt.location for profile in asked for doubt in keystore_doubts(keystore, profile, accesses))
    return FlowAnswer(
        question=question,
        at=at,
        profiles=given.names,
        results=tuple((Attacker(result.prop.attacker), result) for result in results),
        falls=falls,
        engines=runs[-1:] if engines.choice == "native" else runs,
        declared=declared(profiles),
        doubts=tuple(dict.fromkeys(doubts)),
        change=change,
    )


def find_routed_flow(
    path: str | os.PathLike[str],
    question: FlowQuestion,
    engines: Engines,
    folder: Path,
    given: Circumstances,
    releases: Sequence[Release],
) -> FlowAnswer:
    """The same by the session and router files there. Raises as `find_flow`, and where there is no such file."""
    from keystore_audit.engine.routed import decide
    from keystore_audit.zenoh.participants import flows_in

    flows = flows_in(given.keystore(path), folder, given.at)
    claims = questions(question)
    runs, found = decide(flows, [(flows.asked(each), release) for each in claims for release in releases], engines)
    told = iter(found)
    results = [(each, {release.name: next(told) for release in releases}) for each in claims]
    return FlowAnswer(
        question=question,
        at=given.at,
        profiles=tuple(each.name for each in releases),
        results=tuple((each.attacker, asserted(each, each.attacker.value, told)) for each, told in results),
        falls=(),
        engines=runs[-1:] if engines.choice == "native" else runs,
        doubts=tuple(dict(flows.rights.doubts)),
        folder=os.fspath(folder),
        unclear=flows.rights.doubts,
    )


def posed(
    path: str | os.PathLike[str], claims: tuple[Claim, ...], given: Circumstances
) -> tuple[Keystore, AccessViews, NativeEngine]:
    """The keystore, what its documents say within the budget, and the engine that is asked about the claims.

    Raises as `find_flow`.
    """
    keystore = given.keystore(path)
    accesses = given.accesses(keystore)
    usabilities = Usabilities(None, accesses)
    about = keystore, given.profiles, given.at, accesses, usabilities
    systems, _builder, accesses = claimed_systems(*about, {}, claims)
    return keystore, accesses, NativeEngine(systems)


def questions(question: FlowQuestion) -> tuple[Claim, ...]:
    """That there is no flow, under each attacker. Raises errors.UsageError for places that are none."""
    source, target = place(question.source), place(question.target)
    attackers = question.attackers if question.compromised is None else (Attacker.HONEST,)
    if attackers is None:
        attackers = tuple(each for each in ATTACKERS if not (source.outsider and each is Attacker.HONEST))
    return tuple(
        Claim(
            id=f"no-flow-{attacker.value}",
            statement=f"Nothing gets from {question.source} to {question.target}.",
            kind=ClaimKind.NO_FLOW,
            attacker=attacker,
            source=source,
            target=target,
            through=question.through,
            include_ambient=question.include_ambient,
            location=Location("", beside=True),
            place="",
        )
        for attacker in attackers
    )


# What a stolen key opens: `flow --from-compromised`.


MAX_KEYS: Final = 20
"""Authorities of one sort whose keys are tried: a CA file may hold thousands."""


def find_blast_radius(
    path: str | os.PathLike[str],
    who: str,
    given: Circumstances,
    *,
    include_ambient: bool = False,
) -> CompromiseAnswer:
    """What a key opens in the keystore at `path`.

    `who`: an enclave's path, `identity-ca` or `permissions-ca`.
    Raises errors.NothingToAudit, errors.UsageError for an enclave that is not there, and errors.BudgetExceeded where
    there are too many names, authorities or subjects.
    """
    keystore = given.keystore(path)
    profiles, at, accesses = given.profiles, given.at, given.accesses(keystore)
    stolen = Stolen(who) if who in (Stolen.IDENTITY_CA.value, Stolen.PERMISSIONS_CA.value) else Stolen.ENCLAVE
    enclave = keystore.enclave(who, "identity-ca, permissions-ca, ") if stolen is Stolen.ENCLAVE else None
    known = ground(keystore, profiles, at, accesses, include_ambient=include_ambient)
    asking = _Asking(known, given.names)
    doubts = (doubt.location for profile in at_work(profiles) for doubt in keystore_doubts(keystore, profile, accesses))
    return CompromiseAnswer(
        who=who,
        at=at,
        include_ambient=include_ambient,
        ground=known,
        enclaves=len(keystore.enclaves),
        keys=(asking.enclave(enclave),) if enclave is not None else tuple(asking.authorities(stolen)),
        doubts=tuple(dict.fromkeys(doubts)),
        declared=declared(profiles),
    )


def find_routed_radius(
    path: str | os.PathLike[str],
    who: str,
    folder: Path,
    given: Circumstances,
    releases: Sequence[Release],
    *,
    include_ambient: bool = False,
) -> StolenAnswer:
    """What the key of the enclave `who` opens by the files of sessions and routers there.

    Asked are the names that permissions and rules write, in every domain that rules name. Raises as `find_routed_flow`,
    and errors.BudgetExceeded for too many names.
    """
    from keystore_audit.zenoh.answers import channels
    from keystore_audit.zenoh.names import MAX_RIGHTS, rule_domains, written_names
    from keystore_audit.zenoh.participants import flows_in
    from keystore_audit.zenoh.stolen import StolenAnswer, opened

    if who in (Stolen.IDENTITY_CA.value, Stolen.PERMISSIONS_CA.value):
        raise UsageError(
            "By session and router files, the holder of an identity CA's key can be any enclave, and permissions do "
            "not count. Ask about an enclave."
        )
    flows = flows_in(given.keystore(path), folder, given.at)
    enclave = flows.keystore.enclave(who)
    rights = [
        right
        for domain in rule_domains(flows.network)
        for words in written_names(flows.keystore, flows.network, domain).rights
        for right in channels(*words, domain)
    ]
    if len(rights) > MAX_RIGHTS:
        raise BudgetExceeded(f"More than {MAX_RIGHTS} rights are named; `can` answers about one.")
    return StolenAnswer(
        who=who,
        at=given.at,
        folder=flows.network.path,
        include_ambient=include_ambient,
        opened={each.name: tuple(opened(flows, enclave, rights, each, ambient=include_ambient)) for each in releases},
        doubts=flows.rights.doubts,
    )


class _Asking:
    """Each system about each key."""

    def __init__(self, known: Ground, profiles: Sequence[str]) -> None:
        self._known = known
        self._profiles = profiles

    def enclave(self, found: Enclave) -> KeyAnswer:
        """About the key of an enclave."""
        place = found.certificate.file.place if found.certificate is not None else found.files.directory
        left_out = self._known.left_out
        return KeyAnswer(
            stolen=Stolen.ENCLAVE,
            name=found.path,
            location=Location(place),
            alone=self._by_profile(lambda system: radius_of_enclave(system, left_out, found.path)),
            with_an_enclave=None,
        )

    def authorities(self, stolen: Stolen) -> Iterator[KeyAnswer]:
        """About each key of an authority of this sort, as the profiles read the CA files."""
        keys: dict[int, tuple[str, Location]] = {}
        for system in self._known.systems:
            for trust_domain in system.trust_domains:
                for number in sorted(
                    trust_domain.identity_ca if stolen is Stolen.IDENTITY_CA else trust_domain.permissions_ca
                ):
                    certificate = system.certificates[number]
                    keys.setdefault(certificate.key, (certificate.label, certificate.location))
        if len(keys) > MAX_KEYS:
            raise BudgetExceeded(f"{len(keys)} authorities' keys are too many to try (limit {MAX_KEYS}).")
        for key, (name, location) in keys.items():
            yield self._authority(stolen, key, name, location)

    def _authority(self, stolen: Stolen, key: int, name: str, location: Location) -> KeyAnswer:
        left_out = self._known.left_out

        def alone(system: System) -> BlastRadius:
            return radius(system, left_out, holding(system, key), key)

        def both(system: System) -> BlastRadius:
            return radius(system, left_out, holding_both(system, key), key)

        return KeyAnswer(
            stolen=stolen,
            name=name,
            location=location,
            alone=self._by_profile(alone),
            with_an_enclave=self._by_profile(both) if stolen is Stolen.PERMISSIONS_CA else None,
        )

    def _by_profile(self, radius_in: Callable[[System], BlastRadius]) -> dict[str, ProfileRadius]:
        """By profile, the larger blast radius, in which unread parts may do anything."""
        found: dict[str, list[BlastRadius]] = {name: [] for name in self._profiles}
        for system in self._known.systems:  # of each kind the larger reading comes first
            answer = radius_in(system)
            for name in system.profiles:
                found[name].append(answer)
        return {
            name: ProfileRadius(radius=answers[0], certain=all(each == answers[0] for each in answers))
            for name, answers in found.items()
        }
