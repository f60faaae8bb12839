"""What every hostile keystore of tests/hostile/ takes: time, and memory above what a healthy one needs.

`python -m benchmarks.hostile` prints all of them, the slowest first.
"""

from __future__ import annotations

import shutil
import tempfile
import warnings
from pathlib import Path
from typing import Any

from msgspec import Struct

from tests.hostile import credentials, directories, documents, envelopes, names
from tests.hostile.client import AT, Server
from tests.hostile.store import Base, Case, Store, build

ROOT = Path(__file__).resolve().parent.parent

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


def rows() -> tuple[float, list[Row]]:
    """Processor seconds of a healthy keystore, and what each hostile one takes."""
    cases = [case for module in (documents, envelopes, credentials, directories, names) for case in module.CASES]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        folder.chmod(0o755)
        base = build(folder / "base")
        server = Server(ROOT)
        ask(server, base.root, folder, warm=True)
        healthy = ask(server, base.root, folder)
        found = [measured(server, base, folder, case, healthy["peak"]) for case in cases]
        server.close()
    return healthy["cpu"], found


if __name__ == "__main__":
    print("| keystore of two enclaves | exit code | s | s CPU | MB above a healthy one |\n|---|---|---|---|---|")
    print(*sorted(rows()[1], key=lambda each: -each.cpu), sep="\n")
