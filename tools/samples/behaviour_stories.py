"""The TurtleSim with what its multiplexer does declared in settings (`sample_keystores/settings/`)."""

from __future__ import annotations

from collections.abc import Iterator

from .healthy import TURTLESIM, healthy
from .policy import Node
from .story import Story


def stories() -> Iterator[Story]:
    """The samples flows/turtlesim_* about determinism."""
    store = healthy("flow turtlesim", TURTLESIM)
    yield Story(
        directory="flows/turtlesim_fixed_priority",
        text="The multiplexer takes the keyboard's command first: what is sent decides how the turtle moves.",
        tree=store.tree(),
        options=("--settings", "settings/turtlesim_priority.toml"),
    )
    yield Story(
        directory="flows/turtlesim_arrival_order",
        text="The multiplexer takes whichever command comes first: two runs with the same commands differ.",
        tree=store.tree(),
        options=("--settings", "settings/turtlesim_arrival.toml"),
    )
    keyboard = Node(name="keyboard", publish=("high_priority",), subscribe=("joystick",))
    joystick = Node(name="joystick", publish=("joystick",))
    watched = healthy("flow turtlesim", {**TURTLESIM, "/keyboard": keyboard, "/joystick": joystick})
    yield Story(
        directory="flows/turtlesim_joystick",
        text="The keyboard's node reads the joystick, and nobody says what it makes of it: whether the joystick moves "
        "the turtle is unknown.",
        tree=watched.tree(),
        options=("--settings", "settings/turtlesim_joystick.toml"),
    )
