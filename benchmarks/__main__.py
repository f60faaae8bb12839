"""`python -m benchmarks` prints how long audits take and how much memory, each figure beside its goal and its limit."""

from __future__ import annotations

import argparse

from benchmarks.program import NotDecided
from benchmarks.rows import ROWS, Figure

QUICK = 0.05
"""The share of the usual counts that is enough to see that a row works."""


def main() -> None:
    """Print a row as soon as it is measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"{', '.join(ROWS)}; all of them, if none is named")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK:.0%} of the usual counts, to try the rows")
    arguments = parser.parse_args()
    if unknown := set(arguments.rows) - set(ROWS):
        parser.error(f"no row {', '.join(sorted(unknown))}")
    print("| row | what | goal | today | limit | ours: processor (clock) | peer |", flush=True)
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in arguments.rows or ROWS:
        what, goal, limit, measure = ROWS[name]
        try:
            found = measure(QUICK if arguments.quick else 1.0)
        except NotDecided as undecided:
            found = Figure(f"{undecided}")
        print(f"| {name} | {what} | {goal} | {found.value} | {limit} | {found.ours} | {found.peer} |", flush=True)


if __name__ == "__main__":
    main()
