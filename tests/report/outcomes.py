"""Outcomes one by one, as a test says them."""

from __future__ import annotations

from collections.abc import Iterable

from keystore_audit.findings import Outcome, Outcomes, Row


def outcomes_of(outcomes: Iterable[Outcome]) -> Outcomes:
    return Outcomes(rows=tuple(Row(rule, (subject,), ((result, 1),)) for rule, subject, result in outcomes))
