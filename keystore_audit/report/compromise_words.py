"""Names of topics for people, as answers about stolen keys list them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from keystore_audit.model.blast_radius import Topic
from keystore_audit.model.named import Named
from keystore_audit.model.names import PARAMETER_SERVICES, RosKind, parse_dds_name, ros_name
from keystore_audit.text import some

MAX_LISTED: Final = 8
"""Names that are listed; the rest are counted."""

_PARAMETERS: Final = tuple(f"/{service}" for service in PARAMETER_SERVICES)


def topic_words(topics: Iterable[Topic]) -> str:
    """Some of the names, plain topics first, parameter services counted alone; raw text."""
    topics = list(topics)
    others = [topic for topic in topics if not _of_parameters(topic.name)]
    names = sorted(map(_words, others), key=lambda words: (not words.endswith("(topic)"), words))
    listed = some((words.removesuffix(" (topic)") for words in names), MAX_LISTED)
    parameters = len(topics) - len(others)
    return ", and ".join(filter(None, [listed, f"{parameters} of parameter services" if parameters else ""]))


def _of_parameters(name: Named) -> bool:
    parsed = parse_dds_name(name.topic)
    return parsed is not None and parsed.kind is RosKind.SERVICE and parsed.name.endswith(_PARAMETERS)


def _words(topic: Topic) -> str:
    name = ros_name(topic.name.topic)
    inside = f', partition "{topic.name.partition}"' if topic.name.partition else ""
    return f"{f'all names such as {name}' if topic.name.several else name}{inside}"
