"""Measures every hostile keystore of tests/hostile/: time, and memory above what a healthy one needs.

`python -m benchmarks.hostile` prints the ten slowest, the ten largest and all beyond the targets (of
processor time); `--all` prints all.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from msgspec import Struct

from tests.hostile import credentials, directories, documents, envelopes, names
from tests.hostile.client import AT, Server
from tests.hostile.store import Base, Case, Store, build

ROOT = Path(__file__).resolve().parent.parent

MAX_SECONDS = 1.0
MAX_MEGABYTES = 200
"""The targets of issue 4, point 4."""

REPEAT = 3


class Row(Struct, frozen=True):
    """What one keystore cost: the least of several runs, since others use the machine too."""

    name: str
    exit: int
    seconds: float
    cpu: float
    megabytes: float

    def __str__(self) -> str:
        return f"| {self.name} | {self.exit} | {self.seconds:.2f} | {self.cpu:.2f} | {self.megabytes:.0f} |"

    @property
    def beyond(self) -> bool:
        return self.cpu > MAX_SECONDS or self.megabytes > MAX_MEGABYTES


def ask(server: Server, root: Path, written: Path, options: tuple[str, ...] = (), **more: bool) -> dict[str, Any]:
    argv = ["audit", str(root), "--engine", "native", "--at", AT, *options]
    answers = [server.ask(argv=argv, root=str(root), written=f"{written}/", **more) for _ in range(REPEAT)]
    return min(answers, key=lambda answer: float(answer["cpu"]))


def measured(server: Server, base: Base, folder: Path, case: Case, baseline: int) -> Row:
    place = folder / "case"
    place.mkdir(mode=0o755)
    store = Store.copy(base, place, "http://127.0.0.1:9")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            case.spoil(store)
        answer = ask(server, store.root, folder, case.options, nobody=case.nobody)
    finally:
        if store.victim.is_dir():
            store.victim.chmod(0o755)
        shutil.rmtree(place)
    megabytes = max(0, answer["peak"] - baseline) / (1 << 20)
    return Row(case.name, answer["exit"], answer["seconds"], answer["cpu"], megabytes)


def main() -> None:
    """Prints the tables."""
    cases = [case for module in (documents, envelopes, credentials, directories, names) for case in module.CASES]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        folder.chmod(0o755)
        base = build(folder / "base")
        server = Server(ROOT)
        ask(server, base.root, folder, warm=True)
        healthy = ask(server, base.root, folder)
        rows = [measured(server, base, folder, case, healthy["peak"]) for case in cases]
        server.close()
    own = f"{healthy['seconds']:.2f} s, {healthy['cpu']:.2f} s CPU"
    print(f"{len(rows)} hostile keystores of two enclaves; a healthy one: {own}\n")
    header = "| keystore | exit code | s | s CPU | MB above a healthy one |\n|---|---|---|---|---|"
    if "--all" in sys.argv:
        print(header, *rows, sep="\n")
        return
    for title, chosen in (
        ("slowest", sorted(rows, key=lambda row: -row.cpu)[:10]),
        ("largest", sorted(rows, key=lambda row: -row.megabytes)[:10]),
        (f"beyond {MAX_SECONDS:.0f} s or {MAX_MEGABYTES} MB", [row for row in rows if row.beyond]),
    ):
        print(f"\n{title}:\n", header, *chosen, sep="\n")


if __name__ == "__main__":
    main()
