"""How findings name things: the same words for enclaves, instants, implementations and defects in every rule.

Untrusted text goes into messages as it is, only shortened: whoever renders a message escapes it
(`keystore_audit.text`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final, Protocol

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Operation
from keystore_audit.remedy import Remedy
from keystore_audit.rules.registry import Violation
from keystore_audit.text import shorten, some

MAX_QUOTED: Final = 160
"""Characters of one quoted name: an enclave's path and a subject fit, a hostile subject of 60 kB does not."""

MAX_LISTED: Final = 5
"""Names in a list before it says how many more there are; the locations hold them all."""

VERBS: Final = {Operation.PUBLISH: "publish", Operation.SUBSCRIBE: "subscribe to", Operation.RELAY: "relay"}
"""What is done with the topic whose name follows."""


def quoted(text: str) -> str:
    """Untrusted text in single quotes, bounded."""
    return f"'{shorten(text, MAX_QUOTED)}'"


def listed(names: Iterable[str]) -> str:
    """`a, b, c and 4 more`."""
    return some((shorten(name, MAX_QUOTED) for name in names), MAX_LISTED)


def more(count: int, what: str = "") -> str:
    """` and 2 more` of a count of which one is told; nothing where that is all."""
    return f" and {count - 1} more{what}" if count > 1 else ""


def more_like(found: Collection[object], like: str = " like it") -> str:
    """` (and 2 more like it)`, where the first alone is told."""
    return f" ({more(len(found), like).strip()})" if len(found) > 1 else ""


def paths(enclaves: Iterable[Enclave]) -> str:
    """The enclaves' paths, listed."""
    return listed(enclave.path for enclave in enclaves)


def sole(enclaves: Sequence[Enclave]) -> str | None:
    """The enclave's path where only one is concerned, so that the finding is filed under it."""
    return enclaves[0].path if len(enclaves) == 1 else None


def of_kinds(defects: Iterable[Defect], *kinds: Kind) -> Iterator[Defect]:
    """The defects of these kinds, in order."""
    return (defect for defect in defects if defect.kind in kinds)


def defective(
    defects: Iterable[Defect],
    says: str = "",
    *,
    undecided: bool = False,
    severity: Severity | None = None,
    remedy: Remedy | None = None,
) -> Iterator[Violation]:
    """One violation for all defects of one kind in one file, each of them a location of it; `says` what follows.

    A hostile file may have thousands of them. Where all are the same, no place repeats what the message says.
    """
    found = list(defects)
    if not found:
        return
    first, more = found[0], more_like(found)
    several = any(each.detail != first.detail for each in found)
    joint = "; " if ": " in first.detail else ": "  # one colon in a sentence
    yield Violation(
        f"{sentence(first.detail)}{more}{joint if says else '.'}{says}",
        [located(each, shorten(each.detail, MAX_QUOTED) if several else "") for each in found],
        undecided=undecided,
        severity=severity,
        key=first.kind.value,
        remedy=remedy,
    )


class _Placed(Protocol):
    """What stands at a line of a file of the keystore."""

    @property
    def path(self) -> str: ...
    @property
    def line(self) -> int | None: ...


def located(found: _Placed, message: str = "") -> Location:
    """Where it stands."""
    return Location(found.path, found.line, message=message)


def sentence(text: str) -> str:
    """The words of a reader as the beginning of a sentence: bounded, first letter large, no full stop."""
    short = shorten(text, 2 * MAX_QUOTED).rstrip(".")
    return short[:1].upper() + short[1:]


def either(names: Collection[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    every = list(names)
    return every[0] if len(every) == 1 else f"{', '.join(every[:-1])} and {every[-1]}"
