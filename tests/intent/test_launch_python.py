"""Python launch files: what is read of them, what is said not to be, and that nothing in them ever runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from keystore_audit.errors import UsageError
from keystore_audit.intent.launch import read_launch
from keystore_audit.intent.launch_python import MAX_CHARACTERS
from tests.intent.launched import NODE, PLAIN, described, function, launch, names, nodes, unresolved

RUNNING = {
    "at import": ("{run}", "", "return LaunchDescription([{node}])"),
    "in the function": ("", "{run}", "return LaunchDescription([{node}])"),
    "in a default": ("def other(x={run}): pass", "", "return LaunchDescription([{node}])"),
    "in a decorator": ("@(lambda f: {run})\ndef other(): pass", "", "return LaunchDescription([{node}])"),
    "in a class": ("class Other:\n    {run}", "", "return LaunchDescription([{node}])"),
    "in an f-string": ("", "", 'return LaunchDescription([{node}, LogInfo(msg=f"""{{{run}}}""")])'),
    "in a comprehension": ("", "", "return LaunchDescription([{node}, *[{run} for _ in range(1)]])"),
    "as an argument": ("", "", "return LaunchDescription([{node}, Node(executable='e', name={run})])"),
    "in OpaqueFunction": ("", "", "return LaunchDescription([{node}, OpaqueFunction(function=lambda c: {run})])"),
    "in ExecuteProcess": ("", "", "return LaunchDescription([{node}, ExecuteProcess(cmd=['touch', {marker!r}])])"),
    "in PythonExpression": (
        "",
        "",
        "return LaunchDescription([{node}, Node(executable='e', name=PythonExpression([{run!r}]))])",
    ),
    "in Command": (
        "",
        "",
        "return LaunchDescription([{node}, Node(executable='e', name=Command(['touch ', {marker!r}]))])",
    ),
    "in a condition": (
        "",
        "",
        "return LaunchDescription([{node}, GroupAction([], condition=IfCondition(PythonExpression({run!r})))])",
    ),
    "in a type hint": ("x: {run} = 1", "", "return LaunchDescription([{node}])"),
    "as the main program": ("if __name__ == '__main__':\n    {run}", "", "return LaunchDescription([{node}])"),
}


NOTE = "What is not read may start nodes or change their names; record the running system (--graph)."


@pytest.mark.parametrize("where", RUNNING)
def test_nothing_in_a_python_launch_file_runs(where: str, tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    values = {"run": f"__import__('pathlib').Path({str(marker)!r}).touch()", "marker": str(marker), "node": PLAIN}
    before, body, last = (text.format(**values) for text in RUNNING[where])
    text = function(f"{body}\n{last}", before)
    modules = set(sys.modules)
    intent = launch(tmp_path, text, "py")
    assert not marker.exists()
    assert ("/x", "/n") in nodes(intent)
    assert not {name for name in set(sys.modules) - modules if name.split(".")[0] in ("launch", "launch_ros")}
    eval(values["run"])
    assert marker.exists(), "the marker would have told"


@pytest.mark.parametrize("form", ["xml", "yaml"])
def test_nothing_in_an_xml_or_yaml_launch_file_runs(form: str, tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    code = f"__import__('pathlib').Path(r'{marker}').touch()"
    texts = {
        "xml": f"""<executable cmd="touch {marker}"/>
            <executable cmd="touch {marker}" shell="true"/>
            <node pkg="p" exec="e" name="$(command 'touch {marker}')"/>
            <node pkg="p" exec="e" name="n" if="$(eval &quot;{code}&quot;)"/>
            <node pkg="p" exec="e" name="m" launch-prefix="touch {marker}"/>""",
        "yaml": f"""launch:
  - executable: {{cmd: "touch {marker}"}}
  - node: {{pkg: p, exec: e, name: "$(command 'touch {marker}')"}}
  - node: {{pkg: p, exec: e, name: n, if: '$(eval "{code.replace("'", "''")}")'}}
""",
    }
    intent = launch(tmp_path, texts[form], form)
    assert not marker.exists()
    assert nodes(intent) == {("/", "/n"), *([("/", "/m")] if form == "xml" else [])}
    assert len(unresolved(intent)) == {"xml": 4, "yaml": 3}[form]


def test_a_tag_of_yaml_makes_no_object(tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    text = f"launch:\n  - !!python/object/apply:os.system ['touch {marker}']\n"
    with pytest.raises(UsageError, match=r":2: the tag '.*python/object/apply:os.system'"):
        launch(tmp_path, text, "yaml")
    assert not marker.exists()


WAYS = [
    f"return LaunchDescription([{PLAIN}])",
    f"ld = LaunchDescription()\nld.add_action({PLAIN})\nreturn ld",
    f"x = {PLAIN}\nreturn LaunchDescription(initial_entities=[x])",
    f"xs = []\nxs.append({PLAIN})\nreturn LaunchDescription(xs)",
    f"xs = []\nxs += [{PLAIN}]\nreturn LaunchDescription([*xs])",
    f"xs = []\nxs.extend([{PLAIN}])\nreturn LaunchDescription(xs + [])",
    f'"""Text."""\nx: object = {PLAIN}\nreturn LaunchDescription((x,))',
    f"return LaunchDescription([GroupAction(actions=[{PLAIN}])])",
    f"return LaunchDescription([TimerAction(period=1.0, actions=[{PLAIN}])])",
    f"""x = {PLAIN}
h = OnProcessExit(target_action=x, on_exit=[x])
return LaunchDescription([RegisterEventHandler(h)])""",
    """import launch_ros.actions as actions
import launch
return launch.LaunchDescription([actions.Node(executable='e', name='n', arguments=['--ros-args', '-e', '/x'])])""",
    """from launch_ros.actions import Node as N
return LaunchDescription([N(executable='e', node_name='n', ros_arguments=['-e', '/x'])])""",
    """name = 'n'
return LaunchDescription([Node(executable='e', name=f'{name}', ros_arguments=['-e', '/' + 'x'])])""",
    """a = DeclareLaunchArgument('who', default_value='n')
n = Node(executable='e', name=LaunchConfiguration('who'), ros_arguments=['--enclave', ['/', 'x']])
return LaunchDescription([a, n])""",
    """s = SetEnvironmentVariable('ROS_SECURITY_ENCLAVE_OVERRIDE', '/x')
return LaunchDescription([s, Node(executable='e', name='n')])""",
    """e = {'ROS_SECURITY_ENCLAVE_OVERRIDE': '/x'}
return LaunchDescription([Node(executable='e', name='n', additional_env=e)])""",
]


@pytest.mark.parametrize("body", WAYS)
def test_ways_to_say_the_same(body: str, tmp_path: Path) -> None:
    intent = launch(tmp_path, function(body), "py")
    assert nodes(intent) == {("/x", "/n")}
    assert intent.unresolved == ()


def test_a_warning_about_the_file_is_not_ours(tmp_path: Path) -> None:
    body = f"x = '\\d' is 'x'\nreturn LaunchDescription([{PLAIN}])"
    assert nodes(launch(tmp_path, function(body), "py")) == {("/x", "/n")}


def test_what_the_module_sets_is_known_in_the_function(tmp_path: Path) -> None:
    text = function("return LaunchDescription([NODE])", f"WHO = 'n'\nNODE = {NODE.format('n', '')}")
    assert nodes(launch(tmp_path, text, "py")) == {("/x", "/n")}


def test_remappings_and_namespaces(tmp_path: Path) -> None:
    text = described(
        """GroupAction([PushRosNamespace('a'), SetRemap(src='/tf', dst='tf'),
            Node(executable='e', name='n', namespace='b', remappings=[('x', 'y'), ['z', '~/w']])]),
        Node(executable='e', name='m', remappings={'x': 'y'}.items())"""
    )
    intent = launch(tmp_path, text, "py")
    assert names(intent) == {
        ("/", "/m", "/y"),
        ("/", "/a/b/n", "/a/b/y"),
        ("/", "/a/b/n", "/a/b/n/w"),
    }
    assert [reason.partition(";")[0] for _line, reason in unresolved(intent)] == [
        "A remapping for all nodes is to 'tf'"
    ]


def test_components(tmp_path: Path) -> None:
    text = function(
        """box = ComposableNodeContainer(package='p', executable='c', name='box', ros_arguments=['-e', '/box'],
    composable_node_descriptions=[ComposableNode(package='p', plugin='P', name='one')])
load = LoadComposableNodes(target_container=box, composable_node_descriptions=[
    ComposableNode(package='p', plugin='P', name='two', remappings=[('a', 'b')]), other()])
return LaunchDescription([box, load])"""
    )
    intent = launch(tmp_path, text, "py")
    assert nodes(intent) == {("/box", "/box"), ("/box", "/one"), ("/box", "/two")}
    assert names(intent) == {("/box", "/two", "/b")}
    assert [reason for _line, reason in unresolved(intent)] == [NOTE]


@pytest.mark.parametrize(
    ("condition", "counted", "said"),
    [
        ("IfCondition('true')", True, False),
        ("UnlessCondition('true')", False, False),
        ("IfCondition(LaunchConfiguration('on'))", True, False),
        ("LaunchConfigurationEquals('on', 'false')", True, True),
        ("IfCondition(EqualsSubstitution(LaunchConfiguration('on'), 'true'))", True, True),
        ("IfCondition(EnvironmentVariable('X'))", True, True),
        ("IfCondition(PythonExpression('True'))", True, True),
        ("other()", True, True),
    ],
)
def test_conditions(condition: str, counted: bool, said: bool, tmp_path: Path) -> None:
    node = NODE.format("n", f", condition={condition}")
    intent = launch(tmp_path, described(f"DeclareLaunchArgument('on', default_value='true'), {node}"), "py")
    assert (len(nodes(intent)) == 1, len(unresolved(intent)) == 1) == (counted, said)


@pytest.mark.parametrize(
    "path",
    [
        "os.path.join(os.path.dirname(__file__), 'sub', 'other.launch.py')",
        "os.path.dirname(os.path.realpath(__file__)) + '/sub/other.launch.py'",
        "[ThisLaunchFileDir(), '/sub/other.launch.py']",
        "PathJoinSubstitution([ThisLaunchFileDir(), 'sub', 'other.launch.py'])",
        "'sub/other.launch.py'",
    ],
)
def test_includes(path: str, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    node = "Node(executable='e', name=LaunchConfiguration('who'))"
    (tmp_path / "sub" / "other.launch.py").write_text(described(f"DeclareLaunchArgument('who'), {node}"), "utf-8")
    text = f"IncludeLaunchDescription(PythonLaunchDescriptionSource({path}), launch_arguments={{'who': 'x'}}.items())"
    intent = launch(tmp_path, described(text), "py")
    assert (nodes(intent), intent.unresolved) == ({("/", "/x")}, ())


@pytest.mark.parametrize(("character", "reason"), [("\\0", "a NUL character"), ("\\ud800", "half of a surrogate pair")])
def test_an_include_that_no_file_can_be_is_said(character: str, reason: str, tmp_path: Path) -> None:
    text = described(f"IncludeLaunchDescription(PythonLaunchDescriptionSource('a{character}b.launch.py'))")
    found = unresolved(launch(tmp_path, text, "py"))
    assert [f"the path holds {reason}" in said for _line, said in found] == [True]


@pytest.mark.parametrize(
    "path",
    [
        "[FindPackageShare('p'), '/launch/x.launch.py']",
        "os.path.join(get_package_share_directory('p'), 'launch', 'x.launch.py')",
    ],
)
def test_an_include_in_a_package_is_said(path: str, tmp_path: Path) -> None:
    text = described(f"IncludeLaunchDescription(PythonLaunchDescriptionSource({path}))")
    intent = launch(tmp_path, f"from ament_index_python import get_package_share_directory\n{text}", "py")
    assert ["where a package is installed" in reason for _line, reason in unresolved(intent)] == [True]


@pytest.mark.parametrize(
    "body",
    [
        f"xs = []\nfor i in range(2):\n    xs.append({PLAIN})\nreturn LaunchDescription(xs)",
        f"ld = LaunchDescription()\nif other():\n    ld.add_action({PLAIN})\nreturn ld",
        f"ld = LaunchDescription()\nother(ld)\nld.add_action({PLAIN})\nreturn ld",
        f"ld = LaunchDescription()\nx = other(ld)\nld.add_action({PLAIN})\nreturn ld",
        f"def add():\n    xs.append({PLAIN})\nxs = []\nx = add()\nreturn LaunchDescription(xs)",
        f"xs = []\ng = GroupAction(xs)\nxs.append({PLAIN})\nreturn LaunchDescription([g])",
        f"xs = []\nys = xs\nys.extend([{PLAIN}])\nreturn LaunchDescription(xs + [])",
        f"return LaunchDescription([{PLAIN} for i in range(2)])",
        f"return LaunchDescription([{PLAIN}, *other()])",
        f"return LaunchDescription([{PLAIN}, OpaqueFunction(function=other)])",
        f"return LaunchDescription([{PLAIN}, ExecuteProcess(cmd=['x'])])",
        f"return LaunchDescription([{PLAIN}, BrandNew()])",
        f"return LaunchDescription([{PLAIN}, Node(**other)])",
        f"return LaunchDescription([{PLAIN} if other else None])",
        "return other()",
        "pass",
        "with other():\n    return LaunchDescription([])",
        f"if (x := other()):\n    pass\nreturn LaunchDescription([{PLAIN}])",
        f"ld = LaunchDescription()\nld.add_action(action={PLAIN})\nreturn ld",
        f"from other import *\nreturn LaunchDescription([{PLAIN}])",
        f"Node = other\nreturn LaunchDescription([{PLAIN}])",
        f"x = 1\nx = {PLAIN}\nreturn LaunchDescription([x])",
        f"class Node: pass\nreturn LaunchDescription([{PLAIN}])",
        f"os.environ['ROS_SECURITY_ENCLAVE_OVERRIDE'] = '/y'\nreturn LaunchDescription([{PLAIN}])",
        "yield LaunchDescription([])",
        f"return LaunchDescription([TimerAction(1.0, {PLAIN}, [], {PLAIN})])",
        f"return LaunchDescription([GroupAction([{PLAIN}], scoped=other)])",
        f"from .launch_ros.actions import Node\nreturn LaunchDescription([{PLAIN}])",
        f"if __name__ != '__main__':\n    other()\nreturn LaunchDescription([{PLAIN}])",
        f"return LaunchDescription(other({PLAIN}))",
    ],
)
def test_what_is_not_followed_is_said(body: str, tmp_path: Path) -> None:
    intent = launch(tmp_path, function(body), "py")
    assert intent.unresolved != ()
    assert all(line is not None for line, _reason in unresolved(intent))


@pytest.mark.parametrize(
    "change",
    [
        "if other():\n    who = 'm'",
        "if other():\n    who = who + 'm'",
        "for who in other(): pass",
        "with other() as who: pass",
        "try: pass\nexcept ValueError as who: pass",
        "import who",
        "def who(): pass",
        "who, x = other()",
        "who += 'm'",
        "del who",
        "match other():\n    case who: pass",
        "x = (who := 'm')",
        "who = other()",
        "from other import *",
    ],
)
def test_a_name_that_may_have_changed_is_not_known(change: str, tmp_path: Path) -> None:
    indented = "\n".join(change.splitlines())
    body = f"who = 'n'\n{indented}\nreturn LaunchDescription([Node(executable='e', name=who)])"
    intent = launch(tmp_path, function(body), "py")
    assert nodes(intent) == set()
    assert intent.unresolved != ()


@pytest.mark.parametrize("change", ["k['a'] = other()", "j['a'] = other()", "x = other(j)", "j.update(other())"])
def test_what_has_two_names_is_not_known_by_the_other(change: str, tmp_path: Path) -> None:
    node = "Node(executable='e', additional_env=k)"
    body = f"k = {{'ROS_DOMAIN_ID': '3'}}\nj = k\n{change}\nreturn LaunchDescription([{node}])"
    intent = launch(tmp_path, function(body), "py")
    assert {variable.value for variable in intent.variables} == {None}
    assert intent.speaking != ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def", ":1: the text is no Python"),
        ("x = 1\n  y = 2", ":2: the text is no Python"),
        ("\0", "the text is no Python"),
        ("-" * 100_000 + "1", "too deep"),
        ("x" * (MAX_CHARACTERS + 1), f"more than {MAX_CHARACTERS} characters"),
    ],
)
def test_what_is_no_python_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "some.launch.py"
    path.write_text(text, "utf-8")
    with pytest.raises(UsageError) as refused:
        read_launch(path, {})
    assert refused.value.message.startswith(f"{path}:")
    assert said in refused.value.message


def doubled(first: str, step: str, count: int) -> str:
    """Assignments of which each names the one before, {x}, twice; the last is called x."""
    names = [*(f"x{number}" for number in range(count)), "x"]
    lines = [step.format(x=name) for name in names[:-1]]
    return "\n".join(f"{name} = {line}" for name, line in zip(names, [first, *lines], strict=True))


DEEP = {
    "sum": f"x = {'1 + ' * 20_000}1",
    "attributes": f"x = a{'.b' * 20_000}",
    "calls": f"x = f{'()' * 20_000}",
    "lists": doubled("[]", "[{x}, {x}]", 2_000),
    "texts": doubled("'ab'", "{x} + {x}", 2_000),
    "empty texts": doubled("''", "[{x}, {x}]", 2_000) + "\ny = Node(executable='e', name=x)\n",
    "groups": doubled("[]", "[GroupAction({x}), GroupAction({x})]", 2_000),
    "nested groups": doubled("GroupAction([])", "GroupAction([{x}])", 3_000),
    "defaults": doubled("'a'", "LaunchConfiguration({x}, default={x})", 2_000),
    "groups that are not read": doubled("[]", "[GroupAction({x}), GroupAction({x}, scoped=other)]", 60),
    "what comes later": doubled("[]", "Node(executable='e', on_exit=[{x}, {x}])", 2_000),
    "paths": doubled("'a'", "os.path.join({x}, {x})", 2_000),
    "few defaults": doubled("'a'", "LaunchConfiguration({x}, default={x})", 40)
    + "\ny = Node(executable='e', name=x)\n",
    "assignments": "\n".join(f"x{i} = {i}" for i in range(8_000)),
}


@pytest.mark.parametrize("name", DEEP)
def test_large_and_deep_files_end(name: str, tmp_path: Path) -> None:
    text = function("return LaunchDescription([x])", DEEP[name])
    assert len(text) < MAX_CHARACTERS
    try:
        intent = launch(tmp_path, text, "py")
    except UsageError as error:
        ended = error.message
    else:
        ended = intent.unresolved[0].reason
    assert ended


@pytest.mark.parametrize("kind", ["Node", "ExecuteProcess"])
def test_what_starts_when_a_process_ends_is_started(kind: str, tmp_path: Path) -> None:
    later = "Node(package='p', executable='e', name='later', ros_arguments=['--enclave', '/later'])"
    intent = launch(tmp_path, described(f"{kind}(package='p', executable='e', name='n', on_exit=[{later}])"), "py")
    assert ("/later", "/later") in nodes(intent)


@pytest.mark.parametrize(
    "afterwards",
    [
        "generate_launch_description = other",
        "from other import generate_launch_description",
        "generate_launch_description: object = other",
    ],
)
def test_a_function_whose_name_means_something_else_at_last_is_not_read(afterwards: str, tmp_path: Path) -> None:
    text = described("Node(package='p', executable='e', name='n')")
    assert nodes(launch(tmp_path, text, "py")) == {("/", "/n")}
    intent = launch(tmp_path, f"{text}\n{afterwards}\n", "py")
    assert nodes(intent) == set()
    assert [reason for _line, reason in unresolved(intent)] == [NOTE]
