"""Users' settings, `keystore-audit.toml`: what they assert of their keystore (docs/settings.md)."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime, time, timezone
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, NoReturn

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location, Severity
from keystore_audit.model.claim import Attacker, ClaimKind
from keystore_audit.model.claims import Claim, Globs
from keystore_audit.properties import BY_ID
from keystore_audit.settings_positions import Path as KeyPath
from keystore_audit.settings_positions import Position, positions

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FILE_NAME: Final = "keystore-audit.toml"

MAX_BYTES: Final = 1_000_000
"""A settings file is written by people."""

_NAME: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_WHERE: Final = re.compile(r" \(at line (\d+), column (\d+)\)$")
OUTSIDER: Final = "outsider"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What a settings file says. `path` as it was given or found; `sha256` of its bytes, in hexadecimal."""

    path: str
    sha256: str
    claims: tuple[Claim, ...] = ()


def read_settings(path: Path, keystores: Iterable[str | Path] = ()) -> Settings:
    """The settings in the file at `path`.

    Raises errors.UsageError, with line and column, for what is no settings file; and for one that lies in one of the
    `keystores`, which could then absolve itself.
    """
    here = path.resolve()
    for keystore in keystores:
        root = Path(keystore).resolve()
        if root == here or root in here.parents:
            raise UsageError(f"{path} lies in the keystore {keystore}, which would judge itself: keep it elsewhere.")
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}.") from error
    if len(content) > MAX_BYTES:
        raise UsageError(f"{path} is larger than {MAX_BYTES} bytes: no settings file.")
    return Settings(
        path=str(path), sha256=hashlib.sha256(content).hexdigest(), claims=_File(str(path), content).claims()
    )


