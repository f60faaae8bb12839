"""A run over many keystores: first whose identities they share, then each on its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_USAGE, UsageError
from keystore_audit.fleet.executor import Executor, Lost
from keystore_audit.fleet.shared import Identities
from keystore_audit.fleet.task import Audited, Task, carry_out, identify
from keystore_audit.keystore.identity import Beside

Step = Callable[[str, int], None]
"""Told of each step: its name, and how many keystores it is done with."""

COMPARING = "reading identities"
AUDITING = "auditing"


class Fleet(Struct):
    """The keystores of a run. `tasks` have no `beside` yet; `identities` are there once the audits have begun.

    `compared`: identities are read, which a single keystore needs only for tables.
    """

    tasks: Sequence[Task]
    executor: Executor
    step: Step = lambda _name, _done: None
    compared: bool = True
    identities: Identities = field(default_factory=Identities)

    def audit(self) -> Generator[tuple[int, Audited], None, None]:
        """Yield the number of each keystore and what became of it, as they come, each exactly once.

        Raises errors.UsageError for options that make no sense, whatever the keystore. Closing the generator ends what
        is under way.
        """
        lost = self._compare() if self.compared else {}
        yield from lost.items()
        numbers = [number for number in range(len(self.tasks)) if number not in lost]
        with closing(self.executor.run(carry_out, (self._task(number) for number in numbers))) as results:
            for done, (place, result) in enumerate(results, start=len(lost) + 1):
                number = numbers[place]
                audited = self._lost(number, result.reason) if isinstance(result, Lost) else result
                if audited.exit_code == EXIT_USAGE:
                    raise UsageError(audited.error)
                self.step(AUDITING, done)
                yield number, audited

    def _compare(self) -> dict[int, Audited]:
        """Read all identities; the keystores of which that could not be told are lost: they might share some."""
        lost = {}
        for done, (number, known) in enumerate(self.executor.run(identify, self.tasks), start=1):
            if isinstance(known, Lost):
                lost[number] = self._lost(number, known.reason)
            elif known.error:
                lost[number] = Audited(exit_code=EXIT_INCOMPLETE, error=known.error)
            else:
                self.identities.add(number, known.place, known.compared, known.named)
            self.step(COMPARING, done)
        return lost

    def _task(self, number: int) -> Task:
        if len(self.tasks) == 1:
            return self.tasks[number]
        return replace(
            self.tasks[number],
            beside=Beside(
                shared=self.identities.shared_with(number),
                compared=self.identities.compared(number),
                apart=self.identities.within(number),
            ),
        )

    def _lost(self, number: int, reason: str) -> Audited:
        return Audited(exit_code=EXIT_INCOMPLETE, error=f"{self.tasks[number].root}: nothing is decided. {reason}")
