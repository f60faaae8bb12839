"""Python launch files: where they may change the variables that decide about security."""

from __future__ import annotations

from pathlib import Path

import pytest

from keystore_audit.intent.intent import Intent
from tests.intent.launched import PLAIN, described, function, launch

ENABLE = "'ROS_SECURITY_ENABLE'"
NO = f"Node(executable='e', additional_env={{{ENABLE}: 'no'}})"


def speaks(intent: Intent) -> bool:
    """Whether something of the file leaves open what its processes start with."""
    return bool(intent.speaking)


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        (f"os.environ[{ENABLE}] = 'no'", True),
        (f"if other():\n    os.environ[{ENABLE}] = other()", True),
        (f"def later(context):\n    context.environment[{ENABLE}] = 'no'", True),
        (f"del os.environ[{ENABLE}]", True),
        (f"os.environ.pop({ENABLE}, None)", True),
        (f"x = os.environ.setdefault({ENABLE}, 'no')", True),
        ("os.environ.update(other)", True),
        ("os.putenv('A', 'b')", True),
        ("from os import environ\nenviron.update(other)", True),
        ("from os import environ as e", True),
        ("e = os.environ\nx = e['B']", True),
        ("os.environ.clear()", True),
        ("from dotenv import load_dotenv\nload_dotenv()", True),
        ("os.environ[other] = 'x'", True),
        ("getattr(os, 'environ').clear()", True),
        ("with mock.patch.dict('os.environ', clear=True):\n    other()", True),
        ("with mock.patch.dict(os.environ, clear=True):\n    other()", True),
        ("other.change(os.environ)", True),
        ("libc.setenv(b'ROS_SECURITY_ENABLE', b'no', 1)", True),
        ("vars(os)['environ'].clear()", True),
        ("os.environ |= {'A': 'b'}", True),
        ("os.environ['A'] = 'b'", False),
        ("os.environ.pop('A')", True),
        (f"x = os.environ[{ENABLE}] + os.environ.get({ENABLE}) + os.getenv({ENABLE})", True),
        ("x = os.environ['A'] + os.environ.get('A') + os.getenv('A')", False),
        ("x = {**os.environ, 'A': 'b'}", True),
        ("x = 'A' in os.environ", False),
        ("path = tempfile.mktemp(prefix='x')", False),
        ("if os.getenv('ROS_DISTRO') == 'humble':\n    x = 1", False),
    ],
)
def test_what_a_file_makes_of_its_environment_leaves_open_what_processes_start_with(
    statement: str, expected: bool, tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(f"{statement}\nreturn LaunchDescription([{PLAIN}])"), "py")
    assert speaks(intent) is expected


