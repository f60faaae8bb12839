"""The native engine: the properties over the model in `keystore_audit.model`, in Python.

Independent of Alloy, which decides the same questions from the same `System` with rules of its own
(docs/model.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice

from keystore_audit.engine.native_identities import shared_identities, shared_subjects
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal import outsiders
from keystore_audit.model.formal.abilities import Abilities
from keystore_audit.model.formal.attacker import RealmView, realm_views
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import CertificateAtom, GrantAtom, System
from keystore_audit.properties import (
    PROPERTIES,
    Answer,
    Role,
    Status,
    Witness,
    stated,
)
from keystore_audit.properties.property import Property

MAX_WITNESSES = 1000
"""Witnesses kept for each property.

A report shows one and says how many more; a thousand are more than anybody reads.
"""


class NativeEngine:
    """Answers every property and claim about each of the systems of one keystore.

    A moment is what `permission.Permissions` takes for one. What the systems have in common is worked out once.
    """

    def __init__(self, systems: Sequence[System]) -> None:
        self.systems = tuple(systems)
        self._decisions: dict[tuple[int, int, int, int], Decisions] = {}

    @cached_property
    def answers(self) -> tuple[dict[str, Answer], ...]:
        """For each system the answer to each property at the audit instant, by id.

        A witness is given for each violating assignment, up to MAX_WITNESSES.
        """
        return tuple(_Questions(s, None, self._shared(s)).answers() for s in self.systems)

    def first_statuses(self) -> tuple[dict[str, Status], ...]:
        """For each system the status of each property and claim at the audit instant: one witness is enough."""
        return tuple(_Questions(s, None, self._shared(s)).statuses() for s in self.systems)

    def checked(self, told: Sequence[Mapping[str, Answer]]) -> tuple[dict[str, Answer], ...]:
        """What another engine said of each system; UNKNOWN where it shows a violation that is none here.

        A keystore that violates something by one engine's word and not by its example is not decided.
        """
        return tuple(
            _Questions(system, None, self._shared(system)).checked(answers)
            for system, answers in zip(self.systems, told, strict=True)
        )

    def claim_answers(self) -> tuple[dict[str, Answer], ...]:
        """The same about claims alone."""
        return tuple(_Questions(s, None, self._shared(s)).claims() for s in self.systems)

    def statuses(self, moment: int) -> tuple[dict[str, Status], ...]:
        """For each system the status of each property at `moment`, by id."""
        return tuple(
            {name: answer.status for name, answer in answers.items()}
            if _as_now(system, moment)
            else _Questions(system, moment, self._shared(system)).statuses()
            for system, answers in zip(self.systems, self.answers, strict=True)
        )

    def changed_rights(self, moment: int) -> tuple[str | None, ...]:
        """For each system an enclave for which documents grant something else at `moment` than now, by its label."""
        return tuple(self._changed_rights(system, moment) for system in self.systems)

    def _changed_rights(self, system: System, moment: int) -> str | None:
        if _as_now(system, moment):
            return None
        decisions = self._shared(system)
        now, then = Permissions(system, None, decisions), Permissions(system, moment, decisions)
        documents = frozenset(range(len(system.documents)))
        for enclave in system.enclaves:
            before, after = now.chosen(enclave.identity, documents), then.chosen(enclave.identity, documents)
            if before != after and _granted(now, before) != _granted(then, after):
                return enclave.label
        return None

    def _shared(self, system: System) -> Decisions:
        """Decisions for all systems that hold the same grants, rules and channels, as one keystore's mostly do."""
        key = (id(system.grants), id(system.rules), id(system.channels), id(system.meets))  # alive as long as `systems`
        if key not in self._decisions:
            self._decisions[key] = Decisions(system)
        return self._decisions[key]


