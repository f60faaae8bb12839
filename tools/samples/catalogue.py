"""All stories, in the order of their directories."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase

from . import (
    alloy_stories,
    anomaly_stories,
    certificate_stories,
    divergence_stories,
    drift_stories,
    environment_stories,
    flow_stories,
    formal_stories,
    governance_stories,
    healthy,
    identity_stories,
    layout_stories,
    network_stories,
    network_systems,
    observed_stories,
    permissions_stories,
    provisioning_stories,
    ros_stories,
    signature_stories,
    stock,
    suppression_stories,
    unknown_stories,
)
from .story import Story

FAMILIES = (
    healthy,
    stock,
    unknown_stories,
    layout_stories,
    certificate_stories,
    identity_stories,
    signature_stories,
    governance_stories,
    permissions_stories,
    divergence_stories,
    anomaly_stories,
    drift_stories,
    observed_stories,
    provisioning_stories,
    environment_stories,
    ros_stories,
    formal_stories,
    network_stories,
    network_systems,
    flow_stories,
    alloy_stories,
    suppression_stories,
)


def stories(only: str = "*") -> Iterator[Story]:
    """Every story whose directory matches the shell pattern `only`.

    Raises ValueError if two share a directory.
    """
    seen: set[str] = set()
    for family in FAMILIES:
        for story in family.stories():
            if story.directory in seen:
                raise ValueError(f"two stories for {story.directory}")
            seen.add(story.directory)
            if fnmatchcase(story.directory, only):
                yield story
