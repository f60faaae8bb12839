"""Questions about flows and claims whose answers are known: keystores that differ by one change at a time."""

from __future__ import annotations

from typing import NamedTuple

from msgspec.structs import replace

from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from tests.engine.alloy.flow_builders import (
    FOURTH,
    OUT,
    THIRD,
    at,
    below_one_ca,
    chain,
    claim,
    dates_bind_endpoints_alone,
    elsewhere,
    encrypted_from,
    ghost_too,
    in_messages,
    issuing,
    let_in,
    on_channel,
    one_ca,
    opaque_third,
    over,
    reading,
    relaying,
    self_granting,
    shut_out,
    starting,
    unasked,
    unauthenticated,
    unknown,
    weak,
    with_listeners_key,
    with_readers,
)
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    IDENTITY_CA,
    LISTENER,
    LISTENER_PERMISSIONS,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    TALKER_IDENTITY,
    Builder,
)


class Question(NamedTuple):
    """A keystore, a claim about it, and whether the claim is violated. `name`: of those that are asked for by name."""

    builder: Builder
    claim: ClaimAtom
    violated: bool
    name: str = ""


def questions() -> list[Question]:
    """One change flips each answer; the base is a chain from talker over listener to a third."""
    none, sign = ProtectionKind.NONE, ProtectionKind.SIGN

    def with_second_reader(b: Builder) -> Builder:
        b.rule(0, [0], subscribe=[OTHER_TOPIC])
        return b

    def one_key() -> Builder:
        b = chain()
        key = b.certificates[TALKER_IDENTITY].key
        b.certificates[-1] = replace(b.certificates[-1], key=key)
        return b

    def expired() -> Builder:
        b = chain()
        b.grants[0] = replace(b.grants[0], not_after=1)
        return b

    def two_trust_domains() -> Builder:
        """The listener's document counts in its own trust domain only, the talker's in both."""
        b = chain()
        authority = b.certificate(authority=True)
        b.trust_domain([IDENTITY_CA], [PERMISSIONS_CA, authority], GOVERNANCE)
        b.enclaves[LISTENER] = replace(b.enclaves[LISTENER], trust_domain=1)
        b.documents[LISTENER_PERMISSIONS] = replace(b.documents[LISTENER_PERMISSIONS], signers=frozenset({authority}))
        return b

    def unasked_writers() -> Builder:
        b = chain()
        b.topic_rules[0] = replace(b.topic_rules[0], enable_write_access_control=False)
        return b

    def in_the_document_of_another() -> Builder:
        b = chain()
        b.grants[0] = replace(b.grants[0], document=LISTENER_PERMISSIONS)
        return b

    def stubborn() -> Builder:
        """The talker's own implementation lets it read what peers do not let it read."""
        b = chain()
        b.enclaves[TALKER] = replace(b.enclaves[TALKER], reads_alone=frozenset({OTHER_TOPIC}))
        return b

    def silent(b: Builder) -> Builder:
        """Nobody publishes by right."""
        b.rules[:] = [replace(rule, publish=frozenset()) for rule in b.rules]
        return b

    def wilful(b: Builder) -> Builder:
        """The third's own implementation lets it write what peers do not take from it."""
        b.enclaves[THIRD] = replace(b.enclaves[THIRD], writes_alone=frozenset({CHATTER}))
        return b

    def denied(**facts: set[int]) -> Builder:
        """The listener's own implementation refuses it what its peers would take."""
        b = chain()
        b.enclaves[LISTENER] = replace(b.enclaves[LISTENER], **{name: frozenset(each) for name, each in facts.items()})
        return b

    honest, source, relays = Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS
    outsider, encrypted = Attacker.OUTSIDER, ClaimKind.ENCRYPTED
    clear = {"rtps": sign, "metadata": sign, "data": none}
    open_to_all = {"rtps": none, "metadata": none, "data": none}
    shared = {"rtps": ProtectionKind.ENCRYPT, "metadata": ProtectionKind.ENCRYPT}
    table: list[tuple[Builder, ClaimAtom, bool] | tuple[Builder, ClaimAtom, bool, str]] = [
        (chain(), claim(at(TALKER), at(THIRD)), True, "over a relay"),
        (chain(), claim(at(TALKER), at(THIRD), honest), True, "over an honest relay"),
        (chain(), claim(at(TALKER), at(THIRD), through=(LISTENER,)), False, "past a trusted relay"),
        (chain(), claim(at(TALKER), at(THIRD), through=(TALKER, THIRD)), True),
        (chain(), claim(at(TALKER), at(THIRD), left_out=(CHATTER,)), False, "over what is left out"),
        (chain(), claim(at(THIRD), at(TALKER)), False),
        (expired(), claim(at(TALKER), at(THIRD)), False),
        # readers that hold the writer's keys write back where they are taken for it
        (weak(**shared), claim(at(THIRD), at(TALKER)), False),
        (with_second_reader(weak(**shared)), claim(at(THIRD), at(TALKER)), True, "a reader writes back"),
        (with_second_reader(weak(**shared)), claim(at(THIRD), at(TALKER), source), True, "the source writes back"),
        (with_second_reader(weak(**shared)), claim(at(THIRD), at(TALKER), honest), False),
        (with_second_reader(chain()), claim(at(THIRD), at(TALKER)), False),
        # packets whose payload every member of the domain can open
        (
            weak(metadata=sign, data=none),
            claim(at(TALKER), at(THIRD), left_out=(OTHER_TOPIC,)),
            True,
            "packets that members open",
        ),
        (weak(metadata=sign, data=none), claim(at(TALKER), at(THIRD), honest, left_out=(OTHER_TOPIC,)), False),
        # trust domains that trust differently
        (two_trust_domains(), claim(at(TALKER), at(LISTENER), honest), False, "a trust domain that trusts less"),
        (two_trust_domains(), claim(at(TALKER), at(LISTENER), source), True),
        # channels as places
        (chain(), claim(on_channel(CHATTER), on_channel(OTHER_TOPIC)), True, "channel to channel"),
        (chain(), claim(on_channel(CHATTER), at(THIRD), through=(LISTENER,)), False),
        (chain(), claim(on_channel(CHATTER), at(LISTENER), through=(LISTENER,)), True, "the end is trusted"),
        (chain(), claim(at(TALKER), on_channel(OTHER_TOPIC), through=(LISTENER,)), False),
        (chain(), claim(at(LISTENER), on_channel(OTHER_TOPIC), through=(LISTENER,)), True),
        (chain(), claim(on_channel(CHATTER), on_channel(OTHER_TOPIC), left_out=(CHATTER, OTHER_TOPIC)), True),
        # the outsider
        (chain(), claim(at(TALKER), OUT), False, "to the outsider"),
        (weak(rtps=none, metadata=sign, data=none), claim(at(TALKER), OUT), True, "to the outsider, in clear"),
        (weak(rtps=none, metadata=sign, data=none), claim(at(TALKER), OUT, honest), True),
        (weak(rtps=none, metadata=none, data=none), claim(OUT, at(THIRD)), True, "from the outsider"),
        (weak(rtps=none, metadata=none, data=none), claim(OUT, at(THIRD), source), True),
        (weak(rtps=none, metadata=none, data=none), claim(OUT, at(THIRD), honest), False),
        (weak(rtps=sign, metadata=none, data=none), claim(OUT, at(THIRD)), False, "from the outsider, signed"),
        # keys of two enclaves
        (chain(), claim(at(TALKER), at(THIRD), left_out=(OTHER_TOPIC,)), False),
        (one_key(), claim(at(LISTENER), at(TALKER), relays), True, "one key, against the flow"),
        (one_key(), claim(at(LISTENER), at(TALKER), source), False),
        (one_key(), claim(at(THIRD), at(LISTENER), source), True, "one key, at the source"),
        # the other kinds
        (chain(), claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE), False),
        (expired(), claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE), True),
        (in_the_document_of_another(), claim(at(TALKER), at(LISTENER), honest), True),
        (
            in_the_document_of_another(),
            claim(at(TALKER), at(LISTENER), honest, kind=ClaimKind.ABLE),
            True,
            "able by what another holds",
        ),
        (
            unasked_writers(),
            claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            True,
            "writers whom nobody asks",
        ),
        (chain(), claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), False),
        (chain(), claim(at(THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), True),
        # who is no enclave here, with a grant, and who needs no identity
        (elsewhere([IDENTITY_CA]), claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), True),
        (elsewhere([IDENTITY_CA]), claim(at(LISTENER), on_channel(OTHER_TOPIC), kind=ClaimKind.ONLY_PUBLISH), False),
        (
            elsewhere([IDENTITY_CA]),
            claim(ghost_too(at(TALKER)), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            False,
        ),
        (elsewhere([]), claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), False),
        (over(elsewhere([IDENTITY_CA])), claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), False),
        (
            dates_bind_endpoints_alone(over(elsewhere([IDENTITY_CA]))),
            claim(at(TALKER, LISTENER, THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            True,
            "let in by a grant that is over",
        ),
        (
            dates_bind_endpoints_alone(elsewhere([])),
            claim(at(TALKER, LISTENER, THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            False,
        ),
        # whoever has an identity of the CA signs itself any right, where it is one for permissions too
        (
            one_ca(chain()),
            claim(at(TALKER, LISTENER, THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            True,
            "published by a grant that others of the CA sign",
        ),
        (
            one_ca(chain(), pins_signer=True),
            claim(at(TALKER, LISTENER, THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            False,
            "one CA, and its signer pinned",
        ),
        (
            below_one_ca(chain()),
            claim(at(TALKER, LISTENER, THIRD), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            True,
            "published by a grant that others below the CA sign",
        ),
        (one_ca(with_readers(chain())), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), True, "read by signing a grant"),
        (one_ca(with_readers(chain()), pins_signer=True), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (
            unauthenticated(weak(metadata=none, data=none)),
            claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            True,
        ),
        (
            unauthenticated(weak(metadata=none, data=sign)),
            claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            False,
        ),
        (
            weak(rtps=none, metadata=none, data=none),
            claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH),
            False,
        ),
        (chain(), claim(Place(), on_channel(CHATTER), Attacker.OUTSIDER, kind=ClaimKind.ENCRYPTED), False),
        (weak(rtps=sign, data=none), claim(Place(), on_channel(0), Attacker.INSIDER, kind=ClaimKind.ENCRYPTED), False),
        (
            weak(metadata=sign, data=none),
            claim(Place(), on_channel(CHATTER), Attacker.INSIDER, kind=ClaimKind.ENCRYPTED),
            True,
        ),
        (
            weak(rtps=sign, metadata=sign, data=none),
            claim(Place(), on_channel(CHATTER), Attacker.OUTSIDER, kind=ClaimKind.ENCRYPTED),
            True,
        ),
        (chain(), claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS), True),
        (expired(), claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS), False),
        # readers that honest peers refuse
        (chain(), claim(at(LISTENER), at(TALKER), source), False),
        (stubborn(), claim(at(LISTENER), at(TALKER), source), True, "a stubborn reader, lured"),
        (stubborn(), claim(at(LISTENER), at(TALKER), honest), False, "a stubborn reader, honestly"),
        # writers that honest peers refuse
        (chain(), claim(at(THIRD), at(LISTENER)), False),
        (wilful(chain()), claim(at(THIRD), at(LISTENER)), True, "a wilful writer"),
        (wilful(chain()), claim(at(THIRD), at(LISTENER), source), False),
        (wilful(chain()), claim(at(THIRD), at(LISTENER), honest), False),
        (chain(), claim(at(THIRD), on_channel(CHATTER)), False),
        (wilful(chain()), claim(at(THIRD), on_channel(CHATTER)), True, "a wilful writer, to a channel"),
        (wilful(chain()), claim(at(THIRD), on_channel(CHATTER), source), False, "a wilful writer among the honest"),
        (wilful(chain()), claim(at(TALKER), on_channel(CHATTER), kind=ClaimKind.ONLY_PUBLISH), False),
        (wilful(silent(weak(**clear))), claim(at(THIRD), OUT, left_out=(OTHER_TOPIC,)), True),
        (silent(weak(**clear)), claim(at(THIRD), OUT, left_out=(OTHER_TOPIC,)), False),
        (wilful(silent(weak(**clear))), claim(Place(), on_channel(CHATTER), outsider, kind=encrypted), True),
        (
            silent(weak(**clear)),
            claim(Place(), on_channel(CHATTER), outsider, kind=encrypted),
            True,
            "written by nobody",
        ),
        (silent(weak(**{**clear, "metadata": ProtectionKind.ENCRYPT})), encrypted_from(outsider, CHATTER), False),
        # who is no enclave here, and is let in by a grant, reads what is in messages that all members open
        (with_readers(elsewhere([IDENTITY_CA])), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (in_messages(elsewhere([])), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (in_messages(elsewhere([IDENTITY_CA])), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), True, "read elsewhere"),
        (
            in_messages(reading(elsewhere([IDENTITY_CA]))),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            False,
            "read elsewhere, by right",
        ),
        (in_messages(over(elsewhere([IDENTITY_CA]))), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (
            in_messages(relaying(elsewhere([IDENTITY_CA])), metadata=ProtectionKind.ENCRYPT),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            True,
            "relayed elsewhere",
        ),
        (
            in_messages(elsewhere([IDENTITY_CA]), metadata=ProtectionKind.ENCRYPT),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            False,
        ),
        # that nobody asks for a grant entitles nobody to read: those here, those whom a grant names, and any others
        (unasked(chain()), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), True, "read without a grant"),
        (self_granting(chain()), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), True, "read by a grant of its own"),
        (self_granting(with_readers(chain())), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (unasked(with_readers(chain())), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (let_in(with_readers(chain())), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (
            let_in(unasked(with_readers(chain()))),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            True,
            "read by others of the CA",
        ),
        (in_messages(chain()), encrypted_from(Attacker.INSIDER, OTHER_TOPIC), False),
        (
            let_in(in_messages(chain())),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            True,
            "overheard by others of the CA",
        ),
        (
            unasked(with_readers(elsewhere([IDENTITY_CA]))),
            encrypted_from(Attacker.INSIDER, OTHER_TOPIC),
            True,
            "read elsewhere without a grant",
        ),
        # who attacks gets samples of a channel that its own implementation alone lets it read
        (stubborn(), claim(on_channel(OTHER_TOPIC), at(TALKER)), True, "a stubborn reader of a channel"),
        (stubborn(), claim(on_channel(OTHER_TOPIC), at(TALKER), source), False, "a stubborn reader, the source alone"),
        (chain(), claim(on_channel(OTHER_TOPIC), at(TALKER)), False),
        # who has the key of an identity CA is whomever a grant names
        (issuing(chain(), TALKER), claim(at(LISTENER), at(TALKER)), True, "issued to itself"),
        (issuing(chain(), TALKER), claim(at(LISTENER), at(TALKER), source), False),
        # who attacks nobody does neither that, nor sign itself a right
        (
            self_granting(chain()),
            claim(at(LISTENER), at(TALKER), honest),
            False,
            "a reader that could sign itself a right",
        ),
        (self_granting(chain()), claim(at(LISTENER), at(TALKER)), True),
        (
            self_granting(chain()),
            claim(at(TALKER), at(THIRD), honest, left_out=(CHATTER,)),
            False,
            "a writer that could sign itself a right",
        ),
        (self_granting(chain()), claim(at(TALKER), at(THIRD), source, left_out=(CHATTER,)), True),
        (
            self_granting(chain()),
            claim(at(TALKER), at(LISTENER), honest),
            True,
            "a writer that could sign itself a right, and has it",
        ),
        (
            issuing(unknown(chain(), TALKER), TALKER),
            claim(at(TALKER), at(LISTENER), honest),
            False,
            "a writer that could issue itself an identity",
        ),
        (issuing(chain(), LISTENER), claim(at(THIRD), at(TALKER), source), False),
        (shut_out(), claim(at(TALKER), at(THIRD)), False),
        (issuing(shut_out(), THIRD), claim(at(TALKER), at(THIRD)), True, "issued to itself, let in as another"),
        (unknown(chain(), THIRD), claim(at(TALKER), at(THIRD)), False),
        (
            issuing(unknown(chain(), THIRD), THIRD),
            claim(at(TALKER), at(THIRD)),
            True,
            "issued to itself, unknown itself",
        ),
        # participants that honest peers refuse
        (expired(), starting(claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS)), True),
        (expired(), starting(claim(at(THIRD), at(TALKER), kind=ClaimKind.SEPARATE_DOMAINS)), True),
        (expired(), starting(claim(at(TALKER), at(TALKER), kind=ClaimKind.SEPARATE_DOMAINS)), False),
        # endpoints that an enclave's own implementation refuses it
        (
            denied(refused_reads={CHATTER}),
            claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE),
            True,
            "able, a reader refused",
        ),
        (denied(refused_writes={CHATTER}), claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE), False),
        (
            denied(refused_writes={OTHER_TOPIC}),
            claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE),
            True,
            "able, a writer refused",
        ),
        (denied(refused_reads={OTHER_TOPIC}), claim(at(TALKER), at(THIRD), honest, kind=ClaimKind.ABLE), False),
        (denied(refused_reads={CHATTER}), claim(at(TALKER), at(THIRD), honest), True),
        # whoever is on the network listens, whoever attacks
        (weak(rtps=none, metadata=sign, data=none), claim(at(TALKER), OUT, source), True),
        (weak(rtps=none, data=none), claim(at(TALKER), OUT, honest), False),
        (weak(rtps=none, metadata=sign, data=none), claim(on_channel(CHATTER), OUT, honest), True),
        (weak(rtps=none, data=none), claim(on_channel(CHATTER), OUT, honest), False),
        # whose identity could not be read may have the key of anybody
        (opaque_third(), claim(at(LISTENER), at(TALKER), through=(THIRD,)), True, "one that may be anybody"),
        (chain(), claim(at(LISTENER), at(TALKER), through=(THIRD,)), False),
        # who has a reader's key reads what nobody takes
        (
            with_listeners_key(wilful(chain())),
            claim(at(THIRD), at(FOURTH), through=(LISTENER,)),
            True,
            "heard with another's key",
        ),
        (with_listeners_key(chain()), claim(at(THIRD), at(FOURTH), through=(LISTENER,)), False),
        # what is forged is on the network too
        (silent(weak(**clear)), claim(at(THIRD), OUT), True, "forged, and heard"),
        (silent(weak(**clear)), claim(at(THIRD), OUT, source), True),
        (silent(weak(**clear)), claim(at(THIRD), OUT, honest), False),
        # an enclave that peers let into no domain does what anybody does who is on the network
        (shut_out(**open_to_all), claim(at(THIRD), at(LISTENER)), True, "let in nowhere, forging"),
        (shut_out(**open_to_all), claim(at(THIRD), at(LISTENER), source), True),
        (shut_out(**open_to_all), claim(at(THIRD), at(LISTENER), honest), False),
        (shut_out(**{**open_to_all, "rtps": sign}), claim(at(THIRD), at(LISTENER)), False),
        (shut_out(**open_to_all), claim(at(THIRD), on_channel(CHATTER), source), True, "let in nowhere, putting"),
        (shut_out(**open_to_all), claim(at(THIRD), on_channel(CHATTER), honest), False),
        (shut_out(**{**open_to_all, "rtps": sign}), claim(at(THIRD), on_channel(CHATTER)), False),
        (shut_out(**clear), claim(at(TALKER), at(THIRD)), True, "let in nowhere, hearing"),
        (shut_out(**clear), claim(at(TALKER), at(THIRD), source), False),
        (shut_out(**{**clear, "rtps": ProtectionKind.ENCRYPT}), claim(at(TALKER), at(THIRD)), False),
        (shut_out(**clear), claim(on_channel(CHATTER), at(THIRD)), True),
        (shut_out(**clear), claim(on_channel(CHATTER), at(THIRD), source), False),
        (
            with_readers(shut_out(**clear)),
            claim(Place(), on_channel(CHATTER), Attacker.INSIDER, kind=encrypted),
            True,
            "let in nowhere, reading",
        ),
        (
            with_readers(shut_out(**{**clear, "rtps": ProtectionKind.ENCRYPT})),
            claim(Place(), on_channel(CHATTER), Attacker.INSIDER, kind=encrypted),
            False,
        ),
        # who has a reader's key reads as that one
        (chain(), claim(Place(), on_channel(OTHER_TOPIC), Attacker.INSIDER, kind=encrypted), False),
        (
            one_key(),
            claim(Place(), on_channel(OTHER_TOPIC), Attacker.INSIDER, kind=encrypted),
            True,
            "read by another's key",
        ),
        (
            unauthenticated(shut_out()),
            claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS),
            True,
            "apart, without identities",
        ),
        (unauthenticated(shut_out()), claim(at(THIRD), at(TALKER), kind=ClaimKind.SEPARATE_DOMAINS), True),
        (shut_out(), claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS), False),
    ]
    return [Question(*row) for row in table]