class _File:
    """The file, and how to say where something in it is wrong."""

    def __init__(self, path: str, content: bytes) -> None:
        self._path = path
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise UsageError(f"{path}:{line}: this is not UTF-8.") from error
        text = text.replace("\r\n", "\n")
        try:
            self.values: Mapping[str, Any] = tomllib.loads(text)
            self._positions = positions(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            message = str(error) or "too deeply nested"
            where = _WHERE.search(message)
            last = f":{text.count(chr(10)) + 1}:{len(text) - text.rfind(chr(10))}"
            place = f":{where[1]}:{where[2]}" if where else last
            raise UsageError(f"{path}{place}: this is not TOML: {_WHERE.sub('', message)}.") from error

    def position(self, path: KeyPath) -> Position:
        while path not in self._positions and path:
            path = path[:-1]
        return self._positions.get(path, Position(1, 1))

    def place(self, path: KeyPath) -> str:
        position = self.position(path)
        return f"{self._path}:{position.line}:{position.column}"

    def location(self, path: KeyPath) -> Location:
        return Location(path=self._path, line=self.position(path).line, beside=True)

    def claims(self) -> tuple[Claim, ...]:
        root = _Table(self, (), self.values)
        root.only("property")
        entries = root.values.get("property", [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            root.wrong("property", "expected tables, each headed [[property]]")
        claims: dict[str, Claim] = {}
        for number, entry in enumerate(entries):
            table = _Table(self, ("property", number), entry)
            claim = _claim(table)
            if claim.id in claims:
                table.wrong("name", f"there is a property {claim.id!r} already, at {claims[claim.id].place}")
            claims[claim.id] = claim
        return tuple(claims.values())


class _Table:
    """A table of the file; every value is taken with what it is expected to be."""

    def __init__(self, file: _File, path: KeyPath, values: Mapping[str, Any]) -> None:
        self._file = file
        self._path = path
        self.values = values

    def wrong(self, key: str | None, message: str) -> NoReturn:
        """Raise UsageError for the key, None: for the table."""
        raise UsageError(f"{self.place(key)}: {message}.")

    def place(self, key: str | None = None) -> str:
        return self._file.place(self._path if key is None else (*self._path, key))

    @property
    def location(self) -> Location:
        return self._file.location(self._path)

    def only(self, *known: str) -> None:
        """Refuse other keys: a misspelt one would be without effect."""
        for key in self.values:
            if key not in known:
                nearest = get_close_matches(key, known, n=1)
                hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
                self.wrong(key, f"unknown key {key!r}; expected {', '.join(known)}{hint}".rstrip("?"))

    def table(self, key: str) -> _Table:
        if not isinstance(self.values[key], dict):
            self.wrong(key, f"expected a table, e.g. {key} = {{ ... }}")
        return _Table(self._file, (*self._path, key), self.values[key])

    def text(self, key: str) -> str:
        value = self.values.get(key)
        if not isinstance(value, str) or not value:
            self.wrong(key if key in self.values else None, f'expected {key} = "...", a string that is not empty')
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """One string, or several in an array."""
        value = self.values.get(key)
        several = value if isinstance(value, list) else [value]
        if not several or not all(isinstance(one, str) and one for one in several):
            self.wrong(key if key in self.values else None, f'expected {key} = "...", or an array of such strings')
        return tuple(several)

    def choice(self, key: str, words: tuple[str, ...]) -> str:
        value = self.values.get(key, words[0])
        if value not in words:
            self.wrong(key, f"expected {' or '.join(repr(word) for word in words)}")
        return str(value)

    def flag(self, key: str) -> bool:
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self.wrong(key, "expected true or false")
        return value

    def instant(self, key: str) -> datetime | None:
        """A date (its last second) or an instant; without a zone UTC."""
        value = self.values.get(key)
        if value is None:
            return None
        if isinstance(value, datetime):
            zoned = value if value.tzinfo is not None else value.replace(tzinfo=timezone.utc)
            try:
                return zoned.astimezone(timezone.utc).replace(microsecond=0)
            except OverflowError:
                self.wrong(key, "this instant has no UTC date")
        if not isinstance(value, date):
            self.wrong(key, "expected a date without quotes, e.g. 2027-01-31")
        return datetime.combine(value, time(23, 59, 59), timezone.utc)

    def enclaves(self, key: str) -> tuple[str, ...]:
        """Globs on enclave paths."""
        globs = self.texts(key)
        for glob in globs:
            if not glob.startswith("/"):
                self.wrong(key, f'{glob!r} is no enclave\'s path: it begins with /, e.g. "/arm/*"')
        return globs

    def topics(self, key: str) -> tuple[str, ...]:
        """Globs on ROS topics, or with dds: on DDS topics, as globs on DDS topics."""
        return tuple(self._topic(key, glob) for glob in self.texts(key))

    def _topic(self, key: str, glob: str) -> str:
        try:
            return _dds_topic(glob)
        except ValueError as error:
            self.wrong(key, str(error))

    def place_of(self, key: str) -> Globs:
        """Where a flow begins or ends."""
        try:
            return _globs(self.texts(key))
        except ValueError as error:
            self.wrong(key, str(error))


def place(word: str) -> Globs:
    """Where a flow begins or ends, written as in settings. Raises errors.UsageError."""
    try:
        return _globs((word,))
    except ValueError as error:
        raise UsageError(f"{error}.") from error


def _dds_topic(glob: str) -> str:
    """A glob on DDS topics. Raises ValueError."""
    if glob.startswith("dds:") and len(glob) > len("dds:"):
        return glob[len("dds:") :]
    if not glob.startswith("/"):
        raise ValueError(f'{glob!r} is no topic: expected "/cmd_vel", or "dds:rt/cmd_vel" for a DDS topic')
    return f"rt{glob}"


def _globs(words: tuple[str, ...]) -> Globs:
    """Enclaves, or topics, or the outsider. Raises ValueError for anything else."""
    if words == (OUTSIDER,):
        return Globs(outsider=True)
    topics = [word for word in words if word.startswith(("topic:", "dds:"))]
    if topics and len(topics) == len(words):
        return Globs(topics=tuple(_dds_topic(word.removeprefix("topic:")) for word in words))
    if topics or not all(word.startswith("/") for word in words):
        raise ValueError(
            f'{", ".join(map(repr, words))}: expected enclaves ("/arm/*"), or topics ("topic:/cmd_vel", '
            '"dds:rt/cmd_vel"), or "outsider", and one sort alone'
        )
    return Globs(enclaves=words)


def _claim(table: _Table) -> Claim:
    table.only("name", "description", "severity", "until", *_FORMS)
    forms = [form for form in _FORMS if form in table.values]
    name = table.text("name")
    if not _NAME.fullmatch(name) or name in BY_ID:
        taken = "the name of a property that is always decided" if name in BY_ID else "no name"
        table.wrong("name", f'{name!r} is {taken}; expected letters a to z, digits and hyphens, e.g. "no-leak"')
    if len(forms) != 1:
        table.wrong(None, f"expected exactly one of {', '.join(_FORMS)} in property {name!r}, found {len(forms)}")
    said = _FORMS[forms[0]](table, forms[0])
    return Claim(
        id=name,
        statement=table.text("description") if "description" in table.values else said.pop("statement"),
        severity=Severity(table.choice("severity", ("high", "critical", "medium", "low", "info"))),
        until=table.instant("until"),
        location=table.location,
        place=table.place(),
        **{key: value for key, value in said.items() if key != "statement"},
    )


def _no_flow(table: _Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("from", "to", "through", "attacker", "include_ambient")
    through = form.enclaves("through") if "through" in form.values else ()
    attacker = form.choice("attacker", ("relays", "source", "honest"))
    besides = f" except through {_listed(through)}" if through else ""
    return {
        "kind": ClaimKind.NO_FLOW,
        "attacker": Attacker(attacker),
        "source": form.place_of("from"),
        "target": form.place_of("to"),
        "through": through,
        "include_ambient": form.flag("include_ambient"),
        "statement": f"Nothing gets from {_listed(form.texts('from'))} to {_listed(form.texts('to'))}{besides}"
        f"{'' if form.flag('include_ambient') else ', apart from topics that nearly every node uses'}.",
    }


def _able(table: _Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("from", "to", "include_ambient")
    return {
        "kind": ClaimKind.ABLE,
        "attacker": Attacker.HONEST,
        "source": form.place_of("from"),
        "target": form.place_of("to"),
        "include_ambient": form.flag("include_ambient"),
        "statement": f"Data can get from {_listed(form.texts('from'))} to {_listed(form.texts('to'))}.",
    }


def _only_publish(table: _Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("topic", "enclaves")
    return {
        "kind": ClaimKind.ONLY_PUBLISH,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=form.enclaves("enclaves")),
        "target": Globs(topics=form.topics("topic")),
        "include_ambient": True,
        "statement": f"Only {_listed(form.texts('enclaves'))} may publish {_listed(form.texts('topic'))}.",
    }


def _encrypted(table: _Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("topic", "against")
    against = form.choice("against", ("outsider", "insider"))
    return {
        "kind": ClaimKind.ENCRYPTED,
        "attacker": Attacker(against),
        "source": Globs(),
        "target": Globs(topics=form.topics("topic")),
        "include_ambient": True,
        "statement": f"{_listed(form.texts('topic'))} is encrypted against "
        f"{'outsiders' if against == OUTSIDER else 'insiders that may not read it'}.",
    }


def _never_share_domain(table: _Table, key: str) -> dict[str, Any]:
    sides = table.enclaves(key)
    if len(sides) != 2:
        table.wrong(key, f"expected two globs on enclaves, found {len(sides)}")
    return {
        "kind": ClaimKind.SEPARATE_DOMAINS,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=sides[:1]),
        "target": Globs(enclaves=sides[1:]),
        "include_ambient": True,
        "statement": f"{sides[0]} and {sides[1]} can never join one domain.",
    }


_FORMS: Final[Mapping[str, Callable[[_Table, str], dict[str, Any]]]] = {
    "no_flow": _no_flow,
    "only_publish": _only_publish,
    "encrypted": _encrypted,
    "never_share_domain": _never_share_domain,
    "able": _able,
}


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)