@pytest.mark.parametrize(
    ("before", "more", "expected"),
    [
        (f"def other(context):\n    return [{NO}]", "OpaqueFunction(function=other)", True),
        (f"def other(context):\n    e = {{}}\n    e[{ENABLE}] = 'no'", "OpaqueFunction(function=other)", True),
        ("def other(context):\n    return dict(ROS_SECURITY_ENABLE='no')", "", True),
        ("", f"OpaqueFunction(function=lambda c: [SetEnvironmentVariable({ENABLE}, 'no')])", True),
        ("", f"*[{NO} for i in range(2)]", True),
        ("", "*[Node(executable='e', prefix='nice') for i in range(2)]", False),
        ("", "*[Node(executable='e', prefix='env RMW_IMPLEMENTATION=x') for i in range(2)]", True),
        (f"k = {{'additional_env': {{{ENABLE}: 'no'}}}}", "Node(executable='e', **k)", True),
        (f"k = {{}}\nk['additional_env'] = {{{ENABLE}: 'no'}}", "Node(executable='e', **k)", True),
        (f"k = {{'additional_env': {{{ENABLE}: 'no'}}}}", "Node(executable='e', **{})", False),
        (f"k = {{{ENABLE}: 'no'}}\ndef other(c):\n    return [Node(additional_env=k)]", "", True),
        (f"k = {{{ENABLE}: 'no'}}\nother = Node(executable='e', additional_env=k)", "", False),
        (f"k = {{{ENABLE}: 'no'}}\nother = Node(additional_env=k)", "", True),
        (f"k = {ENABLE}\ndef other(c):\n    return [SetEnvironmentVariable(k, 'no')]", "", True),
        ("def other(c):\n    return [SetEnvironmentVariable('A', 'no')]", "", False),
        ("def other(c):\n    return list(map(SetEnvironmentVariable, c, c))", "", True),
        ("def other(c):\n    return ReplaceEnvironmentVariables({'A': 'b'})", "", True),
        ("def other(c):\n    return Node(env={'PATH': 'x'})", "", True),
        ("def other(c):\n    return Node(env=None)", "", False),
        ("def other(c):\n    return Node(additional_env={'A': c()})", "", False),
        ("def other(c):\n    return Node(additional_env=c)", "", True),
        ("def other(c, e):\n    return Node(additional_env={f'ROS_SECURITY_{e}': 'no'})", "", True),
        ("def other(c):\n    return Node(arguments=['--enclave', c])", "", True),
        ("def other(c):\n    return Node(arguments=['--log', c])", "", False),
        ("", "ExecuteProcess(cmd=['env', 'ROS_SECURITY_ENABLE=no', 'e'] + other)", True),
        ("", f"Other(additional_env={{{ENABLE}: 'true'}})", True),
        ("", "Other(EnvironmentVariable(name='ROS_SECURITY_ENABLE'))", True),
        ("def other(c):\n    'As ROS_SECURITY_ENABLE=no.'\n    return os.environ.get('A')", "", False),
        (f"def other(c):\n    return os.getenv({ENABLE})", "", True),
    ],
)
def test_code_that_is_not_followed_is_open_where_it_speaks_of_security(
    before: str, more: str, expected: bool, tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(f"return LaunchDescription([{PLAIN}, {more}])", before), "py")
    assert speaks(intent) is expected
    assert {each.location.path for each in intent.speaking} <= {intent.path}


@pytest.mark.parametrize(
    "given",
    ["env=os.environ", "env={'A': 'b'}", "env=other()", "additional_env=other.e", "additional_env={**os.environ}"],
)
def test_an_environment_made_elsewhere_is_not_known(given: str, tmp_path: Path) -> None:
    node = f"Node(executable='e', name='n', {given})"
    assert speaks(launch(tmp_path, function(f"return LaunchDescription([{node}])"), "py"))


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("'no'", {"ROS_SECURITY_ENABLE": "no"}),
        ("other", {"ROS_SECURITY_ENABLE": None}),
        (f"EnvironmentVariable({ENABLE}, default_value='false')", {"ROS_SECURITY_ENABLE": None}),
        (f"os.environ.get({ENABLE}, 'true')", {"ROS_SECURITY_ENABLE": None}),
    ],
)
def test_what_a_node_is_given_is_told(value: str, told: dict[str, str | None], tmp_path: Path) -> None:
    node = f"Node(executable='e', name='n', additional_env={{{ENABLE}: {value}}})"
    intent = launch(tmp_path, function(f"return LaunchDescription([{node}])"), "py")
    assert {each.name: each.value for each in intent.variables if each.node == "/n"} == told


def test_processes_without_a_name_are_told_apart_by_what_they_run(tmp_path: Path) -> None:
    off = "additional_env={'ROS_SECURITY_ENABLE': 'no'}"

    def started(action: str) -> set[str]:
        return {each.started for each in launch(tmp_path, described(action), "py").variables}

    one, other = (started(f"ExecuteProcess(cmd=['{run}'], {off})") for run in ("date", "talker"))
    assert len(one) == len(other) == len(one | other) - 1 == 1
    one, other = (started(f"Node(package='p', executable='{run}', {off})") for run in ("date", "talker"))
    assert len(one) == len(other) == len(one | other) - 1 == 1
