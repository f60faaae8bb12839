"""The answer of `flow` as JSON: `schemas/flow.schema.json`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from keystore_audit.assumptions import Needed
from keystore_audit.model.formal.claim import Attacker
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import AssertedResult, EngineRun, ProfileResult
from keystore_audit.report.content import conditions_of
from keystore_audit.report.encoded import encoded, told

FOUND: Final[Mapping[Status, bool | None]] = {Status.VIOLATED: True, Status.HOLDS: False, Status.UNKNOWN: None}
"""Whether there is a flow, or a key opens anything of somebody else's."""


def json(
    asked: Mapping[str, Any], results: Sequence[tuple[Attacker, AssertedResult]], engines: Iterable[EngineRun]
) -> str:
    """One line; `asked`: the question."""
    document = {
        **asked,
        "engines": {
            run.name: {"version": run.version, "status": run.status.value, "reason": run.reason} for run in engines
        },
        "attackers": {
            attacker.value: {
                "flow": FOUND[result.status],
                "profiles": {name: _answer(answer) for name, answer in result.profiles.items()},
            }
            for attacker, result in results
        },
        "assumptions": [each.described for each in assumptions(results)],
    }
    return encoded(document) + "\n"


def assumptions(results: Iterable[tuple[Attacker, AssertedResult]]) -> tuple[Needed, ...]:
    """What it rests on that there is no flow."""
    return conditions_of(result for _attacker, result in results)


def _answer(answer: ProfileResult) -> dict[str, Any]:
    return {
        "flow": FOUND[answer.status],
        "engines": {name: FOUND[status] for name, status in answer.engines.items()},
        "path": told(answer.counterexample),
    }
