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
            "The governance does not say whether joining takes a grant: the element is missing. DDS-Security "
            "1.1 requires it, and both vendors refuse the document (measured): nothing starts.",
            replace(ONE, governance=edited(text, _JOIN, "")),
        ),
        good=Case("The document fits the schema.", ONE),
    )
    yield from pair(
        "KA402",
        bad=Case(
            "A comment stands inside the topic expression. Fast DDS reads the text before it (rt/), "
            "Cyclone DDS joins the pieces (rt/*), so that one signed file protects different topics.",
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
            "The listener carries an older governance, in which messages are signed, not encrypted. "
            "Enclaves whose protection differs never match, without a word in any log.",
            with_listener(changes={"governance.p7s": signed_by(ONE.permissions_ca).smime(Governance().xml().encode())}),
        ),
        good=Case("Both carry the same governance.", TWO),
    )
    yield from pair(
        "KA421",
        bad=Case(
            "The governance has the form of DDS-Security 1.0, as Ardent wrote it: it cannot say whether "
            "liveliness is protected, and each implementation answers that for itself.",
            replace(ONE, governance=Governance(rules=(QUIET,), version="20160303")),
        ),
        good=Case("The form of DDS-Security 1.1.", ONE),
    )


def _access() -> Iterator[Story]:
    bare = replace(QUIET, rtps="NONE")
    yield from pair(
        "KA403",
        bad=Case(
            "Participants that never proved who they are may join the domain. Topics are still encrypted, "
            "so that they get no data; they see who is there, and any topic added without protection is "
            "theirs.",
            governed(ONE, replace(bare, allow_unauthenticated=True)),
        ),
        good=Case("Everybody who joins proved an identity.", governed(ONE, bare)),
    )
    yield from pair(
        "KA404",
        bad=Case(
            "Any identity of the CA may join the domain, whatever its permissions say: it holds the keys "
            "that all participants share.",
            governed(ONE, replace(QUIET, join_access_control=False)),
        ),
        good=Case("To join takes a grant.", ONE),
    )
    yield from pair(
        "KA405",
        bad=Case(
            "Subscribe rules of permissions are not looked at: every participant reads every topic.",
            governed(ONE, replace(QUIET, topics=(TopicRule(read_access_control=False),))),
        ),
        good=Case("To read takes a grant.", ONE),
    )
    yield from pair(
        "KA406",
        bad=Case(
            "Publish rules of permissions are not looked at: every participant writes every topic.",
            governed(ONE, replace(QUIET, topics=(TopicRule(write_access_control=False),))),
        ),
        good=Case("To write takes a grant.", ONE),
    )
    yield from pair(
        "KA417",
        bad=Case(
            "Unauthenticated participants are allowed, and every message must be protected by a key that "
            "they cannot have. Fast DDS refuses to start with that since 2.6.5.",
            governed(ONE, replace(QUIET, allow_unauthenticated=True)),
        ),
        good=Case("Messages are protected, and everybody who joins has the key.", ONE),
    )


def _domain_kinds() -> Iterator[Story]:
    yield from pair(
        "KA407",
        bad=Case(
            "Whole messages are not authenticated: outsiders can forge what is not a topic's payload, "
            "such as the headers that say from whom a message comes.",
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
            "Topics are announced in clear: outsiders learn every topic's name and type without any key.",
            governed(ONE, replace(STOCK, topics=(TopicRule(discovery_protection=False),))),
        ),
        good=Case("Topics are announced over the encrypted discovery.", governed(ONE, STOCK)),
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
            "Submessages are bare: sequence numbers and heartbeats can be read, and changed by whoever joined.",
            governed(ONE, with_topic(metadata="NONE")),
        ),
        good=Case("Submessages are encrypted.", governed(ONE, STOCK)),
    )
    yield from pair(
        "KA412",
        bad=Case(
            "Message, submessage and payload are each signed and none is encrypted: outsiders read the data.",
            governed(ONE, with_topic(metadata="SIGN", data="SIGN")),
        ),
        good=Case("The payload is encrypted.", governed(ONE, with_topic(metadata="SIGN", data="ENCRYPT"))),
    )
    quiet = replace(QUIET, topics=(TopicRule(metadata="SIGN", data="SIGN"),))
    yield from pair(
        "KA413",
        bad=Case(
            "Only whole messages are encrypted, with a key that all participants share: whoever joined "
            "reads every topic, grant or not.",
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
            "Message, submessage and payload are all unprotected: anybody on the network writes any "
            "topic, as if there were no security.",
            governed(ONE, replace(with_topic(metadata="NONE", data="NONE"), rtps="NONE")),
        ),
        good=Case(
            "The payload alone is encrypted, and with that authenticated.",
            governed(ONE, replace(with_topic(metadata="NONE", data="ENCRYPT"), rtps="NONE")),
        ),
    )
    yield from pair(
        "KA415",
        bad=Case(
            "Submessages are encrypted and payloads are not: a relay or a durable store, which undoes the "
            "first, holds the data in clear.",
            governed(ONE, with_topic(data="NONE")),
        ),
        good=Case("Payloads are encrypted too.", governed(ONE, STOCK)),
    )


def _reach() -> Iterator[Story]:
    yield from pair(
        "KA418",
        bad=Case(
            "The governance has a rule for rt/* only. For services, actions and ros_discovery_info there "
            "is none: no implementation creates them, so that no node starts.",
            governed(ONE, replace(QUIET, topics=(TopicRule(expression="rt/*"),))),
        ),
        good=Case("The last rule is for every topic.", ONE),
    )
    yield from pair(
        "KA419",
        bad=Case(
            "The domain range has a minimum and no maximum: for the specification that is every domain, "
            "for Fast DDS and Cyclone DDS domain 0 alone.",
            governed(ONE, replace(QUIET, domains=((0, None),))),
        ),
        good=Case("The range has both ends.", governed(ONE, replace(QUIET, domains=((0, 0),)))),
    )
    yield from pair(
        "KA420",
        bad=Case(
            "The governance also names domain 231. Cyclone DDS refuses the whole document for that, and "
            "with it domain 0.",
            governed(ONE, replace(QUIET, domains=(0, 231))),
        ),
        good=Case("The highest domain is 230.", governed(ONE, replace(QUIET, domains=(0, 230)))),
    )
