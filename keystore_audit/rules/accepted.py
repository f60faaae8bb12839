"""KA909 and KA910: findings that somebody accepts. What is accepted ends, and what accepts nothing is said."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity
from keystore_audit.remedy import decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import MAX_QUOTED, places
from keystore_audit.settings.suppressions import Fate, FileOfUses, Use
from keystore_audit.text import shorten

_CLAUSE: Final = "keystore-audit, docs/settings.md: what is accepted has a reason, an owner and an end"


@rule(
    "KA909",
    Severity.MEDIUM,
    clause=_CLAUSE,
    remedy=decision(
        "Fix what was accepted, or accept it again with a reason that still holds and a new date; "
        "`keystore-audit baseline prune` takes what has ended out of a baseline."
    ),
)
def suppression_expired(file: FileOfUses, _context: Context) -> Iterator[Violation]:
    """Somebody accepted a finding until a day that is over, so that it counts again.

    The day ends at 23:59:59 UTC. One finding for each file, with the lines.
    """
    ended = [use for use in file.uses if use.fate is Fate.ENDED]
    if ended:
        again = len({finding.fingerprint for use in ended for finding in use.findings})
        yield Violation(
            message=f"{_counted(ended)} {'has' if len(ended) == 1 else 'have'} ended: {_first(ended)}. "
            f"{_spoken(again)}.",
            locations=_lines(ended),
        )


@rule(
    "KA910",
    Severity.LOW,
    clause=_CLAUSE,
    remedy=decision(
        "Take it out, so that it hides nothing later; `keystore-audit baseline prune` does so for a baseline."
    ),
)
def suppression_unused(file: FileOfUses, _context: Context) -> Iterator[Violation]:
    """Somebody accepted a finding that this audit does not make, or that has become another or a worse one.

    It was mended, moved or renamed; or it shows under other options than this audit's. What is accepted of rules that
    were left out (--select, --ignore) is not looked at. One finding for each file, with the lines.
    """
    unused = [use for use in file.uses if use.fate is Fate.UNUSED]
    if unused:
        yield Violation(
            message=f"{_counted(unused)} {'accepts' if len(unused) == 1 else 'accept'} nothing: {_first(unused)}.",
            locations=_lines(unused),
        )


def _spoken(count: int) -> str:
    return {0: "No finding counts again", 1: "1 finding counts again"}.get(count, f"{count} findings count again")


def _counted(uses: Sequence[Use]) -> str:
    return "An entry" if len(uses) == 1 else f"{len(uses)} entries"


def _first(uses: Sequence[Use]) -> str:
    first = uses[0]
    return f"{'' if len(uses) == 1 else 'the first, '}{shorten(first.acceptance.what, MAX_QUOTED)}: {first.why}"


def _lines(uses: Sequence[Use]) -> tuple[Location, ...]:
    return places(
        replace(use.acceptance.location, message=shorten(f"{use.acceptance.what}: {use.why}", MAX_QUOTED))
        for use in uses
    )
