"""The vendors' programs and plugins, where they are those that the profiles speak of."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.oracles.vendors.pairs import Pairs, pairs
from tests.oracles.xml.parsers import require_measured_versions
from tests.oracles.xml.plugins import Plugin, both


@pytest.fixture(scope="module")
def vendors(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Pairs]]:
    require_measured_versions(oracle)
    with pairs(oracle, tmp_path_factory.mktemp("programs")) as programs:
        yield programs


@pytest.fixture(scope="module")
def plugins(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Plugin]]:
    require_measured_versions(oracle)
    with both(oracle, tmp_path_factory.mktemp("plugins")) as running:
        yield running
