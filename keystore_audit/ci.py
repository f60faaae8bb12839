"""Whether this runs in CI, where nothing is fetched unasked and no settings count that merely lie there."""

from __future__ import annotations

import os


def in_ci() -> bool:
    """Whether the variable CI is set, and not to say no."""
    return os.environ.get("CI", "").lower() not in ("", "0", "false")
