"""What the checks of a user's file range over: of nothing everything is true, and that has to be said.

Asked is about the `all` that a check, or the assertion of its name, begins with, if it is plainly written.
"""

from __future__ import annotations

import re
from typing import Final

from keystore_audit.engine.alloy.user_file import Asked, UserFile

_PLAIN: Final = re.compile(r"[\w\s:,&+\-.()\[\]~^*<>]+", re.ASCII)
_ENCLOSED: Final = re.compile(r"\([^()\[\]]*\)|\[[^()\[\]]*\]")
_NAME: Final = re.compile(r"(?:disj\s+)?(\w+)", re.ASCII)


def ranges(file: UserFile) -> dict[str, str]:
    """By command a run, as its name and text, that has an instance where there is something to speak of."""
    found = ((asked, _declared(file.text, asked)) for asked in file.commands if asked.kind == "check")
    return {asked.name: f"run {run_of(asked)} {{ {asks} }} for 0\n" for asked, asks in found if asks}


def run_of(asked: Asked) -> str:
    """The name of that run."""
    return f"KeystoreAuditRangeOf{asked.name}"


def _declared(text: str, asked: Asked) -> str:
    """That something is what the outermost `all` declares; nothing where it is not plain what that is."""
    begin = re.search(rf"^[ \t]*(?:assert|check)\s+{asked.name}\s*\{{\s*all\s", text, re.MULTILINE | re.ASCII)
    if begin is None:
        return ""
    declarations = re.split(r"[|{]", text[begin.end() :], maxsplit=1)[0]
    if "--" in declarations or not _PLAIN.fullmatch(declarations):
        return ""
    outside = declarations
    while _ENCLOSED.search(outside):
        outside = _ENCLOSED.sub("", outside)
    names = [_NAME.fullmatch(each.partition(":")[0].strip()) for each in outside.split(",")]
    told = [f"some {name[1]}" for name in names if name is not None]
    return f"some {declarations.strip()} | {' and '.join(told)}" if len(told) == len(names) else ""
