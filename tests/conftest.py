"""What every test shares: how hypothesis runs, where things are, and that CI lacks no oracle."""

from __future__ import annotations

import ctypes
import ctypes.util
import gc
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import settings

from keystore_audit.engine.alloy.kept import CURRENT, Kept
from keystore_audit.resources import in_ci
from tests.amount import tried

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background of a shell: programs that the tests interrupt would inherit that and never hear of it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

IN_CI = in_ci()

# No deadline: on two busy cores a pause says nothing about the code. CI repeats the same examples every time, so
# that a red run is the change's fault; elsewhere each run looks at new ones.
settings.register_profile("local", deadline=None, print_blob=True, max_examples=tried(100, 25))
settings.register_profile("ci", parent=settings.get_profile("local"), derandomize=True)
settings.load_profile("ci" if IN_CI else "local")


def lacking(what: str) -> NoReturn:
    """Skip a test of which something is not here; CI has to have it."""
    if IN_CI:
        pytest.fail(f"missing in CI: {what}")
    pytest.skip(f"not here: {what}")


def libcrypto() -> ctypes.CDLL:
    """The system's OpenSSL library."""
    return ctypes.CDLL(ctypes.util.find_library("crypto") or lacking("libcrypto"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """How golden files are written."""
    parser.addoption("--golden", action="store_true", help="write tests/golden again; then look at `git diff`")


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compares a text, whole, with the file of this name in tests/golden; with --golden, writes it."""

    def golden(name: str, text: str) -> None:
        file = Path(__file__).parent / "golden" / name
        if request.config.getoption("golden"):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, "utf-8")
        known = file.read_text("utf-8") if file.exists() else ""
        assert text == known, f"{name}: where that is meant, `pytest --golden` with this test writes it"

    return golden


def pytest_collection_finish() -> None:
    """Leave what was imported and collected out of later searches for garbage: JPype makes one after each of Java's."""
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_unconfigure() -> None:
    """End as the command does: msgspec may crash where the interpreter searches all it leaves for garbage."""
    gc.freeze()


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Keys and signatures are new in each process: bytes in the name of a test would be others in each worker."""
    return argname if isinstance(val, bytes) else None


@pytest.fixture(scope="session")
def session_solvers() -> Iterator[Kept]:
    """What is kept for all tests that take `resident_analyzer`."""
    with ExitStack() as stack:
        yield Kept(stack)


@pytest.fixture
def resident_analyzer(session_solvers: Kept) -> Iterator[None]:
    """Let the program find JVMs that run already, as in the middle of a fleet."""
    token = CURRENT.set(session_solvers)
    yield
    CURRENT.reset(token)


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the source tree."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared(repository: Path) -> Path:
    """The workplace's folder of facts, which a user's clone does not have."""
    folder = repository.parent / "shared"
    if not folder.is_dir():
        pytest.skip("no ../shared here")
    return folder


@pytest.fixture(scope="session")
def oracle() -> Callable[[str], str]:
    """Gives the path of a program that we did not write and compare with; in CI its absence is a failure."""

    def find(program: str) -> str:
        path = shutil.which(program)
        return path if path is not None else lacking(program)

    return find
