"""Who answers questions during a run: JVMs of the Analyzer, and what they answered before.

Any failure ends all of them, so none that misbehaved is asked again. A question that was answered completely is not
asked twice.
"""

from __future__ import annotations

import itertools
import os
import select
import shutil
import tempfile
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Final, TypeVar

from keystore_audit.engine.alloy.answers import failure, verdicts
from keystore_audit.engine.alloy.archive import content, is_made_by, store
from keystore_audit.engine.alloy.install import checked_copy, write_resident
from keystore_audit.engine.alloy.kept import kept
from keystore_audit.engine.alloy.process import (
    ARCHIVES,
    FIRST_COMPILER_ATOMS,
    JAR,
    OUTPUT_DIRECTORY,
    RESIDENT,
    SCRATCH,
    Analyzer,
    Job,
    Jvm,
    Output,
)
from keystore_audit.errors import EngineFailed

PARALLEL: Final = 2
"""JVMs side by side, each using little more than one core, where models are larger than that."""

PARALLEL_ATOMS: Final = 400
"""Atoms beyond which a second JVM saves time. With 225, two take 4.4 s and one 3.9 s. With 435 they take 5.8 and 6.2 s
(10.4 and 7.6 s of processor time)."""

REMEMBERED: Final = 64
"""Questions whose answers are kept, in files, for who asks the same."""

_POLL: Final = 0.1
"""Seconds between looks at the clock."""

Result = TypeVar("Result")

Read = Callable[[int, Mapping[str, bool], Path], Result]
"""Makes a result of a job: its number, which of its commands have an instance, and where the instances are."""

Check = Callable[[Output], Output]
"""Sees what the Analyzer wrote first, and may raise."""


class Solvers:
    """The JVMs of a run, and what they answered, in a directory that goes with them."""

    def __init__(self, analyzer: Analyzer, directory: Path) -> None:
        self._analyzer = analyzer
        self.directory = directory
        self._idle: list[Jvm] = []
        self._busy: dict[Jvm, tuple[str, Path]] = {}
        self._asked = itertools.count()
        self._answered: OrderedDict[str, tuple[Path, Output]] = OrderedDict()

    def run(self, jobs: Sequence[Job], read: Read[Result], check: Check | None) -> list[Result]:
        """As the function of this name."""
        numbers: dict[str, list[int]] = {}
        for number, job in enumerate(jobs):
            numbers.setdefault(job.digest(), []).append(number)
        results: dict[int, Result] = {}

        def take(digest: str, place: Path, output: Output) -> None:
            for number in numbers[digest]:
                found = _verdicts(jobs[number], check(output) if check else output, self._analyzer)
                results[number] = read(number, found, place / OUTPUT_DIRECTORY)

        waiting = deque(numbers)
        most = PARALLEL if any(job.atoms > PARALLEL_ATOMS for job in jobs) else 1
        try:
            while waiting or self._busy:
                while waiting and len(self._busy) < most:
                    digest = waiting.popleft()
                    if digest in self._answered:
                        self._answered.move_to_end(digest)
                        take(digest, *self._answered[digest])
                    else:
                        self._ask(jobs[numbers[digest][0]], digest)
                for digest, place, output in self._answers():
                    take(digest, place, output)
                    self._remember(digest, place, output)
        except BaseException:
            self.close()  # whatever is amiss, none of them is asked again
            raise
        return [results[number] for number in range(len(jobs))]

    def _ask(self, job: Job, digest: str) -> None:
        place = self.directory / f"question_{next(self._asked)}"
        try:
            place.mkdir()
            for name, content in job.files.items():
                (place / name).write_text(content, encoding="ascii")
        except OSError as error:
            raise EngineFailed(f"The model cannot be written: {error.strerror or error}.") from error
        large = job.atoms > FIRST_COMPILER_ATOMS
        jvm = next((each for each in self._idle if each.large is large), None)
        if jvm is None:
            jvm = Jvm(self._analyzer, self.directory, large=large)
        else:
            self._idle.remove(jvm)
        self._busy[jvm] = digest, place
        jvm.ask(place, job.main, digest)

    def _answers(self) -> Iterator[tuple[str, Path, Output]]:
        if self._busy:
            select.select(list(self._busy), [], [], _POLL)
        for jvm, (digest, place) in tuple(self._busy.items()):
            output = jvm.answer()
            if output is not None:
                del self._busy[jvm]
                self._idle.append(jvm)
                yield digest, place, output

    def _remember(self, digest: str, place: Path, output: Output) -> None:
        self._answered[digest] = place, output
        if len(self._answered) > REMEMBERED:
            _digest, (oldest, _output) = self._answered.popitem(last=False)
            shutil.rmtree(oldest, ignore_errors=True)

    def close(self, patience: float = 0) -> None:
        """End every JVM, as `Jvm.close`; a question after that starts one."""
        for jvm in (*self._idle, *self._busy):
            jvm.close(patience)
        self._idle, self._busy = [], {}


