"""Healthy keystores: an authority for each role; every enclave may do what its nodes need and no more."""

from __future__ import annotations

from collections.abc import Iterator

from .certificates import Certificate
from .documents import Permissions
from .keys import Key
from .layouts import flat
from .policy import Node, grant
from .store import Enclave, Store
from .story import Story


def authority(store: str, role: str) -> Certificate:
    """A CA for `role` in the sample `store`, as sros2 would make it but for its name and its dates."""
    return Certificate(key=Key(label=f"{store} {role} CA"), subject=f"{role}CA", ca=True, path_length=1)


def healthy(name: str, nodes: dict[str, Node], **fields: object) -> Store:
    """A keystore with one enclave for each entry of `nodes`."""
    identity_ca = authority(name, "identity")
    enclaves = tuple(
        Enclave(
            path=path,
            certificate=Certificate(key=Key(label=f"{name} {path}"), subject=path, issuer=identity_ca),
            permissions=Permissions(grants=(grant(path, node),)),
        )
        for path, node in nodes.items()
    )
    return Store(
        identity_ca=identity_ca,
        permissions_ca=authority(name, "permissions"),
        enclaves=enclaves,
        unsigned=True,
        **fields,  # type: ignore[arg-type]
    )


TALKER_LISTENER = {
    "/talker": Node(name="talker", publish=("chatter",)),
    "/listener": Node(name="listener", subscribe=("chatter",)),
}

TURTLESIM = {
    "/multiplexer": Node(name="multiplexer", subscribe=("high_priority", "low_priority"), publish=("move_turtle",)),
    "/turtlesim": Node(name="turtlesim", subscribe=("move_turtle",)),
    "/keyboard": Node(name="keyboard", publish=("high_priority",)),
    "/random": Node(name="random", publish=("low_priority",)),
}

VEHICLE = {
    "/infotainment": Node(name="infotainment", subscribe=("vehicle_state",), publish=("media_state",)),
    "/telematics": Node(name="telematics", subscribe=("vehicle_state", "media_state")),
    "/gateway": Node(name="gateway", subscribe=("brake_state", "motor_state"), publish=("vehicle_state",)),
    "/brake": Node(name="brake", subscribe=("motor_state",), publish=("brake_state", "motor_limit")),
    "/motor": Node(name="motor", subscribe=("motor_limit",), publish=("motor_state",)),
}

SERVICE_ACTION = {
    "/add_two_ints/server": Node(name="add_two_ints_server", reply=("add_two_ints",)),
    "/add_two_ints/client": Node(name="add_two_ints_client", request=("add_two_ints",)),
    "/fibonacci/server": Node(name="fibonacci_server", execute=("fibonacci",)),
    "/fibonacci/client": Node(name="fibonacci_client", call=("fibonacci",)),
}

DASHING = {
    "/talker": Node(name="talker", publish=("chatter",)),
    "/robot1/listener": Node(name="listener", namespace="/robot1", subscribe=("/chatter",)),
}


def stories() -> Iterator[Story]:
    """All healthy samples."""
    yield Story(
        directory="healthy/talker_listener",
        text=(
            "The talker publishes /chatter, the listener subscribes to it, and each has the parameter services, log "
            "and clock that every node needs. Separate authorities sign identities and documents; their private keys "
            "are kept elsewhere."
        ),
        tree=healthy("talker_listener", TALKER_LISTENER).tree(),
    )
    yield Story(
        directory="healthy/turtlesim",
        text=(
            "The turtle obeys /move_turtle, which the multiplexer makes of the keyboard's /high_priority and the "
            "random walker's /low_priority. Neither moves the turtle otherwise. As sros2 leaves them, the "
            "authorities' keys are in private/: a note here, critical on a robot."
        ),
        tree=healthy("turtlesim", TURTLESIM, private_keys=True).tree(),
    )
    yield Story(
        directory="healthy/vehicle",
        text=(
            "Brake and motor control each other. The gateway passes their state on to infotainment and telematics, "
            "and reads nothing from infotainment, so nothing of that reaches the motor."
        ),
        tree=healthy("vehicle", VEHICLE).tree(),
    )
    yield Story(
        directory="healthy/service_action",
        text="A service and an action, each with a server and a client. On DDS a service is two topics "
        "and an action eight; each side may write its own half and read the other's.",
        tree=healthy("service_action", SERVICE_ACTION).tree(),
    )
    yield Story(
        directory="healthy/dashing_flat",
        text=(
            "The flat layout of Crystal to Eloquent: a folder for each node, copies instead of links, a readable "
            "dump before the certificates. Only its age is wrong."
        ),
        tree=flat(healthy("dashing_flat", DASHING)),
    )