class _Questions:
    """The properties as questions about one system at one moment."""

    def __init__(self, system: System, moment: int | None, decisions: Decisions) -> None:
        self._system = system
        self._moment = 2 * system.now if moment is None else moment
        self._decisions = decisions
        self._permissions = Permissions(system, moment, decisions)
        self._realms = realm_views(system, self._permissions)
        self.used = [(realm, self._realms[realm]) for realm in system.realms_of_enclaves()]

    def answers(self) -> dict[str, Answer]:
        return {prop.id: self._answer(prop) for prop in PROPERTIES} | self.claims() | self.determinism()

    def checked(self, told: Mapping[str, Answer]) -> dict[str, Answer]:
        """The answers of another engine, where what they show is so."""
        shown = {name: answer for name, answer in told.items() if answer.witnesses or answer.path}
        wrong = {name for name in shown.keys() & _QUESTIONS.keys() if not self._confirms(name, shown[name])}
        if any(claim.id in shown for claim in self._system.claims):
            from keystore_audit.engine.native_claims import claims_at

            for claim in self._system.claims:
                answer = shown.get(claim.id)
                moment = self._moment if answer is None or answer.moment is None else answer.moment
                if answer is not None and not claims_at(self._system, moment, self._decisions).confirms(claim, answer):
                    wrong.add(claim.id)
        return {name: Answer(status=Status.UNKNOWN) if name in wrong else answer for name, answer in told.items()}

    def _confirms(self, name: str, told: Answer) -> bool:
        return all(any(each == found for found in _QUESTIONS[name](self)) for each in told.witnesses)

    def statuses(self) -> dict[str, Status]:
        found = {prop.id: _status(next(_QUESTIONS[prop.id](self), None)) for prop in PROPERTIES}
        return found | {claim: answer.status for claim, answer in self.claims().items()}

    def claims(self) -> dict[str, Answer]:
        """The answers about users' claims from the moment on."""
        if not self._system.claims:
            return {}
        from keystore_audit.engine.native_claims import Claims, answer  # most audits have none

        now = Claims(self._system, self._realms)
        return {
            claim.id: answer(self._system, claim, now, self._moment, self._decisions) for claim in self._system.claims
        }

    def determinism(self) -> dict[str, Answer]:
        """The answers about declared behaviour."""
        if not self._system.determinism:
            return {}
        from keystore_audit.engine.native_determinism import answer  # most audits have none

        return {asked.id: answer(asked) for asked in self._system.determinism}

    def _answer(self, prop: Property) -> Answer:
        witnesses = tuple(islice(_QUESTIONS[prop.id](self), MAX_WITNESSES))
        return Answer(status=_status(next(iter(witnesses), None)), witnesses=witnesses)

    def unauthenticated_joins(self) -> Iterator[Witness]:
        """Domains that an unauthenticated participant can join."""
        for realm, view in self.used:
            for domain in members(view.protection.unauthenticated):
                yield {Role.REALM: realm, Role.DOMAIN: domain}

    def unvouched_identities(self) -> Iterator[Witness]:
        """Enclaves whose identity nobody vouches for now."""
        for enclave, atom in enumerate(self._system.enclaves):
            known = atom.identity is None or self._realms[atom.realm].introduced(enclave, in_force=True)
            if self._system.anybody(enclave) or not (known or atom.at_large):
                yield {Role.ENCLAVE: enclave}

    def unsigned_documents(self) -> Iterator[Witness]:
        """Documents in use that the permissions CA did not sign, or is not in force to."""
        for enclave, atom in enumerate(self._system.enclaves):
            view = self._realms[atom.realm]
            governance = self._system.realms[atom.realm].governance
            used = {atom.permissions, governance} - {None} if not atom.at_large else ()
            for document in sorted(number for number in used if number is not None):
                signers = [self._system.certificates[s] for s in self._system.documents[document].signers]
                if document not in view.genuine or not all(
                    self._permissions.in_force(s.not_before, s.not_after) for s in signers
                ):
                    yield {Role.ENCLAVE: enclave, Role.DOCUMENT: document}

    def shared_identities(self) -> Iterator[Witness]:
        """Pairs of enclaves with one identity key."""
        return shared_identities(self._system)

    def self_granted_rights(self) -> Iterator[Witness]:
        """Enclaves that peers take permissions from which the permissions CA did not sign."""
        for realm, view in self.used:
            foreign = view.accepted - view.genuine
            for enclave, atom in enumerate(self._system.enclaves):
                if atom.permissions in foreign or view.self_granting(enclave):
                    yield {Role.REALM: realm, Role.ENCLAVE: enclave}

    def double_authorities(self) -> Iterator[Witness]:
        """Pairs of identity CA and permissions CA with one key; a certificate that is both is a pair with itself."""
        certificates = self._system.certificates
        for realm, _view in self.used:
            atom = self._system.realms[realm]
            for one in sorted(atom.identity_ca):
                for other in sorted(atom.permissions_ca):
                    if certificates[one].key == certificates[other].key:
                        yield {Role.REALM: realm, Role.CERTIFICATE: one, Role.OTHER_CERTIFICATE: other}

    def shared_subjects(self) -> Iterator[Witness]:
        """Pairs of enclaves that one grant names."""
        return shared_subjects(self._system)

    def _each_enclave(self) -> Iterator[tuple[int, RealmView, int, Abilities]]:
        """In each realm, what each enclave can do."""
        for realm, view in self.used:
            for enclave, able in enumerate(view.everybody()):
                yield realm, view, enclave, able

    def unenforced_grants(self) -> Iterator[Witness]:
        """Channels with a grant that the governance does not make peers ask for."""
        for realm, view in self.used:
            p = view.protection
            published, subscribed = 0, 0
            for enclave in range(len(self._system.enclaves)):
                published |= view.may_be_granted(enclave, Operation.PUBLISH)
                subscribed |= view.may_be_granted(enclave, Operation.SUBSCRIBE)
            joinable = self._permissions.within(members(self._permissions.all_domains & ~p.join_controlled))
            loose = (
                (published & ~p.write_controlled)
                | (subscribed & ~p.read_controlled)
                | ((published | subscribed) & joinable)
            )
            yield from _channels(realm, loose & p.governed)

    def ungranted_writes(self) -> Iterator[Witness]:
        """Enclaves that write, or forge without being a granted reader, where no grant lets them."""
        for realm, view, enclave, able in self._each_enclave():
            forged = able.forges & ~view.granted(enclave, Operation.SUBSCRIBE)
            without = (able.may_write | forged) & ~view.granted(enclave, Operation.PUBLISH)
            yield from _channels(realm, without, enclave)

    def ungranted_reads(self) -> Iterator[Witness]:
        """Enclaves that read where no grant lets them."""
        for realm, view, enclave, able in self._each_enclave():
            yield from _channels(realm, able.knows & ~view.granted(enclave, Operation.SUBSCRIBE), enclave)

    def forging_readers(self) -> Iterator[Witness]:
        """Granted readers that can pass for a writer of the topic."""
        for realm, view in self.used:
            written = union(able.may_write for able in view.everybody())
            for enclave, able in enumerate(view.everybody()):
                forged = able.forges & view.may_be_granted(enclave, Operation.SUBSCRIBE) & written
                yield from _channels(realm, forged & ~view.granted(enclave, Operation.PUBLISH), enclave)

    def reading_relays(self) -> Iterator[Witness]:
        """Enclaves that relay a topic, are not granted to read it, and find its payload in clear."""
        for realm, view, enclave, able in self._each_enclave():
            relayed = able.may_relay & ~view.protection.data_encrypts
            yield from _channels(realm, relayed and relayed & ~view.granted(enclave, Operation.SUBSCRIBE), enclave)

    def bridges(self) -> Iterator[Witness]:
        """Enclaves that read in one class of domains and write in another, perhaps among peers that trust otherwise.

        They write as anybody whose key they have. Who reads as another is one that the other bridges as, too.
        """
        if len(self._system.domains) < 2:
            return
        fed = [0] * len(self._system.enclaves)
        for _realm, view in self.used:
            fed = [each | able.may_write | able.forges for each, able in zip(fed, view.everybody(), strict=True)]
        for enclave, written in enumerate(Flows(self._system, self._realms).as_any(fed)):
            for realm, view in self.used:
                read = view.abilities(enclave).knows
                for within in self._permissions.channels_in if read and written else ():
                    elsewhere = written & ~within
                    for channel in members(read & within if elsewhere else 0):
                        for other in members(elsewhere):
                            witness = {Role.REALM: realm, Role.ENCLAVE: enclave, Role.CHANNEL: channel}
                            yield {**witness, Role.OTHER_CHANNEL: other}


