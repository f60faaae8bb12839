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
            "The policy lets the talker publish /chatter, but its permissions are older. Under Enforce the node "
            "fails when it creates its publisher.",
            with_grant(rules=(DISCOVERY,)),
        ),
        good=Case("The permissions let the talker publish /chatter.", ONE),
    )
    yield from pair(
        "KA641",
        options=TALKER_ALONE,
        bad=Case(
            "The permissions let the talker publish /cmd_vel, added by hand to permissions.xml for a test; no "
            "policy says so.",
            with_rules(replace(TALKING, publish=("rt/chatter", "rt/cmd_vel"))),
        ),
        good=Case("The permissions let the talker publish only /chatter.", ONE),
    )


def _enclaves() -> Iterator[Story]:
    both = with_rules(replace(TALKING, publish=("rt/chatter", "rt/log")))
    yield from pair(
        "KA642",
        bad=Case(
            "The policy has a second <profiles> for the talker, with the node that logs. `ros2 security` makes a "
            "grant of it that no implementation uses.",
            both,
            ("--policy", "policies/two_profiles.policy.xml"),
        ),
        good=Case(
            "The policy has both nodes in one <profiles>, and the keystore agrees.",
            both,
            ("--policy", "policies/one_profiles.policy.xml"),
        ),
    )
    yield from pair(
        "KA643",
        options=BOTH,
        bad=Case("The policy describes a listener, but nobody created its enclave.", ONE),
        good=Case("The keystore has both enclaves of the policy.", TWO),
    )
    yield from pair(
        "KA644",
        options=TALKER_ALONE,
        bad=Case("The keystore has a listener that the policy does not mention: it was removed only there.", TWO),
        good=Case("The policy describes the only enclave.", ONE),
    )


def _undecided() -> Iterator[Story]:
    xml = Permissions(grants=(TALKER_GRANT,)).xml()
    yield from pair(
        "KA645",
        options=TALKER_ALONE,
        bad=Case(
            "A topic's name has a CDATA section, which parsers read differently. It is unknown whether that is what "
            "the policy says.",
            with_talker(permissions=edited(xml, "rt/chatter", "rt/chat<![CDATA[ter]]>")),
        ),
        good=Case("The same without the section.", with_talker(permissions=xml)),
    )
    unsigned = {"permissions.p7s": None}
    yield from pair(
        "KA646",
        options=BOTH,
        bad=Case(
            "Identities without permissions, made for rmw_zenoh, which has its access control elsewhere. Whether "
            "the policy holds cannot be seen here.",
            replace(TWO, enclaves=(replace(TALKER, changes=unsigned), replace(LISTENER, changes=unsigned))),
        ),
        good=Case("Both enclaves have permissions.", TWO),
    )
