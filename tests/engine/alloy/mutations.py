"""Single changes to a healthy system, and the properties that each of them breaks: exactly these."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from keystore_audit.assumptions import Assumption
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal.system import ParticipantKind, System
from keystore_audit.properties import PROPERTIES
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    IDENTITY_CA,
    LISTENER,
    LISTENER_IDENTITY,
    LISTENER_PERMISSIONS,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    TALKER_IDENTITY,
    TALKER_PERMISSIONS,
    Builder,
    healthy_builder,
)

NONE, SIGN, ENCRYPT = ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT

Change = Callable[[Builder], object]


def on(atoms: str, index: int, **changed: Any) -> Change:
    """The change of fields of one atom."""

    def change(b: Builder) -> None:
        of = getattr(b, atoms)
        of[index] = replace(of[index], **changed)

    return change


def both(*changes: Change) -> Change:
    def change(b: Builder) -> None:
        for one in changes:
            one(b)

    return change


def unpinned(b: Builder) -> None:
    b.pins_signer = False


def may(b: Builder) -> None:
    b.may = True


def without(*assumptions: Assumption) -> Change:
    def change(b: Builder) -> None:
        may(b)
        b.assumed -= set(assumptions)

    return change


def believing(b: Builder) -> None:
    b.asks_announced_only = True


def extra(key: int | None, **kept: bool) -> Change:
    """A certificate that the permissions CA issued, and nobody here carries."""

    def change(b: Builder) -> None:
        b.certificate([PERMISSIONS_CA], key=None if key is None else b.certificates[key].key, **kept)

    return change


def crossed(b: Builder) -> None:
    """The permissions CA certified the identity CA's key, which has issued whom it issued."""
    cross = b.certificate([PERMISSIONS_CA], authority=True, key=b.certificates[IDENTITY_CA].key)
    for identity in (TALKER_IDENTITY, LISTENER_IDENTITY):
        b.certificates[identity] = replace(b.certificates[identity], issuers=frozenset({IDENTITY_CA, cross}))


def earlier_deny(b: Builder) -> None:
    """A deny before the talker's allow."""
    b.rules.insert(0, replace(b.rules[0], allow=False))


def expired_first_grant(b: Builder) -> None:
    """An expired grant of nothing before the talker's: it must not be chosen."""
    b.grants.insert(0, replace(b.grants[0], not_after=1))
    b.rules[:] = [replace(rule, grant=rule.grant + 1) for rule in b.rules]


def weak_rule_first(b: Builder) -> None:
    """A topic rule without protection before the strong one."""
    weak = replace(
        b.topic_rules[0], metadata_protection_kind=NONE, data_protection_kind=NONE, enable_read_access_control=False
    )
    b.topic_rules.insert(0, weak)


def weak_rule_last(b: Builder) -> None:
    weak_rule_first(b)
    b.topic_rules.reverse()


def shared_keys(b: Builder) -> None:
    """Everything encrypted, and no origin authenticated."""
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=ENCRYPT)
    b.topic_rules[0] = replace(b.topic_rules[0], metadata_protection_kind=ENCRYPT)


def second_domain(b: Builder) -> None:
    """A domain and a channel of its own, governed alike, that nobody uses."""
    b.channel(b.domain(1, 1), "rt/elsewhere")
    b.domain_rules[0] = replace(b.domain_rules[0], domains=frozenset({0, 1}))
    b.topic_rules[0] = replace(b.topic_rules[0], channels=frozenset({CHATTER, OTHER_TOPIC, ELSEWHERE}))


def second_trust_domain(b: Builder) -> None:
    """A domain that another governance covers, of an enclave that may do nothing."""
    b.channel(b.domain(1, 1), "rt/elsewhere")
    governance = b.document([PERMISSIONS_CA])
    b.topic_rule(b.domain_rule(governance, [1]), [ELSEWHERE])
    trust_domain = b.trust_domain([IDENTITY_CA], [PERMISSIONS_CA], governance)
    b.enclave(trust_domain, b.certificate([IDENTITY_CA]), b.document([PERMISSIONS_CA]))


def listener_publishes(channel: int, domain: int) -> Change:
    def change(b: Builder) -> None:
        b.rule(1, [domain], publish=[channel])

    return change


def second_grant(b: Builder) -> None:
    """Of the listener, behind the one that counts."""
    b.rule(b.grant(LISTENER_PERMISSIONS, [LISTENER_IDENTITY]), [1], publish=[ELSEWHERE])


