"""What expressions of a Python launch file stand for; which element of XML a class of launch is (Humble to Rolling)."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from keystore_audit.intent.launch_actions import Text, Unknown, bounded
from keystore_audit.intent.launch_entities import Entity

_NAMED: Final = {"name": "name", "node_name": "name", "namespace": "namespace", "node_namespace": "namespace"}
_STARTED: Final = {
    "package": "pkg",
    "executable": "exec",
    "node_executable": "exec",
    "prefix": "launch-prefix",
} | _NAMED
FIRST: Final = (
    "variable_name",
    "name",
    "text",
    "launch_file_path",
    "substitutions",
    "predicate_expression",
    "initial_entities",
)
"""What the first argument of a class is called that is no element."""

SOURCES: Final = frozenset(f"{form}LaunchDescriptionSource" for form in ("Python", "XML", "YAML", "Any", "Frontend"))

CLASSES: Final[Mapping[str, tuple[str, Mapping[str, str], tuple[str, ...]]]] = {
    "DeclareLaunchArgument": ("arg", {"name": "name", "default_value": "default"}, ("name",)),
    "SetLaunchConfiguration": ("let", {"name": "name", "value": "value"}, ("name", "value")),
    "SetEnvironmentVariable": ("set_env", {"name": "name", "value": "value"}, ("name", "value")),
    "AppendEnvironmentVariable": ("append_env", {"name": "name", "value": "value"}, ("name", "value")),
    "UnsetEnvironmentVariable": ("unset_env", {"name": "name"}, ("name",)),
    "SetRemap": ("set_remap", {"src": "from", "dst": "to"}, ("from", "to")),
    "PushRosNamespace": ("push_ros_namespace", {"namespace": "namespace"}, ("namespace",)),
    "PushROSNamespace": ("push_ros_namespace", {"namespace": "namespace"}, ("namespace",)),
    "GroupAction": ("group", {"actions": ""}, ()),
    "TimerAction": ("timer", {"period": "", "actions": ""}, ()),
    "IncludeLaunchDescription": ("include", {"launch_description_source": "file"}, ("file",)),
    "Node": ("node", _STARTED, ("exec",)),
    "LifecycleNode": ("lifecycle_node", _STARTED, ("exec",)),
    "ComposableNodeContainer": ("node_container", _STARTED, ("exec",)),
    "ComposableNode": ("composable_node", {"plugin": "plugin"} | _NAMED, ("plugin",)),
    "LoadComposableNodes": ("load_composable_node", {"target_container": "target"}, ("target",)),
    "ExecuteProcess": ("executable", {"cmd": "cmd", "prefix": "launch-prefix"}, ()),
    **dict.fromkeys(("LogInfo", "SetParameter", "SetParametersFromFile", "SetUseSimTime"), ("log", {"msg": ""}, ())),
    **dict.fromkeys(("OnProcessExit", "OnProcessStart", "OnShutdown"), ("timer", {}, ())),
    "RegisterEventHandler": ("timer", {"event_handler": ""}, ()),
}
"""By class: the element that it is, attributes by argument (in order of position), and those that it has to have."""

WITHIN: Final = {"actions", "on_exit", "on_start", "on_shutdown", "event_handler", "composable_node_descriptions"}
"""Arguments that hold elements; `on_...` those that come later."""

PAIRS: Final = {
    "remappings": ("remap", "from", "to"),
    "launch_arguments": ("arg", "name", "value"),
    "launch_configurations": ("keep", "name", "value"),
    "additional_env": ("env", "name", "value"),
}
"""Arguments that hold pairs, and what each of those is."""

RUN_ONLY: Final = {
    "FindPackageShare": "find-pkg-share",
    "FindPackagePrefix": "find-pkg-prefix",
    "FindExecutable": "find-exec",
    "Command": "command",
    "PythonExpression": "eval",
}
"""Substitutions that only a running launch works out, as XML calls them."""


class Imported(NamedTuple):
    """A module, class or function of another module, with dots."""

    path: str


class Condition(NamedTuple):
    """`if` or `unless`, and the text."""

    word: str
    text: Text


Value = Text | list["Value"] | dict[str, "Value"] | Entity | Imported | Condition | bool | int | float | None
"""A tuple is a text. A list may grow while statements are followed; what is part of something else may not."""

LOST: Final[Text] = (Unknown(reason="what only running the file works out"),)


def unknown(reason: str) -> Text:
    """A text that only a running launch knows."""
    return (Unknown(reason=reason),)


def text_of(value: Value) -> Text:
    """What launch makes of a value where it wants a text: of a list, its pieces joined."""
    if isinstance(value, list):
        return bounded(part for each in value for part in text_of(each))
    if isinstance(value, tuple) and not isinstance(value, (Imported, Condition)):
        return value
    if isinstance(value, (bool, int, float)):
        return (str(value),)
    return unknown("a value that is no text")


def path_of(parts: Iterable[Text]) -> Text:
    """Paths below each other; one that may be absolute puts those before it away."""
    whole: Text = ()
    for number, text in enumerate(parts):
        first = text[0] if text else ""
        if number and not isinstance(first, str):
            return unknown("a path that may be absolute")
        whole = text if not number or str(first).startswith("/") else bounded((*whole, "/", *text))
    return whole


def words_of(value: Value) -> Text:
    """A command line; what is no list may be any number of words."""
    if not isinstance(value, list):
        return text_of(value)
    words = ((shlex.quote(part) if isinstance(part, str) else part for part in text_of(each)) for each in value)
    return bounded(part for word in words for part in (*word, " "))
