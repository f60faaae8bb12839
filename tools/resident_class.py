"""Compile keystore_audit/engine/alloy/Resident.java again: a Java without a compiler runs the Eclipse one, from Maven.

Prints the SHA-256 that `engine/alloy/install.py` has to know. A test compares the bytes.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from keystore_audit.engine.alloy.install import CLASS, Engine, locate, maven_artifact

VERSION: Final = "3.44.0"
SHA256: Final = "14c46ddc2e511c46c998da728f6a80f13a689c920f3832402f7ad150f6a6188d"
"""Of org.eclipse.jdt:ecj; what it makes depends on it."""

SOURCE: Final = Path(__file__).resolve().parents[1] / "keystore_audit/engine/alloy/Resident.java"


def compiled(engine: Engine) -> bytes:
    """The class, for Java 17 and newer. Raises what `maven_artifact` does, RuntimeError too for another compiler."""
    with TemporaryDirectory() as scratch:
        compiler = maven_artifact("org.eclipse.jdt", "ecj", VERSION, Path(scratch))
        if hashlib.sha256(compiler.read_bytes()).hexdigest() != SHA256:
            raise RuntimeError(f"{compiler} is not the Eclipse compiler {VERSION}")
        words = (engine.java, "-jar", compiler, "-17", "-g:none", "-cp", engine.jar, "-d", scratch, SOURCE)
        subprocess.run([str(word) for word in words], check=True)
        return (Path(scratch) / CLASS).read_bytes()


if __name__ == "__main__":
    content = compiled(locate(None, offline=False, ci=False))
    SOURCE.with_name(CLASS).write_bytes(content)
    sys.stdout.write(f"{hashlib.sha256(content).hexdigest()}\n")
