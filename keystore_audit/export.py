"""`keystore-audit model`: the Alloy model of a keystore, for the Analyzer's window."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

from keystore_audit.engine.alloy.facts import write_model
from keystore_audit.errors import BudgetExceeded
from keystore_audit.intent.intent import Intent
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.profiles import resolve
from keystore_audit.model.usability import Usabilities
from keystore_audit.model.wiring import wiring


def export_model(
    path: str | os.PathLike[str],
    directory: Path,
    *,
    at: datetime,
    profiles: Sequence[str] = (),
    domain: int | None = None,
    time_zone: ZoneInfo | None = None,
    intents: Sequence[Intent] = (),
) -> None:
    """Writes the Alloy model of the keystore into `directory`, ready for the Alloy Analyzer.

    `intents`: which nodes will use it. Raises errors.NothingToAudit, errors.UsageError (unknown profile, directory not
    writable) or errors.BudgetExceeded.
    """
    keystore = read_keystore(path)
    nodes = wiring(intents, keystore.layout.kind)
    accesses = AccessViews(documents_of(keystore), at, time_zone)
    usabilities = Usabilities(domain, accesses)
    meaning = interpret(keystore, resolve(profiles), at, accesses, usabilities, nodes=nodes)
    if meaning.over_budget is not None:
        raise BudgetExceeded(meaning.over_budget)
    write_model(meaning.systems, directory)
