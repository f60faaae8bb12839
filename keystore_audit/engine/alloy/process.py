"""Runs of the Alloy Analyzer: a child process each, in a directory, a process group and an environment of its own.

Several stand side by side; each must answer every command that it was given.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Final, TypeVar

from msgspec import Struct

from keystore_audit.engine.alloy.install import checked_copy
from keystore_audit.engine.alloy.solution import Command, failure, verdicts
from keystore_audit.errors import EngineFailed, EngineMissing, EngineTimeout

OUTPUT_DIRECTORY: Final = "solutions"
"""Where the Analyzer puts instances, below the run's directory."""

ARGUMENTS: Final = ("exec", "-f", "-t", "xml", "-d", "0", "-s", "sat4j", "-o")
"""What the Analyzer is told, before where instances go and which file is the main one.

No symmetry breaking and no deeper Skolem functions (-d 0): every atom is named, every witness outermost.
"""

MAX_OUTPUT: Final = 1_000_000
"""Bytes read of what the Analyzer writes to stderr, and to stdout: a line for each command, or a stack trace."""

FIRST_COMPILER_ATOMS: Final = 2_500
"""Atoms up to which the JVM's first compiler alone is faster (0.8 s against 1.3 s for a small keystore)."""

LATE_SECOND_COMPILER: Final = (
    "-XX:Tier4InvocationThreshold=50000",
    "-XX:Tier4MinInvocationThreshold=6000",
    "-XX:Tier4CompileThreshold=150000",
    "-XX:Tier4BackEdgeThreshold=400000",
)
"""Ten times the JVM's own thresholds. Beyond that size its second compiler still takes nearly half of all processor
time (20 of 44 s at 500 enclaves); of what runs ten times as often less is compiled by it (22 to 24 s against 26 to 28).
"""

STACK_MB: Final = 64
"""MiB of stack: the translator recurses along unions."""

PARALLEL: Final = 2
"""Analyzers side by side: one uses little more than one core."""

_POLL: Final = 0.01
"""Seconds between looks at a process."""

Result = TypeVar("Result")

Read = Callable[[int, Mapping[str, bool], Path], Result]
"""Makes a result of a job: its number, which of its commands have an instance, and where the instances are."""

_DIAGNOSTICS: Final = "diagnostics"
_MESSAGES: Final = "messages"
_SCRATCH: Final = "scratch"

_INHERITED: Final = ("PATH", "LANG", "LC_ALL", "SYSTEMROOT")
"""All that the child gets of the environment: no JAVA_TOOL_OPTIONS, no class path, no home directory."""


class Analyzer(Struct, frozen=True, kw_only=True):
    """`timeout`: seconds of wall clock for each process; `memory_mb`: MiB of Java heap of each."""

    java: Path
    jar: Path
    timeout: float
    memory_mb: int


class Job(Struct, frozen=True, kw_only=True):
    """What one process does. `files`: name to text; `main`: the one with `commands`; `atoms`: size of the model."""

    files: Mapping[str, str]
    main: str
    commands: Sequence[Command]
    atoms: int


class Output(Struct, frozen=True, kw_only=True):
    """How a run ended: `status` as in `subprocess` (negative: the signal).

    `diagnostics`: its stderr, where the verdicts are; `messages`: its stdout, where the JVM itself complains.
    """

    status: int
    diagnostics: str
    messages: str


