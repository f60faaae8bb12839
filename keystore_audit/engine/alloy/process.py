"""The Alloy Analyzer at work: its command line, in a JVM that answers one question after the other.

A start costs a second, a question after the first a tenth of that. `Resident.java` calls the unmodified Analyzer in a
loop. A JVM has a process group and an environment of its own; each question has files, time and an answer of its own.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import select
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Final, cast

from msgspec import Struct

from keystore_audit.engine.alloy.answers import Command
from keystore_audit.errors import EngineFailed, EngineMissing, EngineTimeout

OUTPUT_DIRECTORY: Final = "solutions"
"""Where the Analyzer puts instances, below a question's directory; `Resident.java` knows it too."""

ARGUMENTS: Final = ("exec", "-f", "-t", "xml", "-d", "0", "-s", "sat4j", "-o")
"""What the Analyzer is told, before where instances go and which file is the main one.

No symmetry breaking and no deeper Skolem functions (-d 0): every atom is named, every witness outermost.
"""

MAX_OUTPUT: Final = 1_000_000
"""Bytes read of what the Analyzer writes to stderr, and to stdout: a line for each command, or a stack trace."""

MAX_ANSWER: Final = 200
"""Characters of the line that says that it has: a nonce, the digest of the question and a status."""

FIRST_COMPILER_ATOMS: Final = 2_500
"""Atoms up to which the JVM's first compiler alone is faster (0.8 s against 1.3 s for a small keystore)."""

LATE_SECOND_COMPILER: Final = (
    "-XX:Tier4InvocationThreshold=50000",
    "-XX:Tier4MinInvocationThreshold=6000",
    "-XX:Tier4CompileThreshold=150000",
    "-XX:Tier4BackEdgeThreshold=400000",
)
"""Ten times the JVM's own thresholds. Beyond that size the second compiler still takes nearly half of all processor
time (20 of 44 s at 500 enclaves). With these it compiles less (22 to 24 s against 26 to 28).
"""

STACK_MB: Final = 64
"""MiB of stack: the translator recurses along unions."""

_DIAGNOSTICS: Final = "diagnostics"
_MESSAGES: Final = "messages"
SCRATCH: Final = "scratch"
JAR: Final = "alloy.jar"
RESIDENT: Final = "resident.jar"

ARCHIVES: Final = {"AOTCache": "classes.aot", "AOTCacheOutput": "recorded.aot"}
"""By option, the archive of classes that a JVM uses, or makes when it ends, where there is such a file."""

_UNUSED: Final = ("exe.electrod", "exe.plingeling", "exe.yices", "lib.glucose", "lib.minisat", "lib.minisatprover")
"""Solvers in the jar that are never asked: the Analyzer would unpack 17 MB of them, or take them from the PATH."""

_INHERITED: Final = ("PATH", "LANG", "LC_ALL", "SYSTEMROOT")
"""All that the child gets of the environment: no JAVA_TOOL_OPTIONS, no class path, no home directory."""


class Analyzer(Struct, frozen=True, kw_only=True):
    """`timeout`: seconds of wall clock for each question; `memory_mb`: MiB of Java heap of each JVM."""

    java: Path
    jar: Path
    timeout: float
    memory_mb: int


class Job(Struct, frozen=True, kw_only=True):
    """A question. `files`: name to text; `main`: the one with `commands`; `atoms`: size of the model."""

    files: Mapping[str, str]
    main: str
    commands: Sequence[Command]
    atoms: int

    def digest(self) -> str:
        """SHA-256, in hex, of everything that the answer depends on."""
        told = repr((ARGUMENTS, self.main, sorted(self.files.items())))
        return hashlib.sha256(told.encode()).hexdigest()


class Output(Struct, frozen=True, kw_only=True):
    """How the Analyzer ended: `status` as in `subprocess` (negative: the signal).

    `diagnostics`: its stderr, where the verdicts are; `messages`: its stdout.
    """

    status: int
    diagnostics: str
    messages: str


