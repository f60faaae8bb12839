"""Pairs for KA4: what the governance protects, and what it leaves open."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import ONE, QUIET, TWO, governed, with_listener
from .documents import DomainRule, Governance, TopicRule, edited
from .smime import signed_by
from .story import Case, Story, pair

STOCK = DomainRule()


def stories() -> Iterator[Story]:
    """All pairs of KA4."""
    yield from _documents()
    yield from _access()
    yield from _domain_kinds()
    yield from _topic_kinds()
    yield from _reach()


_JOIN = "            <enable_join_access_control>true</enable_join_access_control>\n"


def _documents() -> Iterator[Story]:
    text = Governance(rules=(QUIET,)).xml()
    yield from pair(
        "KA401",
        bad=Case(
            "The governance lacks the element that says whether joining needs a grant. Both vendors refuse the "
            "document (measured): nothing starts.",
            replace(ONE, governance=edited(text, _JOIN, "")),
        ),
        good=Case("The document fits the schema.", ONE),
    )
    yield from pair(
        "KA402",
        bad=Case(
            "A comment stands inside the topic expression. Fast DDS reads the text before it (rt/), Cyclone DDS "
            "joins the pieces (rt/*).",
            replace(
                ONE,
                governance=edited(text, ">*</topic_expression>", ">rt/<!-- all -->*</topic_expression>"),
            ),
        ),
        good=Case("The expression is one piece of text.", ONE),
    )
    yield from pair(
        "KA416",
        bad=Case(
            "The listener carries an older governance that signs messages and does not encrypt them. The two never "
            "match.",
            with_listener(changes={"governance.p7s": signed_by(ONE.permissions_ca).smime(Governance().xml().encode())}),
        ),
        good=Case("Both carry the same governance.", TWO),
    )
    yield from pair(
        "KA421",
        bad=Case(
            "The governance has the form of DDS-Security 1.0, as Ardent wrote it, and cannot say whether liveliness "
            "is protected.",
            replace(ONE, governance=Governance(rules=(QUIET,), version="20160303")),
        ),
        good=Case("The form of DDS-Security 1.1.", ONE),
    )


def _access() -> Iterator[Story]:
    bare = replace(QUIET, rtps="NONE")
    yield from pair(
        "KA403",
        bad=Case(
            "Participants without an identity may join. Topics are encrypted, so they get no data, but they see who "
            "is there.",
            governed(ONE, replace(bare, allow_unauthenticated=True)),
        ),
        good=Case("Every participant proved an identity.", governed(ONE, bare)),
    )
    yield from pair(
        "KA404",
        bad=Case(
            "Any identity of the CA may join the domain, whatever its permissions say, and gets the keys that all "
            "participants share.",
            governed(ONE, replace(QUIET, join_access_control=False)),
        ),
        good=Case("Joining needs a grant.", ONE),
    )
    yield from pair(
        "KA405",
        bad=Case(
            "Nobody checks subscribe rules: every participant reads every topic.",
            governed(ONE, replace(QUIET, topics=(TopicRule(read_access_control=False),))),
        ),
        good=Case("Reading needs a grant.", ONE),
    )
    yield from pair(
        "KA406",
        bad=Case(
            "Nobody checks publish rules: every participant writes every topic.",
            governed(ONE, replace(QUIET, topics=(TopicRule(write_access_control=False),))),
        ),
        good=Case("Writing needs a grant.", ONE),
    )
    yield from pair(
        "KA417",
        bad=Case(
            "Unauthenticated participants are allowed, but a key that they cannot have must protect every message. "
            "Fast DDS since 2.6.5 refuses to start.",
            governed(ONE, replace(QUIET, allow_unauthenticated=True)),
        ),
        good=Case("Messages are protected, and every participant has the key.", ONE),
    )


def _domain_kinds() -> Iterator[Story]:
    yield from pair(
        "KA407",
        bad=Case(
            "Whole messages are not authenticated: outsiders can forge all but topic payloads, such as headers that "
            "name the sender.",
            governed(ONE, replace(QUIET, rtps="NONE")),
        ),
        good=Case("Whole messages are encrypted.", ONE),
    )
    yield from pair(
        "KA408",
        bad=Case(
            "Whole messages are authenticated, not encrypted, as in sros2's own governance: outsiders see "
            "who sends how much to whom.",
            governed(ONE, STOCK),
        ),
        good=Case("Whole messages are encrypted.", governed(ONE, replace(STOCK, rtps="ENCRYPT"))),
    )
    yield from pair(
        "KA409",
        bad=Case(
            "Topics are announced in clear: without any key, outsiders learn every topic's name and type.",
            governed(ONE, replace(STOCK, topics=(TopicRule(discovery_protection=False),))),
        ),
        good=Case("Topics are announced over encrypted discovery.", governed(ONE, STOCK)),
    )
    yield from pair(
        "KA410",
        bad=Case(
            "Liveliness messages are not protected: outsiders can keep a dead writer alive.",
            governed(ONE, replace(STOCK, liveliness="NONE")),
        ),
        good=Case("Liveliness is encrypted.", governed(ONE, STOCK)),
    )


def _topic_kinds() -> Iterator[Story]:
    def with_topic(**kinds: str) -> DomainRule:
        return replace(STOCK, topics=(TopicRule(**kinds),))  # type: ignore[arg-type]

    yield from pair(
        "KA411",
        bad=Case(
            "Submessages are not protected: every participant can read and change sequence numbers and heartbeats.",
            governed(ONE, with_topic(metadata="NONE")),
        ),
        good=Case("Submessages are encrypted.", governed(ONE, STOCK)),
    )
    yield from pair(
        "KA412",
        bad=Case(
            "Message, submessage and payload are signed, but none is encrypted: outsiders read the data.",
            governed(ONE, with_topic(metadata="SIGN", data="SIGN")),
        ),
        good=Case("The payload is encrypted.", governed(ONE, with_topic(metadata="SIGN", data="ENCRYPT"))),
    )
    quiet = replace(QUIET, topics=(TopicRule(metadata="SIGN", data="SIGN"),))
    yield from pair(
        "KA413",
        bad=Case(
            "Only whole messages are encrypted, with a key that all participants share: each of them reads every "
            "topic, granted or not.",
            governed(ONE, quiet),
        ),
        good=Case(
            "The payload is encrypted for its readers.",
            governed(ONE, replace(QUIET, topics=(TopicRule(metadata="SIGN", data="ENCRYPT"),))),
        ),
    )
    yield from pair(
        "KA414",
        bad=Case(
            "Message, submessage and payload are all unprotected: anybody on the network writes any topic.",
            governed(ONE, replace(with_topic(metadata="NONE", data="NONE"), rtps="NONE")),
        ),
        good=Case(
            "Only the payload is encrypted, and so authenticated.",
            governed(ONE, replace(with_topic(metadata="NONE", data="ENCRYPT"), rtps="NONE")),
        ),
    )
    yield from pair(
        "KA415",
        bad=Case(
            "Submessages are encrypted, payloads are not: a relay or a durable store, which decrypts submessages, "
            "sees the data in clear.",
            governed(ONE, with_topic(data="NONE")),
        ),
        good=Case("Payloads are encrypted too.", governed(ONE, STOCK)),
    )


def _reach() -> Iterator[Story]:
    yield from pair(
        "KA418",
        bad=Case(
            "The governance has a rule only for rt/*. No implementation creates services, actions and "
            "ros_discovery_info without one, so no node starts.",
            governed(ONE, replace(QUIET, topics=(TopicRule(expression="rt/*"),))),
        ),
        good=Case("The last rule is for every topic.", ONE),
    )
    yield from pair(
        "KA419",
        bad=Case(
            "The domain range has a minimum but no maximum. The specification reads every domain; Fast DDS and "
            "Cyclone DDS read only domain 0.",
            governed(ONE, replace(QUIET, domains=((0, None),))),
        ),
        good=Case("The range has both ends.", governed(ONE, replace(QUIET, domains=((0, 0),)))),
    )
    yield from pair(
        "KA420",
        bad=Case(
            "The governance also names domain 231. Cyclone DDS refuses the whole document for that, even for domain 0.",
            governed(ONE, replace(QUIET, domains=(0, 231))),
        ),
        good=Case("The highest domain is 230.", governed(ONE, replace(QUIET, domains=(0, 230)))),
    )
