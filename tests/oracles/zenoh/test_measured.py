"""Real sessions and routers, asked again: each measured case, on loopback, and what we say of its files."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.profiles import ROUTED
from tests.amount import SHARE
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.asking import ours, real_answers
from tests.oracles.zenoh.cases import Case, cases

FIRST_PORT = 21000
OLDER = {"1.4.0": "zenoh-1.4", "1.6.2": "zenoh-1.6", "1.7.2": "zenoh-1.7"}
"""Releases and their profiles. Where one does something else than the newest:"""
OTHERWISE = {("B21", "1.4.0"): "error", **{(name, old): "no" for name in ("E02", "E22") for old in ("1.4.0", "1.6.2")}}
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return deployment.keystore(tmp_path_factory.mktemp("keystore"), deployment.ODD | deployment.MISNAMED)


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


@pytest.mark.skipif(SHARE < 1, reason="make test-long asks older releases")
@pytest.mark.parametrize("version", OLDER)
def test_older_releases_do_what_their_profile_says(
    version: str, every: Sequence[Case], keystore: Keystore, oracle: Callable[[str], str], tmp_path: Path
) -> None:
    expected = {case.name: OTHERWISE.get((case.name, version), case.measured) for case in every}
    assert real_answers(every, expected, oracle(f"{sys.prefix}/zenoh-{version}/bin/python")) == expected
    said = {case.name: ours(case, keystore, tmp_path / case.name, ROUTED[OLDER[version]]) for case in every}
    assert {name: told for name, told in said.items() if told not in (expected[name], "unknown")} == {}
