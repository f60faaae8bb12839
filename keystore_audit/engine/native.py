"""The native engine: the properties over the model in `keystore_audit.model`, in Python.

Independent of Alloy, which decides the same questions from the same `System` with rules of its own
(docs/model.md).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice, permutations, product

from keystore_audit.assumptions import DOCUMENTS
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal import rights as outsiders
from keystore_audit.model.formal.attacker import TrustDomainView, trust_domain_views
from keystore_audit.model.formal.bit_sets import Abilities, members, union
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import CertificateAtom, GrantAtom, System
from keystore_audit.properties import BY_ID, PROPERTIES, Answer, Property, Role, Status, Witness, stated

MAX_WITNESSES = 1000
"""Witnesses kept for each property.

A report shows one and says how many more; a thousand are more than anybody reads.
"""


class NativeEngine:
    """Answers every property and claim about each of the systems of one keystore.

    Moments are those of `permission.Permissions`. What the systems share is computed once.
    """

    def __init__(self, systems: Sequence[System]) -> None:
        self.systems = tuple(systems)
        self._decisions: dict[tuple[int, int, int, int], Decisions] = {}

    @cached_property
    def answers(self) -> tuple[dict[str, Answer], ...]:
        """For each system the answer to each property at the audit instant, by id.

        A witness is given for each violating assignment, up to MAX_WITNESSES.
        """
        return tuple(self._questions(s).answers() for s in self.systems)

    def statuses_of(self, system: System, names: Collection[str]) -> dict[str, Status]:
        """The status at the audit instant of these properties and of all claims, where one witness is enough.

        `system`: one of these with less taken for granted, or with other claims.
        """
        return self._questions(system).statuses(names)

    def checked(self, told: Sequence[Mapping[str, Answer]]) -> tuple[dict[str, Answer], ...]:
        """What another engine said of each system; UNKNOWN where it shows a violation that is none here.

        A violation that one engine states, but whose example does not violate anything here, is undecided.
        """
        return tuple(
            self._questions(system).checked(answers) for system, answers in zip(self.systems, told, strict=True)
        )

    def claim_answers(self) -> tuple[dict[str, Answer], ...]:
        """The same for claims alone."""
        return tuple(self._questions(s).claims() for s in self.systems)

    def statuses(self, moment: int) -> tuple[dict[str, Status], ...]:
        """For each system the status of each property at `moment`, by id."""
        return tuple(
            {name: answer.status for name, answer in answers.items()}
            if _as_now(system, moment)
            else self._questions(system, moment).statuses()
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

    def _questions(self, system: System, moment: int | None = None) -> _Questions:
        return _Questions(system, moment, self._shared(system))

    def _shared(self, system: System) -> Decisions:
        """Decisions for all systems that hold the same grants, rules and channels, as one keystore's mostly do."""
        key = (id(system.grants), id(system.rules), id(system.channels), id(system.meets))  # alive as long as `systems`
        if key not in self._decisions:
            self._decisions[key] = Decisions(system)
        return self._decisions[key]