def talker_publishes_there(b: Builder) -> None:
    """In the second domain, without reading anything in the first."""
    b.rule(0, [1], publish=[ELSEWHERE])


def relay(b: Builder) -> None:
    """The talker relays what it may not subscribe to."""
    b.rule(0, [0], relay=[OTHER_TOPIC])


def no_reader(b: Builder) -> None:
    """The listener may subscribe to nothing."""
    b.rules[:] = [replace(rule, subscribe=frozenset()) for rule in b.rules]


ELSEWHERE = 2

ALL_NONE = both(
    on("domain_rules", 0, rtps_protection_kind=NONE),
    on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=NONE),
)

LIVES_OPENLY = both(
    on("domain_rules", 0, rtps_protection_kind=NONE), on("topic_rules", 0, enable_liveliness_protection=False)
)
NAMED_OPENLY = both(
    on("topic_rules", 0, enable_discovery_protection=False),
    on("domain_rules", 0, rtps_protection_kind=ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION),
)
READS_ALONE = on("enclaves", LISTENER, reads_alone=frozenset({CHATTER}))

AUTHENTICATION = {"identities-chain-to-the-identity-ca"}
ENCRYPTION = {"outsiders-cannot-read", "outsiders-cannot-inject"}
REPLAY, LIVELINESS = "outsiders-cannot-replay", "outsiders-cannot-forge-liveliness"
BRIDGES = "no-enclave-bridges-domains"
INSIDERS = {"nobody-writes-without-a-grant", "nobody-reads-without-a-grant"}

SIGNS = {"no-enclave-grants-itself-rights"} | INSIDERS
OPAQUE_ENCLAVES = SIGNS | {
    "identities-chain-to-the-identity-ca",
    "no-identity-serves-two-enclaves",
    "no-subject-serves-two-enclaves",
}

