"""What expressions in a Python launch file can stand for, as far as reading tells: the file is never run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from keystore_audit.dataclass import dataclass, field, replace
from keystore_audit.intent.launch_actions import Comparison, Condition, LaunchAction, NodeNames, Part, Text, Unknown

MAX_PARTS: Final = 256
"""Pieces of one text, and thousands of characters in it: `x + x` doubles each time."""

MAX_LENGTH: Final = 4096
MAX_SIZE: Final = 20_000
"""Values in one list, those in lists in it counted: as many as actions are followed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A module, class or function of another module; `path`: with dots, as it is imported from."""

    path: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TextValue:
    """A string, path or substitution. `plain`: a string to Python, which can be joined with `+`."""

    text: Text
    plain: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Plain:
    """A number, a truth value or None."""

    value: bool | int | float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Items:
    """A list or tuple that nothing changes any longer; `size`: values in it, at every depth."""

    line: int
    items: tuple[Value, ...]
    size: int


@dataclass(slots=True, kw_only=True)
class Growing:
    """A list or launch description that a name stands for, which statements may add to.

    `used`: it is part of something else already, which an addition would change. `description`: it is what
    `generate_launch_description` may return.
    """

    items: list[Value] = field(default_factory=list)
    used: bool = False
    description: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairs:
    """A dictionary. `inherited`: with all variables that there were when launch read the file, unless it has others."""

    pairs: tuple[tuple[Value, Value], ...]
    inherited: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionValue:
    """An action, and for a node that others are loaded into its name."""

    action: LaunchAction
    name: Text | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentValue:
    """A ComposableNode."""

    names: NodeNames


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionValue:
    """A condition, or a substitution that compares."""

    condition: Condition | Comparison


@dataclass(frozen=True, slots=True, kw_only=True)
class HandlerValue:
    """An event handler: what it starts when its event comes."""

    actions: tuple[LaunchAction, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Opaque:
    """A value that reading does not tell; `reason`: what it is, words."""

    line: int
    reason: str


Value = (
    Imported
    | TextValue
    | Plain
    | Items
    | Growing
    | Pairs
    | ActionValue
    | ComponentValue
    | ConditionValue
    | HandlerValue
    | Opaque
)

NONE: Final = Plain(value=None)


def dictionary(value: Value) -> Value:
    """The value, `os.environ` as the dictionary that it is."""
    is_environ = isinstance(value, Imported) and value.path == "os.environ"
    return Pairs(pairs=(), inherited=True) if is_environ else value


def with_entries(held: Pairs, entries: Mapping[str, Value]) -> Pairs:
    """A dictionary with these entries, too."""
    return replace(held, pairs=(*held.pairs, *((TextValue(text=(key,)), value) for key, value in entries.items())))


def frozen(value: Value, line: int) -> Value:
    """The value as part of another: a list is taken as it is now."""
    if not isinstance(value, Growing):
        return value
    value.used = True
    return sequence(value.items, line)


def sequence(items: Iterable[Value], line: int) -> Items | Opaque:
    """A list of values that are parts already."""
    found = tuple(items)
    size = 1 + sum(item.size if isinstance(item, Items) else 1 for item in found)
    if size > MAX_SIZE:
        return Opaque(line=line, reason=f"a list of more than {MAX_SIZE} values")
    return Items(line=line, items=found, size=size)


def bounded(parts: Iterable[Part]) -> Text:
    """A text of these pieces, strings joined; an Unknown where it is too long."""
    found: list[Part] = []
    for part in parts:
        if isinstance(part, str) and found and isinstance(found[-1], str):
            found[-1] += part
        elif part != "":
            found.append(part)
    length = sum(len(part) for part in found if isinstance(part, str))
    if len(found) > MAX_PARTS or length > MAX_LENGTH:
        return (Unknown(reason=f"a text of more than {MAX_LENGTH} characters"),)
    return tuple(found)


def text_of(value: Value) -> Text:
    """The text that launch makes of a value: of a list, its pieces joined."""
    if isinstance(value, TextValue):
        return value.text
    if isinstance(value, Items):
        return bounded(part for item in value.items for part in text_of(item))
    if isinstance(value, Plain) and value.value is not None:
        return (str(value.value),)
    if isinstance(value, Opaque):
        return (Unknown(reason=value.reason),)
    return (Unknown(reason="a value that is no text"),)
