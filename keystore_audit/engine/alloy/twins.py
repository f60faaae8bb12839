"""Enclaves that differ only in what is theirs alone: exchanging two of them, with what is theirs, changes no fact.

*Theirs* are the identity certificate and its key, the permissions document with grants and rules, and the channels that
belong to one of them. Each enclave has a signature: all facts in which something of its own occurs. It names its own
things by their part, and everything else by index. So equal signatures cannot speak of each other's own things, and
exchanging two such enclaves is an automorphism of the system.
Which channels belong to whom is a guess; a wrong one makes signatures differ that might be equal, nothing else.
Without this, a keystore of 1,000 enclaves, made by `ros2 security` for one robot after the other, has 8,000 atoms and
is out of scale. With it, 60.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.grouped import gathered, grouped
from keystore_audit.model.formal.system import RuleAtom, System

MAX_MENTIONS: Final = 2_000_000
"""Pairs of a rule and a channel that are looked at: two seconds at worst."""

Order = tuple[bool, ...]
"""Qualifiers of rules that match, in order: True for allow."""

Said = tuple[Mapping[int, Order], Mapping[int, Order], Mapping[int, Order]]
"""What grants (by index) say of one channel: of publishing, of subscribing, of relaying."""


def mentions(system: System) -> list[Said] | None:
    """Return what grants say of each channel, by channel; None where that is too much to look at."""
    granted = sum(len(rule.publish) + len(rule.subscribe) + len(rule.relay) for rule in system.rules)
    if granted + sum(len(rule.channels) for rule in system.topic_rules) > MAX_MENTIONS:
        return None
    said: list[tuple[dict[int, Order], ...]] = [({}, {}, {}) for _ in system.channels]
    for rule in system.rules:
        for operation, channel in _matches(rule, system):
            by_grant = said[channel][operation]
            before = by_grant.get(rule.grant, ())
            if before[-1:] != (rule.allow,):
                by_grant[rule.grant] = (*before, rule.allow)
    return [(publish, subscribe, relay) for publish, subscribe, relay in said]


def _matches(rule: RuleAtom, system: System) -> Iterator[tuple[int, int]]:
    """Operation (its place in a `Said`) and channel, for each channel that a criterion of the rule matches."""
    for operation, channels in enumerate((rule.publish, rule.subscribe, rule.relay)):
        for channel in channels:
            if system.channels[channel].domain in rule.domains:
                yield operation, channel


def surroundings(system: System) -> list[Hashable]:
    """Return what is known of each channel apart from grants: domain, governance rules and places of claims. Of
    enclaves, those whose own implementation decides otherwise about it than peers.
    """
    by_itself: list[list[tuple[int, int]]] = [[] for _ in system.channels]
    for number, enclave in enumerate(system.enclaves):
        for relation, channels in enumerate(enclave.by_itself):
            for channel in channels:
                by_itself[channel].append((number, relation))
    # Topics of a claim of ability are places each, whatever its source and target are together.
    places = [
        list(dict.fromkeys(each.channels for pair in claim.pairs for each in pair if each.channels))
        for claim in system.claims
    ]
    topic_rules: list[list[int]] = [[] for _ in system.channels]
    for number, rule in enumerate(system.topic_rules):
        for channel in rule.channels:
            topic_rules[channel].append(number)
    return [
        (
            atom.domain,
            tuple(topic_rules[channel]),
            tuple(by_itself[channel]),
            tuple(
                (
                    channel in claim.source.channels,
                    channel in claim.target.channels,
                    channel in claim.left_out,
                    *(channel in part for part in parts),
                )
                for claim, parts in zip(system.claims, places, strict=True)
            ),
        )
        for channel, atom in enumerate(system.channels)
    ]


MAX_SHARERS: Final = 4
"""Enclaves that may have rules about a channel that still counts as one's own: itself and a few hubs."""

OWN: Final = -1
"""Stands for one's own certificate."""


def find_twins(system: System, said: Sequence[Said]) -> tuple[Sequence[Sequence[int]], Mapping[int, Sequence[int]]]:
    """Return which enclaves are alike, by index, each class in order; and the channels of its own of each.

    Those that share a certificate, a key or a document are like no other, and in no class.
    """
    twins = _Twins(system, said)
    return tuple(grouped(twins.candidates, twins.signature).values()), twins.own


