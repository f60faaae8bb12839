"""The runner believes the Analyzer only where it answers completely, and leaves nothing behind."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import psutil
import pytest

from keystore_audit import resources
from keystore_audit.engine.alloy import runner, solvers
from keystore_audit.engine.alloy.answers import Command, verdicts, witness
from keystore_audit.engine.alloy.facts import count_atoms
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.kept import kept
from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.alloy.runner import examine
from keystore_audit.errors import EngineError, EngineFailed, EngineMissing, EngineOutOfScale, EngineTimeout
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID, PROPERTIES, Status
from keystore_audit.properties.result import Role
from tests.engine.systems import CHATTER, LISTENER, healthy, random_system, stock

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

ENOUGH = 120.0
"""Seconds for a small model on a busy machine."""

SYSTEMS = (healthy(), stock())

BEHIND = Path(__file__).with_name("behind.py")


@pytest.fixture(autouse=True)
def nothing_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Run directories go below `tmp_path`, and none is left."""
    place = tmp_path / "runs"
    place.mkdir()
    monkeypatch.setattr(solvers.tempfile, "tempdir", str(place))
    yield
    assert list(place.iterdir()) == []


def java(tmp_path: Path, analyzer: Engine, script: str) -> Path:
    """A program in Java's place; `$REAL` is the real one."""
    path = tmp_path / "java"
    path.write_text(f"#!/bin/sh\nREAL='{analyzer.java}'\n{script}\n")
    path.chmod(0o755)
    return path


def test_a_healthy_system_holds_and_has_no_witness(analyzer: Engine) -> None:
    answers = examine([healthy()], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)[0].answers
    assert [*answers] == [prop.id for prop in PROPERTIES]
    assert {(answer.status, answer.witnesses) for answer in answers.values()} == {(Status.HOLDS, ())}


def test_a_violated_property_comes_with_its_witness(analyzer: Engine) -> None:
    [decision] = examine([stock()], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)
    answer = decision.answers["readers-cannot-forge"]
    assert answer.status is Status.VIOLATED
    assert answer.witnesses == ({Role.TRUST_DOMAIN: 0, Role.ENCLAVE: LISTENER, Role.CHANNEL: CHATTER},)


def test_many_systems_keep_their_order(analyzer: Engine) -> None:
    systems = [healthy(), stock(), random_system(159), healthy()]
    decisions = examine(systems, java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)
    together = [decision.answers for decision in decisions]
    assert together[0] == together[3]
    assert [sum(a.status is Status.VIOLATED for a in answers.values()) for answers in together][:2] == [0, 2]
    assert sum(a.status is Status.VIOLATED for a in together[2].values()) >= 8


def test_no_systems_need_no_engine() -> None:
    assert examine([], java=Path("/nonexistent"), jar=Path("/nonexistent"), timeout=1) == ()


