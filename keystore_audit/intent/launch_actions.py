"""What launch files of every form say, before anything is worked out: actions and texts with substitutions.

`launch_entities` makes these of what the readers of XML, YAML and Python find; `launch` follows them.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Final

from msgspec import Struct

MAX_TEXT: Final = 4096
"""Characters of a text that is worked out: names and paths are shorter, and `$(var x)$(var x)` doubles each time."""

MAX_PARTS: Final = 256
"""Pieces of one text: `x + x` doubles each time."""


class Variable(str, Enum):
    """Where a substitution takes its text from."""

    ARGUMENT = "argument"
    ENVIRONMENT = "environment variable"
    DIRECTORY = "directory of the launch file"


class Reference(Struct, frozen=True, kw_only=True):
    """A substitution that may be worked out: `name` of an argument or variable, `default` where there is one."""

    variable: Variable
    name: Text = ()
    default: Text | None = None


class Unknown(Struct, frozen=True, kw_only=True):
    """A piece of text that only a running launch knows; `reason`: why, words such as "the result of a command"."""

    reason: str


Part = str | Reference | Unknown
Text = tuple[Part, ...]
"""A text in pieces, which join without anything between them."""


def bounded(parts: Iterable[Part]) -> Text:
    """A text of these pieces, strings joined; an Unknown where it is too long."""
    found: list[Part] = []
    for part in parts:
        if isinstance(part, str) and found and isinstance(found[-1], str):
            found[-1] += part
        elif part != "":
            found.append(part)
        if len(found) > MAX_PARTS or (found and isinstance(found[-1], str) and len(found[-1]) > MAX_TEXT):
            return (Unknown(reason=f"a text of more than {MAX_TEXT} characters"),)
    return tuple(found)


class Condition(Struct, frozen=True, kw_only=True):
    """An action happens where `text` is true, or with `negated` where it is false."""

    text: Text
    negated: bool = False


class LaunchAction(Struct, frozen=True, kw_only=True):
    """One element of a launch description; `line`: where it begins. All of `conditions` have to hold."""

    line: int
    conditions: tuple[Condition, ...] = ()


class Declare(LaunchAction, frozen=True, kw_only=True):
    """An argument of the file, which the caller may set; without default the caller has to."""

    name: Text
    default: Text | None


class Assign(LaunchAction, frozen=True, kw_only=True):
    """An argument gets a value, whatever it had; None: it is taken away."""

    name: Text
    value: Text | None


class AssignEnvironment(LaunchAction, frozen=True, kw_only=True):
    """An environment variable gets a value; None: it is taken away."""

    name: Text
    value: Text | None


class PushNamespace(LaunchAction, frozen=True, kw_only=True):
    """Nodes behind it, to the end of the group, are in this namespace."""

    namespace: Text


class Remap(Struct, frozen=True, kw_only=True):
    """A node that would use `source` uses `target`."""

    line: int
    source: Text
    target: Text


class SetRemap(LaunchAction, frozen=True, kw_only=True):
    """The remapping holds for all nodes behind it, to the end of the group."""

    remap: Remap


class Group(LaunchAction, frozen=True, kw_only=True):
    """Actions together; what they set ends with the group if it is `scoped`.

    `forwarding` False: nothing set before reaches into it but `given`, arguments by name. `later`: they come when a
    timer ends or an event happens, in the environment that launch has then.
    """

    actions: tuple[LaunchAction, ...]
    scoped: bool = True
    later: bool = False
    forwarding: bool = True
    given: tuple[tuple[Text, Text], ...] = ()


class Include(LaunchAction, frozen=True, kw_only=True):
    """Another launch file, with values for its arguments; what it sets stays set."""

    path: Text
    arguments: tuple[tuple[Text, Text], ...]


class NodeKind(str, Enum):
    """What is known of a node by how it is started."""

    PLAIN = "plain"
    LIFECYCLE = "lifecycle"
    CONTAINER = "container"


class NodeNames(Struct, frozen=True, kw_only=True):
    """Names of a node, in a process of its own or in another's. `name` None: the program chooses."""

    line: int
    name: Text | None
    namespace: Text | None
    remaps: tuple[Remap, ...]
    conditions: tuple[Condition, ...] = ()


class StartProcess(LaunchAction, frozen=True, kw_only=True):
    """A process, of which it is not known whether it is a node.

    `environment`: beside what there was. `prefix`: what stands before the program, None: what is set for all.
    `command`: what is run, in pieces; of a node, its package and program.
    """

    command: tuple[Text, ...] = ()
    environment: tuple[tuple[Text, Text], ...] = ()
    prefix: Text | None = None


class StartNode(StartProcess, frozen=True, kw_only=True):
    """A process with a node; `components` are loaded into it.

    `arguments`: the words of its command line; `ros_arguments`: those that come behind `--ros-args`.
    """

    kind: NodeKind
    names: NodeNames
    arguments: tuple[Text, ...] = ()
    ros_arguments: tuple[Text, ...] = ()
    components: tuple[NodeNames, ...] = ()


class LoadComponents(LaunchAction, frozen=True, kw_only=True):
    """Nodes that are loaded into a process that runs already: the container called `target`."""

    target: Text
    components: tuple[NodeNames, ...]


class Unread(LaunchAction, frozen=True, kw_only=True):
    """Something that may start nodes or change what others are; `reason` says what it is, words.

    `speaks`: a word of security that stands in it (`launch_environment.speaks_of`); empty: none.
    """

    reason: str
    speaks: str = ""