class _Twins:
    def __init__(self, system: System, said: Sequence[Said]) -> None:
        self._system = system
        self._said = said
        self._around = surroundings(system)
        self._grants = gathered((grant.document, number) for number, grant in enumerate(system.grants))
        self._naming = gathered((name, number) for number, grant in enumerate(system.grants) for name in grant.names)
        self._joined = gathered((rule.grant, rule.domains) for rule in system.rules if rule.allow)
        self.candidates = dict(self._independent())
        owner = {grant: enclave for enclave in self.candidates for grant in self._granted(enclave)}
        sharers = [{owner[grant] for part in each for grant in part if grant in owner} for each in said]
        self._mentioned = gathered((enclave, channel) for channel, about in enumerate(sharers) for enclave in about)
        self.own: dict[int, list[int]] = {enclave: [] for enclave in self.candidates}
        related = {channel for one, others in enumerate(system.meets) if others for channel in (one, *others)}
        for channel, about in enumerate(sharers):
            if about and len(about) <= MAX_SHARERS and channel not in related:
                first, *others = sorted(about, key=lambda enclave: len(self._mentioned[enclave]))
                if not others or len(self._mentioned[first]) < len(self._mentioned[others[0]]):
                    self.own[first].append(channel)

    def _independent(self) -> Iterable[tuple[int, int]]:
        """Enclaves whose certificate, key and document serve nobody and nothing else, with the certificate."""
        system = self._system
        identities = Counter(enclave.identity for enclave in system.enclaves)
        carried = Counter(document for enclave in system.enclaves for document in enclave.permissions)
        keys = Counter(certificate.key for certificate in system.certificates)
        bound = {c for trust in system.trust_domains for c in (*trust.identity_ca, *trust.permissions_ca)}
        bound |= {c for document in system.documents for c in document.signers}
        bound |= {i for n, certificate in enumerate(system.certificates) for i in certificate.issuers if i != n}
        governing = {each.governance for each in system.trust_domains} | {each.document for each in system.domain_rules}
        for number, enclave in enumerate(system.enclaves):
            identity = enclave.identity
            if identity is None or enclave.opaque or identity in bound or identities[identity] > 1:
                continue
            if keys[system.certificates[identity].key] > 1:
                continue
            if any(carried[n] > 1 or n in governing or system.documents[n].opaque for n in enclave.permissions):
                continue
            yield number, identity

    def _granted(self, enclave: int) -> Sequence[int]:
        """The grants of its document, reading by reading."""
        carried = sorted(self._system.enclaves[enclave].permissions)
        return [grant for document in carried for grant in self._grants.get(document, ())]

    def signature(self, enclave: int) -> Hashable:
        """All that is known of an enclave."""
        system, own = self._system, set(self.own[enclave])
        return (
            self._trust(enclave),
            self._documents(enclave),
            frozenset((c, self._own_words(enclave, c)) for c in self._mentioned.get(enclave, ()) if c not in own),
            frozenset(self._owned(enclave, channel) for channel in own),
            tuple(
                (enclave in claim.source.enclaves, enclave in claim.target.enclaves, enclave in claim.through)
                for claim in system.claims
            ),
            tuple(frozenset(domain for e, domain in claim.starts if e == enclave) for claim in system.claims),
        )

    def _trust(self, enclave: int) -> Hashable:
        """What is known of its certificate."""
        identity, atom = self.candidates[enclave], self._system.enclaves[enclave]
        certificate = self._system.certificates[identity]
        return (
            (atom.trust_domain, atom.unmanaged),
            self._but_own(certificate.issuers, identity),
            (certificate.authority, certificate.fit_to_sign, certificate.not_before, certificate.not_after),
            tuple((identity in trust.revoked, identity in trust.refuses) for trust in self._system.trust_domains),
            frozenset(self._naming.get(identity, ())) - set(self._granted(enclave)),
        )

    def _documents(self, enclave: int) -> Hashable:
        """Its document and its grants, apart from what these say of channels."""
        grants = self._system.grants
        carried = [self._system.documents[each] for each in sorted(self._system.enclaves[enclave].permissions)]
        told = tuple(
            (
                self._system.documents[grants[n].document].reading,
                self._but_own(grants[n].names, self.candidates[enclave]),
                (grants[n].not_before, grants[n].not_after, grants[n].default_allow),
                frozenset().union(*self._joined.get(n, ())),
            )
            for n in self._granted(enclave)
        )
        return tuple((each.reading, each.intact, each.signers) for each in carried), told

    @staticmethod
    def _but_own(certificates: Collection[int], identity: int) -> frozenset[int]:
        return frozenset(OWN if each == identity else each for each in certificates)

    def _owned(self, enclave: int, channel: int) -> Hashable:
        """All that is known of a channel of its own."""
        grants = set(self._granted(enclave))
        others = tuple(
            frozenset((grant, order) for grant, order in part.items() if grant not in grants)
            for part in self._said[channel]
        )
        return self._around[channel], self._own_words(enclave, channel), others

    def _own_words(self, enclave: int, channel: int) -> tuple[tuple[Order | None, ...], ...]:
        """What its own grants say of a channel, by operation and in the order of its document."""
        return tuple(tuple(part.get(grant) for grant in self._granted(enclave)) for part in self._said[channel])
