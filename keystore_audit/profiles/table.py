"""quirks.toml, read and checked: what is wrong with it, or with a reader of it, is an error at import.

Every peculiarity has a field of `peculiarities` and the other way about, every implementation a value of it, every
value a sentence. Who explains or folds by single peculiarities says with `check_reader` what it knows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec import Struct

from keystore_audit.profiles.peculiarities import Access, Local, Profile, Trust
from keystore_audit.profiles.routed import Release

_ROWS: Final = {"trust": Trust, "access": Access, "local": Local}
GROUP: Final = {name: group for group, row in _ROWS.items() for name in row.__struct_fields__}
"""By peculiarity the row that it is a field of."""

_NEEDED: Final[Mapping[str, tuple[str, ...]]] = {"trust": (), "access": ("cause", "matters"), "local": ("cause",)}
"""By row the columns that its readers cannot do without."""

_VERB: Final = re.compile(r"\[(\w+)\|(\w+)\]")


class TableError(Exception):
    """quirks.toml, the fields of `peculiarities` and the readers of the table do not fit together."""


class Family(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An implementation in all its releases. `middleware`: what RMW_IMPLEMENTATION calls it."""

    title: str
    middleware: tuple[str, ...] = ()


class Quirk(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A peculiarity; quirks.toml says what each column means."""

    what: str
    clause: str
    answers: dict[str, str]
    cause: str = ""
    matters: str = ""
    says: dict[str, dict[str, str]] = {}
    oracle: str = ""
    tested: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()
    read: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    note: str = ""

    def known(self, profile: Profile) -> str:
        """How it is known of an implementation: tested, measured, read, assumed; empty where nothing is said."""
        ways = ("tested", "measured", "read", "assumed")
        return next((way for who in (profile.name, profile.family) for way in ways if who in getattr(self, way)), "")


class _Table(Struct, kw_only=True, forbid_unknown_fields=True):
    family: dict[str, Family]
    quirk: dict[str, Quirk]
    implementation: dict[str, dict[str, Any]]
    routed: dict[str, Release]


def value_name(value: object) -> str:
    """How quirks.toml calls the value of a peculiarity where it has a sentence for it."""
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, bool):
        return str(value).lower()
    return "any" if value is None else "some"


def _profiles(table: _Table) -> dict[str, Profile]:
    """Every implementation; those that have all values of a row in common share it."""
    shared: dict[object, object] = {}
    found = {}
    for name in table.implementation:
        values = _values(name, table)
        if missing := GROUP.keys() - values.keys():
            raise TableError(f"quirks.toml has no value of the peculiarity {min(missing)!r} for {name}")
        for group, row in _ROWS.items():
            own = {field: values.pop(field) for field in row.__struct_fields__}
            made = msgspec.convert({field: None if value == "any" else value for field, value in own.items()}, row)
            values[group] = shared.setdefault(msgspec.structs.astuple(made), made)
        found[name] = _profile(name, values)
    return found


def _profile(name: str, values: dict[str, Any]) -> Profile:
    if unknown := values.keys() - {*Profile.__struct_fields__}:
        raise TableError(f"quirks.toml gives {name} a value of {min(unknown)!r}, and there is no such peculiarity")
    try:
        return msgspec.convert({"name": name, **values}, Profile, from_attributes=True)
    except msgspec.ValidationError as error:
        raise TableError(f"quirks.toml, {name}: {error}") from error


def _values(name: str, table: _Table) -> dict[str, Any]:
    """What the row says, and of peculiarities and family what it leaves to the row that it is like."""
    own = dict(table.implementation[name])
    like = own.pop("like", None)
    inherited = _values(like, table) if like is not None else {}
    return {key: value for key, value in inherited.items() if key in table.quirk or key == "family"} | own


def _check(table: _Table) -> None:
    """Whether the peculiarities are those that the types have, and say all that is read of them."""
    for name in table.quirk.keys() - GROUP.keys():
        raise TableError(f"quirks.toml has the peculiarity {name!r}, and no row of peculiarities.py has such a field")
    for name in GROUP.keys() - table.quirk.keys():
        raise TableError(f"peculiarities.py has the field {name!r}, and quirks.toml has no row for it")
    for name, quirk in table.quirk.items():
        for column in _NEEDED[GROUP[name]]:
            if not getattr(quirk, column):
                raise TableError(f"quirks.toml says nothing of the peculiarity {name!r} in the column {column!r}")


def _check_answers(quirks: Mapping[str, Quirk], profiles: Mapping[str, Profile]) -> None:
    for name, quirk in quirks.items():
        for profile in profiles.values():
            value = value_name(value_of(profile, name))
            if value not in quirk.answers:
                raise TableError(f"quirks.toml has no sentence for the peculiarity {name!r} being {value!r}")


def check_reader(reader: str, column: str, known: Collection[str]) -> None:
    """Raises TableError where a peculiarity has something in the column that the reader does not know."""
    for name, quirk in QUIRKS.items():
        if (said := getattr(quirk, column)) and said not in known:
            raise TableError(f"{reader} does not know {said!r}, the {column!r} of the peculiarity {name!r}")


def value_of(profile: Profile, name: str) -> Any:
    """What it does of the peculiarity."""
    return getattr(getattr(profile, GROUP[name]), name)


_TABLE: Final = msgspec.toml.decode(Path(__file__).with_name("quirks.toml").read_bytes(), type=_Table)
_check(_TABLE)
QUIRKS: Final[Mapping[str, Quirk]] = _TABLE.quirk
FAMILIES: Final[Mapping[str, Family]] = _TABLE.family
VARIANTS: Final[Mapping[str, Profile]] = _profiles(_TABLE)
_check_answers(QUIRKS, VARIANTS)
SPEC: Final = VARIANTS["spec"]
ROUTED: Final[Mapping[str, Release]] = {
    name: msgspec.structs.replace(release, name=name) for name, release in _TABLE.routed.items()
}


def answer(name: str, profile: Profile) -> str:
    """What the implementation does of the peculiarity, with the verbs as in `inflected`."""
    value = value_of(profile, name)
    told = (
        f"{value:,}" if isinstance(value, int) else value if isinstance(value, str) else ", ".join(sorted(value or ()))
    )
    return QUIRKS[name].answers[value_name(value)].replace("{}", told)


def inflected(sentence: str, *, several: bool) -> str:
    """The sentence with the verbs, `[takes|take]`, of one implementation or of several."""
    return _VERB.sub(lambda verb: verb[2 if several else 1], sentence)


def sharing(profiles: Iterable[Profile], common: Callable[[Profile], bool]) -> list[str]:
    """The profiles, named as a family where what is `common` to them is so of all its releases, else as releases."""
    named: dict[str, None] = {}
    for profile in profiles:
        whole = all(common(each) for each in VARIANTS.values() if each.family == profile.family)
        named[FAMILIES[profile.family].title if whole else profile.title] = None
    return list(named)
