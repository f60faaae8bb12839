"""Ask everybody for every document of the corpus; `python -m tests.oracles.xml.measure` writes the answers down.

A reading is told by how it differs from that of the plain document: "as the plain one", "refused", or the items that
only one of the two has, shortened.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.oracles.xml import ours
from tests.oracles.xml.corpus import DOCUMENTS, kind_of, plain_of
from tests.oracles.xml.parsers import Item, Parsers, Reading, lxml_reading, running
from tests.oracles.xml.plugins import Plugin, both

MEASURED = Path(__file__).parent / "measured.json"
"""What each parser reads, and our verdict."""

DECIDED = Path(__file__).parent / "measured_plugins.json"
"""What becomes of an enclave with each vendor."""

TOPICS = ("rt/chatter", "rt/x")

_SHOWN = 60
_NAMESPACE = re.compile(r"\{[^}]*\}")


def described(reading: Reading, plain: Reading) -> str:
    """The reading in words, against that of the plain document."""
    if reading is None:
        return "refused"
    assert plain is not None
    more, fewer = Counter(reading) - Counter(plain), Counter(plain) - Counter(reading)
    if len(fewer) > len(plain) // 2:
        return f"other elements: {_words(reading[0])} …"
    words = [_words(item) for item in more] + [f"without {_words(item)}" for item in fewer if not _replaced(item, more)]
    shown = words[:3] + ["…"] * (len(words) > 3)
    return ", ".join(shown) or ("as the plain one" if reading == plain else "in another order")


def _words(item: Item) -> str:
    path = _NAMESPACE.sub("{}", item.path).rpartition("/")[2]
    value = item.value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return path if item.kind == "E" else f"{path} = {value if len(value) <= _SHOWN else value[:_SHOWN] + '…'!r}"


def _replaced(item: Item, more: Counter[Item]) -> bool:
    return any(other.path == item.path for other in more)


def measured(parsers: Parsers, document: bytes) -> dict[str, str]:
    """What each parser reads, and whether we say that it means one thing."""
    plain = lxml_reading(plain_of(document))
    ours_says = ours.read(document, kind_of(document))
    if ours_says is None:
        verdict = "no content"
    else:
        verdict = "one meaning" if ours_says.values is not None else " ".join(sorted(ours_says.kinds))
    return {
        "tinyxml2": described(parsers.tinyxml2.read(document), plain),
        "cyclone": described(parsers.cyclone.read(document), plain),
        "lxml": described(lxml_reading(document), plain),
        "ours": verdict,
    }


def decided(plugin: Plugin, document: bytes) -> str:
    """What becomes of /talker in domain 0."""
    return str(plugin.ask(plugin.sign(document), kind_of(document), *TOPICS))


def main() -> None:
    """Write the table of this machine's parsers."""
    with tempfile.TemporaryDirectory() as directory, running(found, Path(directory)) as parsers:
        table = {title: measured(parsers, document) for title, document in DOCUMENTS.items()}
    with tempfile.TemporaryDirectory() as directory, both(found, Path(directory)) as plugins:
        decisions = {
            title: {name: decided(plugin, document) for name, plugin in plugins.items()}
            for title, document in DOCUMENTS.items()
        }
    MEASURED.write_text(json.dumps(table, indent=1) + "\n")
    DECIDED.write_text(json.dumps(decisions, indent=1) + "\n")


def found(program: str) -> str:
    path = shutil.which(program)
    return path if path is not None else sys.exit(f"no {program} here")


if __name__ == "__main__":
    main()
