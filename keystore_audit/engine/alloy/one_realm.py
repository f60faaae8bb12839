"""The modules for a keystore whose enclaves trust alike: what depends on the realm alone is worked out once.

The translator works out a function without arguments once, and one with arguments anew wherever it is called. Rights
have the realm of a peer as their argument, because a relation of realms, enclaves and channels would have a place for
each three atoms. Where there is one realm only, `Realm` is that one: then each such function calls one without
arguments, of which it is the name for others. No other text changes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

_DEPENDENT: Final = re.compile(
    r"^fun (?P<name>\w+)\[(?P<realms>realm|sending, receiving): Realm\]: (?P<declared>[^{]+) \{(?P<body>.*?)\}$"
    r"(?=\s*(?:^(?:/\*\*|--|fun|pred|assert)|\Z))",
    re.MULTILINE | re.DOTALL,
)
"""A function of realms and nothing else, as our modules write it."""


def with_one_realm(modules: Mapping[str, str]) -> dict[str, str]:
    """Return the same modules for systems with exactly one realm, name to text."""
    return {name: _DEPENDENT.sub(_named, module) for name, module in modules.items()}


def _named(function: re.Match[str]) -> str:
    name, realms, declared, body = function.group("name", "realms", "declared", "body")
    only = ", ".join(f"{realm} = Realm" for realm in realms.split(", "))
    return (
        f"fun {name}[{realms}: Realm]: {declared} {{ only_{name} }}\n"
        f"fun only_{name}: {declared} {{\n\tlet {only} | {{{body}}}\n}}"
    )
