"""Changes of several enclaves that differ in the enclaves' own paths alone, for showing one of them."""

from __future__ import annotations

import re
from collections.abc import Iterable

from keystore_audit.dataclass import replace
from keystore_audit.model.comparison.change import Change

_PATH, _ABOVE = "\0", "\1"
"""Stand for an enclave's path and for the path above it; neither is in a name (XML 1.0, 2.2)."""


def alike(changes: Iterable[Change]) -> list[tuple[Change, tuple[str, ...]]]:
    """Each change that is not like one before it, with the enclaves of those that are.

    Two are alike where each is the other with its path, or the path above it, put for that of the other in every name;
    whole segments of it, since nobody sees the path /a in /arm.
    """
    found: dict[str, tuple[Change, list[str]]] = {}
    for change in changes:
        key = _form(change)
        if key in found:
            found[key][1].extend(change.enclaves)
        else:
            found[key] = change, []
    return [(change, tuple(enclaves)) for change, enclaves in found.values()]


def _form(change: Change) -> str:
    """What the change says, without the path of its enclave; places do not count."""
    if len(change.enclaves) != 1:
        return repr(change)
    (path,) = change.enclaves
    above = path.rpartition("/")[0]
    form = re.sub(re.escape(repr(path)[1:-1]) + r"(?!\w)", _PATH, repr(replace(change, old=None, new=None)))
    return form.replace(repr(above)[1:-1] + "/", _ABOVE) if above else form
