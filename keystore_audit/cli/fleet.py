"""Several keystores in one run of `keystore-audit audit`: which, how many at a time, and what is kept of each."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec import Struct, field

from keystore_audit import __version__, formats
from keystore_audit.cli import EXIT_INTERRUPTED, delivery, output, places
from keystore_audit.cli.interrupts import interrupts_later
from keystore_audit.cli.program import fault
from keystore_audit.cli.progress import FleetWatch
from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_NOTHING_TO_AUDIT, AuditError, NothingToAudit
from keystore_audit.report.summary import Row, Summary, render_json, render_text, row, without_report
from keystore_audit.text import some

if TYPE_CHECKING:
    from keystore_audit.fleet.parquet import Datasets
    from keystore_audit.fleet.pools import Pool
    from keystore_audit.fleet.search import Found
    from keystore_audit.fleet.shared import Identities
    from keystore_audit.fleet.tables import Rows
    from keystore_audit.fleet.task import Audited
    from keystore_audit.options import Options
    from keystore_audit.report.content import NoReport, Report
    from keystore_audit.report.text import View

WORST_FIRST: Final = (EXIT_INCOMPLETE, EXIT_NOTHING_TO_AUDIT, 1, 0)
"""How exit codes of several keystores combine: the first of these that occurs."""

MAX_IN_TURN: Final = 7
"""So many keystores are audited in this process: others take longer to start."""

ENGINE_WITHOUT_JAVA: Final = "native"

MAX_NAMED: Final = 3
"""Older reports that are named; the others are counted."""


class Make(Struct, frozen=True, kw_only=True):
    """What is made of a report where it is made; goes to other processes.

    `formats`: of the reports that have a file of their own, shown as `kept`; `shown`: the text on standard output is
    wanted; `whole`: the report itself is; `tables`: rows are.
    """

    path: str
    formats: tuple[str, ...]
    kept: View
    shown: View | None
    whole: bool
    tables: bool

    def __call__(self, report: Report) -> Made:
        """Render."""
        from keystore_audit.fleet.tables import rows_of
        from keystore_audit.report import text

        return Made(
            row=row(self.path, report),
            files=tuple(formats.render(kind, [report], self.kept, several=False) for kind in self.formats),
            shown=text.render(report, self.shown) if self.shown is not None else "",
            report=report if self.whole else None,
            rows=rows_of(self.path, report) if self.tables else None,
        )


class Made(Struct, frozen=True, kw_only=True):
    """What `Make` makes."""

    row: Row
    files: tuple[str, ...]
    shown: str
    report: Report | None
    rows: Rows | None


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
        from keystore_audit.fleet.parquet import check_available

        check_available()
    output.check(given["targets"], found.keystores)
    if given["executor"] is not None:
        found, options = places.everywhere(found, chosen(found.keystores))
    else:
        options = chosen(found.keystores)
    reports = places.reports(found.keystores, named, given)
    places.check_outside(found.keystores, reports, given["targets"])
    several = len(named) > 1 or given["recursive"]
    return _Run(found=found, given=given, options=options, reports=reports, several=several).carried_out()


class _Run(Struct):
    """A run as it goes on. `texts`: what standard output still waits for, since its order is that of the keystores."""

    found: Found
    given: Mapping[str, Any]
    options: Options
    reports: Mapping[str, str]
    several: bool
    rows: dict[int, Row] = field(default_factory=dict)
    whole: dict[int, Report] = field(default_factory=dict)
    texts: dict[int, str] = field(default_factory=dict)
    shown: int = 0
    datasets: list[Datasets] = field(default_factory=list)
    identities: Identities | None = None

    def carried_out(self) -> int:
        """Audit all of them, and deliver what there is, also after an interrupt."""
        interrupted = False
        began = time.perf_counter()
        quiet = self.given["quiet"] or (self._texts_wanted and delivery.is_terminal())
        with ExitStack() as stack:
            pool = self._pool(stack)
            try:
                for wanted in self._summaries:  # however this run ends, an earlier one's does not speak of it
                    output.remove(wanted)
                watch = stack.enter_context(
                    FleetWatch(len(self.found.keystores), visible=not quiet and sys.stderr.isatty())
                )
                self._audit(pool, watch)
            except KeyboardInterrupt:
                interrupted = True
            except output.Unwritable:
                delivery.say_not_written(self._together)
                raise
        if self.given["verbose"] or sys.stderr.isatty():
            self._say_rate(time.perf_counter() - began)
        return self._finish(interrupted=interrupted)

    def _audit(self, pool: Pool | None, watch: FleetWatch) -> None:
        from keystore_audit.fleet.run import audited
        from keystore_audit.fleet.shared import Identities

        tables = [wanted for wanted in self.given["targets"] if wanted.tables]
        self.identities = Identities() if tables or len(self.found.keystores) > 1 else None
        try:
            with ExitStack() as stack:
                if tables:
                    from keystore_audit.fleet.parquet import Datasets

                    self.datasets = [stack.enter_context(Datasets(wanted.path)) for wanted in tables]
                tasks = self._tasks()
                results = stack.enter_context(closing(audited(tasks, pool, watch.step, self.identities)))
                for number, outcome in results:
                    with interrupts_later():  # what the summary says of a keystore is there
                        self._take(number, outcome)
        except OSError as error:
            raise output.Unwritable(f"Cannot write a report: {error.strerror or error}.") from error

    @property
    def _each(self) -> list[output.Target]:
        return [wanted for wanted in self.given["targets"] if wanted.each]

    @property
    def _summaries(self) -> list[output.Target]:
        return [places.summary_file(wanted) for wanted in self._each if wanted.format == "json"]

    @property
    def _together(self) -> list[output.Target]:
        return [wanted for wanted in self.given["targets"] if not (wanted.each or wanted.tables)]

    @property
    def _summarised(self) -> bool:
        """Whether standard output has a summary instead of every report, which would say it twice."""
        return self.several and any(wanted.each or wanted.tables for wanted in self.given["targets"])

    @property
    def _collected(self) -> bool:
        """Whether all reports are needed together, in one document."""
        return bool(self._together) or self.given["kind"] != "text"

    @property
    def _texts_wanted(self) -> bool:
        """Whether standard output has every report in full."""
        return self.given["kind"] == "text" and not self._summarised

    def _tasks(self) -> list[Any]:
        from keystore_audit.fleet.task import Task

        explain = partial(fault, verbose=self.given["verbose"])
        kept, shown = delivery.view(self.given, stdout=False), delivery.view(self.given, stdout=True)
        kinds = tuple(wanted.format for wanted in self._each)
        return [
            Task(
                root=path,
                options=self.options,
                explain=explain,
                make=Make(
                    path=path,
                    formats=kinds,
                    kept=kept,
                    shown=shown if self._texts_wanted else None,
                    whole=self._collected,
                    tables=any(wanted.tables for wanted in self.given["targets"]),
                ),
            )
            for path in self.found.keystores
        ]

    def _pool(self, stack: ExitStack) -> Pool | None:
        """Return who audits beside this process, if anybody; what has to be closed afterwards is left to the stack."""
        from keystore_audit.fleet.pools import Cluster, Processes, processors

        address: str | None = self.given["executor"]
        if address is not None:
            return stack.enter_context(closing(Cluster(address)))
        jobs: int | None = self.given["jobs"]
        if jobs is None:
            # Two Analyzers run side by side for one keystore.
            cores = processors() if self.options.engine == ENGINE_WITHOUT_JAVA else processors() // 2
            jobs = max(1, cores) if len(self.found.keystores) > MAX_IN_TURN else 1
        return stack.enter_context(closing(Processes(jobs))) if jobs > 1 else None

    def _take(self, number: int, audited: Audited) -> None:
        """Keep what is to be kept of a keystore, and write its own files."""
        path = self.found.keystores[number]
        if audited.made is None:
            hint = places.command_meant(path) if audited.exit_code == EXIT_NOTHING_TO_AUDIT else ""
            output.say(f"{audited.error}{hint}")
            for wanted in self._each:  # that of an earlier run would look like one of this
                output.remove(places.own_file(wanted, self.reports[path]))
            self.rows[number] = without_report(path, audited.exit_code, audited.error)
            self.texts[number] = ""
        else:
            made: Made = audited.made
            self.rows[number], self.texts[number] = made.row, made.shown
            if made.report is not None:
                self.whole[number] = made.report
            for wanted, text in zip(self._each, made.files, strict=True):
                output.write(places.own_file(wanted, self.reports[path]), text)
        for datasets in self.datasets:
            self._tabulate(datasets, number, audited)
        while self.shown in self.texts:
            self._show(self.texts.pop(self.shown))
            self.shown += 1

    def _tabulate(self, datasets: Datasets, number: int, audited: Audited) -> None:
        from keystore_audit.fleet.tables import rows_of_identities, rows_without_report

        path, at = self.found.keystores[number], self.options.at
        rows: Rows | None = None if audited.made is None else audited.made.rows
        datasets.add(rows or rows_without_report(path, at, audited.exit_code, audited.error))
        if self.identities is not None:
            datasets.add(rows_of_identities(path, at, self.identities.of(number)))

    def _show(self, text: str) -> None:
        if self._texts_wanted and text:
            output.write_stdout(text + "\n" if self.several else text)

    def _say_rate(self, seconds: float) -> None:
        done = len(self.rows)
        click.echo(f"{done:,} keystores in {seconds:.1f} s, {done / max(seconds, 1e-6):.1f} a second.", err=True)

    def _finish(self, *, interrupted: bool) -> int:
        """Write what speaks of all of them, and return the exit code."""
        for number in sorted(self.texts):  # after an interrupt: those behind one that was not done
            self._show(self.texts[number])
        summary = self._summary(interrupted=interrupted)
        for wanted in self._summaries:
            output.write(wanted, render_json(summary, places.FILE_NAMES["json"]))
        for wanted in self._each if self.several else ():
            self._say_older(wanted)
        if self.given["kind"] == "text":
            self._show_summary(summary)
        reports = [self.whole[number] for number in sorted(self.whole)]
        if interrupted:
            delivery.say_not_written(self._together)
            output.say("Interrupted.")
        else:
            stdout = self.given["kind"] != "text"
            delivery.deliver(reports, self.given, several=self.several, stdout=stdout, missing=self._missing())
        return summary.exit_code

    def _say_older(self, wanted: output.Target) -> None:
        """Say which reports there are of an earlier run: somebody might take them for those of this one."""
        written = {places.own_file(wanted, self.reports[self.found.keystores[number]]).path for number in self.rows}
        older = [str(path) for path in places.older_files(wanted, written)]
        if older:
            named = some(older, MAX_NAMED)
            alone = len(older) == 1
            said = (
                "1 report is not of this run, and stays"
                if alone
                else f"{len(older)} reports are not of this run, and stay"
            )
            output.say(f"{said}: {named}.")

    def _show_summary(self, summary: Summary) -> None:
        view = delivery.view(self.given, stdout=True)
        if not self.several:
            return
        if self._summarised:
            output.write_stdout(render_text(summary, view))
            return
        from keystore_audit.report.text import render_total

        verdicts = [each.verdict for each in summary.rows if each.verdict is not None]
        if verdicts:
            output.write_stdout(render_total(verdicts, self._missing(), width=view.width, color=view.color))

    def _missing(self) -> list[NoReport]:
        """What an audit was to be of and there is no report of, in order."""
        from keystore_audit.report.content import NoReport

        unseen = [
            NoReport(path=path, reason=f"not looked into: {reason}.", exit_code=EXIT_INCOMPLETE)
            for path, reason in self.found.unseen
        ]
        rows = [self.rows[number] for number in sorted(self.rows)]
        without = (each for each in rows if each.verdict is None)
        return [
            *unseen,
            *(NoReport(path=each.path, reason=each.error, exit_code=each.exit_code) for each in without),
        ]

    def _summary(self, *, interrupted: bool) -> Summary:
        keystores = self.found.keystores
        codes = [each.exit_code for each in self.rows.values()]
        codes += [EXIT_INCOMPLETE] * bool(self.found.unseen)
        worst = min(codes, key=WORST_FIRST.index, default=EXIT_INCOMPLETE)
        return Summary(
            version=__version__,
            at=self.options.at,
            exit_code=EXIT_INTERRUPTED if interrupted else worst,
            rows=tuple(self.rows[number] for number in sorted(self.rows)),
            not_audited=tuple(path for number, path in enumerate(keystores) if number not in self.rows),
            unseen=self.found.unseen,
            reports=self.reports,
            interrupted=interrupted,
        )
