"""Topic classes against the answers of a matcher that we did not write, name by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import Pattern
from tests.oracles.fnmatch.corpus import NAMES
from tests.oracles.fnmatch.libraries import Column

Ask = Callable[[Sequence[Pattern], Sequence[str]], Sequence[Column]]
"""A column for every pattern."""


def assert_classes_are_exact(patterns: Sequence[Pattern], ask: Ask) -> int:
    """How many names were looked at: each lies in a class that was found, and each class has its witness."""
    if not patterns:
        return 0
    classes = classify(patterns)
    expected = [tuple(number in found.members for number in range(len(patterns))) for found in classes]
    texts = [(pattern.text, pattern.matcher.value) for pattern in patterns]
    assert len(set(expected)) == len(classes), texts
    witnesses = [found.witness for found in classes]
    said = list(zip(*ask(patterns, [*NAMES, *witnesses]), strict=True))
    if not set(said) <= set(expected):
        missed = [(name, row) for name, row in zip(NAMES, said, strict=False) if row not in set(expected)]
        raise AssertionError(f"of {texts} no class holds {missed[:3]}")
    for found, row, ours in zip(classes, said[len(NAMES) :], expected, strict=True):
        assert row == ours, (texts, found.witness)
    for pattern, column in zip(patterns, zip(*said, strict=True), strict=True):
        if not pattern.rewinds or pattern.malformed is not None:  # the direct matcher, where it is easiest to be wrong
            assert tuple(map(pattern.matches, NAMES)) == column[: len(NAMES)], pattern
    return len(NAMES)
