"""Writes what the tool answers about every sample into a folder: two commits are compared by `diff -r`.

What changes no answer leaves no difference; whatever differs is told in the commit that changes it. Another commit's
answers about today's samples: `PYTHONPATH=ITS_CHECKOUT python tools/freeze.py FOLDER`.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, Final

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT))

ACTS: Final = ("publish", "subscribe", "relay")
NAMES: Final = ("rt/chatter", "rt/turtle1/cmd_vel", "rq/turtlesim/get_parametersRequest", "rt/rosout", "unheard")

from tools.samples import catalogue  # noqa: E402
from tools.samples.expectation import SAMPLES, with_engine  # noqa: E402
from tools.samples.store import copy_with_modes  # noqa: E402
from tools.samples.story import read_description  # noqa: E402


def answers(sample: Path, target: Path, engine: str, formats: Sequence[str] = ()) -> None:
    """Write what each command says of a copy of the sample, with its modes and at its instant; exit codes first.

    `formats`: those in which the audit's report is written, too.
    """
    about = read_description(sample)
    copy = Path("keys")
    copy_with_modes(sample, copy, int(about["key_mode"], 8))
    instant = ["--at", about["at"]]
    written = [word for each in formats for word in ("-o", f"{each}={target / each}")]
    asked = {
        "audit.json": ["audit", *with_engine(about["options"], engine), "-f", "json", *written, *instant, str(copy)],
        "access.json": ["access", "-f", "json", *instant, str(copy)],
    }
    beside = sample.with_name("good")
    if sample.name == "bad" and beside.is_dir():
        copy_with_modes(beside, Path("good"), int(read_description(beside)["key_mode"], 8))
        asked["diff.json"] = ["diff", "-f", "json", *instant, "good", str(copy)]
    target.mkdir(parents=True)
    _write(target, asked)
    _write(target, questions(json.loads((target / "audit.json").read_text().partition("\n")[2]), instant, copy))


def questions(report: Any, instant: Sequence[str], copy: Path) -> dict[str, Sequence[str]]:
    """The commands that ask about single enclaves: rights of every enclave, a flow, a compromise."""
    enclaves = [each["path"] for each in report.get("enclaves", ())]
    if not enclaves:
        return {}
    batch = Path("batch.tsv")
    asked = [f"{each}\t{act}\t{name}" for each in enclaves for act in ACTS for name in NAMES]
    batch.write_text("\n".join(asked) + "\n", encoding="utf-8", errors="surrogateescape")
    first, last = enclaves[0], enclaves[-1]
    return {
        "can.jsonl": ["can", "--batch", str(batch), *instant, str(copy)],
        "flow.json": ["flow", "-f", "json", *instant, str(copy), first, last],
        "compromise.json": ["flow", "-f", "json", *instant, str(copy), "--from-compromised", first],
    }


def _write(target: Path, asked: Mapping[str, Sequence[str]]) -> None:
    from keystore_audit.cli.program import run

    for name, words in asked.items():
        written = io.TextIOWrapper(io.BytesIO(), "utf-8")
        with redirect_stdout(written), redirect_stderr(written):
            code = run(words)
        written.flush()
        (target / name).write_bytes(b"%d\n" % code + written.buffer.getvalue())


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where to write; must not be there")
    parser.add_argument("--only", metavar="GLOB", default="*", help="directories below sample_keystores")
    parser.add_argument("--engine", default="native", help="who decides where a sample's options name nobody")
    options = parser.parse_args()
    folder = options.folder.absolute()
    for story in catalogue.stories(options.only):
        with tempfile.TemporaryDirectory() as place:
            os.chdir(place)
            for each in SAMPLES.iterdir():  # files that options name
                if each.is_dir():
                    Path(each.name).symlink_to(each)
            answers(SAMPLES / story.directory, folder / story.directory, options.engine)
            os.chdir(ROOT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