MUTATIONS: dict[str, tuple[Change, set[str]]] = {
    "nothing": (lambda _b: None, set()),
    # authentication
    "unauthenticated participants": (
        on("domain_rules", 0, allow_unauthenticated_participants=True),
        {"only-authenticated-participants-join"},
    ),
    "other issuer": (on("certificates", TALKER_IDENTITY, issuers=frozenset({PERMISSIONS_CA})), AUTHENTICATION),
    "issuer is no authority": (on("certificates", IDENTITY_CA, authority=False), AUTHENTICATION),
    "identity expired": (on("certificates", TALKER_IDENTITY, not_after=1), AUTHENTICATION),
    "identity not yet valid": (on("certificates", TALKER_IDENTITY, not_before=3), AUTHENTICATION),
    "identity ends at the audit instant": (on("certificates", TALKER_IDENTITY, not_before=2, not_after=2), set()),
    "identity CA expired": (on("certificates", IDENTITY_CA, not_after=1), AUTHENTICATION),
    "identity revoked": (on("trust_domains", 0, revoked=frozenset({TALKER_IDENTITY})), AUTHENTICATION),
    "permissions CA expired": (
        on("certificates", PERMISSIONS_CA, not_after=1),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "governance not intact": (on("documents", GOVERNANCE, intact=False), {"documents-signed-by-the-permissions-ca"}),
    "signed by the identity CA": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset({IDENTITY_CA})),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "signed by nobody": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset()),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "signed by two, one a stranger": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset({PERMISSIONS_CA, TALKER_IDENTITY})),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "one CA that another certificate of the same key stands for": (
        on("certificates", PERMISSIONS_CA, key=100),
        {"one-ca-for-one-role"},
    ),
    "one grant for both": (
        on("grants", 0, names=frozenset({TALKER_IDENTITY, LISTENER_IDENTITY})),
        {"no-subject-serves-two-enclaves"},
    ),
    "one key": (on("certificates", LISTENER_IDENTITY, key=102), {"no-identity-serves-two-enclaves"}),
    "one CA, pinned": (
        on("trust_domains", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA})),
        {"one-ca-for-one-role"},
    ),
    "one CA, not pinned": (
        both(unpinned, on("trust_domains", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA}))),
        {"no-enclave-grants-itself-rights", "one-ca-for-one-role"} | INSIDERS,
    ),
    "one CA, not pinned, identities unfit to sign": (
        both(
            unpinned,
            on("trust_domains", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA})),
            on("certificates", TALKER_IDENTITY, fit_to_sign=False),
            on("certificates", LISTENER_IDENTITY, fit_to_sign=False),
        ),
        {"one-ca-for-one-role"},
    ),
    # encryption
    "all kinds NONE": (ALL_NONE, ENCRYPTION | INSIDERS | {"readers-cannot-forge", REPLAY}),
    "messages open, liveliness not asserted in secret": (
        both(
            on("domain_rules", 0, rtps_protection_kind=NONE), on("topic_rules", 0, enable_liveliness_protection=False)
        ),
        {LIVELINESS},
    ),
    "messages open, liveliness protected by nothing": (
        on("domain_rules", 0, rtps_protection_kind=NONE, liveliness_protection_kind=NONE),
        {LIVELINESS},
    ),
    "messages open, liveliness signed": (
        on("domain_rules", 0, rtps_protection_kind=NONE, liveliness_protection_kind=SIGN),
        set(),
    ),
    "messages signed, liveliness not protected": (
        both(
            on("domain_rules", 0, rtps_protection_kind=SIGN), on("topic_rules", 0, enable_liveliness_protection=False)
        ),
        set(),
    ),
    "unauthenticated participants, liveliness not protected": (
        both(
            on("domain_rules", 0, allow_unauthenticated_participants=True),
            on("topic_rules", 0, enable_liveliness_protection=False),
        ),
        {"only-authenticated-participants-join", LIVELINESS},
    ),
    "unauthenticated participants, payloads alone protected": (
        both(
            on("domain_rules", 0, allow_unauthenticated_participants=True),
            on("topic_rules", 0, metadata_protection_kind=NONE),
        ),
        {"only-authenticated-participants-join", "readers-cannot-forge", REPLAY},
    ),
    "a relay": (relay, set()),
    "a relay of what is in the clear": (
        both(relay, on("topic_rules", 0, data_protection_kind=NONE)),
        {"relays-cannot-read", "nobody-reads-without-a-grant"},
    ),
    "a relay that may subscribe": (
        both(
            relay,
            on("topic_rules", 0, data_protection_kind=NONE),
            lambda b: b.rule(0, [0], subscribe=[OTHER_TOPIC]),
        ),
        set(),
    ),
    "a second domain": (second_domain, set()),
    "a bridge": (both(second_domain, listener_publishes(ELSEWHERE, 1)), {BRIDGES}),
    "a second domain under another governance": (second_trust_domain, set()),
    "a bridge between two governances": (both(second_trust_domain, listener_publishes(ELSEWHERE, 1)), {BRIDGES}),
    "one reads in one domain, another writes in the other": (both(second_domain, talker_publishes_there), set()),
    "the same with one key": (
        both(second_domain, talker_publishes_there, on("certificates", LISTENER_IDENTITY, key=102)),
        {BRIDGES, "no-identity-serves-two-enclaves"},
    ),
    "a reader that writes elsewhere in its domain": (
        both(second_domain, listener_publishes(OTHER_TOPIC, 0)),
        set(),
    ),
    "discovery clear, messages encrypted": (on("topic_rules", 0, enable_discovery_protection=False), set()),
    "discovery clear, messages signed": (
        both(
            on("topic_rules", 0, enable_discovery_protection=False),
            on("domain_rules", 0, rtps_protection_kind=ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION),
        ),
        {"outsiders-cannot-learn-names"},
    ),
    "discovery signed, messages signed": (
        on("domain_rules", 0, discovery_protection_kind=SIGN, rtps_protection_kind=SIGN),
        {"outsiders-cannot-learn-names"},
    ),
    "payload in clear, messages encrypted": (
        on("topic_rules", 0, metadata_protection_kind=SIGN, data_protection_kind=NONE),
        {"nobody-reads-without-a-grant", "readers-cannot-forge"},
    ),
    # access control
    "read access control off": (
        on("topic_rules", 0, enable_read_access_control=False),
        {"grants-are-enforced", "nobody-reads-without-a-grant"},
    ),
    "write access control off": (
        on("topic_rules", 0, enable_write_access_control=False),
        {"grants-are-enforced", "nobody-writes-without-a-grant"},
    ),
    "join access control off": (on("domain_rules", 0, enable_join_access_control=False), {"grants-are-enforced"}),
    "no origin authentication": (shared_keys, {"readers-cannot-forge"}),
    "messages alone tell whose they are": (
        both(
            shared_keys, on("domain_rules", 0, rtps_protection_kind=ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION)
        ),
        {"readers-cannot-forge"},
    ),
    "messages alone tell whose they are, nothing else is protected": (
        on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=NONE),
        {"readers-cannot-forge"} | INSIDERS,
    ),
    "payloads encrypted, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=NONE),
            on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=ENCRYPT),
        ),
        {"readers-cannot-forge", REPLAY},
    ),
    "submessages encrypted, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=NONE),
            on("topic_rules", 0, metadata_protection_kind=ENCRYPT, data_protection_kind=NONE),
        ),
        {"readers-cannot-forge"},
    ),
    "default allow": (both(on("grants", 0, default_allow=True), shared_keys), {"readers-cannot-forge"}),
    "default allow, but the only writer is denied: nobody to pass for": (
        both(on("grants", 0, default_allow=True), on("rules", 0, allow=False), shared_keys),
        set(),
    ),
    "messages encrypted for all, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=ENCRYPT),
            on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=NONE),
        ),
        {"readers-cannot-forge"} | INSIDERS,
    ),
    "ungoverned": (on("topic_rules", 0, channels=frozenset()), set()),
    # first match and dates
    "weak topic rule first": (weak_rule_first, {"grants-are-enforced", "readers-cannot-forge"} | INSIDERS),
    "weak topic rule last": (weak_rule_last, set()),
    "all kinds NONE, and the talker denied before it is allowed: nothing to read": (
        both(earlier_deny, ALL_NONE),
        {"outsiders-cannot-inject", REPLAY} | INSIDERS,
    ),
    "expired grant first": (
        both(expired_first_grant, on("topic_rules", 0, enable_write_access_control=False)),
        {"grants-are-enforced", "nobody-writes-without-a-grant"},
    ),
    "a grant that is over, and where it counts nobody is asked": (
        both(
            lambda b: setattr(b, "skips_grants_out_of_date", False),
            on("grants", 0, not_after=1),
            on("topic_rules", 0, enable_write_access_control=False),
        ),
        {"nobody-writes-without-a-grant"},
    ),
    "a rule of one domain about a topic of another": (
        both(second_domain, listener_publishes(ELSEWHERE, 0), lambda b: b.rule(1, [1])),
        set(),
    ),
    "a denial in another domain, where writers are not asked": (
        both(
            second_domain,
            on("topic_rules", 0, enable_write_access_control=False),
            lambda b: b.rule(1, [1], publish=[ELSEWHERE], allow=False),
        ),
        {"grants-are-enforced", "nobody-writes-without-a-grant"},
    ),
    "a second grant, which would make a bridge": (both(second_domain, second_grant), set()),
    # endpoints that honest peers refuse
    "the talker denied and all kinds NONE, but its own implementation lets it write": (
        both(earlier_deny, ALL_NONE, on("enclaves", TALKER, writes_alone=frozenset({CHATTER}))),
        {"outsiders-cannot-read", "outsiders-cannot-inject", REPLAY} | INSIDERS,
    ),
    "nobody reads, all kinds NONE": (both(no_reader, ALL_NONE), {"outsiders-cannot-read"} | INSIDERS),
    "nobody reads and all kinds NONE, but the listener's own implementation lets it": (
        both(no_reader, ALL_NONE, READS_ALONE),
        {"outsiders-cannot-read", "outsiders-cannot-inject", REPLAY} | INSIDERS,
    ),
    "nobody reads, liveliness not asserted in secret": (both(no_reader, LIVES_OPENLY), set()),
    "liveliness not asserted in secret, and a reader by its own implementation alone": (
        both(no_reader, LIVES_OPENLY, READS_ALONE),
        {LIVELINESS},
    ),
    "nobody writes or reads, discovery clear": (both(earlier_deny, no_reader, NAMED_OPENLY), set()),
    "discovery clear, and a reader by its own implementation alone": (
        both(earlier_deny, no_reader, NAMED_OPENLY, READS_ALONE),
        {"outsiders-cannot-learn-names"},
    ),
    "discovery clear, and a writer by its own implementation alone": (
        both(earlier_deny, no_reader, NAMED_OPENLY, on("enclaves", TALKER, writes_alone=frozenset({CHATTER}))),
        {"outsiders-cannot-learn-names"},
    ),
    # what is not taken for granted
    "nothing but the certificates here, not assumed": (without(Assumption.NOTHING_ELSE_CERTIFIED), OPAQUE_ENCLAVES),
    "the authorities as found, not assumed": (without(Assumption.AUTHORITIES_AS_FOUND), OPAQUE_ENCLAVES),
    "nothing in unread files, not assumed": (without(Assumption.NOTHING_IN_UNREAD_FILES), OPAQUE_ENCLAVES),
    "no other documents, not assumed": (
        without(Assumption.NO_OTHER_DOCUMENTS),
        {"no-subject-serves-two-enclaves"} | INSIDERS,
    ),
    "robots that enforce, not assumed": (
        without(Assumption.ROBOTS_ENFORCE),
        {
            "only-authenticated-participants-join",
            "grants-are-enforced",
            "outsiders-cannot-learn-names",
            "readers-cannot-forge",
            REPLAY,
            LIVELINESS,
        }
        | ENCRYPTION
        | INSIDERS,
    ),
    "truthful announcements, not assumed": (without(Assumption.TRUTHFUL_ANNOUNCEMENTS), set()),
    "announcements are believed": (believing, set()),
    "announcements are believed, and not assumed to be truthful": (
        both(believing, without(Assumption.TRUTHFUL_ANNOUNCEMENTS)),
        {"readers-cannot-forge"} | INSIDERS,
    ),
    "sessions and rounds, not assumed": (
        without(Assumption.SESSIONS_END_WITH_GRANTS, Assumption.LOCKSTEP_ROUNDS),
        set(),
    ),
    # certificates that an attacker embeds
    "a second certificate of an enclave's key": (both(unpinned, extra(TALKER_IDENTITY)), SIGNS),
    "a second certificate of an enclave's key, pinned": (extra(TALKER_IDENTITY), set()),
    "a second certificate of an enclave's key, not fit to sign": (
        both(unpinned, extra(TALKER_IDENTITY, fit_to_sign=False)),
        set(),
    ),
    "a certificate of whoever's key": (both(unpinned, extra(None)), SIGNS),
    "a certificate of whoever's key, pinned": (extra(None), set()),
    "a second certificate of the permissions CA's own key": (both(unpinned, extra(PERMISSIONS_CA)), set()),
    "a cross certificate over the identity CA's key": (both(unpinned, crossed), SIGNS),
    "a cross certificate over the identity CA's key, pinned": (crossed, set()),
    # what could not be read
    "opaque governance": (
        both(may, on("documents", GOVERNANCE, intact=False, opaque=True)),
        {prop.id for prop in PROPERTIES}
        - {"identities-chain-to-the-identity-ca", "no-identity-serves-two-enclaves", "no-enclave-grants-itself-rights"}
        - {"one-ca-for-one-role", "no-subject-serves-two-enclaves", BRIDGES},
    ),
    "opaque permissions": (
        both(may, on("documents", TALKER_PERMISSIONS, intact=False, opaque=True)),
        {
            "documents-signed-by-the-permissions-ca",
            "no-enclave-grants-itself-rights",
            "no-subject-serves-two-enclaves",
        }
        | INSIDERS,
    ),
    "opaque authorities": (
        both(may, lambda b: b.unread(0)),
        {prop.id for prop in PROPERTIES}
        - {"no-identity-serves-two-enclaves", "no-subject-serves-two-enclaves", BRIDGES},
    ),
    "opaque enclave": (
        both(may, on("enclaves", TALKER, identity=None, kind=ParticipantKind.UNREAD)),
        {
            "identities-chain-to-the-identity-ca",
            "no-identity-serves-two-enclaves",
            "no-subject-serves-two-enclaves",
            "no-enclave-grants-itself-rights",
        }
        | INSIDERS,
    ),
}


