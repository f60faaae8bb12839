"""What changed between two keystores, for people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.assumptions import holds_if
from keystore_audit.model.comparison.change import Change, Comparison, FailOn, Layer
from keystore_audit.report import diff_words as words
from keystore_audit.report.paragraph import unbroken
from keystore_audit.text import MAX_EXPRESSION, instant, shorten, terminal

MAX_UNREAD: Final = 10


def text(comparison: Comparison, fail_on: FailOn) -> str:
    """Lines of 80 columns at most, as far as names allow: unknown first, then the changes by layer."""
    lines = [terminal(words.verdict(comparison, fail_on))]
    lines.append(unbroken(f"{comparison.old} → {comparison.new}, at {instant(comparison.at)}", "", "  "))
    if conditions := holds_if(words.conditions(comparison)):
        lines.append(unbroken(f"That there are no other rights {conditions}.", "", "  "))
    if comparison.unknown:
        lines += ["", "Not compared, since it could not be read:"]
        lines += [unbroken(words.unread(each), "  ? ", "    ") for each in comparison.unknown[:MAX_UNREAD]]
        if len(comparison.unknown) > MAX_UNREAD:
            lines.append(f"    and {len(comparison.unknown) - MAX_UNREAD} more")
    for layer in Layer:
        changes = [change for change in comparison.changes if change.layer is layer]
        if changes:
            lines += ["", words.TITLES[layer]]
        for change, others in words.alike(changes):
            lines += _change(change, comparison, others)
    if comparison.changes:
        lines += ["", "+ gained   - lost   ± both   ~ changed   i no difference to anybody"]
    return "\n".join(lines) + "\n"


def _change(change: Change, comparison: Comparison, others: tuple[str, ...]) -> Iterator[str]:
    yield unbroken(words.sentence(change, comparison), f"  {words.MARKS[change.direction]} ", "    ")
    for side, location in (("old", change.old), ("new", change.new)):
        if location is not None:
            expression = f"  ({shorten(location.message, MAX_EXPRESSION)})" if location.message else ""
            yield terminal(f"      {side} {location}{expression}")
    if (effective := words.effective(change)) is not None:
        yield unbroken(effective, "      ", "        ")
    for each in change.consequences[: words.MAX_CONSEQUENCES]:
        yield unbroken(words.consequence(each, comparison), f"      {words.MARKS[each.direction]} so ", "        ")
    if len(change.consequences) > words.MAX_CONSEQUENCES:
        yield f"      {words.left_out(change.consequences)} (--format json)"
    if others:
        yield unbroken(words.others(others), "      ", "        ")
