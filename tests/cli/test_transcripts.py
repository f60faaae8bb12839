"""What commands say of samples, whole: tests/golden/cli has a transcript of each; `--golden` writes the answers again.

`$ ` begins a call, whose answer follows: what it says, on stderr behind `! `, and its exit code. `> ` begins a file of
that name; `# ` a remark. `$AT` is an instant at which every sample is valid. A remark says why an answer matters.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from keystore_audit import __version__
from tests.cli.keystores import AT, run_at
from tests.test_samples import EXPECTATIONS, SAMPLES, as_built

TRANSCRIPTS = Path(__file__).parents[1] / "golden/cli"
BLOCK = re.compile(r"^([$>#] .*)\n((?:(?![$>#] ).*\n)*)", re.MULTILINE)


def answered(call: str, folder: Path) -> str:
    """The call, and all that the program says; keystores that it names have the modes that they were built with."""
    words = shlex.split(call.removeprefix("$ ").replace("$AT", f"--at {AT}"))
    for word in words:
        expectation = SAMPLES / f"{word}.toml"
        if (SAMPLES / word).is_dir() and expectation.is_file() and not (folder / word).exists():
            as_built(expectation, folder / word)
    done = run_at(folder, *words)
    assert "Traceback" not in done.stderr
    said = [*done.stdout.splitlines(), *(f"! {line}".rstrip() for line in done.stderr.splitlines())]
    assert all(line.isprintable() for line in said)
    return "\n".join([call, *said, f"[{done.returncode}]\n"]).replace(__version__, "VERSION")


@pytest.mark.parametrize("name", sorted(path.name for path in TRANSCRIPTS.iterdir()))
def test_commands_say_what_the_transcript_has(
    name: str, tmp_path: Path, golden: Callable[[str, str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("KEYSTORE_AUDIT_ALLOY_JAR", raising=False)
    for each in SAMPLES.iterdir():
        if not any(each in path.parents for path in EXPECTATIONS):
            (tmp_path / each.name).symlink_to(each)
    blocks = BLOCK.findall((TRANSCRIPTS / name).read_text("utf-8"))
    said = []
    for head, body in blocks:
        if head.startswith(">"):
            (tmp_path / head[2:]).write_text(body, "utf-8")
        said.append(answered(head, tmp_path) if head.startswith("$") else f"{head}\n{body}")
    golden(f"cli/{name}", "".join(said))
