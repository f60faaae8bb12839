"""Several keystores in one run of `keystore-audit audit`: which, how many at a time, and what is kept of each."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit import __version__
from keystore_audit.cli import output, places
from keystore_audit.cli.progress import FleetWatch, interrupts_later
from keystore_audit.engine.alloy.kept import kept
from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_INTERRUPTED, EXIT_NOTHING_TO_AUDIT, AuditError, NothingToAudit
from keystore_audit.report.summary import Row, Summary, render_json, render_text
from keystore_audit.text import some

if TYPE_CHECKING:
    from keystore_audit.fleet.pools import Pool
    from keystore_audit.fleet.run import Found, Identities
    from keystore_audit.fleet.tables import Datasets
    from keystore_audit.fleet.task import Audited, Task
    from keystore_audit.options import Options
    from keystore_audit.report.content import NoReport, Report

WORST_FIRST: Final = (EXIT_INCOMPLETE, EXIT_NOTHING_TO_AUDIT, 1, 0)
"""How exit codes of several keystores combine: the first of these that occurs."""

MAX_IN_TURN: Final = 7
"""So many keystores are audited in this process: others take longer to start."""

MAX_NAMED: Final = 3
"""Older reports that are named; the others are counted."""


def run(named: Sequence[str], given: Mapping[str, Any], chosen: Callable[[Sequence[str]], Options]) -> int:
    """Audit the keystores that are `named`, or (`--recursive`) below the directories named; return the exit code.

    `chosen`: what the options mean for these keystores.
    """
    found = places.found(named, recursive=given["recursive"])
    for path, reason in found.unseen:
        output.say(f"{path}: not looked into: {reason}.")
    if not found.keystores:
        sentence = f"There is no keystore below {', '.join(named)}"
        if any(path not in named for path, _reason in found.unseen):
            raise AuditError(f"{sentence} where it could be looked.")
        raise NothingToAudit(f"{sentence}.")
    if any(wanted.tables for wanted in given["targets"]):
        from keystore_audit.fleet.tables import check_available

        check_available()
    output.check(given["targets"], found.keystores)
    if given["executor"] is not None:
        found, options = places.everywhere(found, chosen(found.keystores))
    else:
        options = chosen(found.keystores)
    reports = places.reports(found.keystores, named, given)
    places.check_outside(found.keystores, reports, given["targets"])
    several = len(named) > 1 or given["recursive"]
    return _Run(found, given, options, reports, several).carried_out()


class _Run:
    """A run as it goes on. `texts`: what standard output still waits for, since its order is that of the keystores."""

    def __init__(
        self, found: Found, given: Mapping[str, Any], options: Options, reports: Mapping[str, str], several: bool
    ) -> None:
        targets = given["targets"]
        self._found, self._given, self._options, self._reports = found, given, options, reports
        self._several = several
        self._each = [wanted for wanted in targets if wanted.each]
        self._tables = [wanted for wanted in targets if wanted.tables]
        self._together = [wanted for wanted in targets if not (wanted.each or wanted.tables)]
        self._summaries = [places.summary_file(wanted) for wanted in self._each if wanted.format == "json"]
        # Standard output has a summary instead of every report, which would say it twice.
        self._summarised = several and bool(self._each or self._tables)
        self._in_text = given["kind"] == "text"
        self._texts_wanted = self._in_text and not self._summarised
        self._shown_as = output.view(given, stdout=True)
        self._rows: dict[int, Row] = {}
        self._whole: dict[int, Report] = {}
        self._texts: dict[int, str] = {}
        self._shown = 0
        self._datasets: list[Datasets] = []
        self._identities: Identities | None = None

    def carried_out(self) -> int:
        """Audit all of them, and deliver what there is, also after an interrupt."""
        interrupted = False
        began = time.perf_counter()
        quiet = self._given["quiet"] or (self._texts_wanted and output.is_terminal())
        with ExitStack() as stack:
            stack.enter_context(kept())
            pool = self._pool(stack)
            try:
                for wanted in self._summaries:  # however this run ends, an earlier one's does not speak of it
                    output.remove(wanted)
                visible = not quiet and sys.stderr.isatty()
                self._audit(pool, stack.enter_context(FleetWatch(len(self._found.keystores), visible=visible)))
            except KeyboardInterrupt:
                interrupted = True
            except output.Unwritable:
                output.say_not_written(self._together)
                raise
        if self._given["verbose"] or sys.stderr.isatty():
            seconds, done = time.perf_counter() - began, len(self._rows)
            rate = done / max(seconds, 1e-6)
            click.echo(f"{done:,} keystores in {seconds:.1f} s, {rate:.1f} a second.", err=True)
        return self._finish(interrupted=interrupted)

    def _audit(self, pool: Pool | None, watch: FleetWatch) -> None:
        from keystore_audit.fleet.run import Identities, audited

        if self._tables or len(self._found.keystores) > 1:
            self._identities = Identities()
        try:
            with ExitStack() as stack:
                if self._tables:
                    from keystore_audit.fleet.tables import Datasets

                    self._datasets = [stack.enter_context(Datasets(wanted.path)) for wanted in self._tables]
                results = audited(self._tasks(), pool, watch.step, self._identities)
                for number, outcome in stack.enter_context(closing(results)):
                    with interrupts_later():  # what the summary says of a keystore is there
                        self._take(number, outcome)
        except OSError as error:
            raise output.Unwritable(f"Cannot write a report: {error.strerror or error}.") from error

    def _tasks(self) -> list[Task]:
        from keystore_audit.fleet.task import Task

        return [
            Task(
                root=path,
                options=self._options,
                kinds=tuple(wanted.format for wanted in self._each),
                kept=output.view(self._given, stdout=False),
                shown=self._shown_as if self._texts_wanted else None,
                whole=bool(self._together) or not self._in_text,  # all are needed together, in one document
                tables=bool(self._tables),
                verbose=self._given["verbose"],
            )
            for path in self._found.keystores
        ]

    def _pool(self, stack: ExitStack) -> Pool | None:
        """Return who audits beside this process, if anybody; what has to be closed afterwards is left to the stack."""
        from keystore_audit.fleet.pools import Cluster, Processes, processors

        if self._given["executor"] is not None:
            return stack.enter_context(closing(Cluster(self._given["executor"])))
        jobs: int | None = self._given["jobs"]
        if jobs is None:
            jobs = processors() if len(self._found.keystores) > MAX_IN_TURN else 1
        return stack.enter_context(closing(Processes(jobs))) if jobs > 1 else None

    def _take(self, number: int, audited: Audited) -> None:
        """Keep what is to be kept of a keystore, and write its own files."""
        row = self._rows[number] = audited.row
        own = [places.own_file(wanted, self._reports[row.path]) for wanted in self._each]
        if row.verdict is None:
            hint = places.command_meant(row.path) if row.exit_code == EXIT_NOTHING_TO_AUDIT else ""
            output.say(f"{row.error}{hint}")
            for file in own:  # that of an earlier run would look like one of this
                output.remove(file)
        for file, text in zip(own, audited.files, strict=False):  # none without a report
            output.write(file, text)
        if audited.report is not None:
            self._whole[number] = audited.report
        self._texts[number] = audited.shown
        for datasets in self._datasets:
            from keystore_audit.fleet.tables import rows_of_identities

            datasets.add(audited.tables or {})
            found = self._identities.of(number) if self._identities is not None else ()
            datasets.add(rows_of_identities(row.path, self._options.at, found))
        while self._shown in self._texts:
            self._show(self._texts.pop(self._shown))
            self._shown += 1

    def _show(self, text: str) -> None:
        if text:
            output.write_stdout(text + "\n" if self._several else text)

    def _finish(self, *, interrupted: bool) -> int:
        """Write what speaks of all of them, and return the exit code."""
        for number in sorted(self._texts):  # after an interrupt: those behind one that was not done
            self._show(self._texts[number])
        summary = self._summary(interrupted=interrupted)
        for wanted in self._summaries:
            output.write(wanted, render_json(summary, places.FILE_NAMES["json"]))
        for wanted in self._each if self._several else ():
            self._say_older(wanted)
        missing = self._missing()
        if self._in_text and self._several:
            self._show_summary(summary, missing)
        if interrupted:
            output.say_not_written(self._together)
            output.say("Interrupted.")
        else:
            reports = [self._whole[number] for number in sorted(self._whole)]
            output.deliver(reports, self._given, several=self._several, stdout=not self._in_text, missing=missing)
        return summary.exit_code

    def _say_older(self, wanted: output.Target) -> None:
        """Say which reports there are of an earlier run: somebody might take them for those of this one."""
        written = {places.own_file(wanted, self._reports[row.path]).path for row in self._rows.values()}
        older = [str(path) for path in places.older_files(wanted, written)]
        if older:
            one = len(older) == 1
            said = (
                "1 report is not of this run, and stays"
                if one
                else f"{len(older)} reports are not of this run, and stay"
            )
            output.say(f"{said}: {some(older, MAX_NAMED)}.")

    def _show_summary(self, summary: Summary, missing: Sequence[NoReport]) -> None:
        view = self._shown_as
        if self._summarised:
            output.write_stdout(render_text(summary, view))
            return
        from keystore_audit.report.text import render_total

        verdicts = [each.verdict for each in summary.rows if each.verdict is not None]
        if verdicts:
            output.write_stdout(render_total(verdicts, missing, width=view.width, color=view.color))

    def _missing(self) -> list[NoReport]:
        """What an audit was to be of and there is no report of, in order."""
        from keystore_audit.report.content import NoReport

        unseen = [(path, f"not looked into: {reason}.", EXIT_INCOMPLETE) for path, reason in self._found.unseen]
        rows = [self._rows[number] for number in sorted(self._rows)]
        without = [(row.path, row.error, row.exit_code) for row in rows if row.verdict is None]
        return [NoReport(path=path, reason=reason, exit_code=code) for path, reason, code in (*unseen, *without)]

    def _summary(self, *, interrupted: bool) -> Summary:
        codes = [row.exit_code for row in self._rows.values()] + [EXIT_INCOMPLETE] * bool(self._found.unseen)
        worst = min(codes, key=WORST_FIRST.index, default=EXIT_INCOMPLETE)
        return Summary(
            version=__version__,
            at=self._options.at,
            exit_code=EXIT_INTERRUPTED if interrupted else worst,
            rows=tuple(self._rows[number] for number in sorted(self._rows)),
            not_audited=tuple(path for number, path in enumerate(self._found.keystores) if number not in self._rows),
            unseen=self._found.unseen,
            reports=self._reports,
            interrupted=interrupted,
        )
