"""A run over many keystores: first whose identities they share, then each on its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing

from msgspec.structs import replace

from keystore_audit.errors import EXIT_USAGE, UsageError
from keystore_audit.fleet.pools import Lost, Pool, carried_out
from keystore_audit.fleet.shared import Identities
from keystore_audit.fleet.task import Audited, Task, carry_out, identify, lost

Step = Callable[[str, int], None]
"""Told of each step: its name, and how many keystores it is done with."""


def audited(
    tasks: Sequence[Task], pool: Pool | None, step: Step, identities: Identities | None
) -> Generator[tuple[int, Audited], None, None]:
    """Yield the number of each keystore and what became of it, as they come, each exactly once.

    `identities`: filled with those of the keystores before the audits begin; None: a single keystore needs none.
    Raises errors.UsageError for options that make no sense, whatever the keystore. Closing the generator ends what is
    under way.
    """
    without: dict[int, Audited] = {}
    if identities is not None:
        with closing(carried_out(pool, identify, tasks)) as known:
            for done, (number, found) in enumerate(known, start=1):
                if isinstance(found, Lost):  # it might share some
                    without[number] = _ended(tasks[number], found)
                else:
                    identities.add(number, *found)
                step("reading identities", done)
    yield from without.items()
    numbers = [number for number in range(len(tasks)) if number not in without]
    if identities is None or len(tasks) == 1:
        asked: Iterable[Task] = tasks
    else:
        asked = (replace(tasks[number], beside=identities.beside(number)) for number in numbers)
    with closing(carried_out(pool, carry_out, asked)) as results:
        for done, (place, result) in enumerate(results, start=len(without) + 1):
            number = numbers[place]
            outcome = _ended(tasks[number], result) if isinstance(result, Lost) else result
            if outcome.row.exit_code == EXIT_USAGE:
                raise UsageError(outcome.row.error)
            step("auditing", done)
            yield number, outcome


def _ended(task: Task, ended: Lost) -> Audited:
    return lost(task, f"{task.root}: nothing is decided. {ended.reason}")