class Jvm:
    """A JVM that answers one question at a time, in whose directory the jars are."""

    def __init__(self, analyzer: Analyzer, directory: Path, *, large: bool) -> None:
        """Start it. Raises EngineMissing if Java cannot be started."""
        self.large = large
        self._timeout = analyzer.timeout
        self._complaints = directory / f"complaints_{secrets.token_hex(4)}"
        java = analyzer.java.absolute()
        command = [str(java), *_java_options(analyzer, directory, large=large)]
        command += ["-cp", os.pathsep.join((JAR, RESIDENT)), "Resident", *ARGUMENTS]
        try:
            with self._complaints.open("wb") as complaints:
                self._process = subprocess.Popen(
                    command,
                    cwd=directory,
                    env={name: os.environ[name] for name in _INHERITED if name in os.environ},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=complaints,
                    start_new_session=True,
                )
        except OSError as error:
            raise EngineMissing(f"Java cannot be started at {java}: {error.strerror or error}.") from error
        self._questions = cast("IO[bytes]", self._process.stdin)
        self._answers = cast("IO[bytes]", self._process.stdout)

    def fileno(self) -> int:
        """Where answers come, and the end."""
        return self._answers.fileno()

    def ask(self, place: Path, main: str, digest: str) -> None:
        """Ask about the files in the directory `place`, below that of the JVM."""
        self._place = place
        self._expected, self._said = f"{secrets.token_hex(16)} {digest} ", ""
        self._deadline = time.monotonic() + self._timeout
        with suppress(BrokenPipeError):  # it has ended, which `answer` tells
            self._questions.write(f"{self._expected}{place.name} {main}\n".encode())
            self._questions.flush()

    def answer(self) -> Output | None:
        """What was answered, None for nothing yet.

        Raises EngineTimeout once its time is over, EngineFailed for anything but one answer to this question.
        """
        while len(self._said) < MAX_ANSWER and select.select([self], [], [], 0)[0]:
            piece = os.read(self.fileno(), MAX_ANSWER)
            if not piece:
                return self._ended()
            self._said += piece.decode("ascii", "replace")
        if self._said.endswith("\n") or len(self._said) >= MAX_ANSWER:
            match = re.fullmatch(re.escape(self._expected) + r"(\d{1,3})\n", self._said, re.ASCII)
            if match is None:
                raise EngineFailed("The Alloy Analyzer gave no valid answer to the question that it was asked.")
            return self._output(int(match[1]))
        if time.monotonic() < self._deadline:
            return None
        raise self._late()

    def _ended(self) -> Output:
        """What it said before its end. Raises EngineTimeout if it only fell silent."""
        try:
            status = self._process.wait(timeout=max(0.0, self._deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            raise self._late() from None
        return self._output(status or 1)

    def _late(self) -> EngineTimeout:
        return EngineTimeout(
            f"The Alloy Analyzer did not finish within {self._timeout:g} seconds and was ended; "
            "--timeout gives it more."
        )

    def _output(self, status: int) -> Output:
        return Output(
            status=status,
            diagnostics=_written(self._place / _DIAGNOSTICS),
            messages=_written(self._place / _MESSAGES) + (_written(self._complaints) if status else ""),
        )

    def close(self, patience: float = 0) -> None:
        """End the process group, unless it ends within `patience` seconds, since nothing is asked any more."""
        with suppress(BrokenPipeError):
            self._questions.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=patience)
        if self._process.poll() is None:
            if os.name == "posix":
                os.killpg(self._process.pid, signal.SIGKILL)  # its children too, where `java` is a script
            else:
                self._process.kill()
            self._process.wait()
        self._answers.close()


def _written(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            return opened.read(MAX_OUTPUT).decode("utf-8", "replace")
    except FileNotFoundError:
        return ""


def _java_options(analyzer: Analyzer, directory: Path, *, large: bool) -> list[str]:
    scratch = directory / SCRATCH
    return [
        *(f"-XX:{use}={directory / name}" for use, name in ARCHIVES.items() if (directory / name).exists()),
        *(LATE_SECOND_COMPILER if large else ["-XX:TieredStopAtLevel=1"]),
        "-XX:+UseSerialGC",
        "-XX:-UsePerfData",
        "-XX:+ExitOnOutOfMemoryError",
        "-XX:+DisplayVMOutputToStderr",
        f"-Xmx{analyzer.memory_mb}m",
        f"-Xss{STACK_MB}m",
        "-Djava.awt.headless=true",
        f"-Djava.io.tmpdir={scratch}",
        f"-Duser.home={scratch}",
        f"-Djava.util.prefs.userRoot={scratch}",
        "--enable-native-access=ALL-UNNAMED",
        *(f"-Dalloy.native.{each}=NO" for each in _UNUSED),
    ]
