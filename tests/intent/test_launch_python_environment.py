"""Python launch files: where they may change the variables that decide about security."""

from __future__ import annotations

from pathlib import Path

import pytest

from keystore_audit.intent.intent import Intent
from keystore_audit.intent.launch_environment import NAMES, OVERRIDE
from tests.intent.launched import PLAIN, described, function, launch

ENABLE = "'ROS_SECURITY_ENABLE'"
NO = f"Node(executable='e', additional_env={{{ENABLE}: 'no'}})"
SURE = f"SetEnvironmentVariable({ENABLE}, 'true')"


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
        ("with mock.patch.dict(os.environ, clear=True):\n    other()", False),
        ("other.change(os.environ)", True),
        ("libc.setenv(b'ROS_SECURITY_ENABLE', b'no', 1)", True),
        ("vars(os)['environ'].clear()", True),
        ("os.environ |= {'A': 'b'}", True),
        ("os.environ['A'] = 'b'\nos.environ.pop('A')", False),
        (f"x = os.environ[{ENABLE}] + os.environ.get({ENABLE}) + os.getenv({ENABLE})", False),
        (f"x = {{**os.environ, 'A': 'b'}}\ny = dict(os.environ)\nz = {ENABLE} in os.environ", False),
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
        (f"k = {{{ENABLE}: 'no'}}\nother = Node(additional_env=k)", "", False),
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
        ("", "Other(EnvironmentVariable(name='ROS_SECURITY_ENABLE'))", False),
        (f"def other(c):\n    'As ROS_SECURITY_ENABLE=no.'\n    return os.environ.get({ENABLE})", "", False),
        (f"def other(c):\n    return os.environ[{ENABLE}] == {ENABLE} != os.getenv({ENABLE})", "", False),
    ],
)
def test_code_that_is_not_followed_is_open_where_it_speaks_of_security(
    before: str, more: str, expected: bool, tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(f"return LaunchDescription([{PLAIN}, {more}])", before), "py")
    assert speaks(intent) is expected
    assert {each.location.path for each in intent.speaking} <= {intent.path}


@pytest.mark.parametrize(
    ("statements", "given", "told"),
    [
        ("e = os.environ.copy()\ne['A'] = 'b'", "env=e", {}),
        ("e = dict(os.environ, A='b')", "env=e", {}),
        ("e = {**os.environ, 'A': 'b'}", "additional_env=e", {}),
        ("", "env=os.environ", {}),
        ("e = {'A': 'b'}", "env=e", dict.fromkeys(NAMES, "")),
        (f"e = os.environ.copy()\ne[{ENABLE}] = 'no'", "env=e", {ENABLE: "no"}),
        (f"e = os.environ.copy()\ne[{ENABLE}] = other", "env=e", {ENABLE: None}),
        ("e = dict(os.environ, ROS_SECURITY_ENABLE='no')", "env=e", {ENABLE: "no"}),
        (f"e = {{{ENABLE}: 'true', **os.environ}}", "env=e", dict.fromkeys(NAMES)),
        ("e = os.environ.copy()\ne.clear()", "env=e", dict.fromkeys(NAMES)),
        ("def e():\n    return {'A': 'b'}", "additional_env=e()", dict.fromkeys(NAMES)),
        ("import other", "additional_env=other.e", dict.fromkeys(NAMES)),
        ("", "env={k: v for k, v in other.items()}", dict.fromkeys(NAMES)),
        ("", "additional_env={'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID', '0')}", {}),
        ("", "additional_env={'ROS_DOMAIN_ID': os.environ['OTHER']}", {"ROS_DOMAIN_ID": None}),
        ("", "additional_env={'ROS_DOMAIN_ID': os.getenv('ROS_DOMAIN_ID', '7')}", {"ROS_DOMAIN_ID": None}),
        ("", f"additional_env={{{ENABLE}: EnvironmentVariable({ENABLE}, default_value='false')}}", {}),
    ],
)
def test_a_copy_of_the_environment_has_what_there_was_and_another_is_not_known(
    statements: str, given: str, told: dict[str, str | None], tmp_path: Path
) -> None:
    node = f"Node(executable='e', name='n', {given})"
    intent = launch(tmp_path, function(f"{statements}\nreturn LaunchDescription([{node}])"), "py")
    found = {each.name: each.value for each in intent.variables}
    assert found == {name.strip("'"): value for name, value in told.items() if name != OVERRIDE}


@pytest.mark.parametrize(("default", "told"), [("", {}), (", '0'", {}), (", '7'", {"ROS_DOMAIN_ID": None})])
def test_a_variable_that_is_set_to_itself_is_what_it_was(
    default: str, told: dict[str, str | None], tmp_path: Path
) -> None:
    action = f"SetEnvironmentVariable('ROS_DOMAIN_ID', os.environ.get('ROS_DOMAIN_ID'{default}))"
    intent = launch(tmp_path, function(f"return LaunchDescription([{action}, {PLAIN}])"), "py")
    assert {each.name: each.value for each in intent.variables} == told


def test_a_copy_of_the_environment_has_not_what_actions_set(tmp_path: Path) -> None:
    node = "Node(executable='e', name='n', env=dict(os.environ))"
    for first, value in ((SURE, {None}), ("SetEnvironmentVariable('A', 'b')", set[str | None]())):
        intent = launch(tmp_path, described(f"{first}, {node}"), "py")
        assert {each.value for each in intent.variables if each.node == "/n"} == value


def test_processes_without_a_name_are_told_apart_by_what_they_run(tmp_path: Path) -> None:
    off = "additional_env={'ROS_SECURITY_ENABLE': 'no'}"

    def started(action: str) -> set[str]:
        return {each.started for each in launch(tmp_path, described(action), "py").variables}

    one, other = (started(f"ExecuteProcess(cmd=['{run}'], {off})") for run in ("date", "talker"))
    assert len(one) == len(other) == len(one | other) - 1 == 1
    one, other = (started(f"Node(package='p', executable='{run}', {off})") for run in ("date", "talker"))
    assert len(one) == len(other) == len(one | other) - 1 == 1