def test_java_options_of_the_environment_are_not_inherited(analyzer: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("JAVA_TOOL_OPTIONS", "JDK_JAVA_OPTIONS", "_JAVA_OPTIONS"):
        monkeypatch.setenv(variable, "-Xmx1k --nonsense")
    monkeypatch.setenv("CLASSPATH", "/nonexistent")
    assert examine([healthy()], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)


# Faults: each is an error with a sentence of its own, and nothing reads as "holds".


def failing(analyzer: Engine, expected: type[EngineError], **changed: object) -> str:
    arguments: dict[str, object] = {"java": analyzer.java, "jar": analyzer.jar, "timeout": ENOUGH}
    with pytest.raises(EngineError) as caught:
        examine(SYSTEMS, **{**arguments, **changed})  # type: ignore[arg-type]
    assert type(caught.value) is expected
    message = caught.value.message
    assert message.endswith((".", ")")) or len(message) > 40
    return message


def test_no_java(analyzer: Engine, tmp_path: Path) -> None:
    assert "No such file" in failing(analyzer, EngineMissing, java=tmp_path / "nothing")


def test_no_jar(analyzer: Engine, tmp_path: Path) -> None:
    assert "jar" in failing(analyzer, EngineMissing, jar=tmp_path / "nothing.jar")


def test_a_jar_that_is_none(analyzer: Engine, tmp_path: Path) -> None:
    jar = tmp_path / "broken.jar"
    jar.write_bytes(analyzer.jar.read_bytes()[:1_000_000])
    assert "broken.jar" in failing(analyzer, EngineFailed, jar=jar)


def test_what_runs_is_a_copy_of_what_was_checked(analyzer: Engine, tmp_path: Path) -> None:
    replaced = tmp_path / "alloy.jar"
    shutil.copyfile(analyzer.jar, replaced)
    swapping = java(tmp_path, analyzer, f'echo swapped > \'{replaced}\'; exec "$REAL" "$@"')
    assert examine([healthy()], java=swapping, jar=replaced, timeout=ENOUGH)
    assert replaced.read_text() == "swapped\n"


def test_a_killed_solver(analyzer: Engine, tmp_path: Path) -> None:
    killed = java(tmp_path, analyzer, "kill -9 $$")
    assert failing(analyzer, EngineFailed, java=killed) == "The Alloy Analyzer was killed by signal 9."


def test_a_solver_that_does_not_end(analyzer: Engine, tmp_path: Path) -> None:
    """Its children end with it: they would run for longer than pytest's `faulthandler_timeout` lets a test run."""
    slow = java(tmp_path, analyzer, f"sleep 1234567 & echo $! > '{tmp_path}/child'; wait")
    message = failing(analyzer, EngineTimeout, java=slow, timeout=1)
    assert "within 1 seconds" in message
    assert "--timeout" in message
    child = Path(f"/proc/{(tmp_path / 'child').read_text().strip()}/stat")
    assert not child.exists() or child.read_text().split()[2] == "Z"


def test_the_real_analyzer_out_of_time(analyzer: Engine) -> None:
    assert "0.05 seconds" in failing(analyzer, EngineTimeout, timeout=0.05)


def test_out_of_memory(analyzer: Engine) -> None:
    assert "4 MiB of memory" in failing(analyzer, EngineFailed, memory_mb=4)


def test_java_too_old(analyzer: Engine, tmp_path: Path) -> None:
    old = java(tmp_path, analyzer, 'echo "Unrecognized option: --enable-native-access=ALL-UNNAMED" >&2; exit 1')
    assert "Java 17" in failing(analyzer, EngineFailed, java=old)


def test_a_crash_without_a_word(analyzer: Engine, tmp_path: Path) -> None:
    assert "status 3" in failing(analyzer, EngineFailed, java=java(tmp_path, analyzer, "exit 3"))


def test_a_program_that_only_ends(analyzer: Engine, tmp_path: Path) -> None:
    assert "status 1: it said nothing" in failing(analyzer, EngineFailed, java=java(tmp_path, analyzer, "exit 0"))


ANSWER = 'echo "$NONCE $DIGEST $STATUS"'
"""What says an answer (tests/engine/alloy/behind.py)."""


@pytest.fixture(scope="module")
def records(analyzer: Engine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the Analyzer answers about SYSTEMS, asked once."""
    folder = tmp_path_factory.mktemp("recorded")
    examine(SYSTEMS, java=in_front(folder, analyzer, folder, ANSWER), jar=analyzer.jar, timeout=ENOUGH)
    return folder


def in_front(tmp_path: Path, analyzer: Engine, records: Path, shell: str) -> Path:
    """A program in Java's place that does `shell` to each answer."""
    words = map(shlex.quote, (sys.executable, str(BEHIND), str(analyzer.java), str(records), shell))
    return java(tmp_path, analyzer, f'exec {" ".join(words)} "$@"')


@pytest.mark.parametrize(
    "filter_",
    [
        "head -n 15",
        "sed 's/UNSAT/ERROR/'",
        "sed 's/UNSAT$/UNSA/'",
        "sed '$d' | sed '$p'",
        "sed 's/OutsidersCannotRead/OutsidersCanRead/'",
        "sed '1!G;h;$!d'",
        "cat; echo '16. check Another 0 UNSAT'",
        "cat; echo 'Exception in thread main'",
        "true",
    ],
)
def test_verdicts_that_are_not_exactly_the_expected_ones(
    filter_: str, analyzer: Engine, records: Path, tmp_path: Path
) -> None:
    shell = f"cat diagnostics | {{ {filter_}; }} > altered; mv altered diagnostics; {ANSWER}"
    failing(analyzer, EngineFailed, java=in_front(tmp_path, analyzer, records, shell))


@pytest.mark.parametrize(
    "damage",
    [
        "rm",
        "truncate -s 3000",
        "sed -i 's/_enclave\"/_someone\"/'",
        "sed -i 's/E1_listener/E7_listener/'",
        "sed -i 's/E1_listener/T1_listener/'",
        "printf '<alloy/>' >",
    ],
)
def test_a_counterexample_that_cannot_be_read(damage: str, analyzer: Engine, records: Path, tmp_path: Path) -> None:
    instance = "solutions/ReadersCannotForge-solution-0.xml"
    shell = f"if test -e {instance}; then {damage} {instance}; fi; {ANSWER}"
    assert "ReadersCannotForge" in failing(analyzer, EngineFailed, java=in_front(tmp_path, analyzer, records, shell))


@pytest.mark.parametrize(
    ("shell", "said"),
    [
        (f"{ANSWER}; {ANSWER}", "no valid answer"),
        (f"if test -e ../first; then cat ../first; else {ANSWER} | tee ../first; fi", "no valid answer"),
        ('echo "$NONCE 0000 $STATUS"', "no valid answer"),
        ('echo "0000 $DIGEST $STATUS"', "no valid answer"),
        ('echo "$NONCE $DIGEST"', "no valid answer"),
        ('echo "$NONCE $DIGEST $STATUS 0"', "no valid answer"),
        ('echo "$STATUS"', "no valid answer"),
        (f"echo hello; {ANSWER}", "no valid answer"),
        ("yes", "no valid answer"),
        ("rm diagnostics; " + ANSWER, "answered 0 of"),
        ('STATUS=7; ' + ANSWER, "status 7"),
        (f"{ANSWER}; kill -9 $PPID", "killed by signal 9"),
        (f"{ANSWER}; exit 5", "status 5"),
        ("exit 5", "status 5"),
    ],
)  # fmt: skip
def test_a_program_that_lies_or_ends(shell: str, said: str, analyzer: Engine, records: Path, tmp_path: Path) -> None:
    assert said in failing(analyzer, EngineFailed, java=in_front(tmp_path, analyzer, records, shell))


def test_a_program_that_falls_silent(analyzer: Engine, records: Path, tmp_path: Path) -> None:
    silent = in_front(tmp_path, analyzer, records, f"test -e ../first && sleep 1000; touch ../first; {ANSWER}")
    assert "within 1 seconds" in failing(analyzer, EngineTimeout, java=silent, timeout=1)


def test_what_was_recorded_is_an_answer(analyzer: Engine, records: Path, tmp_path: Path) -> None:
    """Nothing but what was altered above is amiss with it."""
    recorded = in_front(tmp_path, analyzer, records, ANSWER)
    first, second = examine(SYSTEMS, java=recorded, jar=analyzer.jar, timeout=ENOUGH)
    assert {answer.status for answer in first.answers.values()} == {Status.HOLDS}
    assert second.answers["readers-cannot-forge"].witnesses


def test_a_run_has_one_jvm_which_is_asked_nothing_twice(analyzer: Engine, records: Path, tmp_path: Path) -> None:
    log = tmp_path / "asked"
    logging = in_front(tmp_path, analyzer, records, f"echo $PPID $DIGEST >> {log}; {ANSWER}")

    def asked(systems: Sequence[System], timeout: float = ENOUGH) -> list[dict[str, Status]]:
        found = examine(systems, java=logging, jar=analyzer.jar, timeout=timeout)
        return [{name: answer.status for name, answer in each.answers.items()} for each in found]

    with kept():
        first, second = asked([healthy()]), asked([stock()])
        assert asked([stock(), healthy(), stock()]) == [*second, *first, *second]
    lines = [line.split() for line in log.read_text().splitlines()]
    assert len({process for process, _digest in lines}) == 1
    assert len({digest for _process, digest in lines}) == len(lines) == 2
    assert asked([healthy()]) == first
    assert len(log.read_text().splitlines()) == 3, "another run asks again"


def test_a_jvm_that_misbehaved_is_not_asked_again(analyzer: Engine, records: Path, tmp_path: Path) -> None:
    shell = f"echo $PPID >> {tmp_path}/asked; test -e {tmp_path}/good || exit 5; {ANSWER}"
    program = in_front(tmp_path, analyzer, records, shell)
    with kept():
        for good in (False, True, True):
            if good:
                (tmp_path / "good").touch()
                assert examine([healthy()], java=program, jar=analyzer.jar, timeout=ENOUGH)
            else:
                with pytest.raises(EngineFailed, match="status 5"):
                    examine([healthy()], java=program, jar=analyzer.jar, timeout=ENOUGH)
    processes = (tmp_path / "asked").read_text().split()
    assert len(processes) == len(set(processes)) == 2


def test_the_next_question_is_not_touched_by_one_out_of_time(analyzer: Engine) -> None:
    with kept():
        with pytest.raises(EngineTimeout):
            examine([stock()], java=analyzer.java, jar=analyzer.jar, timeout=0.05)
        assert examine([healthy()], java=analyzer.java, jar=analyzer.jar, timeout=ENOUGH)


def test_a_jvm_ends_with_the_process_that_asks_it(analyzer: Engine, tmp_path: Path) -> None:
    """Killed itself, that leaves the end of its input; the real program ends in the middle of a question."""
    code = (
        "import os, pathlib, sys\n"
        "from keystore_audit.engine.alloy import process, runner\n"
        "from tests.engine.systems import healthy\n"
        "real = process.Jvm.ask\n"
        "def ask(self, *words):\n"
        "    real(self, *words)\n"
        "    print(self._process.pid, flush=True)\n"
        "    os.kill(os.getpid(), 9)\n"
        "process.Jvm.ask = ask\n"
        "runner.examine([healthy()], java=pathlib.Path(sys.argv[1]), jar=pathlib.Path(sys.argv[2]), timeout=60)\n"
    )
    command = [sys.executable, "-c", code, str(analyzer.java), str(analyzer.jar)]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[3], env=environment, check=False)
    assert done.returncode == -signal.SIGKILL
    with contextlib.suppress(psutil.NoSuchProcess):
        psutil.Process(int(done.stdout)).wait(timeout=30)


def with_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, old: str, new: str) -> None:
    """Use a copy of the modules in which `old` is `new`."""
    folder = tmp_path / "alloy"
    shutil.copytree(resources.alloy(), folder)
    text = (folder / module).read_text()
    assert old in text
    (folder / module).write_text(text.replace(old, new, 1))
    monkeypatch.setattr(resources, "alloy", lambda: folder)


