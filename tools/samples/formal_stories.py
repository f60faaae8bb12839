"""Pairs for KA7: for each property a keystore that violates it for a reason of its own."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import (
    IDENTITY_CA,
    LISTENER,
    LISTENER_CERTIFICATE,
    LISTENER_GRANT,
    PERMISSIONS_CA,
    PROVEN,
    QUIET,
    TALKER_CERTIFICATE,
    TALKER_GRANT,
    TWO,
    domain,
    governed,
    talker,
    with_listener,
)
from .documents import DISCOVERY, DomainRule, Permissions, Rule, TopicRule
from .smime import signed_by
from .story import Case, Story, pair

CHATTER = TopicRule(expression="rt/chatter")
"""A rule for /chatter alone, as strict as the stock rule for every topic."""


def stories() -> Iterator[Story]:
    """All pairs of KA7."""
    yield from _participants()
    yield from _authorities()
    yield from _documents()
    yield from _outsiders()
    yield from _replays()
    yield from _grants()
    yield from _insiders()


def _participants() -> Iterator[Story]:
    lax = DomainRule(domains=(5,), rtps="NONE", allow_unauthenticated=True)
    yield from pair(
        "KA701",
        bad=Case(
            "Domain 0 is strict. Domain 5, opened for a demonstration, admits participants that never proved an "
            "identity.",
            governed(TWO, QUIET, lax),
        ),
        good=Case("Both domains demand an identity.", governed(TWO, QUIET, replace(lax, allow_unauthenticated=False))),
    )
    yield from pair(
        "KA702",
        bad=Case(
            "The permissions CA issued the listener's identity, since the authorities' keys were mixed up. Nobody "
            "who trusts the identity CA accepts it.",
            with_listener(certificate=replace(LISTENER_CERTIFICATE, issuer=PERMISSIONS_CA)),
        ),
        good=Case("The identity CA issued both identities.", TWO),
    )
    yield from pair(
        "KA704",
        bad=Case(
            "The listener has its own certificate for the talker's key, since one request was signed under two "
            "names. Whoever has the key is both.",
            with_listener(certificate=replace(LISTENER_CERTIFICATE, key=TALKER_CERTIFICATE.key)),
        ),
        good=Case("Each enclave has its own key.", TWO),
    )


def _authorities() -> Iterator[Story]:
    yield from pair(
        "KA706",
        bad=Case(
            "One authority signs identities and rights, as sros2 makes it. Only implementations that pin the signer "
            "keep the two apart.",
            replace(TWO, permissions_ca=IDENTITY_CA),
        ),
        good=Case("Each role has its own authority.", TWO),
        options=("--profile", "jazzy"),
    )
    namesake = replace(LISTENER_CERTIFICATE, subject=TALKER_CERTIFICATE.subject)
    grant = replace(LISTENER_GRANT, subject="CN=/talker")
    yield from pair(
        "KA707",
        bad=Case(
            "The listener's certificate has the talker's subject, copied with the command that made it: each may "
            "present the other's permissions.",
            with_listener(certificate=namesake, permissions=Permissions(grants=(grant,))),
        ),
        good=Case("Each certificate has its enclave's subject.", TWO),
    )


def _documents() -> Iterator[Story]:
    shared = replace(TWO, permissions_ca=IDENTITY_CA)
    more = Rule(publish=("rt/chatter", "rt/cmd_vel"))
    permissions = Permissions(grants=(replace(TALKER_GRANT, rules=(more, DISCOVERY)),))
    yield from pair(
        "KA703",
        bad=Case(
            "CVE-2023-24010: one authority serves both roles, and the talker signed itself /cmd_vel. Cyclone DDS up "
            "to 0.10 and Fast DDS up to 2.6.4 accept that, as does `openssl smime -verify -CAfile`.",
            replace(
                shared,
                enclaves=(talker(permissions=permissions, seal=signed_by(TALKER_CERTIFICATE).smime), LISTENER),
            ),
        ),
        good=Case(
            "The authority signed the same rights. It still serves both roles.",
            replace(shared, enclaves=(talker(permissions=permissions), LISTENER)),
        ),
    )
    bundle = PERMISSIONS_CA.pem() + IDENTITY_CA.pem()
    yield from pair(
        "KA705",
        bad=Case(
            "The authorities are separate, but permissions_ca.cert.pem holds both certificates. If Fast DDS does "
            "not pin the signer, every identity can sign rights.",
            replace(TWO, changes={"public/permissions_ca.cert.pem": bundle}),
        ),
        good=Case("permissions_ca.cert.pem holds only the permissions CA.", TWO),
        options=("--profile", "fastdds-2.9"),
    )


def _outsiders() -> Iterator[Story]:
    readable = replace(CHATTER, metadata="SIGN", data="NONE")
    yield from pair(
        "KA711",
        bad=Case(
            "For speed, /chatter is only signed, not encrypted: whoever listens on the network reads it.",
            governed(TWO, domain(readable)),
        ),
        good=Case(
            "/chatter has its own rule, which encrypts the payload.",
            governed(TWO, domain(replace(readable, data="ENCRYPT"))),
        ),
    )
    announced = replace(CHATTER, discovery_protection=False)
    yield from pair(
        "KA712",
        bad=Case(
            "/chatter alone is announced in clear: its data stays secret, but not its name, type and place.",
            governed(TWO, domain(announced)),
        ),
        good=Case("/chatter is announced over encrypted discovery.", governed(TWO, domain(CHATTER))),
    )
    bare = replace(CHATTER, metadata="NONE", data="NONE")
    yield from pair(
        "KA713",
        bad=Case(
            "Whole messages are not authenticated, and /chatter has no protection: whoever reaches the network "
            "writes it.",
            governed(TWO, domain(bare, rtps="NONE")),
        ),
        good=Case(
            "The payload of /chatter is encrypted, and so authenticated.",
            governed(TWO, domain(replace(bare, data="ENCRYPT"), rtps="NONE")),
        ),
    )


def _replays() -> Iterator[Story]:
    recorded = replace(CHATTER, metadata="NONE")
    yield from pair(
        "KA714",
        bad=Case(
            "Only the payload of /chatter is protected, not its submessages and messages: yesterday's message is "
            "accepted again.",
            governed(TWO, domain(recorded, rtps="NONE")),
        ),
        good=Case("Whole messages are signed.", governed(TWO, domain(recorded, rtps="SIGN"))),
    )
    unsaid = replace(CHATTER, liveliness_protection=False)
    yield from pair(
        "KA715",
        bad=Case(
            "Whole messages are not signed, and the liveliness of /chatter is not protected: anybody keeps a dead "
            "talker alive.",
            governed(TWO, domain(unsaid, rtps="NONE")),
        ),
        good=Case("Its liveliness is protected.", governed(TWO, domain(CHATTER, rtps="NONE"))),
    )


def _grants() -> Iterator[Story]:
    yield from pair(
        "KA721",
        bad=Case(
            "Reading and writing need a grant, joining does not: an identity without any right still gets the keys "
            "that participants share.",
            governed(TWO, replace(QUIET, join_access_control=False)),
        ),
        good=Case("Joining needs a grant too.", TWO),
    )
    uncontrolled = replace(CHATTER, write_access_control=False)
    yield from pair(
        "KA722",
        bad=Case(
            "For /chatter alone, nobody checks publish rules: the listener, which may only read, writes.",
            governed(TWO, replace(QUIET, topics=(uncontrolled, TopicRule()))),
        ),
        good=Case("Writing /chatter needs a grant.", governed(TWO, replace(QUIET, topics=(CHATTER, TopicRule())))),
    )


def _insiders() -> Iterator[Story]:
    shared_key = replace(CHATTER, metadata="SIGN", data="SIGN")
    elsewhere = replace(LISTENER_GRANT, rules=(Rule(subscribe=("rt/rosout",)), DISCOVERY))
    bystander = with_listener(permissions=Permissions(grants=(elsewhere,)))
    yield from pair(
        "KA723",
        bad=Case(
            "/chatter is encrypted only as part of whole messages, with the key of all participants. The listener "
            "reads it without a grant.",
            governed(bystander, replace(QUIET, topics=(shared_key, TopicRule()))),
        ),
        good=Case(
            "The payload is encrypted with a key that only readers of /chatter get.",
            governed(bystander, replace(QUIET, topics=(replace(shared_key, data="ENCRYPT"), TopicRule()))),
        ),
    )
    yield from pair(
        "KA724",
        bad=Case(
            "sros2's own governance: the listener can write /chatter to other readers in the talker's name.",
            governed(TWO, DomainRule()),
        ),
        good=Case(
            "Every submessage proves which participant sent it.",
            governed(TWO, PROVEN),
        ),
    )
    relaying = replace(LISTENER_GRANT, rules=(Rule(relay=("rt/chatter",)), DISCOVERY))
    store = with_listener(permissions=Permissions(grants=(relaying,)))
    passed_on = replace(CHATTER, data="NONE")
    yield from pair(
        "KA725",
        bad=Case(
            "The listener may only relay /chatter, of which only submessages are encrypted. A relay holds their "
            "keys, so it reads what it passes on.",
            governed(store, replace(QUIET, topics=(passed_on, TopicRule()))),
        ),
        good=Case(
            "The payload is encrypted with a key that a relay does not get.",
            governed(store, replace(QUIET, topics=(CHATTER, TopicRule()))),
        ),
        options=("--profile", "spec"),
    )
    inside = replace(LISTENER_GRANT, rules=(Rule(subscribe=("rt/chatter",)), DISCOVERY))
    outside = Rule(publish=("rt/status",), domains=(7,))
    both = replace(inside, rules=(*inside.rules, outside))
    domains = (QUIET, replace(QUIET, domains=(7,)))
    yield from pair(
        "KA731",
        bad=Case(
            "Domain 0 is the robot's, domain 7 the operator's. The listener reads /chatter in one and writes /status "
            "in the other.",
            governed(with_listener(permissions=Permissions(grants=(both,))), *domains),
        ),
        good=Case(
            "The listener stays in domain 0.",
            governed(with_listener(permissions=Permissions(grants=(inside,))), *domains),
        ),
    )