class _Questions:
    """The properties as questions about one system at one moment."""

    def __init__(self, system: System, moment: int | None, decisions: Decisions) -> None:
        self.system = system
        self._moment = 2 * system.now if moment is None else moment
        self._decisions = decisions
        self._permissions = Permissions(system, moment, decisions)
        self._trust_domains = trust_domain_views(system, self._permissions)
        self.used = [(number, self._trust_domains[number]) for number in system.trust_domains_of_enclaves()]

    def answers(self) -> dict[str, Answer]:
        return {prop.id: self._answer(prop) for prop in PROPERTIES} | self.claims() | self.determinism()

    def checked(self, told: Mapping[str, Answer]) -> dict[str, Answer]:
        """The answers of another engine, where its examples hold here; a flow without a path gets its path here."""
        confirmed = {name: self._confirmed(name, answer) for name, answer in told.items() if name in BY_ID}
        if self.system.claims:
            from keystore_audit.engine.native_claims import claims_at  # most audits have none

            for claim in (each for each in self.system.claims if each.id in told):
                answer = told[claim.id]
                moment = self._moment if answer.moment is None else answer.moment
                if answer.status is Status.VIOLATED:
                    answer = claims_at(self.system, moment, self._decisions).confirmed(claim, answer, moment)
                confirmed[claim.id] = answer
        return {**told, **confirmed}

    def _confirmed(self, name: str, told: Answer) -> Answer:
        so = all(any(each == found for found in self.witnesses(name)) for each in told.witnesses)
        return told if so else Answer(status=Status.UNKNOWN)

    def statuses(self, names: Collection[str] = BY_ID) -> dict[str, Status]:
        found = {name: _status(next(self.witnesses(name), None)) for name in BY_ID if name in names}
        return found | {claim: answer.status for claim, answer in self.claims().items()}

    def claims(self) -> dict[str, Answer]:
        """The answers about users' claims from the moment on."""
        if not self.system.claims:
            return {}
        from keystore_audit.engine.native_claims import Claims, answer  # most audits have none

        now = Claims(self.system, self._trust_domains)
        return {
            claim.id: answer(self.system, claim, now, self._moment, self._decisions) for claim in self.system.claims
        }

    def determinism(self) -> dict[str, Answer]:
        """The answers about declared behaviour."""
        if not self.system.determinism:
            return {}
        from keystore_audit.engine.native_determinism import answer  # most audits have none

        return {asked.id: answer(asked) for asked in self.system.determinism}

    def _answer(self, prop: Property) -> Answer:
        witnesses = tuple(islice(self.witnesses(prop.id), MAX_WITNESSES))
        return Answer(status=_status(next(iter(witnesses), None)), witnesses=witnesses)

    def witnesses(self, name: str) -> Iterator[Witness]:
        """All that violates the property of this id."""
        if name in _OF_CHANNELS:
            for trust_domain, view in self.used:
                yield from _channels(trust_domain, _OF_CHANNELS[name](view))
        elif name in _OF_ENCLAVES:
            for trust_domain, view in self.used:
                written = union(able.may_write for able in view.everybody())
                for enclave, able in enumerate(view.everybody()):
                    yield from _channels(trust_domain, _OF_ENCLAVES[name](view, enclave, able, written), enclave)
        else:
            yield from _OTHERS[name](self)

    def unauthenticated_joins(self) -> Iterator[Witness]:
        """Domains that an unauthenticated participant can join."""
        for trust_domain, view in self.used:
            for domain in members(view.protection.unauthenticated):
                yield {Role.TRUST_DOMAIN: trust_domain, Role.DOMAIN: domain}

    def unvouched_identities(self) -> Iterator[Witness]:
        """Enclaves whose identity nobody vouches for now."""
        for enclave, atom in enumerate(self.system.enclaves):
            known = atom.identity is None or self._trust_domains[atom.trust_domain].introduced(enclave, in_force=True)
            if not atom.unmanaged and (self.system.anybody(enclave) or not known):
                yield {Role.ENCLAVE: enclave}

    def unsigned_documents(self) -> Iterator[Witness]:
        """Documents in use that the permissions CA did not sign, or whose signature is not in force."""
        for enclave, atom in enumerate(self.system.enclaves):
            view = self._trust_domains[atom.trust_domain]
            used = view.documents.keys() & {*atom.permissions, self.system.trust_domains[atom.trust_domain].governance}
            for document in () if atom.unmanaged else sorted(used):
                signers = [self.system.certificates[s] for s in self.system.documents[document].signers]
                if document not in view.genuine or not all(
                    self._permissions.in_force(s.not_before, s.not_after) for s in signers
                ):
                    yield {Role.ENCLAVE: enclave, Role.DOCUMENT: document}

    def self_granted_rights(self) -> Iterator[Witness]:
        """Enclaves whose permissions peers accept although the permissions CA did not sign them."""
        for trust_domain, view in self.used:
            foreign = view.accepted - view.genuine
            for enclave, atom in enumerate(self.system.enclaves):
                if atom.permissions & foreign or view.self_granting(enclave):
                    yield {Role.TRUST_DOMAIN: trust_domain, Role.ENCLAVE: enclave}

    def double_authorities(self) -> Iterator[Witness]:
        """Pairs of identity CA and permissions CA with one key; a certificate that is both is a pair with itself."""
        certificates = self.system.certificates
        for trust_domain, _view in self.used:
            atom = self.system.trust_domains[trust_domain]
            for one, other in product(sorted(atom.identity_ca), sorted(atom.permissions_ca)):
                if certificates[one].key == certificates[other].key:
                    yield {Role.TRUST_DOMAIN: trust_domain, Role.CERTIFICATE: one, Role.OTHER_CERTIFICATE: other}

    def unenforced_grants(self) -> Iterator[Witness]:
        """Channels with a grant that the governance does not make peers ask for."""
        everybody = range(len(self.system.enclaves))
        for trust_domain, view in self.used:
            p = view.protection
            published = union(view.may_be_granted(enclave, Operation.PUBLISH) for enclave in everybody)
            subscribed = union(view.may_be_granted(enclave, Operation.SUBSCRIBE) for enclave in everybody)
            joinable = self._permissions.within(members(self._permissions.all_domains & ~p.join_controlled))
            loose = (
                (published & ~p.write_controlled)
                | (subscribed & ~p.read_controlled)
                | ((published | subscribed) & joinable)
            )
            yield from _channels(trust_domain, loose & p.governed)

    def bridges(self) -> Iterator[Witness]:
        """Enclaves that read in one class of domains and write in another, perhaps among peers that trust otherwise.

        They write as anybody whose key they have. Who reads as another need not be asked about: that one bridges too.
        """
        if len(self.system.domains) < 2:
            return
        fed = [0] * len(self.system.enclaves)
        for _trust_domain, view in self.used:
            fed = [each | able.may_write | able.forges for each, able in zip(fed, view.everybody(), strict=True)]
        for enclave, written in enumerate(Flows(self.system, self._trust_domains).as_any(fed)):
            for trust_domain, view in self.used:
                read = view.abilities(enclave).knows
                for within in self._permissions.channels_in if read and written else ():
                    elsewhere = written & ~within
                    for channel in members(read & within if elsewhere else 0):
                        for other in members(elsewhere):
                            witness = {Role.TRUST_DOMAIN: trust_domain, Role.ENCLAVE: enclave, Role.CHANNEL: channel}
                            yield {**witness, Role.OTHER_CHANNEL: other}


