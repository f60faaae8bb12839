"""What calling a class of launch or launch_ros makes: actions, substitutions, conditions (Humble to Rolling)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from keystore_audit.dataclass import replace
from keystore_audit.intent.launch_actions import (
    Assign,
    AssignEnvironment,
    Comparison,
    Condition,
    Declare,
    Group,
    Include,
    LaunchAction,
    LoadComponents,
    NodeKind,
    NodeNames,
    PushNamespace,
    Reference,
    Remap,
    SetRemap,
    StartNode,
    StartProcess,
    Text,
    Unknown,
    Unread,
    Variable,
)
from keystore_audit.intent.launch_environment import replaced
from keystore_audit.intent.python_calls import Call
from keystore_audit.intent.python_values import (
    NONE,
    ActionValue,
    ComponentValue,
    ConditionValue,
    Growing,
    HandlerValue,
    Items,
    Opaque,
    Pairs,
    TextValue,
    Value,
    bounded,
    dictionary,
    text_of,
)


def actions_of(value: Value, line: int) -> Iterator[LaunchAction]:
    """The actions that a value is: an action, or a list of them."""
    if isinstance(value, ActionValue):
        yield value.action
    elif isinstance(value, Items):
        for item in value.items:
            yield from actions_of(item, line)
    elif isinstance(value, Opaque):
        said = f"{value.reason} may start nodes or change their names"
        yield Unread(line=value.line, reason=said)
    elif value != NONE:
        yield Unread(line=line, reason="a value that is no action may start nodes or change their names")


def _substitution(call: Call) -> Value:
    """A substitution whose value may be worked out."""
    return TextValue(text=_substituted(call), plain=False)


def _substituted(call: Call) -> Text:
    if call.name == "TextSubstitution":
        return call.text("text")
    if call.name == "ThisLaunchFile":
        return (Unknown(reason="the path of the launch file"),)
    if call.name == "ThisLaunchFileDir":
        return (Reference(variable=Variable.DIRECTORY),)
    if call.name == "PathJoinSubstitution":
        parts = [part for value in call.listed("substitutions", 0) for part in ("/", *text_of(value))]
        return bounded(parts[1:])
    if call.name == "LaunchConfiguration":
        default = call.optional("default", 1, "default_value")
        return (Reference(variable=Variable.ARGUMENT, name=call.text("variable_name", 0), default=default),)
    default = call.optional("default", 1, "default_value")
    return (Reference(variable=Variable.ENVIRONMENT, name=call.text("name", 0), default=default),)


def _comparison(call: Call) -> Value:
    negated = "Not" in call.name
    if call.name.startswith("LaunchConfiguration"):
        left: Text = (Reference(variable=Variable.ARGUMENT, name=call.text("launch_configuration_name", 0)),)
        right = call.text("expected_value", 1)
    else:
        left, right = call.text("left", 0), call.text("right", 1)
    return ConditionValue(condition=Comparison(left=left, right=right, negated=negated))


def _condition(call: Call) -> Value:
    value = call.get("predicate_expression", 0)
    negated = call.name == "UnlessCondition"
    if isinstance(value, ConditionValue) and isinstance(value.condition, Comparison):
        inner = value.condition
        flipped = Comparison(left=inner.left, right=inner.right, negated=inner.negated is not negated)
        return ConditionValue(condition=flipped)
    return ConditionValue(condition=Condition(text=text_of(value), negated=negated))


def _pairs(values: Iterator[Value]) -> Iterator[tuple[int | None, Text, Text]]:
    """From and to of each pair in a list, or name and value; Unknown twice for what is no pair."""
    for value in values:
        if isinstance(value, Items) and len(value.items) == 2:
            yield value.line, text_of(value.items[0]), text_of(value.items[1])
        else:
            unknown = (Unknown(reason=value.reason if isinstance(value, Opaque) else "a value that is no pair"),)
            yield (value.line if isinstance(value, Opaque) else None), unknown, unknown


def _mapping(value: Value) -> tuple[tuple[Text, Text], ...]:
    """Names and values, of a dictionary or a list of pairs."""
    if isinstance(value, Pairs):
        return tuple((text_of(key), text_of(entry)) for key, entry in value.pairs)
    if isinstance(value, Items):
        return tuple((name, entry) for _line, name, entry in _pairs(iter(value.items)))
    return () if value == NONE else ((text_of(value), text_of(value)),)


def _names(call: Call, conditions: tuple[Condition | Comparison, ...] = ()) -> NodeNames:
    remaps = _pairs(call.listed("remappings"))
    return NodeNames(
        line=call.line,
        name=call.optional("name", other="node_name"),
        namespace=call.optional("namespace", other="node_namespace"),
        remaps=tuple(Remap(line=line or call.line, source=source, target=target) for line, source, target in remaps),
        conditions=conditions,
    )


def _components(values: Iterator[Value], line: int) -> tuple[tuple[NodeNames, ...], tuple[Unread, ...]]:
    """The components in a list, and what may be one."""
    found: list[NodeNames] = []
    unread: list[Unread] = []
    for value in values:
        if isinstance(value, ComponentValue):
            found.append(value.names)
        else:
            reason = value.reason if isinstance(value, Opaque) else "a value that is no ComposableNode"
            unread.append(Unread(line=line, reason=f"{reason} may be nodes to be loaded"))
    return tuple(found), tuple(unread)


def _words(call: Call, keyword: str) -> tuple[tuple[Text, ...], tuple[Text, ...]]:
    """The words of a command line, and Unknown ones that may be any number of words."""
    value = call.get(keyword)
    if isinstance(value, Items):
        return tuple(text_of(item) for item in value.items), ()
    return ((), ()) if value == NONE else ((), (text_of(value),))


def _node(call: Call) -> Value:
    kind = {"LifecycleNode": NodeKind.LIFECYCLE, "ComposableNodeContainer": NodeKind.CONTAINER}.get(call.name)
    components, unread = _components(call.listed("composable_node_descriptions"), call.line)
    arguments, unknown = _words(call, "arguments")
    ros_arguments, unknown_ros = _words(call, "ros_arguments")
    start = StartNode(
        **call.where,
        kind=kind or NodeKind.PLAIN,
        names=(names := _names(call)),
        command=(call.text("package"), call.text("executable", other="node_executable")),
        arguments=arguments,
        ros_arguments=(*unknown, *ros_arguments, *unknown_ros),
        components=components,
        **_environment_of(call),
    )
    return ActionValue(action=_with(start, (*unread, *_on_exit(call))), name=names.name)


def _environment_of(call: Call) -> dict[str, Any]:
    given = [dictionary(call.get("env")), dictionary(call.get("additional_env"))]
    inherited = [isinstance(each, Pairs) and each.inherited for each in given]
    variables, clean = (*_mapping(given[0]), *_mapping(given[1])), given[0] != NONE and not inherited[0]
    return {"environment": variables, "clean": clean, "earlier": any(inherited), "prefix": call.optional("prefix")}


def _with(action: LaunchAction, more: tuple[LaunchAction, ...]) -> LaunchAction:
    return Group(line=action.line, actions=(action, *more), scoped=False) if more else action


def _on_exit(call: Call) -> tuple[LaunchAction, ...]:
    """What comes when a process has ended, which changes nothing for what stands behind it."""
    actions = tuple(actions_of(call.get("on_exit"), call.line))
    return (Group(**call.where, actions=actions, later=True),) if actions else ()


def _load(call: Call) -> Value:
    target = call.get("target_container")
    name = target.name if isinstance(target, ActionValue) else text_of(target)
    components, unread = _components(call.listed("composable_node_descriptions"), call.line)
    known = name or (Unknown(reason="a container without a name"),)
    return ActionValue(action=_with(LoadComponents(**call.where, target=known, components=components), unread))


def _group(call: Call) -> Value:
    actions = tuple(actions_of(call.get("actions", 0), call.line))
    group = Group(
        **call.where,
        actions=actions,
        scoped=call.switch("scoped"),
        forwarding=call.switch("forwarding"),
        given=_mapping(call.get("launch_configurations")),
    )
    return ActionValue(action=group)


def _later(call: Call) -> Value:
    """A timer: its actions come later, and change nothing for what stands behind it."""
    actions = tuple(actions_of(call.get("actions", 1 if call.name == "TimerAction" else None), call.line))
    return ActionValue(action=Group(**call.where, actions=actions, later=True))


def _handler(call: Call) -> Value:
    """An event handler; its actions are in arguments called `on_…`, `entities` or `entity`."""
    given = (value for key, value in call.keywords.items() if key.startswith(("on_", "entit")))
    listed = (value for value in (*given, *call.positional) if value != NONE)
    return HandlerValue(actions=tuple(action for value in listed for action in actions_of(value, call.line)))


def _register(call: Call) -> Value:
    handler = call.get("event_handler", 0)
    unread = Unread(line=call.line, reason="an event handler that is not read may start nodes")
    actions = handler.actions if isinstance(handler, HandlerValue) else (unread,)
    return ActionValue(action=Group(**call.where, actions=actions, later=True))


def _include(call: Call) -> Value:
    source = call.get("launch_description_source", 0)
    arguments = _mapping(call.get("launch_arguments"))
    return ActionValue(action=Include(**call.where, path=text_of(source), arguments=arguments))


def _source(call: Call) -> Value:
    return TextValue(text=call.text("launch_file_path", 0), plain=False)


def _description(call: Call) -> Value:
    initial = call.get("initial_entities", 0)
    items: tuple[Value, ...] = initial.items if isinstance(initial, Items) else () if initial == NONE else (initial,)
    return Growing(items=list(items), description=True)


def _set(call: Call) -> Value:
    action: LaunchAction
    if call.name == "DeclareLaunchArgument":
        default = call.optional("default_value", 1)
        action = Declare(**call.where, name=call.text("name", 0), default=default)
    elif call.name == "SetLaunchConfiguration":
        action = Assign(**call.where, name=call.text("name", 0), value=call.text("value", 1))
    elif call.name == "UnsetLaunchConfiguration":
        action = Assign(**call.where, name=call.text("name", 0), value=None)
    elif call.name.endswith("EnvironmentVariable"):
        added: Text = (Unknown(reason="an environment variable that is added to"),)
        values = {"Set": call.text("value", 1), "Unset": None, "Append": added}
        value = values[call.name.removesuffix("EnvironmentVariable")]
        action = AssignEnvironment(**call.where, name=call.text("name", 0), value=value)
    elif call.name == "SetRemap":
        remap = Remap(line=call.line, source=call.text("src", 0), target=call.text("dst", 1))
        action = SetRemap(**call.where, remap=remap)
    else:
        action = PushNamespace(**call.where, namespace=call.text("namespace", 0))
    return ActionValue(action=action)


def _environment(call: Call) -> Value:
    """All variables are replaced, by those that are named or by earlier ones."""
    given = dictionary(call.get("environment", 0))
    earlier = call.name != "ReplaceEnvironmentVariables" or (isinstance(given, Pairs) and given.inherited)
    values = _mapping(given)
    return ActionValue(action=replaced(values, **call.where, earlier=earlier))


def _inert(call: Call) -> Value:
    return ActionValue(action=Group(line=call.line, actions=()))


def _process(call: Call) -> Value:
    """A process, or an Executable, which describes one of ExecuteLocal's."""
    told = call.get("process_description")
    process = StartProcess(line=call.line, command=_words(call, "cmd")[0], **_environment_of(call))
    if isinstance(told, ActionValue) and isinstance(told.action, StartProcess):
        process = told.action
    return ActionValue(action=_with(replace(process, conditions=call.conditions), _on_exit(call)))


