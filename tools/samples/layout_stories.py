"""Pairs for KA1, layout and files. What git cannot hold is in made_at_test_time.py."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import IDENTITY_CA, ONE, TALKER_GRANT, with_talker
from .certificates import Certificate
from .documents import Permissions, edited
from .keys import Key
from .layouts import copied, flat
from .store import Enclave, Store, Tree
from .story import Case, Story, pair


def stories() -> Iterator[Story]:
    """All pairs of KA1."""
    yield from pair(
        "KA101",
        bad=Case(
            "The talker's permissions.p7s was never copied to the robot. Under Enforce its nodes do not "
            "start; under Permissive they start without security.",
            with_talker(changes={"permissions.p7s": None}),
        ),
        good=Case("All six files of the talker are there.", ONE),
    )
    yield from pair(
        "KA109",
        bad=Case(
            "The authorities' private keys are in private/: whoever reads a robot's disk could issue identities and "
            "rights for the whole fleet.",
            replace(ONE, private_keys=True),
        ),
        good=Case("The keystore as it should be shipped, without private/.", ONE),
    )
    yield from pair(
        "KA110",
        bad=Case(
            "Somebody removed a right from permissions.xml and did not sign it again: a reviewer reads /chat, the "
            "robot allows /chatter.",
            replace(with_talker(changes={"permissions.xml": _edited_permissions()}), unsigned=True),
        ),
        good=Case("permissions.xml says what permissions.p7s says.", replace(ONE, unsigned=True)),
    )
    yield from pair(
        "KA122",
        bad=Case("The unsigned documents lie beside the signed ones.", replace(ONE, unsigned=True)),
        good=Case("Only what a robot reads is in the tree.", ONE),
    )
    yield from pair(
        "KA111",
        bad=Case(
            "A key.p11 beside key.pem refers to a hardware module. Fast DDS takes its key, Cyclone DDS the file's.",
            with_talker(changes={"key.p11": b"pkcs11:token=robot;object=talker\n"}),
        ),
        good=Case("The key is only the file key.pem.", ONE),
    )
    yield from pair(
        "KA112",
        bad=Case(
            "An enclave was copied without public/ and the shared governance: the next `create_keystore` makes new "
            "authorities.",
            _without_shared(ONE),
        ),
        good=Case("The same copies with public/ and the shared governance.", copied(ONE.tree())),
    )
    yield from pair(
        "KA113",
        bad=Case(
            "The folder is called front-camera. No ROS 2 enclave name has a hyphen, so no node can ask for this "
            "enclave.",
            _one_enclave("/front-camera"),
        ),
        good=Case("The same enclave called front_camera.", _one_enclave("/front_camera")),
    )
    yield from pair(
        "KA115",
        bad=Case(
            "The flat layout of Crystal, Dashing and Eloquent. No supported distribution finds enclaves there, so "
            "nodes under Permissive start without security.",
            flat(ONE),
        ),
        good=Case("The same enclave in the layout since Foxy.", ONE),
    )


def _edited_permissions() -> bytes:
    return edited(Permissions(grants=(TALKER_GRANT,)).xml(), "rt/chatter", "rt/chat").encode()


def _without_shared(store: Store) -> Tree:
    gone = ("public/", "enclaves/governance.p7s")
    return {path: entry for path, entry in copied(store.tree()).items() if not path.startswith(gone)}


def _one_enclave(path: str) -> Store:
    certificate = Certificate(key=Key(label=f"rules {path}"), subject=path, issuer=IDENTITY_CA)
    grant = replace(TALKER_GRANT, path=path)
    enclave = Enclave(path=path, certificate=certificate, permissions=Permissions(grants=(grant,)))
    return replace(ONE, enclaves=(enclave,))
