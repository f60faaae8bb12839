"""Runs of the Alloy Analyzer: a child process each, in a directory, a process group and an environment of its own.

Several stand side by side; each must answer every command that it was given.
"""

from __future__ import annotations

import math
import os
import re
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

from lxml import etree
from msgspec import Struct

from keystore_audit.engine.alloy.atoms import index_of
from keystore_audit.engine.alloy.install import checked_copy
from keystore_audit.errors import EngineFailed, EngineMissing, EngineTimeout
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Role, Witness
from keystore_audit.text import shorten

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


MAX_INSTANCE: Final = 64 * 1024 * 1024
"""Bytes of one instance: 10,000 atoms take some 2 MB."""

_VERDICT: Final = re.compile(r"(\d+)\. (check|run)\s+(\S+)\s.*\b(UNSAT|SAT)", re.ASCII)
_OUTSIDER: Final = re.compile(r"(?:\w+/)*Outsider\$0", re.ASCII)
_ERROR: Final = re.compile(r"(\w+ error) in (?:.*[/\\])?([^/\\]+?) at line (\d+) column (\d+):\s*([^\n]*)")
_TOO_OLD: Final = ("UnsupportedClassVersionError", "Unrecognized option", "Unrecognized VM option")


class Command(Struct, frozen=True, kw_only=True):
    """A command of the main file: `kind` is check or run."""

    kind: str
    name: str


def verdicts(diagnostics: str, commands: Sequence[Command]) -> dict[str, bool]:
    """Return for each command, by name, whether it has an instance.

    Raises EngineFailed unless there is exactly one verdict for each, in order, and no line besides.
    """
    lines = [line for line in diagnostics.replace("\b", "").splitlines() if line.strip()]
    found: dict[str, bool] = {}
    for line, (number, command) in zip(lines, enumerate(commands), strict=False):
        match = _VERDICT.fullmatch(line.strip())
        if match is None or (int(match[1]), match[2], match[3]) != (number, command.kind, command.name):
            raise EngineFailed(
                f"The Alloy Analyzer gave no verdict on {command.name}, but: {shorten(line.strip(), 200)}"
            )
        found[command.name] = match[4] == "SAT"
    if len(lines) != len(commands):
        raise EngineFailed(
            f"The Alloy Analyzer answered {len(lines)} of {len(commands)} commands, which is no answer at all."
        )
    return found


def witness(directory: Path, command: str, roles: Sequence[Role], system: System) -> Witness:
    """Return the atoms that make the check `command` fail, from the instance that the Analyzer left in `directory`.

    Raises EngineFailed if the instance is not there, is no XML, or does not name one atom of the system for each of
    `roles`.
    """
    variables = skolems(directory, command)
    found: dict[Role, int] = {}
    for asked in roles:
        values, role = variables.get(asked.value, []), asked
        answer = values[0][0] if len(values) == 1 and len(values[0]) == 1 else ""
        if asked in (Role.PUBLISHER, Role.INSIDER):
            if _OUTSIDER.fullmatch(answer):
                continue
            role = Role.ENCLAVE if index_of(answer, Role.CERTIFICATE, system) is None else Role.CERTIFICATE
        index = index_of(answer, role, system)
        if index is None:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {command} names no {asked.value}.")
        found[role] = index
    return found


def skolems(directory: Path, command: str) -> dict[str, list[list[str]]]:
    """The tuples of atoms that each outermost variable of `command` stands for in the instance that was left of it."""
    prefix, path = f"${command}_", directory / f"{command}-solution-0.xml"
    instance = _read(path, command).find("./instance")
    if instance is None:
        raise EngineFailed(f"The Alloy Analyzer's instance of {command} is not there.")
    return {
        skolem.get("label", "").removeprefix(prefix): [
            [atom.get("label", "") for atom in each.findall("./atom")] for each in skolem.findall("./tuple")
        ]
        for skolem in instance.iterfind("./skolem")
        if skolem.get("label", "").startswith(prefix)
    }


def _read(path: Path, assertion: str) -> etree._Element:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        if path.stat().st_size > MAX_INSTANCE:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {assertion} is too large to read.")
        return etree.fromstring(path.read_bytes(), parser)
    except (OSError, etree.XMLSyntaxError) as error:
        raise EngineFailed(f"The Alloy Analyzer's counterexample to {assertion} cannot be read: {error}.") from error


def failure(status: int, diagnostics: str, *, java: Path, memory_mb: int) -> EngineFailed:
    """Return the error that says, in a sentence, why a run ended with `status` other than 0."""
    if status < 0:
        return EngineFailed(f"The Alloy Analyzer was killed by signal {-status}.")
    if "OutOfMemoryError" in diagnostics:
        return EngineFailed(f"The Alloy Analyzer ran out of its {memory_mb} MiB of memory.")
    if "StackOverflowError" in diagnostics:
        return EngineFailed("The Alloy Analyzer ran out of stack.")
    if any(sign in diagnostics for sign in _TOO_OLD):
        return EngineFailed(f"The Java at {java} cannot run the Alloy Analyzer: it needs Java 17 or newer.")
    if match := _ERROR.search(diagnostics):
        kind, file, line, column, message = match.groups()
        text = f"The Alloy Analyzer refuses the model: {kind} in {file}, line {line}, column {column}."
        return EngineFailed(f"{text} {shorten(message.strip(), 200)}".rstrip())
    last = next((line.strip() for line in diagnostics.splitlines() if line.strip()), "it said nothing")
    return EngineFailed(f"The Alloy Analyzer failed with status {status}: {shorten(last, 200)}")
