"""Writes keystore_audit/keystore/published_keys.txt: every key that sample_keystores/ publishes."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from keystore_audit.errors import NothingToAudit  # noqa: E402
from keystore_audit.keystore.key_quality import material_of_keystore  # noqa: E402
from keystore_audit.keystore.keystore import read_keystore  # noqa: E402

SAMPLES = ROOT / "sample_keystores"
LIST = ROOT / "keystore_audit" / "keystore" / "published_keys.txt"


def keys_of(sample: Path) -> set[str]:
    """The keys of one sample, as an audit sees them."""
    try:
        return {each.key for each in material_of_keystore(read_keystore(sample)).keys}
    except NothingToAudit:
        return set()


def samples() -> list[Path]:
    """The directories beside which an expectation stands."""
    return sorted(path.with_suffix("") for path in SAMPLES.rglob("*.toml") if path.with_suffix("").is_dir())


if __name__ == "__main__":
    LIST.write_text("".join(f"{key}\n" for key in sorted(set().union(*map(keys_of, samples())))), "ascii")
