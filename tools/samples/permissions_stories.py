"""Pairs for KA5: to whom a permissions document grants what, and for how long."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import (
    LISTENER,
    LISTENER_CERTIFICATE,
    LISTENER_GRANT,
    ONE,
    TALKER_CERTIFICATE,
    TALKER_GRANT,
    TALKING,
    TWO,
    talker,
    with_grant,
    with_listener,
    with_rules,
    with_talker,
)
from .certificates import day
from .documents import DISCOVERY, Permissions, Rule, edited
from .policy import Node, grant
from .store import Store
from .story import Case, Story, pair

EVERYTHING = Node(
    name="default",
    publish=("/*",),
    subscribe=("/*",),
    reply=("/*",),
    request=("/*",),
    call=("/*",),
    execute=("/*",),
    common=False,
)
"""sros2's default policy, which `create_enclave` applies."""


def stories() -> Iterator[Story]:
    """All pairs of KA5, each about the talker's permissions.p7s."""
    yield from _documents()
    yield from _grants()
    yield from _dates()
    yield from _domains()
    yield from _rights()


def _text(old: str, new: str) -> Store:
    return with_talker(permissions=edited(Permissions(grants=(TALKER_GRANT,)).xml(), old, new))


def _documents() -> Iterator[Story]:
    yield from pair(
        "KA501",
        bad=Case(
            "The grant's default is MAYBE, which the schema does not know: Cyclone DDS takes it for DENY, "
            "Fast DDS refuses the document.",
            _text("<default>DENY</default>", "<default>MAYBE</default>"),
        ),
        good=Case("The default is DENY.", ONE),
    )
    yield from pair(
        "KA502",
        bad=Case(
            "A comment stands inside a topic's name: Fast DDS allows rt/, Cyclone DDS rt/chatter. One "
            "signed file has two meanings.",
            _text("rt/chatter", "rt/<!-- was: talk -->chatter"),
        ),
        good=Case("The name is one piece of text.", ONE),
    )
    yield from pair(
        "KA517",
        bad=Case(
            "A topic is empty. The schema lets it pass; Cyclone DDS crashes on it, and since peers send "
            "their permissions to each other, one signed file takes others down.",
            _text("<topic>rt/chatter</topic>", "<topic></topic>"),
        ),
        good=Case("Every topic has a name.", ONE),
    )
    domains = "        <domains>\n          <id>0</id>\n        </domains>\n"
    yield from pair(
        "KA518",
        bad=Case(
            "The first rule does not say for which domains it is: Cyclone DDS crashes on it, also when a "
            "peer presents it.",
            _text(domains + _head("rt/chatter"), _head("rt/chatter")),
        ),
        good=Case("Every rule names its domains.", ONE),
    )
    yield from pair(
        "KA521",
        bad=Case(
            "The grant was to end some day, and nobody wrote the date: Fast DDS 2.14 crashes on it, also when a peer "
            "presents it.",
            _text("<not_after>2100-01-01T00:00:00</not_after>", "<not_after></not_after>"),
        ),
        good=Case("Both dates are there.", ONE),
    )
    blanks = (" " * 79 + "\n") * 780
    yield from pair(
        "KA522",
        bad=Case(
            "The document has 64 kB (here by blanks, else by some 900 names): on Fast DDS 2.9 the talker completes no "
            "handshake, and dies of the first that it answers.",
            _text("  </permissions>", f"{blanks}  </permissions>"),
        ),
        good=Case("The document is as long as what it says.", ONE),
        options=("--profile", "fastdds-2.9"),
    )


def _head(topic: str) -> str:
    return f"        <publish>\n          <topics>\n            <topic>{topic}</topic>\n"


