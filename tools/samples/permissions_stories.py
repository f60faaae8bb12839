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
            "The grant's default is MAYBE, which the schema does not allow. Cyclone DDS reads DENY; Fast DDS "
            "refuses the document.",
            _text("<default>DENY</default>", "<default>MAYBE</default>"),
        ),
        good=Case("The default is DENY.", ONE),
    )
    yield from pair(
        "KA502",
        bad=Case(
            "A comment stands inside a topic's name. Fast DDS allows rt/, Cyclone DDS rt/chatter: one signed file "
            "has two meanings.",
            _text("rt/chatter", "rt/<!-- was: talk -->chatter"),
        ),
        good=Case("The name is one piece of text.", ONE),
    )
    yield from pair(
        "KA517",
        bad=Case(
            "A topic is empty. The schema allows it, but Cyclone DDS crashes on it, also when a peer presents it.",
            _text("<topic>rt/chatter</topic>", "<topic></topic>"),
        ),
        good=Case("Every topic has a name.", ONE),
    )
    domains = "        <domains>\n          <id>0</id>\n        </domains>\n"
    yield from pair(
        "KA518",
        bad=Case(
            "The first rule names no domains: Cyclone DDS crashes on it, also when a peer presents it.",
            _text(domains + _head("rt/chatter"), _head("rt/chatter")),
        ),
        good=Case("Every rule names its domains.", ONE),
    )
    yield from pair(
        "KA521",
        bad=Case(
            "The date on which the grant ends is empty: Fast DDS 2.14 crashes on it, also when a peer presents it.",
            _text("<not_after>2100-01-01T00:00:00</not_after>", "<not_after></not_after>"),
        ),
        good=Case("Both dates are there.", ONE),
    )
    blanks = (" " * 79 + "\n") * 780
    yield from pair(
        "KA522",
        bad=Case(
            "The document has 64 kB (here by blanks, else by some 900 names). On Fast DDS 2.9 the talker's process "
            "ends when it answers a handshake.",
            _text("  </permissions>", f"{blanks}  </permissions>"),
        ),
        good=Case("The document without the blanks.", ONE),
        options=("--profile", "fastdds-2.9"),
    )


def _head(topic: str) -> str:
    return f"        <publish>\n          <topics>\n            <topic>{topic}</topic>\n"


def _grants() -> Iterator[Story]:
    yield from pair(
        "KA503",
        bad=Case(
            "The grant is for CN=/speaker, but the certificate says CN=/talker: no grant names the talker, so it is "
            "refused.",
            with_grant(subject="CN=/speaker"),
        ),
        good=Case("The grant names the certificate's subject.", ONE),
    )
    nested = "/talker/listener"
    yield from pair(
        "KA519",
        bad=Case(
            "Cyclone DDS cuts names at every slash, and all parts of CN=/talker are in CN=/talker/listener. So the "
            "talker may present the listener's permissions.",
            with_listener(
                path=nested,
                certificate=replace(LISTENER_CERTIFICATE, subject=nested),
                permissions=Permissions(grants=(replace(LISTENER_GRANT, path=nested),)),
            ),
        ),
        good=Case("Neither path consists of parts of the other.", TWO),
    )
    yield from pair(
        "KA520",
        bad=Case(
            "The grant has blanks in its subject: CN = /talker. Only Fast DDS since 2.14 finds it.",
            with_grant(subject="CN = /talker"),
        ),
        good=Case("The subject has no blanks.", ONE),
    )
    wide = replace(TALKER_GRANT, rules=(Rule(publish=("rt/cmd_vel",)), DISCOVERY))
    yield from pair(
        "KA504",
        bad=Case(
            "A second grant gives the talker /cmd_vel. Today every implementation stops at the first; when that "
            "expires, Fast DDS uses the second.",
            with_talker(permissions=Permissions(grants=(TALKER_GRANT, wide))),
        ),
        good=Case("One grant.", ONE),
    )
    yield from pair(
        "KA512",
        bad=Case(
            "The talker's document also grants the listener /cmd_vel, so the listener presents this one instead of "
            "its own.",
            replace(
                TWO,
                enclaves=(
                    talker(permissions=Permissions(grants=(TALKER_GRANT, replace(LISTENER_GRANT, rules=wide.rules)))),
                    LISTENER,
                ),
            ),
        ),
        good=Case("Each document holds its own enclave's grant.", TWO),
    )
    yield from pair(
        "KA514",
        bad=Case(
            "The grant only denies: Fast DDS refuses a participant that is allowed nothing.",
            with_grant(rules=(Rule(publish=("rt/secret",), allow=False),)),
        ),
        good=Case(
            "The same denial before an allow rule.",
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
        good=Case("It has been valid since 2020.", ONE),
    )
    yield from pair(
        "KA507",
        bad=Case(
            "The talker's grant ends two weeks after the audit: time to sign it again.",
            with_grant(not_after="2026-12-05T00:00:00"),
        ),
        good=Case("It ends with the certificate.", ONE),
    )
    shorter = replace(TALKER_CERTIFICATE, not_after=day(2099, 1, 1))
    yield from pair(
        "KA513",
        bad=Case(
            "The grant is valid a year longer than the identity. If somebody issues the name again, the old right "
            "still counts.",
            with_talker(certificate=shorter),
        ),
        good=Case("Grant and identity end together.", ONE),
    )
    yield from pair(
        "KA516",
        bad=Case(
            "The two dates are swapped: the grant ends before it begins, and is never in force.",
            with_grant(not_before="2026-06-01T00:00:00", not_after="2026-01-01T00:00:00"),
        ),
        good=Case("It begins before it ends.", ONE),
    )


def _domains() -> Iterator[Story]:
    elsewhere = tuple(replace(rule, domains=(7,)) for rule in TALKER_GRANT.rules)
    yield from pair(
        "KA508",
        bad=Case(
            "The grant is for domain 7, the governance for domain 0: the talker may do nothing in any domain.",
            with_grant(rules=elsewhere),
        ),
        good=Case("Both are for domain 0.", ONE),
    )
    yield from pair(
        "KA515",
        bad=Case(
            "The rule's domain range has a minimum but no maximum. The specification reads every domain; Fast DDS "
            "and Cyclone DDS read only domain 0.",
            with_rules(replace(TALKING, domains=((0, None),))),
        ),
        good=Case("The range has both ends.", with_rules(replace(TALKING, domains=((0, 0),)))),
    )


def _rights() -> Iterator[Story]:
    yield from pair(
        "KA509",
        bad=Case(
            "What no rule mentions is allowed. Under Cyclone DDS the talker may do everything. Fast DDS ignores the "
            "default, which hides the fault.",
            with_grant(default="ALLOW"),
        ),
        good=Case("What no rule mentions is denied.", ONE),
    )
    yield from pair(
        "KA510",
        bad=Case(
            "The talker may publish rt/chatter*: also /chatter/admin, /chatter_raw and any later name.",
            with_rules(Rule(publish=("rt/chatter*",))),
        ),
        good=Case("The talker may publish /chatter.", ONE),
    )
    yield from pair(
        "KA511",
        bad=Case(
            "The permissions are those of `ros2 security create_enclave`, before any policy: every topic, service "
            "and action, in both directions.",
            with_talker(permissions=Permissions(grants=(grant("/talker", EVERYTHING),))),
        ),
        good=Case("The permissions list what the talker needs.", ONE),
    )
