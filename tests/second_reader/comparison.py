"""The second reader's list beside what an engine is given: every difference in a sentence.

What a system holds as unknown (`opaque`) says nothing definite and is passed over; `Seen` counts it, so that tests can
say where there must be none.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import Any
from urllib.parse import unquote

from msgspec import Struct, field

from tests.second_reader import openssl
from tests.second_reader.documents import DomainRule, Grant, instant
from tests.second_reader.implementations import (
    IMPLEMENTATIONS,
    Implementation,
    covers,
    decides,
    governs,
    has_topic,
    lists,
    names,
)
from tests.second_reader.listing import Bounds, Enclave, Listing
from tests.second_reader.openssl import Certificate

NAMES_ASKED = 24
"""Topic names of a store beside those that stand for its channels."""

Seen = Counter[str]
"""How much was compared, by what it is."""


def compare(listing: Listing, systems: Sequence[Any], digests: Sequence[str], at: datetime, seen: Seen) -> list[str]:
    """All differences, each once for all that it is told of."""
    found: dict[str, None] = {}
    for system in systems:
        for way in dict.fromkeys(IMPLEMENTATIONS[name] for name in system.profiles if name in IMPLEMENTATIONS):
            for each in _System(listing, system, digests, at, way, seen).differences():
                found.setdefault(f"{way.name}, {'may' if system.may else 'must'}: {each}")
    return list(found)


class _System(Struct):
    listing: Listing
    system: Any
    digests: Sequence[str]
    at: datetime
    way: Implementation
    seen: Seen
    held: list[Certificate | None] = field(default_factory=list)
    by_name: dict[str, list[Enclave]] = field(default_factory=dict)

    def differences(self) -> Iterator[str]:
        """Every one."""
        known = self.listing.certificates
        self.held = [known.get(digest) for digest in self.digests]
        self.held += [None] * (len(self.system.certificates) - len(self.held))
        self.by_name = {}
        for each in self.listing.enclaves:
            self.by_name.setdefault(each.folder.name, []).append(each)
        yield from self._certificates()
        yield from self._enclaves()
        yield from self._trust_domains()
        yield from self._documents()
        yield from self._rights()
        yield from self._unmanaged()
        yield from self._signing()

    # certificates and keys

    def _certificates(self) -> Iterator[str]:
        atoms = self.system.certificates
        for number, (atom, mine) in enumerate(zip(atoms, self.held, strict=True)):
            if atom.opaque:
                self.seen["opaque certificate"] += 1
                continue
            if mine is None:
                yield f"certificate {atom.label} at {atom.location} is nowhere in the tree"
                continue
            self.seen["certificate"] += 1
            facts = (atom.authority, atom.fit_to_sign)
            if facts != (mine.may_issue, mine.may_sign):
                yield f"{mine.subject} may issue, may sign: {facts}; OpenSSL: {(mine.may_issue, mine.may_sign)}"
            dates = (self.system.instants[atom.not_before], self.system.instants[atom.not_after])
            if dates != (mine.not_before, mine.not_after):
                yield f"{mine.subject} is valid {dates}; OpenSSL: {(mine.not_before, mine.not_after)}"
            for other, beside in zip(atoms[:number], self.held, strict=False):
                if beside is not None and (other.key == atom.key) is not (beside.key == mine.key):
                    yield f"{mine.subject} and {beside.subject}: one key {other.key == atom.key}; OpenSSL disagrees"
            yield from self._issuers(number, mine)
        given = {each.sha256 for each in self.held if each is not None}
        for enclave in self.listing.enclaves:
            if not enclave.doubtful:
                first = (enclave.identity,) if enclave.identity is not None else ()
                for each in (*first, *enclave.identity_ca, *enclave.permissions_ca):
                    if each.sha256 not in given:
                        yield f"{each.subject} of {enclave.folder.name} is not given"

    def _issuers(self, number: int, mine: Certificate) -> Iterator[str]:
        """Of those that are asked about: authorities. A certificate that adds nothing is said to have no issuer."""
        given = {n for n in self.system.certificates[number].issuers if self.held[n] is not None}
        for n, issuer in enumerate(self.held):
            if issuer is None or not self._is_authority(issuer):
                if n in given and (issuer is None or not openssl.issued(issuer, mine)):
                    yield f"{issuer and issuer.subject} did not issue {mine.subject}"
                continue
            self.seen["pair of certificates"] += 1
            # OpenSSL asks nobody else about one that names itself.
            true = (issuer is mine or not mine.names_itself) and openssl.issued(issuer, mine)
            if true is not (n in given) and (given or true is False or not self._is_idle(number)):
                yield f"{issuer.subject} issued {mine.subject} ({issuer.sha256[:6]}, {mine.sha256[:6]}): {n in given}"

    def _is_authority(self, issuer: Certificate) -> bool:
        """Whether it stands in a CA file, or a message brings it along as an authority."""
        held = (c for each in self.listing.enclaves for c in (*each.identity_ca, *each.permissions_ca))
        if any(each.sha256 == issuer.sha256 for each in held):
            return True
        if not self.way.pins:
            return issuer.may_issue
        contents = (self._content(n) for n in range(len(self.system.documents)))
        messages = [openssl.message_in(content) for content in contents if content is not None]
        return issuer.may_issue and any(issuer in each.embedded for each in messages if each is not None)

    def _is_idle(self, number: int) -> bool:
        """Whether no enclave, no signature and no other certificate rests on it: it may be left out of chains."""
        identities = {each.identity for each in self.system.enclaves}
        signers = {n for each in self.system.documents for n in each.signers}
        return number not in identities | signers

    # enclaves and what they trust

    def _enclaves(self) -> Iterator[str]:
        atoms = [each for each in self.system.enclaves if not each.unmanaged]
        left_out = {unquote(each.label) for each in self.system.left_out}
        named = {unquote(each.label) for each in atoms}
        if self.system.may:
            for name in self.by_name.keys() - named - left_out:
                yield f"enclave {name} is not given"
        for atom in atoms:
            name = unquote(atom.label)
            if atom.opaque:
                self.seen["opaque enclave"] += 1
                continue
            here = self.by_name.get(name, [])
            if not here:
                yield f"there is no enclave {name}"
            for mine in here if len(here) == 1 else ():
                self.seen["enclave"] += 1
                given = None if atom.identity is None else self.held[atom.identity]
                if given is not mine.identity:
                    yield f"{name} goes by {given}, and its file has {mine.identity}"
                document = None if atom.document is None else self._content(atom.document)
                if atom.document is not None and document != mine.permissions:
                    yield f"{name} has other permissions than its folder"
                if atom.permissions is None and mine.permissions in self.listing.messages and not self._must:
                    yield f"{name} has permissions, and none are given"

    @property
    def _must(self) -> bool:
        return not self.system.may

    def _content(self, document: int) -> bytes | None:
        place = unquote(self.system.documents[document].label)
        return self.listing.contents.get(place)

    def _members(self) -> Iterator[tuple[Any, Enclave]]:
        """Each trust domain with an enclave of it whose trust is known."""
        done = set()
        for atom in self.system.enclaves:
            here = self.by_name.get(unquote(atom.label), [])
            if atom.unmanaged or atom.trust_domain in done or len(here) != 1 or here[0].doubtful:
                continue
            trust_domain = self.system.trust_domains[atom.trust_domain]
            if not any(self.system.certificates[n].opaque for n in trust_domain.identity_ca):
                done.add(atom.trust_domain)
                yield trust_domain, here[0]

    def _trust_domains(self) -> Iterator[str]:
        apart: dict[object, set[int]] = {}
        for atom in self.system.enclaves:
            here = self.by_name.get(unquote(atom.label), [])
            if not atom.unmanaged and len(here) == 1 and not here[0].doubtful:
                apart.setdefault(here[0].trust, set()).add(atom.trust_domain)
        yield from (
            f"enclaves of equal files are in trust domains {sorted(each)}" for each in apart.values() if len(each) > 1
        )
        for trust_domain, mine in self._members():
            name = mine.folder.name
            self.seen["trust_domain"] += 1
            yield from self._anchors(
                name, "identity", trust_domain.identity_ca, self.listing.anchors(mine, "identity_ca", self.way)
            )
            signing = self.listing.anchors(mine, "permissions_ca", self.way)
            yield from self._anchors(name, "permissions", trust_domain.permissions_ca, signing)
            governance = None if trust_domain.governance is None else self._content(trust_domain.governance)
            if trust_domain.governance is not None and governance != mine.governance:
                yield f"{name} has another governance than its folder"
            if trust_domain.governance is None and mine.governance in self.listing.messages and not self._must:
                yield f"{name} has a governance, and none is given"
            yield from self._identities(trust_domain, mine)

    def _anchors(self, name: str, role: str, given: Iterable[int], anchors: Sequence[Certificate]) -> Iterator[str]:
        """Anchors by key: one that was certified anew in the same file or message is the same authority."""
        theirs = {each.key for each in (self.held[n] for n in given) if each is not None}
        certain, possible = set(), set()
        for each in anchors:
            if role == "identity":
                is_certain, is_possible = self.listing.usable(each, tuple(anchors), self.way)
            else:
                is_certain = is_possible = self.way.pins or each.names_itself
            certain |= {each.key} if is_certain else set()
            possible |= {each.key} if is_possible else set()
        self.seen["anchor"] += len(certain)
        if not certain <= theirs <= possible:
            odd = (theirs - possible) | (certain - theirs)
            told = sorted(c.subject for c in self.listing.certificates.values() if c.key in odd)
            yield f"{role} anchors of {name} differ by {told}: given {len(theirs)}, in the file {len(certain)}"

    def _identities(self, trust_domain: Any, mine: Enclave) -> Iterator[str]:
        identities = {e.identity for e in self.system.enclaves if e.identity is not None}
        for n in sorted(identities):
            certificate = self.held[n]
            if certificate is None:
                continue
            self.seen["identity under a trust domain"] += 1
            authorities = self.system.certificates
            given = any(authorities[i].authority for i in authorities[n].issuers & trust_domain.identity_ca)
            if not given and certificate in mine.identity_ca:  # an opaque participant stands for it, or (MUST) nobody
                continue
            if self._differs(given, self.listing.lets_in(mine, certificate, self.way)):
                yield f"{mine.folder.name} lets in {certificate.subject} ({certificate.sha256[:6]}): {given}"

    def _differs(self, given: bool, mine: Bounds) -> bool:
        """What some implementation does has to be given, and what none can do must not be."""
        if given and not mine.certain:
            self.seen["given, and not as the files are"] += 1
        return mine.certain if not given else not mine.possible

    # documents

    def _documents(self) -> Iterator[str]:
        given: dict[bytes, Any] = {}
        for number, atom in enumerate(self.system.documents):
            content = self._content(number)
            if atom.opaque:
                self.seen["opaque document"] += 1
                if content is not None:
                    given[content] = None
                continue
            if content is None:
                yield f"document {atom.label} is not there"
                continue
            given[content] = atom
        members = list(self._members())
        carried = {content for e in self.listing.enclaves for content in (e.governance, e.permissions)}
        for content, places in self.listing.messages.items():
            taking = [mine for _trust_domain, mine in members if self._any_way(mine, content)]
            is_governance = self.listing.says(content)[0] is not None
            if content not in given and taking and not is_governance and not self._must:
                yield f"{places[0]} is taken by {taking[0].folder.name}, and is not given"
            if content not in carried and given.get(content) is not None:
                self.seen["unmanaged document"] += 1
        for content, atom in given.items():
            if atom is None:
                continue
            self.seen["document"] += 1
            yield from self._signers(content, atom)
            for trust_domain, mine in members:
                self.seen["document under a trust domain"] += 1
                theirs = self._accepted(trust_domain, atom)
                if self._differs(theirs, self.listing.obeys(mine, content, self.way)):
                    yield f"{mine.folder.name} takes {atom.label}: {theirs}"

    def _signers(self, content: bytes, atom: Any) -> Iterator[str]:
        """Whose keys signed it. Where the signer is not pinned, its certificate has to be in the message."""
        every = tuple(self.listing.certificates.values())
        intact = openssl.signed_content(content, every) is not None
        if (atom.intact and not intact) or (intact and not atom.intact and self.way.pins):
            yield f"{atom.label} has signatures that hold: {atom.intact}"
        theirs = {each.key for each in (self.held[n] for n in atom.signers) if each is not None}
        if atom.intact and theirs != {each.key for each in openssl.signers_in(content, every)}:
            yield f"{atom.label} is signed by others"

    def _any_way(self, mine: Enclave, content: bytes) -> bool:
        return any(self.listing.obeys(mine, content, way).certain for way in IMPLEMENTATIONS.values())

    def _accepted(self, trust_domain: Any, atom: Any) -> bool:
        if not atom.intact or not atom.signers:
            return False
        return bool(atom.signers <= self._trusted_signers(trust_domain))

    def _trusted_signers(self, trust_domain: Any) -> set[int]:
        """As alloy/documents.als has it."""
        if self.system.readings[trust_domain.reading].pins_signer:
            return set(trust_domain.permissions_ca)
        atoms = self.system.certificates
        chained = self._below(trust_domain)
        return {n for n in chained | set(trust_domain.permissions_ca) if atoms[n].fit_to_sign}

    def _below(self, trust_domain: Any) -> set[int]:
        atoms, chained = self.system.certificates, set()
        above = set(trust_domain.permissions_ca)
        while above:
            issuing = {n for n in above if atoms[n].authority}
            above = {n for n, atom in enumerate(atoms) if atom.issuers & issuing} - chained
            chained |= above
        return chained

    def _signing(self) -> Iterator[str]:
        """Whether an enclave's key signs what others take, over whatever certificate of the tree."""
        atoms = self.system.certificates
        for trust_domain, mine in self._members():
            signing = self._trusted_signers(trust_domain) | set(trust_domain.permissions_ca)
            if not self.system.readings[trust_domain.reading].pins_signer:
                signing |= {n for n in self._below(trust_domain) if atoms[n].authority}
            keys = {atoms[n].key for n in signing}
            for atom in self.system.enclaves:
                certificate = None if atom.identity is None else self.held[atom.identity]
                if certificate is None:
                    continue
                self.seen["key that might sign"] += 1
                given = atoms[atom.identity].key in keys
                if self._differs(given, self.listing.can_sign(mine, certificate.key, self.way, self.at)):
                    yield f"the key of {certificate.subject} signs what {mine.folder.name} takes: {given}"

    # what documents say

    def _rights(self) -> Iterator[str]:
        s = self.system
        said: list[tuple[int, tuple[DomainRule, ...] | None, tuple[Grant, ...] | None]] = []
        for number, atom in enumerate(s.documents):
            content = self._content(number)
            if atom.opaque or not atom.intact or content is None:
                continue
            governance, permissions = self._read(content)
            said.append((number, governance, permissions))
        yield from self._grants(said)
        yield from self._domains(said)
        yield from self._decisions(said)

    def _read(self, content: bytes) -> tuple[tuple[DomainRule, ...] | None, tuple[Grant, ...] | None]:
        """What the implementation makes of a document: nothing where it refuses it."""
        governance, permissions = self.listing.says(content)
        ids = [ids for rule in governance or () for ids in rule.ids]
        ids += [ids for grant in permissions or () for rule in grant.rules for ids in rule.ids]
        highest = self.way.highest
        if highest is not None and any((bound or 0) > highest for pair in ids for bound in pair):
            return None, None
        opens = any(rule.flags[0] and rule.kinds[2] != "NONE" for rule in governance or ())
        if opens and self.way.refuses_open_rtps:
            return None, None
        return governance, permissions

    def _grants(self, said: Sequence[tuple[int, Any, tuple[Grant, ...] | None]]) -> Iterator[str]:
        s = self.system
        governed = {
            n
            for n, channel in enumerate(s.channels)
            if self._is_governed(said, channel.topic, s.domains[channel.domain].intervals[0][0])
        }
        for number, _governance, permissions in said:
            label = s.documents[number].label
            given = [n for n, grant in enumerate(s.grants) if grant.document == number]
            if len(given) != len(permissions or ()):
                yield f"{label} has {len(permissions or ())} grants, and {len(given)} are given"
                continue
            for place, grant in zip(given, permissions or (), strict=True):
                self.seen["grant"] += 1
                atom = s.grants[place]
                if atom.subject != grant.subject:
                    yield f"{label}: a grant for {grant.subject!r} is given for {atom.subject!r}"
                named = {n for n, c in enumerate(self.held) if c and names(grant.subject, c, self.way.subjects)}
                if named != {n for n in atom.names if self.held[n] is not None}:
                    told = sorted(c.subject for n in named ^ atom.names if (c := self.held[n]))
                    yield f"{label}: whether the grant for {grant.subject!r} names {told} differs"
                default = self.way.honours_default and grant.default == "ALLOW"
                if atom.default_allow is not default:
                    yield f"{label}: the default of {grant.subject!r} is given as {atom.default_allow}"
                for text, moment in ((grant.not_before, atom.not_before), (grant.not_after, atom.not_after)):
                    date = instant(text if self.way.reads_zone else text[:19], self.way.most_offset)
                    if date is not None and date != s.instants[moment]:
                        yield f"{label}: {text} is given as {s.instants[moment]}"
                yield from self._ordered(label, grant, place, governed)

    def _ordered(self, label: str, grant: Grant, number: int, governed: set[int]) -> Iterator[str]:
        """The rules one by one, for the specification; elsewhere one rule may be given as several."""
        if self.way.name != "spec":
            return
        given = [rule for rule in self.system.rules if rule.grant == number]
        kinds = [rule.allow for rule in given]
        if kinds != [rule.allow for rule in grant.rules]:
            yield f"{label}: the rules of {grant.subject!r} are given as {kinds}"
            return
        for atom, rule in zip(given, grant.rules, strict=True):
            self.seen["rule"] += 1
            own = {n for n, each in enumerate(self.system.domains) if covers(rule.ids, each.intervals[0][0], self.way)}
            if own != atom.domains:
                yield f"{label}: the domains {rule.ids} of a rule are given as {sorted(atom.domains)}"
            compared = {n for n in governed if self.system.channels[n].domain in own}
            for kind in ("publish", "subscribe", "relay"):
                listed = {
                    n
                    for n, channel in enumerate(self.system.channels)
                    if n in compared and lists(rule, kind, channel.topic, channel.partition, self.way)
                }
                if listed != getattr(atom, kind) & compared:
                    yield f"{label}: what a rule lists to {kind} is given otherwise"

    def _domains(self, said: Sequence[tuple[int, Any, Any]]) -> Iterator[str]:
        """Of a class of domains every one is alike to every rule."""
        for each in self.system.domains:
            for low, high in each.intervals:
                same = {self._ids(said, domain) for domain in (low, high, (low + high) // 2)}
                if len(same) > 1:
                    yield f"domains {low} to {high} are not alike"

    def _decisions(
        self, said: Sequence[tuple[int, tuple[DomainRule, ...] | None, tuple[Grant, ...] | None]]
    ) -> Iterator[str]:
        """By channel what every document decides; and of further names, whether there is a channel for them."""
        s, told = self.system, set()
        vectors = set()
        for number, channel in enumerate(s.channels):
            domain = s.domains[channel.domain].intervals[0][0]
            mine = self._mine(said, channel.topic, channel.partition, domain)
            if not self._is_governed(said, channel.topic, domain):
                continue
            given = self._given(said, number)
            vectors.add((channel.domain, mine))
            self.seen["channel"] += 1
            if len(mine) != len(given):
                yield "documents say other things"
                return
            for left, right in zip(mine, given, strict=True):
                if left != right and (left, right) not in told:
                    told.add((left, right))
                    yield f"{channel.topic!r} in {channel.partition!r}, domain {domain}: {left}, given {right}"
        for topic, partition in self._further(said):
            for number, domain in enumerate(s.domains):
                if not self._is_governed(said, topic, domain.intervals[0][0]):
                    continue
                self.seen["further name"] += 1
                mine = self._mine(said, topic, partition, domain.intervals[0][0])
                if (number, mine) not in vectors:
                    yield f"no channel stands for {topic!r} in {partition!r}, {domain.label}"

    def _ids(self, said: Iterable[tuple[int, Any, Any]], domain: int) -> tuple[bool, ...]:
        rules = [rule for _n, governance, _p in said for rule in governance or ()]
        rules += [rule for _n, _g, permissions in said for grant in permissions or () for rule in grant.rules]
        return tuple(covers(rule.ids, domain, self.way) for rule in rules)

    def _further(self, said: Iterable[tuple[int, Any, Any]]) -> list[tuple[str, str]]:
        topics, partitions = {"rt/never_named"}, {""}
        for _number, governance, permissions in said:
            topics |= {each.expression for rule in governance or () for each in rule.topic_rules}
            for grant in permissions or ():
                for criterion in (each for rule in grant.rules for each in rule.criteria):
                    topics |= {*criterion.topics}
                    partitions |= {*(criterion.partitions or ())}
        plain = [text.replace("*", "x").replace("?", "y") for text in sorted(topics) if "[" not in text]
        asked = [name for text in plain for name in (text, f"{text}z")]
        where = [text.replace("*", "x").replace("?", "y") for text in sorted(partitions) if "[" not in text]
        return [(topic, partition) for topic in asked for partition in where if topic][:NAMES_ASKED]

    def _is_governed(self, said: Iterable[tuple[int, Any, Any]], topic: str, domain: int) -> bool:
        """Whether some governance has rules for the topic: elsewhere nobody has any, and names are not told apart."""
        return any(g is not None and governs(g, topic, domain, self.way)[1] for _n, g, _p in said)

    def _mine(
        self, said: Iterable[tuple[int, Any, Any]], topic: str, partition: str, domain: int
    ) -> tuple[object, ...]:
        found: list[object] = []
        both = [governs(g, topic, domain, self.way)[1] for _n, g, _p in said if g is not None]
        ruled = [rule for rule in both if rule is not None]
        controlled = bool(ruled) and all(rule.flags[2] and rule.flags[3] for rule in ruled)
        for number, governance, permissions in said:
            for place, grant in enumerate(permissions or ()):
                for kind in ("publish", "subscribe"):
                    may = decides(grant, kind, topic, partition, domain, self.way)
                    may = may and (not controlled or has_topic(grant, topic, domain, self.way))
                    found.append((number, place, kind, may))
            if governance is not None:
                rule, topic_rule = governs(governance, topic, domain, self.way)
                found.append((number, rule and (rule.flags, rule.kinds)))
                found.append((number, topic_rule and rule and (topic_rule.flags, topic_rule.kinds)))
        return tuple(found)

    def _given(self, said: Iterable[tuple[int, Any, Any]], channel: int) -> tuple[object, ...]:
        s, found = self.system, []
        domain = s.channels[channel].domain
        for number, governance, _permissions in said:
            grants = [n for n, grant in enumerate(s.grants) if grant.document == number]
            for place, n in enumerate(grants):
                for kind in ("publish", "subscribe"):
                    rules = (r for r in s.rules if r.grant == n and domain in r.domains and channel in getattr(r, kind))
                    first = next(rules, None)
                    found.append((number, place, kind, first.allow if first else s.grants[n].default_allow))
            if governance is None:
                continue
            rules = ((n, r) for n, r in enumerate(s.domain_rules) if r.document == number and domain in r.domains)
            n, rule = next(rules, (None, None))
            topics = (t for t in s.topic_rules if t.domain_rule == n and channel in t.channels)
            topic = next(topics, None) if rule else None
            found.append((number, rule and _domain_said(rule)))
            found.append((number, topic and _topic_said(topic)))
        return tuple(found)

    # who is nobody's

    def _unmanaged(self) -> Iterator[str]:
        """Certificates of no enclave that a trust domain lets in: somebody there acts with that key and is named so."""
        s = self.system
        mine = self.listing.unmanaged
        for atom in s.enclaves:
            if atom.unmanaged and not atom.opaque and not atom.possible and atom.identity is not None:
                self.seen["unmanaged identity"] += 1
                certificate = self.held[atom.identity]
                own = {e.identity.sha256 for e in self.listing.enclaves if e.identity is not None}
                if certificate is not None and certificate.sha256 not in {*mine, *own}:
                    yield f"{certificate.subject} at {atom.location} is given as unmanaged"
        if self._must:
            return
        numbers = {trust_domain: n for n, trust_domain in reversed(list(enumerate(s.trust_domains)))}
        for trust_domain, enclave in self._members():
            for certificate in mine.values():
                if certificate.not_after < self.at or not self.listing.lets_in(enclave, certificate, self.way).certain:
                    continue
                there = [e for e in s.enclaves if e.trust_domain == numbers[trust_domain]]
                named = self._names_of(certificate)
                if not any(
                    e.opaque or (self._is(e, certificate) and named <= self._names_of(self.held[e.identity]))
                    for e in there
                ):
                    told = f"{certificate.subject} ({certificate.sha256[:6]})"
                    yield f"{told} may join {enclave.folder.name}, and is not given"

    def _is(self, atom: Any, certificate: Certificate) -> bool:
        held = None if atom.identity is None else self.held[atom.identity]
        return held is not None and held.key == certificate.key

    def _names_of(self, certificate: Certificate | None) -> set[str]:
        texts = {grant.subject for grant in self.system.grants}
        return {text for text in texts if certificate and names(text, certificate, self.way.subjects)}


def _domain_said(rule: Any) -> tuple[object, ...]:
    flags = (rule.allow_unauthenticated_participants, rule.enable_join_access_control)
    kinds = (rule.discovery_protection_kind, rule.liveliness_protection_kind, rule.rtps_protection_kind)
    return flags, tuple(kind.value for kind in kinds)


def _topic_said(rule: Any) -> tuple[object, ...]:
    flags = (rule.enable_discovery_protection, rule.enable_liveliness_protection)
    flags += (rule.enable_read_access_control, rule.enable_write_access_control)
    return flags, tuple(kind.value for kind in (rule.metadata_protection_kind, rule.data_protection_kind))
