"""Graphs and launch files together: what users name of the system as it runs or will run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from keystore_audit.intent.intent import Intent


def read_observed(graphs: Sequence[Path], launches: Sequence[Path], arguments: Mapping[str, str]) -> tuple[Intent, ...]:
    """What the files show; `arguments`: values of arguments of the launch files. Raises UsageError for what is none."""
    intents: list[Intent] = []
    if graphs:  # an audit without them needs no reader of theirs
        from keystore_audit.intent.graph import read_graph

        intents += map(read_graph, graphs)
    if launches:
        from keystore_audit.intent.launch import read_launch

        intents += (read_launch(path, arguments, None) for path in launches)
    return tuple(intents)
