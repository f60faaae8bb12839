"""XML, YAML and Python say the same: random launches in all three, against a few lines that say what they mean."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import Struct, field

from keystore_audit.errors import UsageError
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.launch import read_launch
from tests.intent.launched import IMPORTS, launch, names, nodes, unresolved
from tests.strategies.mutations import edited

LAUNCH = Path(__file__).parent.parent.parent / "sample_keystores" / "launch"
OVERRIDE = "ROS_SECURITY_ENCLAVE_OVERRIDE"


class Text(Struct, frozen=True, kw_only=True):
    """A text, and behind it perhaps the value of an argument."""

    plain: str
    argument: str | None = None

    def frontend(self) -> str:
        return self.plain + (f"$(var {self.argument})" if self.argument else "")

    def python(self) -> str:
        return f"[{self.plain!r}, LaunchConfiguration({self.argument!r})]" if self.argument else repr(self.plain)


class Step(Struct, frozen=True, kw_only=True):
    """One action; `what` is node, group, push, let or override."""

    what: str
    condition: str | None
    text: Text
    other: Text
    remaps: tuple[Text, ...] = ()
    enclave: str | None = None
    scoped: bool = True
    steps: tuple[Step, ...] = ()


class State(Struct, kw_only=True):
    """What is set."""

    namespace: str = ""
    arguments: dict[str, str] = field(default_factory=lambda: {"a": "true", "b": "x"})
    override: str = ""

    def value(self, text: Text) -> str:
        return text.plain + (self.arguments[text.argument] if text.argument else "")

    def below(self, name: str) -> str:
        return name.rstrip("/") if name.startswith("/") else f"{self.namespace}/{name}".rstrip("/")


Meaning = set[tuple[str, ...]]


def meaning(steps: tuple[Step, ...], state: State) -> Meaning:
    """(enclave, node) of each node and (enclave, node, name) of each remapped name."""
    found: Meaning = set()
    for step in steps:
        if step.condition == "false" or (step.condition == "a" and state.arguments["a"] != "true"):
            continue
        if step.what == "push":
            state.namespace = state.below(state.value(step.text))
        elif step.what == "let":
            state.arguments["b"] = state.value(step.text)
        elif step.what == "override":
            state.override = step.enclave or ""
        elif step.what == "group":
            inner = State(namespace=state.namespace, arguments=dict(state.arguments), override=state.override)
            found |= meaning(step.steps, inner if step.scoped else state)
        else:
            namespace = state.below(state.value(step.other))
            node = f"{namespace}/{state.value(step.text)}"
            enclave = state.override or step.enclave or "/"
            found.add((enclave, node))
            for remap in step.remaps:
                target = state.value(remap)
                if target.startswith("~"):
                    target = node + target[1:]
                found.add((enclave, node, target if target.startswith("/") else f"{namespace}/{target}"))
    return found


def _parts(step: Step) -> tuple[str, dict[str, str], list[tuple[str, dict[str, str]]]]:
    """Element, attributes and inner elements, as XML and YAML have them."""
    attributes: dict[str, str] = {}
    inner: list[tuple[str, dict[str, str]]] = []
    if step.what == "node":
        attributes = {"exec": "e", "name": step.text.frontend(), "namespace": step.other.frontend()}
        attributes |= {"ros_args": f"--enclave {step.enclave}"} if step.enclave else {}
        inner = [("remap", {"from": f"r{i}", "to": text.frontend()}) for i, text in enumerate(step.remaps)]
    elif step.what == "push":
        attributes = {"namespace": step.text.frontend()}
    elif step.what == "let":
        attributes = {"name": "b", "value": step.text.frontend()}
    elif step.what == "override":
        attributes = {"name": OVERRIDE, **({"value": step.enclave} if step.enclave else {})}
    elif not step.scoped:
        attributes = {"scoped": "false"}
    if step.condition:
        attributes["if"] = "$(var a)" if step.condition == "a" else step.condition
    kinds = {"push": "push_ros_namespace", "override": "set_env" if step.enclave else "unset_env"}
    return kinds.get(step.what, step.what), attributes, inner


def xml(steps: tuple[Step, ...]) -> str:
    found = ""
    for step in steps:
        kind, attributes, inner = _parts(step)
        below = "".join(f"<{name}{_attributes(values)}/>" for name, values in inner) + xml(step.steps)
        found += f"<{kind}{_attributes(attributes)}>{below}</{kind}>\n"
    return found


def _attributes(values: dict[str, str]) -> str:
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())


def yaml(steps: tuple[Step, ...]) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    for step in steps:
        kind, attributes, inner = _parts(step)
        content: dict[str, object] = dict(attributes)
        if inner:
            content["remap"] = [values for _name, values in inner]
        if step.what == "group":
            content["children"] = yaml(step.steps)
        found.append({kind: content if content.keys() != {"children"} else yaml(step.steps)})
    return found


def python(steps: tuple[Step, ...]) -> str:
    return f"[{', '.join(_python(step) for step in steps)}]"


def _python(step: Step) -> str:
    condition = "LaunchConfiguration('a')" if step.condition == "a" else repr(step.condition)
    last = f", condition=IfCondition({condition})" if step.condition else ""
    if step.what == "push":
        return f"PushRosNamespace({step.text.python()}{last})"
    if step.what == "let":
        return f"SetLaunchConfiguration('b', {step.text.python()}{last})"
    if step.what == "override":
        return (
            f"SetEnvironmentVariable({OVERRIDE!r}, {step.enclave!r}{last})"
            if step.enclave
            else f"UnsetEnvironmentVariable({OVERRIDE!r}{last})"
        )
    if step.what == "group":
        return f"GroupAction({python(step.steps)}, scoped={step.scoped}{last})"
    remaps = ", ".join(f"('r{i}', {text.python()})" for i, text in enumerate(step.remaps))
    enclave = f", ros_arguments=['--enclave', {step.enclave!r}]" if step.enclave else ""
    names = f"name={step.text.python()}, namespace={step.other.python()}"
    return f"Node(executable='e', {names}, remappings=[{remaps}]{enclave}{last})"


arguments = st.sampled_from([None, None, "b"])
node_names = st.builds(Text, plain=st.sampled_from(["n", "m_"]), argument=arguments)
namespaces = st.builds(Text, plain=st.sampled_from(["", "k", "/", "/k/l", "k/"]), argument=st.none()) | st.builds(
    Text, plain=st.sampled_from(["k", "/k/l/"]), argument=st.just("b")
)
targets = st.builds(Text, plain=st.sampled_from(["t", "/t/u", "~/t", "t/u_"]), argument=arguments)
enclaves = st.sampled_from([None, "/one", "/two/three", "/"])
conditions = st.sampled_from([None, None, "a", "true", "false"])
leaves = st.one_of(
    st.builds(
        Step,
        what=st.just("node"),
        condition=conditions,
        text=node_names,
        other=namespaces,
        enclave=enclaves,
        remaps=st.lists(targets, max_size=2).map(tuple),
    ),
    st.builds(
        Step,
        what=st.sampled_from(["push", "let", "override"]),
        condition=conditions,
        text=st.builds(Text, plain=st.sampled_from(["y", "z"]), argument=arguments),
        other=node_names,
        enclave=enclaves,
    ),
)
groups = st.recursive(
    st.lists(leaves, max_size=4).map(tuple),
    lambda inner: st.lists(
        leaves
        | st.builds(
            Step,
            what=st.just("group"),
            condition=conditions,
            text=node_names,
            other=node_names,
            scoped=st.booleans(),
            steps=inner,
        ),
        max_size=4,
    ).map(tuple),
    max_leaves=4,
)


@settings(max_examples=250)
@given(steps=groups)
def test_all_forms_mean_what_was_meant(steps: tuple[Step, ...], tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp()
    expected = meaning(steps, State())
    head = '<arg name="a" default="true"/><arg name="b" default="x"/>'
    arguments = [{"arg": {"name": "a", "default": "true"}}, {"arg": {"name": "b", "default": "x"}}]
    declared = "DeclareLaunchArgument('a', default_value='true'), DeclareLaunchArgument('b', default_value='x')"
    function = f"def generate_launch_description():\n    return LaunchDescription([{declared}, *{python(steps)}])\n"
    imported = "from launch.actions import UnsetEnvironmentVariable"
    texts = {
        "xml": head + xml(steps),
        "yaml": json.dumps({"launch": [*arguments, *yaml(steps)]}, indent=1),
        "py": f"{IMPORTS}\n{imported}\n\n{function}",
    }
    for form, text in texts.items():
        intent = launch(folder, text, form)
        assert unresolved(intent) == []
        assert nodes(intent) | names(intent) == expected, form


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found an empty one"),
        ("launch: [", ":1: the text is no YAML"),
        ("launch:\n\t- node:", ":2: the text is no YAML"),
        ("nodes: []", ":1: expected a map with the one key 'launch'"),
        ("[]", ":1: expected a map with the one key 'launch'"),
        ("launch: []\nmore: 1", ":1: expected a map with the one key 'launch'"),
        ("launch: []\n---\nlaunch: []", ":3: expected one document"),
        ("launch: node", ":1: expected a list of elements"),
        ("launch:\n- node", ":2: expected an element"),
        ("launch:\n- node: {exec: a}\n  group: []", ":2: expected an element"),
        ("launch:\n- node: {exec: a,\n    exec: b}", ":3: the key 'exec' a second time"),
        ("launch:\n- node: {? [a] : b}", ":2: expected a text as a key"),
        ("launch:\n- &a node: {exec: a}", ":2: an anchor or alias"),
        ("launch:\n- *a", ":2: "),
        ("launch:\n- node: {<<: {exec: a}}", ":2: the key '<<'"),
        ("launch:\n- node: {exec: !!str a}", ":2: the tag"),
        ("launch:\n- node: {name: a}", ":2: expected 'node' to have 'exec'"),
        ("launch: " + "[" * 100, "more than 32 deep"),
        ("launch: " + "[" * 200_000, "more than 32 deep"),
        ("launch: \x07", "is no YAML"),
        ("a: b\n" * 60_000, "characters of YAML"),
    ],
)
def test_what_is_no_launch_file_in_yaml_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "some.launch.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(UsageError) as refused:
        read_launch(path, {})
    assert refused.value.message.startswith(f"{path}:")
    assert said in refused.value.message


def test_scalars_of_yaml_are_texts_as_written(tmp_path: Path) -> None:
    text = "launch:\n- node: {exec: e, name: yes, namespace: '007', if: true, unless: 0}\n"
    assert nodes(launch(tmp_path, text.replace("'007'", "a007"), "yaml")) == {("/", "/a007/yes")}


def _read(path: Path) -> Intent | str:
    try:
        return read_launch(path, {"limited": "true"})
    except UsageError as error:
        return error.message


@pytest.mark.parametrize("form", ["xml", "yaml", "py"])
def test_changed_samples_are_read_or_refused(form: str, tmp_path: Path) -> None:
    path = tmp_path / f"changed.launch.{form}"
    samples = [sample.read_bytes() for sample in sorted(LAUNCH.glob(f"*.{form}"))]

    @settings(max_examples=250)
    @given(edited(st.sampled_from(samples)))
    def check(data: bytes) -> None:
        path.write_bytes(data)
        found = _read(path)
        if isinstance(found, str):
            assert found.startswith(str(path))
        else:
            enclaves = dict(found.enclaves)
            assert all(node.enclave in enclaves for node in (*found.nodes, *found.names, *found.rights))
            assert found == _read(path)

    check()
