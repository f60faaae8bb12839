"""All recipes, all pairs and any number of random keystores: `python -m tests.oracles.vendors.long_run --count 10000`.

Prints how often we agree with the real Cyclone DDS and Fast DDS, where we know no answer, and where we deviate: the
exit code is 1 for deviations. Pairs and peers are compared by their tests.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.oracles.vendors.enclave import vendors
from tests.oracles.vendors.local_comparison import Comparison, compare
from tests.oracles.vendors.random_keystores import keystore
from tests.oracles.vendors.recipes import every


def _find(program: str) -> str:
    path = shutil.which(program)
    if path is None:
        sys.exit(f"{program} is missing")
    return path


def main() -> int:
    """Compare."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=10_000)
    arguments.add_argument("--seed", type=int, default=0, help="of the first random keystore")
    chosen = arguments.parse_args()
    recipes, random = Comparison(), Comparison()
    with tempfile.TemporaryDirectory() as folder, vendors(_find, Path(folder)) as asked:
        compare(asked, every().values(), Path(folder), recipes)
        compare(asked, map(keystore, range(chosen.seed, chosen.seed + chosen.count)), Path(folder), random)
    tests = [str(Path(__file__).with_name(name)) for name in ("test_pairs.py", "test_remote_decisions.py")]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    peers = subprocess.run(command, check=False).returncode
    print(f"recipes:\n{recipes}\n{chosen.count} random keystores:\n{random}")
    return 1 if recipes.deviating or random.deviating or peers != 0 else 0


if __name__ == "__main__":
    sys.exit(main())
