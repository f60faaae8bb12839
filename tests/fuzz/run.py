"""Coverage-guided fuzzing of one reader: `python -m tests.fuzz.run TARGET [--seconds N]`.

atheris watches which lines of keystore_audit an input reaches and keeps mutating those that reach new ones. An input
that breaks a promise of tests/fuzz/targets.py ends the run with code 1 and is written to `crash-…` in the directory
that `--crashes` names.
"""

from __future__ import annotations

import argparse
import base64
import binascii
import re
import shutil
import sys
import tempfile
from pathlib import Path

MAX_MEMORY = 1024
"""Megabytes after which libFuzzer calls an input a fault."""

MAX_SECONDS = 10
"""Wall time of one input after which libFuzzer calls it a hang (issue 4)."""

ENCODED = frozenset({"certificate", "crl", "private_key", "smime"})
"""Targets whose input is base64 around DER, in which a random change reaches nothing."""

BASE64 = re.compile(rb"(?:^[A-Za-z0-9+/=]{1,80}\r?\n){2,}", re.MULTILINE)


def _mutate_inside(data: bytes, max_size: int, seed: int) -> bytes:
    """Change what the base64 stands for in three of four cases, and the text in the fourth."""
    import atheris  # type: ignore[import-untyped]

    blocks = list(BASE64.finditer(data))
    if seed % 4 == 0 or not blocks:
        return bytes(atheris.Mutate(data, max_size))
    block = blocks[seed // 4 % len(blocks)]
    try:
        der = base64.b64decode(block.group())
    except binascii.Error:
        return bytes(atheris.Mutate(data, max_size))
    encoded = base64.b64encode(atheris.Mutate(der, max(1, max_size - len(data))))
    lines = b"".join(encoded[at : at + 64] + b"\n" for at in range(0, len(encoded), 64))
    return (data[: block.start()] + lines + data[block.end() :])[:max_size]


def main() -> None:
    arguments = _arguments()
    import atheris  # only where it has a wheel: see pyproject.toml

    with atheris.instrument_imports(include=["keystore_audit"]):
        from tests.fuzz.targets import CORPUS, MAX_INPUT, READERS
    seeds = CORPUS / arguments.target
    with tempfile.TemporaryDirectory() as found:
        options = [f"-max_len={MAX_INPUT}", f"-rss_limit_mb={MAX_MEMORY}", f"-timeout={MAX_SECONDS}"]
        options += [f"-max_total_time={arguments.seconds}", f"-runs={arguments.runs}", f"-seed={arguments.seed}"]
        options += [f"-artifact_prefix={arguments.crashes}/", "-verbosity=0", "-print_final_stats=1"]
        inside = {"custom_mutator": _mutate_inside} if arguments.target in ENCODED else {}
        atheris.Setup([sys.argv[0], *options, found, str(seeds)], READERS[arguments.target], **inside)
        if arguments.keep:
            import atexit

            atexit.register(_keep, Path(found), seeds)
        atheris.Fuzz()


def _keep(found: Path, seeds: Path) -> None:
    """Add what reached something new to the corpus; leave out what is large."""
    for path in found.iterdir():
        if path.stat().st_size < 4_096:
            shutil.copy(path, seeds / f"found-{path.name[:16]}.bin")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.run", description=__doc__)
    parser.add_argument("target", metavar="TARGET")
    parser.add_argument("--seconds", type=int, default=60, help="how long (default 60)")
    parser.add_argument("--runs", type=int, default=-1, help="how many inputs at most (default: any number)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    parser.add_argument("--crashes", default=".", help="directory for inputs that break a promise")
    parser.add_argument("--keep", action="store_true", help="add inputs that reach new lines to the corpus")
    return parser.parse_args()


if __name__ == "__main__":
    main()
