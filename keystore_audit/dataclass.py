"""`dataclass`: what the standard library's decorator makes of our values, at an eighth of its cost.

An audit of four enclaves makes two hundred classes when it starts. For each the standard library writes, compiles and
runs six functions, a third of that audit's time (docs/performance.md). Here only the constructor is compiled, when the
first instance is made, and it writes straight into the slots; `replace` reads all fields in one go. `field` and
`fields` are the standard library's; they, `copy` and `pickle` work as for any other dataclass.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import MISSING, FrozenInstanceError, field, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

__all__ = ["dataclass", "field", "fields", "replace"]


class _Part(NamedTuple):
    """What was declared of one field."""

    default: object
    factory: object
    shown: bool
    kw_only: bool


class _Fields:
    """`__dataclass_fields__`, by which the standard library knows a dataclass: made where somebody asks."""

    def __get__(self, value: object, cls: type) -> dict[str, Any]:
        """Return the fields of the standard library's own dataclass of the same declarations."""
        parts = cls.__parts__  # type: ignore[attr-defined]
        declared = {
            name: field(default=part.default, default_factory=part.factory, repr=part.shown, kw_only=part.kw_only)
            for name, part in parts.items()
        }
        body = {**declared, "__annotations__": dict.fromkeys(parts, object), "__module__": cls.__module__}
        twin: Any = dataclasses.dataclass(init=False, repr=False, eq=False)(type(cls.__name__, (), body))
        found: dict[str, Any] = twin.__dataclass_fields__
        cls.__dataclass_fields__ = found  # type: ignore[attr-defined]
        return found


_FIELDS: Final = _Fields()


def _dataclass(*, slots: bool, frozen: bool = False, kw_only: bool = False, eq: bool = True) -> Callable[[Any], Any]:
    """Decorate a class as `dataclasses.dataclass` does with the same arguments; slots it has to have.

    Raises TypeError for a class without slots.
    """
    if not slots:
        raise TypeError("only for classes with slots=True")

    def made(cls: Any) -> Any:
        own = {name: _part(cls.__dict__.get(name, MISSING), kw_only) for name in cls.__annotations__}
        inherited = _inherited(cls)
        parts = {**inherited, **own}
        given = {name: each for name, each in cls.__dict__.items() if name not in own}
        body = {**_behaviour(parts, frozen=frozen, eq=eq), **given}
        if frozen and eq and given.get("__hash__") is None:  # what Python puts where only `__eq__` is written
            body["__hash__"] = _hashing(parts)
        for name in ("__dict__", "__weakref__"):
            body.pop(name, None)
        body["__slots__"] = tuple(name for name in own if name not in inherited)
        result = type(cls)(cls.__name__, cls.__bases__, body)
        result.__qualname__ = cls.__qualname__
        if "__init__" not in given:
            result.__init__ = _constructor(result)
        return result

    return made


def _replace(value: Any, /, **changes: object) -> Any:
    """What `dataclasses.replace` returns."""
    cls = type(value)
    return cls(**dict(zip(cls.__parts__, cls.__values__(value), strict=True)) | changes)


if TYPE_CHECKING:
    from dataclasses import dataclass, replace
else:
    dataclass, replace = _dataclass, _replace


def _part(declared: object, kw_only: bool) -> _Part:
    if isinstance(declared, dataclasses.Field):
        return _Part(declared.default, declared.default_factory, declared.repr, kw_only)
    return _Part(declared, MISSING, True, kw_only)


def _inherited(cls: type[Any]) -> Mapping[str, _Part]:
    """The fields of the base classes, first declared first."""
    return {
        name: part for each in reversed(cls.__mro__[1:]) for name, part in each.__dict__.get("__parts__", {}).items()
    }


def _behaviour(parts: Mapping[str, _Part], *, frozen: bool, eq: bool) -> dict[str, object]:
    """What such a class has unless its author wrote it, the constructor apart."""
    found: dict[str, object] = {
        "__parts__": parts,
        "__values__": _values(parts),
        "__dataclass_fields__": _FIELDS,
        "__match_args__": tuple(name for name, part in parts.items() if not part.kw_only),
        "__repr__": _shown,
    }
    if eq:
        found |= {"__eq__": _equality(parts), "__hash__": None}
    if frozen:
        found |= {
            "__setattr__": _refuse_to_set,
            "__delattr__": _refuse_to_delete,
            "__getstate__": _state,
            "__setstate__": _restore,
        }
    return found


def _values(parts: Mapping[str, _Part]) -> Callable[[object], object]:
    """What reads the values of all fields of an instance, as one that can be compared and hashed."""
    if len(parts) > 1:
        return attrgetter(*parts)
    return lambda value: tuple(getattr(value, name) for name in parts)


def _equality(parts: Mapping[str, _Part]) -> Callable[[object, object], bool]:
    values = _values(parts)

    def equal(self: object, other: object) -> bool:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    return equal


def _hashing(parts: Mapping[str, _Part]) -> Callable[[object], int]:
    values = _values(parts)
    return lambda self: hash(values(self))


def _constructor(cls: type[Any]) -> Callable[..., None]:
    """A constructor that makes way for the compiled one when it is called first."""

    def construct(self: object, *args: object, **values: object) -> None:
        cls.__init__ = _compiled(cls)
        cls.__init__(self, *args, **values)

    return construct


def _compiled(cls: type[Any]) -> Callable[..., None]:
    """The constructor of `cls`, with the fields as its parameters."""
    scope: dict[str, Any] = {"_absent": MISSING}
    positional: list[str] = []
    named: list[str] = []
    lines: list[str] = []
    for name, part in cls.__parts__.items():
        # By the slot itself: a frozen class lets nobody else write, and by name it would be sought each time.
        scope[f"_set_{name}"] = getattr(cls, name).__set__
        value, default = name, ""
        if part.factory is not MISSING:
            scope[f"_make_{name}"] = part.factory
            value, default = f"_make_{name}() if {name} is _absent else {name}", "=_absent"
        elif part.default is not MISSING:
            scope[f"_default_{name}"] = part.default
            default = f"=_default_{name}"
        (named if part.kw_only else positional).append(name + default)
        lines.append(f"    _set_{name}(self, {value})")
    parameters = ["self", *positional, *(["*", *named] if named else [])]
    # The text is made of the names of fields in our own source, nothing else.
    exec("\n".join([f"def __init__({', '.join(parameters)}):", *lines, "    return None"]), scope)  # noqa: S102
    made: Callable[..., None] = scope["__init__"]
    made.__qualname__ = f"{cls.__qualname__}.__init__"
    made.__module__ = cls.__module__
    return made


def _shown(self: Any) -> str:
    """`__repr__`: the class and its fields, but for those that are not to be shown."""
    shown = ", ".join(f"{name}={getattr(self, name)!r}" for name, part in self.__parts__.items() if part.shown)
    return f"{type(self).__qualname__}({shown})"


def _refuse_to_set(_self: object, name: str, _value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_to_delete(_self: object, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[object]:
    """`__getstate__`, for `copy` and `pickle`: the fields' values."""
    return [getattr(self, name) for name in self.__parts__]


def _restore(self: Any, state: list[object]) -> None:
    """`__setstate__`, into the slots of a new instance."""
    for name, value in zip(self.__parts__, state, strict=True):
        object.__setattr__(self, name, value)
