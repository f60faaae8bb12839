"""Random stores in any number: `python -m tests.second_reader.long_run --count 2000 --seed 0`.

Prints every store about which the two readers differ, and at the end how much was compared. The exit code is 1 if there
is any. A seed makes the same store again in whatever process: with `--keep` it is left there.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.second_reader.check import check_seed
from tests.second_reader.comparison import Seen
from tests.second_reader.stores import store


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.second_reader.long_run", description=__doc__)
    parser.add_argument("--count", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    seen, differing = Seen(), 0
    with TemporaryDirectory() as folder:
        for seed in range(options.seed, options.seed + options.count):
            found = check_seed(seed, Path(folder), seen)
            if found:
                differing += 1
                print(f"store {seed}: {', '.join(sorted(store(seed).features))}", flush=True)
                print("".join(f"    {each}\n" for each in found[:5]), end="")
                if options.keep is not None:
                    store(seed).write(options.keep / str(seed))
    for what, count in sorted(seen.items()):
        print(f"{count:>9} {what}")
    print(f"{options.count} stores, {differing} differ, {time.process_time():.0f} s of processor time")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
