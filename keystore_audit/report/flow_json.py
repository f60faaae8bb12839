"""The answers of `flow` as JSON: `schemas/flow.schema.json`, and of a stolen key `schemas/compromise.schema.json`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from keystore_audit.assumptions import Needed
from keystore_audit.model.blast_radius import Ground
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.properties.result import (
    AssertedResult,
    CompromiseAnswer,
    EngineRun,
    KeyAnswer,
    ProfileRadius,
    ProfileResult,
    Status,
)
from keystore_audit.report.content import answered_if, conditions_of
from keystore_audit.report.json import encoded, picked, told
from keystore_audit.text import instant

FOUND: Final[Mapping[Status, bool | None]] = {Status.VIOLATED: True, Status.HOLDS: False, Status.UNKNOWN: None}
"""Whether there is a flow, or a key opens anything of somebody else's."""


def json(
    asked: Mapping[str, Any], results: Sequence[tuple[Attacker, AssertedResult]], engines: Iterable[EngineRun]
) -> str:
    """One line; `asked`: the question."""
    document = {
        **asked,
        "engines": {run.name: picked(run, "version", "status", "reason") for run in engines},
        "attackers": {
            attacker: {
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


def stolen_key(answer: CompromiseAnswer) -> str:
    """What a stolen key opens: one line."""
    document = {
        "from_compromised": answer.who,
        "include_ambient": answer.include_ambient,
        "at": instant(answer.at),
        "enclaves": answer.enclaves,
        "beyond_itself": FOUND[answer.status],
        "assumptions": [each.described for each in stolen_if(answer)],
        "keys": [_key(answer.ground, key) for key in answer.keys],
    }
    return encoded(document) + "\n"


def stolen_if(answer: CompromiseAnswer) -> tuple[Needed, ...]:
    """What it rests on that a key opens no more."""
    return answered_if(dict.fromkeys(name for key in answer.keys for name in key.alone))


def _key(ground: Ground, key: KeyAnswer) -> dict[str, Any]:
    def radii(by_profile: Mapping[str, ProfileRadius]) -> dict[str, Any]:
        return {name: _radius(ground, each) for name, each in by_profile.items()}

    return {
        "of": key.stolen,
        "name": key.name,
        "path": key.location and key.location.path,
        "alone": radii(key.alone),
        "with_an_enclave": None if key.with_an_enclave is None else radii(key.with_an_enclave),
    }


def _radius(ground: Ground, each: ProfileRadius) -> dict[str, Any]:
    def topics(channels: int) -> list[dict[str, Any]]:
        found = ground.topics(channels)
        return [{**picked(one.name, "topic", "partition", "several"), "domains": one.domains} for one in found]

    radius = each.radius
    return {
        "certain": each.certain,
        "topics_written": topics(radius.written),
        "topics_forged": topics(radius.forged),
        "topics_read": topics(radius.read),
        "passes_for": sorted(radius.passes_for),
        "enclaves_reached_alone": sorted(radius.reached_alone),
        "enclaves_reached": sorted(radius.reached),
    }
