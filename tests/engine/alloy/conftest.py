"""The Analyzer for tests that start it."""

from __future__ import annotations

import pytest

from keystore_audit.engine.alloy.install import Engine
from tests.engine.alloy_batch import engine


@pytest.fixture(scope="session")
def analyzer() -> Engine:
    """Java and the checked jar; a failure in CI where they cannot be had, else a skip."""
    return engine()
