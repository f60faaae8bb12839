"""Python launch files: what they make of the variables that decide about security."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from keystore_audit.intent import python_environment
from keystore_audit.intent.environment import STRATEGY
from keystore_audit.intent.launch_environment import NAMES, OVERRIDE
from tests.intent.launched import PLAIN, described, function, launch

ENABLE = "'ROS_SECURITY_ENABLE'"
ANY = dict.fromkeys(set(NAMES) - {OVERRIDE})


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        (f"os.environ[{ENABLE}] = 'no'", {ENABLE: "no"}),
        (f"os.environ[{ENABLE}] = 'no'\nos.environ[{ENABLE}] = 'true'", {ENABLE: None}),
        (f"if other():\n    os.environ[{ENABLE}] = other()", {ENABLE: None}),
        (f"def later(context):\n    context.environment[{ENABLE}] = 'no'", {ENABLE: "no"}),
        (f"del os.environ[{ENABLE}]", {ENABLE: None}),
        (f"os.environ.pop({ENABLE}, None)", {ENABLE: None}),
        (f"x = os.environ.setdefault({ENABLE}, 'no')", {ENABLE: None}),
        (f"os.environ.update({{{ENABLE}: 'no', 'A': 'b'}}, C='d')", {ENABLE: None}),
        ("os.environ.update(ROS_SECURITY_ENABLE='no')", {ENABLE: None}),
        (f"os.putenv({ENABLE}, 'no')", {ENABLE: None}),
        ("from os import environ\nenviron.update(other)", ANY),
        ("from os import environ as e", ANY),
        ("e = os.environ\nx = e.get('A') or e['B']", {}),
        (f"e = os.environ\ne[{ENABLE}] = 'no'", {ENABLE: "no"}),
        (f"e = os.environ\ndef f(c):\n    e.pop({ENABLE})", {ENABLE: None}),
        ("e = os.environ\ne.clear()", ANY),
        ("e = os.environ\nf = e", ANY),
        ("os.environ.clear()", ANY),
        ("from dotenv import load_dotenv\nload_dotenv()", ANY),
        ("os.environ[other] = 'x'", ANY),
        ("getattr(os, 'environ').clear()", ANY),
        ("with mock.patch.dict('os.environ', clear=True):\n    other()", ANY),
        ("with mock.patch.dict(os.environ, clear=True):\n    other()", ANY),
        ("other.change(os.environ)", ANY),
        ("libc.setenv(b'ROS_SECURITY_ENABLE', b'no', 1)", ANY),
        ("x = other.Reader(os.environ)\njson.dumps(copy.copy(os.environ))\nprint(os.environ)", {}),
        ("def f(e):\n    e.clear()\nf(os.environ)", ANY),
        ("def f(e):\n    print(e['A'])\nf(os.environ)", {}),
        ("for k, v in {'A': 'b', 'C': other()}.items():\n    os.environ[k] = v", {}),
        (f"d = {{{ENABLE}: 'b'}}\nfor k, v in d.items():\n    os.environ[k] = v", {ENABLE: None}),
        ("for k in ('A', 'B'):\n    os.environ.pop(k, None)", {}),
        ("d = {'A': 'b'}\nd[other] = 'c'\nfor k, v in d.items():\n    os.environ[k] = v", ANY),
        ("for k, v in {'A': other()}.items():\n    os.environ[v] = k", ANY),
        ("for k in ('A', 'B'):\n    k += 'C'\n    os.environ[k] = ''", ANY),
        ("for k in ('A', 'B'):\n    print(k)\ndef f(k):\n    os.environ[k] = ''", ANY),
        ("for k in ('A', other):\n    del os.environ[k]", ANY),
        ("n = ['A']\nprint(n.index('A'), 'B' in n)\nfor k in n:\n    del os.environ[k]", {}),
        ("n = ['A']\nn.append(other)\nfor k in n:\n    del os.environ[k]", ANY),
        ("n = ['A']\nm = n\nm += other\nfor k in n:\n    del os.environ[k]", ANY),
        ("n = ['A']\nother(more=n)\nfor k in n:\n    del os.environ[k]", ANY),
        ("try:\n    from other import n\nexcept E:\n    n = ['A']\nfor k in n:\n    del os.environ[k]", ANY),
        ("for k in ['A']:\n    pass\nfrom other import k\ndel os.environ[k]", ANY),
        ("import copy\ne = copy.copy(os.environ)\ne['A'] = 'b'", {}),
        ("e = copy.copy(os.environ)\ne.update(other)", ANY),
        ("vars(os)['environ'].clear()", ANY),
        ("def f(*e):\n    e[0].clear()\nf(os.environ)", ANY),
        ("f = other.change\nf(os.environ)", ANY),
        ("from other import join\njoin(os.environ)", ANY),
        ("os.environ |= {'A': 'b'}", ANY),
        ("os.environ['A'] = 'b'\nos.environ.update({'A': 'b'})\nos.environ.pop('A')\nos.unsetenv('A')", {}),
        (f"x = os.environ[{ENABLE}] + os.environ.get({ENABLE}) + os.getenv({ENABLE})", {}),
        (f"x = {{**os.environ, 'A': 'b'}}\ny = dict(os.environ)\nz = {ENABLE} in os.environ", {}),
    ],
)
def test_what_a_file_makes_of_its_environment_every_process_has(
    statement: str, expected: dict[str, str | None], tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(f"{statement}\nreturn LaunchDescription([{PLAIN}])"), "py")
    found = {each.name: each.value for each in intent.variables if each.node == "/n"}
    assert found == {name.strip("'"): value for name, value in expected.items()}


NO = f"Node(executable='e', additional_env={{{ENABLE}: 'no'}})"


@pytest.mark.parametrize(
    ("before", "more", "named"),
    [
        (f"def other(context):\n    return [{NO}]", "OpaqueFunction(function=other)", True),
        (f"def other(context):\n    e = {{}}\n    e[{ENABLE}] = 'no'", "OpaqueFunction(function=other)", True),
        ("def other(context):\n    return dict(ROS_SECURITY_ENABLE='no')", "Node(additional_env=other())", True),
        ("", f"OpaqueFunction(function=lambda c: [SetEnvironmentVariable({ENABLE}, 'no')])", True),
        ("", f"*[{NO} for i in range(2)]", True),
        (f"k = {{'additional_env': {{{ENABLE}: 'no'}}}}", "Node(executable='e', **k)", True),
        (f"k = {{}}\nk['additional_env'] = {{{ENABLE}: 'no'}}", "Node(executable='e', **k)", True),
        ("", f"Node(executable='e', **{{'additional_env': {{{ENABLE}: 'no'}}}})", True),
        (f"k = {{'additional_env': {{{ENABLE}: 'no'}}}}", "Node(executable='e', **{})", False),
        ("", "*[Node(executable='e', prefix='env ROS_SECURITY_ENABLE=no') for i in range(2)]", True),
        ("", "*[Node(executable='e', prefix='env -u ROS_SECURITY_ENABLE') for i in range(2)]", True),
        ("", "*[Node(executable='e', prefix='nice') for i in range(2)]", False),
        (f"k = {{{ENABLE}: 'no'}}\ndef other(c):\n    return [Node(additional_env=k)]", "", True),
        (f"k = {{{ENABLE}: 'no'}}\nother = Node(additional_env=k)", "", False),
        (f"k = {ENABLE}\ndef other(c):\n    return [SetEnvironmentVariable(k, 'no')]", "", True),
        ("", "ExecuteProcess(cmd='env ROS_SECURITY_ENABLE=no e'.split())", True),
        ("", "ExecuteProcess(cmd=['env', 'ROS_SECURITY_ENABLE=no', 'e'] + other)", True),
        ("", f"Other(additional_env={{{ENABLE}: 'no'}})", True),
        ("", f"Other(additional_env={{{ENABLE}: 'true'}})", False),
        ("", "Other(EnvironmentVariable(name='ROS_SECURITY_ENABLE'))", False),
        (f"k = other({NO})", "", True),
        (f"def other(context):\n    'As ROS_SECURITY_ENABLE=no.'\n    return os.environ.get({ENABLE})", "", False),
        (f"def other(context):\n    return os.environ[{ENABLE}] == {ENABLE} != os.getenv({ENABLE})", "", False),
        ("def other(context):\n    raise ValueError('ROS_SECURITY_ENABLE has to be true')", "", False),
    ],
)
def test_a_variable_that_is_named_where_nothing_is_followed_is_not_known(
    before: str, more: str, named: bool, tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(f"return LaunchDescription([{PLAIN}, {more}])", before), "py")
    found = {each.name: each.value for each in intent.variables if each.node == "/n"}
    assert found == ({ENABLE.strip("'"): None} if named else {})


SURE = f"SetEnvironmentVariable({ENABLE}, 'true')"
LATER = "def other(context):\n    "


@pytest.mark.parametrize(
    ("before", "arguments", "body", "named"),
    [
        ("", "c", "return Node(env={'PATH': os.environ['PATH']})", True),
        ("", "c", "return Node(env={**os.environ, 'A': os.environ['B']})", False),
        ("", "c", "return Node(env={k: os.environ[k] for k in ('A', 'B')})", True),
        ("", "c", "e = os.environ.copy()\n    e.clear()\n    return Node(env=e)", True),
        ("", "c", "e = os.environ.copy()\n    e.pop('A')\n    return Node(env=e)", False),
        ("", "c", "k = {'env': {'A': 'b'}}\n    return Node(**k)", True),
        ("", "c", "return ReplaceEnvironmentVariables({'A': 'b'})", True),
        ("", "c", "return ReplaceEnvironmentVariables(os.environ)", False),
        ("from x import e", "c", "return Node(additional_env=e)", True),
        ("from x import e", "c", "return Node(additional_env={'A': e()})", False),
        ("import x", "c", "return [SetEnvironmentVariable(k, 'no') for k in x.load()]", True),
        ("", "c", "return [SetEnvironmentVariable(k, 'no') for k in ('A', 'B')]", False),
        ("", "c, e", "return [SetEnvironmentVariable(e, 'no')]", True),
        ("", "c, e='A'", "return [SetEnvironmentVariable(e, 'no')]", False),
        ("", "c", "k = {'name': 'A', 'value': 'b'}\n    return [SetEnvironmentVariable(**k)]", False),
        ("from x import k", "c", "return [SetEnvironmentVariable(**k)]", True),
        ("from x import k", "c", "return [functools.partial(SetEnvironmentVariable, k)('no')]", True),
        ("from x import k", "c", "return list(map(launch.actions.SetEnvironmentVariable, k, k))", True),
        ("", "c", "return [e for e in c if not isinstance(e, SetEnvironmentVariable)]", False),
        ("", "c", "k = {}\n    k['env'] = {}\n    return [Node(**k)]", True),
        ("", "c", "k = {}\n    k['env'] = dict(os.environ)\n    return [Node(**k)]", False),
        ("", "c", "k = {}\n    k.setdefault('env', {})\n    return [Node(**k)]", True),
        ("", "c, e='ENABLE'", "return Node(additional_env={f'ROS_SECURITY_{e}': 'no'})", True),
        ("", "c, e", "return Node(additional_env={k: e[k] for k in e if not k.startswith('ROS_')})", True),
        ("", "c, e='X'", "return Node(additional_env={f'ROS_LOG_{e}': 'no'})", False),
        ("", "c", "return Node(prefix='sudo')", True),
        ("", "c", "return Node(prefix='sudo -E env A=b')", False),
        ("", "c", "return Node(prefix='sudo -E script')", True),
        ("", "c", "return SetLaunchConfiguration('launch-prefix', 'sudo')", True),
        ("", "c", "return SetLaunchConfiguration('launch-prefix', 'nice')", False),
        ("", "c", "return ExecuteProcess(cmd=['env', '-i', 'e'])", True),
        ("", "c", "return ExecuteProcess(cmd=['env', 'A=b', 'e'])", False),
        ("", "c", "return ExecuteProcess(cmd=['sudo', 'ros2', 'run', 'p', 'e'])", True),
        ("", "c", "return ExecuteProcess(cmd=['sudo', '-E', 'ros2', 'run', 'p', 'e'])", False),
        ("", "c", "return ExecuteProcess(cmd=['sudo', 'ip', 'link'])", False),
    ],
)
def test_what_processes_are_given_where_nothing_is_followed(
    before: str, arguments: str, body: str, named: bool, tmp_path: Path
) -> None:
    before = f"{before}\ndef other({arguments}):\n    {body}"
    intent = launch(tmp_path, function(f"return LaunchDescription([{PLAIN}])", before), "py")
    found = {each.name: each.value for each in intent.variables}
    assert (ENABLE.strip("'") in found) is bool(found) is named
    assert set(found.values()) <= {None}


@pytest.mark.parametrize(
    ("before", "statements", "told"),
    [
        (f"{LATER}return [{NO}]", f"return LaunchDescription([{SURE}, OpaqueFunction(function=other)])", {None}),
        (f"{LATER}os.environ[{ENABLE}] = 'no'", f"return LaunchDescription([{SURE}, {PLAIN}])", {"no"}),
        (f"{LATER}os.environ[{ENABLE}] = 'true'", f"return LaunchDescription([{SURE}, {PLAIN}])", set()),
        ("", f"a = [{NO}]\nfor i in k:\n    a.append({PLAIN})\nreturn LaunchDescription(a)", {None}),
        ("", f"a = []\na.append({NO})\nfor i in k:\n    a.append({PLAIN})\nreturn LaunchDescription(a)", {None}),
        ("", f"a = {NO}\nd = LaunchDescription()\nif k:\n    d.add_action(a)\nreturn d", {None}),
        ("", f"d = LaunchDescription([{SURE}])\nfor i in k:\n    d.add_action({PLAIN})\nreturn d", set()),
        (f"{LATER}return [Node(executable='e', env={{'A': 'b'}})]", "return LaunchDescription()", {None}),
        (f"{LATER}return [Node(executable='e', env=None)]", "return LaunchDescription()", set()),
        (f"{LATER}e = os.environ.copy()\n    return Node(executable='e', env=e)", "return LaunchDescription()", set()),
    ],
)
def test_what_is_not_followed_may_start_with_what_is_named_there_whatever_is_set_first(
    before: str, statements: str, told: set[str | None], tmp_path: Path
) -> None:
    intent = launch(tmp_path, function(statements, before), "py")
    found = {each.value for each in intent.variables if each.name == ENABLE.strip("'")}
    assert found - {"true"} == told


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
        (f"e = os.environ.copy()\ne['A'] = 'b'\nf = e\nf[{ENABLE}] = 'no'", "env=e", {ENABLE: None}),
        (f"e = {{{ENABLE}: 'no', **os.environ}}", "env=e", {ENABLE: None}),
        (f"e = {{{ENABLE}: 'true', **os.environ}}", "env=e", {}),
        ("def e():\n    f = os.environ.copy()\n    f.update({'A': 'b'})\n    return f", "env=e()", {}),
        (
            f"def e():\n    f = os.environ.copy()\n    f.update({{{ENABLE}: 'b'}})\n    return f",
            "env=e()",
            {ENABLE: None},
        ),
        ("def e():\n    f = {'A': 'b'}\n    return f", "env=e()", dict.fromkeys((ENABLE, STRATEGY))),
        ("def e():\n    return {'A': 'b'}", "additional_env=e()", {}),
        ("import other", "additional_env=other.e", dict.fromkeys(NAMES)),
        ("def f(a):\n    return {**a, 'A': 'b'}", "env=f(os.environ)", {}),
        ("def f(*, a=None):\n    return a", "env=f()", {}),
        ("def f(b, a={}):\n    return a", "env=f(1)", dict.fromkeys((ENABLE, STRATEGY))),
        ("def f(a):\n    return {**a, 'A': 'b'}", "env=f({})", dict.fromkeys((ENABLE, STRATEGY))),
        ("def f(a):\n    return {**a, 'A': 'b'}", "additional_env=f(other)", dict.fromkeys(NAMES)),
        ("e = dict(os.environ)\nfor k in ('A', 'B'):\n    e.pop(k)", "env=e", {}),
        ("", "env={k: v for k, v in os.environ.items()}", {}),
        ("", "env={k: v for k, v in os.environ.items() if 'A' not in k}", dict.fromkeys((ENABLE, STRATEGY))),
        ("", "env={k: k for k, v in os.environ.items()}", dict.fromkeys((ENABLE, STRATEGY))),
        ("", "env={k: v for k, v in other.items()}", dict.fromkeys(NAMES)),
        (f"e = dict(os.environ)\nfor k in ({ENABLE}, 'B'):\n    del e[k]", "env=e", {ENABLE: None}),
        ("e = dict(os.environ)\nfor k in list(e):\n    del e[k]", "env=e", dict.fromkeys((ENABLE, STRATEGY))),
        ("e = {}\nfor k, v in other.items():\n    e[k] = v", "additional_env=e", dict.fromkeys(NAMES)),
        ("e = {}\nfor k in ('A', 'B'):\n    e[k] = other()", "additional_env=e", {}),
        ("e = dict([k.split('=') for k in open('f')])", "additional_env=e", dict.fromkeys(NAMES)),
        ("with open('f') as f:\n    e = dict(map(str.split, f))", "additional_env=e", dict.fromkeys(NAMES)),
        ("e = dict(zip(['A'], ['b']))", "additional_env=e", {}),
        ("e = dict(filter(lambda k: k[0] in 'A', os.environ.items()))", "env=e", dict.fromkeys((ENABLE, STRATEGY))),
        ("e = {'A': 'b'}\ne.update(other())", "additional_env=e", dict.fromkeys(NAMES)),
        ("", "additional_env={'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID', '0')}", {}),
        ("", "additional_env={'ROS_DOMAIN_ID': os.environ['ROS_DOMAIN_ID']}", {}),
        (
            "",
            "env={'ROS_DOMAIN_ID': os.environ['ROS_DOMAIN_ID']}",
            {name: "" for name in NAMES if name != "ROS_DOMAIN_ID"},
        ),
        ("", "additional_env={'ROS_DOMAIN_ID': os.environ['OTHER']}", {"ROS_DOMAIN_ID": None}),
        ("", "additional_env={'ROS_DOMAIN_ID': os.getenv('ROS_DOMAIN_ID', '7')}", {"ROS_DOMAIN_ID": None}),
        ("", "additional_env={'ROS_DOMAIN_ID': os.getenv('OTHER')}", {"ROS_DOMAIN_ID": None}),
        ("", f"additional_env={{{ENABLE}: EnvironmentVariable({ENABLE}, default_value='false')}}", {}),
        ("e = os.environ.copy()\nx = other.change(e)", "env=e", dict.fromkeys(NAMES)),
    ],
)
def test_a_copy_of_the_environment_has_what_there_was(
    statements: str, given: str, told: dict[str, str | None], tmp_path: Path
) -> None:
    node = f"Node(executable='e', name='n', {given})"
    intent = launch(tmp_path, function(f"{statements}\nreturn LaunchDescription([{node}])"), "py")
    found = {each.name: each.value for each in intent.variables if each.node == "/n"}
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


@pytest.mark.parametrize("unit", ["lambda: ", "1 if x else "])
def test_what_stands_in_each_other_is_looked_at_once(
    unit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2,000 functions in each other took 13 seconds, all inner ones being looked at again for each."""
    looked: list[ast.AST] = []
    monkeypatch.setattr(python_environment, "_mentioned", lambda node, *_: looked.append(node) or ())
    launch(tmp_path, function(f"return LaunchDescription([{PLAIN}])", f"x = {unit * 50}0"), "py")
    expressions = [node for node in looked if isinstance(node, ast.expr)]
    assert len(expressions) == len(set(expressions)) > 50
