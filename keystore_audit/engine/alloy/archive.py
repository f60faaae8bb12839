"""The Analyzer's classes as a JVM has them after an answer: each start saves that time (JEP 514, Java 25).

The archive is beside the jar in the user's cache. Its name has the digest of its sources and the digest of its content.
An archive is used only with that digest, from a file that nobody else may write, and by the same Java.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Final

from keystore_audit.engine.alloy.install import CLASS_SHA256, SHA256, cached_jar
from keystore_audit.errors import EngineMissing

OLDEST_JAVA: Final = 25
"""The first that makes an archive in one step (JEP 514)."""

MAX_SIZE: Final = 256 * 1024 * 1024
"""Bytes: ten times a real one."""

_RELEASE: Final = re.compile(rb'^JAVA_VERSION="(\d+)', re.MULTILINE)


def is_made_by(java: Path) -> bool:
    """Whether this Java makes one."""
    return bool(_stem(java))


def find(java: Path) -> Path | None:
    """Where an archive for this Java is, None where there is none; `content` says whether it may be used."""
    stem = _stem(java)
    try:
        return next(iter(sorted(_folder().glob(f"{stem}-*.aot"))), None) if stem else None
    except EngineMissing:
        return None


def content(java: Path) -> bytes | None:
    """The archive for this Java, if it is what its name says and nobody else can have written it; else None."""
    archive = find(java)
    if archive is None:
        return None
    try:
        with archive.open("rb") as file:
            status = os.fstat(file.fileno())
            found = file.read(MAX_SIZE)
    except OSError:
        return None
    private = status.st_uid in (0, os.geteuid()) and not status.st_mode & 0o022
    return found if private and hashlib.sha256(found).hexdigest() == archive.stem.rpartition("-")[2] else None


def store(made: Path, java: Path) -> Path:
    """Put an archive that this Java has made into the cache, in place of every other. Raises OSError."""
    folder = _folder()
    digest = hashlib.sha256(made.read_bytes()).hexdigest()
    target = folder / f"{_stem(java)}-{digest}.aot"
    with tempfile.TemporaryDirectory(dir=folder, prefix=".archive-") as scratch:
        shutil.copyfile(made, Path(scratch) / "archive")
        (Path(scratch) / "archive").chmod(0o600)
        (Path(scratch) / "archive").replace(target)
    for other in folder.glob("alloy-classes-*.aot"):
        if other != target:
            other.unlink(missing_ok=True)
    return target


def _folder() -> Path:
    """Where archives lie: beside the jar."""
    return cached_jar(os.environ).parent


def _stem(java: Path) -> str:
    """What the names of archives for this Java begin with; empty where it makes none."""
    try:
        release = (java.resolve().parent.parent / "release").read_bytes()
    except OSError:
        return ""
    version = _RELEASE.search(release)
    if version is None or int(version[1]) < OLDEST_JAVA:
        return ""
    told = repr((release, SHA256, CLASS_SHA256))
    return f"alloy-classes-{hashlib.sha256(told.encode()).hexdigest()[:16]}"
