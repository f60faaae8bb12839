"""Expressions of topics, and names that an expression might be mistaken about."""

from __future__ import annotations

from hashlib import sha256

from tests.keystore.documents import allow, deny, pub, pubsub, topic_rule
from tests.oracles.vendors.enclave import publish
from tests.oracles.vendors.recipe import Recipe, of_rules, of_topics

NAMES = ("a", "b", "^", "]", "-", "!", "A", "1", "aa", "a/b", ".a", "", "\\", ":", " a", "[", "a]")
EXPRESSIONS = (
    "*",
    "?",
    "??",
    "*?*",
    "a*",
    "*a",
    "a?b",
    "**",
    "[ab]",
    "[a-c]",
    "[c-a]",
    "[!a]",
    "[^a]",
    "[]a]",
    "[!]a]",
    "[a-]",
    "[-a]",
    "[[]",
    "[]",
    "[!]",
    "[a",
    "[",
    "[a]]",
    "[[:alpha:]]",
    "[[:digit:]]",
    "[[:nope:]]",
    "[![:alpha:]]",
    "[[.a.]]",
    "[[=a=]]",
    "\\*",
    "\\a",
    "\\",
    "[\\]",
    "[\\a]",
    "a[*]",
    "[*]",
    "[?]",
    "{a,b}",
    "a|b",
    "a/b",
    "[a/]*",
    ".*",
    ".a",
    "*/*",
    "[.]a",
    "[a-c-e]",
    "[A-z]",
    "[!-^]",
    "[a][b]",
    "*[a]*",
    "*a*b*",
)


