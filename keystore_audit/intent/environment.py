"""The environment that a robot's processes start with, as far as security hangs on it: `--env FILE`.

The file is one of assignments, as a shell's `export`, systemd's EnvironmentFile or a container's env file has them.
Nothing is expanded or run. Source of what the variables mean: rcl's `security.c` and rmw_dds_common's `security.cpp`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location

MAX_BYTES: Final = 1024 * 1024

VARIABLES: Final = (
    "ROS_SECURITY_ENABLE",
    "ROS_SECURITY_STRATEGY",
    "ROS_SECURITY_KEYSTORE",
    "ROS_SECURITY_ENCLAVE_OVERRIDE",
    "ROS_DOMAIN_ID",
    "RMW_IMPLEMENTATION",
    "ROS_DISTRO",
)
"""Those that are looked at; others are passed over."""

_ASSIGNMENT: Final = re.compile(r"(?:export\s+)?([A-Za-z_][A-Za-z0-9_]*)=(.*)", re.DOTALL)
_QUOTED: Final = re.compile(r"""(?:'([^']*)'|"([^"\\$`]*)")\s*(?:#.*)?""")
_BARE: Final = re.compile(r"([^\s'\"\\$`#;&|<>()]*)\s*(?:\s#.*)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """The value of a variable, and the line that sets it last."""

    value: str
    location: Location


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """The variables of `VARIABLES` that the file sets; `path` as the user gave it."""

    path: str
    settings: Mapping[str, Setting]

    def value(self, name: str) -> str:
        """The value of the variable; empty where it is not set, which to ROS 2 is the same."""
        setting = self.settings.get(name)
        return "" if setting is None else setting.value

    def place(self, name: str) -> Location:
        """The line that sets the variable, else the file."""
        setting = self.settings.get(name)
        return Location(path=self.path, beside=True) if setting is None else setting.location

    @property
    def domain(self) -> int | None:
        """The DDS domain, 0 where none is set (rcl's `domain_id.c`); None: the value is none of 0..232."""
        text = self.value("ROS_DOMAIN_ID")
        if not text:
            return 0
        number = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else -1
        return number if 0 <= number <= 232 else None


def read_environment(path: Path) -> Environment:
    """Read the file. Raises UsageError, with the line, for what is no assignment or would need a shell to be read."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}.") from error
    if len(data) > MAX_BYTES:
        raise UsageError(f"{path}: larger than {MAX_BYTES} bytes; expected lines of NAME=VALUE.")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{path}:{line}: not UTF-8; expected lines of NAME=VALUE.") from error
    found: dict[str, Setting] = {}
    for number, content in enumerate(text.split("\n"), 1):
        stripped = content.strip()
        if not stripped or stripped.startswith("#"):
            continue
        match = _ASSIGNMENT.fullmatch(stripped)
        if match is None:
            raise UsageError(f"{path}:{number}: no assignment; expected NAME=VALUE.")
        name, value = match.groups()
        if name in VARIABLES:
            found[name] = Setting(
                value=_value(value, f"{path}:{number}"), location=Location(path=str(path), line=number, beside=True)
            )
    return Environment(path=str(path), settings=found)


def _value(text: str, place: str) -> str:
    """The value without its quotes; raises UsageError for one that only a shell could tell."""
    quoted = _QUOTED.fullmatch(text)
    if quoted is not None:
        return quoted[1] if quoted[1] is not None else quoted[2]
    bare = _BARE.fullmatch(text)
    if bare is None:
        raise UsageError(f"{place}: a value that only a shell could work out; expected a plain or quoted one.")
    return bare[1]
