"""What the vendors answered to every recipe: measured, written down, and compared with what they answer now.

`python -m tests.oracles.vendors.local_answers` measures again and writes measured_local.json.
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from tests.oracles.vendors.enclave import Answer, Vendor, vendors
from tests.oracles.vendors.recipe import Recipe
from tests.oracles.vendors.recipes import every

MEASURED = Path(__file__).with_name("measured_local.json")
"""By recipe and vendor: + (created), t (topic refused), - (refused later) for each endpoint, else why none starts."""

_PASSING = (
    (re.compile(r"Error occurred while validating local permissions?: "), ""),
    (re.compile(r"[0-9A-F]{16}:error:"), "error:"),
    (re.compile(r"path: .*"), "path"),
    (re.compile(r"[^ ]*/(?=[a-z_]+(\.cert)?\.(pem|p7s))"), ""),
    (re.compile(r" ?\(\./?src[^)]*\)|:\./[^(]*|:\.\./[^(]*"), ""),
    (re.compile(r"\((expired|start): [^)]*\)"), r"(\1)"),
)
"""Of a message: what is the same for all, addresses, where the files were and the source stands, dates."""


def written(answer: Answer) -> str:
    """The answer in one string that does not change with time and place."""
    if answer.participant is None:
        return "".join("+" if why is None else "t" if why.startswith("topic") else "-" for why in answer.endpoints)
    message = answer.participant
    for pattern, instead in _PASSING:
        message = pattern.sub(instead, message)
    return f"refused: {message.strip()}"


def measured(asked: Mapping[str, Vendor], recipes: Iterable[Recipe]) -> dict[str, dict[str, str]]:
    """What every recipe comes to."""
    answers = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, recipe in enumerate(recipes):
            enclave = recipe.build(Path(folder) / str(number))
            answers[recipe.title] = {
                name: written(vendor.ask(enclave, recipe.domain, recipe.endpoints, recipe.time_zone))
                for name, vendor in asked.items()
            }
            shutil.rmtree(enclave)
    return answers


def _find(program: str) -> str:
    path = shutil.which(program)
    assert path is not None, program
    return path


def main() -> None:
    """Measure and write."""
    with tempfile.TemporaryDirectory() as folder, vendors(_find, Path(folder)) as asked:
        answers = measured(asked, every().values())
    lines = (f"{json.dumps(title)}: {json.dumps(answers[title], sort_keys=True)}" for title in sorted(answers))
    MEASURED.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