def mutated(change: Change) -> System:
    builder = healthy_builder()
    change(builder)
    return builder.system()


MODEL_MUTANTS = {
    "grants out of date count": (
        "a grant that is over, and where it counts nobody is asked",
        "g: first.c & in_force }",
        "g: first.c }",
    ),
    "grants out of date are not passed over": (
        "expired grant first",
        "g: Grant - (skipped_out_of_date - in_force), c",
        "g: Grant, c",
    ),
    "rules are about all domains": (
        "a rule of one domain about a topic of another",
        "{ r: Rule, c: r.criteria | c.in_domain in r.domains }",
        "{ r: Rule, c: r.criteria }",
    ),
    "denials let in": (
        "a denial in another domain, where writers are not asked",
        "{ g: Grant, d: (g.rule & allow_rule).domains }",
        "{ g: Grant, d: g.rule.domains }",
    ),
    "every grant counts": (
        "a second grant, which would make a bridge",
        "first = eligible - preceded_by.eligible |",
        "first = eligible |",
    ),
    "messages tell whose they are": (
        "messages alone tell whose they are",
        "trust_domain.(submessage_protection[authenticating_origin])",
        "trust_domain.(message_protection[authenticating_origin] + submessage_protection[authenticating_origin])",
    ),
}
"""What it would mean; a change of the above that finds it out; one change of the modules."""
