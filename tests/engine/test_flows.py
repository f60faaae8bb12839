"""Flows and claims against their definitions in docs/model.md, taken word by word over explicit sets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import pytest
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.attacker import RealmView
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Answer, Status
from keystore_audit.properties.result import Hop
from tests.engine.strangers_by_hand import published_elsewhere, read_elsewhere
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    Builder,
    healthy_builder,
    random_system,
    with_claims,
)

OUTSIDER = -1


class Definitions(Struct, dict=True):
    """What docs/model.md calls by these names, one set at a time; participants are indices, or OUTSIDER."""

    system: System

    def __post_init__(self) -> None:
        permissions = Permissions(self.system)
        self.everybody = range(len(self.system.enclaves))
        self.realms = range(len(self.system.realms))
        self.view = [RealmView(self.system, realm, permissions) for realm in self.realms]
        self.permissions = permissions

    def member(self, enclave: int) -> int:
        return self.system.enclaves[enclave].realm

    def able(self, what: str, enclave: int, realm: int) -> set[int]:
        return {*members(getattr(self.view[realm].abilities(enclave), what))}

    def honestly(self, what: str, enclave: int, realm: int) -> set[int]:
        return {*members(getattr(self.view[realm].honest(enclave), what))}

    def acts_as(self, enclave: int) -> set[int]:
        atoms = self.system.enclaves
        if atoms[enclave].opaque:
            return {*self.everybody}
        key = self.key(enclave)
        same = {e for e in self.everybody if key is not None and self.key(e) == key and not atoms[e].opaque}
        return {enclave} | same | {e for e in self.everybody if atoms[e].opaque}

    def key(self, enclave: int) -> int | None:
        identity = self.system.enclaves[enclave].identity
        return None if identity is None else self.system.certificates[identity].key

    def takes(self, enclave: int) -> set[int]:
        return self.honestly("may_read", enclave, self.member(enclave))

    def heeds(self, enclave: int) -> set[int]:
        """Of an attacker, who gives its keys to anybody."""
        return self.takes(enclave) | self.system.enclaves[enclave].reads_alone

    def hears(self, enclave: int) -> set[int]:
        """The same, if it attacks itself."""
        return self.able("may_read", enclave, self.member(enclave)) | self.heeds(enclave)

    def shows(self, enclave: int) -> set[int]:
        """To an attacker, who takes samples from anybody."""
        return self.able("may_write", enclave, self.member(enclave)) | self.system.enclaves[enclave].writes_alone

    def made(self, enclave: int, realm: int) -> set[int]:
        return self.able("may_write", enclave, realm) | self.able("forges", enclave, realm)

    def readable(self, realm: int) -> set[int]:
        p = self.view[realm].protection
        return {*members(p.governed)} - {*members(p.rtps_encrypts | p.metadata_encrypts | p.data_encrypts)}

    def injectable(self, realm: int) -> set[int]:
        p = self.view[realm].protection
        free = {c for c in members(p.governed) if p.unauthenticated >> self.system.channels[c].domain & 1}
        messages = {*members(p.rtps_authenticates)} - free
        return {*members(p.governed & ~(p.metadata_authenticates | p.data_authenticates))} - messages

    def sniffed(self, e: int) -> set[int]:
        """What anybody on the network reads of who is honest."""
        if e == OUTSIDER:
            return set()
        found = self.system.enclaves[e].writes_alone & self.readable(self.member(e))
        return found.union(*(self.honestly("may_write", e, realm) & self.readable(realm) for realm in self.realms))

    def attacking(self, e: int, realm: int) -> set[int]:
        """What is on the network of who attacks, as the realm protects it."""
        found = self.injectable(realm)
        for g in self.acts_as(e) if e != OUTSIDER else ():
            found = found | self.made(g, realm) | (self.shows(g) if self.member(g) == realm else set())
        return found

    def honest(self, e: int, f: int) -> set[int]:
        if f == OUTSIDER:
            return self.sniffed(e)
        if e == OUTSIDER:
            return set()
        there, here = self.member(f), self.member(e)
        return self.honestly("may_write", e, there) & self.takes(f) & self.honestly("may_read", f, here)

    def attacked(self, e: int, f: int) -> set[int]:
        """Hops under relays."""
        found = set()
        for realm in self.realms:
            sent = self.attacking(e, realm)
            found |= sent & self.readable(realm)
            for g in self.acts_as(f) if f != OUTSIDER else ():
                found |= sent & self.able("knows", g, realm)
                if self.member(g) == realm:
                    found |= self.forced(e, realm) & self.hears(g)
        return found

    def forced(self, e: int, realm: int) -> set[int]:
        """What honest members of the realm take of who attacks, if they read it."""
        made = (self.made(g, realm) for g in (self.acts_as(e) if e != OUTSIDER else ()))
        return self.injectable(realm).union(*made)

    def hop(self, claim: ClaimAtom, e: int, f: int) -> set[int]:
        if e == f:
            return set()
        if claim.attacker is Attacker.RELAYS:
            found = self.attacked(e, f)
        else:
            found = self.honest(e, f)
            attacking = claim.source.outsider if e == OUTSIDER else e in claim.source.enclaves
            if claim.attacker is Attacker.SOURCE and attacking:
                if f == OUTSIDER:
                    for realm in self.realms:
                        found = found | (self.attacking(e, realm) & self.readable(realm))
                else:
                    found = found | (self.forced(e, self.member(f)) & self.heeds(f))
        return found - claim.left_out

    def got(self, claim: ClaimAtom, f: int) -> set[int]:
        readable = {c for realm in self.realms for c in self.readable(realm)}
        if f == OUTSIDER:
            return readable
        if claim.attacker is not Attacker.RELAYS:
            return self.takes(f)
        found = readable
        for g in self.acts_as(f):
            found |= self.hears(g)
            for realm in self.realms:
                found |= self.able("knows", g, realm)
        return found

    def put(self, claim: ClaimAtom, e: int) -> set[int]:
        attacking = claim.attacker is Attacker.RELAYS
        if claim.attacker is Attacker.SOURCE:
            attacking = claim.source.outsider if e == OUTSIDER else e in claim.source.enclaves
        found = {c for realm in self.realms for c in self.injectable(realm)} if attacking else set()
        if e == OUTSIDER:
            return found
        found |= {c for realm in self.realms for c in self.honestly("may_write", e, realm)}
        for g in self.acts_as(e) if attacking else ():
            if claim.attacker is Attacker.RELAYS:
                found |= self.shows(g)
            for realm in self.realms:
                found |= self.made(g, realm)
        return found

    def shortest(self, claim: ClaimAtom) -> int | None:
        """The number of hops of a shortest flow: every walk, one hop longer each time."""
        people = [*self.everybody, OUTSIDER]
        ends = claim.target.enclaves | ({OUTSIDER} if claim.target.outsider else set())
        begins = claim.source.enclaves | ({OUTSIDER} if claim.source.outsider else set())
        at, length = set(begins), 0
        if claim.source.channels:
            at, length = {f for f in people if self.got(claim, f) & claim.source.channels}, 1
            if at & ends:
                return 1
            at -= claim.through
        for more in range(len(people) + 2):
            if any(self.put(claim, e) & claim.target.channels for e in at):
                return length + more + 1
            after = {f for e in at for f in people if self.hop(claim, e, f)}
            if after & ends:
                return length + more + 1
            at = after - (claim.through - begins)
        return None


def violated(definitions: Definitions, claim: ClaimAtom) -> bool:
    """What docs/model.md says of the kinds without flows."""
    d = definitions
    channels = claim.target.channels
    pairs = [(r, e) for r in d.realms for e in d.everybody]
    if claim.kind is ClaimKind.ONLY_PUBLISH:
        return any(
            (d.able("may_write", e, r) | granted(d, r, e)) & channels
            for r, e in pairs
            if e not in claim.source.enclaves
        ) or any(
            published_elsewhere(d.system, d.view[r], d.permissions, r, claim.source.certificates) & channels
            for r in d.realms
        )
    if claim.kind is ClaimKind.ENCRYPTED and claim.attacker is Attacker.OUTSIDER:
        return any(d.readable(r) & channels for r in d.realms)
    if claim.kind is ClaimKind.ENCRYPTED:
        return any((learnt(d, e, r) - entitled(d, e, r)) & channels for r, e in pairs) or any(
            read_elsewhere(d.system, d.view[r], d.permissions, r) & channels for r in d.realms
        )
    assert claim.kind is ClaimKind.SEPARATE_DOMAINS

    def there(realm: int, enclave: int) -> set[int]:
        return {*members(d.view[realm].joined(enclave) | d.view[realm].protection.unauthenticated)}

    def starting(enclave: int) -> set[int]:
        return {domain for each, domain in claim.starts if each == enclave}

    return any(
        there(r, one) & (there(r, other) | starting(other))
        for r in d.realms
        for a in claim.source.enclaves
        for b in claim.target.enclaves
        for one, other in ((a, b), (b, a))
    )


def learnt(d: Definitions, enclave: int, realm: int) -> set[int]:
    """What it reads in the realm as anybody whose key it has, or as anybody can."""
    return d.readable(realm).union(*(d.able("knows", each, realm) for each in d.acts_as(enclave)))


def entitled(d: Definitions, enclave: int, realm: int) -> set[int]:
    """What it reads by a grant of the permissions CA, or may, where something could not be read."""
    read = d.able("may_read", enclave, realm)
    if d.system.enclaves[enclave].opaque or any(document.opaque for document in d.system.documents):
        return read
    return read & {*members(d.view[realm].granted(enclave, Operation.SUBSCRIBE))}


def granted(d: Definitions, realm: int, enclave: int) -> set[int]:
    """Channels that it is granted to publish, governed, of domains that it joins."""
    view = d.view[realm]
    joined = {c for c in members(view.protection.governed) if view.joined(enclave) >> d.system.channels[c].domain & 1}
    return joined & {*members(view.granted(enclave, Operation.PUBLISH))}


def cases(seeds: Iterable[int]) -> Iterator[System]:
    for seed in seeds:
        yield with_claims(random_system(seed), seed, 12)


@pytest.mark.parametrize("start", range(0, 400, 50))
def test_claims_against_their_definitions(start: int) -> None:
    told = {True: 0, False: 0}
    for system in cases(range(start, start + 50)):
        definitions = Definitions(system)
        answers = NativeEngine([system]).answers[0]
        for claim in (replace(claim, until=None) for claim in system.claims):
            if claim.kind is ClaimKind.ABLE:
                continue
            answer = answers[claim.id] if claim in system.claims else _now(system, claim)
            if claim.kind is ClaimKind.NO_FLOW:
                expected = definitions.shortest(claim)
                assert len(answer.path) == (expected or 0), claim
                _check_path(definitions, claim, answer.path)
                bad = expected is not None
            else:
                bad = violated(definitions, claim)
            assert (answer.status is Status.VIOLATED) == bad, claim
            assert bool(answer.witnesses) == bad
            told[bad] += 1
    assert min(told.values()) > 20


def _now(system: System, claim: ClaimAtom) -> Answer:
    return NativeEngine([replace(system, claims=(claim,))]).answers[0][claim.id]


def _check_path(definitions: Definitions, claim: ClaimAtom, path: Sequence[Hop]) -> None:
    """Each hop is one, and each begins where the one before ended."""
    for number, hop in enumerate(path):
        if number:
            assert hop.sender == path[number - 1].receiver
        sender = OUTSIDER if hop.sender is None else hop.sender
        receiver = OUTSIDER if hop.receiver is None else hop.receiver
        if number == 0 and claim.source.channels:
            assert hop.channel in claim.source.channels & definitions.got(claim, receiver)
        elif number == len(path) - 1 and claim.target.channels:
            assert hop.channel in claim.target.channels & definitions.put(claim, sender)
        else:
            assert hop.channel in definitions.hop(claim, sender, receiver)
            if number:
                assert sender not in claim.through - claim.source.enclaves


def _claim(kind: ClaimKind, attacker: Attacker, **fields: object) -> ClaimAtom:
    usual = {
        "source": Place(enclaves=frozenset({TALKER})),
        "target": Place(enclaves=frozenset({LISTENER})),
        "through": frozenset(),
        "left_out": frozenset(),
        "until": None,
        "location": Location(path="keystore-audit.toml", line=1),
    }
    return ClaimAtom(id="claim", kind=kind, attacker=attacker, **{**usual, **fields})  # type: ignore[arg-type]


@pytest.mark.parametrize("attacker", [Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS])
def test_a_reader_forges_back_only_where_it_attacks(attacker: Attacker) -> None:
    b = healthy_builder()
    b.topic_rules[0] = replace(b.topic_rules[0], metadata_protection_kind=ProtectionKind.ENCRYPT)
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=ProtectionKind.SIGN)
    b.rule(0, [0], subscribe=[CHATTER])
    there = _claim(ClaimKind.NO_FLOW, attacker)
    back = _claim(ClaimKind.NO_FLOW, attacker, source=there.target, target=there.source)
    assert _now(b.system(), there).status is Status.VIOLATED
    assert (_now(b.system(), back).status is Status.VIOLATED) == (attacker is not Attacker.HONEST)


def test_a_right_that_begins_later_violates_only_what_must_hold_until_then() -> None:
    b = healthy_builder()
    narrow = replace(b.grants[1], not_after=2)
    b.grants[1] = narrow
    wide = b.grant(2, narrow.names)
    b.rule(wide, [0], publish=[OTHER_TOPIC])
    b.grants[0] = replace(b.grants[0], not_after=4)
    b.rule(0, [0], subscribe=[OTHER_TOPIC])
    back = _claim(
        ClaimKind.NO_FLOW,
        Attacker.HONEST,
        source=Place(enclaves=frozenset({LISTENER})),
        target=Place(enclaves=frozenset({TALKER})),
    )
    assert _now(b.system(), back).status is Status.HOLDS
    assert _now(b.system(), replace(back, until=2)).status is Status.HOLDS
    later = _now(b.system(), replace(back, until=3))
    assert (later.status, later.moment, later.path[0].instant) == (Status.VIOLATED, 5, 2)


def test_able_rests_on_an_enclaves_own_document() -> None:
    b = healthy_builder()
    able = _claim(ClaimKind.ABLE, Attacker.HONEST)
    assert _now(b.system(), able).status is Status.HOLDS
    b.enclaves[TALKER] = replace(b.enclaves[TALKER], permissions=None)
    other = _claim(ClaimKind.NO_FLOW, Attacker.HONEST)
    assert _now(b.system(), able).status is Status.VIOLATED
    assert _now(b.system(), other).status is Status.VIOLATED  # it may present the document all the same


FLOWING = (Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS)


def in_two_realms(own: dict[str, Any], other: dict[str, Any], apart: int) -> Builder:
    """The enclave `apart` is in a realm of its own with the flags `own`, the other one in one with `other`."""
    b = healthy_builder()
    b.topic_rules[0] = replace(b.topic_rules[0], **other)
    governance = b.document([PERMISSIONS_CA], label="other governance")
    b.topic_rule(b.domain_rule(governance, [0]), [CHATTER, OTHER_TOPIC], **own)
    b.enclaves[apart] = replace(b.enclaves[apart], realm=b.realm([IDENTITY_CA], [PERMISSIONS_CA], governance))
    return b


def test_an_attacker_reads_what_the_realm_of_the_writer_lets_it_whatever_its_own_says() -> None:
    """Read access control is on where the listener is and off where the talker is: its own refuses an honest one."""
    b = in_two_realms({}, {"enable_read_access_control": False}, LISTENER)
    b.rules[1] = replace(b.rules[1], subscribe=frozenset())
    found = {each: _now(b.system(), _claim(ClaimKind.NO_FLOW, each)).status for each in FLOWING}
    assert found == dict(zip(FLOWING, (Status.HOLDS, Status.HOLDS, Status.VIOLATED), strict=True))
    b.topic_rules[0] = replace(b.topic_rules[0], enable_read_access_control=True)
    assert _now(b.system(), _claim(ClaimKind.NO_FLOW, Attacker.RELAYS)).status is Status.HOLDS


def test_able_asks_the_writers_own_realm_too() -> None:
    """Without a grant it does not create the writer, although the reader's realm would not ask for one."""
    b = in_two_realms({}, {"enable_write_access_control": False}, TALKER)
    able = _claim(ClaimKind.ABLE, Attacker.HONEST)
    onto = replace(able, target=Place(channels=frozenset({CHATTER})))
    assert [_now(b.system(), each).status for each in (able, onto)] == [Status.HOLDS] * 2
    b.rules[0] = replace(b.rules[0], publish=frozenset())
    assert [_now(b.system(), each).status for each in (able, onto)] == [Status.VIOLATED] * 2


def test_an_opaque_enclave_on_the_way_may_carry_anything() -> None:
    b = healthy_builder()
    b.may = True
    claim = _claim(
        ClaimKind.NO_FLOW, Attacker.HONEST, source=Place(enclaves=frozenset({LISTENER})),
        target=Place(enclaves=frozenset({TALKER})),
    )  # fmt: skip
    assert _now(b.system(), claim).status is Status.HOLDS
    b.enclave(0, None, None, opaque=True)
    assert _now(b.system(), replace(claim, attacker=Attacker.RELAYS)).status is Status.VIOLATED
