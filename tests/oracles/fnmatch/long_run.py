"""Look for a name in no class for as long as one likes: `python -m tests.oracles.fnmatch.long_run --count 10000000`."""

from __future__ import annotations

import argparse
import random

from keystore_audit.profiles import Matcher
from tests.oracles.fnmatch.brute_force import assert_classes_are_exact
from tests.oracles.fnmatch.corpus import pattern_set
from tests.oracles.fnmatch.libraries import FLAGS, ask_all


def main() -> None:
    """Stop at the first set of expressions of which libc or ACE says otherwise."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=1_000_000, help="names to look at, for some set each")
    arguments.add_argument("--seed", type=int, default=0)
    chosen = arguments.parse_args()
    random_ = random.Random(chosen.seed)
    sets = checked = 0
    while checked < chosen.count:
        checked += assert_classes_are_exact(pattern_set(random_, *FLAGS, Matcher.SINGLE_TRY), ask_all)
        sets += 1
    print(f"{checked} names in the classes of {sets} sets of expressions: no contradiction")


if __name__ == "__main__":
    main()
