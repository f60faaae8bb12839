"""The mutations of the tests in any number: `python -m tests.oracles.smime.long_run --count 1000000 --seed 7`.

Prints what was seen every minute; messages that contradict OpenSSL or crash it, and the first one for each reason of
strictness that the list does not have, are kept in `--keep`. The exit code is 1 if there are any.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.oracles.smime.mutants import Tally, run
from tests.oracles.smime.oracle import Oracle, compile_oracle
from tests.oracles.smime.stricter import listed

STEP = 20_000
"""Mutations between two lines of output, about half a minute."""


def _keep(tally: Tally, oracle: Oracle, folder: Path) -> int:
    """Write what has to be looked at, a message and the permissions CA file each; how many."""
    unlisted = {reason: message for reason, message in tally.examples.items() if reason not in listed()}
    found = [
        *tally.contradictions,
        *((" ".join(reason), message, b"") for reason, message in unlisted.items()),
        *(("crash", message, b"") for message in oracle.crashes),
    ]
    for text, message, trusted in found:
        folder.mkdir(parents=True, exist_ok=True)
        stem = folder / hashlib.sha256(message).hexdigest()[:16]
        stem.with_suffix(".p7s").write_bytes(message)
        stem.with_suffix(".pem").write_bytes(trusted)
        print(f"FOUND {stem.name}: {text}")
    return len(found)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.smime.long_run", description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("found"))
    options = parser.parse_args()
    kept, done, started = 0, 0, time.monotonic()
    with TemporaryDirectory() as folder:
        oracle = Oracle(compile_oracle(lambda name: shutil.which(name) or name, Path(folder)))
        while done < options.count:
            tally = run(oracle, min(STEP, options.count - done), options.seed + done)
            done += tally.tried
            kept += _keep(tally, oracle, options.keep)
            oracle.crashes.clear()
            seen = ", ".join(f"{ours}/{theirs} {number}" for (ours, theirs), number in sorted(tally.verdicts.items()))
            print(f"{done} in {time.monotonic() - started:.0f} s, {kept} found; ours/OpenSSL: {seen}", flush=True)
        oracle.stop()
    return 1 if kept else 0


if __name__ == "__main__":
    sys.exit(main())
