"""Real sessions and routers, asked again: each measured case, on loopback, and what we say of its files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from keystore_audit.keystore.keystore import Keystore, read_keystore
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.asking import ours, real_answers
from tests.oracles.zenoh.cases import Case, cases

FIRST_PORT = 21000
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return deployment.keystore(tmp_path_factory.mktemp("keystore"))


@pytest.fixture(scope="module")
def keystore(store: Path) -> Keystore:
    return read_keystore(store)


@pytest.fixture(scope="module")
def every(store: Path) -> Sequence[Case]:
    return [*cases(store, FIRST_PORT)]


def test_real_sessions_do_what_was_measured(every: Sequence[Case]) -> None:
    measured = {case.name: case.measured for case in every}
    assert real_answers(every, measured) == measured
    assert len(every) >= 60


def test_we_say_what_was_measured(every: Sequence[Case], keystore: Keystore, tmp_path: Path) -> None:
    said = {case.name: ours(case, keystore, tmp_path / case.name) for case in every}
    wrong = {case.name: said[case.name] for case in every if said[case.name] != (case.ours or case.measured)}
    assert wrong == {}
