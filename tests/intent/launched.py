"""What launch tests look at: the names in an intent without their places, and files to launch."""

from __future__ import annotations

import textwrap
from pathlib import Path

from keystore_audit.intent.intent import Intent
from keystore_audit.intent.launch import read_launch


def launch(folder: Path, text: str, form: str = "xml", **arguments: str) -> Intent:
    """Read `text` as a launch file; XML gets its root element, Python its function."""
    if form == "xml":
        text = f"<launch>{text}</launch>"
    path = folder / f"some.launch.{form}"
    path.write_text(textwrap.dedent(text), "utf-8")
    return read_launch(path, arguments)


def described(text: str) -> str:
    """A Python launch file that returns a description of `text`, which may use all classes by their names."""
    return f"""{IMPORTS}

def generate_launch_description():
    return LaunchDescription([{textwrap.dedent(text)}])
"""


IMPORTS = """
import os
import pathlib
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.actions import RegisterEventHandler, SetEnvironmentVariable, SetLaunchConfiguration, TimerAction
from launch.actions import ExecuteLocal
from launch.descriptions import Executable
from launch.conditions import IfCondition, LaunchConfigurationEquals, UnlessCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import Command, EnvironmentVariable, EqualsSubstitution, LaunchConfiguration
from launch.substitutions import PathJoinSubstitution, PythonExpression, ThisLaunchFileDir
from launch_ros.actions import ComposableNodeContainer, LifecycleNode, LoadComposableNodes, Node, PushRosNamespace
from launch_ros.actions import SetRemap
from launch_ros.descriptions import ComposableNode
from launch_ros.substitutions import FindPackageShare
"""


NODE = 'Node(package="p", executable="e", name="{}", ros_arguments=["-e", "/x"]{})'
PLAIN = NODE.format("n", "")


def function(body: str, before: str = "") -> str:
    """A launch file whose function has these statements."""
    lines = "\n".join(f"    {line}" for line in body.strip().splitlines())
    return f"{IMPORTS}\n{before}\n\ndef generate_launch_description():\n{lines}\n"


def nodes(intent: Intent) -> set[tuple[str, str]]:
    """(enclave, full name) of each node whose name is known."""
    return {(node.enclave, node.name) for node in intent.nodes if node.name}


def names(intent: Intent) -> set[tuple[str, str, str]]:
    """(enclave, node, name) of each used name."""
    return {(used.enclave, used.node, used.name) for used in intent.names}


def unresolved(intent: Intent) -> list[tuple[int | None, str]]:
    """Line and reason of all that was not worked out."""
    return [(place.location.line, place.reason) for place in intent.unresolved]
