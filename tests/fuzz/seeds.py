"""Makes the seeds of the corpora out of sample_keystores/: `python -m tests.fuzz.seeds`.

What a fuzzer finds is kept beside them under names that say so (`run.py --keep`); seeds are written again, not removed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from keystore_audit.keystore.cms import CmsError
from keystore_audit.keystore.mime import MimeError, read_message
from keystore_audit.keystore.smime import read_signed
from tests.fuzz.targets import CORPUS, present

MAX_SEED = 6_000
"""Bytes: larger seeds make slower runs and find no more."""

SAMPLES = Path(__file__).parents[2] / "sample_keystores"
SUFFIX = {"cms": ".der", "xml": ".xml", "governance": ".xml", "permissions": ".xml", "smime": ".p7s", "mime": ".p7s"}
COUNT = 10
"""Seeds of one target: one of each kind of sample."""


def main() -> None:
    for target, name, content in seeds():
        folder = CORPUS / target
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}{SUFFIX.get(target, '.pem')}").write_bytes(content)


def seeds() -> Iterator[tuple[str, str, bytes]]:
    """Target, name and content."""
    yield from _signed()
    yield from _distinct("certificate", "*cert.pem", ("KA2*/bad", "healthy/turtlesim"))
    yield from _distinct("crl", "crl.pem", ("KA21*/*",))
    yield from _distinct("private_key", "key.pem", ("KA21*/bad", "KA216*/good", "healthy/turtlesim"))
    yield from _distinct("pem", "*.pem", ("KA20*/bad", "KA21[1-3]*/bad"))


def _files(pattern: str, samples: tuple[str, ...]) -> Iterator[Path]:
    for sample in samples:
        for root in sorted({*SAMPLES.glob(sample), *(SAMPLES / "rules").glob(sample)}):
            yield from (path for path in sorted(root.rglob(pattern)) if path.is_file() and not path.is_symlink())


def _distinct(target: str, pattern: str, samples: tuple[str, ...]) -> Iterator[tuple[str, str, bytes]]:
    seen: set[str] = set()
    for path in _files(pattern, samples):
        sample = path.relative_to(SAMPLES).parts[1]
        content = path.read_bytes()
        if sample in seen or len(content) > MAX_SEED or len(seen) == COUNT:
            continue
        seen.add(sample)
        yield target, sample, content


def _signed() -> Iterator[tuple[str, str, bytes]]:
    """Messages, the structures and texts in them, and the certificates of those who signed them."""
    patterns = (
        "healthy/turtlesim",
        "healthy/talker_listener",
        "KA30[1-9]*/bad",
        "KA31*/bad",
        "KA40[12]*/bad",
        "KA421*/bad",
    )
    kinds = ("governance", "permissions")
    signers: dict[str, bytes] = {}
    for kind in kinds:
        for _, sample, content in _distinct(kind, f"{kind}.p7s", (*patterns, "KA50[12]*/bad", "KA51*/bad")):
            document = read_signed(present(content), ())
            yield "smime", f"{sample}-{kind}", content
            if kind == "permissions":
                yield "mime", sample, content
            if document.content is not None:
                yield kind, sample, document.content
                yield "xml", f"{sample}-{kind}", document.content
            try:
                yield "cms", f"{sample}-{kind}", read_message(content).signature
            except (MimeError, CmsError):
                continue
            for path in _files("*ca.cert.pem", (f"*/{sample}", f"{sample}/bad")):
                signers.setdefault(hashlib.sha256(path.read_bytes()).hexdigest(), path.read_bytes())
    for number, pem in enumerate(signers.values()):
        yield "certificate", f"signer-{number}", pem


if __name__ == "__main__":
    main()
