"""What changed in meaning between two keystores: `diff`, and whoever wants the answer as a value."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.comparison.change import Comparison
from keystore_audit.model.comparison.compare import compare
from keystore_audit.model.profiles import Profile


def compare_keystores(
    old: str | os.PathLike[str],
    new: str | os.PathLike[str],
    *,
    profiles: Sequence[Profile],
    at: datetime,
    zone: ZoneInfo | None = None,
    domain: int | None = None,
    labels: Mapping[str, Globs] | None = None,
) -> Comparison:
    """What changed from the keystore at `old` to that at `new`, both as of `at` (aware UTC).

    `labels`: by label, what has it; where there are some, changes about others do not fail.
    Raises errors.NothingToAudit where one of them is none, errors.UsageError for a label of nothing in either, and
    errors.BudgetExceeded where there are too many classes of names.
    """
    return compare(read_keystore(old), read_keystore(new), profiles, at, zone, domain, labels)
