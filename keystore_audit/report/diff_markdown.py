"""What changed between two keystores, for a comment on a pull request: the verdict first, consequences folded away."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.assumptions import holds_if
from keystore_audit.model.comparison.change import Change, Comparison, FailOn, Layer
from keystore_audit.report import diff_words as words
from keystore_audit.report.markdown import MAX_LENGTH
from keystore_audit.text import instant
from keystore_audit.text import markdown as escaped


def markdown(comparison: Comparison, fail_on: FailOn) -> str:
    """Headings and lists; what does not fit is counted."""
    lines = [f"## keystore-audit diff: {escaped(words.verdict(comparison, fail_on))}", ""]
    lines += [f"{escaped(comparison.old)} → {escaped(comparison.new)} at {instant(comparison.at)}", ""]
    if conditions := holds_if(words.conditions(comparison)):
        lines += [f"That there are no other rights {escaped(conditions)}.", ""]
    used = sum(map(len, lines))
    left_out = 0
    for item in _items(comparison):
        used += len(item) + 1
        if used > MAX_LENGTH:
            left_out += bool(item)
        else:
            lines.append(item)
    if left_out:
        lines += ["", f"{left_out} more entries are in the full report."]
    return "\n".join(lines) + "\n"


def _items(comparison: Comparison) -> Iterator[str]:
    """Lines, or whole items where a part of them would break what is around it."""
    if comparison.unknown:
        yield "### Not compared, since it could not be read"
        yield ""
        for each in comparison.unknown:
            yield f"- {escaped(words.unread(each))}"
        yield ""
    for layer in Layer:
        changes = [change for change in comparison.changes if change.layer is layer]
        if changes:
            yield f"### {words.TITLES[layer]}"
            yield ""
            for change, others in words.alike(changes):
                yield _item(change, comparison, others)
            yield ""


def _item(change: Change, comparison: Comparison, others: tuple[str, ...]) -> str:
    places = (("old", change.old), ("new", change.new))
    named = [f"{side} {escaped(str(place))}" for side, place in places if place is not None]
    where = f" ({', '.join(named)})" if named else ""
    lines = [f"- **{change.direction.value}** {escaped(words.sentence(change, comparison))}{where}"]
    if (effective := words.effective(change)) is not None:
        lines.append(f"  - {escaped(effective)}")
    lines += [
        f"  - so *{each.direction.value}*: {escaped(words.consequence(each, comparison))}"
        for each in change.consequences[: words.MAX_CONSEQUENCES]
    ]
    if len(change.consequences) > words.MAX_CONSEQUENCES:
        lines.append(f"  - {words.left_out(change.consequences)}")
    if others:
        lines.append(f"  - {escaped(words.others(others))}")
    return "\n".join(lines)