def _grants() -> Iterator[Story]:
    yield from pair(
        "KA503",
        bad=Case(
            "The grant is for CN=/speaker, the certificate says CN=/talker: no grant is the talker's, and "
            "it is refused.",
            with_grant(subject="CN=/speaker"),
        ),
        good=Case("The grant names the certificate's subject.", ONE),
    )
    nested = "/talker/listener"
    yield from pair(
        "KA519",
        bad=Case(
            "The listener lies below the talker, as namespaces do. Cyclone DDS cuts names at every slash, and all "
            "parts of CN=/talker are in CN=/talker/listener: the talker may present the listener's permissions.",
            with_listener(
                path=nested,
                certificate=replace(LISTENER_CERTIFICATE, subject=nested),
                permissions=Permissions(grants=(replace(LISTENER_GRANT, path=nested),)),
            ),
        ),
        good=Case("Neither path is made of parts of the other.", TWO),
    )
    yield from pair(
        "KA520",
        bad=Case(
            "Somebody laid the grant out for the eye: CN = /talker. Fast DDS since 2.14 finds it, Fast DDS 2.6 and "
            "Cyclone DDS 0.10 do not, and the talker has no rights there.",
            with_grant(subject="CN = /talker"),
        ),
        good=Case("The subject is written without blanks.", ONE),
    )
    wide = replace(TALKER_GRANT, rules=(Rule(publish=("rt/cmd_vel",)), DISCOVERY))
    yield from pair(
        "KA504",
        bad=Case(
            "A second grant gives the talker /cmd_vel. Today every implementation stops at the first; "
            "when that one expires, Fast DDS goes on to the second.",
            with_talker(permissions=Permissions(grants=(TALKER_GRANT, wide))),
        ),
        good=Case("One grant.", ONE),
    )
    yield from pair(
        "KA512",
        bad=Case(
            "The talker's document also holds a grant for the listener, to publish /cmd_vel. Peers take "
            "any document that the CA signed: the listener presents this one instead of its own.",
            replace(
                TWO,
                enclaves=(
                    talker(permissions=Permissions(grants=(TALKER_GRANT, replace(LISTENER_GRANT, rules=wide.rules)))),
                    LISTENER,
                ),
            ),
        ),
        good=Case("Each document holds the grant of its own enclave.", TWO),
    )
    yield from pair(
        "KA514",
        bad=Case(
            "The grant only denies: with nothing allowed, Fast DDS refuses the participant.",
            with_grant(rules=(Rule(publish=("rt/secret",), allow=False),)),
        ),
        good=Case(
            "The same denial before what is allowed.",
            with_rules(Rule(publish=("rt/secret",), allow=False), TALKING),
        ),
    )


def _dates() -> Iterator[Story]:
    yield from pair(
        "KA505",
        bad=Case("The talker's grant ended in June 2026.", with_grant(not_after="2026-06-01T00:00:00")),
        good=Case("It ends with the certificate.", ONE),
    )
    yield from pair(
        "KA506",
        bad=Case("The talker's grant begins in 2027.", with_grant(not_before="2027-01-01T00:00:00")),
        good=Case("It has been good since 2020.", ONE),
    )
    yield from pair(
        "KA507",
        bad=Case(
            "The talker's grant ends on 5 December 2026, two weeks after the audit: time to sign it again.",
            with_grant(not_after="2026-12-05T00:00:00"),
        ),
        good=Case("It ends with the certificate.", ONE),
    )
    shorter = replace(TALKER_CERTIFICATE, not_after=day(2099, 1, 1))
    yield from pair(
        "KA513",
        bad=Case(
            "The grant is good for a year longer than the identity: harmless until somebody issues the "
            "name again, for whom the old right then still stands.",
            with_talker(certificate=shorter),
        ),
        good=Case("Grant and identity end together.", ONE),
    )
    yield from pair(
        "KA516",
        bad=Case(
            "The grant ends before it begins: the two dates were swapped, and it never holds.",
            with_grant(not_before="2026-06-01T00:00:00", not_after="2026-01-01T00:00:00"),
        ),
        good=Case("It begins before it ends.", ONE),
    )


def _domains() -> Iterator[Story]:
    elsewhere = tuple(replace(rule, domains=(7,)) for rule in TALKER_GRANT.rules)
    yield from pair(
        "KA508",
        bad=Case(
            "The grant is for domain 7, the governance for domain 0: there is no domain in which the "
            "talker may do anything.",
            with_grant(rules=elsewhere),
        ),
        good=Case("Both are for domain 0.", ONE),
    )
    yield from pair(
        "KA515",
        bad=Case(
            "The rule's domain range has a minimum and no maximum: for the specification that is every "
            "domain, for Fast DDS and Cyclone DDS domain 0 alone.",
            with_rules(replace(TALKING, domains=((0, None),))),
        ),
        good=Case("The range has both ends.", with_rules(replace(TALKING, domains=((0, 0),)))),
    )


def _rights() -> Iterator[Story]:
    yield from pair(
        "KA509",
        bad=Case(
            "What no rule mentions is allowed. Cyclone DDS obeys: the talker may do everything; Fast DDS "
            "ignores the default, which hides the fault where only it is tried.",
            with_grant(default="ALLOW"),
        ),
        good=Case("What no rule mentions is denied.", ONE),
    )
    yield from pair(
        "KA510",
        bad=Case(
            "The talker may publish rt/chatter*: also /chatter/admin, /chatter_raw and any name somebody "
            "thinks of later.",
            with_rules(Rule(publish=("rt/chatter*",))),
        ),
        good=Case("The talker may publish /chatter.", ONE),
    )
    yield from pair(
        "KA511",
        bad=Case(
            "The permissions are those that `ros2 security create_enclave` makes, before any policy was "
            "applied: every topic, service and action, both ways.",
            with_talker(permissions=Permissions(grants=(grant("/talker", EVERYTHING),))),
        ),
        good=Case("The permissions list what the talker needs.", ONE),
    )
