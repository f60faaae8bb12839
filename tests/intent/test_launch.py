"""Launch files: which nodes, in which enclaves, with which names; nothing guessed, nothing outside read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from keystore_audit.errors import UsageError
from keystore_audit.intent.environment import OVERRIDE
from keystore_audit.intent.intent import Action, Intent
from keystore_audit.intent.launch import MAX_ACTIONS, MAX_REMAPS, MAX_SET, read_launch
from keystore_audit.intent.launch_elements import NAMES
from tests.intent.launched import described, launch, names, nodes, unresolved
from tools.samples.healthy import TURTLESIM, VEHICLE
from tools.samples.policy import Node

LAUNCH = Path(__file__).parent.parent.parent / "sample_keystores" / "launch"
TALKER = '<node pkg="demo" exec="talker" name="talker" ros_args="--enclave /talker">{}</node>'


def granted(wiring: dict[str, Node]) -> set[tuple[str, str, str]]:
    """(enclave, node, topic) of what the healthy keystore is for."""
    return {
        (enclave, f"/{node.name}", f"/{topic}")
        for enclave, node in wiring.items()
        for topic in (*node.publish, *node.subscribe)
    }


@pytest.mark.parametrize(("name", "wiring"), [("turtlesim", TURTLESIM), ("vehicle", VEHICLE)])
@pytest.mark.parametrize("form", ["xml", "yaml", "py"])
def test_a_sample_is_what_its_keystore_is_for(name: str, form: str, wiring: dict[str, Node]) -> None:
    intent = read_launch(LAUNCH / f"{name}.launch.{form}", {})
    assert nodes(intent) == {(enclave, f"/{node.name}") for enclave, node in wiring.items()}
    assert names(intent) == granted(wiring)
    assert intent.unresolved == ()


@pytest.mark.parametrize(
    ("name", "wiring", "missing", "excess"),
    [
        ("turtlesim", TURTLESIM, {("/keyboard", "/keyboard", "/rotation")}, {("/multiplexer", "/low_priority")}),
        ("vehicle", VEHICLE, {("/gateway", "/gateway", "/media_state")}, {("/brake", "/motor_limit")}),
    ],
)
def test_variants_differ_from_the_keystore_in_what_their_names_say(
    name: str, wiring: dict[str, Node], missing: set[tuple[str, str, str]], excess: set[tuple[str, str]]
) -> None:
    more = names(read_launch(LAUNCH / f"{name}-missing-grant.launch.xml", {}))
    less = names(read_launch(LAUNCH / f"{name}-excess-grant.launch.xml", {}))
    assert (more - granted(wiring), granted(wiring) - more) == (missing, set())
    assert (less - granted(wiring), {(enclave, topic) for enclave, _, topic in granted(wiring) - less}) == (
        set(),
        excess,
    )


@pytest.mark.parametrize(
    ("target", "used"),
    [
        ("/x", "/x"),
        ("x", "/ns/x"),
        ("x/y", "/ns/x/y"),
        ("~/x", "/ns/talker/x"),
        ("~", "/ns/talker"),
    ],
)
def test_remapped_names_are_expanded_as_rcl_does(target: str, used: str, tmp_path: Path) -> None:
    node = f'<node pkg="p" exec="e" name="talker" namespace="ns"><remap from="a" to="{target}"/></node>'
    assert names(launch(tmp_path, node)) == {("/", "/ns/talker", used)}


@pytest.mark.parametrize(
    "target", ["", "/", "a b", "/a//b", "/a/", "~x", "{other}", "{node}/x", "{ns}/x", "1x", "a:b", "x.y"]
)
def test_names_that_no_node_can_use_are_said(target: str, tmp_path: Path) -> None:
    intent = launch(tmp_path, TALKER.format(f'<remap from="a" to="{target}"/>'))
    assert names(intent) == set()
    assert [line for line, _reason in unresolved(intent)] == [1]


@pytest.mark.parametrize(
    ("attributes", "enclave"),
    [
        ("", "/"),
        ('args="--enclave /x"', "/"),
        ('args="--ros-args --enclave /x"', "/x"),
        ('args="one --ros-args -e /x -- --enclave /y"', "/x"),
        ('args="--ros-args -p a:=b -e /x --params-file f"', "/x"),
        ('args="--ros-args -e /x" ros_args="-e /y"', "/y"),
        ('ros_args="-r __ns:=/a --enclave /x/y --log-level debug"', "/x/y"),
        ("ros_args=\"--enclave '/x'\"", "/x"),
    ],
)
def test_the_enclave_is_what_the_command_line_says(attributes: str, enclave: str, tmp_path: Path) -> None:
    intent = launch(tmp_path, f'<node pkg="p" exec="e" name="n" {attributes}/>')
    assert {found for found, _name in nodes(intent)} == {enclave}


@pytest.mark.parametrize("enclave", ["x", "/x/", "//x", "/x y", "../x"])
def test_what_is_no_enclave_is_said_and_nothing_concluded(enclave: str, tmp_path: Path) -> None:
    intent = launch(tmp_path, f'<node pkg="p" exec="e" name="n" ros_args="--enclave \'{enclave}\'"/>')
    assert (nodes(intent), intent.enclaves) == (set(), ())
    assert "which is no path of an enclave" in unresolved(intent)[0][1]


def test_the_override_variable_goes_before_the_command_line(tmp_path: Path) -> None:
    node = '<node pkg="p" exec="e" name="{}" ros_args="--enclave /x">{}</node>'
    text = (
        '<group><set_env name="ROS_SECURITY_ENCLAVE_OVERRIDE" value="/o"/>'
        + node.format("a", "")
        + '<unset_env name="ROS_SECURITY_ENCLAVE_OVERRIDE"/>'
        + node.format("b", "")
        + "</group>"
        + node.format("c", "")
        + node.format("d", '<env name="ROS_SECURITY_ENCLAVE_OVERRIDE" value="/e"/>')
        + '<append_env name="ROS_SECURITY_ENCLAVE_OVERRIDE" value="/f"/>'
        + node.format("f", "")
    )
    intent = launch(tmp_path, text)
    assert nodes(intent) == {("/o", "/a"), ("/x", "/b"), ("/x", "/c"), ("/e", "/d")}
    assert len(unresolved(intent)) == 1


@pytest.mark.parametrize(
    ("prefix", "known"),
    [
        ("", True),
        ("gdb -ex run --args", True),
        ("sudo", True),
        ("env A=b", True),
        ("env ROS_SECURITY_ENCLAVE_OVERRIDE=/p", False),
        ("env -u ROS_SECURITY_ENABLE", False),
        ("env CYCLONEDDS_URI=x", False),
        ("env 'ROS_DOMAIN_ID=3", False),
    ],
)
def test_a_prefix_that_speaks_of_security_leaves_the_enclave_open(prefix: str, known: bool, tmp_path: Path) -> None:
    node = '<node pkg="p" exec="e" name="n" ros_args="--enclave /x"{}/>'
    for_all = f'<let name="launch-prefix" value="{prefix}"/>{node.format("")}'
    for text in (node.format(f' launch-prefix="{prefix}"'), for_all):
        intent = launch(tmp_path, text)
        assert nodes(intent) == ({("/x", "/n")} if known else set())
        assert (intent.speaking == ()) is known


def variables(intent: Intent) -> dict[str, str | None]:
    return {variable.name.removeprefix("ROS_"): variable.value for variable in intent.variables}


OPEN = dict.fromkeys(each.removeprefix("ROS_") for each in NAMES if each != OVERRIDE)


@pytest.mark.parametrize(
    ("form", "text", "expected"),
    [
        ("xml", '<executable cmd="run"><env name="ROS_SECURITY_ENABLE" value="no"/></executable>', "no"),
        ("xml", '<set_env name="ROS_SECURITY_ENABLE" value="no"/><executable cmd="run"/>', "no"),
        ("xml", '<executable cmd="run" launch-prefix="sudo"/>', ""),
        ("xml", '<executable cmd="run"><env name="ROS_SECURITY_ENABLE" value="$(env X)"/></executable>', None),
        ("xml", '<executable cmd="run"/>', ""),
        ("py", "ExecuteProcess(cmd=['run'], additional_env={'ROS_SECURITY_ENABLE': 'no'})", "no"),
        ("py", "ExecuteProcess(cmd=['run'])", ""),
    ],
)
def test_a_process_that_may_be_a_node_has_what_is_set_for_it(
    form: str, text: str, expected: str | None, tmp_path: Path
) -> None:
    intent = launch(tmp_path, described(text) if form == "py" else text, form)
    assert variables(intent) == ({"SECURITY_ENABLE": expected} if expected != "" else {})
    assert [reason for _line, reason in unresolved(intent)] == [
        "A process is started here; whether it is a node, and which, is not known."
    ]


@pytest.mark.parametrize(
    ("form", "text", "speaks"),
    [
        ("xml", '<executable cmd="env ROS_SECURITY_ENABLE=no run"/>', True),
        ("xml", '<executable cmd="ros2 run a b --ros-args --enclave /x"/>', True),
        ("xml", '<executable cmd="run" launch-prefix="env -u ROS_SECURITY_ENABLE"/>', True),
        ("xml", '<executable cmd="sudo ip link"/>', False),
        (
            "xml",
            '<brand_new><node pkg="p" exec="e"><env name="RMW_IMPLEMENTATION" value="x"/></node></brand_new>',
            True,
        ),
        ("xml", '<brand_new><node pkg="p" exec="e"/></brand_new>', False),
        ("xml", """<arg name="a" default="$(command 'env ROS_DOMAIN_ID=3 run')"/>""", True),
        ("xml", """<arg name="a" default="$(command 'run')"/><log message="$(var b)"/><brand_new/>""", False),
        ("xml", """<arg name="a" default="$(find-pkg-share enclave)"/><brand_new/>""", False),
        ("py", "Node(executable='e', name=Command(['env ROS_DOMAIN_ID=3 ', 'run']))", True),
        ("py", "Node(executable='e', name=Command(['env A=3 ', 'run']))", False),
        ("py", "ExecuteProcess(cmd=[['ROS_SECURITY_', 'ENABLE=no run']], shell=True)", True),
        ("py", "ExecuteLocal(process_description=Executable(cmd=['env', 'FASTRTPS_DEFAULT_PROFILES_FILE=x']))", True),
        ("py", "ExecuteProcess(cmd=['bash', '-c', 'unset A; run'])", False),
    ],
)
def test_what_is_not_read_and_speaks_of_security_is_said_with_its_line(
    form: str, text: str, speaks: bool, tmp_path: Path
) -> None:
    intent = launch(tmp_path, described(text) if form == "py" else text, form)
    assert [each.location.line is not None for each in intent.speaking] == [True] * speaks
    assert intent.unresolved != ()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{node}{off}", {}),
        ("{timer}{off}", {"SECURITY_ENABLE": None}),
        ("{off}{timer}", {"SECURITY_ENABLE": "no"}),
        ("{off}{timer}{on}", {"SECURITY_ENABLE": None}),
        ("<group>{timer}</group>{off}", {"SECURITY_ENABLE": None}),
        ("{timer}<timer period='0'>{off}</timer>", {"SECURITY_ENABLE": None}),
        ("{timer}<group>{off}</group>", {"SECURITY_ENABLE": None}),
        ("{timer}<group scoped='false'>{off}</group>", {"SECURITY_ENABLE": None}),
        ("{timer}<set_env name='A' value='b'/>", {}),
    ],
)
def test_what_comes_later_starts_with_what_is_set_meanwhile(
    text: str, expected: dict[str, str | None], tmp_path: Path
) -> None:
    node = '<node pkg="p" exec="e" name="n"/>'
    off, on = (f'<set_env name="ROS_SECURITY_ENABLE" value="{value}"/>' for value in ("no", "true"))
    timer = f'<timer period="5">{node}</timer>'
    assert variables(launch(tmp_path, text.format(node=node, off=off, on=on, timer=timer))) == expected


def test_what_an_event_handler_starts_comes_later(tmp_path: Path) -> None:
    off = "SetEnvironmentVariable('ROS_SECURITY_ENABLE', 'no')"
    node = "Node(package='p', executable='e', name='n')"
    handler = f"RegisterEventHandler(OnProcessExit(target_action=other, on_exit=[{node}]))"
    assert variables(launch(tmp_path, described(f"{handler}, {off}"), "py")) == {"SECURITY_ENABLE": None}
    first = f"ExecuteProcess(cmd=['x'], on_exit=[{node}])"
    assert variables(launch(tmp_path, described(f"{first}, {off}"), "py")) == {"SECURITY_ENABLE": None}
    assert variables(launch(tmp_path, described(f"{node}, {off}"), "py")) == {}


@pytest.mark.parametrize(
    "unread",
    ['<include file="$(find-pkg-share a)/b.launch.xml"/>', '<include file="missing.launch.xml"/>', "<brand_new/>"],
)
def test_what_is_not_read_starts_with_what_is_set_before_it(unread: str, tmp_path: Path) -> None:
    off = '<set_env name="ROS_SECURITY_ENABLE" value="no"/>'
    assert variables(launch(tmp_path, f"{off}{unread}")) == {"SECURITY_ENABLE": "no"}
    assert variables(launch(tmp_path, f"<group>{off}</group>{unread}")) == {}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<push_env/>", {}),
        ("<rep_env/>", OPEN),
        ('<rep_env><env name="ROS_DOMAIN_ID" value="3"/></rep_env>', OPEN),
        ("<reset_env/>", OPEN),
        ('<set_env name="ROS_SECURITY_ENABLE" value="true"/><pop_env/>', OPEN),
    ],
)
def test_what_replaces_all_variables_in_xml(text: str, expected: dict[str, str | None], tmp_path: Path) -> None:
    intent = launch(tmp_path, f'{text}<node pkg="p" exec="e" name="n"/>')
    assert variables(intent) == expected
    assert (nodes(intent) == set()) is (expected == OPEN)  # its enclave may be another, too


@pytest.mark.parametrize(
    ("before", "given", "expected"),
    [
        ("", "", {}),
        ("", "env=None", {}),
        ("", "additional_env={'ROS_SECURITY_ENABLE': 'true'}", {"SECURITY_ENABLE": "true"}),
        ("", "env={'PATH': '/bin'}", None),
        ("", "env={}", None),
        ("ReplaceEnvironmentVariables({'ROS_DOMAIN_ID': '3'}),", "", OPEN),
        ("ReplaceEnvironmentVariables(environment=other),", "", OPEN),
        ("ResetEnvironment(),", "", OPEN),
        ("PopEnvironment(),", "", OPEN),
        ("PushEnvironment(),", "", {}),
    ],
)
def test_what_replaces_all_variables_in_python(
    before: str, given: str, expected: dict[str, str | None] | None, tmp_path: Path
) -> None:
    """None: what it starts with cannot be told."""
    names = "PopEnvironment, PushEnvironment, ReplaceEnvironmentVariables, ResetEnvironment"
    node = f"Node(executable='e', name='n', {given})"
    text = f"from launch.actions import {names}\n{described(before + node)}"
    intent = launch(tmp_path, text, "py")
    assert (variables(intent), bool(intent.speaking)) == (expected or {}, expected is None)


def test_namespaces_add_up_within_their_group(tmp_path: Path) -> None:
    node = '<node pkg="p" exec="e" name="n" namespace="{}"/>'
    text = f"""<group><push_ros_namespace namespace="a"/>
        <group><push-ros-namespace namespace="b"/>{node.format("c")}{node.format("/d")}</group>
        <group scoped="false"><push_ros_namespace namespace="e"/></group>{node.format("")}
        <group><push_ros_namespace namespace="/f/"/>{node.format("g")}</group>
        </group>{node.format("i")}"""
    intent = launch(tmp_path, text)
    assert {name for _enclave, name in nodes(intent)} == {"/a/b/c/n", "/d/n", "/a/e/n", "/f/g/n", "/i/n"}
    assert intent.unresolved == ()


@pytest.mark.parametrize("kind", ['<group forwarding="false">', '<group><keep name="a" value="b"/>'])
def test_a_group_that_is_apart_is_not_read(kind: str, tmp_path: Path) -> None:
    inside = '<node pkg="p" exec="e" name="n">{}</node></group>'
    plain = launch(tmp_path, kind + inside.format(""))
    assert (nodes(plain), len(unresolved(plain)), plain.speaking) == (set(), 1, ())
    assert launch(tmp_path, kind + inside.format('<env name="ROS_SECURITY_ENABLE" value="no"/>')).speaking != ()


def test_names_given_as_remappings_count(tmp_path: Path) -> None:
    text = '<node pkg="p" exec="e" name="n" args="--ros-args -r __node:=m -r __ns:=/k -r a:=b -r m:c:=d -r z:c:=e"/>'
    intent = launch(tmp_path, text)
    assert nodes(intent) == {("/", "/k/m")}
    assert names(intent) >= {("/", "/k/m", "/k/b")}


def test_a_node_without_name_is_said_and_its_absolute_names_count(tmp_path: Path) -> None:
    remaps = '<remap from="a" to="/x"/><remap from="b" to="y"/><remap from="c" to="~/z"/>'
    intent = launch(tmp_path, f'<node pkg="p" exec="e" ros_args="-e /x">{remaps}</node>')
    assert (nodes(intent), [enclave for enclave, _ in intent.enclaves]) == (set(), ["/x"])
    assert names(intent) == {("/x", "", "/x"), ("/x", "", "/y")}
    assert len(unresolved(intent)) == 2


def test_arguments_are_given_or_default_or_said(tmp_path: Path) -> None:
    text = '<arg name="who" default="a"/><node pkg="p" exec="e" name="$(var who)_x" ros_args="-e /$(var who)"/>'
    assert nodes(launch(tmp_path, text)) == {("/a", "/a_x")}
    assert nodes(launch(tmp_path, text, who="b")) == {("/b", "/b_x")}
    without = launch(tmp_path, text.replace(' default="a"', ""))
    assert nodes(without) == set()
    assert "no value was given with --launch-argument" in unresolved(without)[0][1]
    nested = '<let name="k" value="who"/><arg name="who" default="c"/><node pkg="p" exec="e" name="$(var $(var k))"/>'
    assert nodes(launch(tmp_path, nested)) == set()
    assert "a substitution of the sort 'var'" in unresolved(launch(tmp_path, nested))[0][1]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("$(env HOME)", "the environment variable 'HOME'"),
        ("$(env HOME /x)", "the environment variable 'HOME'"),
        ("$(find-pkg-share demo)", "where a package is installed"),
        ("$(command 'echo /x')", "the output of a command"),
        ("$(eval '1 + 1')", "the result of an expression"),
        ("$(anon x)", "new each time"),
        ("$(brand-new x)", "a substitution of the sort 'brand-new'"),
        ("$(var unset)", "the argument 'unset', which nothing sets"),
        ("$(var self)", "more than 4096 characters"),
    ],
)
def test_what_only_a_run_tells_is_said(text: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/x")  # this machine says nothing about the robot
    doubling = '<let name="self" value="xx"/>' + '<let name="self" value="$(var self)$(var self)"/>' * 20
    intent = launch(tmp_path, f'{doubling}<node pkg="p" exec="e" name="n" ros_args="--enclave {text}"/>')
    assert (nodes(intent), intent.enclaves) == (set(), ())
    assert [reason in said for _line, said in unresolved(intent)] == [True]


@pytest.mark.parametrize(
    ("condition", "counted", "said"),
    [
        ('if="true"', True, False),
        ('if=" 1 "', True, False),
        ('if="false"', False, False),
        ('unless="0"', True, False),
        ('unless="True"', False, False),
        ('if="$(env X)"', True, True),
        ('if="maybe"', True, True),
        ('if="$(env X)" unless="true"', False, False),
    ],
)
def test_conditions_are_decided_or_counted_and_said(condition: str, counted: bool, said: bool, tmp_path: Path) -> None:
    intent = launch(tmp_path, f'<node pkg="p" exec="e" name="n" {condition}/>')
    assert (len(nodes(intent)) == 1, len(unresolved(intent)) == 1) == (counted, said)


def test_what_is_set_under_an_open_condition_is_not_known(tmp_path: Path) -> None:
    node = '<node pkg="p" exec="e" name="$(var a)"/>'
    text = f'<let name="a" value="x"/>{node}<let name="a" value="y" if="$(env X)"/>{node}'
    intent = launch(tmp_path, text)
    assert nodes(intent) == {("/", "/x")}
    assert [said for _line, said in unresolved(intent)] == [
        "Whether this happens depends on the environment variable 'X'; it is taken as if it does.",
        "The name of a node depends on the environment variable 'X'.",
    ]
    pushed = launch(tmp_path, '<push_ros_namespace namespace="k" if="$(env X)"/><node pkg="p" exec="e" name="n"/>')
    assert nodes(pushed) == set()


def test_components_are_in_the_enclave_of_their_container(tmp_path: Path) -> None:
    container = """<node_container pkg="p" exec="c" name="box" namespace="ns" ros_args="-e /box">
        <composable_node pkg="p" plugin="P" name="one" namespace="in"><remap from="a" to="b"/></composable_node>
        <composable_node pkg="p" plugin="P" name="two" if="false"/></node_container>"""
    load = '<load_composable_node target="{}"><composable_node pkg="p" plugin="P" name="{}"/></load_composable_node>'
    text = load.format("/ns/box", "three") + container + load.format("box", "four") + load.format("none", "five")
    intent = launch(tmp_path, text)
    assert nodes(intent) == {("/box", "/ns/box"), ("/box", "/in/one"), ("/box", "/three"), ("/box", "/four")}
    assert names(intent) == {("/box", "/in/one", "/in/b")}
    assert ["'none', which is not started here" in said for _line, said in unresolved(intent)] == [True]
    assert {(right.action, right.name) for right in intent.rights} == {
        (Action.REPLY, f"/ns/box/_container/{service}") for service in ("list_nodes", "load_node", "unload_node")
    }


def test_a_lifecycle_node_offers_its_services(tmp_path: Path) -> None:
    intent = launch(tmp_path, '<lifecycle_node pkg="p" exec="e" name="n" namespace="" ros_args="-e /x"/>')
    assert ("/x", "/n", Action.REPLY, "/n/change_state") in {
        (right.enclave, right.node, right.action, right.name) for right in intent.rights
    }


def test_a_remapping_for_a_group_is_said_and_hides_that_of_a_node(tmp_path: Path) -> None:
    remap, node = '<set_remap from="/tf" to="tf"/>', '<node pkg="p" exec="e" name="n">{}</node>'
    said = [(1, "A remapping for all nodes is to 'tf'; which of them use the name is not said.")]
    one = launch(tmp_path, f"<group>{remap}{node.format('')}</group>")
    assert (names(one), unresolved(one)) == (set(), said)
    own = node.format('<remap from="/tf" to="/other"/><remap from="a" to="b"/>')
    assert names(launch(tmp_path, f"<group>{remap}</group>{own}")) == {("/", "/n", "/other"), ("/", "/n", "/b")}
    assert names(launch(tmp_path, f"{remap}{own}")) == {("/", "/n", "/b")}


def include(tmp_path: Path, file: str, inside: str, **arguments: str) -> Intent:
    (tmp_path / "sub").mkdir(exist_ok=True)
    (tmp_path / "sub" / "other.launch.xml").write_text(f"<launch>{inside}</launch>", "utf-8")
    values = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    return launch(tmp_path, f'<include file="{file}">{values}</include><node pkg="p" exec="e" name="after"/>')


@pytest.mark.parametrize(
    "file", ["$(dirname)/sub/other.launch.xml", "sub/other.launch.xml", "./sub/./other.launch.xml"]
)
def test_files_below_the_directory_are_included(file: str, tmp_path: Path) -> None:
    inside = '<arg name="who"/><node pkg="p" exec="e" name="$(var who)"/>'
    intent = include(tmp_path, file, inside, who="x")
    assert nodes(intent) == {("/", "/x"), ("/", "/after")}
    assert intent.nodes[0].location.path == str(tmp_path / "sub" / "other.launch.xml")


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("$(find-pkg-share demo)/x.launch.xml", "its place depends on where a package is installed"),
        ("/etc/passwd", "is not below"),
        ("../{}/sub/other.launch.xml", ""),
        ("../other.launch.xml", "is not below"),
        ("$(dirname)/../x.launch.xml", "is not below"),
        ("none.launch.xml", "there is no such file"),
        ("sub", "a directory"),
        ("out.launch.xml", "out"),
        ("pipe.launch.xml", "a named pipe"),
        ("other.txt", "neither .xml"),
    ],
)
def test_no_file_outside_is_ever_read(file: str, said: str, tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "other.launch.xml").write_text("<launch>", "utf-8")  # reading it would be an error
    (inner / "out.launch.xml").symlink_to(tmp_path / "other.launch.xml")
    (inner / "other.txt").write_text("x", "utf-8")
    os.mkfifo(inner / "pipe.launch.xml")
    intent = include(inner, file.format("inner"), '<node pkg="p" exec="e" name="x"/>')
    assert ("/", "/after") in nodes(intent)
    if said:
        assert [said in reason for _line, reason in unresolved(intent)] == [True]
    else:
        assert nodes(intent) == {("/", "/x"), ("/", "/after")}


def test_an_argument_of_an_include_is_set_only_before_its_default(tmp_path: Path) -> None:
    inside = '<arg name="who" default="x"/><node pkg="p" exec="e" name="$(var who)"/>'
    assert nodes(include(tmp_path, "sub/other.launch.xml", inside)) == {("/", "/x"), ("/", "/after")}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<launch>", ":1: "),
        ("<lunch/>", ":1: expected <launch>, found <lunch>"),
        ("<launch>\n<node exec='e'/>\n<node/></launch>", ":3: expected 'node' to have 'exec'"),
        ("<launch>\n<node exec='e' name='$(var'/></launch>", ":2: in 'name' a substitution '$(' without"),
        ("<launch>\n<node exec='e' name='$()'/></launch>", ":2: in 'name'"),
        ("<launch>\n<node exec='e' args='\"'/></launch>", ":2: a quote in 'args'"),
        ("<launch>\n<group scoped='perhaps'/></launch>", ":2: expected 'scoped' to be true or false"),
        ("<launch><arg name='a' default='" + "$(var " * 50 + "'/></launch>", "without its ')'"),
        ("<!DOCTYPE launch [<!ENTITY a 'b'>]><launch>&a;</launch>", ":1: a document type"),
        ("<launch><include file='some.launch.xml'/></launch>", "64 deep"),
        (
            "<launch>" + "<node exec='e' name='n'/>" * (MAX_ACTIONS + 1) + "</launch>",
            f"more than {MAX_ACTIONS} actions",
        ),
        ("<launch>" + "<group/>" * (MAX_ACTIONS + 1) + "</launch>", f"more than {MAX_ACTIONS} actions"),
        ("<launch>" + "<group>" * 80 + "</group>" * 80 + "</launch>", "64 deep"),
        ("<launch>" + "".join(f"<let name='a{i}' value=''/>" for i in range(MAX_SET + 1)) + "</launch>", "values"),
        ("<launch>" + "<set_remap from='a' to='b'/>" * (MAX_REMAPS + 1) + "</launch>", f"{MAX_REMAPS} remappings"),
        ("<launch><node exec='e' args='" + "a " * 150_000 + "'/></launch>", "characters of XML"),
    ],
)
def test_what_is_no_launch_file_or_too_large_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "some.launch.xml"
    path.write_text(text, "utf-8")
    with pytest.raises(UsageError) as refused:
        read_launch(path, {})
    assert refused.value.message.startswith(f"{path}:")
    assert said in refused.value.message


def test_a_file_with_much_inside_that_is_included_often_ends(tmp_path: Path) -> None:
    remaps = "".join(f'<remap from="a{i}" to="b{i}"/>' for i in range(6_000))
    component = f'<composable_node pkg="p" plugin="P" name="n">{remaps}</composable_node>'
    box = f'<launch><node_container pkg="p" exec="e" name="box">{component}</node_container></launch>'
    (tmp_path / "box.launch.xml").write_text(box, "utf-8")
    with pytest.raises(UsageError, match="not followed"):
        launch(tmp_path, '<include file="box.launch.xml"/>' * 4_000)


def test_two_files_that_include_each_other_twice_end(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        text = f'<launch><include file="{other}.launch.xml"/><include file="{other}.launch.xml"/></launch>'
        (tmp_path / f"{one}.launch.xml").write_text(text, "utf-8")
    with pytest.raises(UsageError, match="deep"):
        read_launch(tmp_path / "a.launch.xml", {})


def test_a_file_in_launch_is_xml_of_ros_2(tmp_path: Path) -> None:
    """As MAVROS and ros_gz call theirs; an included one as well."""
    inner = '<launch><node pkg="p" exec="e" name="inner"/><bridge name="of a package"/></launch>'
    (tmp_path / "inner.launch").write_text(inner, "utf-8")
    intent = launch(tmp_path, '<launch><include file="inner.launch"/></launch>', "launch")
    assert nodes(intent) == {("/", "/inner")}
    assert len(intent.unresolved) == 1  # the element of a package


@pytest.mark.parametrize("form", ["launch", "xml"])
@pytest.mark.parametrize(
    ("ros_1", "ros_2"),
    [
        ('<node pkg="p" type="e" name="n"/>', '<node pkg="p" exec="e" name="n"/>'),
        ('<include file="$(find p)/a.launch"/>', '<include file="$(find-pkg-share p)/a.launch"/>'),
        ('<arg name="a" default="x"/><let name="b" value="$(arg a)"/>', '<let name="b" value="$(var a)"/>'),
    ],
)
def test_a_file_of_ros_1_is_told_from_one_of_ros_2(ros_1: str, ros_2: str, form: str, tmp_path: Path) -> None:
    def read(text: str) -> Intent:
        return launch(tmp_path, text if form == "xml" else f"<launch>{text}</launch>", form)

    with pytest.raises(UsageError, match=r"some\.launch\.\w+:1: .* is of ROS 1 \(roslaunch\)"):
        read(ros_1)
    assert read(ros_2).files


def test_a_node_whose_name_is_not_known_is_in_its_enclave_all_the_same(tmp_path: Path) -> None:
    def started(more: str) -> list[tuple[str, str, int | None]]:
        intent = launch(tmp_path, f'<node pkg="p" exec="e" {more}/>')
        return [(each.enclave, each.name, each.location.line) for each in intent.nodes]

    assert started("") == [("/", "", 1)]
    assert started('/>\n<node pkg="p" exec="e"') == [("/", "", 1), ("/", "", 2)]
    assert started('name="$(env WHO)" args="--ros-args -e /x"') == [("/x", "", 1)]
    assert started('args="--ros-args -e $(env WHERE)"') == []


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "launch.txt").write_text("", "utf-8")
    with pytest.raises(UsageError, match="expected a launch file that ends in"):
        read_launch(tmp_path / "launch.txt", {})
    with pytest.raises(UsageError, match="there is no such file"):
        read_launch(tmp_path / "none.launch.xml", {})
