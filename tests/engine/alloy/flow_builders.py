"""Keystores that differ by one change at a time, and claims about them."""

from __future__ import annotations

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.system import ParticipantKind
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    LISTENER_IDENTITY,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    TALKER_IDENTITY,
    TALKER_PERMISSIONS,
    Builder,
    healthy_builder,
)

THIRD = 2
"""An enclave that subscribes to what the listener passes on."""

FOURTH = 3


def chain() -> Builder:
    """The talker writes to the listener, and the listener to a third."""
    b = healthy_builder()
    identity = b.certificate([IDENTITY_CA], label="/third")
    document = b.document([PERMISSIONS_CA])
    b.enclave(0, identity, document, label="/third")
    b.rule(b.grant(document, [identity]), [0], subscribe=[OTHER_TOPIC])
    b.rule(1, [0], publish=[OTHER_TOPIC])
    return b


def claim(
    source: Place,
    target: Place,
    attacker: Attacker = Attacker.RELAYS,
    *,
    kind: ClaimKind = ClaimKind.NO_FLOW,
    through: tuple[int, ...] = (),
    left_out: tuple[int, ...] = (),
    until: int | None = None,
) -> ClaimAtom:
    return ClaimAtom(
        id="asked",
        kind=kind,
        attacker=attacker,
        source=source,
        target=target,
        through=frozenset(through),
        left_out=frozenset(left_out),
        until=until,
        location=Location(path="keystore-audit.toml", line=3),
    )


def starting(asked: ClaimAtom) -> ClaimAtom:
    """The same, where the talker's own implementation starts it in the domain, whatever peers say."""
    return replace(asked, starts=frozenset({(TALKER, 0)}))


def at(*enclaves: int) -> Place:
    return Place(enclaves=frozenset(enclaves))


def on_channel(*channels: int) -> Place:
    return Place(channels=frozenset(channels))


OUT = Place(outsider=True)


def elsewhere(issuers: list[int]) -> Builder:
    """The talker's document also grants its topic to somebody whose identity is on another robot."""
    b = chain()
    grant = b.grant(TALKER_PERMISSIONS, [b.certificate(issuers, label="/ghost")])
    b.rule(grant, [0], publish=[CHATTER])
    return b


def ghost_too(place: Place) -> Place:
    """The same, and whoever has the last certificate of `elsewhere`: it may be one of an enclave that is meant."""
    return replace(place, certificates=frozenset({len(chain().certificates)}))


def over(b: Builder) -> Builder:
    b.grants[-1] = replace(b.grants[-1], not_after=1)
    return b


def weak(**kinds: ProtectionKind) -> Builder:
    b = chain()
    rtps = kinds.pop("rtps", b.domain_rules[0].rtps_protection_kind)
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=rtps)
    b.topic_rules[0] = replace(b.topic_rules[0], **{f"{k}_protection_kind": v for k, v in kinds.items()})
    return b


def in_messages(b: Builder, metadata: ProtectionKind = ProtectionKind.NONE) -> Builder:
    """Payloads are protected with whole messages, and in submessages at most; every enclave here may read them."""
    none = ProtectionKind.NONE
    b.topic_rules[0] = replace(b.topic_rules[0], metadata_protection_kind=metadata, data_protection_kind=none)
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=ProtectionKind.ENCRYPT)
    return with_readers(b)


def reading(b: Builder) -> Builder:
    b.rule(len(b.grants) - 1, [0], subscribe=[OTHER_TOPIC])
    return b


def relaying(b: Builder) -> Builder:
    b.rule(len(b.grants) - 1, [0], relay=[OTHER_TOPIC])
    return b


def encrypted_from(attacker: Attacker, channel: int) -> ClaimAtom:
    return claim(Place(), on_channel(channel), attacker, kind=ClaimKind.ENCRYPTED)


def shut_out(**kinds: ProtectionKind) -> Builder:
    """The third's grant is out of date, so that peers let it into no domain."""
    b = weak(**kinds)
    b.grants[THIRD] = replace(b.grants[THIRD], not_after=1)
    return b


def with_readers(b: Builder) -> Builder:
    """Whoever joins may read everything."""
    for grant in (TALKER, LISTENER):
        b.rule(grant, [0], subscribe=[CHATTER, OTHER_TOPIC])
    return b


def unasked(b: Builder) -> Builder:
    """Nobody asks who joins for a grant to read."""
    b.topic_rules[0] = replace(b.topic_rules[0], enable_read_access_control=False)
    return b


def let_in(b: Builder) -> Builder:
    """Whoever has an identity joins."""
    b.domain_rules[0] = replace(b.domain_rules[0], enable_join_access_control=False)
    return b


def self_granting(b: Builder) -> Builder:
    """The talker's key is that of the permissions CA."""
    b.certificates[TALKER_IDENTITY] = replace(
        b.certificates[TALKER_IDENTITY], key=b.certificates[PERMISSIONS_CA].key, fit_to_sign=False
    )
    return b


def one_ca(b: Builder, *, pins_signer: bool = False) -> Builder:
    """One CA for both roles, and whoever it vouches for signs permissions, unless the signer is pinned."""
    b.pins_signer = pins_signer
    b.trust_domains[0] = replace(b.trust_domains[0], permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA}))
    return b


def below_one_ca(b: Builder) -> Builder:
    """The permissions CA issued the identity CA, and no identity here is fit to sign."""
    b.pins_signer = False
    b.certificates[IDENTITY_CA] = replace(b.certificates[IDENTITY_CA], issuers=frozenset({PERMISSIONS_CA}))
    for enclave in b.enclaves:
        if enclave.identity is not None:
            b.certificates[enclave.identity] = replace(b.certificates[enclave.identity], fit_to_sign=False)
    return b


def dates_bind_endpoints_alone(b: Builder) -> Builder:
    """Who has a grant that is over joins by it, and nobody asks writers for one."""
    b.joins_out_of_date = True
    b.topic_rules[0] = replace(b.topic_rules[0], enable_write_access_control=False)
    return b


def issuing(b: Builder, enclave: int) -> Builder:
    """The enclave's key is that of another authority in the identity CA's file."""
    identity = b.enclaves[enclave].identity
    assert identity is not None
    authority = b.certificate([IDENTITY_CA], authority=True)
    b.certificates[authority] = replace(b.certificates[authority], key=b.certificates[identity].key)
    b.trust_domains[0] = replace(b.trust_domains[0], identity_ca=frozenset({IDENTITY_CA, authority}))
    return b


def unknown(b: Builder, enclave: int) -> Builder:
    """No CA issued the enclave's own certificate."""
    identity = b.enclaves[enclave].identity
    assert identity is not None
    b.certificates[identity] = replace(b.certificates[identity], issuers=frozenset())
    return b


def unauthenticated(b: Builder) -> Builder:
    """Participants without an identity are let in."""
    b.domain_rules[0] = replace(b.domain_rules[0], allow_unauthenticated_participants=True)
    return b


def opaque_third() -> Builder:
    b = chain()
    b.may = True
    b.enclaves[THIRD] = replace(b.enclaves[THIRD], identity=None, kind=ParticipantKind.UNREAD)
    return b


def with_listeners_key(b: Builder) -> Builder:
    """A fourth, without rights, whose key is the listener's."""
    identity = b.certificate([IDENTITY_CA], key=b.certificates[LISTENER_IDENTITY].key)
    b.enclave(0, identity, b.document([PERMISSIONS_CA]))
    return b