def _as_now(system: System, moment: int) -> bool:
    """Whether at the moment all is in force that is now, and no more, nobody else is revoked, and implementations make
    the same endpoints; what is claimed of a time is not asked here.
    """
    now = 2 * system.now
    dated: Iterable[CertificateAtom | GrantAtom] = (*system.certificates, *system.grants)
    if system.claims or any(realm.at(moment).revoked != realm.revoked for realm in system.realms):
        return False
    if any(enclave.at(moment).by_itself != enclave.by_itself for enclave in system.enclaves):
        return False
    return all(
        (2 * each.not_before <= now <= 2 * each.not_after) == (2 * each.not_before <= moment <= 2 * each.not_after)
        for each in dated
    )


def _granted(permissions: Permissions, grants: Iterable[int]) -> tuple[int, ...]:
    """What the grants give together: channels for each operation, and domains."""
    given = [0] * (len(Operation) + 1)
    for grant in grants:
        for place, operation in enumerate(Operation):
            given[place] |= permissions.allowed(grant, operation)
        given[-1] |= permissions.joins(grant)
    return tuple(given)


def _channels(realm: int, channels: int, enclave: int | None = None) -> Iterator[Witness]:
    """A witness for each channel of the set."""
    for channel in members(channels):
        witness = {Role.REALM: realm, Role.CHANNEL: channel}
        yield witness if enclave is None else {**witness, Role.ENCLAVE: enclave}


