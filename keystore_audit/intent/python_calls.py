"""A call in a Python launch file, and the arguments that a class of launch or launch_ros asks of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from keystore_audit.dataclass import dataclass
from keystore_audit.intent.launch_actions import Comparison, Condition, Text, Unknown
from keystore_audit.intent.python_values import NONE, ConditionValue, Items, Opaque, Plain, Value, text_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A call with its arguments, all worked out as far as they can be. `name`: of the class, without its module."""

    line: int
    name: str
    positional: Sequence[Value]
    keywords: Mapping[str, Value]

    def get(self, keyword: str, position: int | None = None, other: str = "") -> Value:
        """The argument of that keyword, or its `other` name, or at that position; None where it is not given."""
        for key in (keyword, other):
            if key in self.keywords:
                return self.keywords[key]
        if position is not None and position < len(self.positional):
            return self.positional[position]
        return NONE

    def text(self, keyword: str, position: int | None = None, other: str = "") -> Text:
        """An argument that has to be there."""
        value = self.get(keyword, position, other)
        return text_of(value) if value != NONE else (Unknown(reason=f"{keyword!r}, which is not given"),)

    def optional(self, keyword: str, position: int | None = None, other: str = "") -> Text | None:
        """An argument that may be missing or None."""
        value = self.get(keyword, position, other)
        return text_of(value) if value != NONE else None

    def listed(self, keyword: str, position: int | None = None) -> Iterator[Value]:
        """The values of a list; one Opaque where it is none."""
        value = self.get(keyword, position)
        if isinstance(value, Items):
            yield from value.items
        elif value != NONE:
            yield value if isinstance(value, Opaque) else Opaque(line=self.line, reason="a value that is no list")

    @property
    def conditions(self) -> tuple[Condition | Comparison, ...]:
        """The condition of an action."""
        value = self.get("condition")
        if value == NONE:
            return ()
        if isinstance(value, ConditionValue):
            return (value.condition,)
        return (Condition(text=text_of(value)),)

    @property
    def where(self) -> dict[str, Any]:
        """What every action has: its line and condition."""
        return {"line": self.line, "conditions": self.conditions}

    def switch(self, keyword: str) -> bool:
        """An argument that is True unless it says False."""
        return self.get(keyword) != Plain(value=False)