def test_a_syntax_error_in_a_module(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_model(tmp_path, monkeypatch, "properties.als", "pred OutsidersCannotRead {", "pred {{{")
    message = failing(analyzer, EngineFailed)
    assert "properties.als, line" in message
    assert str(tmp_path) not in message


def test_a_name_that_no_module_defines(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault that makes svROS report that every property holds."""
    with_model(tmp_path, monkeypatch, "governance.als", "preceded_by.covers", "preceded_by.coverz")
    assert "governance.als, line" in failing(analyzer, EngineFailed)


def test_a_property_that_is_not_there(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_model(tmp_path, monkeypatch, "properties.als", "pred OutsidersCannotRead {", "pred Another {")
    assert "OutsidersCannotRead" in failing(analyzer, EngineFailed)


def test_facts_that_contradict_each_other(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an impossible world everything is true."""
    with_model(tmp_path, monkeypatch, "vacuity.als", "open properties", "open properties\nfact { no Enclave }")
    assert "contradicts itself" in failing(analyzer, EngineFailed)


def test_a_missing_module(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "alloy"
    folder.mkdir()
    monkeypatch.setattr(resources, "alloy", lambda: folder)
    assert "incomplete: an Alloy module cannot be read" in failing(analyzer, EngineFailed)


def test_a_system_out_of_scale_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "MAX_ATOMS", count_atoms(merge(healthy()).system) - 1)
    with pytest.raises(EngineOutOfScale, match="atoms"):
        examine([healthy()], java=Path("/nonexistent"), jar=Path("/nonexistent"), timeout=1)


def test_an_interrupt_ends_the_solver(analyzer: Engine, tmp_path: Path) -> None:
    slow = java(tmp_path, analyzer, f"echo $$ > '{tmp_path}/pid'; exec sleep 1234")
    code = (
        "from pathlib import Path\n"
        "from keystore_audit.engine.alloy.runner import examine\n"
        "from tests.engine.systems import healthy\n"
        f"examine([healthy()], java=Path({str(slow)!r}), jar=Path({str(analyzer.jar)!r}), timeout=60)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, cwd=Path(__file__).parents[3])
    deadline = time.monotonic() + 30
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text().strip():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    _out, error = child.communicate(timeout=20)
    assert b"KeyboardInterrupt" in error
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


# The reader, alone.

TWO = (Command(kind="run", name="FactsAreConsistent"), Command(kind="check", name="ReadersCannotForge"))


def test_verdicts_are_read_with_the_progress_in_them() -> None:
    text = (
        "00. run   FactsAreConsistent       0\b\b\b    1/1     SAT\n01. check ReadersCannotForge       0       UNSAT\n"
    )
    assert verdicts(text, TWO) == {"FactsAreConsistent": True, "ReadersCannotForge": False}


def test_a_counterexample_is_no_place_for_entities(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("keystore/E0$0")
    (tmp_path / "ReadersCannotForge-solution-0.xml").write_text(
        f'<!DOCTYPE alloy [<!ENTITY e SYSTEM "{tmp_path}/secret">]>'
        '<alloy><instance><skolem label="$ReadersCannotForge_trust_domain"><tuple><atom label="&e;"/></tuple></skolem>'
        "</instance></alloy>"
    )
    prop = BY_ID["readers-cannot-forge"]
    with pytest.raises(EngineFailed):
        witness(tmp_path, prop.predicate, prop.roles, healthy())