def _function(call: Call) -> Value:
    reason = "a function runs here, which is not called; it may start nodes or change their names"
    return ActionValue(action=Unread(**call.where, reason=reason))


def _component(call: Call) -> Value:
    return ComponentValue(names=_names(call, call.conditions))


def _table() -> Mapping[str, Callable[[Call], Value]]:
    by_reader: dict[Callable[[Call], Value], str] = {
        _substitution: "LaunchConfiguration EnvironmentVariable TextSubstitution ThisLaunchFileDir ThisLaunchFile "
        "PathJoinSubstitution",
        _comparison: "EqualsSubstitution NotEqualsSubstitution LaunchConfigurationEquals LaunchConfigurationNotEquals",
        _condition: "IfCondition UnlessCondition",
        _node: "Node LifecycleNode ComposableNodeContainer",
        _component: "ComposableNode ComposableLifecycleNode",
        _load: "LoadComposableNodes",
        _group: "GroupAction",
        _later: "TimerAction ROSTimer RosTimer",
        _handler: "OnProcessExit OnProcessStart OnProcessIO OnExecutionComplete OnShutdown OnActionEventBase "
        "OnStateTransition OnIncludeLaunchDescription",
        _register: "RegisterEventHandler",
        _include: "IncludeLaunchDescription",
        _source: "PythonLaunchDescriptionSource XMLLaunchDescriptionSource YAMLLaunchDescriptionSource "
        "AnyLaunchDescriptionSource FrontendLaunchDescriptionSource",
        _description: "LaunchDescription",
        _set: "DeclareLaunchArgument SetLaunchConfiguration UnsetLaunchConfiguration SetEnvironmentVariable "
        "UnsetEnvironmentVariable AppendEnvironmentVariable SetRemap PushRosNamespace PushROSNamespace",
        _environment: "ReplaceEnvironmentVariables ResetEnvironment PopEnvironment",
        _inert: "LogInfo LogDebug LogWarning LogError SetParameter SetParametersFromFile SetUseSimTime SetROSLogDir "
        "PushEnvironment Shutdown EmitEvent LifecycleTransition",
        _process: "ExecuteProcess ExecuteLocal Executable",
        _function: "OpaqueFunction OpaqueCoroutine",
    }
    return {name: read for read, names in by_reader.items() for name in names.split()}


CLASSES: Final = _table()
"""By the name of the class, what calling it makes."""

RUN: Final = {
    "FindPackageShare": "where a package is installed",
    "FindPackagePrefix": "where a package is installed",
    "FindExecutable": "where a program is installed",
    "ExecutableInPackage": "where a program is installed",
    "Command": "the output of a command, which is not run",
    "PythonExpression": "the result of an expression, which is not evaluated",
    "AnonName": "a name with a part that is new each time",
}
"""Substitutions that only a running launch works out."""