IN_PERMISSIONS = tuple(
    Recipe(
        title=f"expression rt/{expression} in permissions",
        permissions=of_rules(allow(pub(f"rt/{expression}"))),
        endpoints=tuple(publish(f"rt/{name}") for name in NAMES),
    )
    for expression in EXPRESSIONS
)
IN_GOVERNANCE = tuple(
    Recipe(
        title=f"expression rt/{expression} in the governance",
        governance=of_topics(topic_rule(f"rt/{expression}", read=False, write=False), topic_rule()),
        permissions=of_rules(allow(pub("none"))),
        endpoints=tuple(publish(f"rt/{name}") for name in NAMES),
    )
    for expression in ("*", "?", "[ab]", "[!a]", "[^a]", "[]a]", "[[:alpha:]]", "[a", "\\a", "[a-]", "a/b", "a*")
)
IN_PARTITIONS = tuple(
    Recipe(
        title=f"expression {expression} of a partition",
        permissions=of_rules(allow(pub("rt/t", partitions=(expression,)))),
        endpoints=tuple(publish("rt/t", name) for name in (*NAMES, "*", "?", "a*", "[a]", "[^a]", "\\a", "\\*")),
    )
    for expression in (*EXPRESSIONS, "")
)
TEXTS = (
    Recipe(
        title="blanks round a topic",
        permissions=of_rules(allow(pub(" rt/a "))),
        endpoints=(publish("rt/a"), publish(" rt/a ")),
    ),
    Recipe(
        title="line break in a topic",
        permissions=of_rules(allow(pub("\n      rt/a\n    "))),
        endpoints=(publish("rt/a"),),
    ),
    Recipe(
        title="blank inside a topic",
        permissions=of_rules(allow(pub("rt/a  b"))),
        endpoints=(publish("rt/a  b"), publish("rt/a b")),
    ),
    Recipe(
        title="ampersand and angle brackets",
        permissions=of_rules(allow(pub("rt/a&b", "rt/<"))),
        endpoints=(publish("rt/a&b"), publish("rt/<"), publish("rt/a&amp;b")),
    ),
    Recipe(
        title="names beyond ASCII",
        permissions=of_rules(allow(pub("rt/é", "rt/ö?", "rt/[ü]"))),
        endpoints=(publish("rt/é"), publish("rt/öa"), publish("rt/öé"), publish("rt/ü"), publish("rt/u")),
    ),
    *(
        Recipe(
            title=f"{expression} against a name of two octets and against one of two letters",
            permissions=of_rules(allow(pub(f"rt/{expression}"), pub("rt/t", partitions=("", expression)))),
            endpoints=(publish("rt/é"), publish("rt/ab"), publish("rt/a"), publish("rt/t", "é"), publish("rt/t", "ab")),
        )
        for expression in ("?", "??", "[!a]", "[!a][!a]", "[^a]", "*")
    ),
    Recipe(
        title="upper and lower case",
        permissions=of_rules(allow(pub("rt/Chatter"))),
        endpoints=(publish("rt/chatter"), publish("rt/Chatter"), publish("RT/Chatter")),
    ),
    Recipe(
        title="very long name",
        permissions=of_rules(allow(pub("rt/" + "a" * 240, "rt/b*"))),
        endpoints=(
            publish("rt/" + "a" * 240),
            publish("rt/" + "b" * 252),
            publish("rt/" + "b" * 253),
            publish("rt/b" + "c" * 400),
        ),
    ),
)
BUILTIN = (
    Recipe(
        title="builtin names without rights",
        endpoints=tuple(
            publish(name)
            for name in (
                "ros_discovery_info",
                "rt/rosout",
                "rt/parameter_events",
                "rq/talker/get_parametersRequest",
                "DCPSParticipant",
                "DCPSTopic",
                "DCPSPublication",
                "DCPSPublications",
                "DCPSSubscription",
                "DCPSParticipants",
                "DCPSOwn",
                "DCPSParticipantMessage",
                "DCPSParticipantsSecure",
                "DCPSPublicationsSecure",
                "DCPSParticipantStatelessMessage",
                "DCPSParticipantVolatileMessageSecure",
                "TypeLookup",
                "TypeLookup_request",
            )
        ),
    ),
    Recipe(
        title="builtin names denied",
        permissions=of_rules(allow(pub("rt/z")), deny(pubsub("*"))),
        endpoints=(publish("DCPSParticipant"), publish("DCPSTopic"), publish("ros_discovery_info")),
    ),
    Recipe(
        title="builtin names without topic rule",
        governance=of_topics(topic_rule("rt/*")),
        permissions=of_rules(allow(pubsub("*"))),
        endpoints=(publish("DCPSParticipant"), publish("DCPSTopic"), publish("ros_discovery_info"), publish("rt/a")),
    ),
)
_OPEN_A = topic_rule("rt/a", read=False, write=False)
WILDCARD_TOPICS = (
    *(
        Recipe(
            title=f"topics that are patterns, governed by {title}",
            governance=of_topics(*rules),
            permissions=of_rules(allow(pub("rt/a", "z"))),
            endpoints=tuple(publish(f"rt/{name}") for name in ("*", "?", "[ab]", "[!a]", "a", "b", "b*")),
        )
        for title, rules in {
            "an open one first": (_OPEN_A, topic_rule()),
            "a closed one first": (topic_rule("rt/a"), topic_rule(read=False, write=False)),
            "one of none": (topic_rule("rt/z"),),
            "a set": (topic_rule("rt/[ab]", read=False, write=False), topic_rule()),
        }.items()
    ),
    Recipe(
        title="topics that are patterns",
        permissions=of_rules(allow(pub("rt/a", "rt/b*"))),
        endpoints=tuple(publish(f"rt/{name}") for name in ("*", "?", "[ab]", "b*", "b?", "b[a]", "a")),
    ),
    Recipe(
        title="topics that are patterns, denied literally",
        permissions=of_rules(deny(pub("rt/a")), allow(pub("*"))),
        endpoints=tuple(publish(f"rt/{name}") for name in ("*", "?", "[ab]", "a", "b")),
    ),
    Recipe(
        title="topics that are patterns, governed literally",
        governance=of_topics(topic_rule("rt/a", read=False, write=False), topic_rule("rt/b*")),
        permissions=of_rules(allow(pub("none"))),
        endpoints=tuple(publish(f"rt/{name}") for name in ("*", "?", "[ab]", "a", "b", "b*")),
    ),
)
LONG = tuple(sha256(b"%d" % number).hexdigest()[:40] for number in range(24))
MANY_LONG = tuple(f"*{text}*" for text in LONG)
"""Names may hold each of these texts or not, in any order: their classes are beyond any budget."""

BEYOND_CLASSES = (
    Recipe(
        title="24 topics between stars",
        permissions=of_rules(deny(pub(*MANY_LONG[:12])), allow(pub(*MANY_LONG[12:], "rt/chatter"))),
        endpoints=(
            publish("rt/chatter"),
            publish(f"rt/{LONG[0]}"),
            publish(f"rt/{LONG[20]}"),
            publish(f"rt/{LONG[20]}{LONG[13]}"),
            publish(f"rt/{LONG[20]}{LONG[7]}"),
            publish(f"rt/{LONG[20][1:]}"),
        ),
    ),
    Recipe(
        title="24 partitions between stars",
        permissions=of_rules(allow(pub("rt/t", partitions=MANY_LONG))),
        endpoints=(publish("rt/t"), *(publish("rt/t", name) for name in (LONG[3], LONG[3][1:], "*", f"a{LONG[9]}b"))),
    ),
)

RECIPES = (*IN_PERMISSIONS, *IN_GOVERNANCE, *IN_PARTITIONS, *TEXTS, *BUILTIN, *WILDCARD_TOPICS, *BEYOND_CLASSES)
