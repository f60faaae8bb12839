"""Pairs for KA121, KA660 to KA669: what is left lying about, what robots are given, and how long it lasts."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import (
    LISTENER,
    LISTENER_CERTIFICATE,
    ONE,
    PERMISSIONS_CA,
    QUIET,
    TALKER_GRANT,
    domain,
    governed,
)
from .certificates import Certificate
from .documents import DISCOVERY, Governance, Grant, Permissions, Rule, edited
from .keys import Key
from .smime import signed_by
from .store import Store
from .story import Case, Story, pair

_WIDE = replace(TALKER_GRANT, rules=(Rule(publish=("rt/*",)), DISCOVERY))


def stories() -> Iterator[Story]:
    """All pairs; KA666, about two keystores, has none, and KA665 and KA667 are made at test time."""
    yield from _unmanaged()
    yield from _given()
    yield from _beside()
    yield from _inside()


def _with(path: str, content: bytes) -> Store:
    """ONE with another file."""
    return replace(ONE, changes={path: content})


def _kept(grant: Grant) -> Store:
    """ONE with permissions that the permissions CA signed and no enclave carries."""
    document = Permissions(grants=(grant,)).xml().encode()
    return _with("old/permissions-2023.p7s", signed_by(PERMISSIONS_CA).smime(document))


def _unmanaged() -> Iterator[Story]:
    yield from pair(
        "KA660",
        bad=Case(
            "The talker's rights were narrowed to /chatter, but its earlier permissions, for every topic, are in "
            "old/ and still valid.",
            _kept(_WIDE),
        ),
        good=Case(
            "The same old permissions have expired, so nobody accepts them.",
            _kept(replace(_WIDE, not_after="2024-01-01T00:00:00")),
        ),
    )
    weaker = Governance(rules=(replace(QUIET, rtps="NONE"),)).xml().encode()
    yield from pair(
        "KA661",
        bad=Case(
            "A governance without message protection, signed for tests, lies beside the current one.",
            _with("enclaves/governance.p7s.test", signed_by(PERMISSIONS_CA).smime(weaker)),
        ),
        good=Case("The only governance is the one in use.", ONE),
    )
    stranger = replace(PERMISSIONS_CA, key=Key(label="rules, another fleet"))
    yield from pair(
        "KA662",
        bad=Case(
            "Another fleet's authority signed permissions that lie in the tree. No peer here accepts them.",
            _with("notes/other-fleet", signed_by(stranger).smime(Permissions(grants=(_WIDE,)).xml().encode())),
        ),
        good=Case("No signed document but those of the enclave.", ONE),
    )
    plain = Permissions(grants=(TALKER_GRANT,)).xml()
    sectioned = edited(plain, "rt/chatter", "rt/<![CDATA[chatter]]>")
    yield from pair(
        "KA663",
        bad=Case(
            "Archived permissions, validly signed, have a CDATA section in a topic's name, which parsers read "
            "differently.",
            _with("archive/2023/permissions.p7s", signed_by(PERMISSIONS_CA).smime(sectioned.encode())),
        ),
        good=Case(
            "The archived permissions without the section say what the talker's own say.",
            _with("archive/2023/permissions.p7s", signed_by(PERMISSIONS_CA).smime(plain.encode() + b"\n")),
        ),
    )


def _given() -> Iterator[Story]:
    yield from pair(
        "KA121",
        bad=Case(
            "The tree still has the policy from which the keystore was made, and a map.",
            replace(ONE, changes={"policy.xml": b"<policy/>\n", "maps/hall.yaml": b"resolution: 0.05\n"}),
        ),
        good=Case(
            "Only what sros2 makes, including unsigned documents.",
            replace(ONE, unsigned=True),
        ),
    )


def _beside() -> Iterator[Story]:
    """A backup of the listener, which this robot does not run any more."""
    kept = {
        "backup/cert.pem": LISTENER_CERTIFICATE.pem(),
        "backup/permissions.p7s": ONE.signed_permissions(LISTENER),
    }
    yield from pair(
        "KA668",
        bad=Case(
            "The listener's folder was moved to backup/, with its key. It is no enclave here any more, but whoever "
            "has the tree can start it.",
            replace(ONE, changes={**kept, "backup/key.pem": LISTENER_CERTIFICATE.key.pem()}),
        ),
        good=Case("The same folder without the private key: nobody can be the listener.", replace(ONE, changes=kept)),
    )


def _inside() -> Iterator[Story]:
    """Another robot's keystore in robot2/, whose authority signed a governance without any protection."""
    authority = Certificate(key=Key(label="rules robot2 CA"), subject="robot2CA", ca=True)
    unprotected = governed(replace(ONE, identity_ca=authority, permissions_ca=authority), domain(rtps="NONE"))
    other = {f"robot2/{path}": entry for path, entry in unprotected.tree().items()}
    yield from pair(
        "KA669",
        bad=Case(
            "Another robot's keystore was unpacked in robot2/. Its governance protects nothing, but no rule says so "
            "here.",
            {**ONE.tree(), **other},
        ),
        good=Case(
            "Only the authority's certificate of the other keystore is kept: nobody can start from it.",
            {**ONE.tree(), **{path: entry for path, entry in other.items() if path.startswith("robot2/public/")}},
        ),
    )
