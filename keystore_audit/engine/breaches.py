"""What violates claims and properties: all of it, in names.

A report tells one example. To accept that a telematics unit may publish a command does not accept the same of the
infotainment system. So a finding is about all that violates it, as far as that is known.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice, product
from typing import Final

from msgspec.structs import replace

from keystore_audit.engine.counterexample_claims import left_out
from keystore_audit.engine.native_claims import KeptFlows, claims_at
from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.claims.named import UNREAD_IDENTITY
from keystore_audit.model.formal.asked import ATTACKERS, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.participants.unmanaged import MAX_SUBJECT
from keystore_audit.model.subjects.comparison import MAX_PIECES, TOKENWISE, matching
from keystore_audit.model.subjects.told import ToldSubject, meaning, told
from keystore_audit.profiles import VARIANTS, SubjectComparison
from keystore_audit.properties.result import ANYBODY, Answer, AssertedResult, PropertyResult, Role, Status, Witness
from keystore_audit.text import shorten

MAX_STEPS: Final = 500_000
"""Most steps over all claims: pairs of places, times moments and, for flows, times enclaves (some seconds at worst).
Beyond, the keystore as a whole stands for what violates a claim."""

MAX_BREACHES: Final = 10_000
"""Breaches told apart; beyond, the keystore as a whole stands for them."""


def with_breaches(results: Sequence[AssertedResult], systems: Sequence[System]) -> tuple[AssertedResult, ...]:
    """The results, parallel to the claims of each system, each with all that violates it, unless that is too much.

    For claims of ability, with what is certainly impossible.
    """
    left, told = MAX_STEPS, []
    for number, result in enumerate(results):
        asked = [(_Breaches(s, s.claims[number]), _violated(result, s)) for s in systems if _violated(result, s)]
        steps = sum(breaches.steps for breaches, _profiles in asked)
        every = (f"{name}: {each}" for breaches, profiles in asked for each in breaches.found() for name in profiles)
        found = set(islice(every, MAX_BREACHES + 1)) if steps <= left else None
        known = found is not None and len(found) <= MAX_BREACHES
        left -= 0 if found is None else steps
        told.append(replace(result, breaches=tuple(sorted(found or ()))) if known else result)
    return tuple(_with_others(number, result, systems) for number, result in enumerate(told))


def _with_others(number: int, result: AssertedResult, systems: Sequence[System]) -> AssertedResult:
    """The result; for a claim of who may publish, with who else could."""
    claims = [system.claims[number] for system in systems]
    if not any(claim.kind is ClaimKind.ONLY_PUBLISH for claim in claims):
        return result
    both = [*zip(systems, claims, strict=True)]
    forging = dict.fromkeys(name for each in both for name in _forgers(*each))
    also_named: dict[str, str] = {}
    for text, subject in (item for each in both for item in _shorter_subjects(*each).items()):
        also_named.setdefault(text, subject)
    return replace(result, forgers=tuple(sorted(forging, key=ANYBODY.__eq__)), also_named=also_named)


class _Names:
    """Names of a system's atoms that do not depend on their order; a trust domain has none.

    `topics`: what each channel stands for: rules that tell no names apart make one channel of them.
    """

    def __init__(self, system: System, topics: Iterable[tuple[int, str]] = ()) -> None:
        self._system = system
        self._topics = {number: channel.topic for number, channel in enumerate(system.channels)} | dict(topics)

    def enclave(self, number: int) -> str:
        """An enclave by its path; an unmanaged identity also by all of its subject, of which its label holds a part."""
        enclave = self._system.enclaves[number]
        if not enclave.unmanaged or enclave.identity is None:
            return enclave.label
        return f"{enclave.label} {self._system.certificates[enclave.identity].label}"

    def domain(self, number: int) -> str:
        """A domain class."""
        return self._system.domains[number].label

    def topic(self, channel: int) -> str:
        """The topic of a channel, and its domain."""
        return f"topic {self._topics[channel]} in {self.domain(self._system.channels[channel].domain)}"

    def place(self, place: Place) -> str:
        """All that a place has."""
        topics = sorted(set(map(self.topic, place.channels)))
        return ", ".join([*map(self.enclave, sorted(place.enclaves)), *topics, *["outsider"] * place.outsider])

    def witness(self, witness: Witness) -> str:
        """Who, on what and where."""
        told = []
        for role, atom in sorted(witness.items()):
            if role in (Role.ENCLAVE, Role.OTHER):
                told.append(self.enclave(atom))
            elif role is Role.CERTIFICATE:
                told.append(self._system.certificates[atom].label)
            elif role is Role.CHANNEL:
                channel = self._system.channels[atom]
                told += [self._topics[atom], channel.partition, self.domain(channel.domain)]
            elif role is Role.DOMAIN:
                told.append(self.domain(atom))
            elif role is Role.WITH_IDENTITY and not atom:
                told.append("anybody")
        return "\0".join(told)


class _Breaches:
    """What violates a claim. `steps`: how much there is to look at."""

    def __init__(self, system: System, claim: ClaimAtom) -> None:
        self._system = system
        self._claim = claim
        self._names = _Names(system, claim.names)
        self._decisions = Decisions(system)
        self._pairs = [*product(self._each(claim.source), self._each(claim.target))]
        self._first = 2 * system.now
        self._last = self._first if claim.until is None else max(self._first, 2 * claim.until)
        each = len(system.enclaves) if claim.kind is ClaimKind.NO_FLOW else 1
        self.steps = len(self._pairs) * each * (self._last - self._first + 1)

    def found(self) -> Iterator[str]:
        """What violates it now, and what else violates it at some moment until its end.

        To accept what comes later is not to accept that it comes now.
        """
        claim = self._claim
        starting = replace(claim, through=claim.through - claim.stopping)
        now = set(islice(self._at(self._first, starting), MAX_BREACHES + 1))
        yield from now
        for moment in range(self._first + 1, self._last + 1):
            yield from (f"later: {each}" for each in self._at(moment, claim) if each not in now)
        if claim.kind is ClaimKind.NO_FLOW and claim.until is not None:
            yield from (f"kept: {each}" for each in self._flows(KeptFlows(self._system).takes_time))

    def _at(self, moment: int, claim: ClaimAtom) -> Iterator[str]:
        asked = claims_at(self._system, moment, self._decisions)
        if claim.kind is ClaimKind.NO_FLOW:
            yield from self._flows(lambda each: asked.violation(each) is not None)
        elif claim.kind is ClaimKind.ABLE and claim.pairs:
            yield from (" -> ".join(map(self._names.place, claim.pairs[number])) for number in asked.cut_off(claim))
        else:
            for witness, _path in asked.violations(claim):
                yield self._names.witness(witness)

    def _flows(self, flows: Callable[[ClaimAtom], bool]) -> Iterator[str]:
        """Between which places there is a flow, and the least attacker who makes one."""
        attackers = ATTACKERS[: ATTACKERS.index(self._claim.attacker) + 1]
        for source, target in self._pairs:
            for attacker in attackers:
                if flows(replace(self._claim, source=source, target=target, attacker=attacker)):
                    yield f"{attacker.value}: {self._names.place(source)} -> {self._names.place(target)}"
                    break

    def _each(self, place: Place) -> list[Place]:
        """Its enclaves one by one, its topics by their names and domains, and the outsider."""
        topics = gathered((self._names.topic(channel), channel) for channel in sorted(place.channels))
        found = [Place(enclaves=frozenset({enclave})) for enclave in sorted(place.enclaves)]
        found += [Place(channels=frozenset(channels)) for channels in topics.values()]
        return [*found, *[Place(outsider=True)] * place.outsider]


# Who else could publish, beside a claim of who may.


def _forgers(system: System, claim: ClaimAtom) -> tuple[str, ...]:
    """Who is not a permitted publisher and could impersonate one with its keys; ANYBODY last."""
    asked = bits(claim.target.channels)
    names: dict[str, None] = {}
    permissions = Permissions(system)
    views = trust_domain_views(system, permissions)
    flows = Flows(system, views)
    foreign = [number for number in range(len(system.enclaves)) if number not in claim.source.enclaves]
    for view in views:
        for number in foreign:
            others = (view.abilities(other) for other in flows.acting(number) if other != number)
            forged = view.abilities(number).forges | union(able.forges | able.may_write for able in others)
            if forged & asked:
                names[system.enclaves[number].label] = None
        for certificate, able in view.elsewhere.items():
            if able.forges & asked and certificate not in claim.source.certificates:
                named = permissions.admitting(certificate, view.accepted)  # else by what could not be read alone
                who = shorten(system.certificates[certificate].label, MAX_SUBJECT) if named else UNREAD_IDENTITY
                names[left_out(system, certificate) or f"whoever is {who}"] = None
    if any(view.injectable & asked for view in views):
        names[ANYBODY] = None
    return tuple(names)


# Whom else Cyclone DDS takes a grant for: whoever has a subject of some of its parts.
#
# A grant of `CN=/robot/arm` names `CN=/robot` too. No keystore says whether its CA vouches for somebody of such a name
# elsewhere. For each grant there is such a name: `CN=/`, the enclave `/` of sros2, for nodes that are given none. So
# that is said beside a claim of who alone may publish, and violates it only where the keystore tells of one.

_BETWEEN_PARTS: Final = re.compile("[,/|]")


def _shorter_subjects(system: System, claim: ClaimAtom) -> Mapping[str, str]:
    """A subject that nobody here has, by the subject_name of a grant that lets it publish what the claim is about."""
    names = (*system.profiles, *system.others)
    comparisons = {VARIANTS[name].trust.subjects for name in names if name in VARIANTS}
    granting = sorted(_granting(system, bits(claim.target.channels))) if comparisons & TOKENWISE else []
    known = {meaning(certificate.label) for certificate in system.certificates}
    wanted: dict[int, list[ToldSubject]] = {
        grant: [each for each in _shorter(system.grants[grant].subject) if meaning(each.subject) not in known]
        for grant in granting
    }
    found: dict[str, str] = {}
    for comparison in sorted(comparisons & TOKENWISE, key=lambda each: each.value):
        deciding = _deciding(system, wanted, comparison)
        for grant, subjects in wanted.items():
            taken = [each.subject for each in subjects if grant in deciding[each.subject]]
            for subject in taken[:1]:
                found.setdefault(system.grants[grant].subject, subject)
    return found


def _granting(system: System, asked: int) -> Iterator[int]:
    """The grants in force that let publish some of these channels, in documents that peers take."""
    permissions = Permissions(system)
    governed = [(view.accepted, view.protection.governed & asked) for view in trust_domain_views(system, permissions)]
    for number, grant in enumerate(system.grants):
        here = [channels for accepted, channels in governed if channels and grant.document in accepted]
        if here and permissions.in_force(grant.not_before, grant.not_after):
            allowed = permissions.met(permissions.allowed(number, Operation.PUBLISH))
            if any(allowed & channels for channels in here):
                yield number


def _shorter(text: str) -> Iterator[ToldSubject]:
    """The subjects of all leading parts of the text, the longest first; with too many parts it names nobody."""
    places = [found.start() for found in _BETWEEN_PARTS.finditer(text)]
    for place in reversed(places) if len(places) <= MAX_PIECES else ():
        kept = text[: place + 1] if text[:place].endswith("=") else text[:place]  # no subject ends so: `CN=/` is one
        subject = told(kept)
        if subject is not None:
            yield subject


def _deciding(
    system: System, wanted: Mapping[int, Iterable[ToldSubject]], comparison: SubjectComparison
) -> Mapping[str, frozenset[int]]:
    """By subject, the grants that decide about it: of each document the first that is taken to name it."""
    subjects = list({each.subject: each for several in wanted.values() for each in several}.values())
    documents = {system.grants[number].document for number in wanted}
    grants = [number for number, grant in enumerate(system.grants) if grant.document in documents]
    named = matching([system.grants[number].subject for number in grants], subjects, comparison)
    first: list[dict[int, int]] = [{} for _ in subjects]
    for number in grants:
        for place in named[system.grants[number].subject]:
            first[place].setdefault(system.grants[number].document, number)
    return {each.subject: frozenset(by.values()) for each, by in zip(subjects, first, strict=True)}


def with_violations(
    results: Iterable[PropertyResult], systems: Sequence[System], answers: Sequence[Mapping[str, Answer]]
) -> tuple[PropertyResult, ...]:
    """The results, each with what violates it under each profile, as far as the native engine keeps it."""
    names = [_Names(system) for system in systems]

    def violations(result: PropertyResult) -> Iterator[str]:
        for system, called, answered in zip(systems, names, answers, strict=True):
            profiles = _violated(result, system)
            for witness in answered[result.prop.id].witnesses if profiles else ():
                yield from (f"{profile}: {called.witness(witness)}" for profile in profiles)

    return tuple(replace(each, violations=tuple(sorted(set(violations(each))))) for each in results)


def _violated(result: PropertyResult, system: System) -> list[str]:
    """The profiles of a system under which it is violated; of what must not be, all under which it may be."""
    found = {name for name, each in result.profiles.items() if each.status is Status.VIOLATED}
    return sorted(found.intersection(system.profiles)) if system.may else []
