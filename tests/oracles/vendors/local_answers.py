"""What the vendors answer to every recipe, written down, and where we know no answer.

`python -m tests.oracles.vendors.local_answers` measures again and writes both tables.
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tests.oracles.vendors.enclave import Answer, vendors
from tests.oracles.vendors.local_comparison import Comparison, compare
from tests.oracles.vendors.recipes import every

MEASURED = Path(__file__).with_name("measured_local.json")
"""By recipe and vendor: + (created), t (topic refused), - (refused later) for each endpoint, else why none starts."""

ABSTENTIONS = Path(__file__).with_name("local_abstentions.json")
"""By recipe and vendor: why we say unknown."""

_PASSING = (
    (re.compile(r"Error occurred while validating local permissions?: "), ""),
    (re.compile(r"[0-9A-F]{16}:error:"), "error:"),
    (re.compile(r"path: .*"), "path"),
    (re.compile(r"[^ ]*/(?=[a-z_]+(\.cert)?\.(pem|p7s))"), ""),
    (re.compile(r" ?\(\./?src[^)]*\)|:\./[^(]*|:\.\./[^(]*"), ""),
    (re.compile(r"\((expired|start): [^)]*\)"), r"(\1)"),
)
"""Of a message: what is the same for all, addresses, where the files were and the source stands, dates."""


_OF_TODAY = re.compile(r"\d{4}-\d\d-\d\d([Tt ][\d:]*)?|=+\d+==")


def written(answer: Answer) -> str:
    """The answer in one string that does not change with time and place."""
    if answer.participant is None:
        return "".join("+" if why is None else "t" if why.startswith("topic") else "-" for why in answer.endpoints)
    message = answer.participant
    for pattern, instead in _PASSING:
        message = pattern.sub(instead, message)
    return f"refused: {message.strip()}"


def abstentions(found: Mapping[tuple[str, str], str]) -> dict[str, dict[str, str]]:
    """By title and vendor, why we do not know, without today's dates and boundaries of messages."""
    listed: dict[str, dict[str, str]] = {}
    for (vendor, title), why in found.items():
        reason = why.partition(": ")[2] or why  # behind the words that say what cannot be told
        listed.setdefault(title, {})[vendor] = _OF_TODAY.sub("…", reason)
    return listed


def table(rows: Mapping[str, Mapping[str, str]]) -> str:
    """JSON with one line a recipe, sorted."""
    lines = (f"{json.dumps(title)}: {json.dumps(rows[title], sort_keys=True)}" for title in sorted(rows))
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _find(program: str) -> str:
    path = shutil.which(program)
    assert path is not None, program
    return path


def main() -> None:
    """Measure and write."""
    comparison = Comparison()
    with tempfile.TemporaryDirectory() as folder, vendors(_find, Path(folder)) as asked:
        answers = compare(asked, every().values(), Path(folder), comparison)
    MEASURED.write_text(table({title: {n: written(a) for n, a in each.items()} for title, each in answers.items()}))
    ABSTENTIONS.write_text(table(abstentions(comparison.abstained)))
    print(Comparison(agreed=comparison.agreed, deviating=comparison.deviating))


if __name__ == "__main__":
    main()
