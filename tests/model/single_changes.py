"""A keystore, and others that differ from it in one thing, with what is to be told about each."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import NamedTuple

from msgspec.structs import replace

from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import Member, Store, authority

TALKER = rule(criterion("publish", "rt/chatter", "rt/rosout"), criterion("subscribe", "rt/clock"))
LISTENER = rule(criterion("subscribe", "rt/chatter"))
SOONER = datetime(2030, 1, 1, tzinfo=timezone.utc)
PAST = datetime(2025, 1, 1, tzinfo=timezone.utc)


def talker(*rules: str, **others: str) -> str:
    return permissions(grant("/talker", *rules, **others))


BASE = Store(
    members={
        "/talker": Member(permissions=talker(TALKER), serial=101),
        "/listener": Member(permissions=permissions(grant("/listener", LISTENER)), serial=102),
    }
)
EVERYBODY = ("/listener", "/talker")


def talks(*rules: str, **others: str) -> Store:
    """The talker's permissions are others."""
    return BASE.member("/talker", permissions=talker(*rules, **others))


def governed(*rules: str) -> Store:
    return replace(BASE, governance=governance(*rules))


def by_topic(**flags: str) -> Store:
    return governed(domain_rule(topic_rule(**flags)))


def others_grant(*rules: str) -> str:
    """The listener's permissions have a grant for the talker as well."""
    return permissions(grant("/listener", LISTENER), grant("/talker", *rules))


UNCONTROLLED = governance(domain_rule(topic_rule(write="false")))


class Case(NamedTuple):
    """A keystore beside BASE, and the changes as (layer, kind, direction, enclaves, operation)."""

    name: str
    new: Store
    expected: tuple[tuple[str, str, str, tuple[str, ...], str | None], ...]
    old: Store = BASE


def right(direction: str, operation: str, *paths: str) -> tuple[str, str, str, tuple[str, ...], str | None]:
    return "grants", "right", direction, paths or ("/talker",), operation


def trust(kind: str, direction: str, *paths: str) -> tuple[str, str, str, tuple[str, ...], str | None]:
    return "trust", kind, direction, paths or EVERYBODY, None


def protection(direction: str, *paths: str) -> tuple[str, str, str, tuple[str, ...], str | None]:
    return trust("protection", direction, *paths)


