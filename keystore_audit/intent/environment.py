"""The environment that a robot's processes start with, as far as security depends on it: `--env FILE`.

The file has assignments, as a shell's `export`, systemd's EnvironmentFile or a container's env file.
Nothing is expanded or run. A line that these three read differently is an error. Errors are a continuation after a
backslash, and a carriage return, which a shell takes into the value. Without `export`, so are a comment or blanks
behind a value, and quotes where one exact value is needed: containers take them into it. Lines with `export` beside
others without are refused, since a shell does not pass the latter on, and systemd and containers read no others. Values
of other variables may hold only plain or quoted text and `$NAME`. Variables that put other code or another clock under
what was audited are refused. Source of what the variables mean: rcl's `security.c`, rmw_dds_common's `security.cpp`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile, read_given
from keystore_audit.keystore.document import MAX_DOMAIN
from keystore_audit.profiles import facts

MAX_BYTES: Final = 1024 * 1024

ENABLE: Final = "ROS_SECURITY_ENABLE"
STRATEGY: Final = "ROS_SECURITY_STRATEGY"
KEYSTORE: Final = "ROS_SECURITY_KEYSTORE"
OVERRIDE: Final = "ROS_SECURITY_ENCLAVE_OVERRIDE"
"""The variable that replaces the enclave of every process that has it (rcl's `security.c`)."""
DOMAIN: Final = "ROS_DOMAIN_ID"
RMW: Final = "RMW_IMPLEMENTATION"
DISTRIBUTION: Final = "ROS_DISTRO"

SECURE: Final = {ENABLE: "true", STRATEGY: "Enforce"}
"""The one value with which there is security, exactly (rcl's `security.c`)."""

CONFIGURATION: Final = facts.OVERRIDE_OF_CONFIGURATION

VARIABLES: Final = (ENABLE, STRATEGY, KEYSTORE, OVERRIDE, DOMAIN, RMW, DISTRIBUTION, CONFIGURATION)
"""The variables that are looked at; others are passed over."""

_ASSIGNMENT: Final = re.compile(r"(export[ \t]+)?([A-Za-z_][A-Za-z0-9_]*)=(.*)", re.DOTALL)
_COMMENT: Final = re.compile(r"[ \t]+#.*|[ \t]*")
_QUOTED: Final = re.compile(r"""'([^']*)'|"([^"\\$`]*)\"""")
_BARE: Final = re.compile(r"""[^\s'"\\$`#;&|<>()]*""")
_OTHER: Final = re.compile(
    r"""'[^']*'|"(?:[^"\\$`]|\$(?:\w+|\{\w+\}))*"|(?:[^\s'"\\$`#;&|<>()]|\$(?:\w+|\{\w+\}))*""", re.ASCII
)
"""A value of another variable: as above, and others may be looked up in it."""
_COUNTER: Final = re.compile(
    "BAUD|COLUMNS|DIRSTACKSIZE|E?[GU]ID|ERRNO|FUNCNEST|HISTCMD|HISTSIZE|KEYTIMEOUT|LINENO|LINES|LISTMAX|LOGCHECK"
    "|MAILCHECK|OPTIND|PERIOD|S?RANDOM|REPORTMEMORY|REPORTTIME|SAVEHIST|SECONDS|SHLVL|TMOUT|TRY_BLOCK_[A-Z]+"
)
"""Variables that bash, zsh or ksh take for numbers: the value is computed, and `NAME=0` in it assigns, too."""
_NUMBER: Final = re.compile(r"""(["']?)(?:0|-?[1-9][0-9]{0,17})?\1[ \t]*""")
_RUN: Final = {
    **dict.fromkeys(("BASH_ENV", "PROMPT_COMMAND"), "bash runs what {} names"),
    **dict.fromkeys(("LD_PRELOAD", "LD_LIBRARY_PATH"), "every process loads what {} names"),
    "PYTHONPATH": "Python runs what lies in {}",
    "OPENSSL_CONF": "OpenSSL loads and configures what {} names",
    "FAKETIME": "{} is another clock to certificates and grants",
}
"""Variables that put other code, or another clock, under what was audited."""


class Setting(Struct, frozen=True, kw_only=True):
    """The value of a variable, and the line that sets it last."""

    value: str
    location: Location


class Environment(Struct, frozen=True, kw_only=True):
    """The variables of `VARIABLES` that the `file` sets."""

    file: GivenFile
    settings: Mapping[str, Setting]

    def value(self, name: str) -> str:
        """The value of the variable; empty where it is not set, which to ROS 2 is the same."""
        setting = self.settings.get(name)
        return "" if setting is None else setting.value

    def place(self, name: str) -> Location:
        """The line that sets the variable, else the file."""
        setting = self.settings.get(name)
        return Location(self.file.path, beside=True) if setting is None else setting.location

    @property
    def domain(self) -> int | None:
        """The DDS domain, 0 where none is set (rcl's `domain_id.c`); None: the value is none of 0..232."""
        text = self.value(DOMAIN)
        if not text:
            return 0
        number = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else -1
        return number if 0 <= number <= MAX_DOMAIN else None


def read_environment(path: Path) -> Environment:
    """Read the file. Raises UsageError, with the line, for what is no assignment or would need a shell to be read."""
    file, text = read_given(path, MAX_BYTES, "lines of NAME=VALUE")
    found: dict[str, Setting] = {}
    exports: dict[bool, int] = {}
    other = 0
    for number, content in enumerate(text.split("\n"), 1):
        place = f"{path}:{number}"
        stripped = _line(content, place)
        if not stripped or stripped.startswith("#"):
            continue
        match = _ASSIGNMENT.fullmatch(stripped)
        if match is None:
            raise UsageError(f"{place}: no assignment; expected NAME=VALUE.")
        export, name, value = match.groups()
        if name in VARIABLES:
            if export is None and content.endswith((" ", "\t")):
                raise UsageError(f"{place}: blanks behind a value, which containers take into it; expected none.")
            if export is None and name in SECURE and value.startswith(("'", '"')):
                raise UsageError(f"{place}: quotes, which `docker run` takes into the value; expected {SECURE[name]}.")
            exports.setdefault(export is not None, number)
            found[name] = Setting(
                value=_value(value, place, commented=export is not None),
                location=Location(str(path), number, beside=True),
            )
        else:
            _pass_over(name, value, place)
            other = other or (number if export is not None else 0)
    if other and False in exports and any(name in SECURE for name in found):
        exports.setdefault(True, other)
    if len(exports) > 1:
        raise UsageError(
            f"{path}:{max(exports.values())}: some lines have export and others do not. A shell does not pass on lines "
            "without it; systemd and containers refuse lines with it. Expected one form."
        )
    return Environment(file=file, settings=found)


def _line(content: str, place: str) -> str:
    """The line without blanks around it; raises UsageError for one that is read differently."""
    if "\r" in content:
        raise UsageError(
            f"{place}: a carriage return, which a shell takes into the value; expected lines that end in LF."
        )
    if content.endswith("\\"):
        raise UsageError(f"{place}: a line that goes on after a backslash; expected one assignment a line.")
    return content.strip(" \t")


def _value(text: str, place: str, *, commented: bool) -> str:
    """The value without its quotes, and without a comment where one may stand.

    Raises UsageError for one that only a shell could compute.
    """
    match = _QUOTED.match(text) or _BARE.match(text)
    rest = text[match.end() :] if match is not None else text
    if match is None or _COMMENT.fullmatch(rest) is None:
        raise UsageError(f"{place}: a value that only a shell could work out; expected a plain or quoted one.")
    if rest.strip(" \t") and not commented:
        raise UsageError(f"{place}: a comment behind a value, which only a shell takes for one; expected it above.")
    return next((group for group in match.groups() if group is not None), match[0])


def _pass_over(name: str, text: str, place: str) -> None:
    """Raises UsageError where the value of another variable may set, hide or take back one of `VARIABLES`."""
    match = _OTHER.match(text)
    value = match[0] if match is not None else ""
    if _COMMENT.fullmatch(text[len(value) :]) is None or any(each in value for each in VARIABLES):
        raise UsageError(
            f"{place}: more than one assignment, a command, or the name of a variable that counts. Expected "
            "NAME=VALUE, with shell metacharacters between single quotes."
        )
    if name in _RUN:
        raise UsageError(f"{place}: {_RUN[name].format(name)}; expected no such assignment.")
    if _COUNTER.fullmatch(name) and not _NUMBER.fullmatch(value):
        raise UsageError(f"{place}: {name} is a number to a shell, which works out its value; expected digits.")
