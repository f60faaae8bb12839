"""How much is tried by chance: a fifth in `make test`, all in `make test-long`, more with a larger number."""

from __future__ import annotations

import os
from typing import Final

SHARE: Final = float(os.environ.get("KEYSTORE_AUDIT_TESTS", "0.2"))


def tried(count: int, least: int = 1) -> int:
    """So many, by that share; seeds are counted from the first, so that a larger share looks at further ones."""
    return max(least, round(count * SHARE))
