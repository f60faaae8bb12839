"""What fails while enclaves are updated in any order, for people and as JSON (`schemas/rolling.schema.json`)."""

from __future__ import annotations

from typing import Final

from keystore_audit.assumptions import holds_if
from keystore_audit.properties.result import Passage, RollingAnswer, Status, Step
from keystore_audit.report.content import answered_if
from keystore_audit.report.diff_text import REMEDY
from keystore_audit.report.flow import deciding, engines_told, path_lines
from keystore_audit.report.json import encoded, picked, told
from keystore_audit.report.page import profiles, unbroken
from keystore_audit.text import instant, some

MAX_ENCLAVES: Final = 6
"""Enclaves that are named; the rest are counted."""

_VERDICTS: Final = {
    Status.HOLDS: "PASS: what holds in OLD and in NEW holds whatever is updated first",
    Status.VIOLATED: "FAIL: what is to hold does not hold while enclaves are updated, or after that",
    Status.UNKNOWN: "UNKNOWN: not all is decided of what holds while enclaves are updated, and after that",
}


def text(answer: RollingAnswer) -> str:
    """Lines of 80 columns at most, as far as names allow."""
    lines = [
        _VERDICTS[answer.status],
        unbroken(f"{answer.old.root} → {answer.new.root}, at {instant(answer.at)}", "", "  "),
        unbroken(f"Enclaves that differ: {some(answer.changing or ('none',), MAX_ENCLAVES)}"),
    ]
    if needed := holds_if(answered_if(answer.profiles)):
        lines.append(unbroken(f"That nothing else fails {needed}.", "", "  "))
    shown: set[tuple[Step, ...]] = set()
    for each in answer.passages:
        certain = each.status is Status.VIOLATED
        when = f": {each.reason}" if each.reason else _when(each)
        lines += ["", unbroken(f"{each.prop.id} {'FAILS' if certain else 'MAY FAIL'}{when}.", "", "  ")]
        under = profiles(each.profiles, answer.profiles)
        lines.append(unbroken(f"{each.prop.statement} ({under})", "  ", "  "))
        lines += path_lines(each.example, shown, certain=certain) if each.example else []
    if any(each.lasting for each in answer.passages):
        lines += ["", unbroken(REMEDY)]
    lines += ["", *deciding(answer.engines)]
    if answer.natively_alone:
        lines.append(unbroken(f"By native alone: {some(answer.natively_alone, MAX_ENCLAVES)}."))
    return "\n".join([*lines, ""])


def _when(each: Passage) -> str:
    """Between which updates."""
    begun = f" after the update of {some(each.updated, MAX_ENCLAVES)}"
    if each.lasting:
        until = f" (until {each.until})" if each.until else ""
        return f"{begun}, and then as long as what was signed before is valid{until}"
    return f", for one,{begun} and before that of {some(each.waiting, MAX_ENCLAVES)}" if each.waiting else begun


def json(answer: RollingAnswer) -> str:
    """One line."""
    document = {
        "old": {"path": answer.old.root, "digest": answer.old.digest},
        "new": {"path": answer.new.root, "digest": answer.new.digest},
        "at": instant(answer.at),
        **picked(answer, "status", "profiles", "changing"),
        "passages": [
            {
                **picked(each.prop, "id", "statement"),
                **picked(each, "status", "profiles", "updated", "waiting", "lasting", "until", "reason"),
                "counterexample": told(each.example),
            }
            for each in answer.passages
        ],
        "engines": engines_told(answer.engines),
        "natively_alone": list(answer.natively_alone),
        "assumptions": [each.described for each in answered_if(answer.profiles)],
    }
    return encoded(document) + "\n"