CASES = (
    Case(
        "a topic more to publish",
        talks(rule(criterion("publish", "rt/chatter", "rt/rosout", "rt/more"), criterion("subscribe", "rt/clock"))),
        (right("gained", "publish"),),
    ),
    Case(
        "a topic less to publish",
        talks(rule(criterion("publish", "rt/chatter"), criterion("subscribe", "rt/clock"))),
        (right("lost", "publish"),),
    ),
    Case(
        "another topic",
        talks(rule(criterion("publish", "rt/chatter", "rt/other"), criterion("subscribe", "rt/clock"))),
        (right("gained", "publish"), right("lost", "publish")),
    ),
    Case(
        "a topic more to subscribe to",
        talks(TALKER, rule(criterion("subscribe", "rt/chatter"))),
        (right("gained", "subscribe"),),
    ),
    Case(
        "everything to subscribe to", talks(TALKER, rule(criterion("subscribe", "*"))), (right("gained", "subscribe"),)
    ),
    Case(
        "a deny rule before",
        talks(rule(criterion("publish", "rt/r*"), allow=False), TALKER),
        (right("lost", "publish"),),
    ),
    Case(
        "a default that allows",
        talks(TALKER, default="ALLOW"),
        tuple(right("gained", each) for each in ("publish", "relay", "subscribe")),
    ),
    Case(
        "relaying",
        talks(TALKER, rule(criterion("relay", "rt/chatter"))),
        (right("gained", "relay"), right("gained", "subscribe")),
    ),
    Case(
        "another domain to publish in",
        talks(TALKER, rule(criterion("publish", "rt/chatter"), domains="<id>7</id>")),
        (right("gained", "publish"),),
    ),
    Case("a domain to join", talks(TALKER, rule(domains="<id>7</id>")), (right("gained", "join"),)),
    Case(
        "a partition more",
        talks(TALKER, rule(criterion("publish", "rt/inner", partitions=("p",)))),
        (right("gained", "publish"),),
    ),
    Case(
        "unauthenticated participants",
        governed(domain_rule(unauthenticated="true")),
        (protection("gained"),),
    ),
    Case("no join access control", governed(domain_rule(join="false")), (protection("gained"),)),
    Case("RTPS in clear", governed(domain_rule(rtps="NONE")), (protection("gained"),)),
    Case("RTPS encrypted", governed(domain_rule(rtps="ENCRYPT")), (protection("lost"),)),
    Case("discovery signed", governed(domain_rule(discovery="SIGN")), (protection("gained"),)),
    Case("liveliness in clear", governed(domain_rule(liveliness="NONE")), (protection("gained"),)),
    Case("no write access control", by_topic(write="false"), (protection("gained"),)),
    Case("no read access control", by_topic(read="false"), (protection("gained"),)),
    Case("topics in discovery", by_topic(discovery="false"), (protection("gained"),)),
    Case("liveliness of topics", by_topic(liveliness="false"), (protection("gained"),)),
    Case("payload signed", by_topic(data="SIGN"), (protection("gained"),)),
    Case(
        "origin authenticated",
        by_topic(metadata="ENCRYPT_WITH_ORIGIN_AUTHENTICATION"),
        (protection("lost"),),
    ),
    Case(
        "encrypted, or signed with its origin",
        by_topic(metadata="SIGN_WITH_ORIGIN_AUTHENTICATION"),
        (protection("mixed"),),
    ),
    Case(
        "one topic in clear",
        governed(domain_rule(topic_rule("rt/chatter", data="NONE") + topic_rule())),
        (protection("gained"),),
    ),
    Case(
        "one topic apart in every way",
        governed(domain_rule(topic_rule("rt/chatter", data="NONE", read="false") + topic_rule())),
        (protection("gained"),),
    ),
    Case("no topic covered but one", governed(domain_rule(topic_rule("rt/chatter"))), (protection("lost"),)),
    Case("a domain more", governed(domain_rule(domains="<id>0</id><id>7</id>")), (protection("gained"),)),
    Case(
        "one enclave's governance",
        BASE.member("/talker", governance=governance(domain_rule(rtps="NONE"))),
        (protection("gained", "/talker"),),
    ),
    Case(
        "a grant that ends sooner",
        talks(TALKER, end="2030-01-01T00:00:00"),
        (trust("grant-validity", "lost", "/talker"),),
    ),
    Case(
        "a grant out of date",
        talks(TALKER, end="2025-01-01T00:00:00"),
        (right("lost", "publish"), right("lost", "subscribe")),
    ),
    Case(
        "an identity that ends sooner",
        BASE.member("/talker", end=SOONER),
        (trust("identity-validity", "lost", "/talker"),),
    ),
    Case("an identity out of date", BASE.member("/talker", end=PAST), (trust("identity-validity", "lost", "/talker"),)),
    Case(
        "an identity with another key",
        BASE.member("/talker", key="another"),
        (trust("identity-key", "changed", "/talker"),),
    ),
    Case(
        "an identity with another subject",
        BASE.member("/talker", subject="/other"),
        (trust("identity-subject", "changed", "/talker"),),
    ),
    Case(
        "an identity that is an authority",
        BASE.member("/talker", ca=True),
        (trust("identity-authority", "gained", "/talker"),),
    ),
    Case(
        "an identity of another authority",
        BASE.member("/talker", issuer=authority("somebody")),
        (trust("identity-issuer", "lost", "/talker"),),
    ),
    Case(
        "a private key of another's",
        BASE.member("/talker", private_key="another"),
        (trust("private-key", "gained", "/talker"),),
    ),
    Case(
        "an enclave more",
        replace(
            BASE,
            members={**BASE.members, "/more": Member(permissions=permissions(grant("/more", LISTENER)), serial=103)},
        ),
        (trust("enclave-added", "gained", "/more"),),
    ),
    Case("an enclave less", BASE.without("/listener"), (trust("enclave-removed", "lost", "/listener"),)),
    Case(
        "an identity CA more",
        replace(BASE, identity=(authority("identityCA"), authority("more"))),
        (trust("authority", "gained"),),
    ),
    Case(
        "a permissions CA more",
        replace(BASE, permissions=(authority("permissionsCA"), authority("more"))),
        (trust("authority", "gained"),),
    ),
    Case("another permissions CA", replace(BASE, permissions=(authority("another"),)), (trust("authority", "mixed"),)),
    Case("another identity CA", replace(BASE, identity=(authority("another"),)), (trust("authority", "mixed"),)),
    Case(
        "an identity CA that ends sooner",
        replace(BASE, identity=(authority("identityCA", end=SOONER),)),
        (trust("authority-validity", "lost"),),
    ),
    Case(
        "permissions signed by somebody",
        BASE.member("/talker", signer=authority("somebody")),
        (trust("signer", "mixed", "/talker"),),
    ),
    Case(
        "governance signed by somebody",
        replace(BASE, governance_signer=authority("somebody")),
        (trust("signer", "mixed"),),
    ),
    Case(
        "permissions changed after the signature",
        BASE.member("/talker", tampered=True),
        (trust("signature", "lost", "/talker"),),
    ),
    Case(
        "an identity taken back",
        replace(BASE, revoked=(101,)),
        (trust("revocation", "lost"),),
        replace(BASE, revoked=()),
    ),
    Case("a revocation list", replace(BASE, revoked=()), (trust("revocation", "lost"),)),
    Case(
        "a list out of date",
        replace(BASE, revoked=(), crl_end=PAST),
        (trust("revocation-validity", "lost"),),
        replace(BASE, revoked=()),
    ),
    Case(
        "a document beside the enclaves that names one",
        replace(BASE, strays={"more.p7s": talker(rule(criterion("publish", "rt/more")))}),
        (("access", "accepted", "gained", ("/talker",), "publish"),),
    ),
    Case(
        "a grant for one in the document of another",
        BASE.member(
            "/listener",
            permissions=permissions(
                grant("/listener", LISTENER), grant("/talker", rule(criterion("publish", "rt/more")))
            ),
        ),
        (("access", "accepted", "gained", ("/talker",), "publish"),),
    ),
    Case(
        "a denial in another domain, which Fast DDS applies to own writers here",
        talks(rule(criterion("publish", "rt/chatter"), allow=False, domains="<id>9</id>"), TALKER),
        (("access", "own-endpoint", "lost", ("/talker",), "publish"),),
    ),
    Case(
        "a denial in another domain, which Fast DDS applies to own readers here",
        talks(rule(criterion("subscribe", "rt/clock"), allow=False, domains="<id>9</id>"), TALKER),
        (("access", "own-endpoint", "lost", ("/talker",), "subscribe"),),
    ),
    Case(
        "a denial in another domain, behind what it denies",
        talks(TALKER, rule(criterion("publish", "rt/chatter"), allow=False, domains="<id>9</id>")),
        (),
    ),
    Case(
        "a grant for one in the document of another, where nothing is governed",
        BASE.member("/listener", permissions=others_grant(rule(criterion("publish", "rt/more"), domains="<id>7</id>"))),
        (("grants", "right-presented", "gained", ("/talker",), "publish"),),
    ),
    Case(
        "a grant for one in the document of another, to join where nothing is governed",
        BASE.member("/listener", permissions=others_grant(rule(domains="<id>7</id>"))),
        (("grants", "right-presented", "gained", ("/talker",), "join"),),
    ),
    Case(
        "a grant for one in the document of another, where no rule asks for it",
        replace(BASE, governance=UNCONTROLLED).member(
            "/listener", permissions=others_grant(rule(criterion("publish", "rt/more")))
        ),
        (("grants", "right-presented", "gained", ("/talker",), "publish"),),
        replace(BASE, governance=UNCONTROLLED),
    ),
)
