"""What a stolen key opens, as JSON: `schemas/compromise.schema.json`."""

from __future__ import annotations

from typing import Any

from keystore_audit.model.blast_radius import Ground, Topic
from keystore_audit.properties.compromise_result import CompromiseAnswer, KeyAnswer, ProfileRadius
from keystore_audit.report.content import answered_if
from keystore_audit.report.encoded import encoded
from keystore_audit.report.flow_json import FOUND
from keystore_audit.text import instant


def json(answer: CompromiseAnswer) -> str:
    """One line."""
    asked = dict.fromkeys(name for key in answer.keys for name in key.alone)
    document = {
        "from_compromised": answer.who,
        "include_ambient": answer.include_ambient,
        "at": instant(answer.at),
        "enclaves": answer.enclaves,
        "beyond_itself": FOUND[answer.status],
        "assumptions": [each.described for each in answered_if(asked)],
        "keys": [_key(answer.ground, key) for key in answer.keys],
    }
    return encoded(document) + "\n"


def _key(ground: Ground, key: KeyAnswer) -> dict[str, Any]:
    both = key.with_an_enclave
    return {
        "of": key.stolen.value,
        "name": key.name,
        "path": None if key.location is None else key.location.path,
        "alone": {name: _profile(ground, each) for name, each in key.alone.items()},
        "with_an_enclave": None if both is None else {name: _profile(ground, each) for name, each in both.items()},
    }


def _profile(ground: Ground, each: ProfileRadius) -> dict[str, Any]:
    radius = each.radius
    return {
        "certain": each.certain,
        "topics_written": [_topic(topic) for topic in ground.topics(radius.written)],
        "topics_forged": [_topic(topic) for topic in ground.topics(radius.forged)],
        "topics_read": [_topic(topic) for topic in ground.topics(radius.read)],
        "passes_for": sorted(radius.passes_for),
        "enclaves_reached_alone": sorted(radius.reached_alone),
        "enclaves_reached": sorted(radius.reached),
    }


def _topic(topic: Topic) -> dict[str, Any]:
    return {
        "topic": topic.name.topic,
        "partition": topic.name.partition,
        "several": topic.name.several,
        "domains": list(topic.domains),
    }
