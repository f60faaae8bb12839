"""Two keystores of 1,000 enclaves compared: CPU seconds, beside those of one native audit, by what changed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks import keystores
from benchmarks.program import run
from tests.keystore.documents import domain_rule, topic_rule
from tests.keystore.documents import governance as governance_of


def others(root: Path, paths: list[str]) -> Iterator[tuple[str, Path]]:
    """Keystores beside the one that `keystores.build` makes, all of other keys, by what else is different."""
    yield (
        "all keys",
        keystores.build_with(root / "diff-keys", "ec", {path: keystores.permissions(path) for path in paths}),
    )
    topics = {
        path: keystores.wired_permissions(path, ["rt/chatter", f"rt{path}/state"], ["rt/clock", f"rt{path}/command"])
        for path in paths
    }
    yield "a topic of each enclave", keystores.build_with(root / "diff-topics", "ec", topics)
    wild = {
        path: keystores.wired_permissions(path, ["rt/chatter", f"rt{path.rpartition('/')[0]}/*"], ["rt/clock"])
        for path in paths
    }
    yield "wildcards for each robot", keystores.build_with(root / "diff-wild", "ec", wild)
    governance = governance_of(domain_rule(topic_rule(write=False))).encode()
    same = {path: keystores.permissions(path) for path in paths}
    yield "no write access control", keystores.build_with(root / "diff-open", "ec", same, governance)


def main() -> None:
    """The table."""
    enclaves = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    old = keystores.build(keystores.ROOT, enclaves, "ec")
    paths = [f"/robot{number // 10}/node{number % 10}" for number in range(enclaves)]
    audit = run("audit", "--engine", "native", "--format", "json", str(old)).cpu
    sys.stdout.write(
        f"{enclaves} enclaves; audit: {audit:.1f} s CPU\n\n| other | diff (s CPU) | diff / audit |\n|---|---|---|\n"
    )
    for words, new in [("nothing", old), *others(keystores.ROOT / str(enclaves), paths)]:
        taken = run("diff", str(old), str(new)).cpu
        sys.stdout.write(f"| {words} | {taken:.1f} | {taken / audit:.1f} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
