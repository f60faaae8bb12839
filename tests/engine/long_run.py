"""Hold the engines against each other for as long as one likes: `python -m tests.engine.long_run --count 1000`."""

from __future__ import annotations

import argparse
import sys

from tests.engine.test_agreement import SYSTEMS, disagreements


def main() -> None:
    """The exit code is 1 where the engines, or enumeration by hand, disagree."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=1000, help="random systems to look at")
    arguments.add_argument("--seed", type=int, default=SYSTEMS, help="of the first; the tests look at those before")
    chosen = arguments.parse_args()
    differing, _tally = disagreements(range(chosen.seed, chosen.seed + chosen.count))
    print(*differing, f"{chosen.count} systems: {len(differing)} disagreements", sep="\n")
    sys.exit(bool(differing))


if __name__ == "__main__":
    main()
