"""`keystore_audit.dataclass` beside the standard library's decorator: the same declarations, the same behaviour."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit import dataclass as ours

Decorator = Callable[..., Any]
NAMES = st.lists(st.sampled_from(["path", "line", "set_path", "default_line", "value", "args", "self_"]), unique=True)
VALUES = st.one_of(st.integers(0, 3), st.text(max_size=2), st.none(), st.tuples(st.integers(0, 1)))
OPTIONS = st.fixed_dictionaries({"frozen": st.booleans(), "kw_only": st.booleans(), "eq": st.booleans()})


@dataclasses.dataclass(frozen=True)
class Declared:
    """One field as it is declared."""

    name: str
    default: object
    made: bool
    shown: bool


DECLARED = st.builds(Declared, st.just(""), st.one_of(st.just(MISSING), VALUES), st.booleans(), st.booleans())


@st.composite
def declarations(draw: st.DrawFn) -> list[Declared]:
    """Fields in an order that a dataclass may have: those without defaults first."""
    fields = [dataclasses.replace(draw(DECLARED), name=name) for name in draw(NAMES)]
    return sorted(fields, key=lambda each: each.default is not MISSING and not each.made)


def build(decorate: Decorator, fields: list[Declared], base: type, options: dict[str, bool]) -> type[Any]:
    """A class of these fields."""
    body: dict[str, Any] = {
        each.name: dataclasses.field(default_factory=list, repr=each.shown)
        if each.made
        else dataclasses.field(default=each.default, repr=each.shown)
        for each in fields
    }
    # Those that are made anew each time have a default, hence stand behind.
    ordered = sorted(fields, key=lambda each: each.made or each.default is not MISSING)
    body["__annotations__"] = {each.name: "object" for each in ordered}
    made: type[Any] = decorate(slots=True, **options)(type("Sample", (base,), body))
    return made


def outcome(work: Callable[..., object], *values: Any, **named: object) -> object:
    """What comes of it: a value, or the kind of error and its message."""
    try:
        return work(*values, **named)
    except TypeError as error:
        return TypeError, str(error)
    except FrozenInstanceError:
        return FrozenInstanceError


def text(cls: type[Any], **values: object) -> str:
    """What an instance shows of itself."""
    return repr(cls(**values))


def alike(first: object, second: object) -> tuple[object, object]:
    """Whether two instances are equal, and their hashes, where they have any."""
    return first == second, outcome(lambda: hash(first) == hash(second))


def declared_of(value: Any) -> list[tuple[object, ...]]:
    """What the standard library knows of the fields."""
    return [(each.name, each.repr, each.kw_only, each.default) for each in dataclasses.fields(value)]


GIVEN = st.dictionaries(st.sampled_from(["path", "line", "value", "other"]), VALUES)


@given(declarations(), declarations(), OPTIONS, GIVEN, st.booleans())
def test_a_class_behaves_as_the_standard_library_s(
    above: list[Declared], fields: list[Declared], options: dict[str, bool], values: dict[str, object], whole: bool
) -> None:
    """Construction, its errors, text, equality, hashes, copies, fields and replacement, with a base class."""
    options = {**options, "kw_only": options["kw_only"] or bool(above)}
    mine, theirs = (
        build(decorate, fields, build(decorate, above, object, options), options)
        for decorate in (ours.dataclass, dataclasses.dataclass)
    )
    if whole:
        values = dict.fromkeys(theirs.__dataclass_fields__, 1)
    shown = outcome(text, mine, **values)
    assert shown == outcome(text, theirs, **values)
    if not isinstance(shown, str):
        return
    first, peer = mine(**values), theirs(**values)
    assert alike(first, mine(**values)) == alike(peer, theirs(**values))
    assert first != peer
    assert declared_of(first) == declared_of(peer)
    assert mine.__match_args__ == theirs.__match_args__
    assert repr(copy.copy(first)) == repr(copy.copy(peer)) == shown
    with pytest.raises(TypeError):
        ours.replace(first, nothing_of_the_kind=1)
    for name, *_ in declared_of(peer)[:1]:
        for replace in (ours.replace, dataclasses.replace):
            assert repr(replace(first, **{str(name): 7})) == repr(dataclasses.replace(peer, **{str(name): 7}))
        assert outcome(setattr, first, name, 8) == outcome(setattr, peer, name, 8)
        assert repr(first) == repr(peer)
    with pytest.raises((AttributeError, TypeError)):
        first.nothing_of_the_kind = 1


@ours.dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A value that can be pickled: its module has it by name."""

    path: str
    lines: tuple[int, ...] = ()


@ours.dataclass(frozen=True, slots=True)
class Written:
    """A class whose author wrote some of it."""

    text: str

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Written) and self.text.lower() == other.text.lower()

    def __hash__(self) -> int:
        return 1

    def __repr__(self) -> str:
        return "written"


def test_what_the_author_wrote_stays() -> None:
    """Equality, hash and text of the class itself come before ours."""
    assert Written("A") == Written("a")
    assert (hash(Written("A")), repr(Written("A"))) == (1, "written")


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_it_can_be_pickled(protocol: int) -> None:
    """Copies of the process hand values back in this way."""
    place = Place(path="a", lines=(1, 2))
    again = pickle.loads(pickle.dumps(place, protocol))
    assert again == place
    assert hash(again) == hash(place)
    assert again is not place


def test_a_frozen_value_stays_as_it_is() -> None:
    """Neither fields nor other names can be set or deleted."""
    place = Place(path="a")
    with pytest.raises(FrozenInstanceError, match="path"):
        place.path = "b"  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError, match="path"):
        del place.path
    assert place == Place(path="a")


def test_a_class_without_slots_is_refused() -> None:
    """Nothing here needs one."""
    with pytest.raises(TypeError, match="slots"):
        ours.dataclass(slots=False)