def _as_now(system: System, moment: int) -> bool:
    """Whether the same is in force at the moment as now, the same is revoked, and implementations make the same
    endpoints. Claims about a time are not asked here.
    """
    now = 2 * system.now
    dated: Iterable[CertificateAtom | GrantAtom] = (*system.certificates, *system.grants)
    if system.claims or any(each.at(moment).revoked != each.revoked for each in system.trust_domains):
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


def _channels(trust_domain: int, channels: int, enclave: int | None = None) -> Iterator[Witness]:
    """A witness for each channel of the set."""
    for channel in members(channels):
        witness = {Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: channel}
        yield witness if enclave is None else {**witness, Role.ENCLAVE: enclave}


_OF_CHANNELS: Mapping[str, Callable[[TrustDomainView], int]] = {
    stated.OUTSIDERS_CANNOT_READ.id: outsiders.read,
    stated.OUTSIDERS_CANNOT_LEARN_NAMES.id: outsiders.learn_of,
    stated.OUTSIDERS_CANNOT_INJECT.id: outsiders.inject_into,
    stated.OUTSIDERS_CANNOT_REPLAY.id: outsiders.replay,
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS.id: outsiders.assert_liveliness_of,
}
"""By property: the channels of a trust domain on which somebody without any key violates it."""


def _writes_without_a_grant(view: TrustDomainView, enclave: int, able: Abilities, _written: int) -> int:
    """Channels that it writes, or forges without being a granted reader, where no grant allows it."""
    forged = able.forges & ~view.granted(enclave, Operation.SUBSCRIBE)
    return (able.may_write | forged) & ~view.granted(enclave, Operation.PUBLISH)


def _reads_without_a_grant(view: TrustDomainView, enclave: int, able: Abilities, _written: int) -> int:
    return able.knows & ~view.granted(enclave, Operation.SUBSCRIBE)


def _forges_as_a_reader(view: TrustDomainView, enclave: int, able: Abilities, written: int) -> int:
    """Channels of which it is a granted reader and can impersonate a writer."""
    forged = able.forges & view.may_be_granted(enclave, Operation.SUBSCRIBE) & written
    return forged & ~view.granted(enclave, Operation.PUBLISH)


def _reads_as_a_relay(view: TrustDomainView, enclave: int, able: Abilities, _written: int) -> int:
    """Channels that it relays, is not granted to read, and whose payload is in clear."""
    relayed = able.may_relay & ~view.protection.data_encrypts
    return relayed and relayed & ~view.granted(enclave, Operation.SUBSCRIBE)