class AnalyzerProcess:
    """The Analyzer at work on a job, in a directory of its own.

    A context manager: entering it starts the process, leaving it ends the process group, whatever happened, and
    removes the directory, in which everything stands that the Analyzer writes (natives that it unpacks,
    preferences, instances).
    """

    def __init__(self, job: Job, analyzer: Analyzer) -> None:
        self._job = job
        self._analyzer = analyzer
        self._java = analyzer.java.absolute()
        self._jar = analyzer.jar.absolute()
        self._cleanup = ExitStack()

    def __enter__(self) -> AnalyzerProcess:
        """Start, with a copy of the jar that nobody else can replace.

        Raises EngineMissing if Java cannot be started or the jar not be read, EngineFailed if the jar is not the
        Analyzer any more or there is no place to write.
        """
        with ExitStack() as stack:
            self.directory = Path(stack.enter_context(_scratch_directory()))
            self._write_files()
            self._process = self._start()
            stack.callback(self._end)
            self._deadline = time.monotonic() + self._analyzer.timeout
            _limit_processor_time(self._process.pid, self._analyzer.timeout)
            self._cleanup = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process group if it still runs, and remove the directory; a second time does nothing."""
        self._cleanup.close()

    def poll(self, seconds: float) -> Output | None:
        """Wait at most `seconds`; return the output if the process has ended.

        Raises EngineTimeout once its time is over.
        """
        try:
            status = self._process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            if time.monotonic() < self._deadline:
                return None
            raise EngineTimeout(
                f"The Alloy Analyzer was still at work after {self._analyzer.timeout:g} seconds and was ended; "
                "--timeout gives it more."
            ) from None
        return Output(status=status, diagnostics=self._written(_DIAGNOSTICS), messages=self._written(_MESSAGES))

    def _written(self, name: str) -> str:
        with (self.directory / name).open("rb") as file:
            return file.read(MAX_OUTPUT).decode("utf-8", "replace")

    def _write_files(self) -> None:
        try:
            (self.directory / _SCRATCH).mkdir()
            self._jar = checked_copy(self._jar, self.directory)
            for name, content in self._job.files.items():
                (self.directory / name).write_text(content, encoding="ascii")
        except OSError as error:
            raise EngineFailed(f"The model cannot be written: {error.strerror or error}.") from error

    def _start(self) -> subprocess.Popen[bytes]:
        command = [str(self._java), *self._java_options(), "-jar", str(self._jar)]
        command += [*ARGUMENTS, OUTPUT_DIRECTORY, self._job.main]
        try:
            with (
                (self.directory / _DIAGNOSTICS).open("wb") as diagnostics,
                (self.directory / _MESSAGES).open("wb") as messages,
            ):
                return subprocess.Popen(
                    command,
                    cwd=self.directory,
                    env={name: os.environ[name] for name in _INHERITED if name in os.environ},
                    stdin=subprocess.DEVNULL,
                    stdout=messages,
                    stderr=diagnostics,
                    start_new_session=True,
                )
        except OSError as error:
            raise EngineMissing(f"Java cannot be started at {self._java}: {error.strerror or error}.") from error

    def _java_options(self) -> list[str]:
        scratch = self.directory / _SCRATCH
        return [
            *(["-XX:TieredStopAtLevel=1"] if self._job.atoms <= FIRST_COMPILER_ATOMS else LATE_SECOND_COMPILER),
            "-XX:+UseSerialGC",
            "-XX:-UsePerfData",
            "-XX:+ExitOnOutOfMemoryError",
            f"-Xmx{self._analyzer.memory_mb}m",
            f"-Xss{STACK_MB}m",
            "-Djava.awt.headless=true",
            f"-Djava.io.tmpdir={scratch}",
            f"-Duser.home={scratch}",
            f"-Djava.util.prefs.userRoot={scratch}",
            "--enable-native-access=ALL-UNNAMED",
        ]

    def _end(self) -> None:
        if self._process.poll() is not None:
            return
        if os.name == "posix":
            os.killpg(self._process.pid, signal.SIGKILL)  # its children too, where `java` is a script
        else:
            self._process.kill()
        self._process.wait()


def _scratch_directory() -> tempfile.TemporaryDirectory[str]:
    try:
        return tempfile.TemporaryDirectory(prefix="keystore-audit-alloy-", ignore_cleanup_errors=True)
    except OSError as error:
        raise EngineFailed(f"There is no place for the model: {error.strerror or error}.") from error


def _limit_processor_time(pid: int, timeout: float) -> None:
    """Bound the child's processor time, in case this process dies and nobody is left to end it (Linux only)."""
    try:
        from resource import RLIMIT_CPU, prlimit
    except ImportError:
        return
    seconds = math.ceil(timeout) * (os.cpu_count() or 1) + 10
    try:
        prlimit(pid, RLIMIT_CPU, (seconds, seconds))
    except (ProcessLookupError, PermissionError):  # ended already
        return


def run(
    jobs: Sequence[Job],
    analyzer: Analyzer,
    read: Read[Result],
    check: Callable[[Output], Output] | None = None,
) -> list[Result]:
    """Return what `read` makes of each job, in their order. `check` sees what the Analyzer wrote first, and may raise.

    Raises an EngineError if one of them was not answered completely; then the others are ended.
    """
    results: dict[int, Result] = {}
    waiting = deque(enumerate(jobs))
    running: dict[int, AnalyzerProcess] = {}
    with ExitStack() as cleanup:
        while waiting or running:
            while waiting and len(running) < PARALLEL:
                number, job = waiting.popleft()
                running[number] = cleanup.enter_context(AnalyzerProcess(job, analyzer))
            for number, process in tuple(running.items()):
                output = process.poll(_POLL)
                if output is not None:
                    found = _verdicts(jobs[number], check(output) if check else output, analyzer)
                    results[number] = read(number, found, process.directory / OUTPUT_DIRECTORY)
                    running.pop(number).close()
    return [results[number] for number in range(len(jobs))]


def _verdicts(job: Job, output: Output, analyzer: Analyzer) -> Mapping[str, bool]:
    if output.status != 0:
        said = output.diagnostics + output.messages
        raise failure(output.status, said, java=analyzer.java, memory_mb=analyzer.memory_mb)
    return verdicts(output.diagnostics, job.commands)
