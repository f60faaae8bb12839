"""What all pairs did on this machine, and the table of what they did when it was measured.

`python -m tests.oracles.vendors.pairs_measured` measures again and writes the table.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.oracles.vendors.pairs import Pairs, pairs
from tests.oracles.vendors.pairs_case import Case, outcome
from tests.oracles.vendors.pairs_documents import DOCUMENT_CASES
from tests.oracles.vendors.pairs_governance import GOVERNANCE_CASES

CASES: tuple[Case, ...] = (*GOVERNANCE_CASES, *DOCUMENT_CASES)
TABLE = Path(__file__).with_name("measured_pairs.json")


def measured() -> dict[str, dict[str, str]]:
    """By the title of the case and the vendor, the letters of `outcome`."""
    table: dict[str, dict[str, str]] = json.loads(TABLE.read_text())
    return table


def outcomes(vendor: Pairs, cases: Sequence[Case], directory: Path, expected: Sequence[str | None]) -> list[str]:
    """What each case does; one that does other than expected is let meet again, alone and with patience."""
    sides = [case.sides(directory / str(number)) for number, case in enumerate(cases)]
    meetings = vendor.meet_all(sides, lambda n, seen: expected[n] in (None, outcome(seen, cases[n])))
    return [outcome(meeting, case) for meeting, case in zip(meetings, cases, strict=True)]


def _main() -> None:
    with TemporaryDirectory() as directory, pairs(lambda program: str(shutil.which(program)), Path(directory)) as both:
        table: dict[str, dict[str, str]] = {case.title: {} for case in CASES}
        for name, vendor in both.items():
            place = Path(directory) / name
            for case, letters in zip(CASES, outcomes(vendor, CASES, place, [None] * len(CASES)), strict=True):
                table[case.title][name] = letters
    lines = (f"{json.dumps(title)}: {json.dumps(answers)}" for title, answers in table.items())
    TABLE.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    _main()
