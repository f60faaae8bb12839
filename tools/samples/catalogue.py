"""All stories, in the order of their directories."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase

from . import healthy, stock
from .story import Story


def stories(only: str = "*") -> Iterator[Story]:
    """Every story whose directory matches the shell pattern `only`.

    Raises ValueError if two share a directory.
    """
    seen: set[str] = set()
    for family in (healthy, stock):
        for story in family.stories():
            if story.directory in seen:
                raise ValueError(f"two stories for {story.directory}")
            seen.add(story.directory)
            if fnmatchcase(story.directory, only):
                yield story