@contextmanager
def solvers(analyzer: Analyzer) -> Iterator[Solvers]:
    """Who answers questions, with a copy of the jar that nobody else can replace.

    When left, all has ended and nothing is on disk, where everything stands that the Analyzer writes (natives that it
    unpacks, preferences, instances). Raises EngineMissing if the jar cannot be read, EngineFailed if it is not the
    Analyzer or there is no place to write.
    """
    with ExitStack() as stack:
        try:
            directory = Path(
                stack.enter_context(
                    tempfile.TemporaryDirectory(prefix="keystore-audit-alloy-", ignore_cleanup_errors=True)
                )
            )
            (directory / SCRATCH).mkdir()
            checked_copy(analyzer.jar.absolute(), directory / JAR)
            write_resident(directory / RESIDENT)
            for jar in (JAR, RESIDENT):
                os.utime(directory / jar, (0, 0))  # an archive is of jars of one date
            classes = content(analyzer.java)
            if classes is not None:
                (directory / ARCHIVES["AOTCache"]).write_bytes(classes)
        except OSError as error:
            raise EngineFailed(f"There is no place for the model: {error.strerror or error}.") from error
        yield stack.enter_context(closing(Solvers(analyzer, directory)))


def record_classes(job: Job, analyzer: Analyzer) -> Path | None:
    """Make an archive of classes by a JVM that answers this and ends; None where this Java makes none.

    Raises an EngineError if it does not answer, or the archive cannot be stored.
    """
    if not is_made_by(analyzer.java):
        return None
    with solvers(analyzer) as own:
        (own.directory / ARCHIVES["AOTCache"]).unlink(missing_ok=True)
        recorded = own.directory / ARCHIVES["AOTCacheOutput"]
        recorded.touch()
        own.run([job], lambda *_: None, None)
        own.close(analyzer.timeout)
        try:
            return store(recorded, analyzer.java) if recorded.stat().st_size else None
        except OSError as error:
            raise EngineFailed(f"The Analyzer's classes cannot be kept: {error.strerror or error}.") from error


def run(jobs: Sequence[Job], analyzer: Analyzer, read: Read[Result], check: Check | None = None) -> list[Result]:
    """Return what `read` makes of each job, in their order; whoever answers is kept for the run (`kept`).

    `check`, for questions with words of users, sees first what the Analyzer wrote, and may raise; who answers those is
    asked nothing of ours. Raises an EngineError if one of them was not answered completely; then all that is being
    asked is ended.
    """
    if not jobs:
        return []
    with kept() as found:
        return found.get((analyzer, check is None), lambda: solvers(analyzer)).run(jobs, read, check)


def _verdicts(job: Job, output: Output, analyzer: Analyzer) -> Mapping[str, bool]:
    if output.status != 0:
        said = output.diagnostics + output.messages
        raise failure(output.status, said, java=analyzer.java, memory_mb=analyzer.memory_mb)
    return verdicts(output.diagnostics, job.commands)
