"""Facts 4.4, end to end: directories, links and special files where one enclave should be."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.hostile.directories import CASES
from tests.hostile.store import Case, parameters


@pytest.mark.parametrize("case", parameters(CASES))
def test_directory(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)
