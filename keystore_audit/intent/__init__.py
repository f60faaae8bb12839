"""What was meant: rights that a policy, a running graph or launch files say enclaves are to have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from keystore_audit.intent.intent import Intent


def read_observed(
    graphs: Sequence[Path],
    launches: Sequence[Path],
    arguments: Mapping[str, str],
    policy: Path | None = None,
    include: Path | None = None,
) -> tuple[Intent, ...]:
    """What the files show; `arguments`: values of arguments of the launch files. Raises UsageError for what is none.

    `policy`: what its author means counts, too; it may include files from below `include` (None: its own directory).
    """
    intents: list[Intent] = []
    if graphs:  # an audit without them needs no reader of theirs
        from keystore_audit.intent.graph import read_graph

        intents += map(read_graph, graphs)
    if launches:
        from keystore_audit.intent.launch import read_launch

        intents += (read_launch(path, arguments) for path in launches)
    if policy is not None:
        from keystore_audit.intent.policy import read_policy

        intents.append(read_policy(policy, include).intent)
    return tuple(intents)