_OF_ENCLAVES: Mapping[str, Callable[[TrustDomainView, int, Abilities, int], int]] = {
    stated.NOBODY_WRITES_WITHOUT_A_GRANT.id: _writes_without_a_grant,
    stated.NOBODY_READS_WITHOUT_A_GRANT.id: _reads_without_a_grant,
    stated.READERS_CANNOT_FORGE.id: _forges_as_a_reader,
    stated.RELAYS_CANNOT_READ.id: _reads_as_a_relay,
}
"""By property: the channels on which an enclave violates it, of all that somebody writes."""

_OTHERS: Mapping[str, Callable[[_Questions], Iterator[Witness]]] = {
    stated.ONLY_AUTHENTICATED_JOIN.id: _Questions.unauthenticated_joins,
    stated.IDENTITIES_CHAIN.id: _Questions.unvouched_identities,
    stated.DOCUMENTS_SIGNED.id: _Questions.unsigned_documents,
    stated.NO_SHARED_IDENTITY.id: lambda questions: shared_identities(questions.system),
    stated.NO_SELF_GRANTED_RIGHTS.id: _Questions.self_granted_rights,
    stated.ONE_CA_FOR_ONE_ROLE.id: _Questions.double_authorities,
    stated.NO_SHARED_SUBJECT.id: lambda questions: shared_subjects(questions.system),
    stated.GRANTS_ARE_ENFORCED.id: _Questions.unenforced_grants,
    stated.NO_BRIDGES.id: _Questions.bridges,
}


def _status(witness: Witness | None) -> Status:
    return Status.HOLDS if witness is None else Status.VIOLATED


def shared_identities(system: System) -> Iterator[Witness]:
    """Pairs of enclaves with one identity key; an opaque enclave may be any other, even one that is not here."""
    subjects = _subjects(system) if any(enclave.unmanaged for enclave in system.enclaves) else {}
    for sharing in system.holders().values():
        for one, other in permutations(sharing, 2):
            unmanaged = system.enclaves[one].unmanaged, system.enclaves[other].unmanaged
            renewed = any(unmanaged) and subjects[one] == subjects[other]
            if not (all(unmanaged) or renewed):
                yield {Role.ENCLAVE: one, Role.OTHER: other}
    for one in range(len(system.enclaves)):
        if system.anybody(one):
            yield {Role.ENCLAVE: one, Role.OTHER: one}


def _subjects(system: System) -> dict[int, tuple[frozenset[int], Sequence[int]]]:
    """By enclave, who issued its certificate and which grants name it: equal for a renewed certificate."""
    naming: dict[int, list[int]] = {}
    for number, grant in enumerate(system.grants):
        for certificate in grant.names:
            naming.setdefault(certificate, []).append(number)
    return {
        number: (system.certificates[enclave.identity].issuers, naming.get(enclave.identity, []))
        for number, enclave in enumerate(system.enclaves)
        if enclave.identity is not None
    }


def shared_subjects(system: System) -> Iterator[Witness]:
    """Pairs of enclaves that one grant names; an opaque enclave may have any subject, a document any grant."""
    governances = {trust_domain.governance for trust_domain in system.trust_domains}
    opaque = (number for number, document in enumerate(system.documents) if document.opaque)
    if any(number not in governances for number in opaque) or not system.assumed >= DOCUMENTS:
        for one, other in permutations(range(len(system.enclaves)), 2):
            yield {Role.ENCLAVE: one, Role.OTHER: other}
    by_certificate: dict[int, list[int]] = {}
    for enclave, atom in enumerate(system.enclaves):
        if system.anybody(enclave):
            yield {Role.ENCLAVE: enclave, Role.OTHER: enclave}
        elif atom.identity is not None:
            by_certificate.setdefault(atom.identity, []).append(enclave)
    holders = system.holders()
    for names in dict.fromkeys(grant.names for grant in system.grants):
        named = [enclave for certificate in sorted(names) for enclave in by_certificate.get(certificate, ())]
        for one, other in permutations(named, 2):
            if _serve_two(system, holders, one, other):
                yield {Role.ENCLAVE: one, Role.OTHER: other}


def _serve_two(system: System, holders: Mapping[int, Sequence[int]], one: int, other: int) -> bool:
    """Whether two enclaves have these identities; an unmanaged one belongs to each enclave that has its key."""
    first, second = sorted((one, other), key=lambda enclave: system.enclaves[enclave].unmanaged)
    key = system.key_of(second)
    if not system.enclaves[second].unmanaged or key is None:
        return True
    sharing = [enclave for enclave in holders[key] if not system.enclaves[enclave].unmanaged]
    return not system.enclaves[first].unmanaged and any(enclave != first for enclave in sharing)
