"""Work that copies of the process do: the same answers, with and without them, and when they die."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.keystore import builder

AT = "2025-06-01T00:00:00Z"

# A process of its own: that of the tests has threads, beside which no copies are made.
AUDIT = """
import os, sys
copies = []
sys.addaudithook(lambda event, _: copies.append(event) if event == "os.fork" else None)
if sys.argv[1] == "one processor":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
if sys.argv[1] == "dying":
    os.register_at_fork(after_in_child=lambda: os._exit(9))
from keystore_audit.cli.program import run
code = run(sys.argv[2:])
print(len(copies), file=sys.stderr)
sys.exit(code)
"""

ALONE = """
import os, signal, threading
from keystore_audit.aside import Aside

here = os.getpid()
left, right = object(), object()
both = lambda: (os.getpid(), left, [right, left])

with Aside(both, known=(left, right)) as aside:
    there, one, (two, three) = aside.result()
assert there != here and one is left and two is right and three is left

def dies():
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)
    return "done here"

with Aside(dies) as aside:
    assert aside.result() == "done here"

def no_pickle():
    return lambda: os.getpid()

with Aside(no_pickle) as aside:
    assert aside.result()() == here

def wrong():
    raise LookupError("said to whoever asked")

try:
    with Aside(wrong) as aside:
        aside.result()
except LookupError as error:
    assert str(error) == "said to whoever asked"
else:
    raise AssertionError

with Aside(lambda: signal.pause()):  # nobody asks, and it would never end by itself
    pass

with Aside(os.getpid, wanted=False) as aside:
    assert aside.result() == here

waiting = threading.Event()
other = threading.Thread(target=waiting.wait)
other.start()
with Aside(os.getpid) as aside:
    assert aside.result() == here
waiting.set()
other.join()

try:
    os.waitpid(-1, os.WNOHANG)
except ChildProcessError:
    print("nothing is left")
"""


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", *arguments], capture_output=True, text=True, check=False, timeout=120)


def test_a_copy_answers_and_whatever_becomes_of_it_the_answer_is_the_same() -> None:
    done = python(ALONE)
    assert (done.stdout, done.stderr) == ("nothing is left\n", "")


@pytest.fixture(scope="module")
def keystore(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """So many enclaves that copies take part, with something wrong in each half that is read and judged apart."""
    root = builder.sros2(tmp_path_factory.mktemp("many") / "keystore", [f"/robot/n{n:03}" for n in range(120)])
    for number in (3, 90):
        enclave = root / f"enclaves/robot/n{number:03}"
        (enclave / "permissions.p7s").write_bytes(
            (enclave / "permissions.p7s").read_bytes().replace(b"chatter", b"bla")
        )
        enclave.with_name(f"n{number + 1:03}").joinpath("key.pem").write_text("no key\n")
        os.replace(enclave.with_name(f"n{number + 2:03}") / "key.pem", enclave / "key.pem")
        os.symlink(f"../n{number:03}/key.pem", enclave.with_name(f"n{number + 2:03}") / "key.pem")
        document = builder.PERMISSIONS.format(name=f"/robot/n{number + 3:03}").encode()
        stranger = builder.signed_document(document, builder.authority("stranger"))
        enclave.with_name(f"n{number + 3:03}").joinpath("permissions.p7s").write_bytes(stranger)
        enclave.with_name(f"n{number + 4:03}").joinpath("permissions.p7s").unlink()
        (enclave.with_name(f"n{number + 5:03}") / "permissions.p7s").write_bytes(b"\0" * 100)
    elsewhere = root / "enclaves/robot/n041/permissions.p7s"
    elsewhere.unlink()
    elsewhere.symlink_to("/elsewhere/permissions.p7s")  # outside: nobody knows what it says
    same = (root / "enclaves/robot/n020/permissions.p7s").read_bytes()
    for number in (21, 70, 71):
        (root / f"enclaves/robot/n{number:03}/permissions.p7s").write_bytes(same)
    return root


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As many, and nothing wrong."""
    return builder.sros2(tmp_path_factory.mktemp("well") / "keystore", [f"/robot/n{n:03}" for n in range(120)])


def answered(mode: str, *arguments: str) -> tuple[str, int, int]:
    """What was written, the exit code, and how many copies were made."""
    done = python(AUDIT, mode, *arguments)
    return done.stdout, done.returncode, int(done.stderr)


def report(keystore: Path, mode: str, jobs: int, *options: str) -> tuple[str, int, int]:
    """The report, the exit code, and how many copies were made."""
    return answered(mode, "audit", "--engine", "native", "--at", AT, "-j", str(jobs), *options, str(keystore))


@pytest.mark.parametrize("kind", ["json", "text"])
def test_copies_change_no_byte_of_a_report(keystore: Path, kind: str) -> None:
    alone, code, copies = report(keystore, "", 1, "--format", kind)
    assert copies == 0
    assert code == 4
    for mode in ("", "dying"):
        found, same_code, copies = report(keystore, mode, 2, "--format", kind)
        assert found == alone
        assert same_code == code
        assert copies >= 3


def test_the_report_speaks_of_both_halves(keystore: Path) -> None:
    found: dict[str, Any] = json.loads(report(keystore, "", 2, "--format", "json")[0])
    spoken = {finding["enclave"] for finding in found["findings"]}
    assert {f"/robot/n{number:03}" for number in (3, 4, 6, 8, 90, 91, 93, 95)} <= spoken


def test_few_enclaves_are_audited_in_one_process(tmp_path: Path) -> None:
    few = builder.sros2(tmp_path / "keystore", [f"/n{number}" for number in range(20)])
    assert report(few, "", 2, "--format", "json")[2] == 0


@pytest.mark.parametrize(("which", "source", "code"), [("keystore", "n041", 4), ("healthy", "n010", 1)])
def test_copies_change_no_byte_of_a_flow(which: str, source: str, code: int, request: pytest.FixtureRequest) -> None:
    root = str(request.getfixturevalue(which))
    profiles = ("--profile", "spec") if which == "keystore" else ()  # one that the healthy one has no flow under
    asked = ("flow", "--at", AT, *profiles, root, f"/robot/{source}", "/robot/n119")
    alone, exit_code, copies = answered("one processor", *asked)
    assert (exit_code, copies) == (code, 0)
    assert ("It depends on what could not be read: " in alone and "n041/permissions.p7s" in alone) is (code == 4)
    for mode in ("", "dying"):
        found, same_code, copies = answered(mode, *asked)
        assert found == alone
        assert same_code == code
        assert copies >= 3  # for reading, for certificates, for the answers about half of the systems
