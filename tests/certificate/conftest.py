"""What tests of certificates share."""

from __future__ import annotations

import shutil

import pytest

from tests.conftest import lacking


@pytest.fixture(autouse=True, scope="session")
def _openssl() -> None:
    if shutil.which("openssl") is None:
        lacking("openssl")
