"""One keystore, read twice: by keystore_audit for both engines, and by the second reader."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from tests.second_reader.asked import ask
from tests.second_reader.comparison import Seen, compare
from tests.second_reader.given import differences
from tests.second_reader.listing import Listing
from tests.second_reader.material import AT
from tests.second_reader.stores import store


def check(root: Path, at: datetime, profiles: Sequence[str], seen: Seen) -> list[str] | None:
    """Where the readers differ; None where there is nothing to audit."""
    asked = ask(root, at, profiles)
    listing = Listing(root)
    if asked is None:
        return [f"enclave {each.folder.name} is not read" for each in listing.enclaves] or None
    found = [
        f"Alloy is told otherwise: {each}"
        for system, text in zip(asked.systems, asked.texts, strict=True)
        for each in differences(system, text)
    ]
    found += compare(listing, asked.systems, asked.certificates, at, seen)
    mine = frozenset(listing.tree.foreign)
    seen["foreign file"] += len(mine)
    return [*found, *(f"foreign, or not: {path}" for path in sorted(mine ^ asked.foreign))]


def profiles_of(seed: int) -> tuple[str, ...]:
    """Four of them, in turns: more say the same."""
    fastdds, cyclonedds = ("fastdds-3.6", "fastdds-2.6")[seed % 2], ("cyclonedds-0.10", "cyclonedds-11")[seed // 2 % 2]
    return "spec", "fastdds-2.9", fastdds, cyclonedds


def check_seed(seed: int, folder: Path, seen: Seen) -> list[str]:
    """The same of a random store, which is taken away again."""
    made = store(seed)
    here: Seen = Seen()
    with _written(folder / str(seed)) as root:
        made.write(root)
        found = check(root, AT, profiles_of(seed), here)
    if found is None:
        return ["nothing to audit"]
    seen.update(here)
    seen.update(f"store: {feature}" for feature in made.features)
    if not made.may_be_unknown:  # where all was read nothing is unknown
        found += [f"{count} times {what}" for what, count in here.items() if what.startswith("opaque")]
    return found


@contextmanager
def _written(root: Path) -> Iterator[Path]:
    root.mkdir(parents=True)
    try:
        yield root
    finally:
        shutil.rmtree(root)
