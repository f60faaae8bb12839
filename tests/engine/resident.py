"""The program's runs of the Analyzer in a JVM that stays: a new one takes some two seconds of processor time each.

All else is the program's own: the files and their directory, the Analyzer's command line, what it writes, and how that
is read. What a process of its own adds (limits, signals, an environment) is asked in tests/engine/alloy/test_runner.py.
"""

from __future__ import annotations

import jpype
from msgspec import Struct

from keystore_audit.engine.alloy.process import ARGUMENTS, OUTPUT_DIRECTORY, AnalyzerProcess
from tests.engine.alloy_batch import start_jvm


class _Ended(Struct, frozen=True):
    """What the program asks of its child."""

    status: int
    pid: int = -1  # of no process, so that the limit of processor time meets none

    def wait(self, timeout: float) -> int:  # noqa: ARG002
        return self.status

    def poll(self) -> int:
        return self.status


def analyze_here(process: AnalyzerProcess) -> _Ended:
    """Do as the Analyzer's `main` does, but for its exit. In place of `AnalyzerProcess._start`."""
    start_jvm()
    system, stream = jpype.JClass("java.lang.System"), jpype.JClass("java.io.PrintStream")
    dispatcher = jpype.JClass("org.alloytools.alloy.core.infra.AlloyDispatcher")
    directory = process.directory
    arguments = [*ARGUMENTS, str(directory / OUTPUT_DIRECTORY), str(directory / process._job.main)]
    before = system.err, system.out
    after = stream(str(directory / "diagnostics")), stream(str(directory / "messages"))
    system.setErr(after[0])
    system.setOut(after[1])
    log = jpype.JClass("org.slf4j.impl.SimpleLogger").class_.getDeclaredField("TARGET_STREAM")
    log.setAccessible(True)
    log.set(None, after[0])  # it has kept the stream that was stderr when it was loaded
    try:
        dispatcher.exitCode = 0
        analyzer = dispatcher()
        line = jpype.JClass("aQute.lib.getopt.CommandLine")(analyzer)
        fault = line.execute(analyzer, "_alloy", jpype.JClass("java.util.Arrays").asList(arguments))
        if fault is not None:
            system.err.println(fault)
        return _Ended(int(dispatcher.exitCode))
    finally:
        system.setErr(before[0])
        system.setOut(before[1])
        log.set(None, before[0])
        for each in after:
            each.close()