def _outside(of: Callable[[RealmView], int]) -> Callable[[_Questions], Iterator[Witness]]:
    """The question on which channels somebody without any key can do something."""
    return lambda questions: (each for realm, view in questions.used for each in _channels(realm, of(view)))


_QUESTIONS: Mapping[str, Callable[[_Questions], Iterator[Witness]]] = {
    stated.ONLY_AUTHENTICATED_JOIN.id: _Questions.unauthenticated_joins,
    stated.IDENTITIES_CHAIN.id: _Questions.unvouched_identities,
    stated.DOCUMENTS_SIGNED.id: _Questions.unsigned_documents,
    stated.NO_SHARED_IDENTITY.id: _Questions.shared_identities,
    stated.NO_SELF_GRANTED_RIGHTS.id: _Questions.self_granted_rights,
    stated.ONE_CA_FOR_ONE_ROLE.id: _Questions.double_authorities,
    stated.NO_SHARED_SUBJECT.id: _Questions.shared_subjects,
    stated.OUTSIDERS_CANNOT_READ.id: _outside(outsiders.read),
    stated.OUTSIDERS_CANNOT_LEARN_NAMES.id: _outside(outsiders.learn_of),
    stated.OUTSIDERS_CANNOT_INJECT.id: _outside(outsiders.inject_into),
    stated.OUTSIDERS_CANNOT_REPLAY.id: _outside(outsiders.replay),
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS.id: _outside(outsiders.assert_liveliness_of),
    stated.GRANTS_ARE_ENFORCED.id: _Questions.unenforced_grants,
    stated.NOBODY_WRITES_WITHOUT_A_GRANT.id: _Questions.ungranted_writes,
    stated.NOBODY_READS_WITHOUT_A_GRANT.id: _Questions.ungranted_reads,
    stated.READERS_CANNOT_FORGE.id: _Questions.forging_readers,
    stated.RELAYS_CANNOT_READ.id: _Questions.reading_relays,
    stated.NO_BRIDGES.id: _Questions.bridges,
}


def _status(witness: Witness | None) -> Status:
    return Status.HOLDS if witness is None else Status.VIOLATED
