"""Pairs for KA64x: a keystore and the policy that it is to be the work of (`sample_keystores/policies/`)."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER, ONE, TALKER, TALKER_GRANT, TALKING, TWO, with_grant, with_rules, with_talker
from .documents import DISCOVERY, Permissions, edited
from .story import Case, Story, pair

TALKER_ALONE = ("--policy", "policies/talker.policy.xml")
BOTH = ("--policy", "policies/talker_and_listener.policy.xml")


def stories() -> Iterator[Story]:
    """All pairs of KA64x."""
    yield from _rights()
    yield from _enclaves()
    yield from _undecided()


def _rights() -> Iterator[Story]:
    yield from pair(
        "KA640",
        options=TALKER_ALONE,
        bad=Case(
            "The policy lets the talker publish /chatter; its permissions were signed before that was written. Under "
            "Enforce the node fails when it makes its publisher.",
            with_grant(rules=(DISCOVERY,)),
        ),
        good=Case("The permissions let the talker publish /chatter.", ONE),
    )
    yield from pair(
        "KA641",
        options=TALKER_ALONE,
        bad=Case(
            "The permissions let the talker publish /cmd_vel, which was written into permissions.xml by hand for an "
            "afternoon's test; no policy says so.",
            with_rules(replace(TALKING, publish=("rt/chatter", "rt/cmd_vel"))),
        ),
        good=Case("The permissions let the talker publish /chatter and nothing else.", ONE),
    )


def _enclaves() -> Iterator[Story]:
    both = with_rules(replace(TALKING, publish=("rt/chatter", "rt/log")))
    yield from pair(
        "KA642",
        bad=Case(
            "The policy has a second <profiles> for the talker, with the node that logs. `ros2 security` makes a "
            "grant of it that no implementation asks, so that the logger's right is in the keystore by hand alone.",
            both,
            ("--policy", "policies/two_profiles.policy.xml"),
        ),
        good=Case(
            "The policy has both nodes in one <profiles>, and the keystore what it says.",
            both,
            ("--policy", "policies/one_profiles.policy.xml"),
        ),
    )
    yield from pair(
        "KA643",
        options=BOTH,
        bad=Case("The policy speaks of a listener, for which nobody created an enclave.", ONE),
        good=Case("The keystore has both enclaves of the policy.", TWO),
    )
    yield from pair(
        "KA644",
        options=TALKER_ALONE,
        bad=Case("The keystore has a listener of which the policy says nothing: it was removed there alone.", TWO),
        good=Case("The policy speaks of the one enclave that there is.", ONE),
    )


def _undecided() -> Iterator[Story]:
    xml = Permissions(grants=(TALKER_GRANT,)).xml()
    yield from pair(
        "KA645",
        options=TALKER_ALONE,
        bad=Case(
            "A CDATA section inside a topic's name, of which parsers read different pieces. Whether that is what the "
            "policy says cannot be told.",
            with_talker(permissions=edited(xml, "rt/chatter", "rt/chat<![CDATA[ter]]>")),
        ),
        good=Case("The same without the section.", with_talker(permissions=xml)),
    )
    unsigned = {"permissions.p7s": None}
    yield from pair(
        "KA646",
        options=BOTH,
        bad=Case(
            "Identities, and no permissions: made for rmw_zenoh, which has its access control elsewhere. That the "
            "policy holds cannot be seen here.",
            replace(TWO, enclaves=(replace(TALKER, changes=unsigned), replace(LISTENER, changes=unsigned))),
        ),
        good=Case("Both enclaves have permissions.", TWO),
    )
